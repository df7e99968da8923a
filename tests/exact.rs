//! The whole pipeline against answers known in advance: furnaces, spheres, craters, rooms and configuration factors.
//!
//! Letters: E₀ exitance, ρ albedo, H irradiance, B = E₀ + ρH radiosity, S area, F configuration factor, Φ flux.
//! Every bake runs through `bake::pipeline::build`, every answer comes from `Field::evaluate` at points of the test's
//! own. A row of N = 256 lattice rays errs by 0.7 % where the light has edges (docs/theory.md, lattice noise);
//! interpolation averages a few rows, a mean over a face hundreds: that is what most tolerances are made of.

mod closed_forms;
mod shapes;

#[path = "exact/boxes.rs"]
mod boxes;
#[path = "exact/factors.rs"]
mod factors;
#[path = "exact/furnace.rs"]
mod furnace;
#[path = "exact/meshes.rs"]
mod meshes;
#[path = "exact/open.rs"]
mod open;
#[path = "exact/operator.rs"]
mod operator;
#[path = "exact/round.rs"]
mod round;
#[path = "exact/solved.rs"]
mod solved;
