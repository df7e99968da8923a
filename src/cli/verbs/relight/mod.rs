//! `glowtree relight JOB --set NAME.radiance=R,G,B -o out.ply`

mod animate;

use std::path::Path;

use serde::Serialize;

use super::films::is_png;
use super::points::probe::answers;
use super::{Destination, Written, export, render};
use crate::bake::{Meter, Monitor, RelightReport, Relighter, Stage, Stopwatch};
use crate::cli::arguments::Relight;
use crate::cli::console::Console;
use crate::cli::values::{show_bytes, show_seconds};
use crate::error::{Error, Result};
use crate::output::file::check_folder;
use crate::output::points::PointTable;

/// The figures of relighting.
#[derive(Debug, Serialize)]
struct Relit {
    #[serde(flatten)]
    written: Written,
    /// Reading the job.
    open_seconds: f64,
    /// Finding the sites' light.
    relight_seconds: f64,
    iterations: usize,
    residual: f64,
    converged: bool,
    /// Traced to lamps that are new, moved or were black.
    rays: u64,
}

/// What is wanted of the light.
enum Wanted<'a> {
    Points(PointTable, Destination<'a>),
    Mesh(&'a Path),
    Image(&'a Path),
}

/// Finds the light anew with the operator that the job holds, and answers.
pub fn run(request: &Relight, console: &Console) -> Result<()> {
    if let Some(keys) = &request.animate {
        return animate::run(request, keys, console);
    }
    let (meter, watch) = (Meter::start(), Stopwatch::start());
    let wanted = wanted(request, console)?;
    let mut relighter = Relighter::open(&request.job)?;
    let mut lighting = relighter.baked().clone();
    for text in &request.set {
        lighting.set(relighter.scene(), text)?;
    }
    if let (Some(order), Some(sky)) = (request.harmonics, &mut lighting.sky) {
        sky.harmonics = Some(usize::from(order));
    }
    let open_seconds = watch.seconds();
    let stage = Stage::start(console, "solve", "iterations", None);
    let report = relighter.relight_with(&lighting, &|| console.check())?;
    stage.advance(report.iterations as u64)?;
    stage.finish();
    let relight_seconds = watch.seconds() - open_seconds;
    report.warnings.iter().for_each(|warning| console.warn(warning));
    let RelightReport { iterations, residual, converged, rays, .. } = report;
    if !converged {
        return Err(Error::NotConverged { residual, iterations });
    }
    let written = answer(&mut relighter, (request, &wanted), &meter, console)?;
    let relit = Relit { written, open_seconds, relight_seconds, iterations, residual, converged, rays };
    if matches!(wanted, Wanted::Points(..)) && relit.written.output == crate::cli::console::STANDARD_OUTPUT {
        return Ok(());
    }
    console.result(&format!(
        "{}: {}, relit in {} after {} for reading\n",
        relit.written.output,
        show_bytes(relit.written.written_bytes),
        show_seconds(relight_seconds),
        show_seconds(open_seconds),
    ))?;
    console.summary("relight", &relit)
}

/// What the request wants, once it makes sense.
fn wanted<'a>(request: &'a Relight, console: &Console) -> Result<Wanted<'a>> {
    if let Some(points) = &request.points {
        let destination = Destination::of(request.output.as_deref(), console)?;
        return Ok(Wanted::Points(PointTable::read(points)?, destination));
    }
    let output = request.output.as_deref().unwrap_or(Path::new(""));
    let ending = output.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
    let wanted = match ending.as_deref() {
        Some("ply" | "glb") => Wanted::Mesh(output),
        Some("png" | "exr") => Wanted::Image(output),
        Some("csv") => {
            return Err(Error::Usage("-o .csv is a table of points: give them with --points in.csv".into()));
        }
        _ => {
            return Err(Error::Usage(format!(
                "{}: expected a name in .ply, .glb, .png, .exr or .csv",
                output.display()
            )));
        }
    };
    check_folder(output)?;
    Ok(wanted)
}

/// Writes what is wanted.
fn answer(
    relighter: &mut Relighter,
    (request, wanted): (&Relight, &Wanted<'_>),
    meter: &Meter,
    console: &Console,
) -> Result<Written> {
    match wanted {
        Wanted::Points(table, destination) => {
            let columns = answers(relighter.model(), table, console)?;
            destination.table(table, &columns)?;
            return Ok(Written::points(destination, table.len() as u64, meter));
        }
        Wanted::Mesh(output) => export::write((&request.job, relighter.model()), output, console)?,
        Wanted::Image(output) => {
            let camera = request.camera.as_deref();
            if is_png(output) {
                render::shoot(relighter.model(), camera, output, console)?;
            } else {
                render::apart(relighter, camera, output, console)?;
            }
        }
    }
    let (Wanted::Mesh(output) | Wanted::Image(output)) = wanted else { unreachable!("points return above") };
    Ok(Written::file(output, meter))
}
