//! Where sites must be denser than receivers are: in corners, where light that varies is near to those it shines on.

use crate::geometry::{SurfacePoint, hemisphere, tangent_frame};
use crate::light::{Rgb, mean_channel};
use crate::links::lamps::light::{Shares, weight};
use crate::links::lamps::shadow::Shadows;
use crate::scene::Sky;

/// The lamps' light on a surface, roughly: one shadow ray for all of them.
pub struct Shine<'a> {
    shadows: Shadows<'a>,
    /// Mean of lamps' and sky's light where surfaces exchange light, W·m⁻².
    level: f32,
}

/// A point, its weight, and the share of the sky that it sees.
pub type Representative = (SurfacePoint, f32, f32);

impl<'a> Shine<'a> {
    /// Over points that stand for the scene.
    pub fn new(shadows: Shadows<'a>, sky: Option<&Sky>, over: impl Iterator<Item = Representative>) -> Self {
        let mut shine = Self { shadows, level: 0.0 };
        let outside = sky.map_or(0.0, |sky| mean_channel(mean_radiance(sky)) * std::f32::consts::PI);
        let (mut sum, mut total) = (0.0, 0.0);
        for (point, weight, open) in over {
            sum += (shine.at(&point) + open * outside) * weight;
            total += weight;
        }
        shine.level = sum / total.max(f32::MIN_POSITIVE);
        shine
    }

    fn at(&self, point: &SurfacePoint) -> f32 {
        let mut shares = Shares::new();
        self.shadows.tree.shares(self.shadows.lamps, point, &mut shares);
        let seen = self.shadows.trace(point, &shares, 1, [0.5, 0.5]).visibility().unwrap_or(0.0);
        seen * weight(&shares)
    }

    /// How much the light differs within a reach of a point, over its mean in the scene.
    pub fn variation(&self, at: &SurfacePoint, reach: f32) -> f32 {
        if self.level <= 0.0 {
            return 0.0;
        }
        let (s, t) = tangent_frame(at.normal);
        let offsets = [s * 0.0, s * reach, s * -reach, t * reach, t * -reach];
        let (mut low, mut high) = (f32::INFINITY, 0.0f32);
        for offset in offsets {
            let light = self.at(&SurfacePoint { position: at.position + offset, ..*at });
            (low, high) = (low.min(light), high.max(light));
        }
        (high - low) / self.level
    }
}

/// How many directions tell a sky's mean radiance.
const DIRECTIONS: u32 = 256;

fn mean_radiance(sky: &Sky) -> Rgb {
    let direction = |i| hemisphere::uniform_sphere(hemisphere::fibonacci(i, DIRECTIONS, [0.5, 0.5]));
    (0..DIRECTIONS).map(|i| sky.radiance(direction(i))).sum::<Rgb>() / DIRECTIONS as f32
}
