//! Evaluation of a solution at any surface point, straight from the receivers.

use rayon::prelude::*;
use smallvec::SmallVec;

use super::light::RowLight;
use super::{Problem, Solution};
use crate::basis::{self, Basis, Reconstruction, shepard};
use crate::geometry::{SurfacePoint, hash};
use crate::light::{Rgb, mean_channel};
use crate::links::direct::{DirectParams, Query};
use crate::links::receivers::Receivers;
use crate::scene::Sky;
use crate::sites::SiteId;
use crate::sites::neighbours::mutually_visible;
use crate::tree::Support;
use crate::tree::mls::{self, Fit, Sign};

/// The light that falls on one point, as the solution knows it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Irradiance {
    /// From emitters and punctual lamps directly, W·m⁻².
    pub direct: Rgb,
    /// From other surfaces and the sky, W·m⁻².
    pub indirect: Rgb,
    /// Cosine-weighted share of the sky that the point sees, in [0, 1].
    pub sky_visibility: f32,
    /// The program's own estimate of the standard error of the mean-channel irradiance, W·m⁻².
    pub error: f32,
}

impl Irradiance {
    /// Direct and indirect together.
    pub fn total(&self) -> Rgb {
        self.direct + self.indirect
    }
}

/// How points off the receivers are answered.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldParams {
    /// Shadow rays.
    pub direct: DirectParams,
    /// Rays that a point shoots itself where nobody near it says how many it takes.
    pub rays: u32,
    /// Rays that it shoots at the most.
    pub most_rays: u32,
    /// The standard error, relative to the solution's level, that a point's own row may have.
    pub noise: f32,
    /// The disagreement, relative to the solution's level, from which a point gathers for itself.
    pub doubt: f32,
}

/// Interpolation between receivers errs by this much of what leaving one out does: a point is nearer to them than they
/// are to each other.
pub const BETWEEN: f32 = 0.4;

/// Fits of fewer receivers than this are not trusted.
pub const FEWEST: usize = 3;

/// Interpolated light below this share of the mean is not believed.
const DARK: f32 = 2.0e-3;

/// Leverages count up to this.
const MOST_LEVERAGE: f32 = 0.99;

/// Lattices of n rays err by n to the minus this (docs/theory.md, rows).
const LATTICE_ORDER: f32 = 0.6;

/// Noise is held to the geometric mean of the light around and the mean light, down to this share of the latter.
const DARKEST: f32 = 0.05;

/// Rows of fewer rays are not shot.
const FEWEST_RAYS: u32 = 32;

/// A site's shadows speak for points whose normals' cosine with its own is at least this (18°).
const SAME_TURN: f32 = 0.95;

/// A point set onto the surface, and what the receivers around it say.
pub(super) struct First {
    /// The point.
    pub set: SurfacePoint,
    /// The site that speaks for it.
    pub site: Option<u32>,
    /// Receivers around it.
    pub near: SmallVec<[u32; 32]>,
    /// Their answer.
    pub blended: Irradiance,
    /// Whether it may stand.
    pub trusted: bool,
}

/// A solved scene that answers for any surface point.
#[derive(Clone, Copy)]
pub struct Field<'a> {
    /// The geometry and its links.
    pub problem: Problem<'a>,
    /// The light.
    pub solution: &'a Solution,
    /// How to answer.
    pub params: FieldParams,
    /// The light as one function over all receivers, if the basis is global.
    pub smooth: Option<&'a dyn Reconstruction<4>>,
    /// The light that tells in place of the solution where points gather for themselves, and with how many rays: answers are then
    /// linear in the solution and the sky, negative light included.
    pub judge: Option<Judge<'a>>,
}

/// A light by which it is decided how points are answered.
#[derive(Clone, Copy)]
pub struct Judge<'a> {
    /// Of the same receivers.
    pub solution: &'a Solution,
    /// The sky that it is of.
    pub sky: &'a Sky,
}

impl Field<'_> {
    /// Irradiance at each point, in order; the same for any number of threads.
    ///
    /// Cost: one short ray and one fit of at most [`mls::MOST`] receivers a point, shadow rays in penumbrae.
    pub fn evaluate(&self, points: &[SurfacePoint]) -> Vec<Irradiance> {
        points.par_iter().with_min_len(64).map(|p| self.at(p)).collect()
    }

    /// The light that decides how points are answered.
    pub(super) fn judge(&self) -> &Solution {
        self.judge.map_or(self.solution, |judge| judge.solution)
    }

    /// The field of the light that decides, if it is another. It is one function over all receivers to nobody: its fits speak.
    pub(super) fn judged(&self) -> Option<Self> {
        let Judge { solution, sky } = self.judge?;
        let problem = Problem { sky: Some(sky), ..self.problem };
        Some(Self { problem, solution, judge: None, smooth: None, ..*self })
    }

    fn at(&self, point: &SurfacePoint) -> Irradiance {
        let first = self.first(point);
        if first.trusted { first.blended } else { self.alone(&first) }
    }

    /// The answer of a point's own row.
    pub(super) fn alone(&self, first: &First) -> Irradiance {
        let RowLight { irradiance: indirect, sky_visibility, noise: error, .. } = self.gather_at(first);
        Irradiance { direct: first.blended.direct, indirect, sky_visibility, error }
    }

    /// What the receivers around a point say.
    pub(super) fn first(&self, point: &SurfacePoint) -> First {
        let problem = &self.problem;
        let (site, set) = problem.around.footing(point);
        let point = &set;
        let sites = problem.around.sites;
        let turned = |s| sites.point(s).normal.dot(point.normal) < SAME_TURN;
        let rugged = site.is_none_or(|s| problem.around.graph.unclean(s) || turned(s));
        // A cell next to a wall may reach through it: its site speaks for those points alone that it sees.
        let sees = |s: &SiteId| {
            let there = sites.point(*s);
            problem.around.ground().is_sure(point, *s)
                || mutually_visible(*point, there, f32::INFINITY, problem.around.bvh)
        };
        let home = site.filter(|s| sees(s) && !problem.around.bvh.is_tight(point.position, point.normal));
        let site = site.map(|s| s.0);
        let query = Query { point: *point, site, rugged, key: key(point) };
        let direct = problem.direct.at_point(problem.around.bvh, problem.lamps, &self.params.direct, &query);
        let listed = home.map_or(&[][..], |s| problem.spread.receivers_of(s.index()));
        let listed = if listed.len() < FEWEST { &[][..] } else { listed };
        let near = nearest(problem.receivers, point, listed);
        let fit = fit(problem, point, &near);
        let blend = |field: &Self| match &fit {
            Some(fit) => field.blend(point, &near, fit, direct),
            None => Irradiance { direct, indirect: Rgb::ZERO, sky_visibility: 0.0, error: f32::INFINITY },
        };
        let blended = blend(self);
        let judged = self.judged().map_or(blended, |judge| blend(&judge));
        // Darkness may be a hidden side's, reached through a wall: it is looked into.
        let level = self.judge().level;
        let dark = mean_channel(judged.indirect) < DARK * level;
        let trusted = !dark && judged.error <= self.params.doubt * level;
        First { set, site, near, blended, trusted }
    }

    fn blend(&self, point: &SurfacePoint, near: &[u32], fit: &Fit, direct: Rgb) -> Irradiance {
        let indirect = fitted((&self.problem, self.solution), point, near, fit);
        let share = |(&r, w): (&u32, &f32)| self.solution.sky_visibility[r as usize] * w;
        let sky_visibility = near.iter().zip(&fit.weights).map(share).sum::<f32>().clamp(0.0, 1.0);
        // Negative light tells that the fit extrapolates from others' shade: nobody speaks for this point.
        let negative = indirect.min_element() < 0.0;
        let error = if negative { f32::INFINITY } else { claim(self.solution, near, fit) };
        let indirect = if self.judge.is_some() { indirect } else { indirect.max(Rgb::ZERO) };
        let local = Irradiance { direct, indirect, sky_visibility, error };
        self.smooth.map_or(local, |smooth| self.smoothed(point, smooth, local))
    }

    /// What a global function says. It knows no walls, the receivers that the point sees do: where they disagree, nobody is
    /// believed.
    fn smoothed(
        &self,
        point: &SurfacePoint,
        smooth: &dyn Reconstruction<4>,
        local: Irradiance,
    ) -> Irradiance {
        let Some([r, g, b, sky]) = smooth.at(point).map(|v| v.map(|v| v as f32)) else {
            return Irradiance { error: f32::INFINITY, ..local };
        };
        let indirect = Rgb::new(r, g, b);
        // Darkness is looked into, whatever seeps in from beyond a wall.
        let dark = mean_channel(local.indirect) < DARK * self.solution.level;
        let doubtful = dark || indirect.min_element() < 0.0;
        let error =
            if doubtful { f32::INFINITY } else { local.error.hypot(mean_channel(indirect - local.indirect)) };
        let sky_visibility = sky.clamp(0.0, 1.0);
        let indirect = if self.judge.is_some() { indirect } else { indirect.max(Rgb::ZERO) };
        Irradiance { indirect, sky_visibility, error, ..local }
    }

    /// The point's own row, against the solved radiosities.
    fn gather_at(&self, first: &First) -> RowLight {
        self.gather_row(&first.set, key(&first.set), self.rays_for(&first.near)).0
    }

    /// How many rays bring a point's row down to the noise allowed, as the rows of receivers near it tell. The point's own
    /// rays have no say: those that missed what is bright would stop too early.
    fn rays_for(&self, near: &[u32]) -> u32 {
        let FieldParams { rays, most_rays, noise, .. } = self.params;
        if near.len() < FEWEST {
            return rays;
        }
        let judge = self.judge();
        // Where it is dark noise shows more than its share of the mean tells.
        let level = judge.level;
        let light = |&r: &u32| mean_channel(judge.irradiance[r as usize]);
        let here = (near.iter().map(light).sum::<f32>() / near.len() as f32).clamp(DARKEST * level, level);
        let allowed = (noise * (level * here).sqrt()).max(f32::MIN_POSITIVE);
        let by = |&r: &u32| {
            let (rows, _) = self.problem.receivers.row(r as usize);
            rows.rays as f32 * (judge.noise[r as usize] / allowed).powf(1.0 / LATTICE_ORDER)
        };
        let wanted = near.iter().map(by).sum::<f32>() / near.len() as f32;
        (wanted as u32).clamp(FEWEST_RAYS, most_rays.max(FEWEST_RAYS))
    }
}

/// A function over all receivers: three channels of irradiance, and the share of the sky that is seen.
pub type Smooth = Box<dyn Reconstruction<4>>;

/// Fits the function of a global basis to the light at receivers.
///
/// # Panics
/// When the basis is not global, or its system cannot be factored: it is positive definite by construction.
pub fn smooth(basis: Basis, receivers: &Receivers, solution: &Solution) -> Smooth {
    let channels = |(light, sky): (&Rgb, &f32)| [light.x, light.y, light.z, *sky].map(f64::from);
    let values: Vec<[f64; 4]> =
        solution.irradiance.iter().zip(&solution.sky_visibility).map(channels).collect();
    match basis::fit(basis, receivers.index.supports(), &values) {
        Ok(Some(smooth)) => smooth,
        Ok(None) => panic!("{basis} has no function over all receivers"),
        Err(problem) => panic!("{basis}: {problem}"),
    }
}

/// The standard error of a fit: what leaving receivers out misses, and the noise of their rows.
fn claim(solution: &Solution, near: &[u32], fit: &Fit) -> f32 {
    let (mut bias, mut noise) = (0.0, 0.0);
    for (&r, w) in near.iter().zip(&fit.weights) {
        bias += (BETWEEN * solution.surplus[r as usize]).powi(2) * w.abs();
        noise += (solution.noise[r as usize] * w).powi(2);
    }
    (bias + noise).sqrt() * outside(fit)
}

/// Outside of its supports a fit errs more than between them, by this factor, as a regression's standard error does.
pub(super) fn outside(fit: &Fit) -> f32 {
    let leverage = fit.leverage.min(MOST_LEVERAGE);
    1.0 + leverage / (1.0 - leverage)
}

/// The standard error that interpolation claims at a point; infinite where too few receivers are near.
pub fn claimed(problem: &Problem<'_>, solution: &Solution, point: &SurfacePoint, listed: &[u32]) -> f32 {
    let near = &nearest(problem.receivers, point, listed);
    let trusted = fit(problem, point, near).filter(|_| listed.len() >= FEWEST);
    trusted.map_or(f32::INFINITY, |fit| claim(solution, near, &fit))
}

/// The receivers of a list that are nearest to a point, at most [`mls::MOST`].
pub fn nearest(receivers: &Receivers, point: &SurfacePoint, listed: &[u32]) -> SmallVec<[u32; 32]> {
    let supports = receivers.index.supports();
    if listed.len() <= mls::MOST {
        return SmallVec::from_slice(listed);
    }
    let mut by: SmallVec<[(f32, u32); 32]> =
        listed.iter().map(|&r| (supports[r as usize].distance(point), r)).collect();
    by.select_nth_unstable_by(mls::MOST - 1, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    by[..mls::MOST].iter().map(|b| b.1).collect()
}

/// Weights of the receivers at a point; None when none of them reaches it.
fn fit(problem: &Problem<'_>, point: &SurfacePoint, near: &[u32]) -> Option<Fit> {
    let supports: SmallVec<[Support; mls::MOST]> =
        near.iter().map(|&r| problem.receivers.index.supports()[r as usize]).collect();
    let mut fit = mls::fit(point, &supports, Sign::Any);
    if problem.spread.basis == Basis::Shepard {
        fit.weights = shepard::weights(point, &supports);
    }
    Some(fit).filter(|fit| !fit.weights.is_empty())
}

/// Irradiance fitted to the given receivers, with their gradients.
pub fn interpolate(
    problem: &Problem<'_>,
    solution: &Solution,
    point: &SurfacePoint,
    near: &[u32],
) -> Option<Rgb> {
    let near = &nearest(problem.receivers, point, near);
    let fit = fit(problem, point, near)?;
    Some(fitted((problem, solution), point, near, &fit).max(Rgb::ZERO))
}

/// A fit's light, with the receivers' gradients; negative where it extrapolates too far.
fn fitted(
    (problem, solution): (&Problem<'_>, &Solution),
    point: &SurfacePoint,
    near: &[u32],
    fit: &Fit,
) -> Rgb {
    // An average of what is turned would not stay within its data.
    let turns = problem.spread.basis != Basis::Shepard;
    let value = |r: usize| {
        if !turns {
            return solution.irradiance[r];
        }
        let turn = point.normal - problem.receivers.index.supports()[r].point.normal;
        solution.irradiance[r] + solution.gradient[r] * turn
    };
    near.iter().zip(&fit.weights).map(|(&r, &w)| value(r as usize) * w).sum()
}

/// A point's key: its coordinates' bits, so that equal points get equal answers wherever they stand in a list.
pub(super) fn key(point: &SurfacePoint) -> u64 {
    let p = point.position.to_array().map(|v| u64::from(v.to_bits()));
    hash::mix2(hash::mix2(p[0], p[1]), p[2])
}
