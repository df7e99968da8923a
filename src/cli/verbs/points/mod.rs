//! Verbs that answer for tables of points.

pub mod probe;
pub mod reference;

use super::{Destination, Written};
