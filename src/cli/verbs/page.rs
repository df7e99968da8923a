//! `glowtree export JOB -o view.html`

use std::path::Path;

use crate::bake::{Monitor, Relighter, Stage};
use crate::cli::console::Console;
use crate::error::Result;
use crate::geometry::SurfacePoint;
use crate::light::Rgb;
use crate::output::picture::{View, frame};
use crate::output::viewer::{DenseMesh, Page, ViewLight};
use crate::solve::Irradiance;

/// Pixels of a view of a scene without a camera.
const SIZE: [u32; 2] = [768, 512];

/// Irradiance over the mean below which a vertex lies where no light comes, as within solids.
const UNLIT: f32 = 1.0e-4;

/// Points asked together.
const BATCH: usize = 1 << 15;

/// Writes a page that shows the job and relights it.
///
/// # Errors
/// Those of opening the job, of [`Page::write`], and interruptions.
pub fn write(job: &Path, output: &Path, console: &Console) -> Result<()> {
    let mut relighter = Relighter::open(job)?;
    relighter.prepare_with(&|| console.check())?;
    let model = relighter.model();
    let mesh = DenseMesh::new(&model.scene);
    let at = mesh.asked().into_iter().zip(&mesh.vertices);
    let mut points: Vec<SurfacePoint> =
        at.map(|(position, vertex)| SurfacePoint { position, normal: vertex.normal }).collect();
    if !model.details.is_empty() {
        // Vertices of proxies lie beside the surface.
        points.iter_mut().for_each(|point| *point = model.around().footing(point).1);
    }
    let view = match model.scene.cameras.first() {
        Some(camera) => View { camera: camera.clone(), see_through: false },
        None => frame(&model.scene, &model.bvh, SIZE),
    };
    let baked = relighter.baked().clone();
    let apart = baked.apart(relighter.scene());
    let total = points.len() as u64 * (apart.len() as u64 + 1);
    let stage = Stage::start(console, "vertices", "vertices", Some(total));
    let together = answers(&mut relighter, &points, &stage)?;
    let sites = relighter.model().sites.positions.clone();
    let mut radiosity = relighter.radiosity().to_vec();
    let exitance = relighter.model().exitance.clone();
    radiosity.iter_mut().zip(exitance).for_each(|(b, e)| *b = b.max(e));
    let mean = together.iter().map(|light| light.total().max_element()).sum::<f32>() / points.len() as f32;
    let unlit: Vec<bool> = together.iter().map(|light| light.total().max_element() <= UNLIT * mean).collect();
    let mut lights = Vec::with_capacity(apart.len());
    for light in apart {
        relighter.relight_with(&light.lighting, &|| console.check())?;
        let answers = answers(&mut relighter, &points, &stage)?;
        let exitance = |mesh: usize| light.lighting.meshes[mesh].radiance * std::f32::consts::PI;
        let mut irradiance: Vec<Rgb> = answers.iter().map(|light| light.total().max(Rgb::ZERO)).collect();
        mesh.lighten(&unlit, &mut irradiance);
        lights.push(ViewLight {
            name: light.name,
            irradiance,
            surface: light.mesh.map(|mesh| (mesh, exitance(mesh))),
            is_sky: light.is_sky,
        });
    }
    stage.finish();
    relighter.relight(&baked)?;
    let model = relighter.model();
    let title = job.file_stem().unwrap_or_default().to_string_lossy();
    let note = if model.details.is_empty() { "the light of the job" } else { "in place of meshes in files" };
    let [open, error] = [|l: &Irradiance| l.sky_visibility, |l: &Irradiance| l.error]
        .map(|of| together.iter().map(of).collect::<Vec<f32>>());
    let page = Page {
        title: &title,
        scene: &model.scene,
        mesh: &mesh,
        lights: &lights,
        ambient_occlusion: &open,
        error: &error,
        sites: (&sites, &radiosity),
        view: &view,
        note,
    };
    page.write(output)?;
    model.bvh.sound()
}

/// The light of now at all points.
fn answers(relighter: &mut Relighter, points: &[SurfacePoint], stage: &Stage<'_>) -> Result<Vec<Irradiance>> {
    let field = relighter.model().field();
    let mut answers = Vec::with_capacity(points.len());
    for batch in points.chunks(BATCH) {
        answers.extend(field.evaluate_crowd(batch));
        stage.advance(batch.len() as u64)?;
    }
    Ok(answers)
}
