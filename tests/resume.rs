//! What becomes of a job when it is stopped, when its scene changes, and when it is asked for anew.
//!
//! Kills, power losses and full disks are `tests/reliability.rs`; here is what a user sees.

mod command;

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use command::{Place, code, lines, stderr, stdout};
use glowtree::archive::Digest;
use glowtree::bake::{self, Monitor, Options, Signal};

const ARCHIVES: [&str; 4] = ["scene.glow", "sites.glow", "links.glow", "light.glow"];

/// Names and digests of what a job is for: a difference then fits on a screen.
fn bytes(job: &Path) -> Vec<(&'static str, String)> {
    let digest = |name: &'static str| {
        let digest = Digest::of_file(job.join(name));
        (name, digest.map_or_else(|_| "absent".into(), |digest| digest.to_string()))
    };
    ARCHIVES.into_iter().chain(["mesh.ply", "preview.png"]).map(digest).collect()
}

/// Asks to stop at the n-th time that it is asked.
struct StopAt {
    left: AtomicU64,
}

impl Monitor for StopAt {
    fn interrupted(&self) -> Option<Signal> {
        let left = self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1));
        left.is_err().then_some(Signal::Terminate)
    }
}

#[test]
fn stopped_again_and_again_it_ends_with_the_same_bytes_and_redoes_nothing() {
    let place = Place::new();
    let options = Options { error: 0.1, ..Options::default() };
    let (scene, whole) = (place.path("scene.toml"), place.path("whole.glow"));
    let undisturbed = bake::run(&scene, &whole, &options, &bake::Silent).unwrap();
    let job = place.path("job.glow");
    let (mut stops, mut before) = (0, 0);
    let summary = loop {
        // Each run gets a little farther than the one before.
        let monitor = StopAt { left: AtomicU64::new(10 + 7 * stops) };
        match bake::run(&scene, &job, &options, &monitor) {
            Ok(summary) => break summary,
            Err(error) => assert_eq!(error.exit_code(), 143, "{error}"),
        }
        stops += 1;
        // What is on the disk only grows, but for rounds that are over.
        let now = std::fs::read_dir(job.join("work")).map_or(0, Iterator::count);
        assert!(now >= before.min(1), "stop {stops}: the work folder shrank");
        before = now;
        assert!(stops < 500, "it does not get on");
    };
    assert!(stops > 5, "{stops} stops are too few to tell");
    assert_eq!(bytes(&job), bytes(&whole), "after {stops} stops");
    // Every block was made once: those of the last run and those that it found are as many as undisturbed.
    let made = |s: &bake::Summary| s.resumed_blocks + s.computed_blocks;
    assert_eq!(made(&summary), made(&undisturbed), "{summary:?}");
    assert!(summary.resumed_blocks > 0 && !job.join("work").exists() && !job.join("lock").exists());
}

#[test]
fn other_lights_keep_the_operator_and_other_geometry_is_refused() {
    let place = Place::new();
    let bake = ["bake", "scene.toml", "-o", "job.glow", "--error", "10%", "--json", "--progress", "none"];
    assert_eq!(code(&place.run(&bake)), 0);
    let rows = |job: &str| {
        let archive = glowtree::archive::Archive::open(place.path(job).join("links.glow")).unwrap();
        let tag = glowtree::archive::Tag::new("rows");
        archive.blocks(tag).map(|block| block.stored().unwrap().to_vec()).collect::<Vec<_>>()
    };
    let before = (rows("job.glow"), std::fs::read(place.path("job.glow/light.glow")).unwrap());
    let scene = std::fs::read_to_string(place.path("scene.toml")).unwrap();
    std::fs::write(place.path("scene.toml"), scene.replace("intensity = [1, 1, 1]", "intensity = [2, 1, 0]"))
        .unwrap();

    let said = place.run(&["inspect", "job.glow"]);
    assert!(stdout(&said).contains("scene.toml has changed: lights or albedos"), "{}", stdout(&said));
    let again = place.run(&bake);
    assert_eq!(code(&again), 0, "{}", stderr(&again));
    let noted = lines(&again).iter().any(|line| {
        line["type"] == "note"
            && line["message"].as_str().is_some_and(|text| text.contains("sites and rows stay"))
    });
    assert!(noted, "{}", stdout(&again));
    assert!(rows("job.glow") == before.0, "R knows geometry only");
    assert_ne!(std::fs::read(place.path("job.glow/light.glow")).unwrap(), before.1);
    assert!(!place.path("job.glow.new").exists());
    // Light adds up: relit and baked anew agree within twice the target of the scene's mean.
    let fresh = ["bake", "scene.toml", "-o", "fresh.glow", "--error", "10%", "-q", "--no-preview"];
    assert_eq!(code(&place.run(&fresh)), 0);
    let mean = |job: &str| {
        let answers = place.run(&["probe", job, "--points", "points.csv", "-q"]);
        let text = stdout(&answers);
        let rows = text.lines().skip(1).map(|row| row.rsplit(',').nth(6).unwrap().parse::<f64>().unwrap());
        rows.sum::<f64>() / 2.0
    };
    let (relit, baked) = (mean("job.glow"), mean("fresh.glow"));
    assert!((relit / baked - 1.0).abs() < 0.2, "{relit} and {baked}");

    let mesh = std::fs::read_to_string(place.path("corner.ply")).unwrap();
    std::fs::write(place.path("corner.ply"), mesh.replacen("\n0 0 0 ", "\n0 0.01 0 ", 1)).unwrap();
    let refused = place.run(&bake);
    assert_eq!(code(&refused), 3);
    assert!(stderr(&refused).contains("corner.ply has changed"), "{}", stderr(&refused));
}

#[test]
fn a_restart_keeps_the_old_job_until_the_new_one_is_complete() {
    let place = Place::new();
    place.baked("job.glow");
    let old = bytes(&place.path("job.glow"));
    let options = Options { error: 0.05, restart: true, preview: false, ..Options::default() };
    let (scene, job) = (place.path("scene.toml"), place.path("job.glow"));
    let stopped = bake::run(&scene, &job, &options, &StopAt { left: AtomicU64::new(30) });
    assert_eq!(stopped.unwrap_err().exit_code(), 143);
    assert_eq!(bytes(&job), old, "the old job still answers");
    assert_eq!(code(&place.run(&["probe", "job.glow", "--points", "points.csv", "-q"])), 0);
    bake::run(&scene, &job, &options, &bake::Silent).unwrap();
    assert_ne!(bytes(&job), old);
    assert!(!place.path("job.glow.new").exists() && !job.join("lock").exists());
    let other = place.run(&["bake", "scene.toml", "-o", "job.glow", "--error", "20%", "-q"]);
    assert_eq!(code(&other), 3, "{}", stderr(&other));
}

/// A run may end between the exchange of a new job with the old one and the removal of the old one, or just before its
/// summary: what then lies there must not pass for the work of another command.
#[test]
fn what_was_made_of_something_else_is_never_taken_over() {
    let place = Place::new();
    let scene = place.path("scene.toml");
    let bake =
        |job: &str, options: &Options| bake::run(&scene, &place.path(job), options, &bake::Silent).unwrap();
    let coarse = Options { error: 0.2, ..Options::default() };
    let fine = Options { error: 0.05, ..Options::default() };
    bake("fine.glow", &fine);
    // The leftover of an exchange: a whole job of other options, pictures and all.
    bake("job.glow", &coarse);
    bake("job.glow.new", &coarse);
    bake("job.glow", &Options { restart: true, ..fine.clone() });
    assert_eq!(bytes(&place.path("job.glow")), bytes(&place.path("fine.glow")));
    assert!(!place.path("job.glow.new").exists());
    // A restart that ended just before its summary, then one of other options.
    bake("job.glow.new", &coarse);
    std::fs::remove_file(place.path("job.glow.new/summary.json")).unwrap();
    bake("job.glow", &Options { restart: true, ..fine });
    assert_eq!(bytes(&place.path("job.glow")), bytes(&place.path("fine.glow")));
    assert!(!place.path("job.glow.new").exists());
}

#[test]
fn an_unfinished_job_says_so_and_refuses_other_options() {
    let place = Place::new();
    let options = Options { error: 0.1, ..Options::default() };
    let stop = StopAt { left: AtomicU64::new(30) };
    bake::run(&place.path("scene.toml"), &place.path("job.glow"), &options, &stop).unwrap_err();
    let said = place.run(&["inspect", "job.glow"]);
    assert_eq!(code(&said), 0, "{}", stderr(&said));
    assert!(stdout(&said).contains("not finished") && stdout(&said).contains("round-1"), "{}", stdout(&said));
    assert_eq!(code(&place.run(&["probe", "job.glow", "--points", "points.csv"])), 10);
    let other = place.run(&["bake", "scene.toml", "-o", "job.glow", "--error", "20%", "-q"]);
    assert_eq!(code(&other), 3);
    let bake = ["bake", "scene.toml", "-o", "job.glow", "--error", "10%"];
    let same = place.run(&bake);
    assert_eq!(code(&same), 0);
    assert!(stderr(&same).contains("blocks of an earlier run are reused"), "{}", stderr(&same));
}

#[test]
fn a_budget_too_small_is_refused_with_its_exit_code_and_leaves_nothing_behind() {
    let place = Place::new();
    let bake = ["bake", "scene.toml", "-o", "job.glow", "--error", "10%", "--max-memory"];
    let small = place.run(&[&bake[..], &["100kB"]].concat());
    assert_eq!(code(&small), 6, "{}", stderr(&small));
    assert!(stderr(&small).contains("--max-memory"), "{}", stderr(&small));
    assert_eq!(code(&place.run(&[&bake[..], &["4GiB"]].concat())), 0);
}

#[test]
fn a_scene_that_cannot_be_read_leaves_no_job() {
    let place = Place::new();
    let refused = place.run(&["bake", "nowhere.ply", "-o", "job.glow"]);
    assert_eq!(code(&refused), 4);
    assert!(!place.path("job.glow").exists());
}
