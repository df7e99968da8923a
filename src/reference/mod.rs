//! The judge: irradiance at surface points by plain path tracing, unbiased, with a standard error.
//!
//! H(x) = ∫ L(x, ω) cosθ dω, estimated by paths that are continued until chance ends them. Nothing here is shared with
//! the solver but the scene and its rays: what the two agree on, they found on different ways.
//!
//! This work is based on: Owen, "Monte Carlo Variance of Scrambled Net Quadrature", SIAM J. Numer. Anal. 1997
//! (independent replicates of a scrambled net give an unbiased mean and an honest standard error).

mod emitters;
mod lamps;
mod origins;
mod paths;
mod pattern;
mod sky;

use glam::DVec3;
use rayon::prelude::*;

use crate::geometry::{SurfacePoint, hash};
use crate::light::Rgb;
use crate::rays::Bvh;
use crate::scene::Scene;
use paths::Tracer;
use pattern::Draws;

/// Independent replicates per point: the spread of their means is the standard error, itself known to
/// 1/√(2·15) = 18 %. More would be surer of it and leave each a shorter, worse distributed sequence.
pub const REPLICATES: u32 = 16;

/// Paths between two calls of the progress closure, about a second's work.
const BLOCK_PATHS: usize = 1 << 20;

/// How to trace.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferenceParams {
    /// Paths per point; rounded up to a multiple of [`REPLICATES`]. A power of two is best distributed.
    pub samples: u32,
    /// Another seed gives independent noise.
    pub seed: u64,
    /// Reflections that are followed: 0 is direct light alone; [`u32::MAX`] leaves the end to chance, without bias.
    pub max_bounces: u32,
}

impl Default for ReferenceParams {
    fn default() -> Self {
        Self { samples: 64, seed: 0, max_bounces: u32::MAX }
    }
}

/// The irradiance at a point, W·m⁻².
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Mean over all paths.
    pub mean: Rgb,
    /// Standard error of the mean, per channel.
    pub standard_error: Rgb,
}

/// Irradiance at each point on the side its normal looks to, by path tracing.
///
/// `points`: local frame; those within 1e-5 of a triangle that looks their way are moved onto it. `progress` hears the share of the work that is
/// done, in (0, 1], about once a second, on the calling thread. Unbiased; the error falls at least as samples^(−½). The
/// result depends on (scene, points' order, params) alone, not on the number of threads. Cost: about 1 µs a path in a
/// room of few triangles; memory: 200 B a point at the most.
pub fn irradiance(
    scene: &Scene,
    bvh: &Bvh,
    points: &[SurfacePoint],
    params: &ReferenceParams,
    progress: impl Fn(f64),
) -> Vec<Estimate> {
    let tracer = Tracer::new(scene, bvh, params.max_bounces);
    let length = params.samples.div_ceil(REPLICATES).max(1);
    let block = (BLOCK_PATHS / (length * REPLICATES) as usize).max(1);
    let mut estimates = Vec::with_capacity(points.len());
    for block in points.chunks(block) {
        let first = estimates.len();
        let block: Vec<SurfacePoint> =
            block.par_iter().map(|point| origins::settled(scene, bvh, point)).collect();
        let replicates = REPLICATES as usize;
        // Each replicate of each point is a task of its own, so that one point alone uses all cores.
        let means: Vec<DVec3> = (0..block.len() * replicates)
            .into_par_iter()
            .map(|task| {
                let point = (first + task / replicates) as u64;
                let key = hash::mix2(hash::mix2(params.seed, point), (task % replicates) as u64);
                replicate(&tracer, &block[task / replicates], key, length)
            })
            .collect();
        estimates.par_extend(block.par_iter().zip(means.par_chunks(replicates)).map(|(point, means)| {
            let lamps = lamps::direct(&scene.lamps, bvh, point);
            summary(means, lamps)
        }));
        progress(estimates.len() as f64 / points.len() as f64);
    }
    estimates
}

/// The mean of one replicate's paths.
fn replicate(tracer: &Tracer<'_>, point: &SurfacePoint, key: u64, length: u32) -> DVec3 {
    let paths = (0..length).map(|sample| tracer.irradiance(point, &Draws { replicate: key, sample }));
    paths.map(Rgb::as_dvec3).sum::<DVec3>() / f64::from(length)
}

/// Mean and standard error over the replicates, the lamps' exact direct light added.
fn summary(means: &[DVec3], lamps: Rgb) -> Estimate {
    let count = means.len() as f64;
    let mean = means.iter().sum::<DVec3>() / count;
    let square = means.iter().map(|m| (m - mean) * (m - mean)).sum::<DVec3>();
    let error = (square / (count * (count - 1.0))).map(f64::sqrt);
    Estimate { mean: (mean + lamps.as_dvec3()).as_vec3(), standard_error: error.as_vec3() }
}
