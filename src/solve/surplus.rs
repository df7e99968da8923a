//! What receivers would lose if they were left out, and what of it is more than noise.
//!
//! This work is based on: Lehtinen et al., "A Meshless Hierarchical Representation for Light Transport", SIGGRAPH 2008
//! (refinement by what the coarser level misses).

use rayon::prelude::*;

use super::field::BETWEEN;
use super::{Problem, Solution, field};
use crate::light::mean_channel;
use crate::sites::SiteId;

/// The surplus of a receiver with too few others around it: huge, but its square is finite.
const UNKNOWN: f32 = 1.0e18;

/// Relative error of interpolation where there are too few receivers to tell.
const UNSURE: f32 = 0.2;

/// How many receivers' surpluses are averaged to tell bias from noise.
const AVERAGED: usize = 8;

/// Variance of a surplus that is all noise, over that of a row: the row's own and the fit's.
const NOISE_SHARE: f32 = 1.4;

impl Problem<'_> {
    /// Leave-one-out: how far each receiver's own row is from what its neighbours would have said.
    pub fn surplus(&self, solution: &Solution) -> Vec<f32> {
        (0..self.receivers.len())
            .into_par_iter()
            .with_min_len(16)
            .map(|r| {
                let site = self.receivers.homes[r].index();
                let others: Vec<u32> =
                    self.spread.receivers_of(site).iter().copied().filter(|&o| o as usize != r).collect();
                let at = self.receivers.index.supports()[r].point;
                // Too few others to tell: the receiver vouches for nothing around it.
                if others.len() < field::FEWEST {
                    return UNKNOWN;
                }
                match field::interpolate(self, solution, &at, &others) {
                    Some(fit) => (mean_channel(fit - solution.irradiance[r])).abs(),
                    None => UNKNOWN,
                }
            })
            .collect()
    }

    /// Per receiver the error of interpolation around it, noise taken out, as a standard error of the mean channel.
    pub fn bias(&self, solution: &Solution) -> Vec<f32> {
        (0..self.receivers.len())
            .into_par_iter()
            .with_min_len(64)
            .map(|r| {
                if solution.surplus[r] >= UNKNOWN {
                    return UNSURE * mean_channel(solution.irradiance[r]);
                }
                let near = self.spread.receivers_of(self.receivers.homes[r].index());
                let (mut square, mut noise, mut count) = (0.0, 0.0, 0.0);
                let known = |o: &&u32| solution.surplus[**o as usize] < UNKNOWN;
                for &o in near.iter().take(AVERAGED).filter(known).chain(std::iter::once(&(r as u32))) {
                    square += solution.surplus[o as usize].powi(2);
                    noise += solution.noise[o as usize].powi(2);
                    count += 1.0;
                }
                BETWEEN * ((square - NOISE_SHARE * noise).max(0.0) / count).sqrt()
            })
            .collect()
    }

    /// The sites that see no receiver, and those whose own rows would bring the error of sites below `limit`, a relative RMS
    /// error weighed by how much surfaces exchange light there: those that claim the most, as few as it takes.
    pub fn doubtful_sites(&self, solution: &Solution, limit: f64) -> Vec<u32> {
        let exchange = self.exchange();
        let mut stakes: Vec<(f64, u32)> = (0..self.around.sites.len())
            .into_par_iter()
            .with_min_len(64)
            .map(|site| {
                let point = self.around.sites.point(SiteId(site as u32));
                let near = self.spread.receivers_of(site);
                if near.is_empty() {
                    return (f64::INFINITY, site as u32);
                }
                let claimed = field::claimed(self, solution, &point, near).min(solution.level);
                (exchange[site] * f64::from(claimed).powi(2), site as u32)
            })
            .collect();
        let allowed = (limit * f64::from(solution.level)).powi(2) * exchange.iter().sum::<f64>();
        let mut left: f64 = stakes.iter().map(|s| s.0).filter(|s| s.is_finite()).sum();
        stakes.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let above = |stake: &&(f64, u32)| {
            let ask = left > allowed || stake.0.is_infinite();
            left -= if stake.0.is_finite() { stake.0 } else { 0.0 };
            ask
        };
        let mut chosen: Vec<u32> = stakes.iter().take_while(above).map(|s| s.1).collect();
        chosen.sort_unstable();
        chosen
    }

    /// Per receiver the area that it speaks for, by how much sites make of it.
    pub fn areas_of_receivers(&self) -> Vec<f64> {
        let mut areas = vec![0.0; self.receivers.len()];
        for (site, &area) in self.around.sites.areas.iter().enumerate() {
            for (&r, &w) in self.spread.receivers_of(site).iter().zip(self.spread.weights_of(site)) {
                areas[r as usize] += f64::from(area * w);
            }
        }
        areas
    }
}
