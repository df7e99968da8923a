//! A storage over the real disk that counts what changes it, and has mishaps.

pub mod log;
pub mod power;
pub mod story;

use std::fmt::Debug;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use glowtree::archive::{Disk, Storage, StoredFile};

use log::{Change, Kind, Mishap};

/// The storage; clones are the same.
#[derive(Clone, Debug, Default)]
pub struct Clumsy(Arc<Mutex<State>>);

#[derive(Debug, Default)]
struct State {
    kinds: Vec<Kind>,
    mishap: Option<(usize, Mishap)>,
    dead: bool,
    /// Bytes that may still be written.
    room: Option<u64>,
    log: Option<Vec<Change>>,
}

impl Clumsy {
    /// Has a mishap at operation `at`, from 0.
    pub fn at(at: usize, mishap: Mishap) -> Self {
        let clumsy = Self::default();
        clumsy.0.lock().unwrap().mishap = Some((at, mishap));
        clumsy
    }

    /// A disk with so much room.
    pub fn with_room(bytes: u64) -> Self {
        let clumsy = Self::default();
        clumsy.0.lock().unwrap().room = Some(bytes);
        clumsy
    }

    /// Writes down every change.
    pub fn logging() -> Self {
        let clumsy = Self::default();
        clumsy.0.lock().unwrap().log = Some(Vec::new());
        clumsy
    }

    /// The operations so far, by kind.
    pub fn kinds(&self) -> Vec<Kind> {
        self.0.lock().unwrap().kinds.clone()
    }

    /// The changes so far.
    pub fn log(&self) -> Vec<Change> {
        self.0.lock().unwrap().log.clone().unwrap_or_default()
    }

    /// As what the bake takes.
    pub fn shared(&self) -> Arc<dyn Storage> {
        Arc::new(self.clone())
    }

    /// Counts an operation; the mishap if it is its turn.
    fn step(&self, kind: Kind) -> io::Result<Option<Mishap>> {
        let mut state = self.0.lock().unwrap();
        if state.dead {
            return Err(io::Error::other("the process is dead"));
        }
        let number = state.kinds.len();
        state.kinds.push(kind);
        let mishap = state.mishap.filter(|&(at, _)| at == number).map(|(_, mishap)| mishap);
        match mishap {
            Some(Mishap::Fails(number)) => Err(io::Error::from_raw_os_error(number)),
            Some(Mishap::Killed) => {
                state.dead = true;
                Ok(mishap)
            }
            _ => Ok(mishap),
        }
    }

    fn note(&self, change: impl FnOnce() -> Change) {
        if let Some(log) = &mut self.0.lock().unwrap().log {
            log.push(change());
        }
    }

    /// An operation on names.
    fn named(
        &self,
        kind: Kind,
        act: impl FnOnce() -> io::Result<()>,
        change: impl FnOnce() -> Change,
    ) -> io::Result<()> {
        self.step(kind)?;
        act()?;
        self.note(change);
        Ok(())
    }

    fn file(&self, file: Box<dyn StoredFile>, path: &Path) -> Box<dyn StoredFile> {
        Box::new(Handle { storage: self.clone(), file, path: path.into(), at: 0 })
    }
}

impl Storage for Clumsy {
    fn create(&self, path: &Path) -> io::Result<Box<dyn StoredFile>> {
        self.step(Kind::Create)?;
        let file = Disk.create(path)?;
        self.note(|| Change::Create(path.into()));
        Ok(self.file(file, path))
    }

    fn open(&self, path: &Path) -> io::Result<Box<dyn StoredFile>> {
        self.step(Kind::Open)?;
        Ok(self.file(Disk.open(path)?, path))
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.named(Kind::Rename, || Disk.rename(from, to), || Change::Rename(from.into(), to.into()))
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        self.named(Kind::Remove, || Disk.remove(path), || Change::Remove(path.into()))
    }

    fn create_directory(&self, path: &Path) -> io::Result<()> {
        self.named(Kind::CreateDirectory, || Disk.create_directory(path), || Change::Directory(path.into()))
    }

    fn remove_directory(&self, path: &Path) -> io::Result<()> {
        self.named(Kind::RemoveDirectory, || Disk.remove_directory(path), || Change::RemoveAll(path.into()))
    }

    fn exchange(&self, one: &Path, other: &Path) -> io::Result<()> {
        let change = || Change::Exchange(one.into(), other.into());
        self.named(Kind::Exchange, || Disk.exchange(one, other), change)
    }

    fn sync_directory(&self, directory: &Path) -> io::Result<()> {
        let change = || Change::SyncDirectory(directory.into());
        // Nothing here is ever cut off from the current: the system need not be asked.
        self.named(Kind::SyncDirectory, || Ok(()), change)
    }
}

/// An open file of a [`Clumsy`] storage.
#[derive(Debug)]
struct Handle {
    storage: Clumsy,
    file: Box<dyn StoredFile>,
    path: PathBuf,
    at: u64,
}

impl Read for Handle {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let take = match self.storage.step(Kind::Read)? {
            Some(Mishap::Interrupted) => return Err(io::ErrorKind::Interrupted.into()),
            Some(Mishap::Short) => buffer.len().div_ceil(2),
            _ => buffer.len(),
        };
        let count = self.file.read(&mut buffer[..take])?;
        self.at += count as u64;
        Ok(count)
    }
}

impl Write for Handle {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut take = match self.storage.step(Kind::Write)? {
            Some(Mishap::Interrupted) => return Err(io::ErrorKind::Interrupted.into()),
            Some(Mishap::Short | Mishap::Killed) => bytes.len().div_ceil(2),
            _ => bytes.len(),
        };
        if let Some(room) = &mut self.storage.0.lock().unwrap().room {
            take = take.min(usize::try_from(*room).unwrap_or(usize::MAX));
            *room -= take as u64;
        }
        if take == 0 && !bytes.is_empty() {
            return Err(io::ErrorKind::StorageFull.into());
        }
        self.file.write_all(&bytes[..take])?;
        self.storage.note(|| Change::Write(self.path.clone(), self.at as usize, bytes[..take].into()));
        self.at += take as u64;
        Ok(take)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Seek for Handle {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        self.at = self.file.seek(position)?;
        Ok(self.at)
    }
}

impl StoredFile for Handle {
    fn sync(&mut self) -> io::Result<()> {
        self.storage.step(Kind::Sync)?;
        self.storage.note(|| Change::Sync(self.path.clone()));
        Ok(())
    }

    fn truncate(&mut self, bytes: u64) -> io::Result<()> {
        self.storage.step(Kind::Truncate)?;
        self.file.truncate(bytes)?;
        self.storage.note(|| Change::Length(self.path.clone(), bytes as usize));
        Ok(())
    }

    fn reserve(&mut self, end: u64) -> io::Result<()> {
        self.storage.step(Kind::Reserve)?;
        self.file.reserve(end)
    }
}
