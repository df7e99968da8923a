//! Row 4: light near a concave edge rises as r^β.

use glam::{DVec3, Vec3};

use super::Numbers;
use crate::bake::Monitor;
use crate::bake::model::Model;
use crate::compare::known::{self, answers, part, quad};
use crate::compare::stability::Measured;
use crate::compare::stability::bakes::{light, mean, planned};
use crate::compare::textbook::strips;
use crate::error::Result;
use crate::geometry::SurfacePoint;

/// What is asked of the exponent.
const LIMIT: f64 = 0.05;

/// Distances from the edge, in widths of the walls: from 0.01 to 0.2 the exact solution itself fits to within 0.009.
const FROM: f64 = 0.01;
const TO: f64 = 0.2;
const STEPS: usize = 16;

/// Length of the edge in widths of the walls.
const LENGTH: f64 = 6.0;

fn distances() -> Vec<f64> {
    (0..STEPS).map(|k| FROM * (TO / FROM).powf(k as f64 / (STEPS - 1) as f64)).collect()
}

/// The exponent of B ≈ c₀ + c₁ r^β fitted at a 90° edge within 0.05 of the exact one.
///
/// Two long walls of width 1 glow alike. By Mellin's transform their solution is c₀ + c₁ r^β + O(r³): the linear term is
/// missing, so that the exponent can be told from 1. Seen to fail: on uniform strips.
pub fn right_angle(monitor: &dyn Monitor) -> Result<Numbers> {
    let (mut textbook, mut ours) = (Vec::new(), Vec::new());
    let wanted = answers::CREASE_EXPONENTS.iter().filter(|(albedo, _)| [0.5, 0.8, 0.9].contains(albedo));
    for &(albedo, exponent) in wanted {
        let floor = quad(DVec3::ZERO, DVec3::X, DVec3::Y * LENGTH, 8);
        let wall = quad(DVec3::ZERO, DVec3::Y * LENGTH, DVec3::Z, 8);
        let parts = [floor, wall].map(|shape| part("wall", shape, albedo as f32).exitance(1.0));
        let (model, _) = planned(known::scene(&parts), 0.005, monitor)?;
        let name = format!("exponent at albedo {albedo} off by");
        ours.push(Measured::plain(name.clone(), (fitted(&profile(&model, albedo)) - exponent).abs(), LIMIT));
        let strips = strips::radiosity(16, albedo);
        let uniform: Vec<f64> = distances().iter().map(|&r| strips::interpolated(&strips, r)).collect();
        textbook.push(Measured::plain(name, (fitted(&uniform) - exponent).abs(), LIMIT));
    }
    Ok((textbook, ours))
}

/// Mean radiosity at each distance over 200 places along the edge's middle third.
fn profile(model: &Model, albedo: f64) -> Vec<f64> {
    let placement = &model.scene.placement;
    let along = |k: usize| LENGTH * (1.0 + (k as f64 + 0.5) / 200.0) / 3.0;
    let at = |r: f64| {
        let points: Vec<SurfacePoint> = (0..200)
            .flat_map(|k| {
                let floor = (DVec3::new(r, along(k), 0.0), Vec3::Z);
                let wall = (DVec3::new(0.0, along(k), r), Vec3::X);
                [floor, wall].map(|(p, normal)| SurfacePoint { position: placement.to_local(p), normal })
            })
            .collect();
        1.0 + albedo * mean(&light(model, &points))
    };
    distances().into_iter().map(at).collect()
}

/// β of the best c₀ + c₁ r^β: for each β the two constants by least squares.
fn fitted(values: &[f64]) -> f64 {
    let misfit = |exponent: f64| {
        let powers: Vec<f64> = distances().iter().map(|r| r.powf(exponent)).collect();
        let (p, v) = (mean(&powers), mean(values));
        let cross: f64 = powers.iter().zip(values).map(|(a, b)| (a - p) * (b - v)).sum();
        let square: f64 = powers.iter().map(|a| (a - p).powi(2)).sum();
        let slope = cross / square;
        powers.iter().zip(values).map(|(a, b)| (b - v - slope * (a - p)).powi(2)).sum::<f64>()
    };
    let tried = (200..1600).map(|k| f64::from(k) * 1e-3);
    tried.min_by(|a, b| misfit(*a).total_cmp(&misfit(*b))).unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponents_of_pure_powers_are_found() {
        for exponent in [0.54, 0.7634, 0.95] {
            let values: Vec<f64> = distances().iter().map(|r| 1.3 - 0.3 * r.powf(exponent)).collect();
            // The step of the search.
            assert!((fitted(&values) - exponent).abs() < 1e-3);
        }
    }
}
