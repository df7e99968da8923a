//! output

pub mod file;
pub mod points;
