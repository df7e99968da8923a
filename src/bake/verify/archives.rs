//! The four archives: every checksum, and whose files they are.

use std::collections::BTreeSet;
use std::path::Path;

use bytemuck::Pod;

use super::sides::Sides;
use super::{ARCHIVES, Damage, Report, file_name};
use crate::archive::{Access, Archive, Block, Digest, Tag};
use crate::bake::report::progress::{Monitor, Stage};
use crate::bake::store;
use crate::error::{Error, Result};

/// An archive whose blocks were all looked at.
pub(super) struct Opened {
    name: String,
    archive: Archive,
    /// Numbers of the blocks whose checksums fail.
    damaged: BTreeSet<usize>,
}

/// The job's archives in the order of [`ARCHIVES`]; None where one cannot be opened.
pub(super) type Archives = [Option<Opened>; 4];

/// Opens all archives and recomputes the checksum of every block.
pub(super) fn open_all(job: &Path, report: &mut Report, monitor: &dyn Monitor) -> Result<Archives> {
    let size = |kind: &&str| std::fs::metadata(job.join(file_name(kind))).map_or(0, |meta| meta.len());
    let stage = Stage::start(monitor, "checksums", "bytes", Some(ARCHIVES.iter().map(size).sum()));
    let mut opened = Archives::default();
    for (kind, place) in ARCHIVES.iter().zip(&mut opened) {
        report.files += 1;
        report.examined_bytes += size(kind);
        *place = open(job, (file_name(kind), kind), report, &stage)?;
    }
    // A scene that cannot say what it refers to is found damaged by itself.
    for (_, name) in store::chunk_files(job).unwrap_or_default() {
        report.files += 1;
        report.examined_bytes += std::fs::metadata(job.join(&name)).map_or(0, |meta| meta.len());
        open(job, (name, "detail"), report, &stage)?;
    }
    stage.finish();
    Ok(opened)
}

fn open(
    job: &Path,
    (name, kind): (String, &str),
    report: &mut Report,
    stage: &Stage<'_>,
) -> Result<Option<Opened>> {
    let archive = match Archive::open(job.join(&name)) {
        Ok(archive) => archive,
        Err(Error::Damaged { place, problem, .. }) => {
            report.damages.push(Damage::of_file(name, format!("{place}: {problem}")));
            return Ok(None);
        }
        Err(Error::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => {
            report.damages.push(Damage::of_file(name, "missing"));
            return Ok(None);
        }
        Err(error) => return Err(error),
    };
    if let Err(Error::JobDiffers { difference, .. }) = archive.expect_kind(Tag::new(kind)) {
        report.damages.push(Damage::of_file(name, difference));
        return Ok(None);
    }
    archive.advise(Access::Sequential);
    let mut damaged = BTreeSet::new();
    for block in archive.all_blocks() {
        report.blocks += 1;
        match block.stored() {
            Ok(_) => {}
            Err(Error::Damaged { problem, .. }) => {
                report.damages.push(damage(&name, block, problem));
                damaged.insert(block.number());
            }
            Err(error) => return Err(error),
        }
        stage.advance(block.entry().stored_bytes)?;
    }
    Ok(Some(Opened { name, archive, damaged }))
}

/// Recomputes the checksums of one more archive of the job.
pub(super) fn check_blocks(
    job: &Path,
    named: (String, &str),
    report: &mut Report,
    stage: &Stage<'_>,
) -> Result<()> {
    open(job, named, report, stage).map(drop)
}

fn damage(file: &str, block: Block<'_>, problem: String) -> Damage {
    let entry = block.entry();
    Damage {
        file: file.to_owned(),
        block: Some(block.number() as u64),
        tag: Some(name_of(entry.tag)),
        first: Some(entry.first),
        count: Some(entry.count),
        problem,
    }
}

impl Opened {
    pub(super) fn archive(&self) -> &Archive {
        &self.archive
    }

    /// Whether a block's checksum holds.
    pub(super) fn is_whole(&self, block: Block<'_>) -> bool {
        !self.damaged.contains(&block.number())
    }

    /// Notes that a block must not hold what it holds.
    pub(super) fn fault(&self, report: &mut Report, block: Block<'_>, problem: String) {
        report.damages.push(damage(&self.name, block, problem));
    }

    /// Notes what is wrong with the only block with a tag; whether nothing is.
    pub(super) fn hold(&self, report: &mut Report, tag: &str, outcome: Result<(), String>) -> bool {
        let Err(problem) = outcome else { return true };
        match self.archive.blocks(Tag::new(tag)).next() {
            Some(block) => self.fault(report, block, problem),
            None => report.damages.push(Damage::of_file(&self.name, format!("`{tag}`: {problem}"))),
        }
        false
    }

    /// The array of the only block with a tag; None where it is damaged, which is noted unless it was before.
    pub(super) fn array<T: Pod>(&self, report: &mut Report, tag: &str) -> Option<&[T]> {
        if self.archive.blocks(Tag::new(tag)).any(|block| !self.is_whole(block)) {
            return None;
        }
        match self.archive.array::<T>(Tag::new(tag)) {
            Ok(array) => Some(array),
            Err(Error::Damaged { problem, .. }) => {
                self.hold(report, tag, Err(problem));
                None
            }
            Err(error) => {
                self.hold(report, tag, Err(error.to_string()));
                None
            }
        }
    }

    /// As [`Opened::array`], of this many entries.
    pub(super) fn sized<T: Pod>(&self, report: &mut Report, tag: &str, entries: usize) -> Option<&[T]> {
        let array = self.array::<T>(report, tag)?;
        let fits = array.len() == entries;
        let problem = || format!("expected {entries} entries, got {}", array.len());
        self.hold(report, tag, if fits { Ok(()) } else { Err(problem()) }).then_some(array)
    }
}

/// A tag's letters without the quotes that it is shown in.
fn name_of(tag: Tag) -> String {
    tag.to_string().trim_matches('`').to_owned()
}

/// Notes archives that were made from other inputs or options than the job's files say, or than the others were, and puts
/// them aside: their blocks are whole, but of another job.
pub(super) fn agree(opened: &mut Archives, sides: &Sides, report: &mut Report) -> Result<()> {
    let [inputs, options] = sides.digests()?;
    let of = |archive: &Opened, which: usize| {
        let digests = archive.archive.digests();
        [digests.inputs, digests.options][which]
    };
    for (which, (what, told)) in [("inputs", inputs), ("options", options)].into_iter().enumerate() {
        // What most of them say counts, the job's own file being one voice.
        let voices: Vec<Digest> = opened.iter().flatten().map(|o| of(o, which)).chain(told).collect();
        let number = |digest: &Digest| voices.iter().filter(|other| *other == digest).count();
        let Some(common) = voices.iter().copied().max_by_key(|d| (number(d), *d)) else { continue };
        let problem = |got: Digest| format!("expected digest of {what} {common}, got {got}: of another job");
        for place in opened.iter_mut() {
            if let Some(other) = place.take_if(|archive| of(archive, which) != common) {
                report.damages.push(Damage::of_file(&other.name, problem(of(&other, which))));
            }
        }
        if let Some(got) = told.filter(|got| *got != common) {
            report.damages.push(Damage::of_file(format!("{what}.json"), problem(got)));
        }
    }
    Ok(())
}
