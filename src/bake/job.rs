//! One job directory: made by [`run`], answered from by [`open`].

use std::fs;
use std::path::{Path, PathBuf};

use super::model::Model;
use super::options::Options;
use super::pictures;
use super::pipeline::{self, Target};
use super::progress::{Monitor, Stage};
use super::store;
use super::summary::{SUMMARY_FILE, Summary};
use super::usage::Meter;
use crate::archive::{Digest, Digests};
use crate::error::{Error, Result};
use crate::geometry::SurfacePoint;
use crate::rays::Bvh;
use crate::scene::{self, Scene};
use crate::solve::Irradiance;

/// The file within the job directory that says what the job was asked.
const OPTIONS_FILE: &str = "options.json";

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
    let model = store::read(job)?;
    Ok(Job { model, summary, directory: job.to_path_buf() })
}

/// Bakes a scene into a job directory, or finds that nothing is left to do.
///
/// # Errors
/// [`Error::JobDiffers`] when the directory holds a job of other options; every error of reading the scene and of
/// writing the job.
pub fn run(scene_path: &Path, job: &Path, options: &Options, monitor: &dyn Monitor) -> Result<Summary> {
    let meter = Meter::start();
    if let Some(summary) = finished(job, options)? {
        return Ok(Summary { resumed_blocks: summary.computed_blocks, computed_blocks: 0, ..summary });
    }
    let stage = Stage::start(monitor, "scene", "files", None);
    let scene = scene::load(scene_path)?;
    scene.warnings.iter().for_each(|w| monitor.warn(&format!("{}: {}", w.file.display(), w.message)));
    let (triangles, vertices) = (scene.triangles.len() as u64, scene.vertices.len() as u64);
    let read = stage.finish();
    let bounces = options.max_bounces.map(|n| n as usize);
    let target = Target { error: options.error, seed: options.seed, bounces };
    let (model, _, report) = pipeline::reach(&scene, &target, monitor)?;
    drop(scene);
    monitor.check()?;
    let stage = Stage::start(monitor, "store", "bytes", None);
    fs::create_dir_all(job).map_err(|e| Error::io(job, "making the job directory", e))?;
    write_options(job, options)?;
    let digests = Digests { inputs: Digest::of_file(scene_path)?, options: Digest::of_options(options)? };
    let stored = store::write(&model, job, digests)?;
    monitor.disk(stored.archive_bytes);
    let mut stages = vec![read];
    stages.extend(report.stages);
    stages.push(stage.finish());
    if options.preview {
        let field = model.field();
        let evaluate = |points: &[SurfacePoint]| field.evaluate(points);
        stages.extend(pictures::write(job, (&model.scene, &model.bvh), &evaluate, monitor)?);
    }
    let links = model.receivers.rows.met.len() as u64;
    let mut summary = Summary {
        usage: meter.usage(),
        triangles,
        vertices,
        sites: model.sites.len() as u64,
        levels: model.sites.level_count() as u32,
        links,
        rays: report.rays,
        archive_bytes: stored.archive_bytes,
        bytes_per_link: stored.row_bytes as f64 / links.max(1) as f64,
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

/// The summary of the job, if it is finished and was asked the same.
fn finished(job: &Path, options: &Options) -> Result<Option<Summary>> {
    let Some(stored) = stored_options(job)? else { return Ok(None) };
    if options.restart {
        return Ok(None);
    }
    if let Some(difference) = options.difference(&stored) {
        return Err(Error::JobDiffers { job: job.to_path_buf(), difference });
    }
    if job.join(SUMMARY_FILE).exists() { Summary::read(job).map(Some) } else { Ok(None) }
}

fn stored_options(job: &Path) -> Result<Option<Options>> {
    let path = job.join(OPTIONS_FILE);
    let text = match fs::read(&path) {
        Ok(text) => text,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(Error::io(path, "reading the options", e)),
    };
    serde_json::from_slice(&text).map(Some).map_err(|e| Error::Damaged {
        file: path,
        place: format!("line {}", e.line()),
        problem: e.to_string(),
    })
}

fn write_options(job: &Path, options: &Options) -> Result<()> {
    let path = job.join(OPTIONS_FILE);
    let text = serde_json::to_vec_pretty(options).unwrap_or_default();
    fs::write(&path, text).map_err(|e| Error::io(path, "writing the options", e))
}
