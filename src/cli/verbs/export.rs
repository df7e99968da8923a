//! `glowtree export JOB -o out.{ply,glb,html}`

use crate::bake::{self, Job, Meter, Stage};
use crate::cli::arguments::Export;
use crate::cli::console::Console;
use crate::cli::values::{show_bytes, show_count};
use crate::cli::verbs::Written;
use crate::error::Result;
use crate::geometry::SurfacePoint;
use crate::output::file::check_folder;
use crate::output::picture::{Quality, View, render};
use crate::output::viewer::{self, Lit, Picture, ViewMesh};
use crate::output::{glb, ply};

/// Writes the light of the job per vertex.
///
/// # Errors
/// Those of opening the job, finding the light and writing the file.
pub fn run(request: &Export, console: &Console) -> Result<()> {
    let meter = Meter::start();
    check_folder(&request.output)?;
    let job = bake::open(&request.job)?;
    let ends =
        |with: &str| request.output.extension().is_some_and(|ending| ending.eq_ignore_ascii_case(with));
    let is_glb = ends("glb");
    if ends("html") {
        note_proxies(&job, console);
        view(&job, request, console)?;
    } else if !is_glb && !job.model().details.is_empty() {
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

/// The view that a page begins with, when the scene has no camera.
const VIEW_SIZE: [u32; 2] = [1200, 800];

/// The page begins with the exposure of a picture that many times smaller.
const SMALLER: u32 = 8;

/// Writes the page that one looks at in a browser.
fn view(job: &Job, request: &Export, console: &Console) -> Result<()> {
    let scene = job.scene();
    let mesh = ViewMesh::new(scene, viewer::VERTICES);
    let stage = Stage::start(console, "mesh", "vertices", Some(mesh.points.len() as u64));
    let lit = lights(job, &mesh.asked, &stage)?;
    let view = View::choose(scene, job.bvh(), None, VIEW_SIZE)?;
    let mut small = view.clone();
    small.camera.size = view.camera.size.map(|pixels| pixels.div_ceil(SMALLER));
    let evaluate = |points: &[SurfacePoint]| job.evaluate(points);
    let film = render(scene, job.bvh(), &evaluate, (&small, Quality::PREVIEW), &|_| Ok(()))?;
    let mut picture = Picture {
        title: title(job),
        scene,
        mesh,
        lit,
        dots: viewer::dots(&job.model().sites),
        view,
        exposure: film.exposure(),
        level: job.model().solution.level,
    };
    picture.drop_dark_backs();
    viewer::write(&request.output, &picture)?;
    stage.finish();
    job.sound()
}

/// The lights of a job at the vertices of a page: what its sliders weigh.
fn lights(job: &Job, points: &[SurfacePoint], stage: &Stage<'_>) -> Result<Lit> {
    Lit::together(job.scene(), points, &|points| answer(job, points), &|vertices| stage.advance(vertices))
}

/// The name of the job's folder without its ending.
fn title(job: &Job) -> String {
    let stem = job.directory().file_stem();
    stem.map_or_else(|| "glowtree".into(), |stem| crate::error::one_line(&stem.to_string_lossy(), 80))
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
