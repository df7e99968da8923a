//! `glowtree export JOB -o out.ply`

use std::path::Path;

use crate::bake::model::Model;
use crate::bake::{self, Meter, Stage};
use crate::cli::arguments::Export;
use crate::cli::console::Console;
use crate::cli::values::show_bytes;
use crate::cli::verbs::Written;
use crate::error::Result;
use crate::output::file::check_folder;
use crate::output::ply;

/// Writes the light of the job per vertex.
pub fn run(request: &Export, console: &Console) -> Result<()> {
    let meter = Meter::start();
    check_folder(&request.output)?;
    let job = bake::open(&request.job)?;
    if job.model().details.is_empty() {
        write(job.model(), &request.output, console)?;
    } else {
        bake::pictures::write_streamed(&job, &request.output, console)?;
    }
    let written = Written::file(&request.output, &meter);
    console.result(&format!("{}: {}\n", written.output, show_bytes(written.written_bytes)))?;
    console.summary("export", &written)
}

/// Writes the light of a scene that is in memory, per vertex.
///
/// # Errors
/// Those of [`ply::export`], and interruptions.
pub fn write(model: &Model, output: &Path, console: &Console) -> Result<()> {
    let (scene, field) = (&model.scene, model.field());
    let stage = Stage::start(console, "mesh", "vertices", Some(scene.vertices.len() as u64));
    let evaluate = |points: &[_]| field.evaluate(points);
    ply::export(output, scene, &evaluate, &|vertices| stage.advance(vertices))?;
    stage.finish();
    Ok(())
}
