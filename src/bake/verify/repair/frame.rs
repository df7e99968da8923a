//! Superblock, directory and trailer, made again from the blocks between them.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

use super::{Repaired, RepairedFile, readable};
use crate::archive::{Archive, Digests, SUPERBLOCK_BYTES, Tag, Writer, partial_path};
use crate::bake::verify::{ARCHIVES, Report, file_name};
use crate::error::{Error, Result};

/// Mends the frames of archives that do not open; whether any was mended.
pub(super) fn mend(job: &Path, report: &Report, repaired: &mut Repaired) -> Result<bool> {
    let others = readable(job);
    let Some(other) = others.first() else { return Ok(false) };
    let mut any = false;
    for kind in ARCHIVES {
        let name = file_name(kind);
        if report.is_whole_file(&name) || Archive::open(job.join(&name)).is_ok() {
            continue;
        }
        let kept = mend_one(job, kind, (other.digests(), other.provenance()))?;
        any |= kept.is_some();
        repaired.files.extend(kept.map(|kept_blocks| RepairedFile {
            file: name,
            made_blocks: 0,
            kept_blocks,
            by: "blocks read anew",
        }));
    }
    Ok(any)
}

/// Mends one file if all of its blocks are whole; how many they are.
fn mend_one(job: &Path, kind: &str, like: (Digests, &[(String, String)])) -> Result<Option<u64>> {
    let path = job.join(file_name(kind));
    let Ok(mut old) = File::open(&path) else { return Ok(None) };
    let folder = tempfile::Builder::new().prefix(".glowtree-").tempdir_in(job);
    let folder = folder.map_err(|e| Error::io(job, "making a temporary folder", e))?;
    let new = folder.path().join(file_name(kind));
    let (digests, provenance) = like;
    // A new file's superblock, then all that stands behind the old one's: the writer keeps the blocks that are whole.
    drop(Writer::create(&new, Tag::new(kind), digests)?);
    append_rest(&mut old, &partial_path(&new)).map_err(|e| Error::io(&new, "copying", e))?;
    let (writer, resumed) = Writer::resume(&new, Tag::new(kind), digests)?;
    let end = writer.bytes();
    let provenance: Vec<(&str, &str)> = provenance.iter().map(|(n, t)| (n.as_str(), t.as_str())).collect();
    writer.finish(&provenance)?;
    if !is_proven(&mut old, &new, end).map_err(|e| Error::io(&new, "comparing", e))? {
        return Ok(None);
    }
    fs::rename(&new, &path)
        .and_then(|()| File::open(job)?.sync_all())
        .map_err(|e| Error::io(&path, "renaming the mended file", e))?;
    Ok(Some(resumed.blocks as u64))
}

fn append_rest(old: &mut File, new: &Path) -> io::Result<()> {
    old.seek(SeekFrom::Start(SUPERBLOCK_BYTES as u64))?;
    let mut new = OpenOptions::new().append(true).open(new)?;
    io::copy(old, &mut new).map(drop)
}

/// Whether the old file has the new one's directory or its trailer: each tells of all blocks, so that none is missing.
fn is_proven(old: &mut File, new: &Path, directory: u64) -> io::Result<bool> {
    let mut tail = Vec::new();
    let mut new = File::open(new)?;
    new.seek(SeekFrom::Start(directory))?;
    new.read_to_end(&mut tail)?;
    let mut there = Vec::new();
    old.seek(SeekFrom::Start(directory))?;
    old.take(tail.len() as u64 + 1).read_to_end(&mut there)?;
    let middle = tail.len() - TRAILER_BYTES.min(tail.len());
    let same_directory = there.get(..middle) == Some(&tail[..middle]);
    let same_trailer = there.len() == tail.len() && there[middle..] == tail[middle..];
    Ok(same_directory || same_trailer)
}

/// The trailer's length: docs/format.md.
const TRAILER_BYTES: usize = 64;
