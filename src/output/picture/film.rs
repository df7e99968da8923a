//! The film: what the camera's rays bring back, averaged over each pixel.

use glam::Vec3;

use crate::light::Rgb;
use crate::output::exposure;

/// Depth of a pixel that sees no surface, as compositing programs expect it.
pub const NO_DEPTH: f32 = 1.0e10;

/// One pixel's averages. Colours are over the whole pixel; normal, depth and error over the part that sees surfaces.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Pixel {
    /// Radiance of emitters, of the sky behind, and of light reflected once, W·m⁻²·sr⁻¹.
    pub direct: Rgb,
    /// Radiance of light reflected more than once, and of reflected sky light, W·m⁻²·sr⁻¹.
    pub indirect: Rgb,
    /// Diffuse reflectance; black where the sky is.
    pub albedo: Rgb,
    /// Unit normal in scene axes; zero where the sky is.
    pub normal: Vec3,
    /// Distance along the viewing axis in scene units.
    pub depth: f32,
    /// Standard error of the mean-channel radiance, W·m⁻²·sr⁻¹.
    pub error: f32,
    /// Share of the pixel that sees surfaces.
    pub coverage: f32,
}

impl Pixel {
    /// Everything that the camera sees.
    pub fn radiance(&self) -> Rgb {
        self.direct + self.indirect
    }

    /// Adds one sample that met a surface; see [`Pixel::resolve`].
    pub fn add(&mut self, sample: &Self) {
        self.direct += sample.direct;
        self.indirect += sample.indirect;
        self.albedo += sample.albedo;
        self.normal += sample.normal;
        self.depth += sample.depth;
        self.error += sample.error;
        self.coverage += sample.coverage;
    }

    /// Turns sums over `count` samples into averages without NaN or infinity.
    pub fn resolve(&self, count: u32) -> Self {
        let all = 1.0 / count as f32;
        let covered = if self.coverage > 0.0 { 1.0 / self.coverage } else { 0.0 };
        let sound = |v: Vec3| if v.is_finite() { v } else { Vec3::ZERO };
        let depth = if self.coverage > 0.0 { self.depth * covered } else { NO_DEPTH };
        let error = self.error * covered;
        Self {
            direct: sound(self.direct * all),
            indirect: sound(self.indirect * all),
            albedo: sound(self.albedo * all),
            normal: sound(self.normal).normalize_or_zero(),
            depth: if depth.is_finite() { depth } else { NO_DEPTH },
            error: if error.is_finite() { error } else { 0.0 },
            coverage: self.coverage * all,
        }
    }
}

/// A finished picture, rows from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct Film {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Row-major from the top left.
    pub pixels: Vec<Pixel>,
}

impl Film {
    /// The exposure that shows the surfaces of this picture well: their 98th percentile of luminance at 0.9 of the
    /// display's linear range; the sky behind does not count.
    pub fn exposure(&self) -> f32 {
        exposure::automatic(self.pixels.iter().map(|p| (exposure::luminance(p.radiance()), p.coverage)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_half_covered_pixel_keeps_the_depth_of_its_surface() {
        let mut sum = Pixel::default();
        sum.add(&Pixel { direct: Vec3::ONE, normal: Vec3::Z, depth: 3.0, coverage: 1.0, ..Pixel::default() });
        sum.add(&Pixel { direct: Vec3::splat(3.0), ..Pixel::default() });
        let pixel = sum.resolve(2);
        assert_eq!((pixel.direct, pixel.depth, pixel.coverage), (Vec3::splat(2.0), 3.0, 0.5));
        assert_eq!(pixel.normal, Vec3::Z);
        assert_eq!(Pixel::default().resolve(4).depth, NO_DEPTH);
        let broken = Pixel { indirect: Vec3::splat(f32::NAN), ..Pixel::default() };
        assert_eq!(broken.resolve(1).radiance(), Vec3::ZERO);
    }
}
