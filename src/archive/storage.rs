//! The seam between a job and the disk: all that changes files goes through it. Production uses [`Disk`]; tests put
//! storages behind it that fail, fill up, kill the process or lose power.

use std::fmt::Debug;
use std::fs::{File, OpenOptions};
use std::io::{self, Read, Seek, Write};
use std::path::Path;

/// Where files are created, renamed and made durable.
pub trait Storage: Debug + Send + Sync {
    /// Creates a file for reading and writing, empty if it existed.
    ///
    /// # Errors
    /// What the system says.
    fn create(&self, path: &Path) -> io::Result<Box<dyn StoredFile>>;
    /// Opens an existing file for reading and writing.
    ///
    /// # Errors
    /// What the system says; `NotFound` when there is none.
    fn open(&self, path: &Path) -> io::Result<Box<dyn StoredFile>>;
    /// Renames a file, replacing the target atomically.
    ///
    /// # Errors
    /// What the system says.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()>;
    /// Removes a file.
    ///
    /// # Errors
    /// What the system says.
    fn remove(&self, path: &Path) -> io::Result<()>;
    /// Makes a directory and those above it that are missing.
    ///
    /// # Errors
    /// What the system says.
    fn create_directory(&self, path: &Path) -> io::Result<()>;
    /// Removes a directory with all that is in it.
    ///
    /// # Errors
    /// What the system says.
    fn remove_directory(&self, path: &Path) -> io::Result<()>;
    /// Makes two existing files or directories change names, atomically where the system can.
    ///
    /// # Errors
    /// What the system says.
    fn exchange(&self, one: &Path, other: &Path) -> io::Result<()>;
    /// Makes the names in a directory durable.
    ///
    /// # Errors
    /// What the system says.
    fn sync_directory(&self, directory: &Path) -> io::Result<()>;
}

/// An open file of a [`Storage`].
pub trait StoredFile: Debug + Send + Read + Write + Seek {
    /// Makes the contents durable.
    ///
    /// # Errors
    /// What the system says; afterwards nothing written since the last success may be trusted.
    fn sync(&mut self) -> io::Result<()>;
    /// Cuts (or extends) the file to a length.
    ///
    /// # Errors
    /// What the system says.
    fn truncate(&mut self, bytes: u64) -> io::Result<()>;
    /// Reserves disk space up to `end` without changing the length; storages that cannot do it do nothing.
    ///
    /// # Errors
    /// What the system says, `StorageFull` above all.
    fn reserve(&mut self, end: u64) -> io::Result<()>;
}

/// The file system.
#[derive(Clone, Copy, Debug, Default)]
pub struct Disk;

impl Storage for Disk {
    fn create(&self, path: &Path) -> io::Result<Box<dyn StoredFile>> {
        Ok(Box::new(OpenOptions::new().read(true).write(true).create(true).truncate(true).open(path)?))
    }

    fn open(&self, path: &Path) -> io::Result<Box<dyn StoredFile>> {
        Ok(Box::new(OpenOptions::new().read(true).write(true).open(path)?))
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        std::fs::rename(from, to)
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        std::fs::remove_file(path)
    }

    fn create_directory(&self, path: &Path) -> io::Result<()> {
        std::fs::create_dir_all(path)
    }

    fn remove_directory(&self, path: &Path) -> io::Result<()> {
        std::fs::remove_dir_all(path)
    }

    fn exchange(&self, one: &Path, other: &Path) -> io::Result<()> {
        #[cfg(target_os = "linux")]
        {
            use rustix::fs::{CWD, RenameFlags, renameat_with};
            use rustix::io::Errno;
            match renameat_with(CWD, one, CWD, other, RenameFlags::EXCHANGE) {
                // File systems that cannot do it, such as some mounted over a network.
                Err(Errno::INVAL | Errno::NOSYS | Errno::OPNOTSUPP) => {}
                outcome => return outcome.map_err(io::Error::from),
            }
        }
        let mut aside = one.as_os_str().to_owned();
        aside.push(".old");
        std::fs::rename(one, &aside)?;
        std::fs::rename(other, one)?;
        std::fs::rename(aside, other)
    }

    fn sync_directory(&self, directory: &Path) -> io::Result<()> {
        File::open(directory)?.sync_all()
    }
}

impl StoredFile for File {
    fn sync(&mut self) -> io::Result<()> {
        self.sync_all()
    }

    fn truncate(&mut self, bytes: u64) -> io::Result<()> {
        self.set_len(bytes)
    }

    #[cfg(target_os = "linux")]
    fn reserve(&mut self, end: u64) -> io::Result<()> {
        use rustix::fs::{FallocateFlags, fallocate};
        use rustix::io::{Errno, retry_on_intr};
        // KEEP_SIZE: a resume must see how far the writing came, not how far the reservation did.
        match retry_on_intr(|| fallocate(&*self, FallocateFlags::KEEP_SIZE, 0, end.max(1))) {
            Err(Errno::OPNOTSUPP | Errno::NOSYS) => Ok(()),
            outcome => outcome.map_err(io::Error::from),
        }
    }

    #[cfg(not(target_os = "linux"))]
    fn reserve(&mut self, _end: u64) -> io::Result<()> {
        Ok(())
    }
}
