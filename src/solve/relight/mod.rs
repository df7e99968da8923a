//! Relighting: other lights and other albedos through the rows that there are.
//!
//! This work is based on: Sloan, Kautz and Snyder, "Precomputed Radiance Transfer for Real-Time Rendering in Dynamic,
//! Low-Frequency Lighting Environments", SIGGRAPH 2002 (light adds up: what unit lights do is found once and weighed
//! afterwards), and Lehtinen et al. 2008. Unlike there, a transfer belongs to a light of the scene and holds all sites.

mod bounce;
mod harmonics;
mod links;
mod together;

pub use links::Links;
pub use together::{TogetherParams, solve_together};

use rayon::prelude::*;

use super::{Problem, Solution};
use crate::light::Rgb;

/// A light before any interreflection.
#[derive(Debug, Clone, PartialEq)]
pub struct Source {
    /// Radiosity of the sites: their glow, and the lamps' light reflected once, W·m⁻².
    pub own: Vec<Rgb>,
    /// Irradiance at receivers straight from the sky, W·m⁻²; empty without a sky.
    pub sky: Vec<Rgb>,
}

/// What a light does everywhere, interreflections included.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Transfer {
    /// Irradiance at receivers from surfaces and sky, W·m⁻².
    pub irradiance: Vec<Rgb>,
    /// Radiosity per site, without the lamps' own exitance, W·m⁻².
    pub radiosity: Vec<Rgb>,
}

/// Values added up by one task.
const RUN: usize = 4096;

impl Problem<'_> {
    /// Irradiance of the sites straight from the lamps, W·m⁻². Cost: the lamp links.
    pub fn lamplight(&self) -> Vec<Rgb> {
        let site = |site| self.direct.at_site(self.lamps, site);
        (0..self.around.sites.len()).into_par_iter().with_min_len(64).map(site).collect()
    }

    /// Irradiance at receivers straight from the sky, W·m⁻². Cost: the rows' escaped rays; none are traced.
    pub fn skylight(&self) -> Vec<Rgb> {
        self.sky_light()
    }

    /// Everything that answers at points need, from irradiance at receivers that was found before.
    ///
    /// Cost: one product with directions and a fit a receiver: several products of the solver.
    pub fn completed(&self, irradiance: Vec<Rgb>) -> Solution {
        self.complete(irradiance, &self.unreflected())
    }
}

/// Adds up transfers, each times its light by channel, into `irradiance` and `radiosity`, which are overwritten.
///
/// Exact but for rounding, ε a transfer. Cost: memory's: 12 B a transfer and value.
pub fn superpose(transfers: &[(&Transfer, Rgb)], irradiance: &mut [Rgb], radiosity: &mut [Rgb]) {
    let parts: Vec<(&[Rgb], Rgb)> = transfers.iter().map(|(c, light)| (&c.irradiance[..], *light)).collect();
    add_up(&parts, irradiance);
    let parts: Vec<(&[Rgb], Rgb)> = transfers.iter().map(|(c, light)| (&c.radiosity[..], *light)).collect();
    add_up(&parts, radiosity);
}

fn add_up(parts: &[(&[Rgb], Rgb)], sum: &mut [Rgb]) {
    sum.par_chunks_mut(RUN).enumerate().for_each(|(run, sum)| {
        let own = run * RUN..run * RUN + sum.len();
        let Some(((first, light), others)) = parts.split_first() else {
            return sum.fill(Rgb::ZERO);
        };
        sum.iter_mut().zip(&first[own.clone()]).for_each(|(sum, value)| *sum = *value * *light);
        for (values, light) in others {
            sum.iter_mut().zip(&values[own.clone()]).for_each(|(sum, value)| *sum += *value * *light);
        }
    });
}
