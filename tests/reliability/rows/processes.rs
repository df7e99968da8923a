//! R1, R2, R11, R12: processes that end at any moment, asked or not, and two that meet.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use glowtree::geometry::hash::mix2;

use super::super::finished::Finished;
use super::super::job::{Beginning, Ground, contents, same};
use super::super::program::{self, Said};
use super::super::storage::Clumsy;
use super::super::storage::log::Mishap;
use super::super::tally::{Bad, Tally, Trial, broken, spread};
use crate::ask::Ask;

/// R1: the n-th change is the last, half of it when it writes; then the same again.
pub fn at_operations(_: &Ask, tally: &Tally) {
    each_killed(&Ground::new(true), tally);
}

/// R1b: the same with a mesh that stays in its file.
pub fn at_operations_streamed(_: &Ask, tally: &Tally) {
    each_killed(&Ground::streamed(), tally);
}

fn each_killed(ground: &Ground, tally: &Tally) {
    let beginnings = ground.beginnings();
    let changes = |from: &Beginning| (0..from.kinds.len()).filter(|&at| from.kinds[at].changes()).collect();
    let changes: Vec<Vec<usize>> = beginnings.iter().map(changes).collect();
    let counts: Vec<usize> = changes.iter().map(Vec::len).collect();
    tally.remark(format!("changes of the disk in a fresh bake, one that resumes, a restart: {counts:?}"));
    let all: Vec<(usize, usize)> =
        changes.iter().enumerate().flat_map(|(from, at)| at.iter().map(move |&at| (from, at))).collect();
    let picks = spread(tally.at_most(all.len() as u64), all.len() as u64);
    tally.trials(picks.len() as u64, |trial| {
        let (from, at) = all[picks[trial as usize] as usize - 1];
        let (beginning, job) = (&beginnings[from], ground.path(&format!("killed-{trial}")));
        let ended = match ground.begin(beginning, &Clumsy::at(at, Mishap::Killed), &job) {
            // Nothing comes after the last change that could fail.
            Ok(_) if Some(&at) != changes[from].last() => broken("a killed bake ended well"),
            _ => ground.go_on(beginning, &job),
        };
        let _ = std::fs::remove_dir_all(&job);
        (format!("killed at {at} ({:?}){}", beginning.kinds[at], beginning.name), ended)
    });
}

/// R2: the program is killed again and again until its job is done; then the next job.
pub fn at_random_times(_: &Ask, tally: &Tally) {
    killed_until_done(&Ground::new(true), tally);
}

/// R2b: the same with a mesh that stays in its file.
pub fn at_random_times_streamed(_: &Ask, tally: &Tally) {
    killed_until_done(&Ground::streamed(), tally);
}

fn killed_until_done(ground: &Ground, tally: &Tally) {
    let started = Instant::now();
    program::run(&mut ground.command(&ground.path("timed")));
    let long = started.elapsed();
    let (mut kills, mut bakes) = (0, 0);
    while kills < tally.asked() {
        let job = ground.path(&format!("killed-{bakes}"));
        let mut again = true;
        while again {
            let share = mix2(kills, bakes) as f64 / u64::MAX as f64;
            let before = Finished::of(&job, ground.digests);
            let command = &mut ground.command(&job);
            let (said, _) = program::run_and_send(command, long.mul_f64(share), "KILL");
            again = said.code == 137;
            if again {
                kills += 1;
                tally.count(1);
            } else {
                tally.check(&format!("bake {bakes}"), || finished(ground, &job, &before, &said));
            }
        }
        bakes += 1;
    }
    tally.remark(format!("{kills} kills in {bakes} bakes, each to its end"));
}

fn finished(ground: &Ground, job: &Path, before: &Finished, said: &Said) -> Trial {
    if said.code != 0 {
        return broken(said.in_words());
    }
    ground.same(job)?;
    before.is_reused(job, said.blocks())
}

/// R12: asked to stop, it stops within seconds, says so by its code, and goes on when run again.
pub fn asked_to_stop(_: &Ask, tally: &Tally) {
    let ground = Ground::new(true);
    let started = Instant::now();
    program::run(&mut program::bake(&ground.scene(), &ground.path("timed"), true));
    let long = started.elapsed();
    // A fifth of the trials stop a bake of seconds, in which all stages take long enough to be hit.
    let cornell = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/cornell/scene.toml");
    let slow = Slow::new(cornell, &ground.path("slow"));
    let slowest = Mutex::new(Duration::ZERO);
    let stopped = AtomicU64::new(0);
    tally.trials(tally.asked(), |trial| {
        let (signal, code) = if trial % 2 == 0 { ("TERM", 143) } else { ("INT", 130) };
        let share = mix2(trial, 12) as f64 / u64::MAX as f64;
        let job = ground.path(&format!("stopped-{trial}"));
        let of_seconds = trial % 5 == 0;
        let command =
            || if of_seconds { slow.command(&job) } else { program::bake(&ground.scene(), &job, true) };
        let after = if of_seconds { slow.long } else { long }.mul_f64(share);
        let (said, took) = program::run_and_send(&mut command(), after, signal);
        let trial = (|| {
            if said.code == 0 {
                return Ok(()); // done before it was asked
            }
            if said.code != code {
                return broken(said.in_words());
            }
            stopped.fetch_add(1, Ordering::Relaxed);
            let mut most = slowest.lock().unwrap();
            *most = took.max(*most);
            drop(most);
            if took > Duration::from_secs(5) {
                return broken(format!("took {took:?} to stop"));
            }
            if of_seconds {
                return slow.again(&job);
            }
            let before = Finished::of(&job, ground.digests);
            finished(&ground, &job, &before, &program::run(&mut command()))
        })();
        let _ = std::fs::remove_dir_all(&job);
        (format!("SIG{signal} after {after:?}{}", if of_seconds { " of seconds" } else { "" }), trial)
    });
    let most = slowest.lock().unwrap().as_secs_f64();
    tally.remark(format!("{} were stopped, the slowest in {most:.2} s", stopped.into_inner()));
}

/// A bake of some seconds.
struct Slow {
    scene: PathBuf,
    files: std::collections::BTreeMap<String, Vec<u8>>,
    long: Duration,
}

impl Slow {
    fn new(scene: PathBuf, job: &Path) -> Self {
        let mut slow = Self { scene, files: Default::default(), long: Duration::ZERO };
        let started = Instant::now();
        let said = program::run(&mut slow.command(job));
        assert_eq!(said.code, 0, "{}", said.in_words());
        (slow.long, slow.files) = (started.elapsed(), contents(job));
        slow
    }

    fn command(&self, job: &Path) -> std::process::Command {
        program::bake_at("0.7%", (&self.scene, job), false)
    }

    fn again(&self, job: &Path) -> Trial {
        let said = program::run(&mut self.command(job));
        if said.code != 0 {
            return broken(said.in_words());
        }
        same(&self.files, &contents(job)).map_err(Bad::Wrong)
    }
}

/// R11: two processes, one job. Both start together: one bakes, the other is told who does, or finds it done.
pub fn pairs(_: &Ask, tally: &Tally) {
    let ground = Ground::new(true);
    let told = AtomicU64::new(0);
    tally.trials(tally.asked(), |trial| {
        let job = ground.path(&format!("raced-{trial}"));
        let command = || program::bake(&ground.scene(), &job, true);
        let first = program::start(&mut command());
        // Some start together, some while the first is anywhere.
        std::thread::sleep(Duration::from_millis(trial % 8 * 20));
        let second = program::start(&mut command());
        let numbers = [first.id(), second.id()];
        let said = [first, second].map(|child| Said::from(child.wait_with_output().unwrap()));
        told.fetch_add(said.iter().filter(|said| said.code == 11).count() as u64, Ordering::Relaxed);
        let outcome = one_baked(&said, numbers).and_then(|()| ground.same(&job));
        let _ = std::fs::remove_dir_all(&job);
        (format!("race {trial}"), outcome)
    });
    tally.remark(format!("{} were told who bakes, the others found it done", told.into_inner()));
}

fn one_baked(said: &[Said; 2], numbers: [u32; 2]) -> Trial {
    let bakers =
        said.iter().filter(|said| said.code == 0 && said.figure("computed_blocks") != Some(0)).count();
    if bakers != 1 {
        return broken(format!("{bakers} baked: {} | {}", said[0].in_words(), said[1].in_words()));
    }
    for (mine, other) in [(0, 1), (1, 0)] {
        let named = || said[mine].last["message"].as_str().unwrap_or_default().to_owned();
        let holder = format!("process {} ", numbers[other]);
        if said[mine].code != 0 && !(said[mine].code == 11 && named().contains(&holder)) {
            return broken(said[mine].in_words());
        }
    }
    Ok(())
}
