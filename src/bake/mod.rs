//! The job: everything from a scene file to a solved job directory, interruptible and resumable.

pub mod options;
pub mod pictures;
pub mod progress;
mod provisional;
pub mod summary;
pub mod usage;

pub use options::Options;
pub use progress::{Monitor, Signal, Silent, Stage};
pub use provisional::{Job, open, run};
pub use summary::{StageTime, Summary};
pub use usage::{Meter, Stopwatch, Usage};
