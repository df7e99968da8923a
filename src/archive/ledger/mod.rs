//! What a long run has done so far, block by block: a run that was interrupted reads the blocks that are there and makes
//! the others.
//!
//! A run is a fixed sequence of blocks, each made from the inputs and the blocks before it. The ledger is that sequence
//! in an unfinished archive: whoever starts again asks for the same blocks in the same order and gets those that were
//! finished from the file, until they end. It is therefore enough that every block is deterministic.

pub mod parcel;

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::{Digests, Resumed, Storage, Tag, Writer};
use crate::{Error, Result};
use parcel::{Keep, Parcel, Parts};

/// How often blocks are made durable: what a power loss costs at most. The system writes pages back by itself after
/// half of this, so that little is left for the sync to wait for.
const SYNC_INTERVAL: Duration = Duration::from_secs(60);

/// Asked between blocks whether to go on: errors end the run.
pub type Pause<'a> = &'a (dyn Fn() -> Result<()> + Sync);

/// Keeps the blocks of a run, or nothing ([`Ledger::idle`]). Blocks are kept in one order: by one thread.
pub struct Ledger<'a> {
    book: Option<Mutex<Book>>,
    pause: Pause<'a>,
}

struct Book {
    writer: Writer,
    /// The block that is asked for next.
    next: usize,
    counts: Arc<Counts>,
    synced: Instant,
}

/// How many blocks the ledgers of a run gave.
#[derive(Debug, Default)]
pub struct Counts {
    resumed: AtomicU64,
    computed: AtomicU64,
}

impl Counts {
    /// Blocks read: an earlier run made them.
    pub fn resumed(&self) -> u64 {
        self.resumed.load(Ordering::Relaxed)
    }

    /// Blocks made by this run.
    pub fn computed(&self) -> u64 {
        self.computed.load(Ordering::Relaxed)
    }
}

impl<'a> Ledger<'a> {
    /// Keeps nothing; `pause` is asked all the same.
    pub fn idle(pause: Pause<'a>) -> Self {
        Self { book: None, pause }
    }

    /// Continues the ledger at `path`, or begins it. One that was made from something else is begun anew.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::DiskFull`].
    pub fn resume(
        storage: &Arc<dyn Storage>,
        path: &Path,
        digests: Digests,
        (pause, counts): (Pause<'a>, &Arc<Counts>),
    ) -> Result<(Self, Resumed)> {
        let kind = Tag::new("ledger");
        let (writer, resumed) = match Writer::resume_in(Arc::clone(storage), path, kind, digests) {
            Err(Error::JobDiffers { .. }) => {
                let writer = Writer::create_in(Arc::clone(storage), path, kind, digests)?;
                (writer, Resumed::default())
            }
            outcome => outcome?,
        };
        let book = Book { writer, next: 0, counts: Arc::clone(counts), synced: Instant::now() };
        Ok((Self { book: Some(Mutex::new(book)), pause }, resumed))
    }

    /// One block: read if it is there, else made and kept.
    ///
    /// # Errors
    /// What `make` and the pause say; [`Error::Damaged`] when the file holds another block in its place; [`Error::Io`],
    /// [`Error::DiskFull`].
    pub fn keep<K: Keep>(&self, tag: Tag, range: Range<u64>, make: impl FnOnce() -> Result<K>) -> Result<K> {
        let Some(book) = &self.book else {
            (self.pause)()?;
            return make();
        };
        if let Err(stop) = (self.pause)() {
            // Who stops here leaves all of it behind; if that fails, the blocks are on their way to the disk all the same.
            let _ = lock(book).writer.checkpoint();
            return Err(stop);
        }
        if let Some(parcel) = lock(book).found(tag, &range)? {
            return parcel.open(&tag.to_string());
        }
        // Unlocked: what is made may keep nothing, but it may ask how the ledger stands.
        let made = make()?;
        lock(book).append(tag, range, &Parts::of(&made))?;
        Ok(made)
    }

    /// Blocks of at most `most` of `count` entries, each handed to `take` in order.
    ///
    /// # Errors
    /// As [`Ledger::keep`].
    pub fn blocks<K: Keep>(
        &self,
        tag: Tag,
        (count, most): (usize, usize),
        mut make: impl FnMut(Range<usize>) -> Result<K>,
        mut take: impl FnMut(K),
    ) -> Result<()> {
        for first in (0..count).step_by(most.max(1)) {
            let range = first..count.min(first + most.max(1));
            take(self.keep(tag, range.start as u64..range.end as u64, || make(range))?);
        }
        Ok(())
    }

    /// Errors when the run is to end.
    ///
    /// # Errors
    /// What the pause says.
    pub fn pause(&self) -> Result<()> {
        (self.pause)()
    }
}

/// A panic while the book was held left it as it was before or after a block.
fn lock(book: &Mutex<Book>) -> MutexGuard<'_, Book> {
    book.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Book {
    /// The next block, if the file has one; it must be the one that is asked for.
    fn found(&mut self, tag: Tag, range: &Range<u64>) -> Result<Option<Parcel>> {
        let Some(entry) = self.writer.entries().get(self.next) else { return Ok(None) };
        if entry.tag != tag || entry.range() != *range {
            let place = format!("block {}", self.next);
            let problem = format!("expected {tag} {range:?}, got {} {:?}", entry.tag, entry.range());
            return Err(Error::Damaged { file: self.file(), place, problem });
        }
        let parcel = Parcel::from_bytes(self.writer.read_back(self.next)?, self.file());
        self.next += 1;
        self.counts.resumed.fetch_add(1, Ordering::Relaxed);
        Ok(Some(parcel))
    }

    fn append(&mut self, tag: Tag, range: Range<u64>, parts: &Parts<'_>) -> Result<()> {
        self.writer.append_parts(tag, range, &parts.bytes())?;
        self.next += 1;
        self.counts.computed.fetch_add(1, Ordering::Relaxed);
        if self.synced.elapsed() >= SYNC_INTERVAL {
            self.writer.checkpoint()?;
            self.synced = Instant::now();
        }
        Ok(())
    }

    fn file(&self) -> PathBuf {
        self.writer.partial().to_path_buf()
    }
}
