//! The bright part of an image sky, kept apart from the rest so that rays can be aimed at it.
//!
//! A row of a few hundred rays meets a sun of a few pixels by chance only, and the sun may hold most of the sky's light.
//! What exceeds a limit becomes texels to aim at; the rest, which no longer exceeds it, stays an image. Both add up to
//! the sky in every direction, as bilinear look-ups are linear in the pixels.

use std::f32::consts::{PI, TAU};
use std::sync::Arc;

use glam::{Mat3, Vec3};

use crate::light::{Rgb, mean_channel};
use crate::scene::{Sky, Texture};

/// What exceeds this many times the rest's mean radiance is aimed at.
///
/// At 4, light of that height comes from a quarter of the sphere at the most: like emitters, sources above the limit that
/// hold a few per cent of the light are seen by a few rays of a row only, and their lattice noise is that of the row.
const LIMIT: f64 = 4.0;

/// Skies whose bright part holds less than this share of the light stay whole.
const LEAST_SHARE: f64 = 0.01;

/// Rounds in which the limit settles; each starts from the mean of what the last one left.
const ROUNDS: usize = 12;

/// A pixel's light above the limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Texel {
    /// From the left of the image.
    pub column: u32,
    /// From the zenith.
    pub row: u32,
    /// Unit vector from the scene towards its centre.
    pub direction: Vec3,
    /// Irradiance of a surface that faces it: radiance times solid angle, W·m⁻².
    pub light: Rgb,
}

/// The bright part of an image sky.
#[derive(Debug, Clone)]
pub struct Bright {
    /// Those with light, row by row.
    pub texels: Vec<Texel>,
    width: u32,
    height: u32,
    to_image: Mat3,
}

impl Sky {
    /// Splits a sky into what is left for rows of rays and the bright part to aim at, if it has one.
    ///
    /// Deterministic; a few milliseconds a megapixel. Turning the sky only turns the bright part.
    pub fn split(&self) -> (Self, Option<Bright>) {
        let Self::Image { image, to_image } = self else { return (self.clone(), None) };
        let Some(limit) = limit(image) else { return (self.clone(), None) };
        let (width, height) = (image.width, image.height);
        let mut bright = Bright { texels: Vec::new(), width, height, to_image: *to_image };
        let mut pixels = image.pixels.clone();
        for (k, pixel) in pixels.iter_mut().enumerate() {
            let mean = mean_channel(*pixel);
            if mean > limit {
                let rest = *pixel * (limit / mean);
                let (column, row) = (k as u32 % width, k as u32 / width);
                let direction = bright.direction(column as f32 + 0.5, row as f32 + 0.5);
                let solid_angle = (band(height, row) * f64::from(TAU) / f64::from(width)) as f32;
                bright.texels.push(Texel { column, row, direction, light: (*pixel - rest) * solid_angle });
                *pixel = rest;
            }
        }
        let rest = Self::Image { image: Arc::new(Texture { width, height, pixels }), to_image: *to_image };
        (rest, Some(bright))
    }
}

impl Bright {
    /// A direction within a texel's footprint, that of bilinear look-ups, with density proportional to its weight there.
    pub fn within(&self, texel: &Texel, [x, y]: [f32; 2]) -> Vec3 {
        let column = texel.column as f32 + 0.5 + tent(x);
        // Beyond a pole the image repeats its last row.
        let row = (texel.row as f32 + 0.5 + tent(y)).abs();
        let most = self.height as f32;
        self.direction(column, if row > most { 2.0 * most - row } else { row })
    }

    /// How far footprints reach from their centres, as the length of a chord of the unit sphere.
    pub fn reach(&self) -> f32 {
        PI / self.height as f32 * std::f32::consts::SQRT_2
    }

    /// Unit vector towards a place of the image in pixels.
    fn direction(&self, column: f32, row: f32) -> Vec3 {
        let (sine, cosine) = (PI * row / self.height as f32).sin_cos();
        let (x, z) = (TAU * (column / self.width as f32 - 0.5)).sin_cos();
        self.to_image.transpose() * Vec3::new(sine * x, cosine, -sine * z)
    }
}

/// Maps [0, 1) to (−1, 1) with density 1 − |t|.
fn tent(x: f32) -> f32 {
    if x < 0.5 { (2.0 * x).sqrt() - 1.0 } else { 1.0 - (2.0 * (1.0 - x)).sqrt() }
}

/// Solid angle of a row of pixels over 2π.
fn band(height: u32, row: u32) -> f64 {
    let edge = |k: u32| (std::f64::consts::PI * f64::from(k) / f64::from(height)).cos();
    edge(row) - edge(row + 1)
}

/// The radiance from which pixels are bright: [`LIMIT`] times the mean of the image clamped to it. None without a bright
/// part worth aiming at.
fn limit(image: &Texture) -> Option<f32> {
    let mean = |limit: f64| -> f64 {
        let rows = image.pixels.chunks_exact(image.width as usize).enumerate();
        let sum = |pixels: &[Rgb]| pixels.iter().map(|p| f64::from(mean_channel(*p)).min(limit)).sum::<f64>();
        let total: f64 = rows.map(|(row, pixels)| sum(pixels) * band(image.height, row as u32)).sum();
        total / (2.0 * f64::from(image.width))
    };
    let all = mean(f64::INFINITY);
    let mut rest = all;
    for _ in 0..ROUNDS {
        rest = mean(LIMIT * rest);
    }
    let limit = LIMIT * rest;
    (limit > 0.0 && all - mean(limit) >= LEAST_SHARE * all).then_some(limit as f32)
}
