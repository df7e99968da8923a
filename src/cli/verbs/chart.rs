//! `glowtree chart`

use std::path::Path;

use serde::Serialize;

use crate::bake::{Meter, Usage};
use crate::cli::arguments::Chart;
use crate::cli::console::{self, Console};
use crate::compare::stability::{self, Row, report};
use crate::error::{Error, Result};

/// Measures what is asked for.
pub fn run(request: &Chart, console: &Console) -> Result<()> {
    if !request.stability {
        return Err(Error::Usage("nothing to chart: give --stability".into()));
    }
    stability(request.output.as_deref(), console)
}

/// A row as a JSON line.
#[derive(Serialize)]
struct RowLine<'a> {
    r#type: &'static str,
    #[serde(flatten)]
    row: &'a Row,
}

/// The last line of the table.
#[derive(Serialize)]
struct Figures<'a> {
    rows: usize,
    failed: Vec<usize>,
    output: Option<&'a Path>,
    #[serde(flatten)]
    usage: Usage,
}

fn stability(folder: Option<&Path>, console: &Console) -> Result<()> {
    let meter = Meter::start();
    console.result(&report::head())?;
    let told = |row: &Row| {
        if console.json() {
            console::line(&RowLine { r#type: "row", row })
        } else {
            console.result(&report::text(row))
        }
    };
    let rows = stability::run(console, told)?;
    folder.map_or(Ok(()), |folder| report::write(&rows, folder))?;
    let failed: Vec<usize> = rows.iter().filter(|row| !row.holds).map(|row| row.number).collect();
    let numbers = failed.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
    console.summary("chart", Figures { rows: rows.len(), failed, output: folder, usage: meter.usage() })?;
    if numbers.is_empty() { Ok(()) } else { Err(Error::Unstable { rows: numbers }) }
}
