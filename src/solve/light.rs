//! What one row says of the light: irradiance, its change with the normal, and how sure its rays are of it.

use std::ops::Range;

use glam::Mat3;
use rayon::prelude::*;

use super::{Problem, Solution};
use crate::light::{Rgb, mean_channel};
use crate::links::rows::{self, Directions, FIRST_MARK, LOST, SKY};

/// The light that a receiver's row brings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RowLight {
    /// Irradiance from surfaces and sky, W·m⁻².
    pub irradiance: Rgb,
    /// Its change with the normal: H(n′) ≈ H(n) + gradient · (n′ − n).
    pub gradient: Mat3,
    /// Share of the sky that the receiver sees, weighted by the cosine.
    pub sky_visibility: f32,
    /// Standard error of the mean channel, W·m⁻².
    pub noise: f32,
}

/// Rays flatter than this cosine count as this flat in gradients (1/cos would let a few rays rule).
const FLATTEST: f32 = 0.4;

/// The lattice's standard error over that of pairs of neighbouring rays taken for independent (docs/theory.md, lattice
/// noise).
const LATTICE_GAIN: f32 = 0.6;

impl Problem<'_> {
    /// The light of some receivers' rows, given the radiosity of the sites.
    pub fn row_lights(&self, receivers: Range<usize>, radiosity: &[Rgb]) -> Vec<RowLight> {
        receivers
            .into_par_iter()
            .with_min_len(16)
            .map_init(Vec::new, |seen, r| self.row_light(r, radiosity, seen))
            .collect()
    }

    fn row_light(&self, r: usize, radiosity: &[Rgb], seen: &mut Vec<Rgb>) -> RowLight {
        let rows = &self.receivers.rows;
        let normal = self.receivers.index.supports()[r].point.normal;
        let directions = Directions::new(normal, rows.keys[r], rows.rays);
        let lattice = rows::lattice(rows.rays);
        seen.clear();
        let (mut sum, mut live) = (Rgb::ZERO, 0u32);
        for (at, &met) in lattice.iter().zip(rows.row(r)) {
            let light = match met {
                SKY => {
                    self.sky.map_or(Rgb::ZERO, |sky| sky.radiance(directions.at(*at)) * std::f32::consts::PI)
                }
                m if m < FIRST_MARK => radiosity[m as usize],
                _ => Rgb::ZERO,
            };
            live += u32::from(met != LOST);
            sum += light;
            seen.push(light);
        }
        let irradiance = sum / live.max(1) as f32;
        let mut gradient = Mat3::ZERO;
        for (at, light) in lattice.iter().zip(seen.iter()) {
            let direction = directions.at(*at);
            // Levers average to nothing, but for the lattice's noise: uniform light must not turn.
            let b = *light - irradiance;
            let cosine = direction.dot(normal);
            let lever = (direction - normal * cosine) / cosine.max(FLATTEST);
            gradient += Mat3::from_cols(b * lever.x, b * lever.y, b * lever.z);
        }
        let apart = |pair: &[Rgb]| mean_channel(pair[0] - pair[1]).powi(2);
        let square: f32 = seen.chunks_exact(2).map(apart).sum();
        RowLight {
            irradiance,
            gradient: gradient * (1.0 / rows.rays as f32),
            sky_visibility: rows.summaries[r].escaped as f32 / rows.rays as f32,
            noise: LATTICE_GAIN * square.sqrt() / live.max(1) as f32,
        }
    }
}

impl Solution {
    /// Adds a receiver's light.
    pub fn add(&mut self, light: RowLight) {
        self.irradiance.push(light.irradiance);
        self.gradient.push(light.gradient);
        self.sky_visibility.push(light.sky_visibility);
        self.noise.push(light.noise);
    }
}
