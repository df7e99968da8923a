//! What a bake would take, without baking it: headers say what is linear in triangles, a pilot at coarser targets the rest.

mod pilot;
mod streamed;

use std::path::Path;

use serde::Serialize;

use crate::bake::job::Budget;
use crate::bake::options::Options;
use crate::bake::report::progress::Monitor;
use crate::error::{Error, Result};
use crate::scene;
use crate::scene::assemble::Contents;

/// What one stage would take.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct StageForecast {
    /// The stage's noun, as in the summary of a bake.
    pub name: String,
    /// Wall-clock time.
    pub seconds: f64,
    /// CPU time of all threads.
    pub cpu_seconds: f64,
    /// Largest anonymous resident memory while it runs.
    pub peak_anonymous_bytes: u64,
    /// What it leaves in the job.
    pub disk_bytes: u64,
}

/// What a bake would take. Predictions, meant to be right within 30 %; a scene whose first plan misses its target takes
/// a second one, which nobody can tell beforehand.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Forecast {
    /// Wall-clock time.
    pub seconds: f64,
    /// CPU time of all threads.
    pub cpu_seconds: f64,
    /// Largest anonymous resident memory.
    pub peak_anonymous_bytes: u64,
    /// What the finished job takes on disk.
    pub disk_bytes: u64,
    /// What it takes besides, for a while.
    pub passing_bytes: u64,
    /// What is free where the job would lie; 0 where the system does not tell.
    pub free_bytes: u64,
    /// Triangles in the scene.
    pub triangles: u64,
    /// Vertices in the scene.
    pub vertices: u64,
    /// Sites on all surfaces; 0 where meshes stay in their files and nobody has seen them yet.
    pub sites: u64,
    /// Parts that the links can be made in.
    pub shards: u64,
    /// Stages in the order they would run.
    pub stages: Vec<StageForecast>,
}

impl Forecast {
    /// Sums up stages.
    fn of(stages: Vec<StageForecast>) -> Self {
        Self {
            seconds: stages.iter().map(|stage| stage.seconds).sum(),
            cpu_seconds: stages.iter().map(|stage| stage.cpu_seconds).sum(),
            peak_anonymous_bytes: stages.iter().map(|s| s.peak_anonymous_bytes).max().unwrap_or_default(),
            disk_bytes: stages.iter().map(|stage| stage.disk_bytes).sum(),
            shards: 1,
            stages,
            ..Self::default()
        }
    }

    /// Errors when the disk or the budget would not do.
    ///
    /// # Errors
    /// [`Error::DiskFull`] with what is missing, [`Error::Memory`].
    pub fn check(&self, job: &Path, max_memory_bytes: Option<u64>) -> Result<()> {
        Budget::new(max_memory_bytes).refuse_above("the bake", self.peak_anonymous_bytes)?;
        let wanted = self.disk_bytes + self.passing_bytes;
        if self.free_bytes > 0 && wanted > self.free_bytes {
            return Err(Error::DiskFull { file: job.into(), needed_bytes: wanted - self.free_bytes });
        }
        Ok(())
    }
}

/// Predicts what baking a scene into a job directory would take; writes nothing.
///
/// Cost: reads headers and the meshes that a bake holds in memory; these are baked twice, at two and four times the target,
/// which takes about half as long as their stages at the target, without lit mesh and picture.
///
/// # Errors
/// Those of reading the scene; [`Error::Interrupted`].
pub fn forecast(scene_path: &Path, job: &Path, options: &Options, monitor: &dyn Monitor) -> Result<Forecast> {
    let contents = scene::draft(scene_path, options.resident())?;
    let mut forecast = if contents.parts.iter().any(|part| part.streamed.is_some()) {
        streamed::forecast(&contents, options)
    } else {
        pilot::forecast(contents.into_scene(scene_path)?, options, monitor)?
    };
    forecast.free_bytes = free_bytes(job);
    Ok(forecast)
}

/// Bytes that are free in the first folder above that exists.
fn free_bytes(job: &Path) -> u64 {
    let there = |path: &&Path| path.exists() && !path.as_os_str().is_empty();
    let folder = job.ancestors().find(there).unwrap_or(Path::new("."));
    rustix::fs::statvfs(folder).map_or(0, |system| system.f_bavail.saturating_mul(system.f_frsize))
}

/// Triangles and vertices as far as headers and what was read tell.
fn counts(contents: &Contents) -> (u64, u64) {
    contents.parts.iter().fold((0, 0), |(triangles, vertices), part| match part.streamed {
        Some(left) => (triangles + left.faces, vertices + left.vertices),
        None => (triangles + part.triangles.len() as u64, vertices + part.positions.len() as u64),
    })
}
