//! R6: memory is short.

use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicU64, Ordering};

use super::super::job::{Ground, contents};
use super::super::program::{self, Said};
use super::super::tally::{Bad, Tally, Trial, broken};
use crate::ask::Ask;

/// `--max-memory` from a fraction of what the bake takes to more than that: done within it, or refused with code 6.
pub fn budgets(_: &Ask, tally: &Tally) {
    let room = Room::new();
    tally.remark(format!("undisturbed: {} bytes of anonymous memory", room.peak));
    let (asked, refused) = (tally.asked(), AtomicU64::new(0));
    tally.trials(asked, |trial| {
        let level = room.peak / 4 + 3 * room.peak / 2 * trial / asked.max(2).saturating_sub(1);
        let job = room.ground.path(&format!("budget-{trial}"));
        let mut command = room.bake(&job);
        command.args(["--max-memory", &level.to_string()]);
        let said = program::run(&mut command);
        refused.fetch_add(u64::from(said.code == 6), Ordering::Relaxed);
        let peak = said.figure("peak_anonymous_bytes").unwrap_or(u64::MAX);
        let outcome = if said.code == 0 && peak > level {
            broken(format!("took {peak} bytes"))
        } else {
            room.ended(&job, &said)
        };
        let _ = std::fs::remove_dir_all(&job);
        (format!("--max-memory {level}"), outcome)
    });
    tally.remark(format!("{} refused with code 6", refused.into_inner()));
}

/// The same with the system's limit on addresses, from where the program just starts: an allocation that fails is code 6
/// too.
pub fn limits(_: &Ask, tally: &Tally) {
    let room = Room::new();
    let least = (1..).map(|step| step * 1024).find(|&kilobytes| starts(kilobytes)).unwrap();
    let most = (1..).map(|step| least + step * 8192).find(|&kilobytes| room.suffices(kilobytes)).unwrap();
    tally.remark(format!("starts with {least} KiB of addresses, bakes with {most} KiB"));
    let (asked, refused) = (tally.asked(), AtomicU64::new(0));
    tally.trials(asked, |trial| {
        let kilobytes = least + (most - least) * 9 / 8 * trial / asked.max(2).saturating_sub(1);
        let job = room.ground.path(&format!("limit-{trial}"));
        let said = program::run(&mut limited(kilobytes, &room.bake(&job)));
        refused.fetch_add(u64::from(said.code == 6), Ordering::Relaxed);
        let outcome = room.ended(&job, &said);
        let _ = std::fs::remove_dir_all(&job);
        (format!("{kilobytes} KiB of addresses"), outcome)
    });
    tally.remark(format!("{} refused with code 6", refused.into_inner()));
}

/// A bake that needs some memory: the Cornell box at 2 %.
struct Room {
    ground: Ground,
    files: std::collections::BTreeMap<String, Vec<u8>>,
    peak: u64,
}

impl Room {
    fn new() -> Self {
        let mut room = Self { ground: Ground::new(false), files: Default::default(), peak: 0 };
        let job = room.ground.path("roomy");
        let said = program::run(&mut room.bake(&job));
        assert_eq!(said.code, 0, "{}", said.in_words());
        room.peak = said.figure("peak_anonymous_bytes").unwrap();
        room.files = contents(&job);
        room
    }

    fn bake(&self, job: &Path) -> Command {
        let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/cornell/scene.toml");
        program::bake_at("2%", (&scene, job), false)
    }

    /// Done with the same bytes, or refused with code 6, and then done with the same bytes given room.
    fn ended(&self, job: &Path, said: &Said) -> Trial {
        let said_again;
        let last = match said.code {
            0 => said,
            6 => {
                said_again = program::run(&mut self.bake(job));
                &said_again
            }
            _ => return broken(said.in_words()),
        };
        if last.code != 0 {
            return broken(format!("with room: {}", last.in_words()));
        }
        super::super::job::same(&self.files, &contents(job)).map_err(Bad::Wrong)
    }

    fn suffices(&self, kilobytes: u64) -> bool {
        let job = self.ground.path("measured");
        let _ = std::fs::remove_dir_all(&job);
        program::run(&mut limited(kilobytes, &self.bake(&job))).code == 0
    }
}

/// Whether the program can say its version under a limit: below, the system cannot even load it.
fn starts(kilobytes: u64) -> bool {
    let mut command = Command::new(env!("CARGO_BIN_EXE_glowtree"));
    command.arg("--version");
    program::run(&mut limited(kilobytes, &command)).code == 0
}

/// A command under a limit of its addresses.
fn limited(kilobytes: u64, command: &Command) -> Command {
    let mut shell = Command::new("sh");
    shell.args(["-c", &format!("ulimit -v {kilobytes}; exec \"$@\""), "sh"]);
    shell.arg(command.get_program()).args(command.get_args());
    shell
}
