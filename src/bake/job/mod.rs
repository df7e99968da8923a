//! One job directory: made by [`run`], answered from by [`open`].
//!
//! A job is finished when it has a summary. Until then its `work` folder holds what is done; the same command goes on
//! from there and ends with the same bytes.

mod budget;
mod inputs;
mod journal;
mod lock;
mod relit;
mod run;
mod side;
pub mod streams;

use std::path::{Path, PathBuf};

use super::model::Model;
use super::report::summary::Summary;
use super::store;
use crate::error::Result;
use crate::geometry::SurfacePoint;
use crate::rays::Bvh;
use crate::scene::Scene;
use crate::solve::Irradiance;

pub use budget::Budget;
pub use inputs::{Change, Inputs};
pub use journal::WORK_FOLDER;
pub use lock::{LOCK_FILE, Lock};
pub use run::{Unfinished, digests, options_digest, run, run_in, standing, unfinished};
pub(super) use side::{read as read_side, write as write_side};

/// The file within the job directory that says what the job was asked.
pub const OPTIONS_FILE: &str = "options.json";

/// The file within the job directory that says what the job was made from.
pub const INPUTS_FILE: &str = "inputs.json";

/// The file that marks a job whose place another takes, or has taken.
const REPLACED_FILE: &str = "replaced";

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

    /// Errors when chunks of a streamed mesh could not be read: answers given since are not to be used.
    ///
    /// # Errors
    /// [`Error::Damaged`](crate::Error::Damaged) with the chunk, [`Error::Io`](crate::Error::Io).
    pub fn sound(&self) -> Result<()> {
        self.model.bvh.sound()
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
/// [`Error::NoJob`](crate::Error::NoJob) when there is none or it is not finished,
/// [`Error::Damaged`](crate::Error::Damaged) when a checksum fails.
pub fn open(job: &Path) -> Result<Job> {
    let summary = Summary::read(job)?;
    let model = store::read(job, store::Purpose::Answers)?;
    Ok(Job { model, summary, directory: job.to_path_buf() })
}
