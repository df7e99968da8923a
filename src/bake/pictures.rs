//! What a bake leaves for the eye: `mesh.ply` and `preview.png`.

use std::path::Path;

use super::report::progress::{Monitor, Stage};
use super::report::summary::StageTime;
use crate::bake::model::Model;
use crate::error::Result;
use crate::output::picture::{Quality, frame, png, render};
use crate::output::ply;

/// The lit mesh within the job.
pub const MESH_FILE: &str = "mesh.ply";

/// The picture within the job.
pub const PREVIEW_FILE: &str = "preview.png";

/// Pixels of the picture.
const PREVIEW_SIZE: [u32; 2] = [768, 512];

/// Whether the job holds both files.
pub fn present(job: &Path) -> bool {
    [MESH_FILE, PREVIEW_FILE].iter().all(|name| job.join(name).is_file())
}

/// Disagreement of receivers, relative to the mean irradiance, from which the picture's points gather for themselves: the
/// eye forgives more than the target, and a point that gathers costs a hundred that do not. Without any, slits turn black.
const PREVIEW_DOUBT: f32 = 0.1;

/// Rays of such points: about 0.8 % of noise.
const PREVIEW_RAYS: u32 = 160;

/// Opens a finished job and writes both files.
///
/// # Errors
/// As [`super::open`] and [`write()`].
pub fn of_job(job: &Path, monitor: &dyn Monitor) -> Result<Vec<StageTime>> {
    let opened = super::open(job)?;
    write(job, opened.model(), monitor)
}

/// Writes both files into the job directory and says what they took.
///
/// # Errors
/// Input/output errors, and [`crate::Error::Interrupted`].
pub fn write(job: &Path, model: &Model, monitor: &dyn Monitor) -> Result<Vec<StageTime>> {
    let (scene, bvh) = (&model.scene, &model.bvh);
    let field = model.field();
    let mut quick = field;
    quick.params.doubt = field.params.doubt.max(PREVIEW_DOUBT);
    (quick.params.rays, quick.params.most_rays, quick.params.noise) = (PREVIEW_RAYS, PREVIEW_RAYS, 0.0);
    let stage = Stage::start(monitor, "mesh", "vertices", Some(scene.vertices.len() as u64));
    ply::export(&job.join(MESH_FILE), scene, &|points: &[_]| field.evaluate(points), &|vertices| {
        stage.advance(vertices)
    })?;
    let mesh = stage.finish();
    let view = match scene.cameras.first() {
        Some(camera) => crate::output::picture::View { camera: camera.clone(), see_through: false },
        None => frame(scene, bvh, PREVIEW_SIZE),
    };
    let [width, height] = view.camera.size;
    let stage = Stage::start(monitor, "preview", "pixels", Some(u64::from(width) * u64::from(height)));
    let evaluate = |points: &[_]| quick.evaluate(points);
    let film = render(scene, bvh, &evaluate, (&view, Quality::PREVIEW), &|pixels| stage.advance(pixels))?;
    png::write(&job.join(PREVIEW_FILE), &film, film.exposure())?;
    Ok(vec![mesh, stage.finish()])
}
