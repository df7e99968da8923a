//! One process per job: a lock that the system gives back when its holder dies, with the holder's name in it.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::bake::report::progress::Monitor;
use crate::error::{Error, Result};

/// The file within the job directory that is locked.
pub const LOCK_FILE: &str = "lock";

/// A job that no other process works on, until dropped.
#[derive(Debug)]
pub struct Lock {
    /// Locked for as long as it is open.
    _file: File,
    path: PathBuf,
}

impl Lock {
    /// Locks the job; a holder that died is named and followed.
    ///
    /// # Errors
    /// [`Error::JobLocked`] with the holder; [`Error::Io`].
    pub fn take(job: &Path, monitor: &dyn Monitor) -> Result<Self> {
        let path = job.join(LOCK_FILE);
        let failed = |source| Error::io(&path, "locking the job", source);
        loop {
            let mut options = OpenOptions::new();
            let mut file =
                options.read(true).write(true).create(true).truncate(false).open(&path).map_err(failed)?;
            let free = match file.try_lock() {
                Ok(()) => true,
                Err(TryLockError::WouldBlock) => false,
                // Some file systems know no locks: the holder's number must do.
                Err(TryLockError::Error(_)) => !lives(&holder(&mut file)),
            };
            if !free {
                return Err(Error::JobLocked { job: job.into(), holder: named(&patient_holder(&mut file)) });
            }
            // The holder before may have removed the file that was opened here.
            if !is_at(&file, &path) {
                continue;
            }
            let before = holder(&mut file);
            if !before.is_empty() {
                monitor.note(&format!("{before} worked on {} and is gone: taking over", job.display()));
            }
            let text = format!("{}\n", own_name());
            file.set_len(0)
                .and_then(|()| file.rewind())
                .and_then(|()| file.write_all(text.as_bytes()))
                .map_err(failed)?;
            return Ok(Self { _file: file, path });
        }
    }

    /// The lock of a job that has changed its name since.
    pub fn moved(&mut self, job: &Path) {
        self.path = job.join(LOCK_FILE);
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // Removed while locked, so that nobody else's lock is. What cannot be removed is taken over.
        let _ = fs::remove_file(&self.path);
    }
}

/// Who holds or held the lock; empty when nobody said so.
fn holder(file: &mut File) -> String {
    let mut text = Vec::new();
    let read = file.rewind().and_then(|()| file.take(256).read_to_end(&mut text));
    if read.is_err() { String::new() } else { String::from_utf8_lossy(&text).trim().to_owned() }
}

/// Who holds the lock, who may be about to write it down: that takes microseconds, unless the machine is busy.
fn patient_holder(file: &mut File) -> String {
    for _ in 0..100 {
        let name = holder(file);
        if !name.is_empty() {
            return name;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    String::new()
}

fn named(holder: &str) -> String {
    if holder.is_empty() { "another process".into() } else { holder.into() }
}

fn own_name() -> String {
    format!("process {} on {}", std::process::id(), host())
}

#[cfg(unix)]
fn host() -> String {
    rustix::system::uname().nodename().to_string_lossy().into_owned()
}

#[cfg(not(unix))]
fn host() -> String {
    std::env::var("COMPUTERNAME").unwrap_or_else(|_| "this computer".into())
}

/// Whether a holder on this host is still there; one on another host counts as living.
fn lives(holder: &str) -> bool {
    let Some((process, place)) = holder.strip_prefix("process ").and_then(|rest| rest.split_once(" on "))
    else {
        return false;
    };
    place != host() || Path::new("/proc").join(process).exists()
}

#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let same = |(a, b): (fs::Metadata, fs::Metadata)| (a.dev(), a.ino()) == (b.dev(), b.ino());
    file.metadata().ok().zip(fs::metadata(path).ok()).is_some_and(same)
}

#[cfg(not(unix))]
fn is_at(_: &File, path: &Path) -> bool {
    path.exists()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::report::progress::Silent;

    #[test]
    fn a_second_lock_is_refused_with_the_holder_until_the_first_is_dropped() {
        let job = tempfile::tempdir().unwrap();
        let first = Lock::take(job.path(), &Silent).unwrap();
        let refused = Lock::take(job.path(), &Silent).unwrap_err();
        assert_eq!(refused.exit_code(), 11);
        assert!(refused.to_string().contains(&own_name()), "{refused}");
        drop(first);
        assert!(!job.path().join(LOCK_FILE).exists());
        assert!(Lock::take(job.path(), &Silent).is_ok());
    }

    #[test]
    fn a_holder_that_has_not_yet_written_its_name_is_waited_for() {
        let job = tempfile::tempdir().unwrap();
        let mut file = File::create(job.path().join(LOCK_FILE)).unwrap();
        file.try_lock().unwrap();
        let refused = std::thread::scope(|scope| {
            let refused = scope.spawn(|| Lock::take(job.path(), &Silent).unwrap_err());
            std::thread::sleep(Duration::from_millis(20));
            file.write_all(b"process 7 on a-host\n").unwrap();
            refused.join().unwrap()
        });
        assert!(refused.to_string().contains("process 7 on a-host"), "{refused}");
    }

    #[test]
    fn the_living_are_told_from_the_dead() {
        assert!(lives(&own_name()));
        assert!(!lives(&format!("process 4194999 on {}", host())) && !lives(""));
        assert!(lives("process 1 on a-host-elsewhere"));
    }
}
