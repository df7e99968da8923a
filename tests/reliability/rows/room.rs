//! R5: the disk is full.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use super::super::finished::Finished;
use super::super::job::Ground;
use super::super::program;
use super::super::storage::Clumsy;
use super::super::tally::{Tally, Trial, broken};
use crate::ask::Ask;

/// Disks of sizes from next to nothing to what a bake needs: code 7 and what is missing, then room is made and it goes on.
/// A small file system in memory where this may mount one, else a storage that runs out of bytes.
pub fn sizes(_: &Ask, tally: &Tally) {
    let ground = Ground::new(true);
    let mounted = Small::mount(&ground.path("small"), 64 << 10).is_some();
    tally.remark(if mounted { "on a tmpfs" } else { "no right to mount: a storage that runs out of bytes" });
    let whole = whole_bytes(&ground, mounted);
    let (asked, page) = (tally.asked(), 4096);
    tally.remark(format!("{whole} bytes are not enough for a bake"));
    for trial in 0..asked {
        let bytes = (whole * (trial + 1) / asked).next_multiple_of(page);
        tally.trial(&format!("a disk of {bytes} bytes"), || {
            if mounted { on_small(&ground, bytes) } else { on_clumsy(&ground, bytes) }
        });
    }
}

/// The largest disk, to a sixteenth, on which a bake does not end well.
fn whole_bytes(ground: &Ground, mounted: bool) -> u64 {
    let (mut bytes, mut too_few) = (128 << 10, 0);
    loop {
        let enough = if mounted {
            let small = Small::mount(&ground.path("small"), bytes).unwrap();
            program::run(&mut program::bake(&ground.scene(), &small.0.join("job"), true)).code == 0
        } else {
            let job = ground.path("measured");
            let _ = std::fs::remove_dir_all(&job);
            ground.bake(&Clumsy::with_room(bytes).shared(), &job).is_ok()
        };
        if enough {
            return too_few;
        }
        too_few = bytes;
        bytes = (bytes + bytes / 16) / 4096 * 4096;
    }
}

fn on_small(ground: &Ground, bytes: u64) -> Trial {
    let Some(small) = Small::mount(&ground.path("small"), bytes) else { return broken("cannot be mounted") };
    let job = small.0.join("job");
    let said = program::run(&mut program::bake(&ground.scene(), &job, true));
    let message = said.last["message"].as_str().unwrap_or_default();
    let needed = message.split("disk full: ").nth(1).and_then(|rest| rest.split(' ').next());
    if said.code != 7 || needed.and_then(|text| text.parse().ok()).unwrap_or(0) == 0_u64 {
        return broken(said.in_words());
    }
    if !small.grow() {
        return broken("cannot be made larger");
    }
    let before = Finished::of(&job, ground.digests);
    let said = program::run(&mut program::bake(&ground.scene(), &job, true));
    if said.code != 0 {
        return broken(format!("with room: {}", said.in_words()));
    }
    ground.same(&job)?;
    before.is_reused(&job, said.blocks())
}

fn on_clumsy(ground: &Ground, bytes: u64) -> Trial {
    let job = ground.path(&format!("room-{bytes}"));
    match ground.bake(&Clumsy::with_room(bytes).shared(), &job) {
        Err(glowtree::Error::DiskFull { needed_bytes, .. }) if needed_bytes > 0 => ground.rerun(&job),
        Err(error) => broken(format!("code {}: {error}", error.exit_code())),
        Ok(_) => broken("nothing was said"),
    }
}

/// A file system of its own until dropped.
struct Small(PathBuf);

impl Small {
    fn mount(at: &Path, bytes: u64) -> Option<Self> {
        std::fs::create_dir_all(at).ok()?;
        let size = format!("size={bytes}");
        quiet(Command::new("mount").args(["-t", "tmpfs", "-o", &size, "tmpfs"]).arg(at))
            .then(|| Self(at.into()))
    }

    fn grow(&self) -> bool {
        quiet(Command::new("mount").args(["-o", "remount,size=16m"]).arg(&self.0))
    }
}

impl Drop for Small {
    fn drop(&mut self) {
        quiet(Command::new("umount").arg(&self.0));
    }
}

fn quiet(command: &mut Command) -> bool {
    let silent = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    silent.status().is_ok_and(|status| status.success())
}
