//! Residuals interpolated over nested subsets, coarse to fine, every level with functions as wide as it is sparse.
//!
//! This work is based on: Floater and Iske, "Multistep scattered data interpolation using compactly supported radial basis
//! functions", 1996. The systems' condition does not grow with the number of points, because width over spacing is the same on
//! every level; errors fall from level to level because what is left is ever smaller.

use super::kernels::Space;
use super::levels::{self, Level};
use super::radial::{Kernel, Widths};
use super::system::System;
use super::{Reconstruction, add};
use crate::geometry::SurfacePoint;
use crate::scatter::octaves::Octaves;
use crate::tree::Support;

/// The ladder of levels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Steps {
    /// Spacing of the coarsest level, local units; it halves from level to level.
    pub coarsest: f32,
    /// Levels at the most.
    pub most: usize,
    /// Width of a function over its level's spacing.
    pub reach: f32,
    /// Whether normals count.
    pub with_normals: bool,
    /// Added to the diagonal; zero interpolates.
    pub ridge: f64,
}

/// Levels over the program's supports: down to a 4096th of the coarsest spacing. Points closer than that are one.
const MOST_LEVELS: usize = 13;

/// Width over spacing over the program's supports: 3 errs a twentieth more.
const GRADED_REACH: f32 = 4.0;

/// Added to the diagonal over the program's supports, whose rows are noisy.
const GRADED_RIDGE: f64 = 0.1;

impl Steps {
    /// Steps for graded supports: from twice the largest radius down until every support is a member.
    pub fn graded(supports: &[Support]) -> Self {
        let largest = supports.iter().map(|s| s.radius).fold(0.0, f32::max);
        Self {
            coarsest: 2.0 * largest,
            most: MOST_LEVELS,
            reach: GRADED_REACH,
            with_normals: true,
            ridge: GRADED_RIDGE,
        }
    }
}

/// A sum of interpolants: s = mean + Σ_l s_l, s_l through what the coarser levels leave at level l's members.
pub struct Multistep<const C: usize> {
    mean: [f64; C],
    rungs: Vec<Rung<C>>,
}

struct Rung<const C: usize> {
    kernel: Kernel,
    coefficients: Vec<[f64; C]>,
    system: System,
    spacing: f32,
}

impl<const C: usize> Multistep<C> {
    /// Interpolates values at the points of supports; their radii do not matter. Errors with a description when a level cannot
    /// be factored.
    pub fn fit(supports: &[Support], values: &[[f64; C]], steps: &Steps) -> Result<Self, String> {
        assert_eq!(supports.len(), values.len(), "a value per support");
        let points: Vec<SurfacePoint> = supports.iter().map(|s| s.point).collect();
        let mut mean = [0.0; C];
        values.iter().for_each(|v| add(&mut mean, 1.0 / values.len() as f64, v));
        let mut made = Self { mean, rungs: Vec::new() };
        let space = |spacing| {
            if steps.with_normals { Space::parting(steps.reach * spacing) } else { Space { turn: 0.0 } }
        };
        let mut before = 0;
        for level in levels::nested(&points, steps.coarsest, steps.most, space) {
            let stirred = stirred(&points, &level, before, steps.reach * level.spacing);
            before = level.members.len();
            let members: Vec<SurfacePoint> = stirred.iter().map(|&m| points[m as usize]).collect();
            let mut left: Vec<[f64; C]> = stirred.iter().map(|&m| values[m as usize]).collect();
            let coarser = made.evaluate(&members);
            left.iter_mut().zip(coarser).for_each(|(v, s)| add(v, -1.0, &s.unwrap_or(mean)));
            made.rungs.push(Rung::fit(&members, &left, level.spacing, steps)?);
        }
        Ok(made)
    }

    /// Estimates the condition number of every level's system, with its spacing and the number of its members.
    pub fn conditions(&self) -> Vec<(f32, usize, f64)> {
        self.rungs.iter().map(|r| (r.spacing, r.system.len(), r.system.condition())).collect()
    }
}

/// The members of a level that functions are needed for: those from number `before` on, which are new, and the others within a
/// function's width of them. What is left at the rest is zero already, and no new function reaches it.
fn stirred(points: &[SurfacePoint], level: &Level, before: usize, width: f32) -> Vec<u32> {
    let (old, new) = level.members.split_at(before);
    let mut near = Octaves::default();
    new.iter().for_each(|&m| near.push(m, points[m as usize].position, width));
    let reached = |m: &&u32| {
        let at = points[**m as usize].position;
        let mut reached = false;
        near.for_each(at, |o| reached |= points[o as usize].position.distance(at) < width);
        reached
    };
    new.iter().chain(old.iter().filter(reached)).copied().collect()
}

impl<const C: usize> Rung<C> {
    fn fit(members: &[SurfacePoint], left: &[[f64; C]], spacing: f32, steps: &Steps) -> Result<Self, String> {
        let widths = Widths { unit: spacing, reach: steps.reach, with_normals: steps.with_normals };
        let kernel = Kernel::new(members, vec![0.0; members.len()], None, widths);
        let mut rows = kernel.rows();
        rows.iter_mut().enumerate().for_each(|(i, row)| row.push((i, steps.ridge)));
        let system = System::factor(rows)?;
        let coefficients = system.solve(left);
        Ok(Self { kernel, coefficients, system, spacing })
    }
}

impl<const C: usize> Reconstruction<C> for Multistep<C> {
    fn at(&self, point: &SurfacePoint) -> Option<[f64; C]> {
        let mut sum = self.mean;
        let mut reached = false;
        for rung in &self.rungs {
            rung.kernel.for_each(point, |j, weight| {
                add(&mut sum, weight, &rung.coefficients[j]);
                reached = true;
            });
        }
        reached.then_some(sum)
    }
}
