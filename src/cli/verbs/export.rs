//! `glowtree export JOB -o out.{ply,glb}`

use crate::bake::{self, Job, Meter, Stage};
use crate::cli::arguments::Export;
use crate::cli::console::Console;
use crate::cli::values::{show_bytes, show_count};
use crate::cli::verbs::Written;
use crate::error::Result;
use crate::geometry::SurfacePoint;
use crate::output::file::check_folder;
use crate::output::{glb, ply};

/// Writes the light of the job per vertex.
///
/// # Errors
/// Those of opening the job, finding the light and writing the file.
pub fn run(request: &Export, console: &Console) -> Result<()> {
    let meter = Meter::start();
    check_folder(&request.output)?;
    let job = bake::open(&request.job)?;
    let is_glb = request.output.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("glb"));
    if !is_glb && !job.model().details.is_empty() {
        bake::pictures::write_streamed(&job, &request.output, console)?;
    } else {
        let stage = Stage::start(console, "mesh", "vertices", Some(job.scene().vertices.len() as u64));
        let evaluate = |points: &[SurfacePoint]| answer(&job, points);
        let advance = |vertices| stage.advance(vertices);
        if is_glb {
            note_proxies(&job, console);
            glb::export(&request.output, job.scene(), &evaluate, &advance)?;
        } else {
            ply::export(&request.output, job.scene(), &evaluate, &advance)?;
        }
        stage.finish();
        job.sound()?;
    }
    let written = Written::file(&request.output, &meter);
    console.result(&format!("{}: {}\n", written.output, show_bytes(written.written_bytes)))?;
    console.summary("export", &written)
}

/// Light at vertices; those of proxies lie beside the surface and are set onto it first.
fn answer(job: &Job, points: &[SurfacePoint]) -> Vec<crate::solve::Irradiance> {
    let model = job.model();
    if model.details.is_empty() {
        return job.evaluate(points);
    }
    let set: Vec<SurfacePoint> = points.iter().map(|point| model.around().footing(point).1).collect();
    model.field().evaluate_crowd(&set)
}

/// A viewer's file holds what memory holds.
fn note_proxies(job: &Job, console: &Console) {
    use crate::bake::Monitor as _;
    for (mesh, detail) in &job.model().details {
        let proxy = &job.scene().meshes[*mesh];
        let counts = [proxy.triangles.len() as u64, detail.triangles()].map(show_count);
        console.note(&format!(
            "{}: its proxy of {} triangles of {}; .ply has all",
            proxy.name, counts[0], counts[1]
        ));
    }
}
