//! The job: everything from a scene file to a solved job directory, interruptible and resumable.

pub mod forecast;
pub mod job;
pub mod laws;
pub mod model;
pub mod options;
pub mod pictures;
pub mod pipeline;
pub mod relight;
pub mod report;
pub mod store;
pub mod transfer;
pub mod validate;
pub mod verify;
pub mod vertices;
pub mod work;

pub use forecast::{Forecast, forecast};
pub use job::{Job, open, run, run_in};
pub use options::Options;
pub use relight::{Lighting, RelightParams, RelightReport, Relighter};
pub use report::progress::{Monitor, Signal, Silent, Stage};
pub use report::summary::{StageTime, Summary};
pub use report::usage;
pub use report::usage::{Meter, Stopwatch, Usage};
