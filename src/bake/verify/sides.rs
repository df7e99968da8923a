//! The job's files beside its archives: what was asked, of which inputs, and what the bake reported.

use std::path::Path;

use super::links::Linked;
use super::sites::Sited;
use super::{Damage, Report};
use crate::archive::Digest;
use crate::bake::job::{INPUTS_FILE, Inputs, OPTIONS_FILE, options_digest, read_side};
use crate::bake::options::Options;
use crate::bake::report::summary::{SUMMARY_FILE, Summary};
use crate::error::{Error, Result};

/// What the three files say; None where one does not.
pub(super) struct Sides {
    pub options: Option<Options>,
    pub inputs: Option<Inputs>,
    pub summary: Option<Summary>,
}

impl Sides {
    /// Reads the three files, and notes which are missing or damaged.
    pub(super) fn read(job: &Path, report: &mut Report) -> Result<Self> {
        for name in [OPTIONS_FILE, INPUTS_FILE, SUMMARY_FILE] {
            report.files += 1;
            report.examined_bytes += std::fs::metadata(job.join(name)).map_or(0, |meta| meta.len());
        }
        let summary = match Summary::read(job) {
            Err(Error::NoJob { .. }) => Ok(None),
            outcome => outcome.map(Some),
        };
        Ok(Self {
            options: noted(OPTIONS_FILE, read_side(&job.join(OPTIONS_FILE)), report)?,
            inputs: noted(INPUTS_FILE, read_side(&job.join(INPUTS_FILE)), report)?,
            summary: noted(SUMMARY_FILE, summary, report)?,
        })
    }

    /// Digests of inputs and options, as archives carry them.
    pub(super) fn digests(&self) -> Result<[Option<Digest>; 2]> {
        Ok([
            self.inputs.as_ref().map(Inputs::digest).transpose()?,
            self.options.as_ref().map(options_digest).transpose()?,
        ])
    }

    /// Notes figures of the summary that the archives contradict; triangles and vertices are those of the scene's files.
    pub(super) fn agree(
        &self,
        (triangles, vertices): (Option<u64>, Option<u64>),
        sites: Option<&Sited<'_>>,
        links: Option<&Linked<'_>>,
        report: &mut Report,
    ) {
        let Some(summary) = &self.summary else { return };
        for (what, told, counted) in [
            ("triangles", summary.triangles, triangles),
            ("vertices", summary.vertices, vertices),
            ("sites", summary.sites, sites.and_then(|s| s.count).map(|n| n as u64)),
            ("links", summary.links, links.and_then(|l| l.links)),
        ] {
            if let Some(counted) = counted.filter(|counted| *counted != told) {
                let problem = format!("expected {counted} {what}, got {told}");
                report.damages.push(Damage::of_file(SUMMARY_FILE, problem));
            }
        }
    }
}

/// What was read, if it was; notes why not.
fn noted<T>(name: &str, outcome: Result<Option<T>>, report: &mut Report) -> Result<Option<T>> {
    let problem = match outcome {
        Ok(Some(value)) => return Ok(Some(value)),
        Ok(None) => "missing".to_owned(),
        Err(Error::Damaged { place, problem, .. }) => format!("{place}: {problem}"),
        Err(error) => return Err(error),
    };
    report.damages.push(Damage::of_file(name, problem));
    Ok(None)
}
