//! What an interrupted job has finished, and whether it was taken over.

use std::fs;
use std::path::{Path, PathBuf};

use glowtree::archive::{Digests, Tag, Writer};
use glowtree::bake::job::WORK_FOLDER;
use glowtree::bake::report::summary::SUMMARY_FILE;

use super::tally::{Bad, Trial};

/// What an interrupted job has finished.
pub struct Finished {
    /// Whole blocks in ledgers that a rerun reads.
    blocks: u64,
    /// Finished archives, by the number of their file on disk.
    archives: Vec<(PathBuf, u64)>,
    whole: bool,
}

impl Finished {
    /// Looks without changing anything.
    pub fn of(job: &Path, digests: Digests) -> Self {
        let pictured = job.join("mesh.ply").exists() && job.join("preview.png").exists();
        let archives = fs::read_dir(job).into_iter().flatten().flatten().map(|entry| entry.path());
        let archives = archives.filter(|path| path.extension().is_some_and(|end| end == "glow"));
        let ledgers = fs::read_dir(job.join(WORK_FOLDER)).into_iter().flatten().flatten();
        // Pictures that are there are not asked what they were made of.
        let read = ledgers.filter(|entry| !(pictured && entry.file_name() == "mesh.partial"));
        Self {
            blocks: read.map(|entry| whole_blocks(&entry.path(), digests)).sum(),
            archives: archives.map(|path| (path.clone(), file_number(&path))).collect(),
            whole: job.join(SUMMARY_FILE).exists(),
        }
    }

    /// Whether a rerun that ended well took all of it over.
    pub fn is_reused(&self, job: &Path, (resumed, computed): (u64, u64)) -> Trial {
        if self.whole {
            let why = || format!("a finished job was baked again: {computed} blocks");
            return if computed == 0 { Ok(()) } else { Err(Bad::Lost(computed, why())) };
        }
        if resumed != self.blocks {
            let why = format!("{} blocks were whole, {resumed} were reused", self.blocks);
            return Err(Bad::Lost(self.blocks.abs_diff(resumed), why));
        }
        for (path, number) in &self.archives {
            if file_number(&job.join(path.file_name().unwrap_or_default())) != *number {
                return Err(Bad::Lost(1, format!("{} was written again", path.display())));
            }
        }
        Ok(())
    }
}

/// The leading whole blocks of an unfinished ledger, of which a copy is examined.
fn whole_blocks(partial: &Path, digests: Digests) -> u64 {
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join("copy");
    if fs::copy(partial, glowtree::archive::partial_path(&copy)).is_err() {
        return 0;
    }
    Writer::resume(&copy, Tag::new("ledger"), digests).map_or(0, |(_, resumed)| resumed.blocks as u64)
}

#[cfg(unix)]
fn file_number(path: &Path) -> u64 {
    use std::os::unix::fs::MetadataExt;
    fs::metadata(path).map_or(0, |meta| meta.ino())
}

#[cfg(not(unix))]
fn file_number(_: &Path) -> u64 {
    0
}
