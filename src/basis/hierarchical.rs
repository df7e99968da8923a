//! Residual levels of normalised compact weights: no system to solve.
//!
//! This work is based on: Lehtinen, Zwicker, Turquin, Kontkanen, Durand, Sillion and Aila, "A Meshless Hierarchical
//! Representation for Light Transport", 2008. Weights of a level fade to nothing where its members end, instead of being
//! normalised by the coarser levels' too.

use super::kernels::{Space, wendland3};
use super::levels::{self, Level};
use super::{Reconstruction, add};
use crate::geometry::SurfacePoint;
use crate::tree::Support;
use crate::tree::index::{REACH, SupportIndex};

/// The ladder of levels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ladder {
    /// Spacing of the coarsest level, local units; it halves from level to level.
    pub coarsest: f32,
    /// Levels at the most.
    pub most: usize,
    /// Width of a weight over its level's spacing; above 1, or there are holes between a level's members.
    pub reach: f32,
}

/// A sum of averages: s = Σ_l s_l, s_l the average of what the coarser levels leave at level l's members.
pub struct Residuals<const C: usize> {
    rungs: Vec<Rung<C>>,
}

struct Rung<const C: usize> {
    index: SupportIndex,
    left: Vec<[f64; C]>,
    /// Weights that sum to less fade out.
    least: f64,
}

impl<const C: usize> Residuals<C> {
    /// Fits values at the points of supports; their radii do not matter. Distances are [`Support::distance`].
    pub fn fit(supports: &[Support], values: &[[f64; C]], ladder: &Ladder) -> Self {
        assert_eq!(supports.len(), values.len(), "a value per support");
        let points: Vec<SurfacePoint> = supports.iter().map(|s| s.point).collect();
        let mut made = Self { rungs: Vec::new() };
        for level in levels::nested(&points, ladder.coarsest, ladder.most, |_| Space { turn: 0.0 }) {
            let mut rung = Rung::new(&points, &level, ladder);
            let members: Vec<SurfacePoint> = level.members.iter().map(|&m| points[m as usize]).collect();
            let coarser = made.evaluate(&members);
            rung.left = level.members.iter().map(|&m| values[m as usize]).collect();
            let left = rung.left.iter_mut().zip(coarser);
            left.for_each(|(v, s)| add(v, -1.0, &s.unwrap_or([0.0; C])));
            made.rungs.push(rung);
        }
        made
    }
}

impl<const C: usize> Rung<C> {
    fn new(points: &[SurfacePoint], level: &Level, ladder: &Ladder) -> Self {
        let radius = ladder.reach * level.spacing / REACH;
        let support = |&m: &u32| Support { point: points[m as usize], radius };
        let supports: Vec<Support> = level.members.iter().map(support).collect();
        // A member lies within one spacing of every point that the level covers: its weight alone is at least this.
        let least = wendland3(1.0 / f64::from(ladder.reach));
        Self { index: SupportIndex::new(&supports), left: Vec::new(), least }
    }
}

impl<const C: usize> Reconstruction<C> for Residuals<C> {
    fn at(&self, point: &SurfacePoint) -> Option<[f64; C]> {
        let mut all = None;
        for rung in &self.rungs {
            let (mut sum, mut total) = ([0.0; C], 0.0);
            rung.index.for_each(point, REACH, |id, distance| {
                let weight = wendland3(f64::from(distance / REACH));
                add(&mut sum, weight, &rung.left[id as usize]);
                total += weight;
            });
            if total > 0.0 {
                // The first level that reaches carries the constants: it never fades.
                let least = if all.is_some() { rung.least } else { 0.0 };
                add(all.get_or_insert([0.0; C]), 1.0 / total.max(least), &sum);
            }
        }
        all
    }
}
