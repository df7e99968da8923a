//! Row 1: form factors between squares near and far.

use glam::DVec3;

use super::Numbers;
use crate::bake::Monitor;
use crate::compare::known::{self, Part, Shape, answers, hinged_squares, parallel_rectangles, part, quad};
use crate::compare::stability::Measured;
use crate::compare::stability::bakes::{mean, over, planned};
use crate::compare::textbook::points::{self, Point};
use crate::error::Result;

/// What is asked of every factor.
const LIMIT: f64 = 0.01;

/// The bakes' target: over seeds the factor of squares hinged at 120° has a standard deviation as large as the target, so that
/// a bake at 0.4 % keeps it within 1 % at 2.5 of them.
const TARGET: f64 = 0.004;

/// Two rectangles and their factor, from the first to the second.
struct Pair {
    name: String,
    shapes: [Shape; 2],
    factor: f64,
}

fn pairs() -> Vec<Pair> {
    let facing = |ratio: f64| {
        let factor = answers::parallel_rectangles(1.0 / ratio, 1.0 / ratio);
        let n = if ratio > 4.0 { 4 } else { 16 };
        let shapes = parallel_rectangles(1.0, 1.0, ratio, n);
        Pair { name: format!("facing at d/h {ratio}"), shapes, factor }
    };
    let hinged = |&(degrees, factor): &(f64, f64)| Pair {
        name: format!("adjacent at {degrees}°"),
        shapes: hinged_squares(degrees, 16),
        factor,
    };
    let touching = |height: f64| {
        let floor = quad(DVec3::ZERO, DVec3::X, DVec3::Y, 16);
        let wall = quad(DVec3::ZERO, DVec3::Y, DVec3::Z * height, 16);
        let factor = answers::perpendicular_rectangles(height, 1.0);
        Pair { name: format!("touching, 1 and {height}"), shapes: [floor, wall], factor }
    };
    let facing = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0].map(facing);
    let hinged = answers::HINGED_SQUARES.iter().map(hinged);
    facing.into_iter().chain(hinged).chain([0.1, 10.0].map(touching)).collect()
}

/// Form factors of thirteen pairs of squares within 1 % of the catalogue.
///
/// Seen to fail: on the textbook scheme, +59 % for facing squares at distance 1.
pub fn near_and_far(monitor: &dyn Monitor) -> Result<Numbers> {
    let (mut textbook, mut ours) = (Vec::new(), Vec::new());
    for Pair { name, shapes, factor } in pairs() {
        let [first, second] = [centre(&shapes[0]), centre(&shapes[1])];
        let relative = |got: f64| (got / factor - 1.0).abs();
        textbook.push(Measured::share(name.clone(), relative(points::factor(&first, &second)), LIMIT));
        ours.push(Measured::share(name, relative(baked(shapes, monitor)?), LIMIT));
    }
    Ok((textbook, ours))
}

/// The middle of a rectangle, standing for all of it.
fn centre(shape: &Shape) -> Point {
    let all = points::of_parts(&[part("rectangle", shape.clone(), 0.0)]);
    let position = all.iter().map(|p| p.position).sum::<DVec3>() / all.len() as f64;
    Point { position, area: shape.area(), ..all[0] }
}

/// The factor as light: the smaller one receives, black, under the other of exitance 1; A₁F₁₂ = A₂F₂₁.
fn baked([first, second]: [Shape; 2], monitor: &dyn Monitor) -> Result<f64> {
    let (a, b) = (first.area(), second.area());
    let (receiver, emitter, ratio) = if a <= b { (first, second, 1.0) } else { (second, first, b / a) };
    let parts: [Part; 2] = [part("emitter", emitter, 0.0).exitance(1.0), part("receiver", receiver, 0.0)];
    let (model, _) = planned(known::scene(&parts), TARGET, monitor)?;
    Ok(mean(&over(&model, 1, 4096)) * ratio)
}
