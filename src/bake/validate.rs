//! The program's own judge: points gathered independently of receivers and interpolation.
//!
//! It sees errors of placement, interpolation, row noise and visibility; it does not see those shared through the
//! sites' radiosities, which enter both sides (docs/theory.md, error estimate).

use rayon::prelude::*;

use crate::geometry::{SurfacePoint, hash, tangent_frame};
use crate::light::mean_channel;
use crate::links::direct::{DirectParams, Query};
use crate::links::rows::Rows;
use crate::rays::Ray;
use crate::scatter::surface::side_normal;
use crate::sites::SiteId;
use crate::solve::Field;
use crate::solve::light::RowLight;

/// How the estimate is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ValidateParams {
    /// Lit points to judge by.
    pub points: usize,
    /// Rays of each point's own row.
    pub rays: u32,
    /// Random seed, not shared with any stage.
    pub seed: u64,
}

/// What the independent gather says.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Estimate {
    /// Relative RMS error of irradiance: √⟨|ΔH|²⟩ / ⟨H⟩ over lit points, rows' own noise taken out.
    pub error: f64,
    /// The part of it in light from lamps.
    pub direct: f64,
    /// The part in light from surfaces and sky.
    pub indirect: f64,
    /// Rays traced.
    pub rays: u64,
}

/// Judges a field by points spread over all lit surfaces.
pub fn judge(field: &Field<'_>, params: &ValidateParams) -> Estimate {
    let sampler = Sampler::new(field);
    // Sides that no light reaches (the outside of a closed room) are no part of the answer; ask for more points
    // until enough are lit.
    let mut lit: Vec<Sample> = Vec::new();
    let mut rays = 0;
    for round in 0..8 {
        let points: Vec<SurfacePoint> = (0..params.points)
            .filter_map(|i| sampler.point(field, params.seed, (round * params.points + i) as u64))
            .collect();
        let answers = field.evaluate(&points);
        let dark = |k: usize| answers[k].total().max_element() <= 0.0;
        let chosen: Vec<usize> =
            (0..points.len()).filter(|&k| !dark(k)).take(params.points - lit.len()).collect();
        let samples: Vec<Sample> = chosen.par_iter().map(|&k| sample(field, &points[k], params)).collect();
        rays += samples.len() as u64 * u64::from(params.rays);
        lit.extend(samples);
        if lit.len() >= params.points {
            break;
        }
    }
    let mut estimate = Estimate::from_samples(&lit);
    estimate.rays = rays;
    estimate
}

/// The differences at one point.
struct Sample {
    direct: f64,
    indirect: f64,
    both: f64,
    mean: f64,
    noise: f64,
}

fn sample(field: &Field<'_>, point: &SurfacePoint, params: &ValidateParams) -> Sample {
    let problem = &field.problem;
    let got = field.evaluate(std::slice::from_ref(point))[0];
    let key = hash::mix2(
        params.seed,
        u64::from(point.position.x.to_bits()) ^ u64::from(point.position.y.to_bits()) << 32,
    );
    let row = Rows::single(problem.around, point, key, params.rays);
    let RowLight { irradiance: indirect, noise, .. } = field.row_light(&row, point);
    let thorough = DirectParams { first: 512, penumbra: 512, seed: params.seed };
    let direct = problem.direct.at_point(
        problem.around.bvh,
        problem.lamps,
        &thorough,
        &Query { point: *point, site: None, rugged: true, key },
    );
    let square = |v: glam::Vec3| f64::from(v.length_squared()) / 3.0;
    Sample {
        direct: square(got.direct - direct),
        indirect: square(got.indirect - indirect),
        both: square(got.total() - indirect - direct),
        mean: f64::from(mean_channel(indirect + direct)),
        noise: f64::from(noise).powi(2),
    }
}

/// Squared errors count up to this many times the mean square of all but the worst hundredth.
///
/// One point in a slit that makes up a thousandth of the surface would otherwise rule the estimate of a few hundred.
const OUTLIER: f64 = 36.0;

impl Estimate {
    fn from_samples(samples: &[Sample]) -> Self {
        let mean =
            |f: &dyn Fn(&Sample) -> f64| samples.iter().map(f).sum::<f64>() / samples.len().max(1) as f64;
        let level = mean(&|s| s.mean).max(f64::MIN_POSITIVE);
        let noise = mean(&|s| s.noise);
        let relative = |square: f64| square.max(0.0).sqrt() / level;
        Self {
            error: relative(tempered(samples, |s| s.both) - noise),
            direct: relative(tempered(samples, |s| s.direct)),
            indirect: relative(tempered(samples, |s| s.indirect) - noise),
            rays: 0,
        }
    }
}

/// The mean of a square over the samples, outliers tempered.
fn tempered(samples: &[Sample], square: impl Fn(&Sample) -> f64) -> f64 {
    let mut squares: Vec<f64> = samples.iter().map(square).collect();
    squares.sort_unstable_by(f64::total_cmp);
    let most = squares.len() - squares.len() / 100;
    let usual = squares[..most].iter().sum::<f64>() / most.max(1) as f64;
    squares.iter().map(|s| s.min(OUTLIER * usual)).sum::<f64>() / squares.len().max(1) as f64
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
        let above = at.position + (s * cos + t * sin) * (reach * u.sqrt()) + at.normal * reach;
        let ray = Ray { origin: above, direction: -at.normal, t_min: 0.0, t_max: 2.0 * reach };
        let hit = around.bvh.closest(&ray)?;
        let back = crate::links::from_behind(around.scene, &ray, &hit);
        let normal = side_normal(around.scene, hit.triangle, back);
        let mesh = &around.scene.meshes[around.scene.mesh_of(hit.triangle)];
        (mesh.two_sided || !back)
            .then(|| SurfacePoint { position: above + ray.direction * hit.distance, normal })
    }
}
