//! Files that appear whole or not at all.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// What names of files that are not whole yet begin with.
pub const TEMPORARY: &str = ".glowtree-";

/// What `write` closures write to; counts bytes so that a full disk can say how many are missing.
pub struct Sink {
    file: BufWriter<File>,
    written_bytes: u64,
}

impl Sink {
    fn new(file: File) -> Self {
        Self { file: BufWriter::with_capacity(1 << 20, file), written_bytes: 0 }
    }

    /// Bytes written so far.
    pub fn written_bytes(&self) -> u64 {
        self.written_bytes
    }
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.file.write(bytes)?;
        self.written_bytes += count as u64;
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl io::Seek for Sink {
    fn seek(&mut self, to: io::SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}

/// Writes `path` through a temporary file beside it, synced and renamed when `write` succeeds; on any error the path is
/// as it was. Something that is no regular file (a pipe, a device) is written to as it stands.
///
/// `expected_bytes` is what the whole file will take, for the message of a full disk.
///
/// # Errors
/// [`Error::DiskFull`] with the missing bytes, [`Error::Io`], or what `write` says.
pub fn write_whole(
    path: &Path,
    expected_bytes: u64,
    write: impl FnOnce(&mut Sink) -> Result<()>,
) -> Result<()> {
    let failed = |source: io::Error| Error::io(path, "writing", source);
    if fs::metadata(path).is_ok_and(|meta| !meta.is_file() && !meta.is_dir()) {
        let mut sink = Sink::new(File::create(path).map_err(failed)?);
        write(&mut sink)?;
        return sink.flush().map_err(failed);
    }
    let folder = folder_of(path);
    let temporary = temporary_in(folder).map_err(failed)?;
    let (file, name) = temporary.into_parts();
    let mut sink = Sink::new(file);
    let outcome = write(&mut sink)
        .and_then(|()| sink.flush().map_err(failed))
        .and_then(|()| sink.file.get_ref().sync_all().map_err(failed));
    match outcome {
        Ok(()) => {
            name.persist(path).map_err(|e| failed(e.error))?;
            File::open(folder).and_then(|folder| folder.sync_all()).map_err(failed)
        }
        Err(Error::DiskFull { .. }) => Err(Error::DiskFull {
            file: PathBuf::from(path),
            needed_bytes: expected_bytes.saturating_sub(sink.written_bytes).max(1),
        }),
        Err(other) => Err(other),
    }
}

/// Writes what is in memory, whole or not at all.
///
/// # Errors
/// As [`write_whole`].
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<()> {
    write_whole(path, bytes.len() as u64, |sink| {
        sink.write_all(bytes).map_err(|e| Error::io(path, "writing", e))
    })
}

/// Checks that the folder that `path` is to lie in is there, before work is done that could not be kept.
///
/// # Errors
/// [`Error::Io`].
pub fn check_folder(path: &Path) -> Result<()> {
    let folder = folder_of(path);
    let meta =
        fs::metadata(folder).map_err(|e| Error::io(folder, "looking for the folder to write to", e))?;
    if meta.is_dir() {
        return Ok(());
    }
    Err(Error::io(folder, "looking for the folder to write to", io::ErrorKind::NotADirectory.into()))
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// A temporary file with the permissions that the user's umask gives to new files.
fn temporary_in(folder: &Path) -> io::Result<tempfile::NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(TEMPORARY);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_no_litter() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.bin");
        write_whole(&path, 3, |sink| sink.write_all(b"old").map_err(|e| Error::io("out", "writing", e)))
            .unwrap();
        let failure = write_whole(&path, 10, |sink| {
            sink.write_all(b"new").map_err(|e| Error::io("out", "writing", e))?;
            Err(Error::DiskFull { file: "out".into(), needed_bytes: 0 })
        });
        assert!(matches!(failure, Err(Error::DiskFull { needed_bytes: 7, .. })), "{failure:?}");
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_missing_folder_is_an_io_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("no/such/out.bin");
        assert_eq!(write_whole(&path, 0, |_| Ok(())).unwrap_err().exit_code(), 8);
        assert_eq!(check_folder(&path).unwrap_err().exit_code(), 8);
        assert!(check_folder(Path::new("out.bin")).is_ok());
    }
}
