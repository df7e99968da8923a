//! Interpolation between levels: from receivers, where light is gathered, to sites and to any point.

pub mod index;
pub mod mls;

use glam::Vec3;

use crate::geometry::SurfacePoint;

/// A point at which irradiance is known, with the radius in which it may speak for its surroundings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Support {
    /// Where.
    pub point: SurfacePoint,
    /// Validity radius in local units (harmonic mean distance times a factor, clamped).
    pub radius: f32,
}

impl Support {
    /// The interpolation distance from this support to a point: below 1 it covers the point, at 2 its weight ends.
    ///
    /// ε = |d| / r + 0.35 √(1 − n·n′) + |d·m| / r with d from support to point and m the mean normal: a chord of a round
    /// surface has d·m = 0, a step beside or behind has not. Infinite when the normals part by 78°.
    /// The normals weigh little because rows carry their change with the normal and fits regress on it.
    /// Source: Ward, Rubinstein and Clear 1988, eq. 2; the weights of the normal and offset terms from measurement.
    pub fn distance(&self, to: &SurfacePoint) -> f32 {
        let cosine = self.point.normal.dot(to.normal);
        if cosine < OPPOSED {
            return f32::INFINITY;
        }
        let d: Vec3 = to.position - self.point.position;
        // The mean normal has length √((1 + n·n′)/2) ≥ 0.86: near enough to one.
        let offset = 0.5 * d.dot(self.point.normal + to.normal).abs();
        (d.length() + OFFSET_WEIGHT * offset) / self.radius + NORMAL_WEIGHT * (1.0 - cosine).max(0.0).sqrt()
    }
}

/// What an offset along the normal weighs more than one along the surface.
const OFFSET_WEIGHT: f32 = 1.0;

/// What √(1 − n·n′) weighs.
const NORMAL_WEIGHT: f32 = 0.35;

/// Points whose normals' cosine is below this do not speak for each other.
const OPPOSED: f32 = 0.2;
