//! The verb as users see it: exit codes, what is printed, and no panic over damage.

use std::fs;

use super::command::{Place, code, lines, stderr, stdout};

#[test]
fn damage_is_printed_and_repaired() {
    let place = Place::new();
    place.baked("job");
    let whole = place.run(&["verify", "job"]);
    assert_eq!(code(&whole), 0, "{}", stderr(&whole));
    assert!(stdout(&whole).contains("examined: whole"), "{}", stdout(&whole));
    assert!(stdout(&whole).contains("note: preview.png: absent"), "{}", stdout(&whole));
    let nothing = place.run(&["verify", "job", "--repair"]);
    assert_eq!(code(&nothing), 0, "{}", stderr(&nothing));

    let links = place.path("job/links.glow");
    let before = fs::read(&links).unwrap();
    let mut bytes = before.clone();
    let last = bytes.len() / 2;
    bytes[last] ^= 1;
    fs::write(&links, &bytes).unwrap();
    let damaged = place.run(&["verify", "job"]);
    assert_eq!(code(&damaged), 9);
    assert!(stdout(&damaged).contains("job/links.glow: block "), "{}", stdout(&damaged));
    assert!(stderr(&damaged).contains("`glowtree verify job --repair`"), "{}", stderr(&damaged));
    let json = place.run(&["verify", "job", "--json", "--progress", "none"]);
    let lines = lines(&json);
    assert_eq!((code(&json), lines.len()), (9, 2));
    assert_eq!(lines[0]["damages"].as_array().unwrap().len(), 1);
    assert_eq!((&lines[0]["verb"], &lines[1]["code"]), (&"verify".into(), &9.into()));

    let repaired = place.run(&["verify", "job", "--repair"]);
    assert_eq!(code(&repaired), 0, "{}", stderr(&repaired));
    assert!(stdout(&repaired).contains("1 block made"), "{}", stdout(&repaired));
    assert!(fs::read(&links).unwrap() == before);
    assert_eq!(code(&place.run(&["verify", "job", "-q"])), 0);
    assert_eq!(code(&place.run(&["verify", "nowhere"])), 10);
    assert_eq!(code(&place.run(&["verify", "scene.toml"])), 10);
}

#[test]
fn other_verbs_point_to_the_repair() {
    let place = Place::new();
    place.baked("job");
    let light = place.path("job/light.glow");
    let mut bytes = fs::read(&light).unwrap();
    bytes[4096 + 64] ^= 1;
    fs::write(&light, &bytes).unwrap();
    let output = place.run(&["probe", "job", "--points", "points.csv"]);
    assert_eq!(code(&output), 9);
    assert!(stderr(&output).contains("`glowtree verify job --repair` makes it anew"), "{}", stderr(&output));
}
