//! The small JSON files of a job: written whole or not at all, each with a checksum of its own text.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::archive::{Digest, Storage};
use crate::error::{Error, Result};

/// What stands before the checksum's digits.
const HEAD: &str = "{\n  \"checksum\": \"";
/// Digits of the checksum.
const DIGITS: usize = 32;

/// Writes a value as JSON under its checksum: temporary name, sync, rename, sync of the directory.
///
/// # Errors
/// [`Error::Io`], [`Error::DiskFull`].
pub fn write(storage: &Arc<dyn Storage>, path: &Path, value: &impl Serialize) -> Result<()> {
    let text = sealed(value).map_err(|e| Error::io(path, "writing", e.into()))?;
    let failed = |source: io::Error| match Error::io(path, "writing", source) {
        Error::DiskFull { file, .. } => Error::DiskFull { file, needed_bytes: text.len() as u64 },
        error => error,
    };
    let mut partial = path.as_os_str().to_owned();
    partial.push(".partial");
    let partial = PathBuf::from(partial);
    let mut file = storage.create(&partial).map_err(failed)?;
    file.write_all(text.as_bytes()).and_then(|()| file.sync()).map_err(failed)?;
    drop(file);
    storage.rename(&partial, path).map_err(failed)?;
    storage.sync_directory(folder_of(path)).map_err(failed)
}

/// Makes an empty file whose name lasts.
///
/// # Errors
/// What the system says.
pub fn mark(storage: &Arc<dyn Storage>, path: &Path) -> io::Result<()> {
    storage.create(path)?.sync()?;
    sync_name(storage, path)
}

/// Makes a directory whose name lasts: those that hold it, and those that had to be made above it, are synced.
///
/// # Errors
/// What the system says.
pub fn make_directory(storage: &Arc<dyn Storage>, path: &Path) -> io::Result<()> {
    let named = |above: &&Path| !above.as_os_str().is_empty();
    let above = path.ancestors().take_while(named).skip(1);
    let made = above.take_while(|above| !above.exists()).count();
    storage.create_directory(path)?;
    path.ancestors().take_while(named).take(made + 1).try_for_each(|path| sync_name(storage, path))
}

/// Makes the name of something durable: syncs the directory that holds it.
///
/// # Errors
/// What the system says.
pub fn sync_name(storage: &Arc<dyn Storage>, path: &Path) -> io::Result<()> {
    match storage.sync_directory(folder_of(path)) {
        // A directory that may be written but not read cannot be synced. It is no reason to refuse work.
        Err(e) if e.kind() == io::ErrorKind::PermissionDenied => Ok(()),
        outcome => outcome,
    }
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Reads a value back; None where there is no such file.
///
/// # Errors
/// [`Error::Damaged`] when the checksum fails or the text is no such value; [`Error::Io`].
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<Option<T>> {
    let text = match fs::read(path) {
        Ok(text) => text,
        Err(e) if matches!(e.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) => {
            return Ok(None);
        }
        Err(e) => return Err(Error::io(path, "reading", e)),
    };
    let damaged = |place: String, problem: String| Error::Damaged { file: path.into(), place, problem };
    unseal(&text).map_err(|problem| damaged("checksum".into(), problem))?;
    serde_json::from_slice(&text).map(Some).map_err(|e| damaged(format!("line {}", e.line()), e.to_string()))
}

/// The text of a value that is an object, its checksum first.
fn sealed(value: &impl Serialize) -> serde_json::Result<String> {
    let body = serde_json::to_string_pretty(value)?;
    let fields = body.strip_prefix("{\n").unwrap_or("}");
    let text = |digits: &str| format!("{HEAD}{digits}\",\n{fields}\n");
    let digest = Digest::of_bytes(text(&"0".repeat(DIGITS)).as_bytes());
    Ok(text(&digest.to_string()))
}

/// Whether the text is what was written: its digest with zeros for the digits.
fn unseal(text: &[u8]) -> Result<(), String> {
    let end = HEAD.len() + DIGITS;
    if !text.starts_with(HEAD.as_bytes()) || text.len() < end {
        return Err("expected a checksum in the second line, got none".into());
    }
    let mut zeroed = text.to_vec();
    zeroed[HEAD.len()..end].fill(b'0');
    let expected = Digest::of_bytes(&zeroed).to_string();
    let got = &text[HEAD.len()..end];
    if expected.as_bytes() == got {
        return Ok(());
    }
    Err(format!("expected {expected}, got {}", got.escape_ascii()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::archive::Disk;

    #[derive(serde::Serialize, serde::Deserialize, PartialEq, Debug)]
    struct Value {
        error: f64,
        name: String,
    }

    #[test]
    fn every_flipped_bit_is_seen() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("value.json");
        assert!(read::<Value>(&path).unwrap().is_none());
        let value = Value { error: 0.1 + 0.2, name: "a\n\"b".into() };
        let storage: Arc<dyn Storage> = Arc::new(Disk);
        write(&storage, &path, &value).unwrap();
        assert_eq!(read::<Value>(&path).unwrap(), Some(value));
        let text = fs::read(&path).unwrap();
        for bit in 0..8 * text.len() {
            let mut flipped = text.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            assert!(unseal(&flipped).is_err(), "bit {bit}");
        }
        (0..text.len()).for_each(|end| assert!(unseal(&text[..end]).is_err(), "cut at {end}"));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
