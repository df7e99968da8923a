//! R13: the same bytes, however it was made.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};

use glowtree::geometry::hash::mix2;

use super::super::job::{contents, same};
use super::super::program;
use super::super::tally::{Bad, Tally, Trial, broken};
use crate::ask::Ask;

/// Scenes of `data` with their error targets; the release has them finer.
const SCENES: [(&str, &str, &str); 3] =
    [("cornell", "20%", "1%"), ("wall", "20%", "2%"), ("specks", "20%", "2%")];

/// Every scene with 1, 2, 3 and 8 threads, at once and interrupted on the way.
pub fn threads(ask: &Ask, tally: &Tally) {
    let ways: Vec<(u32, bool)> = [1, 2, 3, 8].into_iter().flat_map(|n| [(n, false), (n, true)]).collect();
    let all: Vec<_> =
        SCENES.into_iter().flat_map(|scene| ways.iter().map(move |way| (scene, *way))).collect();
    let count = tally.at_most(all.len() as u64) as usize;
    let folder = tempfile::tempdir().unwrap();
    for (name, ..) in SCENES {
        copy(name, &folder.path().join(name));
    }
    let mut firsts: BTreeMap<&str, (BTreeMap<String, Vec<u8>>, Duration)> = BTreeMap::new();
    for ((name, push, release), (threads, interrupted)) in all.into_iter().take(count) {
        let job = folder.path().join(format!("{name}-{threads}-{interrupted}"));
        let error = if ask.release { release } else { push };
        let made = Made { name, error, threads, job: &job };
        let called =
            format!("{name} with {threads} threads{}", if interrupted { ", interrupted" } else { "" });
        tally.trial(&called, || {
            let started = Instant::now();
            if let (true, Some((_, long))) = (interrupted, firsts.get(name)) {
                made.interrupt(*long)?;
            }
            let said = program::run(&mut made.command(threads));
            if said.code != 0 {
                return broken(said.in_words());
            }
            let files = contents(&job);
            let long = started.elapsed();
            let (first, _) = firsts.entry(name).or_insert_with(|| (files.clone(), long));
            same(first, &files).map_err(Bad::Wrong)
        });
        let _ = std::fs::remove_dir_all(&job);
    }
    let names: Vec<&str> = SCENES.iter().map(|(name, ..)| *name).collect();
    tally.remark(format!("{}: archives, mesh.ply, preview.png", names.join(", ")));
}

/// Copies a scene of `data`; its picture, which would take most of the time, becomes small.
fn copy(name: &str, to: &Path) {
    std::fs::create_dir(to).unwrap();
    let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("data").join(name);
    for entry in std::fs::read_dir(from).unwrap().flatten() {
        std::fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
    }
    let scene = std::fs::read_to_string(to.join("scene.toml")).unwrap();
    assert!(scene.contains("size = [512, 512]"), "{name}");
    std::fs::write(to.join("scene.toml"), scene.replace("[512, 512]", "[32, 32]")).unwrap();
}

struct Made<'a> {
    name: &'a str,
    error: &'a str,
    threads: u32,
    job: &'a Path,
}

impl Made<'_> {
    fn command(&self, threads: u32) -> std::process::Command {
        let scene = self.job.with_file_name(self.name).join("scene.toml");
        let mut command = program::bake_at(self.error, (&scene, self.job), true);
        command.args(["--threads", &threads.to_string()]);
        command
    }

    /// Stopped twice on the way, with other threads than those it ends with.
    fn interrupt(&self, long: Duration) -> Trial {
        for time in 0..2 {
            let share = mix2(u64::from(self.threads), time) as f64 / u64::MAX as f64;
            let mut command = self.command(1 + (self.threads + time as u32) % 3);
            let (said, _) = program::run_and_send(&mut command, long.mul_f64(share * 0.8), "TERM");
            if said.code != 143 && said.code != 0 {
                return broken(said.in_words());
            }
        }
        Ok(())
    }
}
