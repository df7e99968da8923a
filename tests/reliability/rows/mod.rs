//! The rows of the table.

mod damage;
mod errors;
mod memory;
mod power;
mod processes;
mod room;
mod sameness;

use super::ask::Ask;
use super::tally::Tally;

/// One row.
pub struct Row {
    pub number: &'static str,
    pub what: &'static str,
    /// How often on each push.
    pub push: u64,
    /// How often for a release.
    pub release: u64,
    pub run: fn(&Ask, &Tally),
}

/// As often as there are different ways.
const ALL: u64 = u64::MAX;

/// All rows of this harness; `docs/reliability.md` says where the others are.
pub const ROWS: [Row; 15] = [
    row("R1", "killed at its n-th change of the disk", (200, ALL), processes::at_operations),
    row("R1b", "the same, a mesh that stays in its file", (40, ALL), processes::at_operations_streamed),
    row("R2", "SIGKILL at random times until it is done", (30, 1000), processes::at_random_times),
    row("R2b", "the same, a mesh that stays in its file", (8, 200), processes::at_random_times_streamed),
    row("R3", "power lost: writes and names dropped, reordered, torn", (2000, 100_000), power::states),
    row("R3b", "the same, the whole bake run again", (60, 2000), power::bakes),
    row("R4", "its n-th operation fails: 6 errors", (300, ALL), errors::at_operations),
    row("R4b", "the same, a mesh that stays in its file", (40, ALL), errors::at_operations_streamed),
    row("R5", "disk full at many sizes", (10, 100), room::sizes),
    row("R6", "--max-memory at many levels", (5, 60), memory::budgets),
    row("R6b", "address space (RLIMIT_AS) at many levels", (5, 60), memory::limits),
    row("R8", "every bit of an archive of 64 KiB flipped", (ALL, ALL), damage::bits),
    row("R11", "two processes race for one job", (50, 2000), processes::pairs),
    row("R12", "SIGTERM or SIGINT at random times", (20, 300), processes::asked_to_stop),
    row("R13", "threads 1, 2, 3, 8, interrupted or not: same bytes", (ALL, ALL), sameness::threads),
];

const fn row(
    number: &'static str,
    what: &'static str,
    (push, release): (u64, u64),
    run: fn(&Ask, &Tally),
) -> Row {
    Row { number, what, push, release, run }
}

impl Row {
    /// As the usual harness would call it.
    pub fn full_name(&self) -> String {
        format!("{} {}", self.number, self.what)
    }
}
