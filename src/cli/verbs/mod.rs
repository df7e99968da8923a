//! One file per verb.

pub mod bake;
pub mod chart;
pub mod export;
pub mod films;
pub mod inspect;
pub mod packaging;
pub mod page;
pub mod points;
pub mod relight;
pub mod render;
pub mod verify;
pub mod view;

pub use super::destination::{Destination, Written};
