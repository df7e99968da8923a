//! Read-only memory maps of finished files, and what becomes of readers when such a file is cut: the only file of the
//! archive with `unsafe`.
#![allow(unsafe_code)]

use std::fs::File;
use std::io;
use std::ops::Range;
use std::path::Path;

use memmap2::{Advice, Mmap};

/// A read-only map of a file.
#[derive(Debug)]
pub struct Map {
    bytes: Mmap,
    file: File,
}

/// How a map is going to be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// The system's default read-ahead (128 kB a touch).
    Normal,
    /// In file order: read far ahead, drop behind.
    Sequential,
    /// Scattered touches: one page each.
    Random,
}

impl Map {
    /// Maps a file.
    ///
    /// # Errors
    /// What the system says.
    pub fn open(path: &Path) -> io::Result<Self> {
        let file = File::open(path)?;
        // SAFETY: a map is sound as long as no one changes the bytes under it. Archives are written under another
        // name and renamed when finished; no code of this crate writes to, or truncates, a finished file: a new
        // version is a new file. Should another program do it, the bytes are only ever read as plain old data after
        // their checksum, so no value is invalid; and `touch` turns a truncation into an error.
        let bytes = unsafe { Mmap::map(&file)? };
        Ok(Self { bytes, file })
    }

    /// Reads a range in, as an error rather than the SIGBUS that a plain access gives where the file was cut short
    /// or the disk fails.
    ///
    /// # Errors
    /// `UnexpectedEof` when the file is now shorter than the map; what the system says otherwise.
    pub fn touch(&self, range: Range<usize>) -> io::Result<()> {
        self.still_whole()?;
        if range.is_empty() {
            return Ok(());
        }
        #[cfg(target_os = "linux")]
        match self.bytes.advise_range(Advice::PopulateRead, range.start, range.len()) {
            // Linux before 5.14 does not know the advice.
            Err(error) if error.kind() == io::ErrorKind::InvalidInput => {}
            // Pages that are gone are no more than an address that fails: the length tells whether the file was cut just now.
            Err(error) => return self.still_whole().and(Err(error)),
            Ok(()) => {}
        }
        Ok(())
    }

    /// Errors with `UnexpectedEof` when the file is now shorter than the map.
    fn still_whole(&self) -> io::Result<()> {
        let now = self.file.metadata()?.len();
        if now < self.bytes.len() as u64 {
            let problem = format!("cut from {} to {now} bytes while in use", self.bytes.len());
            return Err(io::Error::new(io::ErrorKind::UnexpectedEof, problem));
        }
        Ok(())
    }

    /// Announces the pattern of access.
    ///
    /// # Errors
    /// What the system says.
    pub fn advise(&self, access: Access) -> io::Result<()> {
        self.bytes.advise(match access {
            Access::Normal => Advice::Normal,
            Access::Sequential => Advice::Sequential,
            Access::Random => Advice::Random,
        })
    }

    /// Asks for a range to be read in the background.
    ///
    /// # Errors
    /// What the system says.
    pub fn prefetch(&self, range: Range<usize>) -> io::Result<()> {
        self.bytes.advise_range(Advice::WillNeed, range.start, range.len())
    }
}

/// Makes the program leave with a code when a mapped file is cut short between [`Map::touch`] and a read, which the system
/// answers with SIGBUS: each message is written to its file first. A system that refuses keeps its default.
#[cfg(unix)]
pub fn leave_when_cut(messages: Vec<(File, Vec<u8>)>, code: i32) {
    use std::io::Write;
    let leave = move || {
        for (mut file, message) in messages.iter().map(|(file, message)| (file, message)) {
            // There is nowhere left to complain.
            let _ = file.write(message);
        }
        signal_hook::low_level::exit(code)
    };
    // SAFETY: the action only reads memory that it owns and calls write(2) and _exit(2), all of which a signal handler may
    // do. It must not return: the standard library's own handler, which runs before, puts the default action back, so that
    // the next SIGBUS kills.
    let _ = unsafe { signal_hook::low_level::register(signal_hook::consts::SIGBUS, leave) };
}

impl AsRef<[u8]> for Map {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}
