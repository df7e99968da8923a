//! `glowtree chart SCENE -o DIR`: measures once, resumes, judges rightly, and says what rises.

#![allow(clippy::unwrap_used)] // a test that cannot go on panics where it stands

mod command;

use std::path::Path;

use command::{Place, code, lines, stderr, stdout};

/// A short ladder: two targets and one number of paths.
const LADDER: [&str; 12] = [
    "chart",
    "scene.toml",
    "-o",
    "charts",
    "--errors",
    "30%,15%",
    "--spp",
    "16",
    "--reference-spp",
    "256",
    "--seed",
    "3",
];

/// The scene's name in tables and files: that of the folder it lies in.
fn name(place: &Place) -> String {
    place.path("").canonicalize().unwrap().file_name().unwrap().to_string_lossy().into_owned()
}

fn text(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

fn charted(place: &Place, words: &[&str]) -> serde_json::Value {
    let output = place.run(&[words, &["--json"]].concat());
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    lines(&output).pop().unwrap()
}

#[test]
fn a_ladder_is_measured_once_and_drawn() {
    let place = Place::new();
    let first = charted(&place, &LADDER);
    let journal = text(&place.path("charts/measured.jsonl"));
    let count = first["measurements"].as_u64().unwrap();
    // Two targets, one number of paths, and one target again on other numbers of threads.
    assert!((3..=5).contains(&count) && first["measured"] == count, "{first}");
    assert_eq!(journal.lines().count() as u64, count);
    let table = text(&place.path("charts/chart.csv"));
    assert_eq!(table.lines().count() as u64, count + 1);
    for figure in ["error-cpu", "error-links", "memory", "residual", "scaling"] {
        for ending in ["svg", "png"] {
            let file = place.path(&format!("charts/{}-{figure}.{ending}", name(&place)));
            assert!(file.metadata().unwrap().len() > 1000, "{}", file.display());
        }
    }
    let again = charted(&place, &LADDER);
    assert_eq!((&again["measured"], &again["measurements"]), (&0.into(), &first["measurements"]));
    assert_eq!(text(&place.path("charts/measured.jsonl")), journal, "nothing is measured twice");
    assert_eq!(text(&place.path("charts/chart.csv")), table);
    // Another seed is another measurement; the reference stays.
    let mut other = LADDER;
    other[11] = "4";
    assert_eq!(charted(&place, &other)["measured"], count);
}

#[test]
fn a_journal_that_was_cut_short_costs_one_measurement() {
    let place = Place::new();
    charted(&place, &LADDER);
    let path = place.path("charts/measured.jsonl");
    let whole = text(&path);
    std::fs::write(&path, &whole[..whole.len() - 20]).unwrap();
    assert_eq!(charted(&place, &LADDER)["measured"], 1);
    assert_eq!(charted(&place, &LADDER)["measured"], 0);
}

/// A reference beside the scene that holds twice the light: everything measured must err by a half.
#[test]
fn the_reference_beside_the_scene_judges() {
    let place = Place::new();
    let points = ["scene.toml", "--points", "points.csv", "--spp", "1024", "-o", "reference.csv", "-q"];
    let traced = place.run(&[&["reference"][..], &points[..]].concat());
    assert_eq!(code(&traced), 0, "{}", stderr(&traced));
    let errors = |place: &Place| -> Vec<f64> {
        charted(place, &LADDER);
        let mut table = csv::Reader::from_path(place.path("charts/chart.csv")).unwrap();
        let at = table.headers().unwrap().iter().position(|h| h == "true_error").unwrap();
        table.records().map(|row| row.unwrap()[at].parse().unwrap()).collect()
    };
    // Two points at 30 % and at 16 paths: within the loosest target by far.
    let honest = errors(&place);
    assert!(honest.iter().all(|e| *e < 0.3), "{honest:?}");
    let reference = place.path("reference.csv");
    let mut table = csv::Reader::from_path(&reference).unwrap();
    let headers = table.headers().unwrap().clone();
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(&headers).unwrap();
    for row in table.records().map(Result::unwrap) {
        let doubled = headers.iter().zip(&row).map(|(head, value)| match head.starts_with("irradiance") {
            true => (2.0 * value.parse::<f64>().unwrap()).to_string(),
            false => value.to_string(),
        });
        writer.write_record(doubled).unwrap();
    }
    std::fs::write(&reference, writer.into_inner().unwrap()).unwrap();
    let halved = errors(&place);
    assert_eq!(halved.len(), honest.len());
    // Half of the light is missing: ½ of the mean over the points, at least so in the RMS, give or take the error itself.
    assert!(halved.iter().zip(&honest).all(|(h, e)| *h > 0.5 - e && *h < 1.0), "{halved:?}");
}

#[test]
fn what_has_no_meaning_is_refused() {
    let place = Place::new();
    assert_eq!(code(&place.run(&["chart"])), 2);
    assert_eq!(code(&place.run(&["chart", "scene.toml"])), 2, "no folder");
    assert_eq!(
        code(&place.run(&["chart", "scene.toml", "--stability", "-o", "d"])),
        2,
        "one thing at a time"
    );
    assert_eq!(code(&place.run(&["chart", "nowhere.ply", "-o", "d"])), 4);
    assert_eq!(code(&place.run(&["chart", "scene.toml", "-o", "d", "--basis", "wavelet"])), 2);
    std::fs::write(place.path("reference.csv"), "x,y,z,nx,ny,nz\n0,0,0,0,1,0\n").unwrap();
    let refused = place.run(&["chart", "scene.toml", "-o", "d"]);
    assert_eq!(code(&refused), 4, "{}", stderr(&refused));
    assert!(stderr(&refused).contains("irradiance_r"), "{}", stderr(&refused));
}

#[test]
fn people_are_told_the_slopes() {
    let place = Place::new();
    let output = place.run(&[&LADDER[..], &["--progress", "none"][..]].concat());
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    let said = stdout(&output);
    assert!(said.contains("measurements") && said.contains("hierarchical: error ~ CPU time^"), "{said}");
}

/// An interrupted chart leaves by 130, keeps what is measured, and goes on from there.
#[cfg(unix)]
#[test]
fn an_interrupted_chart_goes_on() {
    let place = Place::new();
    charted(&place, &LADDER);
    let journal = place.path("charts/measured.jsonl");
    let before = text(&journal).lines().count();
    // Long enough to be caught: a billion paths.
    let mut words = LADDER;
    words[7] = "1000000";
    let mut child = place
        .command(&words)
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    std::thread::sleep(std::time::Duration::from_secs(2));
    let sent =
        std::process::Command::new("kill").args(["-s", "INT", &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert!(text(&journal).lines().count() >= before);
    assert_eq!(charted(&place, &LADDER)["measured"], 0);
}
