//! The command line: what cargo passes to any test, and ours.

use super::rows::Row;

/// Options of the usual harness that take a value.
const WITH_VALUE: [&str; 6] = ["--test-threads", "--format", "--color", "--logfile", "--shuffle-seed", "-Z"];

/// What was asked.
#[derive(Debug, Default)]
pub struct Ask {
    /// The counts of a release.
    pub release: bool,
    /// Print the rows' names only.
    pub list: bool,
    exact: bool,
    most: Option<u64>,
    filters: Vec<String>,
    skips: Vec<String>,
}

impl Ask {
    /// None when nothing is to be run: there are no ignored rows and no benches.
    pub fn of_arguments(mut words: impl Iterator<Item = String>) -> Option<Self> {
        let mut ask = Self::default();
        while let Some(word) = words.next() {
            match word.as_str() {
                "release" => ask.release = true,
                "--list" => ask.list = true,
                "--exact" => ask.exact = true,
                "--ignored" | "--bench" => return None,
                "--skip" => ask.skips.extend(words.next()),
                "--most" => ask.most = words.next().and_then(|word| word.parse().ok()),
                word if WITH_VALUE.contains(&word) => drop(words.next()),
                word if word.starts_with('-') => {}
                _ => ask.filters.push(word),
            }
        }
        Some(ask)
    }

    /// Whether a row was asked for: by its number or a part of its name.
    pub fn wants(&self, row: &Row) -> bool {
        let named = |filter: &String| {
            let whole = *filter == row.number || *filter == row.full_name();
            whole || !self.exact && !is_number(filter) && row.full_name().contains(filter.as_str())
        };
        (self.filters.is_empty() || self.filters.iter().any(named)) && !self.skips.iter().any(named)
    }

    /// How often a row does its thing; for "all of them" more than there are.
    pub fn count(&self, row: &Row) -> u64 {
        let count = if self.release { row.release } else { row.push };
        count.min(self.most.unwrap_or(u64::MAX))
    }
}

/// Whether it is a row's number, so that R1 is not R11 too.
fn is_number(filter: &str) -> bool {
    filter.strip_prefix('R').is_some_and(|digits| digits.parse::<u32>().is_ok())
}
