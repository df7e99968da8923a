//! The job's unfinished work: ledgers in a folder of their own, removed when the job is done.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::archive::{Counts, Digests, Ledger, Pause, Storage, partial_path};
use crate::bake::pipeline::Journal;
use crate::bake::report::progress::Monitor;
use crate::error::{Error, Result};

/// The folder within the job directory that holds unfinished work.
pub const WORK_FOLDER: &str = "work";

/// The ledgers of one bake.
pub struct Work<'a> {
    storage: &'a Arc<dyn Storage>,
    folder: PathBuf,
    digests: Digests,
    pause: Pause<'a>,
    monitor: &'a dyn Monitor,
    rounds: Ledger<'a>,
    counts: Arc<Counts>,
}

impl<'a> Work<'a> {
    /// Continues what the job directory holds of this work, or begins it.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::DiskFull`].
    pub fn resume(
        storage: &'a Arc<dyn Storage>,
        job: &Path,
        digests: Digests,
        (pause, monitor): (Pause<'a>, &'a dyn Monitor),
    ) -> Result<Self> {
        let folder = job.join(WORK_FOLDER);
        super::side::make_directory(storage, &folder)
            .map_err(|e| Error::io(&folder, "making the folder", e))?;
        let counts = Arc::new(Counts::default());
        let (rounds, _) = Ledger::resume(storage, &folder.join("rounds"), digests, (pause, &counts))?;
        Ok(Self { storage, folder, digests, pause, monitor, rounds, counts })
    }

    /// A ledger by name.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::DiskFull`].
    pub fn ledger(&self, name: &str) -> Result<Ledger<'_>> {
        let watch = (self.pause, &self.counts);
        let (ledger, resumed) = Ledger::resume(self.storage, &self.folder.join(name), self.digests, watch)?;
        if resumed.blocks > 0 {
            let blocks = resumed.blocks;
            self.monitor
                .note(&format!("{name}: {blocks} blocks of an earlier run are reused, the rest is made"));
        }
        Ok(ledger)
    }

    /// How many blocks were read and made so far.
    pub fn counts(&self) -> &Counts {
        &self.counts
    }
}

impl Journal for Work<'_> {
    fn rounds(&self) -> &Ledger<'_> {
        &self.rounds
    }

    fn round(&self, number: u32) -> Result<Ledger<'_>> {
        if number > 1 {
            let before = partial_path(self.folder.join(format!("round-{}", number - 1)));
            match self.storage.remove(&before) {
                Err(e) if e.kind() != io::ErrorKind::NotFound => {
                    return Err(Error::io(before, "removing", e));
                }
                _ => {}
            }
        }
        self.ledger(&format!("round-{number}"))
    }
}

/// Removes the unfinished work of a job, if there is any.
///
/// # Errors
/// [`Error::Io`].
pub fn clear(storage: &Arc<dyn Storage>, job: &Path) -> Result<()> {
    let folder = job.join(WORK_FOLDER);
    if !folder.exists() {
        return Ok(());
    }
    storage.remove_directory(&folder).map_err(|e| Error::io(folder, "removing", e))
}
