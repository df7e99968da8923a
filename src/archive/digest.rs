//! Digests of whatever a file was made from: xxh3-128, for telling things apart, not for security.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use serde::Serialize;
use xxhash_rust::xxh3::{Xxh3, xxh3_128};

use crate::{Error, Result};

/// Bytes read at a time when a file is digested: large enough that the hash, not the system call, is the cost.
const STREAM_BYTES: usize = 1 << 20;

/// An xxh3-128 digest; displayed as 32 hexadecimal digits.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Digest(pub [u8; 16]);

impl Digest {
    /// The digest of bytes in memory.
    pub fn of_bytes(bytes: &[u8]) -> Self {
        Self(xxh3_128(bytes).to_le_bytes())
    }

    /// The digest of a file's bytes, read in pieces of 1 MiB.
    ///
    /// # Errors
    /// [`Error::Io`] when the file cannot be read.
    pub fn of_file(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let mut file = File::open(path).map_err(|source| Error::io(path, "opening", source))?;
        let mut hash = Xxh3::new();
        let mut piece = vec![0; STREAM_BYTES];
        loop {
            match file.read(&mut piece) {
                Ok(0) => return Ok(Self(hash.digest128().to_le_bytes())),
                Ok(count) => hash.update(&piece[..count]),
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                Err(source) => return Err(Error::io(path, "reading", source)),
            }
        }
    }

    /// The digest of options, through their JSON with sorted keys: the order of fields and of maps does not
    /// matter, names and values do. JSON has no infinities and no NaN: all of them count as `null`.
    ///
    /// # Errors
    /// [`Error::Usage`] when the options cannot be written as JSON (maps whose keys are not strings).
    pub fn of_options(options: &impl Serialize) -> Result<Self> {
        let value = serde_json::to_value(options)
            .map_err(|error| Error::Usage(format!("options that cannot be recorded: {error}")))?;
        let mut text = String::new();
        write_sorted(&value, &mut text);
        Ok(Self::of_bytes(text.as_bytes()))
    }

    /// One digest of several, in this order.
    pub fn of_digests(digests: &[Self]) -> Self {
        let mut hash = Xxh3::new();
        for digest in digests {
            hash.update(&digest.0);
        }
        Self(hash.digest128().to_le_bytes())
    }
}

/// JSON with keys in byte order, whichever map serde_json was built with.
fn write_sorted(value: &serde_json::Value, text: &mut String) {
    use serde_json::Value;
    match value {
        Value::Object(fields) => {
            let mut fields: Vec<_> = fields.iter().collect();
            fields.sort_by_key(|(name, _)| *name);
            text.push('{');
            for (name, field) in fields {
                text.push_str(&Value::from(name.as_str()).to_string());
                text.push(':');
                write_sorted(field, text);
                text.push(',');
            }
            text.push('}');
        }
        Value::Array(entries) => {
            text.push('[');
            for entry in entries {
                write_sorted(entry, text);
                text.push(',');
            }
            text.push(']');
        }
        leaf => text.push_str(&leaf.to_string()),
    }
}

impl std::fmt::Display for Digest {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{:032x}", u128::from_le_bytes(self.0))
    }
}

impl std::fmt::Debug for Digest {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "Digest({self})")
    }
}
