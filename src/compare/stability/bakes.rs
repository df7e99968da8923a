//! Scenes baked for a row, and what their surfaces receive.

use crate::bake::laws::Plan;
use crate::bake::model::Model;
use crate::bake::pipeline::{self, PipelineReport, Target};
use crate::bake::{Monitor, Signal};
use crate::basis::Basis;
use crate::compare::known::points_on;
use crate::error::Result;
use crate::geometry::SurfacePoint;
use crate::light::mean_channel;
use crate::links::points::Operator;
use crate::rays::Bvh;
use crate::reference::{self, ReferenceParams};
use crate::scene::Scene;

/// Hears of a signal and says nothing: what a row bakes is no stage of its own.
pub struct Within<'m>(pub &'m dyn Monitor);

impl Monitor for Within<'_> {
    fn interrupted(&self) -> Option<Signal> {
        self.0.interrupted()
    }
}

/// Seed of every bake that is not about seeds.
pub const SEED: u64 = 1;

/// One plan for the target, without the rounds that would tighten it.
pub fn planned(scene: Scene, error: f64, monitor: &dyn Monitor) -> Result<(Model, PipelineReport)> {
    pipeline::build(scene, &Plan::new(error, SEED), None, &Within(monitor))
}

/// As `glowtree bake --error` does it.
pub fn asked(scene: &Scene, error: f64, seed: u64, monitor: &dyn Monitor) -> Result<(Model, PipelineReport)> {
    let target = Target {
        error,
        seed,
        bounces: None,
        basis: Basis::default(),
        operator: Operator::default(),
        relightable: false,
    };
    let (model, _, report) = pipeline::reach(scene, &target, &Within(monitor))?;
    Ok((model, report))
}

/// Total irradiance at points, mean channel.
pub fn light(model: &Model, points: &[SurfacePoint]) -> Vec<f64> {
    model.field().evaluate(points).iter().map(|a| f64::from(mean_channel(a.total()))).collect()
}

/// Points evenly over the front of one mesh.
pub fn on(model: &Model, mesh: usize, count: usize) -> Vec<SurfacePoint> {
    points_on(&model.scene, mesh, count, 17)
}

/// Total irradiance over the front of one mesh.
pub fn over(model: &Model, mesh: usize, count: usize) -> Vec<f64> {
    light(model, &on(model, mesh, count))
}

/// The mean.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The largest difference from 1, NaN if there is one.
pub fn worst(ratios: impl IntoIterator<Item = f64>) -> f64 {
    ratios.into_iter().fold(0.0, |most, ratio| {
        let off = (ratio - 1.0).abs();
        if off.is_nan() || off > most { off } else { most }
    })
}

/// RMS difference over the mean of the second.
pub fn apart(got: &[f64], want: &[f64]) -> f64 {
    let square = got.iter().zip(want).map(|(g, w)| (g - w).powi(2)).sum::<f64>();
    (square / want.len() as f64).sqrt() / mean(want)
}

/// Path-traced irradiance at points, mean channel, and the mean square of its standard error.
pub fn traced(scene: &Scene, points: &[SurfacePoint], samples: u32) -> (Vec<f64>, f64) {
    let params = ReferenceParams { samples, seed: 77, ..ReferenceParams::default() };
    let all = reference::irradiance(scene, &Bvh::build(scene), points, &params, |_| ());
    let noise = all.iter().map(|e| f64::from(mean_channel(e.standard_error)).powi(2)).sum::<f64>();
    (all.iter().map(|e| f64::from(mean_channel(e.mean))).collect(), noise / all.len() as f64)
}
