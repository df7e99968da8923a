//! The cases, as they are numbered in `docs/stability.md`.

mod creases;
mod enclosures;
mod factors;
mod inputs;
mod small;
mod variants;
mod walls;

use super::Measured;
use crate::bake::Monitor;
use crate::error::Result;

/// What the textbook scheme gives, and what the program does.
type Numbers = (Vec<Measured>, Vec<Measured>);

/// A case.
pub struct Case {
    /// What may fail.
    pub title: &'static str,
    /// The textbook scheme that is measured beside.
    pub scheme: Option<&'static str>,
    /// Measures both.
    pub measure: fn(&dyn Monitor) -> Result<Numbers>,
}

const fn case(
    title: &'static str,
    scheme: Option<&'static str>,
    measure: fn(&dyn Monitor) -> Result<Numbers>,
) -> Case {
    Case { title, scheme, measure }
}

/// All of them.
pub const ROWS: [Case; 17] = [
    case("facing, adjacent, touching squares", Some("point-to-point kernel"), factors::near_and_far),
    case("furnace at high albedo", Some("point-to-point kernel"), enclosures::furnace),
    case("products at high albedo", Some("Neumann series"), enclosures::products),
    case("90° crease", Some("uniform strips"), creases::right_angle),
    case("thin wall", Some("interpolation by distance"), walls::thin),
    case("one floor under two rooms", Some("interpolation by distance"), walls::common_floor),
    case("occluder half a spacing wide", Some("one shadow ray a site"), small::leg),
    case("tiny bright emitter", Some("256 hemisphere rays"), small::emitter),
    case("target from 20 % to 0.2 %", Some("Shepard, weights 1/d"), variants::sweep),
    case("broken triangles", Some("point-to-point kernel"), inputs::broken),
    case("scale and offset", Some("f32 world coordinates"), variants::placed),
    case("coincident, intersecting surfaces", Some("rays from the surface itself"), inputs::coincident),
    case("speck smaller than every disc", Some("interpolation by distance"), small::speck_in_the_air),
    case("open scene", Some("point-to-point kernel"), enclosures::open),
    case("ten times the triangles", Some("one value a triangle"), variants::retessellated),
    case("order, rotation, seed", None, variants::reordered),
    case("albedo 1, negative light, NaN", Some("Neumann series"), inputs::refused),
];
