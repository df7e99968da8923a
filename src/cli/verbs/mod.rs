//! One file per verb.

pub mod bake;
pub mod export;
pub mod inspect;
pub mod packaging;
pub mod render;

use serde::Serialize;

use crate::bake::{Meter, Usage};

/// The figures of a verb that wrote one file.
#[derive(Debug, Serialize)]
pub struct Written {
    /// The file.
    pub output: String,
    /// Its size.
    pub written_bytes: u64,
    /// What it took.
    #[serde(flatten)]
    pub usage: Usage,
}

impl Written {
    /// Of a file just written.
    pub fn of(path: &std::path::Path, meter: &Meter) -> Self {
        Self {
            output: path.display().to_string(),
            written_bytes: std::fs::metadata(path).map_or(0, |meta| meta.len()),
            usage: meter.usage(),
        }
    }
}
