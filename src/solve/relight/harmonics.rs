//! What skies of spherical harmonics send to receivers, through the rays of their rows that escape.

use glam::Mat3;
use rayon::prelude::*;

use super::Problem;
use crate::light::harmonics::{MOST, basis};
use crate::links::rows::{self, Directions, SKY};

impl Problem<'_> {
    /// Irradiance at receivers straight from skies whose radiance is one of the harmonics each, of the first `order` bands; `frame`
    /// turns directions of the scene into theirs ([`crate::scene::sky::to_harmonics`]). Negative in places.
    ///
    /// Cost: one look at the rows' escaped rays for all of them; none are traced. Memory: 4 B a receiver and function.
    ///
    /// # Panics
    /// When there are no so many bands.
    pub fn harmonic_light(&self, frame: Mat3, order: usize) -> Vec<Vec<f32>> {
        let row = |r: usize| {
            let normal = self.receivers.index.supports()[r].point.normal;
            let (rows, r) = self.receivers.row(r);
            let directions = Directions::new(normal, rows.keys[r], rows.rays);
            let mut sums = [0.0f32; MOST];
            for (at, _) in rows::lattice(rows.rays).iter().zip(rows.row(r)).filter(|(_, met)| **met == SKY) {
                let values = basis(frame * directions.at(*at));
                sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
            }
            sums.map(|sum| sum * (std::f32::consts::PI / rows.rays as f32))
        };
        let all: Vec<[f32; MOST]> =
            (0..self.receivers.len()).into_par_iter().with_min_len(64).map(row).collect();
        (0..order * order).map(|number| all.iter().map(|sums| sums[number]).collect()).collect()
    }
}
