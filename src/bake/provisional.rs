//! Stands in until the pipeline is wired: reads the scene and lights it by a formula, so that the program runs.

use std::path::Path;

use glam::Vec3;

use super::{Meter, Monitor, Options, Stage, Summary, pictures};
use crate::error::{Error, Result};
use crate::geometry::SurfacePoint;
use crate::rays::Bvh;
use crate::scene::{self, Scene};
use crate::solve::Irradiance;

/// A baked job.
pub struct Job {
    scene: Scene,
    bvh: Bvh,
    summary: Summary,
}

impl Job {
    /// Its scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }
    /// Its rays.
    pub fn bvh(&self) -> &Bvh {
        &self.bvh
    }
    /// Its figures.
    pub fn summary(&self) -> &Summary {
        &self.summary
    }
    /// A sky above and a sun from the side.
    pub fn evaluate(&self, points: &[SurfacePoint]) -> Vec<Irradiance> {
        points.iter().map(|p| evaluate(&self.scene, &self.bvh, p)).collect()
    }
}

fn evaluate(scene: &Scene, bvh: &Bvh, point: &SurfacePoint) -> Irradiance {
    let sun = Vec3::new(0.5, 0.8, 0.3).normalize();
    let lit = !bvh.occluded(&crate::rays::Ray::new(point.lifted(), sun));
    let up = 0.5 + 0.5 * point.normal.dot(scene.up);
    Irradiance {
        direct: Vec3::new(3.0, 2.8, 2.5) * point.normal.dot(sun).max(0.0) * if lit { 1.0 } else { 0.0 },
        indirect: Vec3::new(0.8, 0.9, 1.0) * up,
        sky_visibility: up,
        error: 0.01,
    }
}

/// Reads, lights, writes pictures.
pub fn run(scene_path: &Path, job: &Path, options: &Options, monitor: &dyn Monitor) -> Result<Summary> {
    let meter = Meter::start();
    let stage = Stage::start(monitor, "scene", "bytes", None);
    let scene = scene::load(scene_path)?;
    let mut stages = vec![stage.finish()];
    for warning in &scene.warnings {
        monitor.warn(&format!("{}: {}", warning.file.display(), warning.message));
    }
    let failed = |e| Error::io(job, "making the job directory", e);
    std::fs::create_dir_all(job).map_err(failed)?;
    let absolute = scene_path.canonicalize().map_err(failed)?;
    std::fs::write(job.join("scene.path"), absolute.to_string_lossy().as_bytes()).map_err(failed)?;
    let bvh = Bvh::build(&scene);
    if options.preview {
        let light = |points: &[SurfacePoint]| points.iter().map(|p| evaluate(&scene, &bvh, p)).collect();
        stages.extend(pictures::write(job, (&scene, &bvh), &light, monitor)?);
    }
    let summary = Summary {
        usage: meter.usage(),
        triangles: scene.triangles.len() as u64,
        vertices: scene.vertices.len() as u64,
        converged: true,
        computed_blocks: 1,
        stages,
        ..Summary::default()
    };
    summary.write(job)?;
    Ok(summary)
}

/// Opens a job.
pub fn open(job: &Path) -> Result<Job> {
    let summary = Summary::read(job)?;
    let path = std::fs::read_to_string(job.join("scene.path"));
    let path = path.map_err(|_| Error::NoJob { job: job.to_path_buf() })?;
    let scene = scene::load(Path::new(&path))?;
    let bvh = Bvh::build(&scene);
    Ok(Job { scene, bvh, summary })
}
