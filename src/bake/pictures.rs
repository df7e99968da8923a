//! What a bake leaves for the eye: `mesh.ply` and `preview.png`.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use super::job::{Job, WORK_FOLDER};
use super::report::progress::{Monitor, Stage};
use super::report::summary::StageTime;
use super::store;
use super::vertices::{self, Workshop};
use crate::archive::{Digests, Disk, Ledger, Storage, Tag};
use crate::bake::model::Model;
use crate::error::{Error, Result};
use crate::geometry::SurfacePoint;
use crate::light::Rgb;
use crate::output::picture::{Quality, frame, png, render};
use crate::output::ply;
use crate::solve::{Field, Irradiance};

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

/// Writes both files into the job directory and says what they took.
///
/// # Errors
/// Input/output errors, and the ledger's.
pub fn write(
    job: &Path,
    model: &Model,
    (monitor, ledger): (&dyn Monitor, &Ledger<'_>),
) -> Result<Vec<StageTime>> {
    let (scene, bvh) = (&model.scene, &model.bvh);
    let field = model.field();
    let mut quick = field;
    quick.params.doubt = field.params.doubt.max(PREVIEW_DOUBT);
    (quick.params.rays, quick.params.most_rays, quick.params.noise) = (PREVIEW_RAYS, PREVIEW_RAYS, 0.0);
    let mesh = if model.details.is_empty() {
        held(job, model, (monitor, ledger))?
    } else {
        streamed(job, model, monitor)?
    };
    let view = match scene.cameras.first() {
        Some(camera) => crate::output::picture::View { camera: camera.clone(), see_through: false },
        None => frame(scene, bvh, PREVIEW_SIZE),
    };
    let [width, height] = view.camera.size;
    let stage = Stage::start(monitor, "preview", "pixels", Some(u64::from(width) * u64::from(height)));
    let evaluate = |points: &[SurfacePoint]| {
        if model.details.is_empty() {
            return quick.evaluate(points);
        }
        // What a camera's ray met is known to its rounding: rows begin on the surface itself.
        let set: Vec<SurfacePoint> = points.iter().map(|point| model.around().footing(point).1).collect();
        quick.evaluate_crowd(&set)
    };
    let film = render(scene, bvh, &evaluate, (&view, Quality::PREVIEW), &|pixels| stage.advance(pixels))?;
    bvh.sound()?;
    png::write(&job.join(PREVIEW_FILE), &film, film.exposure())?;
    Ok(vec![mesh, stage.finish()])
}

/// The mesh of a scene that is in memory.
fn held(job: &Path, model: &Model, (monitor, ledger): (&dyn Monitor, &Ledger<'_>)) -> Result<StageTime> {
    let (scene, field) = (&model.scene, model.field());
    let stage = Stage::start(monitor, "mesh", "vertices", Some(scene.vertices.len() as u64));
    let kept = Kept { ledger, failed: Mutex::new(None) };
    let evaluate = |points: &[SurfacePoint]| kept.evaluate(&field, points);
    ply::export(&job.join(MESH_FILE), scene, &evaluate, &|vertices| {
        kept.failure()?;
        stage.advance(vertices)
    })?;
    Ok(stage.finish())
}

/// The meshes that stay in their files: `mesh.ply` is the first of them, `mesh-2.ply` the second.
fn streamed(job: &Path, model: &Model, monitor: &dyn Monitor) -> Result<StageTime> {
    let folder = job.join(WORK_FOLDER);
    std::fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, "making the folder", e))?;
    stream_to(&job.join(MESH_FILE), (model, store::digests_of(job)?), &folder, monitor)
}

/// Writes a job's streamed meshes, the first to `path`, others beside it with a number.
///
/// # Errors
/// Those of [`vertices::export`].
pub fn write_streamed(job: &Job, path: &Path, monitor: &dyn Monitor) -> Result<StageTime> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let scratch = tempfile::tempdir_in(folder).map_err(|e| Error::io(folder, "making a folder in it", e))?;
    stream_to(path, (job.model(), store::digests_of(job.directory())?), scratch.path(), monitor)
}

/// Writes a model's streamed meshes, the first to `path`, others beside it with a number; `folder` keeps answers on their way.
///
/// # Errors
/// Those of [`vertices::export`].
pub fn stream_to(
    path: &Path,
    (model, digests): (&Model, Digests),
    folder: &Path,
    monitor: &dyn Monitor,
) -> Result<StageTime> {
    let total: u64 = model.details.iter().map(|(_, detail)| detail.vertices()).sum();
    let stage = Stage::start(monitor, "mesh", "vertices", Some(total));
    let storage: Arc<dyn Storage> = Arc::new(Disk);
    let pause = || monitor.check();
    let workshop = Workshop { storage: &storage, folder, digests, pause: &pause };
    for number in 0..model.details.len() {
        let path = if number == 0 { path.to_path_buf() } else { numbered(path, number + 1) };
        vertices::export((&path, model, number), &workshop, &|done| stage.advance(done))?;
    }
    Ok(stage.finish())
}

/// `mesh-2.ply` for `mesh.ply`.
fn numbered(path: &Path, number: usize) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{stem}-{number}.ply"))
}

/// Answers that are kept; a failure is told at the next opportunity, and what is written until then is thrown away.
struct Kept<'a> {
    ledger: &'a Ledger<'a>,
    failed: Mutex<Option<Error>>,
}

/// Direct, indirect, visibility of the sky, error.
type Words = [f32; 8];

impl Kept<'_> {
    fn evaluate(&self, field: &Field<'_>, points: &[SurfacePoint]) -> Vec<Irradiance> {
        let words = self.ledger.keep(Tag::new("answers"), 0..points.len() as u64, || {
            Ok(field.evaluate(points).iter().map(to_words).collect::<Vec<Words>>())
        });
        match words {
            Ok(words) => words.iter().map(from_words).collect(),
            Err(error) => {
                *self.failed.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
                vec![from_words(&[0.0; 8]); points.len()]
            }
        }
    }

    fn failure(&self) -> Result<()> {
        self.failed.lock().unwrap_or_else(PoisonError::into_inner).take().map_or(Ok(()), Err)
    }
}

fn to_words(light: &Irradiance) -> Words {
    let ([a, b, c], [d, e, f]) = (light.direct.to_array(), light.indirect.to_array());
    [a, b, c, d, e, f, light.sky_visibility, light.error]
}

fn from_words(&[a, b, c, d, e, f, sky_visibility, error]: &Words) -> Irradiance {
    Irradiance { direct: Rgb::new(a, b, c), indirect: Rgb::new(d, e, f), sky_visibility, error }
}
