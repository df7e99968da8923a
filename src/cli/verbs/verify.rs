//! `glowtree verify JOB`

use std::path::Path;

use serde::Serialize;

use crate::bake::verify::{self, Repaired, Report};
use crate::bake::{Meter, Usage};
use crate::cli::arguments::Verify;
use crate::cli::console::Console;
use crate::cli::values::{show_bytes, show_count};
use crate::error::{Error, Result};

/// What was found, and what was made anew.
#[derive(Debug, Serialize)]
struct Verified<'a> {
    job: String,
    #[serde(flatten)]
    report: &'a Report,
    /// None where nothing was damaged, or nobody asked.
    repaired: Option<&'a Repaired>,
    #[serde(flatten)]
    usage: Usage,
}

/// Examines a job, names all that is damaged, and makes it anew if asked.
///
/// # Errors
/// [`Error::DamagedJob`] after the summary when something is damaged and stays so; what the repair says.
pub fn run(request: &Verify, console: &Console) -> Result<()> {
    let meter = Meter::start();
    let job = &request.job;
    let report = verify::verify(job, console)?;
    for damage in &report.damages {
        console.result(&format!("{}/{damage}\n", job.display()))?;
    }
    for note in &report.notes {
        console.result(&format!("note: {note}\n"))?;
    }
    console.result(&counts(job, &report))?;
    let wanted = request.repair && !report.is_whole();
    let repaired = wanted.then(|| verify::repair(job, &report, console)).transpose();
    let made = repaired.as_ref().ok().and_then(Option::as_ref);
    if let Some(made) = made {
        console.result(&made_anew(job, made))?;
    }
    let name = job.display().to_string();
    console
        .summary("verify", Verified { job: name, report: &report, repaired: made, usage: meter.usage() })?;
    if repaired?.is_some() || report.is_whole() {
        return Ok(());
    }
    let problem = format!(
        "{} damaged; `glowtree verify {} --repair` makes them anew",
        plural(report.damages.len() as u64, "place"),
        job.display()
    );
    Err(Error::DamagedJob { job: job.clone(), problem })
}

fn counts(job: &Path, report: &Report) -> String {
    let verdict =
        if report.is_whole() { "whole".to_owned() } else { format!("{} damaged", report.damages.len()) };
    format!(
        "{}: {}, {}, {} examined: {verdict}\n",
        job.display(),
        plural(report.files, "file"),
        plural(report.blocks, "block"),
        show_bytes(report.examined_bytes),
    )
}

fn made_anew(job: &Path, repaired: &Repaired) -> String {
    let mut text = String::new();
    for file in &repaired.files {
        let blocks = if file.made_blocks + file.kept_blocks == 0 {
            String::new()
        } else {
            format!(", {} made, {} kept", plural(file.made_blocks, "block"), show_count(file.kept_blocks))
        };
        text += &format!("{}/{}: {}{blocks}\n", job.display(), file.file, file.by);
    }
    let blocks = plural(repaired.made_blocks(), "block");
    text + &format!(
        "{}: repaired: {}, {blocks} made anew\n",
        job.display(),
        plural(repaired.files.len() as u64, "file")
    )
}

fn plural(count: u64, noun: &str) -> String {
    format!("{} {noun}{}", show_count(count), if count == 1 { "" } else { "s" })
}
