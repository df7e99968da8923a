//! Row R7: a job that is cut short or overwritten while the program reads it.

use std::fs::{self, OpenOptions};
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;
use std::process::Stdio;
use std::thread::sleep;
use std::time::{Duration, Instant};

use glowtree::bake::verify::ARCHIVES;
use glowtree::geometry::hash;

use super::command::{Place, code, stderr};
use super::copy;

/// Trials of each push; a release makes more (`GLOWTREE_READERS`).
const TRIALS: u64 = 20;

/// Bytes that a trial writes over.
const OVERWRITTEN: usize = 1 << 18;

/// A job of some megabytes, in which reading takes a while.
fn rooms() -> Place {
    let place = Place::new();
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/data/rooms/scene.toml");
    let bake = place.run(&["bake", scene, "-o", "whole", "--error", "1%", "--no-preview", "-q"]);
    assert_eq!(code(&bake), 0, "{}", stderr(&bake));
    place
}

/// Runs a verb on a job that is spoilt meanwhile, many times; `right` judges exits with 0.
fn trials(place: &Place, words: &[&str], right: &dyn Fn(u64)) {
    copy(&place.path("whole"), &place.path("job"));
    let started = Instant::now();
    assert_eq!(code(&place.run(words)), 0);
    let run = started.elapsed();
    let trials = std::env::var("GLOWTREE_READERS").ok().and_then(|n| n.parse().ok()).unwrap_or(TRIALS);
    let (mut whole, mut refused, mut cut) = (0, 0, 0);
    for trial in 0..trials {
        copy(&place.path("whole"), &place.path("job"));
        let _ = fs::remove_file(place.path("out.csv"));
        let mut command = place.command(words);
        let reader = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let share = |salt| f64::from(hash::unit(salt, trial));
        // Spread over the run: reading comes first, answering is short.
        sleep(Duration::from_secs_f64(run.as_secs_f64() * share(1)));
        let kind = ARCHIVES[(share(2) * 4.0) as usize % 4];
        spoil(&place.path(&format!("job/{kind}.glow")), trial % 3, share(3));
        let output = reader.wait_with_output().unwrap();
        // `code` panics when a signal ended the program.
        match code(&output) {
            0 => {
                right(trial);
                whole += 1;
            }
            9 => {
                assert!(stderr(&output).contains("error: "), "{}", stderr(&output));
                assert!(!place.path("out.csv").exists(), "no output beside a refusal");
                cut += u64::from(stderr(&output).contains("was cut short while it was read"));
                refused += 1;
            }
            other => panic!("trial {trial}, {kind}.glow: exit {other}: {}", stderr(&output)),
        }
    }
    let verb = words[0];
    println!(
        "{verb}: {trials} trials, {whole} right, {refused} refused ({cut} of them bus errors), no signal"
    );
    assert_eq!(whole + refused, trials);
}

#[test]
fn readers_of_a_changing_job_answer_rightly_or_exit_with_9() {
    let place = rooms();
    let out = place.path("out.csv");
    let probe = ["probe", "job", "--points", "points.csv", "-o", "out.csv", "-q"];
    copy(&place.path("whole"), &place.path("job"));
    assert_eq!(code(&place.run(&probe)), 0);
    let answer = fs::read(&out).unwrap();
    trials(&place, &probe, &|trial| {
        assert!(fs::read(&out).unwrap() == answer, "trial {trial}: a wrong answer");
    });
    // Verifying looks longer than reading does, and reports what it sees.
    trials(&place, &["verify", "job", "-q"], &|_| ());
}

/// Cuts a file short, writes over a part of it, or over all of it.
fn spoil(path: &Path, how: u64, share: f64) {
    let length = fs::metadata(path).unwrap().len();
    let at = (share * length as f64) as u64;
    let mut file = OpenOptions::new().write(true).open(path).unwrap();
    match how {
        0 => file.set_len(at).unwrap(),
        1 => {
            file.seek(SeekFrom::Start(at)).unwrap();
            file.write_all(&vec![0x5a; OVERWRITTEN.min((length - at) as usize)]).unwrap();
        }
        _ => fs::write(path, vec![0x5a; length as usize]).unwrap(),
    }
}

#[test]
fn a_bus_error_is_an_exit_code() {
    let place = Place::new();
    let words = ["reference", "scene.toml", "--points", "points.csv", "--spp", "100000000", "-o", "out.csv"];
    let mut command = place.command(&words);
    let running = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    sleep(Duration::from_millis(500));
    let sent = std::process::Command::new("kill").args(["-BUS", &running.id().to_string()]).status().unwrap();
    assert!(sent.success());
    let output = running.wait_with_output().unwrap();
    assert_eq!(code(&output), 9, "{}", stderr(&output));
    assert!(stderr(&output).contains("cut short while it was read"), "{}", stderr(&output));
}
