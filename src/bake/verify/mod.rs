//! Checking a finished job: every checksum, every invariant, and that its files belong together; and making anew what is
//! damaged ([`repair()`]).
//!
//! Blocks are looked at one after the other, straight from the map; what is kept in memory is the scene's triangles, as
//! every verb keeps them, a bit a triangle, and one decoded block of rows.

mod archives;
mod light;
mod links;
mod repair;
mod rows;
mod scene;
mod sides;
mod sites;
mod transfer;

use std::ops::Range;
use std::path::Path;

use serde::Serialize;

use super::report::progress::{Monitor, Stage};
use super::{pictures, report::summary::SUMMARY_FILE, store};
use crate::archive::partial_path;
use crate::error::{Error, Result};
pub use repair::{Repaired, repair};
use sides::Sides;

/// The archives of a job, in the order of the stages.
pub const ARCHIVES: [&str; 4] = ["scene", "sites", "links", "light"];

/// The file of a kind of archive.
fn file_name(kind: &str) -> String {
    format!("{kind}.glow")
}

/// What was examined and what is wrong.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Report {
    /// Files examined.
    pub files: u64,
    /// Blocks examined.
    pub blocks: u64,
    /// Bytes examined, all of every file.
    pub examined_bytes: u64,
    /// What is not as it was written, or must not be so; empty when the job is whole.
    pub damages: Vec<Damage>,
    /// What is not there and need not be.
    pub notes: Vec<String>,
}

/// One thing that is wrong.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Damage {
    /// The file's name within the job.
    pub file: String,
    /// The block's number within the file; none where it is not one block that is damaged.
    pub block: Option<u64>,
    /// What the block holds.
    pub tag: Option<String>,
    /// First of the receivers, rows, triangles … that the block covers.
    pub first: Option<u64>,
    /// How many they are.
    pub count: Option<u64>,
    /// Expected and found.
    pub problem: String,
}

impl Damage {
    /// Of a whole file.
    fn of_file(file: impl Into<String>, problem: impl Into<String>) -> Self {
        Self { file: file.into(), block: None, tag: None, first: None, count: None, problem: problem.into() }
    }

    /// The receivers, rows, triangles … that the block covers.
    pub fn range(&self) -> Option<Range<u64>> {
        self.first.zip(self.count).map(|(first, count)| first..first.saturating_add(count))
    }
}

impl std::fmt::Display for Damage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: ", self.file)?;
        if let Some(block) = self.block {
            write!(f, "block {block} ")?;
        }
        if let Some(tag) = &self.tag {
            write!(f, "`{tag}`")?;
            if let Some(range) = self.range() {
                write!(f, " of {}..{}", range.start, range.end)?;
            }
            write!(f, ": ")?;
        }
        f.write_str(&self.problem)
    }
}

impl Report {
    /// Whether nothing is wrong.
    pub fn is_whole(&self) -> bool {
        self.damages.is_empty()
    }

    /// Whether nothing is wrong with a file.
    fn is_whole_file(&self, file: &str) -> bool {
        self.damages.iter().all(|damage| damage.file != file)
    }
}

/// Recomputes every checksum of a finished job and holds what it stores to its invariants; goes on after damage.
///
/// Damage is not an error but in the report. A finished job has its summary, or all archives at least.
///
/// Cost: one pass over all bytes, and decoding all rows. Deterministic.
///
/// # Errors
/// [`Error::NoJob`] when there is none or it is not finished, [`Error::Io`] when a file cannot be read,
/// [`Error::Input`] when another version of the format wrote it, [`Error::Interrupted`].
pub fn verify(job: &Path, monitor: &dyn Monitor) -> Result<Report> {
    if !is_finished(job) {
        return Err(Error::NoJob { job: job.to_path_buf() });
    }
    let mut report = Report::default();
    let sides = Sides::read(job, &mut report)?;
    let mut opened = archives::open_all(job, &mut report, monitor)?;
    archives::agree(&mut opened, &sides, &mut report)?;
    let [scene, sites, links, light] = &opened;
    let stage = Stage::start(monitor, "invariants", "rows", None);
    let scene = scene.as_ref().map(|archive| scene::check(archive, &mut report));
    let scene = scene.as_ref().and_then(Option::as_ref);
    monitor.check()?;
    let sites = sites.as_ref().map(|archive| sites::check(archive, scene, &mut report));
    monitor.check()?;
    let links = match (links, &sites) {
        (Some(archive), Some(sites)) => Some(links::check(archive, (scene, sites), &mut report, &stage)?),
        _ => None,
    };
    monitor.check()?;
    if let (Some(archive), Some(links), Some(sites)) = (light, &links, &sites) {
        light::check(archive, (sites, links), &mut report);
    }
    let counts = match scene {
        Some(scene) => scene::counts(job, scene, &mut report)?,
        None => None,
    };
    let sizes = (sites.as_ref().and_then(|s| s.count), links.as_ref().and_then(|l| l.receivers));
    transfer::check(job, is_relightable(job, &sides), sizes, &mut report, monitor)?;
    sides.agree(counts.unzip(), sites.as_ref(), links.as_ref(), &mut report);
    stage.finish();
    note_absent(job, &mut report);
    Ok(report)
}

/// Whether the job is to hold transfers, as far as its options and its scene can tell.
fn is_relightable(job: &Path, sides: &Sides) -> bool {
    let Some(options) = &sides.options else { return false };
    options
        .relightable
        .unwrap_or_else(|| store::read_scene(job).is_ok_and(|(scene, _)| options.is_relightable(&scene)))
}

/// Whether a bake came to its end here: the summary is the last file that it writes.
fn is_finished(job: &Path) -> bool {
    let archives = || ARCHIVES.iter().all(|kind| job.join(file_name(kind)).is_file());
    job.join(SUMMARY_FILE).is_file() || archives()
}

fn note_absent(job: &Path, report: &mut Report) {
    for name in [pictures::PREVIEW_FILE, pictures::MESH_FILE] {
        if !job.join(name).is_file() {
            report.notes.push(format!("{name}: absent"));
        }
    }
    for kind in ARCHIVES {
        let partial = partial_path(file_name(kind));
        if job.join(&partial).exists() {
            report.notes.push(format!("{}: left by an interrupted bake", partial.display()));
        }
    }
}

/// Errors with the number of the first value that does not satisfy the rule, and what it is.
fn each<T: std::fmt::Debug>(values: &[T], wanted: &str, rule: impl Fn(&T) -> bool) -> Result<(), String> {
    match values.iter().position(|value| !rule(value)) {
        None => Ok(()),
        Some(at) => Err(format!("entry {at}: expected {wanted}, got {:?}", values[at])),
    }
}

/// Errors unless offsets begin at nought, ascend, and end at `end`: then each of what they divide is in one place once.
fn ascending(offsets: &[u32], end: usize) -> Result<(), String> {
    if offsets.first() != Some(&0) {
        return Err(format!("expected offsets from 0, got {:?}", offsets.first()));
    }
    if let Some(at) = offsets.windows(2).position(|pair| pair[0] > pair[1]) {
        return Err(format!("entry {}: expected at least {}, got {}", at + 1, offsets[at], offsets[at + 1]));
    }
    match offsets.last() {
        Some(&last) if last as usize == end => Ok(()),
        last => Err(format!("expected offsets up to {end}, got {last:?}")),
    }
}
