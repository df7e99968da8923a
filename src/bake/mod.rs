//! The job: everything from a scene file to a solved job directory, interruptible and resumable.

pub mod job;
pub mod laws;
pub mod model;
pub mod options;
pub mod pictures;
pub mod pipeline;
pub mod progress;
pub mod record;
pub mod store;
pub mod summary;
pub mod usage;
pub mod validate;

pub use job::{Job, open, run};
pub use options::Options;
pub use progress::{Monitor, Signal, Silent, Stage};
pub use summary::{StageTime, Summary};
pub use usage::{Meter, Stopwatch, Usage};
