//! R3: the power goes. The log of a whole bake, interrupted on its way so that it made blocks durable, is cut anywhere.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use glowtree::geometry::hash::mix2;

use super::super::finished::Finished;
use super::super::job::Ground;
use super::super::storage::story::Story;
use super::super::tally::{Tally, Trial, broken};
use crate::ask::Ask;

/// Blocks of ledgers and archives after a loss: none that is not of the undisturbed bake, and all that were promised.
pub fn states(_: &Ask, tally: &Tally) {
    let story = Story::record();
    tally.remark(story.in_words());
    let kept = AtomicU64::new(0);
    let per_cut = 25;
    let cuts = tally.asked().div_ceil(per_cut);
    tally.trials(cuts, |cut| {
        let count = per_cut.min(tally.asked() - cut * per_cut);
        tally.count(count - 1);
        let at = mix2(cut, 3) as usize % (story.log.len() + 1);
        let (machine, promised) = story.until(at);
        let outcome = (0..count).try_for_each(|seed| {
            let files = machine.files_after_loss(sector(seed), &mut draw(cut * per_cut + seed));
            kept.fetch_add(story.examine(&files, &promised)?, Ordering::Relaxed);
            Ok(())
        });
        (format!("power lost after change {at}"), outcome)
    });
    tally.remark(format!("{} blocks and archives survived, all of them true", kept.into_inner()));
    // The oracle must see what a missing sync does.
    let noticed = (0..40).filter(|&cut| {
        let at = mix2(cut, 3) as usize % (story.log.len() + 1);
        let (_, promised) = story.until(at);
        let files = story.lying(at).files_after_loss(512, &mut draw(cut));
        story.examine(&files, &promised).is_err()
    });
    let noticed = noticed.count();
    tally.remark(format!("{noticed} of 40 losses on a disk that lies about syncs are noticed"));
    if noticed == 0 {
        tally.trial("a lying disk", || broken("nothing is noticed"));
    }
}

/// The same with the whole bake run again on what is left.
pub fn bakes(_: &Ask, tally: &Tally) {
    let story = Story::record();
    let refused = AtomicU64::new(0);
    tally.trials(tally.asked(), |trial| {
        let at = mix2(trial, 33) as usize % (story.log.len() + 1);
        let (machine, _) = story.until(at);
        let files = machine.files_after_loss(sector(trial), &mut draw(!trial));
        let place = story.ground.path(&format!("lost-{trial}"));
        let outcome = again(&story.ground, (&place, &files), &refused);
        let _ = std::fs::remove_dir_all(&place);
        (format!("power lost after change {at}"), outcome)
    });
    tally.remark(format!(
        "{} refused with code 3, 8 or 9, the others ended with the same bytes",
        refused.into_inner()
    ));
}

fn sector(seed: u64) -> usize {
    [512, 4096][seed as usize % 2]
}

fn draw(seed: u64) -> impl FnMut() -> u64 {
    let mut drawn = 0;
    move || {
        drawn += 1;
        mix2(seed, drawn)
    }
}

/// Puts the files in place, with the lock of a process that is no more, and bakes.
fn again(
    ground: &Ground,
    (place, files): (&Path, &BTreeMap<PathBuf, Vec<u8>>),
    refused: &AtomicU64,
) -> Trial {
    let job = place.join("job");
    std::fs::create_dir_all(&job).unwrap();
    for (path, bytes) in files {
        let path = place.join(path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
    std::fs::write(job.join("lock"), "process 4194999 on elsewhere\n").unwrap();
    let before = Finished::of(&job, ground.digests);
    match ground.bake(&super::super::job::disk(), &job) {
        Ok(summary) => {
            ground.same(&job)?;
            before.is_reused(&job, (summary.resumed_blocks, summary.computed_blocks))
        }
        Err(error) if matches!(error.exit_code(), 3 | 8 | 9) => {
            refused.fetch_add(1, Ordering::Relaxed);
            Ok(())
        }
        Err(error) => broken(format!("code {}: {error}", error.exit_code())),
    }
}
