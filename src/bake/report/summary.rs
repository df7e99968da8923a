//! What a bake reports when it is done, and the file that keeps it in the job.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::usage::Usage;
use crate::bake::job::read_side;
use crate::error::{Error, Result};

/// The file within the job directory that holds the summary.
pub const SUMMARY_FILE: &str = "summary.json";

/// One stage's name and cost.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StageTime {
    /// The stage's noun: "scene", "bvh", "sites", "tree", "links", "solve", "mesh", "preview".
    pub name: String,
    /// Wall-clock time.
    pub seconds: f64,
    /// CPU time of all threads.
    pub cpu_seconds: f64,
}

/// How well the light of one light of a scene is known.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct LightEstimate {
    /// What the scene calls it; several where there are many.
    pub name: String,
    /// Relative RMS error of irradiance.
    pub error: f64,
}

/// The figures of a finished bake. All numbers are finite; shares of nothing are 0.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Time and memory.
    #[serde(flatten)]
    pub usage: Usage,
    /// Triangles in the scene.
    pub triangles: u64,
    /// Vertices in the scene.
    pub vertices: u64,
    /// Sites on all surfaces.
    pub sites: u64,
    /// Levels of the hierarchy.
    pub levels: u32,
    /// Links stored: pairs of a receiver and a site that some of its rays met.
    pub links: u64,
    /// Rays traced.
    pub rays: u64,
    /// Bytes of the job's archives on disk.
    pub archive_bytes: u64,
    /// Bytes of the stored rows, links and the order of their rays, per link.
    pub bytes_per_link: f64,
    /// The program's own estimate of the relative RMS error of irradiance.
    pub estimated_error: f64,
    /// The same of each light by itself, relative to its own light, of a bake that is meant for relighting.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lights: Vec<LightEstimate>,
    /// Iterations of the solver.
    pub iterations: u32,
    /// Relative residual reached.
    pub residual: f64,
    /// Whether the residual met its tolerance.
    pub converged: bool,
    /// Cost by stage, in the order they ran.
    pub stages: Vec<StageTime>,
    /// Blocks found finished and kept.
    pub resumed_blocks: u64,
    /// Blocks made by this run.
    pub computed_blocks: u64,
}

impl Summary {
    /// Reads the summary of a finished job. Errors: [`Error::NoJob`] when the file is absent, [`Error::Damaged`]
    /// when it does not parse.
    pub fn read(job: &Path) -> Result<Self> {
        read_side(&job.join(SUMMARY_FILE))?.ok_or_else(|| Error::NoJob { job: job.to_path_buf() })
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::sync::Arc;

    use super::*;
    use crate::archive::{Disk, Storage};
    use crate::bake::job::write_side;

    fn sample() -> Summary {
        let stage = StageTime { name: "links".into(), seconds: 1.5, cpu_seconds: 2.9 };
        Summary { sites: 12_345, converged: true, stages: vec![stage], ..Summary::default() }
    }

    #[test]
    fn written_summaries_read_back() {
        let job = tempfile::tempdir().unwrap();
        let storage: Arc<dyn Storage> = Arc::new(Disk);
        write_side(&storage, &job.path().join(SUMMARY_FILE), &sample()).unwrap();
        assert_eq!(Summary::read(job.path()).unwrap(), sample());
    }

    #[test]
    fn absent_and_damaged_summaries_have_their_own_errors() {
        let job = tempfile::tempdir().unwrap();
        assert_eq!(Summary::read(job.path()).unwrap_err().exit_code(), 10);
        assert_eq!(Summary::read(&job.path().join("nowhere")).unwrap_err().exit_code(), 10);
        fs::write(job.path().join(SUMMARY_FILE), "{\"sites\": 1").unwrap();
        assert_eq!(Summary::read(job.path()).unwrap_err().exit_code(), 9);
    }
}
