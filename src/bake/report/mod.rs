//! What a job says of itself: its progress while it runs, its figures when it is done.

pub mod progress;
pub mod summary;
pub mod usage;
