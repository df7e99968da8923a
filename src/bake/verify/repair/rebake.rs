//! A new bake of the same inputs, from which damaged blocks are taken once the whole ones prove it the same.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::Arc;

use tempfile::TempDir;

use super::headers::HEADER_BYTES;
use super::{Plan, Repaired, RepairedFile, damaged};
use crate::archive::{Archive, Block, Digest, Disk, Storage};
use crate::bake::job::{self, INPUTS_FILE, Inputs, OPTIONS_FILE, read_side, write_side};
use crate::bake::options::Options;
use crate::bake::report::progress::Monitor;
use crate::bake::report::summary::{SUMMARY_FILE, Summary};
use crate::bake::verify::{ARCHIVES, Report, file_name};
use crate::error::{Error, Result};

/// What a job was asked and made from, and a folder beside it to make it again.
pub(super) fn again(job: &Path) -> Result<(Options, Inputs, TempDir)> {
    let options = read_side::<Options>(&job.join(OPTIONS_FILE))?;
    let inputs = read_side::<Inputs>(&job.join(INPUTS_FILE))?;
    let (Some(options), Some(inputs)) = (options, inputs) else {
        return Err(Error::NoJob { job: job.to_path_buf() });
    };
    let here = job.canonicalize().map_err(|e| Error::io(job, "looking for the job", e))?;
    let parent = here.parent().unwrap_or(&here);
    let folder = tempfile::Builder::new().prefix(".glowtree-repair-").tempdir_in(parent);
    let folder = folder.map_err(|e| Error::io(parent, "making a temporary folder", e))?;
    Ok((options, inputs, folder))
}

/// Bakes the job's scene again beside the job and takes what is damaged.
pub(super) fn mend(
    job: &Path,
    report: &Report,
    repaired: &mut Repaired,
    monitor: &dyn Monitor,
) -> Result<()> {
    let (options, inputs, folder) = again(job)?;
    let scene = unchanged(job, &inputs)?;
    let new = folder.path().join("job");
    let options = Options { restart: false, preview: false, max_memory_bytes: None, ..options };
    job::run(scene, &new, &options, monitor)?;
    repaired.rebaked = true;
    // All are compared before the first is changed.
    let archives: Vec<Archive> =
        ARCHIVES.iter().map(|kind| Archive::open(new.join(file_name(kind)))).collect::<Result<_>>()?;
    for (kind, fresh) in ARCHIVES.iter().zip(&archives) {
        compare(job, &file_name(kind), fresh, report)?;
    }
    for (kind, fresh) in ARCHIVES.iter().zip(&archives).filter(|(k, _)| !report.is_whole_file(&file_name(k)))
    {
        repaired.files.push(take(job, kind, fresh, report)?);
    }
    if !report.is_whole_file(SUMMARY_FILE) {
        let storage: Arc<dyn Storage> = Arc::new(Disk);
        write_side(&storage, &job.join(SUMMARY_FILE), &Summary::read(&new)?)?;
        let file = SUMMARY_FILE.to_owned();
        repaired.files.push(RepairedFile { file, made_blocks: 0, kept_blocks: 0, by: "baked anew" });
    }
    Ok(())
}

/// The scene asked for, if all inputs are what they were.
pub(super) fn unchanged<'a>(job: &Path, inputs: &'a Inputs) -> Result<&'a Path> {
    let differs = |difference: String| Error::JobDiffers { job: job.to_path_buf(), difference };
    for (file, digest) in &inputs.files {
        let shown = file.display();
        match Digest::of_file(file) {
            Ok(now) if now.to_string() == *digest => {}
            Ok(now) => {
                return Err(differs(format!("{shown} has changed: digest {digest} then, {now} now")));
            }
            Err(Error::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => {
                return Err(differs(format!("{shown} is gone, seen from where the program runs")));
            }
            Err(error) => return Err(error),
        }
    }
    match inputs.files.first() {
        Some((scene, _)) => Ok(scene),
        None => Err(differs("no inputs are listed".to_owned())),
    }
}

/// The job's own file, if it opens and parts of it are to be kept.
pub(super) fn kept(job: &Path, name: &str, report: &Report) -> Option<(Archive, BTreeSet<usize>)> {
    let archive = Archive::open(job.join(name)).ok()?;
    let damaged = if report.is_whole_file(name) { BTreeSet::new() } else { damaged(report, name, |_| true)? };
    Some((archive, damaged))
}

/// Refuses a new file that does not have the job's whole blocks.
pub(super) fn compare(job: &Path, name: &str, fresh: &Archive, report: &Report) -> Result<()> {
    let Some((old, damaged)) = kept(job, name, report) else { return Ok(()) };
    let other = |what: String| {
        let difference = format!("{name}: {what} is another when made now");
        Err(Error::JobDiffers { job: job.to_path_buf(), difference })
    };
    if old.digests() != fresh.digests() {
        return other("the digest of inputs or options".into());
    }
    if old.all_blocks().count() != fresh.all_blocks().count() {
        return other("the number of blocks".into());
    }
    let differs = |(a, b): &(Block<'_>, Block<'_>)| {
        let place = |block: &Block<'_>| (block.entry().tag, block.range());
        // A later block's place may change when one before it is mended.
        let same = place(a) == place(b) && a.entry().hash == b.entry().hash;
        !same && !damaged.contains(&a.number())
    };
    let first = old.all_blocks().zip(fresh.all_blocks()).find(differs);
    match first {
        Some((block, _)) => other(format!("block {} {}", block.number(), block.entry().tag)),
        None => Ok(()),
    }
}

/// Writes a file of the job's whole blocks and the new bake's for those that are damaged.
fn take(job: &Path, kind: &str, fresh: &Archive, report: &Report) -> Result<RepairedFile> {
    let name = file_name(kind);
    let old = kept(job, &name, report);
    let provenance = old.as_ref().map_or(fresh.provenance(), |(old, _)| old.provenance());
    let plan = Plan { job, kind, digests: fresh.digests(), provenance };
    let mut made_blocks = 0;
    let mut present = File::open(job.join(&name)).ok();
    let proven = plan.write(|writer| {
        let mut own = old.as_ref().map(|(old, damaged)| (old.all_blocks(), damaged));
        for block in fresh.all_blocks() {
            let whole = own.as_mut().and_then(|(blocks, damaged)| {
                blocks.next().filter(|block| !damaged.contains(&block.number()))
            });
            if let Some(whole) = whole {
                writer.append_copy(whole)?;
            } else {
                made_blocks += u64::from(old.is_some() || !is_present(present.as_mut(), &block));
                writer.append_copy(block)?;
            }
        }
        Ok(writer.entries().iter().eq(fresh.all_blocks().map(|block| block.entry())))
    })?;
    if !proven {
        let difference = format!("{name}: blocks of both bakes do not fit together");
        return Err(Error::JobDiffers { job: job.to_path_buf(), difference });
    }
    let kept_blocks = fresh.all_blocks().count() as u64 - made_blocks;
    Ok(RepairedFile { file: name, made_blocks, kept_blocks, by: "baked anew" })
}

/// Bytes compared at a time.
const PIECE_BYTES: usize = 1 << 20;

/// Whether a file that does not open holds a block's payload all the same, where it belongs.
fn is_present(file: Option<&mut File>, block: &Block<'_>) -> bool {
    let (Some(file), Ok(payload)) = (file, block.stored()) else { return false };
    let end = block.entry().offset + HEADER_BYTES + block.entry().stored_bytes;
    if file.metadata().map_or(0, |meta| meta.len()) < end {
        return false;
    }
    if file.seek(SeekFrom::Start(block.entry().offset + HEADER_BYTES)).is_err() {
        return false;
    }
    let mut piece = vec![0; PIECE_BYTES.min(payload.len())];
    payload.chunks(PIECE_BYTES).all(|expected| {
        let piece = &mut piece[..expected.len()];
        file.read_exact(piece).is_ok() && piece == expected
    })
}
