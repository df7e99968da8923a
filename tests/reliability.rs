//! The table of `docs/reliability.md`: interrupts, damages and starves bakes, counts what came of it, and fails when
//! a row does not hold.
//!
//! `cargo test --release --test reliability` runs the counts of each push; `… -- release` those of a release. Names or
//! numbers of rows choose among them (`… -- release R2`), `--most N` bounds every count.
#![allow(clippy::unwrap_used)]

#[path = "reliability/ask.rs"]
mod ask;
#[allow(dead_code)] // shared with tests/archive.rs; each uses a part of it
#[path = "archive/faults.rs"]
mod faults;
#[path = "reliability/finished.rs"]
mod finished;
#[path = "reliability/job.rs"]
mod job;
#[path = "reliability/program.rs"]
mod program;
#[path = "reliability/rows/mod.rs"]
mod rows;
#[path = "reliability/storage/mod.rs"]
mod storage;
#[path = "reliability/tally.rs"]
mod tally;

use std::process::ExitCode;
use std::time::Instant;

use ask::Ask;
use tally::Tally;

fn main() -> ExitCode {
    let Some(ask) = Ask::of_arguments(std::env::args().skip(1)) else { return ExitCode::SUCCESS };
    let chosen: Vec<_> = rows::ROWS.iter().filter(|row| ask.wants(row)).collect();
    if ask.list {
        chosen.iter().for_each(|row| println!("{}: test", row.full_name()));
        return ExitCode::SUCCESS;
    }
    if chosen.is_empty() {
        return ExitCode::SUCCESS;
    }
    println!("{}", job::SCENE_IN_WORDS);
    println!("row  what{:50}  asked    done   wrong    lost  broken  seconds", "");
    let started = Instant::now();
    let mut holds = true;
    for row in chosen {
        holds &= run(row, &ask);
    }
    println!("{} in {:.0} s", if holds { "all rows hold" } else { "FAIL" }, started.elapsed().as_secs_f64());
    ExitCode::from(u8::from(!holds))
}

/// Runs a row and prints its line, its remarks and what went wrong.
fn run(row: &rows::Row, ask: &Ask) -> bool {
    let started = Instant::now();
    let tally = Tally::new(ask.count(row));
    (row.run)(ask, &tally);
    let seconds = started.elapsed().as_secs_f64();
    let (counts, holds) = (tally.counts(), tally.holds());
    let verdict = if holds { "" } else { "  FAIL" };
    println!("{:4} {:54}  {counts}  {seconds:7.1}{verdict}", row.number, row.what);
    tally.print_remarks();
    holds
}
