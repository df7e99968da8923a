//! `glowtree inspect JOB`

use std::fmt::Write;
use std::path::Path;

use serde::Serialize;

use crate::bake::job::{self, Unfinished};
use crate::bake::store::{self, Purpose};
use crate::bake::{Stage, Summary};
use crate::cli::arguments::Inspect;
use crate::cli::console::Console;
use crate::cli::values::{show_bytes, show_count, show_seconds};
use crate::error::{Error, Result};
use crate::plot::job::{self as plots, Drawn};

/// The job's figures, and what was drawn of it.
#[derive(Debug, Serialize)]
struct Inspected<'a> {
    #[serde(flatten)]
    summary: &'a Summary,
    #[serde(skip_serializing_if = "Option::is_none")]
    changed: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    plots: Option<Vec<String>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    plotted_receivers: Option<Vec<u32>>,
}

/// Prints what the job's summary holds, and draws the job if asked.
pub fn run(request: &Inspect, console: &Console) -> Result<()> {
    if let Some(unfinished) = job::unfinished(&request.job)? {
        return tell_unfinished(request, &unfinished, console);
    }
    let summary = Summary::read(&request.job)?;
    let changed = job::standing(&request.job).unwrap_or_else(|error| Some(error.to_string()));
    let drawn = request.plot.as_ref().map(|folder| draw(request, folder, console)).transpose()?;
    console.result(&table(&summary))?;
    if let Some(changed) = &changed {
        console.result(&format!("{:<16} {changed}\n", "changed since"))?;
    }
    let plots: Option<Vec<String>> =
        drawn.as_ref().map(|d| d.files.iter().map(|f| f.display().to_string()).collect());
    for file in plots.iter().flatten() {
        console.result(&format!("{file}\n"))?;
    }
    let plotted_receivers = drawn.map(|d| d.receivers);
    console.summary("inspect", Inspected { summary: &summary, changed, plots, plotted_receivers })
}

/// Says how far an unfinished job came and how to go on.
fn tell_unfinished(request: &Inspect, unfinished: &Unfinished, console: &Console) -> Result<()> {
    if request.plot.is_some() {
        return Err(Error::NoJob { job: request.job.clone() });
    }
    let changed = job::standing(&request.job).unwrap_or_else(|error| Some(error.to_string()));
    console.result(&format!(
        "{}: not finished, --error {}, {} done in {}; the same bake goes on from there\n",
        request.job.display(),
        unfinished.options.error,
        show_bytes(unfinished.work_bytes),
        unfinished.ledgers.join(", "),
    ))?;
    if let Some(changed) = &changed {
        console.result(&format!("{:<16} {changed}\n", "changed since"))?;
    }
    console.summary("inspect", serde_json::json!({ "unfinished": unfinished, "changed": changed }))
}

/// Draws the job into a folder, which is made if it is not there.
fn draw(request: &Inspect, folder: &Path, console: &Console) -> Result<Drawn> {
    std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, "making the folder for plots", e))?;
    // Found out before work is done that could not be kept.
    tempfile::tempfile_in(folder).map_err(|e| Error::io(folder, "writing into the folder for plots", e))?;
    let model = store::read(&request.job, Purpose::Light)?;
    let stage = Stage::start(console, "plots", "pixels", None);
    let drawn = plots::write(&model.field(), request.receiver, folder, &|pixels| stage.advance(pixels))?;
    stage.finish();
    Ok(drawn)
}

fn table(summary: &Summary) -> String {
    let converged = if summary.converged { "converged" } else { "not converged" };
    let rows = [
        ("triangles", show_count(summary.triangles)),
        ("vertices", show_count(summary.vertices)),
        ("sites", show_count(summary.sites)),
        ("levels", summary.levels.to_string()),
        ("links", show_count(summary.links)),
        ("rays", show_count(summary.rays)),
        ("on disk", show_bytes(summary.archive_bytes)),
        ("bytes per link", format!("{:.2}", summary.bytes_per_link)),
        ("estimated error", format!("{:.2}%", 100.0 * summary.estimated_error)),
        (
            "solver",
            format!("{} iterations, residual {:.1e}, {converged}", summary.iterations, summary.residual),
        ),
        ("peak memory", show_bytes(summary.usage.peak_anonymous_bytes)),
        ("time", show_seconds(summary.usage.seconds)),
        ("CPU time", show_seconds(summary.usage.cpu_seconds)),
    ];
    let mut text = String::new();
    for (name, value) in rows {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "{name:<16} {value}");
    }
    for light in &summary.lights {
        let _ = writeln!(text, "  {:<14} {:.2}% of its own light", light.name, 100.0 * light.error);
    }
    for stage in &summary.stages {
        let (wall, cpu) = (show_seconds(stage.seconds), show_seconds(stage.cpu_seconds));
        let _ = writeln!(text, "  {:<14} {wall}, {cpu} of CPU", stage.name);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::StageTime;

    #[test]
    fn the_table_has_counts_and_stages() {
        let stage = StageTime { name: "links".into(), seconds: 61.0, cpu_seconds: 0.5 };
        let summary = Summary { sites: 12_345, stages: vec![stage], ..Summary::default() };
        let text = table(&summary);
        assert!(text.contains("sites            12 345\n"), "{text}");
        assert!(text.contains("  links          1 min 01 s, 0.50 s of CPU\n"), "{text}");
    }
}
