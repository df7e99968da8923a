//! The operator's product in three calls: pull, gather, push.

use rayon::prelude::*;

use crate::light::Rgb;
use crate::links::receivers::Spread;
use crate::links::rows::{FIRST_MARK, LOST, Rows};

/// The linear map from irradiance at receivers to irradiance at receivers, one bounce later.
///
/// H′ = G·ρ·P·H, without lamps and sky. ‖GP‖∞ ≤ 1, so the spectral radius is at most the largest albedo.
pub struct Transport<'a> {
    /// Rows G.
    pub rows: &'a Rows,
    /// Interpolation P.
    pub spread: &'a Spread,
    /// ρ per site.
    pub albedo: &'a [Rgb],
}

impl Transport<'_> {
    /// Interpolates irradiance from receivers to sites: P·H. Sites without receivers get none.
    pub fn push(&self, receivers: &[Rgb]) -> Vec<Rgb> {
        (0..self.albedo.len())
            .into_par_iter()
            .with_min_len(1024)
            .map(|site| {
                let weights = self.spread.weights_of(site);
                self.spread
                    .receivers_of(site)
                    .iter()
                    .zip(weights)
                    .map(|(&r, &w)| receivers[r as usize] * w)
                    .sum()
            })
            .collect()
    }

    /// Radiosity that leaves the sites under the given irradiance: ρ·H + E.
    pub fn pull(&self, irradiance: &[Rgb], own: Option<&[Rgb]>) -> Vec<Rgb> {
        let reflected = |site: usize| self.albedo[site] * irradiance[site];
        (0..self.albedo.len())
            .into_par_iter()
            .with_min_len(4096)
            .map(|site| reflected(site) + own.map_or(Rgb::ZERO, |own| own[site]))
            .collect()
    }

    /// Irradiance at receivers from the sites' radiosity: G·B.
    pub fn gather(&self, radiosity: &[Rgb]) -> Vec<Rgb> {
        (0..self.rows.len())
            .into_par_iter()
            .with_min_len(64)
            .map(|r| {
                let mut sum = Rgb::ZERO;
                let mut live = 0u32;
                for &m in self.rows.row(r) {
                    live += u32::from(m != LOST);
                    if m < FIRST_MARK {
                        sum += radiosity[m as usize];
                    }
                }
                sum / live.max(1) as f32
            })
            .collect()
    }

    /// One bounce: H ↦ G·ρ·P·H.
    pub fn apply(&self, receivers: &[Rgb]) -> Vec<Rgb> {
        self.gather(&self.pull(&self.push(receivers), None))
    }
}
