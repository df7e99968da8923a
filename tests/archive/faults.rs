//! A storage in memory that fails at the n-th operation, dies, or loses power.
//!
//! It keeps what a running system sees apart from what a power loss leaves: unsynced writes survive sector by sector,
//! each or not, and renames survive up to some point. A failed sync throws the unsynced data away while still showing
//! it, as Linux does.

use std::collections::BTreeMap;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use glowtree::archive::{Storage, StoredFile};

/// What happens at the chosen operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    Failed,
    Full,
    Interrupted,
    Short,
    /// This operation (half of it, when it writes) is the last that the process does.
    Killed,
}

#[derive(Clone, Debug, Default)]
pub struct Memory(Arc<Mutex<State>>);

#[derive(Clone, Debug, Default)]
struct State {
    files: Vec<Contents>,
    names: BTreeMap<PathBuf, usize>,
    durable_names: BTreeMap<PathBuf, usize>,
    pending_names: Vec<NameChange>,
    operations: u64,
    fault: Option<(u64, Fault)>,
    dead: bool,
    /// A disk that says it synced and did not.
    lying: bool,
}

#[derive(Clone, Debug, Default)]
struct Contents {
    now: Vec<u8>,
    durable: Vec<u8>,
    pending: Vec<Change>,
}

#[derive(Clone, Debug)]
enum Change {
    Write(usize, Vec<u8>),
    Length(usize),
}

#[derive(Clone, Debug)]
enum NameChange {
    Create(PathBuf, usize),
    Rename(PathBuf, PathBuf),
    Remove(PathBuf),
}

impl Change {
    fn apply(&self, bytes: &mut Vec<u8>) {
        match self {
            Self::Length(length) => bytes.resize(*length, 0),
            Self::Write(at, written) => {
                bytes.resize(bytes.len().max(at + written.len()), 0);
                bytes[*at..at + written.len()].copy_from_slice(written);
            }
        }
    }

    /// What a power loss leaves of it: for a write, any of its sectors.
    fn survivors(&self, sector: usize, random: &mut impl FnMut() -> u64) -> Vec<Self> {
        let Self::Write(at, bytes) = self else {
            return if random().is_multiple_of(2) { vec![self.clone()] } else { vec![] };
        };
        let share = random() % 5; // of sectors in quarters: none, some or all
        let mut left = Vec::new();
        let mut start = 0;
        while start < bytes.len() {
            let end = bytes.len().min((at + start + 1).next_multiple_of(sector) - at);
            if random() % 4 < share {
                left.push(Self::Write(at + start, bytes[start..end].to_vec()));
            }
            start = end;
        }
        left
    }
}

impl NameChange {
    fn apply(&self, names: &mut BTreeMap<PathBuf, usize>) {
        match self {
            Self::Create(path, file) => {
                names.insert(path.clone(), *file);
            }
            Self::Rename(from, to) => {
                if let Some(file) = names.remove(from) {
                    names.insert(to.clone(), file);
                }
            }
            Self::Remove(path) => {
                names.remove(path);
            }
        }
    }
}

impl State {
    /// Counts an operation; an error or a fault to act upon when it is the chosen one.
    fn step(&mut self) -> io::Result<Option<Fault>> {
        if self.dead {
            return Err(io::Error::other("the process is dead"));
        }
        self.operations += 1;
        match self.fault {
            Some((at, fault)) if at == self.operations => match fault {
                Fault::Failed => Err(io::Error::other("injected")),
                Fault::Full => Err(io::ErrorKind::StorageFull.into()),
                Fault::Killed => {
                    self.dead = true;
                    Ok(Some(fault))
                }
                Fault::Interrupted | Fault::Short => Ok(Some(fault)),
            },
            _ => Ok(None),
        }
    }

    fn change(&mut self, file: usize, change: Change) {
        change.apply(&mut self.files[file].now);
        self.files[file].pending.push(change);
    }

    fn rename(&mut self, change: NameChange) {
        change.apply(&mut self.names);
        self.pending_names.push(change);
    }
}

impl Memory {
    /// A storage that fails at operation `at` (from 1).
    pub fn with_fault(at: u64, fault: Fault) -> Self {
        let memory = Self::default();
        memory.0.lock().unwrap().fault = Some((at, fault));
        memory
    }

    /// A storage whose syncs do nothing.
    pub fn lying() -> Self {
        let memory = Self::default();
        memory.0.lock().unwrap().lying = true;
        memory
    }

    pub fn operations(&self) -> u64 {
        self.0.lock().unwrap().operations
    }

    pub fn bytes(&self, path: &Path) -> Option<Vec<u8>> {
        let state = self.0.lock().unwrap();
        state.names.get(path).map(|&file| state.files[file].now.clone())
    }

    pub fn put(&self, path: &Path, bytes: &[u8]) {
        let mut state = self.0.lock().unwrap();
        let file = state.files.len();
        state.files.push(Contents { now: bytes.to_vec(), durable: bytes.to_vec(), pending: vec![] });
        state.names.insert(path.into(), file);
        state.durable_names.insert(path.into(), file);
    }

    /// The system goes on, without faults: what the next process finds.
    pub fn next_process(&self) {
        let mut state = self.0.lock().unwrap();
        (state.fault, state.dead) = (None, false);
    }

    /// The machine as it is after a power loss now; this storage stays as it is.
    pub fn after_power_loss(&self, sector: usize, mut random: impl FnMut() -> u64) -> Self {
        let mut state = self.0.lock().unwrap().clone();
        let kept_names = random() as usize % (state.pending_names.len() + 1);
        for change in state.pending_names.drain(..).take(kept_names) {
            change.apply(&mut state.durable_names);
        }
        state.names = state.durable_names.clone();
        for contents in &mut state.files {
            for change in contents.pending.drain(..) {
                for survivor in change.survivors(sector, &mut random) {
                    survivor.apply(&mut contents.durable);
                }
            }
            contents.now.clone_from(&contents.durable);
        }
        let machine = Self(Arc::new(Mutex::new(state)));
        machine.next_process();
        machine
    }
}

impl Storage for Memory {
    fn create(&self, path: &Path) -> io::Result<Box<dyn StoredFile>> {
        let mut state = self.0.lock().unwrap();
        state.step()?;
        let file = state.files.len();
        state.files.push(Contents::default());
        state.rename(NameChange::Create(path.into(), file));
        Ok(Box::new(Handle { memory: self.clone(), file, at: 0 }))
    }

    fn open(&self, path: &Path) -> io::Result<Box<dyn StoredFile>> {
        let mut state = self.0.lock().unwrap();
        state.step()?;
        let file = *state.names.get(path).ok_or(io::ErrorKind::NotFound)?;
        Ok(Box::new(Handle { memory: self.clone(), file, at: 0 }))
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        let mut state = self.0.lock().unwrap();
        state.step()?;
        state.rename(NameChange::Rename(from.into(), to.into()));
        Ok(())
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        let mut state = self.0.lock().unwrap();
        state.step()?;
        state.rename(NameChange::Remove(path.into()));
        Ok(())
    }

    fn create_directory(&self, _path: &Path) -> io::Result<()> {
        Err(io::ErrorKind::Unsupported.into())
    }

    fn remove_directory(&self, _path: &Path) -> io::Result<()> {
        Err(io::ErrorKind::Unsupported.into())
    }

    fn exchange(&self, _one: &Path, _other: &Path) -> io::Result<()> {
        Err(io::ErrorKind::Unsupported.into())
    }

    fn sync_directory(&self, _directory: &Path) -> io::Result<()> {
        let mut state = self.0.lock().unwrap();
        state.step()?;
        if !state.lying {
            state.durable_names = state.names.clone();
            state.pending_names.clear();
        }
        Ok(())
    }
}

/// An open file of a [`Memory`].
#[derive(Debug)]
pub struct Handle {
    memory: Memory,
    file: usize,
    at: usize,
}

impl Read for Handle {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut state = self.memory.0.lock().unwrap();
        let fault = state.step()?;
        if fault == Some(Fault::Interrupted) {
            return Err(io::ErrorKind::Interrupted.into());
        }
        let bytes = &state.files[self.file].now;
        let left = &bytes[self.at.min(bytes.len())..];
        let mut count = left.len().min(buffer.len());
        if fault == Some(Fault::Short) {
            count = count.div_ceil(2);
        }
        buffer[..count].copy_from_slice(&left[..count]);
        self.at += count;
        Ok(count)
    }
}

impl Write for Handle {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut state = self.memory.0.lock().unwrap();
        let fault = state.step()?;
        let count = match fault {
            Some(Fault::Interrupted) => return Err(io::ErrorKind::Interrupted.into()),
            Some(Fault::Short | Fault::Killed) => bytes.len().div_ceil(2),
            _ => bytes.len(),
        };
        state.change(self.file, Change::Write(self.at, bytes[..count].to_vec()));
        self.at += count;
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for Handle {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        self.at = match position {
            SeekFrom::Start(at) => at as usize,
            SeekFrom::End(0) => self.memory.0.lock().unwrap().files[self.file].now.len(),
            other => panic!("the writer does not seek to {other:?}"),
        };
        Ok(self.at as u64)
    }
}

impl StoredFile for Handle {
    fn sync(&mut self) -> io::Result<()> {
        let mut state = self.memory.0.lock().unwrap();
        let (dead, lying) = (state.dead, state.lying);
        let outcome = state.step();
        let contents = &mut state.files[self.file];
        match outcome {
            _ if dead || lying => {}
            Ok(_) => {
                for change in std::mem::take(&mut contents.pending) {
                    change.apply(&mut contents.durable);
                }
            }
            Err(_) => contents.pending.clear(), // the system marks the lost pages clean
        }
        outcome.map(|_| ())
    }

    fn truncate(&mut self, bytes: u64) -> io::Result<()> {
        let mut state = self.memory.0.lock().unwrap();
        state.step()?;
        state.change(self.file, Change::Length(bytes as usize));
        Ok(())
    }

    fn reserve(&mut self, _end: u64) -> io::Result<()> {
        self.memory.0.lock().unwrap().step().map(|_| ())
    }
}
