//! The program's own judge: points gathered independently of receivers and interpolation.
//!
//! It sees errors of placement, interpolation, row noise and visibility; it does not see those shared through the
//! sites' radiosities, which enter both sides (docs/theory.md, error estimate).

use rayon::prelude::*;

use crate::geometry::{SurfacePoint, hash, triangle};
use crate::light::mean_channel;
use crate::links::direct::{DirectParams, Query};
use crate::links::rows::Rows;
use crate::scene::Scene;
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
    let scene = field.problem.around.scene;
    let surface = Surface::new(scene);
    // Sides that no light reaches (the outside of a closed room) are no part of the answer; ask for more points
    // until enough are lit.
    let mut lit: Vec<Sample> = Vec::new();
    let mut rays = 0;
    for round in 0..8 {
        let points: Vec<SurfacePoint> = (0..params.points)
            .filter_map(|i| surface.point(scene, params.seed, (round * params.points + i) as u64))
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

/// All sides of the scene that can receive light, for sampling by area.
struct Surface {
    cumulative: Vec<f64>,
    /// Triangle, and whether its back.
    sides: Vec<(u32, bool)>,
}

impl Surface {
    fn new(scene: &Scene) -> Self {
        let (mut cumulative, mut sides) = (Vec::new(), Vec::new());
        let mut sum = 0.0;
        for mesh in &scene.meshes {
            for t in mesh.triangles.clone() {
                let area = f64::from(triangle::area(scene.corners(t)));
                for back in [false, true].into_iter().take(1 + usize::from(mesh.two_sided)) {
                    sum += area;
                    cumulative.push(sum);
                    sides.push((t, back));
                }
            }
        }
        Self { cumulative, sides }
    }

    fn point(&self, scene: &Scene, seed: u64, index: u64) -> Option<SurfacePoint> {
        let total = *self.cumulative.last()?;
        let want = f64::from(hash::unit(seed, index)) * total;
        let k = self.cumulative.partition_point(|&c| c <= want).min(self.sides.len() - 1);
        let (t, back) = self.sides[k];
        let corners = scene.corners(t);
        let (u, v) = triangle::uniform_barycentric(hash::unit_pair(seed ^ 0xa5a5, index));
        let normal = triangle::normal(corners) * if back { -1.0 } else { 1.0 };
        (normal != glam::Vec3::ZERO)
            .then(|| SurfacePoint { position: triangle::point(corners, u, v), normal })
    }
}
