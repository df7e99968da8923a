//! Averages: local weights that sum to one, no system to solve.
//!
//! This work is based on: Shepard, "A two-dimensional interpolation function for irregularly-spaced data", 1968, and Franke and
//! Nielson, "Smooth interpolation of large sets of scattered data", 1980 (the weights of Franke and Little). Distances are
//! [`Support::distance`], in radii.

use smallvec::SmallVec;

use super::kernels::{franke_little, wendland3};
use super::{Reconstruction, add};
use crate::geometry::SurfacePoint;
use crate::tree::Support;
use crate::tree::index::{REACH, SupportIndex};
use crate::tree::mls::{self, Sign};

/// How a support's weight falls with distance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shepard {
    /// ((R − d)₊ / (R d))², R = 2 radii: interpolates, flat at supports.
    FrankeLittle,
    /// 1/d over all supports, however far: the seed paper's example, a bad one. Σ 1/d over a surface is made by the supports far
    /// away, so that it does not converge to anything local as supports get denser. For comparison only.
    InverseDistance,
    /// Wendland's function over 2 radii: an average even at supports, which smooths noise.
    Compact,
}

impl Shepard {
    /// The weight at a distance in radii.
    pub fn weight(self, distance: f32) -> f64 {
        let d = f64::from(distance);
        match self {
            Self::FrankeLittle => franke_little(d, f64::from(REACH)),
            Self::InverseDistance => 1.0 / d.max(1e-9),
            Self::Compact => wendland3(d / f64::from(REACH)),
        }
    }
}

/// Franke–Little weights of supports at a point; non-negative, they sum to one. Empty when no support reaches.
pub fn weights(at: &SurfacePoint, supports: &[Support]) -> SmallVec<[f32; mls::MOST]> {
    let raw: SmallVec<[f64; mls::MOST]> =
        supports.iter().map(|s| Shepard::FrankeLittle.weight(s.distance(at))).collect();
    let sum: f64 = raw.iter().sum();
    if sum > 0.0 { raw.iter().map(|w| (w / sum) as f32).collect() } else { SmallVec::new() }
}

/// Values averaged by a law of weights: a partition of unity, within the range of its data.
pub struct Averaged<const C: usize> {
    law: Shepard,
    index: SupportIndex,
    values: Vec<[f64; C]>,
}

impl<const C: usize> Averaged<C> {
    /// Over the given supports and their values.
    pub fn new(law: Shepard, supports: &[Support], values: &[[f64; C]]) -> Self {
        assert_eq!(supports.len(), values.len(), "a value per support");
        Self { law, index: SupportIndex::new(supports), values: values.to_vec() }
    }
}

impl<const C: usize> Reconstruction<C> for Averaged<C> {
    fn at(&self, point: &SurfacePoint) -> Option<[f64; C]> {
        let (mut sum, mut total) = ([0.0; C], 0.0);
        let mut visit = |id: u32, distance: f32| {
            let weight = self.law.weight(distance);
            add(&mut sum, weight, &self.values[id as usize]);
            total += weight;
        };
        if self.law == Shepard::InverseDistance {
            self.index.supports().iter().enumerate().for_each(|(id, s)| visit(id as u32, s.distance(point)));
        } else {
            self.index.for_each(point, REACH, visit);
        }
        (total > 0.0).then(|| sum.map(|s| s / total))
    }
}

/// A linear fit by moving least squares of the nearest supports, [`mls`]: second order, what the program's default adds its
/// rotational gradients to.
pub struct Linear<const C: usize> {
    sign: Sign,
    index: SupportIndex,
    values: Vec<[f64; C]>,
}

impl<const C: usize> Linear<C> {
    /// Over the given supports and their values.
    pub fn new(sign: Sign, supports: &[Support], values: &[[f64; C]]) -> Self {
        assert_eq!(supports.len(), values.len(), "a value per support");
        Self { sign, index: SupportIndex::new(supports), values: values.to_vec() }
    }
}

impl<const C: usize> Reconstruction<C> for Linear<C> {
    fn at(&self, point: &SurfacePoint) -> Option<[f64; C]> {
        let mut found = Vec::new();
        self.index.nearest(point, REACH, &mut found);
        found.truncate(mls::MOST);
        let near: SmallVec<[Support; mls::MOST]> =
            found.iter().map(|f| self.index.supports()[f.1 as usize]).collect();
        let weights = mls::weights(point, &near, self.sign);
        if weights.is_empty() {
            return None;
        }
        let mut sum = [0.0; C];
        for ((_, id), weight) in found.iter().zip(&weights) {
            add(&mut sum, f64::from(*weight), &self.values[*id as usize]);
        }
        Some(sum)
    }
}
