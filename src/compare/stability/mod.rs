//! The stability suite: seventeen cases in which methods of this kind fail, each with what it takes to hold.
//!
//! A row measures the program as users run it, and beside it the scheme of the textbooks where it has one. `docs/stability.md`
//! holds the table with the reasons why the default holds.

mod bakes;
pub mod report;
mod rows;

use serde::Serialize;

use crate::bake::{Monitor, Stage};
use crate::error::Result;

/// How a measured number is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Unit {
    /// A share, shown in percent.
    Percent,
    /// A plain number.
    Plain,
}

/// A measured number and the limit that it must not exceed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Measured {
    /// What was measured.
    pub what: String,
    /// The number; infinite where a scheme diverges, NaN where it has no answer.
    pub value: f64,
    /// What it may be at the most.
    pub limit: f64,
    /// How both are written.
    pub unit: Unit,
}

impl Measured {
    /// A share of something: an error, a leak, a contrast.
    pub fn share(what: impl Into<String>, value: f64, limit: f64) -> Self {
        Self { what: what.into(), value, limit, unit: Unit::Percent }
    }

    /// A plain number.
    pub fn plain(what: impl Into<String>, value: f64, limit: f64) -> Self {
        Self { what: what.into(), value, limit, unit: Unit::Plain }
    }

    /// Whether the number stays within its limit; NaN does not.
    pub fn holds(&self) -> bool {
        self.value <= self.limit
    }

    /// How near to the limit, 1 at it; infinite for NaN and for anything above a limit of zero.
    fn strain(&self) -> f64 {
        match self.value {
            v if v.is_nan() => f64::INFINITY,
            v if v <= 0.0 => 0.0,
            v => v / self.limit,
        }
    }
}

/// One case of the suite, measured.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// Its number in the table, from 1.
    pub number: usize,
    /// What may fail.
    pub case: &'static str,
    /// The textbook scheme, if there is one.
    pub scheme: Option<&'static str>,
    /// What the textbook scheme gives.
    pub textbook: Vec<Measured>,
    /// What the program gives.
    pub ours: Vec<Measured>,
    /// Whether every number of the program's stays within its limit.
    pub holds: bool,
}

impl Row {
    /// The number of the program's that is nearest to its limit, or farthest beyond.
    pub fn worst(&self) -> Option<&Measured> {
        worst(&self.ours)
    }

    /// The same of the textbook scheme.
    pub fn worst_textbook(&self) -> Option<&Measured> {
        worst(&self.textbook)
    }
}

fn worst(all: &[Measured]) -> Option<&Measured> {
    // The first of equals.
    all.iter().rev().max_by(|a, b| a.strain().total_cmp(&b.strain()))
}

/// How many cases there are.
pub const COUNT: usize = rows::ROWS.len();

/// Measures one case, numbered from 1; the same for any number of threads.
///
/// # Errors
/// [`Error::Interrupted`](crate::error::Error::Interrupted), and whatever hinders a bake.
///
/// # Panics
/// When there is no such case.
pub fn row(number: usize, monitor: &dyn Monitor) -> Result<Row> {
    let case = &rows::ROWS[number - 1];
    let (textbook, ours) = (case.measure)(monitor)?;
    let holds = !ours.is_empty() && ours.iter().all(Measured::holds);
    Ok(Row { number, case: case.title, scheme: case.scheme, textbook, ours, holds })
}

/// Measures all cases in order.
///
/// # Errors
/// As [`row`].
pub fn run(monitor: &dyn Monitor, mut told: impl FnMut(&Row) -> Result<()>) -> Result<Vec<Row>> {
    let stage = Stage::start(monitor, "stability", "rows", Some(COUNT as u64));
    let mut rows = Vec::with_capacity(COUNT);
    for number in 1..=COUNT {
        let row = row(number, &bakes::Within(monitor))?;
        told(&row)?;
        rows.push(row);
        stage.advance(1)?;
    }
    stage.finish();
    Ok(rows)
}
