//! `glowtree export JOB -o out.{ply,glb,html}`

use std::path::Path;

use crate::bake::model::Model;
use crate::bake::{self, Meter, Monitor as _, Relighter, Stage};
use crate::cli::arguments::Export;
use crate::cli::console::Console;
use crate::cli::values::{show_bytes, show_count};
use crate::cli::verbs::{Written, page};
use crate::error::{Error, Result};
use crate::geometry::SurfacePoint;
use crate::output::file::check_folder;
use crate::output::transfers::VertexTransfers;
use crate::output::vertices::VertexField;
use crate::output::{glb, ply};

/// Writes the light of the job per vertex.
///
/// # Errors
/// Those of opening the job, finding the light and writing the file.
pub fn run(request: &Export, console: &Console) -> Result<()> {
    let meter = Meter::start();
    check_folder(&request.output)?;
    if let Some(order) = request.transfer {
        write_transfers((&request.job, usize::from(order)), &request.output, console)?;
        return report(&request.output, &meter, console);
    }
    if has_ending(&request.output, "html") {
        page::write(&request.job, &request.output, console)?;
        return report(&request.output, &meter, console);
    }
    let job = bake::open(&request.job)?;
    write((&request.job, job.model()), &request.output, console)?;
    report(&request.output, &meter, console)
}

fn report(output: &Path, meter: &Meter, console: &Console) -> Result<()> {
    let written = Written::file(output, meter);
    console.result(&format!("{}: {}\n", written.output, show_bytes(written.written_bytes)))?;
    console.summary("export", &written)
}

fn has_ending(path: &Path, wanted: &str) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case(wanted))
}

/// Writes a light of a job per vertex; for viewers, of meshes that stay in their files that of their proxies.
///
/// # Errors
/// Those of [`ply::export`], [`glb::export`] and [`bake::pictures::write_streamed`], and interruptions.
pub fn write((job, model): (&Path, &Model), output: &Path, console: &Console) -> Result<()> {
    if !has_ending(output, "glb") && !model.details.is_empty() {
        return bake::pictures::write_streamed(output, (job, model), console).map(drop);
    }
    let scene = &model.scene;
    let stage = Stage::start(console, "mesh", "vertices", Some(scene.vertices.len() as u64));
    let evaluate = |points: &[SurfacePoint]| model.field().evaluate_crowd(&model.set_down(points));
    let advance = |vertices| stage.advance(vertices);
    if has_ending(output, "glb") {
        note_proxies(model, console);
        glb::export(output, scene, &evaluate, &advance)?;
    } else {
        ply::export(output, scene, &evaluate, &advance)?;
    }
    stage.finish();
    model.bvh.sound()
}

/// Writes the light of a job per vertex, and what skies of harmonics do there.
fn write_transfers((job, order): (&Path, usize), output: &Path, console: &Console) -> Result<()> {
    let mut relighter = Relighter::open(job)?;
    let streamed = !relighter.model().details.is_empty();
    if has_ending(output, "html") || (streamed && !has_ending(output, "glb")) {
        let what = if streamed { "of a streamed mesh's proxy" } else { "at vertices" };
        return Err(Error::Usage(format!("--transfer: transfers {what} go into a .ply or .glb")));
    }
    let functions = order * order;
    let total = (functions * relighter.model().scene.vertices.len()) as u64;
    let stage = Stage::start(console, "transfer", "vertices", Some(total));
    let mut transfers = VertexTransfers::default();
    relighter.each_sky(order, &|| console.check(), &mut |_, model, evaluate| {
        let field = VertexField::new(&model.scene, &evaluate, &|vertices| stage.advance(vertices))?;
        let lights = field.light(0..model.scene.vertices.len());
        transfers.columns.push(lights.into_iter().map(|light| light.radiosity).collect());
        Ok(())
    })?;
    stage.finish();
    let model = relighter.model();
    let evaluate = |points: &[SurfacePoint]| model.field().evaluate_crowd(&model.set_down(points));
    let advance = |_| console.check();
    if has_ending(output, "glb") {
        note_proxies(model, console);
        glb::export_with((output, &model.scene), &evaluate, &advance, &transfers)?;
    } else {
        ply::export_with((output, &model.scene), &evaluate, &advance, &transfers)?;
    }
    model.bvh.sound()
}

fn note_proxies(model: &Model, console: &Console) {
    for (mesh, detail) in &model.details {
        let proxy = &model.scene.meshes[*mesh];
        let [held, all] = [proxy.triangles.len() as u64, detail.triangles()].map(show_count);
        console.note(&format!("{}: its proxy of {held} triangles, not all {all}; .ply has all", proxy.name));
    }
}
