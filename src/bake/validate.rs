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

/// Relative noise of a judging row of 1,024 lattice rays; falls as N^-0.75 (docs/theory.md, lattice noise).
const ROW_NOISE_AT_1024: f64 = 0.0017;

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
    let mut estimate = Estimate::from_samples(&lit, params);
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
    let indirect = field.row_light(&row, point);
    let thorough = DirectParams { first: 256, penumbra: 256, seed: params.seed };
    let direct = problem.direct.at_point(
        problem.around.bvh,
        problem.lamps,
        &thorough,
        &Query { point: *point, site: None, key },
    );
    let square = |v: glam::Vec3| f64::from(v.length_squared()) / 3.0;
    let level =
        f64::from(mean_channel(indirect)) * ROW_NOISE_AT_1024 * (1024.0 / f64::from(params.rays)).powf(0.75);
    Sample {
        direct: square(got.direct - direct),
        indirect: square(got.indirect - indirect),
        both: square(got.total() - indirect - direct),
        mean: f64::from(mean_channel(indirect + direct)),
        noise: level * level,
    }
}

impl Estimate {
    fn from_samples(samples: &[Sample], _: &ValidateParams) -> Self {
        let mean =
            |f: &dyn Fn(&Sample) -> f64| samples.iter().map(f).sum::<f64>() / samples.len().max(1) as f64;
        let level = mean(&|s| s.mean).max(f64::MIN_POSITIVE);
        let noise = mean(&|s| s.noise);
        let relative = |square: f64| square.max(0.0).sqrt() / level;
        Self {
            error: relative(mean(&|s| s.both) - noise),
            direct: relative(mean(&|s| s.direct)),
            indirect: relative(mean(&|s| s.indirect) - noise),
            rays: 0,
        }
    }
}

/// Points spread by area times the share of rays that meet surfaces: where surfaces exchange light. An endless plane under
/// an open sky has area without end and nothing to get wrong.
struct Sampler {
    cumulative: Vec<f64>,
}

impl Sampler {
    fn new(field: &Field<'_>) -> Self {
        let problem = &field.problem;
        let rows = &problem.receivers.rows;
        let mut sum = 0.0;
        let weight = |site: usize| -> f64 {
            let share =
                |(&r, &w): (&u32, &f32)| rows.summaries[r as usize].hits as f32 / rows.rays as f32 * w;
            let spread = problem.spread;
            let share: f32 = spread.receivers_of(site).iter().zip(spread.weights_of(site)).map(share).sum();
            f64::from(problem.around.sites.areas[site] * share)
        };
        let cumulative = (0..problem.around.sites.len())
            .map(|site| {
                sum += weight(site);
                sum
            })
            .collect();
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
