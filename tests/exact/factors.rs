//! Configuration factors as light: a black receiver under an emitter of exitance 1, F₁₂ = ⟨H₂⟩ A₂/A₁.

use glam::DVec3;
use glowtree::geometry::SurfacePoint;
use glowtree::light::mean_channel;

use crate::closed_forms as exact;
use crate::shapes::{self, Shape, part};
use crate::solved::{irradiance, solve, within};

/// F from the first shape to the second. The smaller one receives, so that its light varies little over the points
/// (by reciprocity A₁F₁₂ = A₂F₂₁, and F from the receiver is its mean irradiance).
pub fn factor(from: Shape, to: Shape) -> f64 {
    let (first, second) = (from.area(), to.area());
    let (receiver, emitter) = if first <= second { (from, to) } else { (to, from) };
    let ratio = if first <= second { 1.0 } else { second / first };
    let parts = [part("emitter", emitter, 0.0).exitance(1.0), part("receiver", receiver, 0.0)];
    let model = solve(shapes::scene(&parts), BAKED_AT);
    irradiance(&model, 1, 4096).mean() * ratio
}

/// Pairs of figures, told together so that one failure does not hide the others.
#[derive(Default)]
pub struct Table {
    failures: Vec<String>,
}

impl Table {
    /// Adds a factor, asked for within [`FACTOR`].
    pub fn add(&mut self, what: &str, got: f64, want: f64) {
        let line = format!("{what}: got {got:.6}, want {want:.6}: {:+.3} %", 100.0 * (got / want - 1.0));
        println!("{line}");
        if (got / want - 1.0).abs() > FACTOR {
            self.failures.push(line);
        }
    }

    /// Asserts that all held.
    pub fn holds(self) {
        assert!(self.failures.is_empty(), "off by more than 1 %:\n{}", self.failures.join("\n"));
    }
}

/// What is asked of every factor.
pub const FACTOR: f64 = 0.01;

/// The bakes' target. Over seeds the factor of squares hinged at 120° has a standard deviation as large as the target, so
/// that a bake at 0.4 % keeps it within 1 % at 2.5 of them.
pub const BAKED_AT: f64 = 0.004;

#[test]
fn parallel_squares() {
    let mut table = Table::default();
    // Distances of 0.1 to 2 edges and an oblong pair; farther ones are `distant_squares`.
    for (a, b) in [(0.5, 0.5), (1.0, 1.0), (1.0, 2.0), (2.0, 2.0), (4.0, 4.0), (10.0, 10.0)] {
        let [floor, top] = shapes::parallel_rectangles(a, b, 1.0, 16);
        table.add(&format!("parallel {a} × {b}"), factor(floor, top), exact::parallel_rectangles(a, b));
    }
    table.holds();
}

#[test]
fn distant_squares() {
    let mut table = Table::default();
    // Ten edges apart, F = 0.0032: one ray of a row of 256 does not even meet the emitter on average.
    let [floor, top] = shapes::parallel_rectangles(0.1, 0.1, 1.0, 4);
    table.add("parallel 0.1 × 0.1", factor(floor, top), exact::parallel_rectangles(0.1, 0.1));
    table.holds();
}

#[test]
fn perpendicular_rectangles() {
    let mut table = Table::default();
    for (h, w) in [(1.0, 1.0), (2.0, 1.0), (10.0, 1.0), (0.5, 1.0), (0.1, 1.0), (5.0, 5.0)] {
        let floor = shapes::quad(DVec3::ZERO, DVec3::X * w, DVec3::Y, 16);
        let wall = shapes::quad(DVec3::ZERO, DVec3::Y, DVec3::Z * h, 16);
        table.add(
            &format!("perpendicular {h} × {w}"),
            factor(floor, wall),
            exact::perpendicular_rectangles(h, w),
        );
    }
    table.holds();
}

#[test]
fn hinged_squares() {
    let mut table = Table::default();
    for (degrees, want) in exact::HINGED_SQUARES {
        let [floor, leaf] = shapes::hinged_squares(degrees, 16);
        table.add(&format!("hinged at {degrees}°"), factor(floor, leaf), want);
    }
    table.holds();
}

#[test]
fn coaxial_discs() {
    let mut table = Table::default();
    for (from, to, distance) in [(1.0, 1.0, 1.0), (1.0, 1.0, 2.0), (1.0, 2.0, 1.0), (1.0, 1.0, 0.1)] {
        // A fan of 256 triangles misses 1e-4 of the disc.
        let emitter = shapes::disc(from, 256);
        let receiver = shapes::disc(to, 256).flipped().translated(DVec3::Z * distance);
        let want = exact::coaxial_discs(from, to, distance);
        table.add(&format!("discs {from}, {to} at {distance}"), factor(emitter, receiver), want);
    }
    table.holds();
}

#[test]
fn elements_under_a_small_lamp() {
    // A unit square over a floor of 8 × 8 is below the share of area from which rows meet emitters: it is aimed at,
    // by Lambert's exact formula. Both are f32 sums of a dozen terms; nothing is in the way.
    let lamp = shapes::quad(DVec3::new(-0.5, -0.5, 1.0), DVec3::Y, DVec3::X, 1);
    let floor = shapes::quad(DVec3::new(-4.0, -4.0, 0.0), DVec3::X * 8.0, DVec3::Y * 8.0, 8);
    let scene = shapes::scene(&[part("lamp", lamp, 0.0).exitance(1.0), part("floor", floor, 0.0)]);
    let model = solve(scene, 0.01);
    let at = |x: f64, y: f64| SurfacePoint {
        position: model.scene.placement.to_local(DVec3::new(x, y, 0.0)),
        normal: glam::Vec3::Z,
    };
    let answers = model.field().evaluate(&[at(0.0, 0.0), at(0.5, 0.5)]);
    let want = [exact::point_under_centre(1.0, 1.0, 1.0), exact::point_under_corner(1.0, 1.0, 1.0)];
    for (answer, want) in answers.iter().zip(want) {
        within("element under a square", f64::from(mean_channel(answer.total())), want, 1e-4);
    }
}
