//! Pictures: a solution becomes meshes, tables and images.
//!
//! Everything here asks for light through a closure ([`Evaluate`]), so that it neither knows nor cares how the light
//! was found, and reports through another ([`Advance`]), which may ask it to stop.

pub mod exposure;
pub mod file;
pub mod footing;
pub mod glb;
pub mod normals;
pub mod picture;
pub mod ply;
pub mod points;
#[cfg(test)]
pub(crate) mod synthetic;
pub mod transfers;
pub mod vertices;
pub mod viewer;

use crate::error::Result;
use crate::geometry::SurfacePoint;
use crate::solve::Irradiance;

/// Answers for surface points, in order.
pub type Evaluate<'a> = dyn Fn(&[SurfacePoint]) -> Vec<Irradiance> + Sync + 'a;

/// Takes how many more units are done; an error stops the work and is passed on.
pub type Advance<'a> = dyn Fn(u64) -> Result<()> + Sync + 'a;
