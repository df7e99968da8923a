//! Scenes in which nothing, or next to nothing, exchanges light: few sites suffice, and the sky's light is exact.
//!
//! A plane under a sky of radiance 1 sees nothing else: H = π on both of its sides.

use std::f64::consts::PI;

use glam::DVec3;
use glowtree::bake::laws::Plan;
use glowtree::bake::model::Model;

use crate::shapes::{self, Part, Shape, grid, part, under_sky, with_sun};
use crate::solved::{irradiance, solve, within};

/// Both ends of what is asked for.
const TARGETS: [f64; 2] = [0.05, 0.005];

/// Into a frame that is aligned with no axis; `v.z` is the height over the floor.
fn tilted(v: DVec3) -> DVec3 {
    let (s, c) = 0.37f64.sin_cos();
    let (t, d) = 0.61f64.sin_cos();
    let (y, z) = (c * v.y - s * v.z, s * v.y + c * v.z);
    DVec3::new(d * v.x - t * y, t * v.x + d * y, z)
}

/// A tilted square of this edge around a centre, of 2n² triangles.
fn sheet(n: u32, edge: f64, centre: DVec3) -> Shape {
    grid(n, n, |x, y| tilted(centre + edge * DVec3::new(x - 0.5, y - 0.5, 0.0)))
}

fn floor(n: u32) -> Part {
    part("floor", sheet(n, 1.0, DVec3::ZERO), 0.7).two_sided()
}

/// Sites are no more than the plan may ask for, and at least enough to cover the first level's receivers.
///
/// Wanted spacings w are met within √2, disks pack to 0.72 of a site a squared spacing: at most 1.44 A/w² sites. w is the
/// least of 3 r√(1/s) and 0.7 R, s the share of rays that meet surfaces, R the receivers' radius, r² = 0.76 Aₓ/finest the
/// smallest and Aₓ = ∫s dA. The former asks for 1.44 · finest/(9 · 0.76) = 0.21 finest; the latter for 1.44 · finest/(0.49 · 0.76)
/// = 3.9 finest where surfaces meet, and in the open, where R is 1.25 first spacings, R² = 1.56 · 0.76 A/64, for 160.
fn few_sites(model: &Model, error: f64, share: f64) {
    let finest = Plan::new(error, 1).receivers.finest;
    let most = ((0.21 + 3.9 * share) * finest + 160.0) as usize;
    let sites = model.sites.len();
    assert!((50..=most).contains(&sites), "{sites} sites for {} %, not 50 to {most}", 100.0 * error);
}

/// Bakes under the sky and asks for the mean irradiance of the first mesh within 0.1 %: constant light is gathered
/// without noise, rounding is 1e-5.
fn holds(name: &str, parts: &[Part], share: f64) {
    for error in TARGETS {
        let model = solve(under_sky(shapes::scene(parts), 1.0), error);
        few_sites(&model, error, share);
        within(name, irradiance(&model, 0, 2000).mean(), PI, 1e-3);
    }
}

#[test]
fn open_floors_need_few_sites() {
    for n in [1, 64] {
        holds("floor", &[floor(n)], 0.0);
    }
    let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y].map(tilted).to_vec();
    let triangle = Shape { vertices: triangle, triangles: vec![[0, 1, 2]] };
    holds("triangle", &[part("triangle", triangle, 0.7).two_sided()], 0.0);
}

#[test]
fn sheets_far_apart_need_few_sites() {
    // Each takes (1/100)²/π = 3e-5 of the other's sky.
    let far = part("far", sheet(1, 1.0, 100.0 * DVec3::Z), 0.7).two_sided();
    holds("sheets", &[floor(1), far], 0.0);
}

#[test]
fn a_speck_over_an_open_floor_needs_few_sites() {
    // 1e-6 of the floor's area takes that share of the sky from it in the mean. Surfaces meet at the speck alone: it may
    // take all of what the plan has for them.
    for n in [1, 64] {
        let speck = part("speck", sheet(1, 1e-3, DVec3::new(0.1, 0.1, 0.01)), 0.7).two_sided();
        holds("floor under a speck", &[floor(n), speck], 1.0);
    }
}

#[test]
fn an_open_floor_under_a_sun_needs_few_sites() {
    for error in TARGETS {
        let sunny =
            with_sun(under_sky(shapes::scene(&[floor(1)]), 1.0), -tilted(DVec3::new(0.6, 0.0, 0.8)), 2.0);
        let model = solve(sunny, error);
        few_sites(&model, error, 0.0);
        // The sun stands 0.8 over the floor's front.
        within("floor under a sun", irradiance(&model, 0, 2000).mean(), PI + 1.6, 1e-3);
    }
}
