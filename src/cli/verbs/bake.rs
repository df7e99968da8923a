//! `glowtree bake SCENE`

use std::path::{Path, PathBuf};

use crate::bake::{self, Options};
use crate::cli::arguments::Bake;
use crate::cli::console::Console;
use crate::cli::values::{show_bytes, show_seconds};
use crate::error::{Error, Result};

/// Bakes, or resumes, or says that nothing is left to do.
///
/// # Errors
/// What the bake says; [`Error::NotConverged`] after the summary when the solver stopped at its limit.
pub fn run(request: &Bake, console: &Console) -> Result<()> {
    let job = match &request.output {
        Some(job) => job.clone(),
        None => default_job(&request.scene)?,
    };
    let options = Options {
        error: request.error,
        max_bounces: request.max_bounces,
        seed: request.seed,
        basis: request.basis,
        operator: request.operator,
        resident: request.resident,
        proxy: request.proxy,
        relightable: request.relightable,
        max_memory_bytes: request.max_memory,
        restart: request.restart,
        preview: !request.no_preview,
    };
    if request.dry_run {
        return foretell((&request.scene, &job), &options, console);
    }
    let summary = bake::run(&request.scene, &job, &options, console)?;
    let report = if summary.computed_blocks == 0 && summary.resumed_blocks > 0 {
        format!("{}: nothing left to do\n", job.display())
    } else {
        format!(
            "{}: baked in {} ({} of CPU), {} of memory, {} on disk, estimated error {:.2}%\n",
            job.display(),
            show_seconds(summary.usage.seconds),
            show_seconds(summary.usage.cpu_seconds),
            show_bytes(summary.usage.peak_anonymous_bytes),
            show_bytes(summary.archive_bytes),
            100.0 * summary.estimated_error,
        )
    };
    console.result(&report)?;
    console.summary("bake", &summary)?;
    if summary.converged {
        Ok(())
    } else {
        Err(Error::NotConverged { iterations: summary.iterations as usize, residual: summary.residual })
    }
}

/// Says what the bake would take; refuses like the bake itself would, but early.
fn foretell((scene, job): (&Path, &Path), options: &Options, console: &Console) -> Result<()> {
    let forecast = bake::forecast(scene, job, options, console)?;
    let mut text = format!(
        "{}: about {} ({} of CPU), {} of memory, {} on disk ({} free); {} triangles\n",
        job.display(),
        show_seconds(forecast.seconds),
        show_seconds(forecast.cpu_seconds),
        show_bytes(forecast.peak_anonymous_bytes),
        show_bytes(forecast.disk_bytes),
        show_bytes(forecast.free_bytes),
        forecast.triangles,
    );
    for stage in &forecast.stages {
        let figures = [
            show_seconds(stage.seconds),
            show_bytes(stage.peak_anonymous_bytes),
            show_bytes(stage.disk_bytes),
        ];
        let [seconds, memory, disk] = figures;
        text += &format!("  {:<12} {seconds:>10} {memory:>12} of memory {disk:>12} on disk\n", stage.name);
    }
    forecast.check(job, options.max_memory_bytes)?;
    console.result(&text)?;
    console.summary("bake", Foretold { dry_run: true, forecast: &forecast })
}

/// A forecast, told from the summary of a bake.
#[derive(serde::Serialize)]
struct Foretold<'a> {
    dry_run: bool,
    #[serde(flatten)]
    forecast: &'a bake::Forecast,
}

/// `<scene>.glow` in the working directory.
fn default_job(scene: &Path) -> Result<PathBuf> {
    let stem =
        scene.file_stem().ok_or_else(|| Error::Usage(format!("{}: not a file name", scene.display())))?;
    let mut name = stem.to_os_string();
    name.push(".glow");
    Ok(PathBuf::from(name))
}
