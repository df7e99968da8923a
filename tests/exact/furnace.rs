//! The furnace: closed, uniform E₀ and ρ, so B = E₀/(1−ρ) whatever the geometry.
//!
//! Rows average over what their rays meet, so that only lost energy can make a difference: a share ε of rays that end
//! on black backs or in the sky lowers B by ερ/(1−ρ). Fits multiply rotational gradients, whose lattice noise remains
//! on curved surfaces. Targets are coarse: the furnace must be exact at any.

use glam::DVec3;

use crate::closed_forms as exact;
use crate::shapes::{self, Part, Shape, part};
use crate::solved::{below, irradiance, solve};

/// Bakes the parts with exitance 1 and this albedo, and asks for B within `limit` at each of 4,000 points a part.
fn holds(name: &str, parts: &[Part], albedo: f32, limit: f64) {
    let parts: Vec<Part> =
        parts.iter().map(|p| Part { albedo: glam::Vec3::splat(albedo), ..p.clone() }.exitance(1.0)).collect();
    let model = solve(shapes::scene(&parts), 0.03);
    let want = exact::furnace(1.0, f64::from(albedo));
    for (mesh, part) in parts.iter().enumerate() {
        let mut light = irradiance(&model, mesh, 4000);
        light.values.iter_mut().for_each(|h| *h = 1.0 + f64::from(albedo) * *h);
        let title = format!("{name}, {}, albedo {albedo}: mean {:.5}", part.name, light.mean() / want);
        below(&title, light.worst(want), limit);
    }
}

fn room() -> Shape {
    shapes::cuboid(DVec3::ZERO, DVec3::ONE, 2).flipped()
}

/// Radius 1 + 0.2 · a product of waves: bumps of several sizes, still seen whole from the centre.
fn bumpy() -> Shape {
    let waves = |v: DVec3| (5.0 * v.x).sin() * (4.0 * v.y + 1.0).sin() * (6.0 * v.z + 2.0).cos();
    shapes::icosphere(1.0, 4).mapped(|v| v * (1.0 + 0.2 * waves(v))).flipped()
}

/// f32 alone: a sum of at most 2,048 terms and a hundred products round to about 1e-5; a tenth of the 0.1 % that the
/// stability suite allows, times ten for one ray in 10⁶ at ρ = 0.99 that slips out through a crease.
const FLAT: f64 = 1e-3;

/// On round surfaces gradients add their noise; 0.2 % is asked for.
const ROUND: f64 = 2e-3;

#[test]
fn furnace_cube() {
    for albedo in [0.5, 0.9, 0.99] {
        holds("cube", &[part("walls", room(), 0.0)], albedo, FLAT);
    }
}

#[test]
fn furnace_sphere() {
    for albedo in [0.5, 0.9, 0.99] {
        holds("sphere", &[part("sphere", shapes::icosphere(1.0, 4).flipped(), 0.0)], albedo, ROUND);
    }
}

#[test]
fn furnace_bumpy_cave() {
    for albedo in [0.5, 0.9, 0.99] {
        holds("bumpy", &[part("cave", bumpy(), 0.0)], albedo, ROUND);
    }
}

#[test]
fn furnace_with_occluders() {
    let block = shapes::cuboid(DVec3::new(0.2, 0.2, 0.1), DVec3::new(0.5, 0.6, 0.5), 2);
    let ball = shapes::icosphere(0.15, 3).translated(DVec3::new(0.7, 0.4, 0.6));
    let leaf = shapes::quad(DVec3::new(0.3, 0.8, 0.2), DVec3::X * 0.4, DVec3::Z * 0.5, 1);
    // One mesh each side count: every part is above the share of area below which emitters are aimed at.
    let solids = part("room, block and ball", room().with(&block).with(&ball), 0.0);
    let parts = [solids, part("leaf", leaf.scaled(1.0), 0.0).two_sided()];
    for albedo in [0.5, 0.9, 0.99] {
        holds("occluders", &parts[..1], albedo, ROUND);
    }
    // The leaf holds 0.2 of 7.4: it becomes a lamp, analytic with sampled shadows, while rows meet the rest. The sum is
    // exact only up to the target of 3 %, of the share of light that comes from the leaf (a tenth where it is near).
    holds("leaf as a lamp", &parts, 0.5, 0.03);
}
