//! What one row says of the light: irradiance, its change with the normal, and how sure its rays are of it.

use std::ops::Range;

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use super::{Problem, Solution};
use crate::light::{Rgb, mean_channel};
use crate::links::rows::{self, Directions, FIRST_MARK, LOST, LatticePoint, Rows, SKY};

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

/// The lattice's standard error over that of pairs of neighbouring rays taken for independent: 0.35 to 0.50 was measured
/// with 64 rays, 0.28 to 0.42 with 512 (docs/theory.md, rows).
fn lattice_gain(rays: u32) -> f32 {
    0.43 * (64.0 / rays as f32).powf(0.1)
}

impl Problem<'_> {
    /// The light of some receivers' rows, given the radiosity of the sites.
    pub fn row_lights(&self, receivers: Range<usize>, radiosity: &[Rgb]) -> Vec<RowLight> {
        let supports = self.receivers.index.supports();
        receivers
            .into_par_iter()
            .with_min_len(16)
            .map_init(Vec::new, |seen, r| {
                self.row_light(self.receivers.row(r), supports[r].point.normal, radiosity, seen)
            })
            .collect()
    }

    /// What one ray brings, as the irradiance of a row that sees the same everywhere.
    fn ray_light(&self, met: u32, direction: impl FnOnce() -> Vec3, radiosity: &[Rgb]) -> Rgb {
        match met {
            SKY => self.sky.map_or(Rgb::ZERO, |sky| sky.radiance(direction()) * std::f32::consts::PI),
            site if site < FIRST_MARK => radiosity[site as usize],
            _ => Rgb::ZERO,
        }
    }

    /// Irradiance at receivers straight from the sky.
    pub(super) fn sky_light(&self) -> Vec<Rgb> {
        if self.sky.is_none() {
            return vec![Rgb::ZERO; self.receivers.len()];
        }
        (0..self.receivers.len())
            .into_par_iter()
            .map(|r| {
                let normal = self.receivers.index.supports()[r].point.normal;
                let (rows, r) = self.receivers.row(r);
                let lattice = rows::lattice(rows.rays);
                let directions = Directions::new(normal, rows.keys[r], rows.rays);
                let of_sky = |(at, &met): (&LatticePoint, &u32)| {
                    (met == SKY).then(|| self.ray_light(SKY, || directions.at(*at), &[]))
                };
                lattice.iter().zip(rows.row(r)).filter_map(of_sky).sum::<Rgb>() / rows.rays as f32
            })
            .collect()
    }

    /// The light of any row at a normal; `seen` is room to work in.
    pub fn row_light(
        &self,
        (rows, r): (&Rows, usize),
        normal: Vec3,
        radiosity: &[Rgb],
        seen: &mut Vec<Rgb>,
    ) -> RowLight {
        self.look((rows, r), normal, radiosity, seen);
        RowLight::new((rows, r), normal, seen)
    }

    /// What every ray of a row brings, in lattice order; lost rays bring the mean of the others that met surfaces.
    pub(super) fn look(
        &self,
        (rows, r): (&Rows, usize),
        normal: Vec3,
        radiosity: &[Rgb],
        seen: &mut Vec<Rgb>,
    ) {
        let directions = Directions::new(normal, rows.keys[r], rows.rays);
        let lattice = rows::lattice(rows.rays);
        let light = |(at, &met): (&LatticePoint, &u32)| self.ray_light(met, || directions.at(*at), radiosity);
        seen.clear();
        seen.extend(lattice.iter().zip(rows.row(r)).map(light));
        let met = rows.row(r);
        if met.contains(&LOST) {
            let known = || seen.iter().zip(met).filter(|(_, met)| **met != SKY && **met != LOST);
            let mean = known().map(|(light, _)| *light).sum::<Rgb>() / known().count().max(1) as f32;
            seen.iter_mut().zip(met).filter(|(_, met)| **met == LOST).for_each(|(light, _)| *light = mean);
        }
    }
}

impl RowLight {
    /// Sums up what a row's rays bring.
    pub(super) fn new((rows, r): (&Rows, usize), normal: Vec3, seen: &[Rgb]) -> Self {
        let directions = Directions::new(normal, rows.keys[r], rows.rays);
        let lattice = rows::lattice(rows.rays);
        let irradiance = seen.iter().copied().sum::<Rgb>() / rows.rays as f32;
        let mut gradient = Mat3::ZERO;
        for (at, light) in lattice.iter().zip(seen) {
            let direction = directions.at(*at);
            // Levers average to nothing, but for the lattice's noise: uniform light must not turn.
            let b = *light - irradiance;
            let cosine = direction.dot(normal);
            let lever = (direction - normal * cosine) / cosine.max(FLATTEST);
            gradient += Mat3::from_cols(b * lever.x, b * lever.y, b * lever.z);
        }
        let apart = |pair: &[Rgb]| mean_channel(pair[0] - pair[1]).powi(2);
        let square: f32 = seen.chunks_exact(2).map(apart).sum();
        Self {
            irradiance,
            gradient: gradient * (1.0 / rows.rays as f32),
            sky_visibility: rows.summaries[r].escaped as f32 / rows.rays as f32,
            noise: lattice_gain(rows.rays) * square.sqrt() / rows.rays as f32,
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
