//! Markers of scratch files: what they were made from. One that is there, and says the same, tells that they are whole.

use std::fs::File;
use std::io;
use std::path::Path;
use std::time::UNIX_EPOCH;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// Tells a file from what it was when scratch was made from it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Origin {
    bytes: u64,
    modified_nanoseconds: u64,
}

impl Origin {
    /// Of an open file.
    ///
    /// # Errors
    /// What the system says.
    pub fn of(file: &File) -> io::Result<Self> {
        let metadata = file.metadata()?;
        let since = metadata.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
        let modified_nanoseconds = since.map_or(0, |since| since.as_nanos() as u64);
        Ok(Self { bytes: metadata.len(), modified_nanoseconds })
    }

    /// The file's length.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }
}

/// The marker at this path, if it is there and holds what is expected of one.
pub fn read<T: DeserializeOwned>(path: &Path) -> Option<T> {
    serde_json::from_slice(&std::fs::read(path).ok()?).ok()
}

/// Writes the marker once all that it vouches for is written.
///
/// # Errors
/// [`Error::Io`], [`Error::DiskFull`].
pub fn write(path: &Path, marker: &impl Serialize) -> Result<()> {
    let fail = |source| Error::io(path, "writing", source);
    let text = serde_json::to_vec(marker).map_err(|error| fail(io::Error::other(error)))?;
    // Under its name only when it is whole: a process may be killed in between.
    let new = path.with_extension("new");
    std::fs::write(&new, text).and_then(|()| std::fs::rename(&new, path)).map_err(fail)
}

/// Removes the marker before what it vouches for is made anew.
///
/// # Errors
/// [`Error::Io`].
pub fn remove(path: &Path) -> Result<()> {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(Error::io(path, "removing", error)),
        _ => Ok(()),
    }
}
