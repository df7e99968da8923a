//! A scene solved, and what its surfaces receive.

use glowtree::bake::Silent;
use glowtree::bake::laws::Plan;
use glowtree::bake::model::Model;
use glowtree::bake::pipeline::build;
use glowtree::light::mean_channel;
use glowtree::scene::Scene;

use crate::shapes::points_on;

/// Bakes a scene for a relative error target; all randomness hangs on seed 1.
pub fn solve(scene: Scene, error: f64) -> Model {
    let (model, report) = build(scene, &Plan::new(error, 1), None, &Silent).expect("nothing interrupts");
    let counts = (model.sites.len(), model.receivers.len());
    let (products, estimate) = (report.iterate.iterations, 100.0 * report.estimate.error);
    println!("{} sites, {} receivers, {products} products, estimate {estimate:.3} %", counts.0, counts.1);
    assert!(report.iterate.converged, "residual {}", report.iterate.residual);
    model
}

/// Irradiance over the front of a mesh, at points spread evenly over its area.
pub struct Sampled {
    /// One value a point.
    pub values: Vec<f64>,
}

/// Samples one mesh: total irradiance, mean channel.
pub fn irradiance(model: &Model, mesh: usize, count: usize) -> Sampled {
    let points = points_on(&model.scene, mesh, count, 17);
    let answers = model.field().evaluate(&points);
    Sampled { values: answers.iter().map(|a| f64::from(mean_channel(a.total()))).collect() }
}

impl Sampled {
    /// Mean over the area.
    pub fn mean(&self) -> f64 {
        self.values.iter().sum::<f64>() / self.values.len() as f64
    }

    /// Root mean square of the relative difference from one value that holds everywhere.
    pub fn rms(&self, want: f64) -> f64 {
        let square = |v: &f64| (v / want - 1.0) * (v / want - 1.0);
        (self.values.iter().map(square).sum::<f64>() / self.values.len() as f64).sqrt()
    }

    /// The largest relative difference from one value that holds everywhere.
    pub fn worst(&self, want: f64) -> f64 {
        self.values.iter().map(|v| (v / want - 1.0).abs()).fold(0.0, f64::max)
    }
}

/// Asserts a relative difference, telling both values.
pub fn within(what: &str, got: f64, want: f64, tolerance: f64) {
    let relative = got / want - 1.0;
    println!("{what}: got {got:.6}, want {want:.6}: {:+.4} %", 100.0 * relative);
    assert!(relative.abs() <= tolerance, "{what}: got {got}, want {want} ± {:.3} %", 100.0 * tolerance);
}

/// Asserts that a relative error is below its limit.
pub fn below(what: &str, error: f64, limit: f64) {
    println!("{what}: {:.4} %", 100.0 * error);
    assert!(error <= limit, "{what}: {:.4} % exceeds {:.4} %", 100.0 * error, 100.0 * limit);
}
