//! Making anew what is damaged, and nothing else: the frame of a file from its blocks, headers from the directory, rows
//! from their points, chunks from the meshes that they were cut from, all else from a new bake, of which only the damaged
//! blocks are taken. Checksums prove each repair before it takes its name.

mod chunks;
mod frame;
mod headers;
mod lost;
mod rebake;
mod rows;
mod transfers;

use std::collections::BTreeSet;
use std::path::Path;

use serde::Serialize;

use super::{Damage, Report, verify};
use crate::archive::{Archive, Digests, Tag, Writer};
use crate::bake::job::{INPUTS_FILE, Lock, OPTIONS_FILE};
use crate::bake::report::progress::Monitor;
use crate::error::{Error, Result};

/// What was made anew.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Repaired {
    /// Files that were written anew.
    pub files: Vec<RepairedFile>,
    /// Whether the scene was baked once more.
    pub rebaked: bool,
}

/// One file that was written anew.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RepairedFile {
    /// Its name within the job.
    pub file: String,
    /// Blocks that were made anew; nought where only what frames them was damaged.
    pub made_blocks: u64,
    /// Blocks that were whole and were kept.
    pub kept_blocks: u64,
    /// How.
    pub by: &'static str,
}

impl Repaired {
    /// Blocks that were made anew, of all files.
    pub fn made_blocks(&self) -> u64 {
        self.files.iter().map(|file| file.made_blocks).sum()
    }
}

/// Makes anew what [`verify`] found damaged, as cheaply as it can be proven; ends with a whole job.
///
/// Files are never edited: repaired ones are written under a temporary name and renamed. Where a bake is needed it runs in
/// a temporary folder beside the job. Deterministic: archives come out byte by byte as they were.
///
/// # Errors
/// [`Error::JobDiffers`] when the inputs have changed since, or this program bakes them otherwise; [`Error::DamagedJob`]
/// when what was asked is lost; [`Error::JobLocked`]; what the bake says; input/output errors. What was not proven by then is left as it is.
pub fn repair(job: &Path, report: &Report, monitor: &dyn Monitor) -> Result<Repaired> {
    let _lock = Lock::take(job, monitor)?;
    let mut repaired = Repaired::default();
    let mut report = others(report.clone());
    if frame::mend(job, &report, &mut repaired)? {
        report = others(verify(job, monitor)?);
    }
    if headers::mend(job, &report, &mut repaired)? {
        report = others(verify(job, monitor)?);
    }
    if rows::mend(job, &report, &mut repaired, monitor)? {
        report = others(verify(job, monitor)?);
    }
    if !(report.is_whole_file(OPTIONS_FILE) && report.is_whole_file(INPUTS_FILE)) {
        lost::find(job, &mut repaired)?;
        report = others(verify(job, monitor)?);
    }
    if chunks::mend(job, &report, &mut repaired, monitor)? {
        report = others(verify(job, monitor)?);
    }
    if !report.is_whole() {
        rebake::mend(job, &report, &mut repaired, monitor)?;
        report = others(verify(job, monitor)?);
        // Only now the scene may tell which chunks there are to be.
        if chunks::mend(job, &report, &mut repaired, monitor)? {
            report = others(verify(job, monitor)?);
        }
    }
    if report.is_whole() {
        report = verify(job, monitor)?;
        if transfers::mend(job, &report, &mut repaired, monitor)? {
            report = verify(job, monitor)?;
        }
    }
    match report.damages.first() {
        None => Ok(repaired),
        Some(damage) => Err(Error::DamagedJob {
            job: job.to_path_buf(),
            problem: format!("still damaged after the repair: {damage}; bake again with --restart"),
        }),
    }
}

/// What is wrong with all but transfers, which are made of the others.
fn others(mut report: Report) -> Report {
    report.damages.retain(|damage| damage.file != crate::bake::transfer::FILE);
    report
}

/// An archive to be written anew under its own name.
struct Plan<'a> {
    job: &'a Path,
    kind: &'a str,
    digests: Digests,
    provenance: &'a [(String, String)],
}

impl Plan<'_> {
    /// Writes the archive's blocks; it takes its name when `blocks` says that they are proven, else nothing has changed.
    fn write(&self, blocks: impl FnOnce(&mut Writer) -> Result<bool>) -> Result<bool> {
        let path = self.job.join(super::file_name(self.kind));
        let mut writer = Writer::create(path, Tag::new(self.kind), self.digests)?;
        match blocks(&mut writer) {
            Ok(true) => {
                let provenance: Vec<(&str, &str)> =
                    self.provenance.iter().map(|(name, text)| (name.as_str(), text.as_str())).collect();
                writer.finish(&provenance).map(|_| true)
            }
            outcome => {
                // The outcome counts, not whether what nobody wants could be removed.
                let _ = writer.abandon();
                outcome
            }
        }
    }
}

/// Numbers of a file's damaged blocks, if there are any, all are of tags like that, and nothing else is damaged.
fn damaged(report: &Report, name: &str, like: impl Fn(Option<&str>) -> bool) -> Option<BTreeSet<usize>> {
    let own = report.damages.iter().filter(|damage| damage.file == name);
    let number = |d: &Damage| d.block.filter(|_| like(d.tag.as_deref())).map(|block| block as usize);
    own.map(number).collect::<Option<BTreeSet<usize>>>().filter(|numbers| !numbers.is_empty())
}

/// Whether the checksums of all these blocks fail: what is whole and wrong all the same comes out no better.
fn all_fail(archive: &Archive, numbers: &BTreeSet<usize>) -> bool {
    archive
        .all_blocks()
        .filter(|block| numbers.contains(&block.number()))
        .all(|block| block.recheck().is_err())
}

/// The archives of the job that open, whatever their blocks hold.
fn readable(job: &Path) -> Vec<Archive> {
    super::ARCHIVES.iter().filter_map(|kind| Archive::open(job.join(super::file_name(kind))).ok()).collect()
}
