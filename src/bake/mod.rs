//! The job: everything from a scene file to a solved job directory, interruptible and resumable.

pub mod options;
pub mod progress;
pub mod summary;
pub mod usage;

pub use options::Options;
pub use progress::{Monitor, Signal, Silent, Stage};
pub use summary::{StageTime, Summary};
pub use usage::{Meter, Stopwatch, Usage};
