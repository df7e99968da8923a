//! What is done to the disk, in order, and what can happen to it.

use std::path::PathBuf;

/// One change, or one wish that earlier changes last.
#[derive(Clone, Debug)]
pub enum Change {
    /// A new empty file, or an old one emptied.
    Create(PathBuf),
    /// Bytes at an offset.
    Write(PathBuf, usize, Vec<u8>),
    /// A file cut or extended.
    Length(PathBuf, usize),
    /// A file's contents are to last.
    Sync(PathBuf),
    /// A new name within the same directory.
    Rename(PathBuf, PathBuf),
    /// A name is gone.
    Remove(PathBuf),
    /// A directory and those above it.
    Directory(PathBuf),
    /// A directory with all in it is gone.
    RemoveAll(PathBuf),
    /// Two names of one directory are exchanged.
    Exchange(PathBuf, PathBuf),
    /// A directory's names are to last.
    SyncDirectory(PathBuf),
}

/// What happens at the chosen operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mishap {
    /// It is the last one, and half of it if it writes.
    Killed,
    /// It fails with this number of the system's.
    Fails(i32),
    /// It is interrupted by a signal before anything was done.
    Interrupted,
    /// Half of what was asked is written.
    Short,
}

/// The kinds of operations that are counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Create,
    Open,
    Rename,
    Remove,
    CreateDirectory,
    RemoveDirectory,
    Exchange,
    SyncDirectory,
    Read,
    Write,
    Sync,
    Truncate,
    Reserve,
}

impl Kind {
    /// Whether the disk is another afterwards.
    pub fn changes(self) -> bool {
        !matches!(self, Self::Open | Self::Read)
    }
}
