//! The program's own judge: points gathered independently of receivers and interpolation.
//!
//! It sees errors of placement, interpolation, row noise and visibility. Those shared through the sites' radiosities enter
//! both sides; they are added by a measured law (docs/theory.md, error estimate).

use rayon::prelude::*;

use crate::archive::{Ledger, Tag};
use crate::error::Result;
use crate::geometry::{SurfacePoint, hash, tangent_frame};
use crate::light::{Rgb, mean_channel};
use crate::links::direct::{DirectParams, Query};
use crate::sites::SiteId;
use crate::solve::Field;
use crate::solve::light::RowLight;

/// Points judged in a block: a fraction of a second's rays.
const JUDGED_BLOCK: usize = 128;

/// How the estimate is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ValidateParams {
    /// Lit points to judge by.
    pub points: usize,
    /// Rays of each of a point's two own rows, and of its shadows.
    pub rays: u32,
    /// Random seed, not shared with any stage.
    pub seed: u64,
}

/// What the independent gather says.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Estimate {
    /// Relative RMS error of irradiance: √⟨|ΔH|²⟩ / ⟨H⟩ over lit points, free of the rows' own noise.
    pub error: f64,
    /// The part of it in light from lamps.
    pub direct: f64,
    /// The part in light from surfaces and sky.
    pub indirect: f64,
    /// Rays traced.
    pub rays: u64,
}

/// Judges a field by points spread over all lit surfaces.
///
/// # Errors
/// The ledger's.
pub fn judge(field: &Field<'_>, params: &ValidateParams, ledger: &Ledger<'_>) -> Result<Estimate> {
    let sampler = Sampler::new(field);
    // Sides that no light reaches (the outside of a closed room) are no part of the answer; ask for more points
    // until enough are lit.
    let mut lit: Vec<Sample> = Vec::new();
    for round in 0..8 {
        let points: Vec<SurfacePoint> = (0..params.points)
            .filter_map(|i| sampler.point(field, params.seed, (round * params.points + i) as u64))
            .collect();
        let answers = field.evaluate(&points);
        let dark = |k: usize| answers[k].total().max_element() <= 0.0;
        let chosen: Vec<usize> =
            (0..points.len()).filter(|&k| !dark(k)).take(params.points - lit.len()).collect();
        let judged = |range: std::ops::Range<usize>| {
            let samples = chosen[range].par_iter().map(|&k| sample(field, &points[k], params).to_words());
            Ok(samples.collect::<Vec<[f64; 5]>>())
        };
        ledger.blocks(Tag::new("judged"), (chosen.len(), JUDGED_BLOCK), judged, |samples| {
            lit.extend(samples.iter().map(Sample::from_words));
        })?;
        if lit.len() >= params.points {
            break;
        }
    }
    let mut estimate = Estimate::from_samples(&lit);
    estimate.rays = lit.iter().map(|s| s.rays).sum();
    Ok(estimate)
}

/// The differences at one point: products of those to two independent gathers, whose noise averages to nothing.
struct Sample {
    direct: f64,
    indirect: f64,
    both: f64,
    mean: f64,
    rays: u64,
}

impl Sample {
    fn to_words(&self) -> [f64; 5] {
        [self.direct, self.indirect, self.both, self.mean, self.rays as f64]
    }

    fn from_words(&[direct, indirect, both, mean, rays]: &[f64; 5]) -> Self {
        Self { direct, indirect, both, mean, rays: rays as u64 }
    }
}

fn sample(field: &Field<'_>, point: &SurfacePoint, params: &ValidateParams) -> Sample {
    let got = field.evaluate(std::slice::from_ref(point))[0];
    let place = u64::from(point.position.x.to_bits()) ^ u64::from(point.position.y.to_bits()) << 32;
    let halves =
        [0, 1].map(|half| gather(field, point, hash::mix2(hash::mix2(params.seed, half), place), params));
    let apart = halves.map(|(direct, indirect, _)| {
        let (direct, indirect) = (got.direct - direct, got.indirect - indirect);
        (direct, indirect, direct + indirect)
    });
    let product = |a: glam::Vec3, b: glam::Vec3| f64::from(a.dot(b)) / 3.0;
    Sample {
        direct: product(apart[0].0, apart[1].0),
        indirect: product(apart[0].1, apart[1].1),
        both: product(apart[0].2, apart[1].2),
        mean: halves.iter().map(|h| 0.5 * f64::from(mean_channel(h.0 + h.1))).sum(),
        rays: halves.iter().map(|h| h.2).sum(),
    }
}

/// Direct and indirect irradiance by one independent gather, and the rays that it took.
fn gather(field: &Field<'_>, point: &SurfacePoint, key: u64, params: &ValidateParams) -> (Rgb, Rgb, u64) {
    let problem = &field.problem;
    let (RowLight { irradiance: indirect, .. }, rays) = field.gather_row(point, key, params.rays);
    let thorough = DirectParams { first: params.rays, penumbra: params.rays, seed: key };
    let query = Query { point: *point, site: None, rugged: true, key };
    let direct = problem.direct.at_point(problem.around.bvh, problem.lamps, &thorough, &query);
    (direct, indirect, rays)
}

/// Squared errors count up to this many times the mean square of all but the worst hundredth.
///
/// One point in a slit that makes up a thousandth of the surface would otherwise rule the estimate of a few hundred.
const OUTLIER: f64 = 36.0;

/// Errors that points share through the sites' radiosities, which no gather against these can see, over the error of
/// indirect light that it sees: 0.46 was measured in the Cornell box, 0.77 in rooms, 0.84 on the scan (docs/theory.md).
const SHARED: f64 = 0.75;

impl Estimate {
    fn from_samples(samples: &[Sample]) -> Self {
        let mean =
            |f: &dyn Fn(&Sample) -> f64| samples.iter().map(f).sum::<f64>() / samples.len().max(1) as f64;
        let level = mean(&|s| s.mean).max(f64::MIN_POSITIVE);
        let [direct, indirect, both] = [
            tempered(samples, |s| s.direct),
            tempered(samples, |s| s.indirect),
            tempered(samples, |s| s.both),
        ];
        let relative = |square: f64| square.max(0.0).sqrt() / level;
        Self {
            error: relative(both + SHARED * SHARED * indirect),
            direct: relative(direct),
            indirect: relative(indirect),
            rays: 0,
        }
    }
}

/// The mean of a square over the samples, outliers tempered; at least its own standard error, below which nothing is known
/// (products of two gathers' differences may well be negative).
fn tempered(samples: &[Sample], square: impl Fn(&Sample) -> f64) -> f64 {
    let mut squares: Vec<f64> = samples.iter().map(square).collect();
    squares.sort_unstable_by(f64::total_cmp);
    let usual = at_least_its_error(&squares[..squares.len() - squares.len() / 100]);
    squares.iter_mut().for_each(|s| *s = s.min(OUTLIER * usual));
    at_least_its_error(&squares)
}

/// The mean, or its standard error if that is larger.
fn at_least_its_error(values: &[f64]) -> f64 {
    let count = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / count;
    let scatter = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
    mean.max(scatter.sqrt() / count)
}

/// Points spread by area times the share of rays that meet surfaces: where surfaces exchange light. An endless plane under
/// an open sky has area without end and nothing to get wrong.
struct Sampler {
    cumulative: Vec<f64>,
}

impl Sampler {
    fn new(field: &Field<'_>) -> Self {
        let mut sum = 0.0;
        let cumulative = field.problem.exchange().into_iter().map(|weight| {
            sum += weight;
            sum
        });
        let cumulative = cumulative.collect();
        Self { cumulative }
    }

    /// A point near a site: thrown onto its tangent plane, then onto the surface.
    fn point(&self, field: &Field<'_>, seed: u64, index: u64) -> Option<SurfacePoint> {
        let around = field.problem.around;
        let want = f64::from(hash::unit(seed, index)) * self.cumulative.last()?;
        let site = self.cumulative.partition_point(|&c| c <= want).min(self.cumulative.len() - 1);
        let at = around.sites.point(SiteId(site as u32));
        let reach = 0.5 * around.sites.spacings[site];
        let (s, t) = tangent_frame(at.normal);
        let [u, v] = hash::unit_pair(seed ^ 0xa5a5, index);
        let (sin, cos) = (std::f32::consts::TAU * v).sin_cos();
        let offset = (s * cos + t * sin) * (reach * u.sqrt());
        let (hit, point) = around.beside(&at, offset, reach)?;
        let mesh = &around.scene.meshes[around.scene.mesh_of(hit.triangle)];
        (mesh.two_sided || !hit.back).then_some(point)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_claimed_below_the_noise() {
        // Products of differences that are noise: as many below zero as above.
        let sample = |k: u64| {
            let noise = f64::from(hash::unit(3, k)) - 0.55;
            Sample { direct: 0.0, indirect: noise, both: noise, mean: 1.0, rays: 0 }
        };
        let samples: Vec<Sample> = (0..500).map(sample).collect();
        let estimate = Estimate::from_samples(&samples);
        // Uniform noise has a standard deviation of 1/√12; the mean of 500 is known to 0.0129, its square root is 0.114.
        assert!((0.10..0.13).contains(&estimate.indirect), "{estimate:?}");
        assert!(estimate.direct == 0.0 && estimate.error >= estimate.indirect);
    }
}
