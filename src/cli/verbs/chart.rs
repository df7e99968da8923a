//! `glowtree chart`

use std::fmt::Write;
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::bake::{Meter, Usage};
use crate::cli::arguments::Chart;
use crate::cli::console::{self, Console};
use crate::compare::figure3;
use crate::compare::ladder::{self, Report, Request};
use crate::compare::stability::{self, Row, report};
use crate::error::{Error, Result};

/// Measures what is asked for.
pub fn run(request: &Chart, console: &Console) -> Result<()> {
    match (&request.output, request.stability) {
        (folder, true) => stability(folder.as_deref(), console),
        (Some(folder), false) if request.figure3 => figure(folder, console),
        (Some(folder), false) => ladder(request, folder, console),
        (None, false) => Err(Error::Usage("name a folder with -o".into())),
    }
}

/// The last line of a chart or a figure.
#[derive(Serialize)]
struct Charted<'a> {
    output: &'a Path,
    #[serde(flatten)]
    report: Report,
    #[serde(flatten)]
    usage: Usage,
}

fn ladder(request: &Chart, folder: &Path, console: &Console) -> Result<()> {
    let meter = Meter::start();
    let mut paths = request.spp.clone();
    paths.retain(|&n| n > 0);
    let asked = Request {
        scenes: request.scenes.clone(),
        folder: folder.to_path_buf(),
        errors: unique(&request.errors),
        bases: unique(&request.basis),
        paths: unique(&paths),
        reference_paths: request.reference_spp,
        seed: request.seed,
    };
    let report = ladder::run(&asked, console)?;
    console.result(&told(&report, folder))?;
    console.summary("chart", Charted { output: folder, report, usage: meter.usage() })
}

/// The first of each.
fn unique<T: PartialEq + Clone>(values: &[T]) -> Vec<T> {
    let mut seen: Vec<T> = Vec::new();
    for value in values {
        if !seen.contains(value) {
            seen.push(value.clone());
        }
    }
    seen
}

fn told(report: &Report, folder: &Path) -> String {
    let (all, new) = (report.measurements, report.measured);
    let mut text = format!("{}: {all} measurements, {new} of them new\n", folder.display());
    // Writing to a String cannot fail.
    for slope in &report.slopes {
        let _ = writeln!(text, "{}, {}: error ~ CPU time^{:.2}", slope.scene, slope.method, slope.exponent);
    }
    for rise in &report.risen {
        let target = |t: f64| if t < 1.0 { format!("{} %", 100.0 * t) } else { format!("{t} paths") };
        let _ = writeln!(
            text,
            "not monotone: {}, {}: from {} to {} the true error rises from {:.3} % to {:.3} %",
            rise.scene,
            rise.method,
            target(rise.from[0]),
            target(rise.to[0]),
            100.0 * rise.from[1],
            100.0 * rise.to[1],
        );
    }
    text
}

fn figure(folder: &Path, console: &Console) -> Result<()> {
    let meter = Meter::start();
    let files: Vec<PathBuf> = figure3::write(folder, console)?;
    for file in &files {
        console.result(&format!("{}\n", file.display()))?;
    }
    let report = Report { files, ..Report::default() };
    console.summary("chart", Charted { output: folder, report, usage: meter.usage() })
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
