//! One file per verb.

pub mod bake;
pub mod chart;
mod destination;
pub mod export;
pub mod inspect;
pub mod packaging;
pub mod points;
pub mod render;
pub mod verify;

pub use destination::{Destination, Written};
