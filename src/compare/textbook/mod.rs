//! The schemes of the textbooks, as plain as they stand there: what the stability table measures the program against.

pub mod interpolation;
pub mod points;
pub mod strips;
