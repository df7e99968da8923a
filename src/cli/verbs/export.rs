//! `glowtree export JOB -o out.ply`

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
        let stage = Stage::start(console, "mesh", "vertices", Some(job.scene().vertices.len() as u64));
        let evaluate = |points: &[_]| job.evaluate_crowd(points);
        ply::export(&request.output, job.scene(), &evaluate, &|vertices| stage.advance(vertices))?;
        stage.finish();
    } else {
        bake::pictures::write_streamed(&job, &request.output, console)?;
    }
    let written = Written::file(&request.output, &meter);
    console.result(&format!("{}: {}\n", written.output, show_bytes(written.written_bytes)))?;
    console.summary("export", &written)
}
