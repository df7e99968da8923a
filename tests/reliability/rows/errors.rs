//! R4: an operation fails, and the rest of the world goes on.

use glowtree::Error;
use glowtree::bake::Summary;

use super::super::job::Ground;
use super::super::storage::Clumsy;
use super::super::storage::log::{Kind, Mishap};
use super::super::tally::{Tally, Trial, broken, spread};
use crate::ask::Ask;

const EIO: i32 = 5;
const ENOSPC: i32 = 28;
const EDQUOT: i32 = 122;

/// What can happen to an operation of a kind, with its name.
fn mishaps(kind: Kind) -> Vec<(&'static str, Mishap)> {
    use Kind::{Create, CreateDirectory, Read, Rename, Reserve, Sync, SyncDirectory, Write};
    let failed = match kind {
        Sync | SyncDirectory => "a failed sync",
        Rename | Kind::Exchange => "a failed rename",
        _ => "EIO",
    };
    let mut all = vec![(failed, Mishap::Fails(EIO))];
    if matches!(kind, Create | CreateDirectory | Rename | Reserve | Sync | Write) {
        all.push(("ENOSPC", Mishap::Fails(ENOSPC)));
        all.push(("EDQUOT", Mishap::Fails(EDQUOT)));
    }
    if matches!(kind, Read | Write) {
        all.extend([("EINTR", Mishap::Interrupted), ("short", Mishap::Short)]);
    }
    all
}

/// All pairs of an operation of a bake and something that can happen to it.
pub fn at_operations(_: &Ask, tally: &Tally) {
    each_failed(&Ground::new(true), tally);
}

/// R4b: the same with a mesh that stays in its file.
pub fn at_operations_streamed(_: &Ask, tally: &Tally) {
    each_failed(&Ground::streamed(), tally);
}

fn each_failed(ground: &Ground, tally: &Tally) {
    let beginnings = ground.beginnings();
    let pairs: Vec<(usize, usize, &str, Mishap)> = beginnings
        .iter()
        .enumerate()
        .flat_map(|(from, beginning)| (0..beginning.kinds.len()).map(move |at| (from, at)))
        .flat_map(|(from, at)| {
            let all = mishaps(beginnings[from].kinds[at]).into_iter();
            all.map(move |(name, mishap)| (from, at, name, mishap))
        })
        .collect();
    let counts: Vec<usize> = beginnings.iter().map(|beginning| beginning.kinds.len()).collect();
    tally.remark(format!("operations of a fresh bake, one that resumes, a restart: {counts:?}"));
    tally.remark(format!("{} pairs of an operation and an error", pairs.len()));
    let picks = spread(tally.at_most(pairs.len() as u64), pairs.len() as u64);
    tally.trials(picks.len() as u64, |trial| {
        let (from, at, name, mishap) = pairs[picks[trial as usize] as usize - 1];
        let (beginning, job) = (&beginnings[from], ground.path(&format!("failed-{trial}")));
        let outcome = ground.begin(beginning, &Clumsy::at(at, mishap), &job);
        let outcome = as_it_should(mishap, &outcome).and_then(|()| ground.rerun(&job));
        let _ = std::fs::remove_dir_all(&job);
        (format!("{name} at {at} ({:?}){}", beginning.kinds[at], beginning.name), outcome)
    });
}

/// Whether what was said is right.
fn as_it_should(mishap: Mishap, outcome: &glowtree::Result<Summary>) -> Trial {
    match (mishap, outcome) {
        (Mishap::Interrupted | Mishap::Short, Ok(_)) => Ok(()),
        (Mishap::Interrupted | Mishap::Short, Err(error)) => broken(format!("is no failure: {error}")),
        (Mishap::Fails(ENOSPC | EDQUOT), Err(Error::DiskFull { needed_bytes, .. })) if *needed_bytes > 0 => {
            Ok(())
        }
        (Mishap::Fails(EIO), Err(error)) if error.exit_code() == 8 => Ok(()),
        (_, Err(error)) => broken(format!("code {}: {error}", error.exit_code())),
        (_, Ok(_)) => broken("nothing was said"),
    }
}
