//! Points that lie so close together that they share rows, as the vertices of a scan do: where receivers are not believed,
//! rows are gathered at some of the points, and the others interpolate between those.
//!
//! This work is based on: Lehtinen et al., "A Meshless Hierarchical Representation for Light Transport", SIGGRAPH 2008
//! (finer levels where coarser ones, interpolated, would miss the light). A level halves the spacing of rows around the
//! points that still disagree; what a point costs falls with the density of points, since rows follow the light.

use glam::Mat3;
use rayon::prelude::*;
use smallvec::SmallVec;

use super::field::{self, BETWEEN, FEWEST, Field, First, Irradiance};
use super::light::RowLight;
use crate::geometry::SurfacePoint;
use crate::light::{Rgb, mean_channel};
use crate::tree::Support;
use crate::tree::index::{REACH, SupportIndex};
use crate::tree::mls::{self, Sign};

/// Radius of the first shared rows over the spacing of the site below them.
const FIRST_RADIUS: f32 = 0.7;

/// Halvings of that radius at the most.
const LEVELS: u32 = 5;

/// Points gather for themselves where a level would need a row for less than so many of them.
const WORTH: usize = 3;

/// Where too few rows are around to tell, light may change by this much of the solution's level over the spacing of sites:
/// by a share of itself, dark points would speak for lit ones.
const UNTOLD: f32 = 1.0;

/// A shared row: what it brings, and what the others around it would have said.
#[derive(Clone, Copy)]
struct Shared {
    irradiance: Rgb,
    gradient: Mat3,
    sky_visibility: f32,
    noise: f32,
    surplus: f32,
}

/// The shared rows of some points.
#[derive(Default)]
struct Crowd {
    supports: Vec<Support>,
    index: SupportIndex,
    rows: Vec<Shared>,
}

impl Field<'_> {
    /// As [`Field::evaluate`], for points that are dense; the answers depend on which points are asked together, not on the
    /// number of threads.
    ///
    /// Cost: one short ray and one fit a point, two where receivers disagree; rows there by the light's complexity.
    pub fn evaluate_crowd(&self, points: &[SurfacePoint]) -> Vec<Irradiance> {
        let firsts: Vec<First> = points.par_iter().with_min_len(64).map(|p| self.first(p)).collect();
        let mut answers: Vec<Irradiance> = firsts.iter().map(|f| f.blended).collect();
        let mut open: Vec<usize> = (0..points.len()).filter(|&k| !firsts[k].trusted).collect();
        let mut crowd = Crowd::default();
        let mut radius = FIRST_RADIUS;
        for _ in 0..LEVELS {
            let fresh = crowd.uncovered(&firsts, &open, radius);
            if WORTH * fresh.len() > open.len() {
                break;
            }
            let gather = |&k: &usize| self.gather_at(&firsts[k]);
            let rows: Vec<RowLight> = fresh.par_iter().with_min_len(4).map(gather).collect();
            let level = self.solution.level;
            crowd.add((&firsts, &fresh), &rows, (radius, level));
            let most = self.params.doubt * level;
            let shared =
                |&k: &usize| crowd.at(&firsts[k], radius * level).filter(|light| light.error <= most);
            let found: Vec<Option<Irradiance>> = open.par_iter().with_min_len(64).map(shared).collect();
            let mut left = Vec::new();
            for (&k, found) in open.iter().zip(found) {
                match found {
                    Some(light) => answers[k] = light,
                    None => left.push(k),
                }
            }
            open = left;
            radius *= 0.5;
        }
        let own = |&k: &usize| {
            let RowLight { irradiance: indirect, sky_visibility, noise: error, .. } =
                self.gather_at(&firsts[k]);
            Irradiance { direct: firsts[k].blended.direct, indirect, sky_visibility, error }
        };
        let gathered: Vec<Irradiance> = open.par_iter().with_min_len(4).map(own).collect();
        open.into_iter().zip(gathered).for_each(|(k, light)| answers[k] = light);
        answers
    }
}

impl Crowd {
    /// The open points that need a row, so that each is within a radius of one: in their order, as far apart as that.
    fn uncovered(&self, firsts: &[First], open: &[usize], radius: f32) -> Vec<usize> {
        let halved = |s: &Support| Support { radius: 0.5 * s.radius, ..*s };
        let mut index = SupportIndex::new(&self.supports.iter().map(halved).collect::<Vec<_>>());
        let mut fresh = Vec::new();
        for &k in open {
            let point = firsts[k].set;
            let mut covered = false;
            index.for_each(&point, 1.0, |_, _| covered = true);
            if !covered {
                index.push(Support { point, radius: radius * firsts[k].spacing });
                fresh.push(k);
            }
        }
        fresh
    }

    /// Takes in the rows of fresh points; those that are there speak for half as far from now on.
    fn add(&mut self, (firsts, fresh): (&[First], &[usize]), rows: &[RowLight], (radius, level): (f32, f32)) {
        self.supports.iter_mut().for_each(|s| s.radius *= 0.5);
        for (&k, row) in fresh.iter().zip(rows) {
            self.supports.push(Support { point: firsts[k].set, radius: radius * firsts[k].spacing });
            self.rows.push(Shared {
                irradiance: row.irradiance,
                gradient: row.gradient,
                sky_visibility: row.sky_visibility,
                noise: row.noise,
                surplus: f32::INFINITY,
            });
        }
        self.index = SupportIndex::new(&self.supports);
        let surplus = |r: usize| {
            let without = self.fitted(&self.supports[r].point, Some(r));
            let own = self.rows[r].irradiance;
            let unknown = UNTOLD * radius * level;
            without.map_or(unknown, |(light, ..)| mean_channel(light - own).abs())
        };
        let surpluses: Vec<f32> =
            (0..self.rows.len()).into_par_iter().with_min_len(64).map(surplus).collect();
        self.rows.iter_mut().zip(surpluses).for_each(|(row, surplus)| row.surplus = surplus);
    }

    /// Irradiance fitted to the rows around a point but for one, and by which weights; None where they are too few.
    fn fitted(
        &self,
        at: &SurfacePoint,
        but: Option<usize>,
    ) -> Option<(Rgb, SmallVec<[(f32, u32); 32]>, mls::Fit)> {
        let mut near: SmallVec<[(f32, u32); 32]> = SmallVec::new();
        self.index.for_each(at, REACH, |id, distance| {
            if but != Some(id as usize) {
                near.push((distance, id));
            }
        });
        if near.len() < FEWEST {
            return None;
        }
        near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        near.truncate(mls::MOST);
        let supports: SmallVec<[Support; mls::MOST]> =
            near.iter().map(|n| self.supports[n.1 as usize]).collect();
        let fit = mls::fit(at, &supports, Sign::Any);
        if fit.weights.is_empty() {
            return None;
        }
        let value = |(n, w): (&(f32, u32), &f32)| {
            let row = &self.rows[n.1 as usize];
            (row.irradiance + row.gradient * (at.normal - self.supports[n.1 as usize].point.normal)) * *w
        };
        let light = near.iter().zip(&fit.weights).map(value).sum();
        Some((light, near, fit))
    }

    /// The light at a point by the rows around it, and how sure it is; None where they are too few.
    fn at(&self, first: &First, untold: f32) -> Option<Irradiance> {
        let Some((indirect, near, fit)) = self.fitted(&first.set, None) else {
            return self.nearest(first, untold);
        };
        let (mut bias, mut noise, mut sky) = (0.0, 0.0, 0.0);
        for (n, w) in near.iter().zip(&fit.weights) {
            let row = &self.rows[n.1 as usize];
            bias += (BETWEEN * row.surplus).powi(2) * w.abs();
            noise += (row.noise * w).powi(2);
            sky += row.sky_visibility * w;
        }
        let negative = indirect.min_element() < 0.0;
        let error = if negative { f32::INFINITY } else { (bias + noise).sqrt() * field::outside(&fit) };
        Some(Irradiance {
            direct: first.blended.direct,
            indirect: indirect.max(Rgb::ZERO),
            sky_visibility: sky.clamp(0.0, 1.0),
            error,
        })
    }

    /// The light of the row that covers a point, turned to the point's normal; light may change by `untold` over a radius.
    fn nearest(&self, first: &First, untold: f32) -> Option<Irradiance> {
        let mut best = (1.0, usize::MAX);
        self.index.for_each(&first.set, 1.0, |id, distance| {
            best = if distance < best.0 { (distance, id as usize) } else { best };
        });
        let (distance, row) = (best.0, self.rows.get(best.1)?);
        let turned = row.gradient * (first.set.normal - self.supports[best.1].point.normal);
        let indirect = (row.irradiance + turned).max(Rgb::ZERO);
        // What the turn changes is known to no better than a part of itself.
        let error = row.noise.hypot(UNTOLD * (untold * distance + mean_channel(turned).abs()));
        Some(Irradiance { direct: first.blended.direct, indirect, sky_visibility: row.sky_visibility, error })
    }
}
