//! Where a verb's result goes, and the figures that say so.

use std::path::Path;

use serde::Serialize;

use crate::bake::{Meter, Usage};
use crate::cli::console::{self, Console, STANDARD_OUTPUT};
use crate::cli::values::{show_bytes, show_count, show_seconds};
use crate::error::{Error, Result};
use crate::output::file::check_folder;
use crate::output::points::{Column, PointTable};

/// A file, or standard output for `-` or nothing.
#[derive(Debug, Clone, Copy)]
pub struct Destination<'a> {
    file: Option<&'a Path>,
}

impl<'a> Destination<'a> {
    /// From the value of `-o`.
    ///
    /// # Errors
    /// [`Error::Usage`] when results and JSON lines would share standard output; [`Error::Io`] when the file's folder is
    /// not there.
    pub fn of(output: Option<&'a Path>, console: &Console) -> Result<Self> {
        let file = output.filter(|path| path.as_os_str() != "-");
        if file.is_none() && console.json() {
            return Err(Error::Usage("--json fills standard output: name a file with -o".into()));
        }
        file.map_or(Ok(()), check_folder)?;
        Ok(Self { file })
    }

    /// Writes a table of points with results.
    ///
    /// # Errors
    /// Input/output errors.
    pub fn table(&self, table: &PointTable, columns: &[Column]) -> Result<()> {
        let Some(path) = self.file else {
            let mut text = Vec::new();
            table.write_to(&mut text, columns).map_err(|e| Error::io(STANDARD_OUTPUT, "writing", e))?;
            return console::print(&text);
        };
        table.write(path, columns)
    }

    /// Says what was written: nothing more than that if the result itself went to standard output.
    ///
    /// # Errors
    /// As [`Console::result`].
    pub fn report(&self, verb: &str, written: &Written, console: &Console) -> Result<()> {
        if self.file.is_none() {
            return Ok(());
        }
        let points = written.points.map(|points| format!("{} points, ", show_count(points)));
        console.result(&format!(
            "{}: {}{}, {}\n",
            written.output,
            points.unwrap_or_default(),
            show_bytes(written.written_bytes),
            show_seconds(written.usage.seconds),
        ))?;
        console.summary(verb, written)
    }
}

/// The figures of a verb that wrote one result.
#[derive(Debug, Serialize)]
pub struct Written {
    /// The file.
    pub output: String,
    /// Its size.
    pub written_bytes: u64,
    /// Points answered, where the result is a table of them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub points: Option<u64>,
    /// What it took.
    #[serde(flatten)]
    pub usage: Usage,
}

impl Written {
    /// Of a file just written.
    pub fn file(path: &Path, meter: &Meter) -> Self {
        Self {
            output: path.display().to_string(),
            written_bytes: std::fs::metadata(path).map_or(0, |meta| meta.len()),
            points: None,
            usage: meter.usage(),
        }
    }

    /// Of a table of points just written.
    pub fn points(destination: &Destination<'_>, points: u64, meter: &Meter) -> Self {
        let path = destination.file.unwrap_or(Path::new(STANDARD_OUTPUT));
        Self { points: Some(points), ..Self::file(path, meter) }
    }
}
