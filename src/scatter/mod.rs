//! Points on surfaces, coarse to fine, dense only where somebody asks for more.
//!
//! A [`Growth`](growth::Growth) visits the surface level by level; each level halves the spacing and keeps only the
//! pieces of surface that still want points, so that the work follows the points placed and not the area or the
//! number of triangles.

pub mod bricks;
pub mod growth;
pub mod octaves;
pub mod packing;
pub mod surface;
pub mod thin;

use glam::Vec3;

use crate::geometry::SurfacePoint;

/// Integer cell coordinates: without SSE 4.1, `floor` is a call.
#[inline]
pub(crate) fn floor(at: Vec3) -> [i32; 3] {
    let below = |x: f32| {
        let cut = x as i32;
        cut.wrapping_sub(i32::from(cut as f32 > x))
    };
    [below(at.x), below(at.y), below(at.z)]
}

/// A point of the surface that may become a site or a receiver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// Position and normal of its side.
    pub point: SurfacePoint,
    /// The triangle it lies on.
    pub triangle: u32,
    /// Barycentric (u, v) there.
    pub barycentric: [f32; 2],
    /// Whether on the back.
    pub back: bool,
    /// The active piece it was drawn from.
    pub piece: u32,
    /// The triangle's place in its side's order.
    pub place: u32,
}
