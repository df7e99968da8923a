//! Interpolation that knows distance alone: Shepard's over all data, and compact weights that see through walls.
//!
//! This work is based on: Shepard, "A two-dimensional interpolation function for irregularly-spaced data", 1968.

use glam::Vec3;

use crate::bake::model::Model;
use crate::geometry::SurfacePoint;
use crate::light::mean_channel;
use crate::solve::transport::Transport;

/// RMS error of Shepard's interpolation with weights 1/d of a smooth function from a grid of spacing 1/n on the unit square,
/// over the function's own spread.
pub fn shepard_error(n: usize) -> f64 {
    let smooth = |x: f64, y: f64| (3.0 * x).sin() * (2.0 * y).cos();
    let step = 1.0 / n as f64;
    let centre = |k: usize| (k as f64 + 0.5) * step;
    let at = |x: f64, y: f64| {
        let (mut sum, mut weights) = (0.0, 0.0);
        for (i, j) in (0..n * n).map(|k| (k % n, k / n)) {
            let weight = 1.0 / ((centre(i) - x).hypot(centre(j) - y)).max(1e-9);
            sum += weight * smooth(centre(i), centre(j));
            weights += weight;
        }
        sum / weights
    };
    const ASKED: usize = 37;
    let place = |k: usize| (k as f64 + 0.37) / ASKED as f64;
    let points = || (0..ASKED * ASKED).map(|k| (place(k % ASKED), place(k / ASKED)));
    let count = (ASKED * ASKED) as f64;
    let square: f64 = points().map(|(x, y)| (at(x, y) - smooth(x, y)).powi(2)).sum::<f64>() / count;
    let mean = points().map(|(x, y)| smooth(x, y)).sum::<f64>() / count;
    let spread = points().map(|(x, y)| (smooth(x, y) - mean).powi(2)).sum::<f64>() / count;
    (square / spread).sqrt()
}

/// Irradiance of a model at its sites, mean channel.
pub fn at_sites(model: &Model) -> Vec<f64> {
    let problem = model.problem();
    let transport =
        Transport { receivers: problem.receivers, spread: problem.spread, albedo: problem.albedo };
    let indirect = transport.push(&model.solution.irradiance);
    let total = |(site, light): (usize, &Vec3)| {
        f64::from(mean_channel(*light + model.direct.at_site(&model.lamps, site)))
    };
    indirect.iter().enumerate().map(total).collect()
}

/// The sites' irradiance interpolated by weights (1 − d/2h)² over sites turned alike, whatever stands between; NaN where no
/// site is within reach.
pub fn blind(model: &Model, light: &[f64], point: &SurfacePoint) -> f64 {
    let (mut sum, mut weights) = (0.0, 0.0);
    let sites = &model.sites;
    for (site, value) in light.iter().enumerate() {
        let reach = 2.0 * sites.spacings[site];
        let distance = sites.positions[site].distance(point.position);
        if distance < reach && sites.normals[site].dot(point.normal) > 0.7 {
            let weight = f64::from((1.0 - distance / reach).powi(2));
            sum += weight * value;
            weights += weight;
        }
    }
    sum / weights
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shepard_with_inverse_distance_does_not_converge() {
        let errors = [8, 16, 32].map(shepard_error);
        // Weights 1/d over a surface: ∫ 1/d · d dd does not concentrate at the point, so that the error stays.
        assert!(errors[2] > 0.8 * errors[0] && errors[0] > 0.1, "{errors:?}");
    }
}
