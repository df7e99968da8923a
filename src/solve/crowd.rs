//! Points that lie so close together that they share rows, as the vertices of a scan do: rows are gathered at some of the
//! points, and the others interpolate between those.
//!
//! This work is based on: Lehtinen et al., "A Meshless Hierarchical Representation for Light Transport", SIGGRAPH 2008
//! (finer levels where coarser ones, interpolated, would miss the light), and Ward and Heckbert, "Irradiance Gradients",
//! 1992 (rows carry their change with the normal). A level halves the spacing of rows around the points that still disagree;
//! what a point costs falls with the density of points, since rows follow the light.

use glam::Mat3;
use rayon::prelude::*;
use smallvec::SmallVec;

use super::field::{self, BETWEEN, FEWEST, Field, First, Irradiance};
use super::light::RowLight;
use crate::geometry::SurfacePoint;
use crate::light::{Rgb, mean_channel};
use crate::links::direct::{DirectParams, Query};
use crate::tree::Support;
use crate::tree::index::{REACH, SupportIndex};
use crate::tree::mls::{self, Sign};

/// How willingly points share.
struct Sharing {
    /// Radius of the first rows over the spacing of the site below them.
    first: f32,
    /// Points answer for themselves where a level would need a row for less than so many of them.
    worth: f32,
    /// The disagreement of rows that is borne, over that of receivers.
    tolerance: f32,
}

/// Of points of full surfaces, which are many. A first radius of 0.5 takes 0.12 % off 3.1, a tolerance of 0.7 as much, both 0.22 %
/// for 40 % more time: what errs most there is what the rows say, not what is between them.
const FULL: Sharing = Sharing { first: 0.7, worth: 4.0, tolerance: 1.0 };

/// Of points in memory, which the receivers did not know: fewer, and held to more.
const HELD: Sharing = Sharing { first: 0.5, worth: 1.5, tolerance: 0.7 };

/// Halvings of that radius at the most.
const LEVELS: u32 = 4;

/// Where too few rows are around to tell, light may change by this much of its level over the spacing of sites: by a share of
/// itself, dark points would speak for lit ones.
const UNTOLD: f32 = 1.0;

/// Variance of what leaving a row out misses that is noise, over that of a row: its own and the fit's.
const NOISE_SHARE: f32 = 1.4;

/// Shares of the lamps' light that arrive at rows around a point differ by no more than this where none is in a penumbra.
const ALIKE: f32 = 0.1;

/// Shared rows have half the rays of others, but no fewer than this: a fit averages the noise of some ten of them.
const FEWEST_RAYS: u32 = 48;

/// Shadow rays of a shared row.
const SHADOW_RAYS: u32 = 16;

/// Doubt in a fit beyond its rows is not multiplied by more than this: rows turn with the normal by themselves.
const MOST_OUTSIDE: f32 = 3.0;

/// A shared row: what it brings, and what the others around it would have said.
#[derive(Clone, Copy)]
struct Shared {
    irradiance: Rgb,
    gradient: Mat3,
    /// The same of the light that is asked for, where another decides.
    own: Option<(Rgb, Mat3)>,
    sky_visibility: f32,
    noise: f32,
    surplus: f32,
    /// The share of the lamps' light that arrives; NaN where none would.
    arriving: f32,
}

/// A point with the number of the site below it and its spacing.
#[derive(Clone, Copy)]
struct Asked {
    point: SurfacePoint,
    site: Option<u32>,
    spacing: f32,
    /// Whether it lies in a slit or within another body.
    hidden: bool,
    /// The lamps' light, where it is known.
    direct: Option<Rgb>,
}

/// The shared rows of some points.
#[derive(Default)]
struct Crowd {
    index: SupportIndex,
    /// Rows by their numbers in the index.
    rows: Vec<Shared>,
    /// Mean irradiance of the rows, at least the solution's level.
    level: f32,
}

/// What the rows around a point say of the light that is not the lamps'.
struct Fitted {
    indirect: Rgb,
    /// The same of the light that is asked for, where another decides.
    own: Option<Rgb>,
    sky_visibility: f32,
    error: f32,
    arriving: Option<f32>,
}

/// Numbers of rows with their distances.
type Near = SmallVec<[(f32, u32); 32]>;

impl Field<'_> {
    /// As [`Field::evaluate`], for points of the surface that are dense; the answers depend on which points are asked together,
    /// not on the number of threads. Points that are not dense are answered as there.
    ///
    /// Cost: a short ray and a fit a point, rows by the light's complexity.
    pub fn evaluate_crowd(&self, points: &[SurfacePoint]) -> Vec<Irradiance> {
        if self.problem.around.bvh.near().is_some() { self.of_full(points) } else { self.of_held(points) }
    }

    /// For points of a full surface, of which the receivers know too little.
    fn of_full(&self, points: &[SurfacePoint]) -> Vec<Irradiance> {
        let asked: Vec<Asked> = points.par_iter().with_min_len(256).map(|p| self.asked(p)).collect();
        let mut answers = vec![Irradiance::default(); points.len()];
        let (placed, alone): (Vec<usize>, Vec<usize>) =
            (0..points.len()).partition(|&k| asked[k].spacing > 0.0);
        // Hidden points do not speak for those beside them, nor those for them.
        let (hidden, free): (Vec<usize>, Vec<usize>) = placed.into_iter().partition(|&k| asked[k].hidden);
        for together in [free, hidden] {
            let left = self.answer_together((&asked, together), &FULL, &mut answers);
            let light = |&k: &usize| self.complete(&asked[k], &self.share(&asked[k]).alone());
            let lights: Vec<Irradiance> = left.par_iter().with_min_len(4).map(light).collect();
            left.into_iter().zip(lights).for_each(|(k, light)| answers[k] = light);
        }
        let own: Vec<SurfacePoint> = alone.iter().map(|&k| points[k]).collect();
        alone.into_iter().zip(self.evaluate(&own)).for_each(|(k, light)| answers[k] = light);
        answers
    }

    /// For points of a scene in memory: those that the receivers do not know share rows.
    fn of_held(&self, points: &[SurfacePoint]) -> Vec<Irradiance> {
        let firsts: Vec<First> = points.par_iter().with_min_len(64).map(|p| self.first(p)).collect();
        let sites = self.problem.around.sites;
        let spacing = |first: &First| first.site.map_or(0.0, |site| sites.spacings[site as usize]);
        let asked = |first: &First| Asked {
            point: first.set,
            site: first.site,
            spacing: spacing(first),
            hidden: false,
            direct: Some(first.blended.direct),
        };
        let asked: Vec<Asked> = firsts.iter().map(asked).collect();
        let mut answers: Vec<Irradiance> = firsts.iter().map(|first| first.blended).collect();
        let doubted = (0..points.len()).filter(|&k| !firsts[k].trusted);
        let (placed, mut left): (Vec<usize>, Vec<usize>) = doubted.partition(|&k| asked[k].spacing > 0.0);
        left.extend(self.answer_together((&asked, placed), &HELD, &mut answers));
        let alone = |&k: &usize| self.alone(&firsts[k]);
        let lights: Vec<Irradiance> = left.par_iter().with_min_len(4).map(alone).collect();
        left.into_iter().zip(lights).for_each(|(k, light)| answers[k] = light);
        answers
    }

    /// Answers for some of the points by rows that they share, level by level; returns those that it does not pay for.
    fn answer_together(
        &self,
        (asked, mut open): (&[Asked], Vec<usize>),
        sharing: &Sharing,
        answers: &mut [Irradiance],
    ) -> Vec<usize> {
        let mut crowd = Crowd { level: self.judge().level, ..Crowd::default() };
        let mut radius = sharing.first;
        for _ in 0..LEVELS {
            let fresh = crowd.cover(asked, &open, radius);
            if sharing.worth * fresh.len() as f32 > open.len() as f32 {
                break;
            }
            let share = |&k: &usize| self.share(&asked[k]);
            let rows: Vec<Shared> = fresh.par_iter().with_min_len(4).map(share).collect();
            crowd.add(rows, radius);
            let most = sharing.tolerance * self.params.doubt * crowd.level;
            let answer = |&k: &usize| {
                let fitted = crowd.at(&asked[k].point, radius).filter(|fitted| fitted.error <= most)?;
                Some(self.complete(&asked[k], &fitted))
            };
            let found: Vec<Option<Irradiance>> = open.par_iter().with_min_len(64).map(answer).collect();
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
        open
    }

    fn asked(&self, point: &SurfacePoint) -> Asked {
        let around = self.problem.around;
        let site = around.site_below(point);
        let spacing = site.map_or(0.0, |site| around.sites.spacings[site.index()]);
        let hidden = around.bvh.is_hidden(point.position, point.normal);
        Asked { point: *point, site: site.map(|site| site.0), spacing, hidden, direct: None }
    }

    /// A point's own row, short, and the share of the lamps' light that arrives.
    fn share(&self, asked: &Asked) -> Shared {
        let rays = (self.params.rays / 2).max(FEWEST_RAYS);
        let gathered = |field: &Self| field.gather_row(&asked.point, field::key(&asked.point), rays).0;
        let (row, own) = match self.judged() {
            Some(judge) => (gathered(&judge), Some(gathered(self))),
            None => (gathered(self), None),
        };
        let own = own.map(|own| (own.irradiance, own.gradient));
        let RowLight { irradiance, gradient, sky_visibility, noise } = row;
        let open = match asked.direct {
            Some(_) => 0.0,
            None => mean_channel(self.problem.direct.open_at(self.problem.lamps, &asked.point)),
        };
        let arriving = if open > 0.0 {
            let first = self.params.direct.first.max(SHADOW_RAYS);
            let params = DirectParams { first, ..self.params.direct };
            mean_channel(self.direct(asked, &params)) / open
        } else {
            f32::NAN
        };
        Shared { irradiance, gradient, own, sky_visibility, noise, surplus: 0.0, arriving }
    }

    fn direct(&self, asked: &Asked, params: &DirectParams) -> Rgb {
        let key = field::key(&asked.point);
        let query = Query { point: asked.point, site: asked.site, rugged: true, key };
        let problem = &self.problem;
        problem.direct.at_point(problem.around.bvh, problem.lamps, params, &query)
    }

    /// With the lamps' light: as much of it as arrives at the rows around, or looked at where those differ.
    fn complete(&self, asked: &Asked, fitted: &Fitted) -> Irradiance {
        let direct = match (asked.direct, fitted.arriving) {
            (Some(direct), _) => direct,
            (None, Some(share)) => self.problem.direct.open_at(self.problem.lamps, &asked.point) * share,
            (None, None) => self.direct(asked, &self.params.direct),
        };
        let Fitted { sky_visibility, error, .. } = *fitted;
        let indirect = fitted.own.unwrap_or(fitted.indirect);
        Irradiance { direct, indirect, sky_visibility, error }
    }
}

impl Shared {
    /// What a row says that nobody shares.
    fn alone(&self) -> Fitted {
        let arriving = Some(self.arriving).filter(|share| !share.is_nan());
        let Self { irradiance: indirect, sky_visibility, noise: error, .. } = *self;
        Fitted { indirect, own: self.own.map(|(own, _)| own), sky_visibility, error, arriving }
    }
}

impl Crowd {
    /// Places rows so that each open point is within a radius of one: at those points, in their order, as far apart as that.
    /// Rows that are there speak for half as far from now on.
    fn cover(&mut self, asked: &[Asked], open: &[usize], radius: f32) -> Vec<usize> {
        let halved = |s: &Support| Support { radius: 0.5 * s.radius, ..*s };
        let halved: Vec<Support> = self.index.supports().iter().map(halved).collect();
        self.index = SupportIndex::new(&halved);
        let mut fresh = Vec::new();
        for &k in open {
            let Asked { point, spacing, .. } = asked[k];
            let mut covered = false;
            self.index.for_each(&point, 1.0, |_, _| covered = true);
            if !covered {
                self.index.push(Support { point, radius: radius * spacing });
                fresh.push(k);
            }
        }
        fresh
    }

    /// Takes in the rows of the points that [`Crowd::cover`] placed last.
    fn add(&mut self, rows: Vec<Shared>, radius: f32) {
        if self.rows.is_empty() {
            let sum: f32 = rows.iter().map(|row| mean_channel(row.irradiance)).sum();
            self.level = self.level.max(sum / rows.len().max(1) as f32);
        }
        self.rows.extend(rows);
        let surplus = |r: usize| {
            let own = self.rows[r].irradiance;
            let unknown = UNTOLD * radius * self.level;
            let without = self.fitted(&self.point(r), Some(r));
            without.map_or(unknown, |(light, ..)| mean_channel(light - own).abs())
        };
        let surpluses: Vec<f32> =
            (0..self.rows.len()).into_par_iter().with_min_len(64).map(surplus).collect();
        self.rows.iter_mut().zip(surpluses).for_each(|(row, surplus)| row.surplus = surplus);
    }

    /// Where a row was gathered.
    fn point(&self, row: usize) -> SurfacePoint {
        self.index.supports()[row].point
    }

    /// Irradiance fitted to the rows around a point but for one, and by which weights; None where they are too few.
    fn fitted(&self, at: &SurfacePoint, but: Option<usize>) -> Option<(Rgb, Near, mls::Fit)> {
        let mut near = Near::new();
        self.index.for_each(at, REACH, |id, distance| {
            if but != Some(id as usize) {
                near.push((distance, id));
            }
        });
        if near.len() < FEWEST {
            return None;
        }
        if near.len() > mls::MOST {
            near.select_nth_unstable_by(mls::MOST - 1, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            near.truncate(mls::MOST);
        }
        let supports: SmallVec<[Support; mls::MOST]> =
            near.iter().map(|n| self.index.supports()[n.1 as usize]).collect();
        let fit = mls::fit(at, &supports, Sign::Any);
        if fit.weights.is_empty() {
            return None;
        }
        let value = |(n, w): (&(f32, u32), &f32)| {
            let row = &self.rows[n.1 as usize];
            (row.irradiance + row.gradient * (at.normal - self.point(n.1 as usize).normal)) * *w
        };
        let light = near.iter().zip(&fit.weights).map(value).sum();
        Some((light, near, fit))
    }

    /// What the rows around a point say; None where they are too few, or contradict each other.
    fn at(&self, point: &SurfacePoint, radius: f32) -> Option<Fitted> {
        let Some((indirect, near, fit)) = self.fitted(point, None) else {
            return self.nearest(point, radius);
        };
        let (mut missed, mut noise, mut carried, mut sky, mut total) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (n, w) in near.iter().zip(&fit.weights) {
            let row = &self.rows[n.1 as usize];
            missed += row.surplus.powi(2) * w.abs();
            noise += row.noise.powi(2) * w.abs();
            carried += (row.noise * w).powi(2);
            sky += row.sky_visibility * w;
            total += w.abs();
        }
        if indirect.min_element() < 0.0 {
            return None;
        }
        let bias = BETWEEN * BETWEEN * (missed - NOISE_SHARE * noise).max(0.0) / total;
        let error = (bias + carried).sqrt() * field::outside(&fit).min(MOST_OUTSIDE);
        let arriving = self.arriving(&near);
        let own = self.own_light(point, &near, &fit);
        Some(Fitted { indirect, own, sky_visibility: sky.clamp(0.0, 1.0), error, arriving })
    }

    /// The light that is asked for where another decides, by the same weights.
    fn own_light(&self, at: &SurfacePoint, near: &[(f32, u32)], fit: &mls::Fit) -> Option<Rgb> {
        let value = |(n, w): (&(f32, u32), &f32)| {
            let (irradiance, gradient) = self.rows[n.1 as usize].own?;
            Some((irradiance + gradient * (at.normal - self.point(n.1 as usize).normal)) * *w)
        };
        near.iter().zip(&fit.weights).map(value).sum()
    }

    /// The share of the lamps' light that arrives around, where rows agree on it.
    fn arriving(&self, near: &[(f32, u32)]) -> Option<f32> {
        let (mut low, mut high, mut sum, mut weight) = (f32::INFINITY, f32::NEG_INFINITY, 0.0, 0.0);
        for (distance, id) in near {
            let share = self.rows[*id as usize].arriving;
            if !share.is_nan() {
                (low, high) = (low.min(share), high.max(share));
                let w = mls::falloff(*distance);
                (sum, weight) = (sum + share * w, weight + w);
            }
        }
        (weight > 0.0 && high - low <= ALIKE).then(|| sum / weight)
    }

    /// What the row that covers a point says, turned to the point's normal.
    fn nearest(&self, point: &SurfacePoint, radius: f32) -> Option<Fitted> {
        let mut best = (1.0, usize::MAX);
        self.index.for_each(point, 1.0, |id, distance| {
            best = if distance < best.0 { (distance, id as usize) } else { best };
        });
        let (distance, row) = (best.0, self.rows.get(best.1)?);
        let turn = point.normal - self.point(best.1).normal;
        let turned = row.gradient * turn;
        let own = row.own.map(|(irradiance, gradient)| irradiance + gradient * turn);
        let indirect = (row.irradiance + turned).max(Rgb::ZERO);
        // What the turn changes is known to no better than a part of itself.
        let untold = UNTOLD * (radius * distance * self.level + mean_channel(turned).abs());
        let error = row.noise.hypot(untold);
        Some(Fitted { indirect, own, sky_visibility: row.sky_visibility, error, arriving: None })
    }
}
