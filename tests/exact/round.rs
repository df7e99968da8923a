//! Spheres and craters: curved surfaces on which the exact irradiance is uniform although the light is not.

use std::f64::consts::PI;

use glam::DVec3;
use glowtree::light::mean_channel;
use glowtree::rays::Ray;

use crate::closed_forms as exact;
use crate::shapes::{self, part, points_on};
use crate::solved::{below, irradiance, solve, within};

#[test]
fn sphere_lit_by_its_lower_half() {
    let (rings, segments) = (64, 256);
    let lower = part("lower", shapes::zone(0.0, 0.5 * PI, rings, segments), 0.5).exitance(1.0);
    let upper = part("upper", shapes::zone(0.5 * PI, PI, rings, segments), 0.5);
    let model = solve(shapes::scene(&[lower, upper]), 0.01);
    let half = |exitance| exact::Zone { share: 0.5, exitance, albedo: 0.5 };
    let want = exact::sphere_interior(&[half(1.0), half(0.0)]);
    for (mesh, name, own) in [(0, "lower", 1.0), (1, "upper", 0.0)] {
        let light = irradiance(&model, mesh, 8000);
        // Facets of edge h = 0.0245 misplace h²/4 = 1.5e-4 of the light, and means over the hundreds of rows of a
        // half err by 0.7 % / √300 = 4e-4: together far inside the 0.2 % asked for.
        within(&format!("B of the {name} half"), own + 0.5 * light.mean(), own + 0.5 * want, 2e-3);
        // Each point on its own: the target.
        below(&format!("H of the {name} half, rms"), light.rms(want), 0.01);
    }
}

#[test]
fn craters_under_the_sun() {
    for (degrees, elevation, albedo) in [(40.0, 15.0, 0.3f32), (60.0, 30.0, 0.5), (90.0, 45.0, 0.8)] {
        let (half_angle, elevation) = (f64::to_radians(degrees), f64::to_radians(elevation));
        let shape = shapes::zone(0.0, half_angle, 64, 512);
        let scene = shapes::scene(&[part("crater", shape, albedo)]);
        let travel = DVec3::new(-elevation.cos(), 0.0, -elevation.sin());
        let model = solve(shapes::with_sun(scene, travel, 1.0), 0.01);
        let want = exact::crater(half_angle, elevation, f64::from(albedo), 1.0);
        let points = points_on(&model.scene, 0, 8000, 17);
        let answers = model.field().evaluate(&points);
        let light = crate::solved::Sampled {
            values: answers.iter().map(|a| f64::from(mean_channel(a.indirect))).collect(),
        };
        // A cap of rings and segments loses (h_ring² + h_segment²)/24 of its area and (2π²/3)/512² of its opening: f
        // moves by (1−f)/f · 5e-5 ≤ 4e-4. What counts is the shadow's edge: of n ≈ 900 sites about 2√n lie on it,
        // and each stands for all of its cell or none, 0.29 √60 = 2.2 of some 400 lit ones, 0.55 %. Two such
        // deviations, and 0.4 % for the mean over two hundred rows.
        within(&format!("crater of {degrees}°"), light.mean(), want, 1.5e-2);
        // Little of the light is indirect; the target is relative to all of it.
        let level = answers.iter().map(|a| f64::from(mean_channel(a.total()))).sum::<f64>() / 8000.0;
        below(&format!("crater of {degrees}°, rms of all light"), light.rms(want) * want / level, 0.01);
        // Direct light: the sun's cosine, or nothing in the shadow.
        let toward = -travel.normalize().as_vec3();
        for (point, answer) in points.iter().zip(&answers).step_by(80) {
            let free = !model.bvh.occluded(&Ray::new(point.lifted(), toward));
            let cosine = if free { point.normal.dot(toward).max(0.0) } else { 0.0 };
            // The same ray and two f32 products.
            assert!((mean_channel(answer.direct) - cosine).abs() < 1e-5, "{point:?}: {answer:?}");
        }
    }
}

/// Bakes a ball in a shell and compares both means and spreads with the exact solution.
fn ball_in_shell(inner: f64, exitances: [f64; 2], albedos: [f64; 2]) {
    // Both are the same polyhedron, scaled: the ratio of their areas is exact, and so is F₂₁.
    let ball = shapes::icosphere(inner, 5);
    let shell = shapes::icosphere(1.0, 5).flipped();
    let parts = [
        part("ball", ball, albedos[0] as f32).exitance(exitances[0] as f32),
        part("shell", shell, albedos[1] as f32).exitance(exitances[1] as f32),
    ];
    let model = solve(shapes::scene(&parts), 0.01);
    let want = exact::concentric_spheres([inner, 1.0], exitances, albedos);
    for (mesh, name) in [(0, "ball"), (1, "shell")] {
        let light = irradiance(&model, mesh, 8000);
        let radiosity = exitances[mesh] + albedos[mesh] * light.mean();
        // Two uniform surfaces whose factors are exact; rows see the ball's outline with 0.7 % noise each, the mean
        // of three hundred of them 4e-4: five standard errors are the 0.2 % asked for.
        within(&format!("B of the {name} of radius {inner}"), radiosity, want[mesh], 2e-3);
        let uniform = (want[mesh] - exitances[mesh]) / albedos[mesh];
        below(&format!("H of the {name}, rms"), light.rms(uniform), 0.01);
    }
}

#[test]
fn concentric_spheres() {
    ball_in_shell(0.5, [1.0, 0.0], [0.5, 0.5]);
}

#[test]
fn plates_as_a_thin_shell() {
    // Infinite plates cannot be meshed; a gap of 2 % between spheres is curved so little that the exact answer for the
    // spheres differs from that for plates only by F₂₁ = 0.96, and it is the spheres' own answer that is compared.
    let (exitances, albedos) = ([1.0, 0.5], [0.5, 0.8]);
    let shell = exact::concentric_spheres([0.98, 1.0], exitances, albedos);
    let plates = exact::parallel_plates(exitances, albedos);
    // 1 − F₂₁ of the shell's light returns to it instead of crossing: at most 4 % times the loop gain 1/(1−ρ₁ρ₂).
    within("thin shell as plates", shell[0], plates, 0.04 / (1.0 - 0.4));
    ball_in_shell(0.98, exitances, albedos);
}
