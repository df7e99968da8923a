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
    /// display's linear range, or less, down to half, where the sky behind would then outshine the display: surfaces
    /// under a white sky stay distinct from it.
    pub fn exposure(&self) -> f32 {
        let luminance = |pixel: &Pixel| exposure::luminance(pixel.radiance());
        let surfaces = exposure::automatic(self.pixels.iter().map(|p| (luminance(p), p.coverage)));
        let mut behind: Vec<f32> = self.pixels.iter().filter(|p| p.coverage == 0.0).map(luminance).collect();
        behind.sort_by(f32::total_cmp);
        match behind.get(behind.len() / 2) {
            Some(&median) if median > 0.0 => surfaces.min((1.0 / median).max(0.5 * surfaces)),
            _ => surfaces,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sky_behind_darkens_a_picture_by_half_at_the_most() {
        let lit = |radiance: f32, coverage: f32| Pixel {
            direct: Vec3::splat(radiance),
            coverage,
            ..Pixel::default()
        };
        let film = |sky: f32| Film { width: 2, height: 1, pixels: vec![lit(0.5, 1.0), lit(sky, 0.0)] };
        // Surfaces of 0.5 alone ask for 0.9 / 0.5 = 1.8; luminance weights add up to 1 within 1e-6.
        for (sky, expected) in [(0.0, 1.8), (0.1, 1.8), (0.8, 1.25), (10.0, 0.9)] {
            assert!((film(sky).exposure() - expected).abs() < 1e-5, "{sky}: {}", film(sky).exposure());
        }
    }

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
