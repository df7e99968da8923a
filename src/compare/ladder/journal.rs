//! The journal: a line of JSON for each finished measurement, appended and synced, so that none is made twice.

use std::fs::{self, File, OpenOptions};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use super::{Key, Measurement};
use crate::bake::Monitor;
use crate::error::{Error, Result};

/// The journal's name in the folder of a chart.
pub const JOURNAL_FILE: &str = "measured.jsonl";

/// What is measured so far.
pub struct Journal {
    path: PathBuf,
    file: File,
    known: Vec<Measurement>,
}

impl Journal {
    /// Opens the journal, or begins it. Lines that do not read, as a run that was cut short leaves behind, are told of and
    /// left where they are; what they held is measured again.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn open(path: &Path, monitor: &dyn Monitor) -> Result<Self> {
        let text = match fs::read(path) {
            Ok(bytes) => String::from_utf8_lossy(&bytes).into_owned(),
            Err(e) if e.kind() == ErrorKind::NotFound => String::new(),
            Err(e) => return Err(Error::io(path, "reading", e)),
        };
        let lines = text.lines().filter(|line| !line.is_empty());
        let (known, damaged): (Vec<_>, Vec<_>) = lines.map(serde_json::from_str).partition(Result::is_ok);
        if !damaged.is_empty() {
            monitor.warn(&format!("{}: {} lines do not read; measured again", path.display(), damaged.len()));
        }
        let known = known.into_iter().flatten().collect();
        let mut file = OpenOptions::new()
            .create(true)
            .append(true)
            .open(path)
            .map_err(|e| Error::io(path, "opening", e))?;
        if !text.is_empty() && !text.ends_with('\n') {
            file.write_all(b"\n").map_err(|e| Error::io(path, "appending", e))?;
        }
        Ok(Self { path: path.to_path_buf(), file, known })
    }

    /// The measurement that is known by a key.
    pub fn find(&self, key: &Key) -> Option<&Measurement> {
        self.known.iter().find(|m| m.key == *key)
    }

    /// Adds a measurement; it is on the disk when this returns. Returns it as it will be read back, the last digit of a
    /// number included.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::DiskFull`].
    pub fn append(&mut self, made: &Measurement) -> Result<Measurement> {
        let failed = |e| Error::io(&self.path, "appending", e);
        let mut line = serde_json::to_vec(made).map_err(|e| failed(e.into()))?;
        let kept: Measurement = serde_json::from_slice(&line).map_err(|e| failed(e.into()))?;
        line.push(b'\n');
        self.file.write_all(&line).and_then(|()| self.file.sync_all()).map_err(failed)?;
        self.known.push(kept.clone());
        Ok(kept)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::Silent;
    use crate::compare::ladder::Method;

    fn made(target: f64) -> Measurement {
        let method = Method::Paths;
        let key = Key { program: "1".into(), digest: "d".into(), method, target, seed: 0, threads: 2 };
        Measurement {
            cpu_seconds: 0.1 + 0.2,
            true_error: 1.0 / 3.0,
            residuals: vec![0.1, 1e-7],
            ..Measurement::blank(key, "s", 10)
        }
    }

    #[test]
    fn what_is_appended_is_found_again_and_cut_lines_are_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(JOURNAL_FILE);
        let (first, second) = (made(16.0), made(64.0));
        Journal::open(&path, &Silent).unwrap().append(&first).unwrap();
        let whole = fs::read(&path).unwrap();
        Journal::open(&path, &Silent).unwrap().append(&second).unwrap();
        let journal = Journal::open(&path, &Silent).unwrap();
        assert_eq!((journal.find(&first.key), journal.find(&second.key)), (Some(&first), Some(&second)));
        let both = fs::read(&path).unwrap();
        for cut in whole.len()..both.len() - 1 {
            fs::write(&path, &both[..cut]).unwrap();
            let mut journal = Journal::open(&path, &Silent).unwrap();
            assert!(
                journal.find(&first.key).is_some() && journal.find(&second.key).is_none(),
                "cut at {cut}"
            );
            journal.append(&second).unwrap();
            assert!(Journal::open(&path, &Silent).unwrap().find(&second.key).is_some(), "cut at {cut}");
        }
        let other = Key { seed: 1, ..first.key };
        assert!(journal.find(&other).is_none());
    }
}
