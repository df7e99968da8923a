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
    /// ε = |p − c| / r + 0.7 √(1 − n·n′); infinite when the normals part by 60° or the point lies behind.
    /// Source: Ward, Rubinstein and Clear 1988, eq. 2, with the weight of the normal term from measurement.
    pub fn distance(&self, to: &SurfacePoint) -> f32 {
        let cosine = self.point.normal.dot(to.normal);
        if cosine < 0.5 {
            return f32::INFINITY;
        }
        let d: Vec3 = to.position - self.point.position;
        // A point in front of the support's hemisphere sees what the support does not.
        if d.dot(self.point.normal + to.normal) < -0.2 * self.radius {
            return f32::INFINITY;
        }
        d.length() / self.radius + 0.7 * (1.0 - cosine).max(0.0).sqrt()
    }
}
