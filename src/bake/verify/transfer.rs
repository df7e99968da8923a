//! Transfers beside a job: checksums, whose they are, and that they are light.

use std::path::Path;

use super::archives::check_blocks;
use super::{Damage, Report};
use crate::bake::report::progress::{Monitor, Stage};
use crate::bake::transfer::{FILE, Stored};
use crate::error::{Error, Result};

/// Checks `transfer.glow`; where it is not, that it need not be.
pub(super) fn check(
    job: &Path,
    wanted: bool,
    (sites, receivers): (Option<usize>, Option<usize>),
    report: &mut Report,
    monitor: &dyn Monitor,
) -> Result<()> {
    let path = job.join(FILE);
    if !path.is_file() {
        if wanted {
            report.damages.push(Damage::of_file(FILE, "missing"));
        }
        return Ok(());
    }
    report.files += 1;
    let bytes = std::fs::metadata(&path).map_or(0, |meta| meta.len());
    report.examined_bytes += bytes;
    let stage = Stage::start(monitor, "transfers", "bytes", Some(bytes));
    let before = report.damages.len();
    check_blocks(job, (FILE.to_owned(), crate::bake::transfer::KIND), report, &stage)?;
    if report.damages.len() == before {
        match Stored::open(job) {
            Ok(Some(stored)) => hold(&stored, (sites, receivers), report, monitor)?,
            Ok(None) => {
                let problem = "expected transfers of this job's archives, got those of others";
                report.damages.push(Damage::of_file(FILE, problem));
            }
            // Archives that cannot be opened are told of by themselves.
            Err(Error::Damaged { file, place, problem }) if file.ends_with(FILE) => {
                report.damages.push(Damage::of_file(FILE, format!("{place}: {problem}")));
            }
            Err(Error::Damaged { .. } | Error::Io { .. }) => {}
            Err(error) => return Err(error),
        }
    }
    stage.finish();
    Ok(())
}

/// Every value is a finite number, and there are as many as sites and receivers.
fn hold(
    stored: &Stored,
    (sites, receivers): (Option<usize>, Option<usize>),
    report: &mut Report,
    monitor: &dyn Monitor,
) -> Result<()> {
    let [own_receivers, own_sites] = stored.sizes();
    for (what, expected, got) in [("receivers", receivers, own_receivers), ("sites", sites, own_sites)] {
        if let Some(expected) = expected.filter(|expected| *expected as u64 != got && !stored.is_empty()) {
            let problem = format!("expected light of {expected} {what}, got {got}");
            report.damages.push(Damage::of_file(FILE, problem));
        }
    }
    for light in 0..stored.len() {
        monitor.check()?;
        let problem = match stored.number(light) {
            Ok(transfer) => {
                let mut values = transfer.irradiance.iter().chain(&transfer.radiosity);
                values
                    .find(|v| !v.is_finite())
                    .map(|v| format!("light {light}: expected finite numbers, got {v}"))
            }
            Err(Error::Damaged { place, problem, .. }) => Some(format!("light {light}: {place}: {problem}")),
            Err(error) => return Err(error),
        };
        report.damages.extend(problem.map(|problem| Damage::of_file(FILE, problem)));
    }
    Ok(())
}
