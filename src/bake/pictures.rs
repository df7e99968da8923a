//! What a bake leaves for the eye: `mesh.ply` and `preview.png`.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use super::job::WORK_FOLDER;
use super::report::progress::{Monitor, Stage};
use super::report::summary::StageTime;
use super::store;
use super::vertices::{self, Workshop};
use crate::archive::{Disk, Ledger, Storage, Tag};
use crate::bake::model::Model;
use crate::error::{Error, Result};
use crate::geometry::SurfacePoint;
use crate::light::Rgb;
use crate::output::picture::{Film, Quality, View, png, render};
use crate::output::{Advance, ply, vertices as lit};
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

/// Writes both files into the job directory and says what they took. What is on its way to them lies in the storage.
///
/// # Errors
/// Input/output errors, and the ledger's.
pub fn write(
    (storage, job): (&Arc<dyn Storage>, &Path),
    model: &Model,
    (monitor, ledger): (&dyn Monitor, &Ledger<'_>),
) -> Result<Vec<StageTime>> {
    let mesh = if model.details.is_empty() {
        held(job, model, (monitor, ledger))?
    } else {
        streamed((storage, job), model, (monitor, ledger))?
    };
    let view = View::choose(&model.scene, &model.bvh, None, PREVIEW_SIZE)?;
    let [width, height] = view.camera.size;
    let stage = Stage::start(monitor, "preview", "pixels", Some(u64::from(width) * u64::from(height)));
    let film = draw(model, &view, &|pixels| stage.advance(pixels))?;
    model.bvh.sound()?;
    png::write(&job.join(PREVIEW_FILE), &film, film.exposure())?;
    Ok(vec![mesh, stage.finish()])
}

/// The picture, with the light that the eye asks for.
fn draw(model: &Model, view: &View, advance: &Advance<'_>) -> Result<Film> {
    let mut quick = model.field();
    quick.params.doubt = quick.params.doubt.max(PREVIEW_DOUBT);
    (quick.params.rays, quick.params.most_rays, quick.params.noise) = (PREVIEW_RAYS, PREVIEW_RAYS, 0.0);
    let evaluate = |points: &[SurfacePoint]| {
        if model.details.is_empty() {
            return quick.evaluate(points);
        }
        quick.evaluate_crowd(&model.set_down(points))
    };
    render(&model.scene, &model.bvh, &evaluate, (view, Quality::PREVIEW), advance)
}

/// Vertices of a sample, in runs that lie side by side as in the whole mesh.
const SAMPLED: usize = 1 << 14;
const SAMPLED_RUN: usize = 1 << 11;

/// A sampled picture is this many times smaller along either edge.
const SAMPLED_EDGE: u32 = 3;

/// What a part of the mesh and of the picture takes, each with the share of the whole that it is. Writes nothing.
///
/// # Errors
/// The monitor's; a camera without extent.
pub fn sample(model: &Model, monitor: &dyn Monitor) -> Result<Vec<(StageTime, f64)>> {
    let scene = &model.scene;
    let stage = Stage::start(monitor, "mesh", "vertices", None);
    let normals = lit::normals(scene);
    let order = lit::along_curve(scene, &normals);
    let runs = order.chunks(SAMPLED_RUN);
    let every = (order.len() / SAMPLED).max(1);
    let mut count = 0;
    for run in runs.step_by(every) {
        let at =
            |&v: &u32| SurfacePoint { position: scene.vertices[v as usize], normal: normals[v as usize] };
        let points: Vec<SurfacePoint> = run.iter().map(at).collect();
        std::hint::black_box(model.field().evaluate_crowd(&points));
        count += points.len();
        stage.advance(points.len() as u64)?;
    }
    let mesh = (stage.finish(), count as f64 / order.len().max(1) as f64);
    let mut view = View::choose(&model.scene, &model.bvh, None, PREVIEW_SIZE)?;
    let whole = view.camera.size.map(f64::from);
    view.camera.size = view.camera.size.map(|edge| (edge / SAMPLED_EDGE).max(1));
    let part = view.camera.size.map(f64::from);
    let stage = Stage::start(monitor, "preview", "pixels", None);
    std::hint::black_box(draw(model, &view, &|pixels| stage.advance(pixels))?);
    Ok(vec![mesh, (stage.finish(), part[0] * part[1] / (whole[0] * whole[1]))])
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
fn streamed(
    (storage, job): (&Arc<dyn Storage>, &Path),
    model: &Model,
    (monitor, ledger): (&dyn Monitor, &Ledger<'_>),
) -> Result<StageTime> {
    let folder = &job.join(WORK_FOLDER);
    storage.create_directory(folder).map_err(|e| Error::io(folder, "making the folder", e))?;
    let workshop = Workshop { storage, folder, digests: store::digests_of(job)?, pause: &|| ledger.pause() };
    stream_to(&job.join(MESH_FILE), model, &workshop, monitor)
}

/// Writes the streamed meshes of a job's model, the first to `path`, others beside it with a number. The model's light may be
/// another than the job's.
///
/// # Errors
/// Those of [`vertices::export`].
pub fn write_streamed(
    path: &Path,
    (job, model): (&Path, &Model),
    monitor: &dyn Monitor,
) -> Result<StageTime> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let scratch = tempfile::tempdir_in(folder).map_err(|e| Error::io(folder, "making a folder in it", e))?;
    let storage: Arc<dyn Storage> = Arc::new(Disk);
    let digests = store::digests_of(job)?;
    let pause = || monitor.check();
    let workshop = Workshop { storage: &storage, folder: scratch.path(), digests, pause: &pause };
    stream_to(path, model, &workshop, monitor)
}

fn stream_to(
    path: &Path,
    model: &Model,
    workshop: &Workshop<'_>,
    monitor: &dyn Monitor,
) -> Result<StageTime> {
    let total: u64 = model.details.iter().map(|(_, detail)| detail.vertices()).sum();
    let stage = Stage::start(monitor, "mesh", "vertices", Some(total));
    for number in 0..model.details.len() {
        let path = if number == 0 { path.to_path_buf() } else { numbered(path, number + 1) };
        vertices::export((&path, model, number), workshop, &|done| stage.advance(done))?;
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
            Ok(field.evaluate_crowd(points).iter().map(to_words).collect::<Vec<Words>>())
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
