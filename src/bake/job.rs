//! One job directory: made by [`run`], answered from by [`open`].

use std::fs;
use std::path::{Path, PathBuf};

use super::model::Model;
use super::options::Options;
use super::pictures;
use super::pipeline::{self, Target};
use super::report::progress::{Monitor, Stage};
use super::report::summary::{SUMMARY_FILE, Summary};
use super::report::usage::Meter;
use super::store;
use crate::archive::{Digest, Digests};
use crate::error::{Error, Result};
use crate::geometry::SurfacePoint;
use crate::rays::Bvh;
use crate::scene::{self, Scene};
use crate::solve::Irradiance;

/// The file within the job directory that says what the job was asked.
pub(super) const OPTIONS_FILE: &str = "options.json";

/// The file within the job directory that says what the job was made from.
pub(super) const INPUTS_FILE: &str = "inputs.json";

/// A finished job, open for questions.
pub struct Job {
    model: Model,
    summary: Summary,
    directory: PathBuf,
}

impl Job {
    /// The scene as it was baked.
    pub fn scene(&self) -> &Scene {
        &self.model.scene
    }

    /// The ray engine over it.
    pub fn bvh(&self) -> &Bvh {
        &self.model.bvh
    }

    /// Irradiance at surface points, in order.
    pub fn evaluate(&self, points: &[SurfacePoint]) -> Vec<Irradiance> {
        self.model.field().evaluate(points)
    }

    /// What the bake reported.
    pub fn summary(&self) -> &Summary {
        &self.summary
    }

    /// Where the job lies.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// Everything the job holds.
    pub fn model(&self) -> &Model {
        &self.model
    }
}

/// Opens a finished job.
///
/// # Errors
/// [`Error::NoJob`] when there is none or it is not finished, [`Error::Damaged`] when a checksum fails.
pub fn open(job: &Path) -> Result<Job> {
    let summary = Summary::read(job)?;
    let model = store::read(job, store::Purpose::Answers)?;
    Ok(Job { model, summary, directory: job.to_path_buf() })
}

/// Bakes a scene into a job directory, or finds that nothing is left to do.
///
/// # Errors
/// [`Error::JobDiffers`] when the directory holds a job of other options; every error of reading the scene and of
/// writing the job.
pub fn run(scene_path: &Path, job: &Path, options: &Options, monitor: &dyn Monitor) -> Result<Summary> {
    let meter = Meter::start();
    if let Some(summary) = finished(job, scene_path, options)? {
        return Ok(Summary { resumed_blocks: summary.computed_blocks, computed_blocks: 0, ..summary });
    }
    let stage = Stage::start(monitor, "scene", "files", None);
    let scene = scene::load(scene_path)?;
    scene.warnings.iter().for_each(|w| monitor.warn(&format!("{}: {}", w.file.display(), w.message)));
    let inputs = inputs(scene_path, &scene)?;
    let (triangles, vertices) = (scene.triangles.len() as u64, scene.vertices.len() as u64);
    let read = stage.finish();
    let bounces = options.max_bounces.map(|n| n as usize);
    let Options { error, seed, basis, operator, .. } = *options;
    let target = Target { error, seed, bounces, basis, operator };
    let (model, _, report) = pipeline::reach(&scene, &target, monitor)?;
    drop(scene);
    monitor.check()?;
    let stage = Stage::start(monitor, "store", "bytes", None);
    fs::create_dir_all(job).map_err(|e| Error::io(job, "making the job directory", e))?;
    write_json(job, OPTIONS_FILE, options)?;
    write_json(job, INPUTS_FILE, &inputs)?;
    let digests = Digests { inputs: Digest::of_options(&inputs)?, options: Digest::of_options(options)? };
    let stored = store::write(&model, job, digests)?;
    monitor.disk(stored.archive_bytes);
    let mut stages = vec![read];
    stages.extend(report.stages);
    stages.push(stage.finish());
    if options.preview {
        stages.extend(pictures::write(job, &model, monitor)?);
    }
    let mut summary = Summary {
        usage: meter.usage(),
        triangles,
        vertices,
        sites: model.sites.len() as u64,
        levels: model.sites.level_count() as u32,
        links: stored.links,
        rays: report.rays,
        archive_bytes: stored.archive_bytes,
        bytes_per_link: stored.row_bytes as f64 / stored.links.max(1) as f64,
        estimated_error: report.estimate.error,
        iterations: report.iterate.iterations as u32,
        residual: report.iterate.residual,
        converged: report.iterate.converged,
        stages,
        resumed_blocks: 0,
        computed_blocks: stored.blocks,
    };
    summary.usage = meter.usage();
    summary.write(job)?;
    Ok(summary)
}

/// The files a scene was read from, the one asked for first, with their digests.
fn inputs(scene_path: &Path, scene: &Scene) -> Result<Vec<(PathBuf, String)>> {
    let mut files = vec![scene_path.to_path_buf()];
    for mesh in &scene.meshes {
        if !files.contains(&mesh.file) {
            files.push(mesh.file.clone());
        }
    }
    files.into_iter().map(|file| Digest::of_file(&file).map(|digest| (file, digest.to_string()))).collect()
}

/// The summary of the job, if it is finished and was asked the same of the same files.
fn finished(job: &Path, scene_path: &Path, options: &Options) -> Result<Option<Summary>> {
    let Some(stored) = read_json::<Options>(job, OPTIONS_FILE)? else { return Ok(None) };
    if options.restart {
        return Ok(None);
    }
    let differs = |difference: String| Error::JobDiffers { job: job.to_path_buf(), difference };
    if let Some(difference) = options.difference(&stored) {
        return Err(differs(difference));
    }
    let made_from = read_json::<Vec<(PathBuf, String)>>(job, INPUTS_FILE)?.unwrap_or_default();
    if let Some((first, digest)) = made_from.first()
        && Digest::of_file(scene_path)?.to_string() != *digest
    {
        return Err(differs(format!("the scene was {}, now {}", first.display(), scene_path.display())));
    }
    for (file, digest) in made_from.iter().skip(1) {
        if Digest::of_file(file)?.to_string() != *digest {
            return Err(differs(format!("{} has changed", file.display())));
        }
    }
    if job.join(SUMMARY_FILE).exists() { Summary::read(job).map(Some) } else { Ok(None) }
}

pub(super) fn read_json<T: serde::de::DeserializeOwned>(job: &Path, name: &str) -> Result<Option<T>> {
    let path = job.join(name);
    let text = match fs::read(&path) {
        Ok(text) => text,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(Error::io(path, "reading", e)),
    };
    serde_json::from_slice(&text).map(Some).map_err(|e| Error::Damaged {
        file: path,
        place: format!("line {}", e.line()),
        problem: e.to_string(),
    })
}

pub(super) fn write_json(job: &Path, name: &str, value: &impl serde::Serialize) -> Result<()> {
    let path = job.join(name);
    let text = serde_json::to_vec_pretty(value).map_err(|e| Error::io(&path, "writing", e.into()))?;
    fs::write(&path, text).map_err(|e| Error::io(&path, "writing", e))
}
