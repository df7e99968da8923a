//! Meshless hierarchical radiosity for scenes bigger than memory.
//!
//! The pipeline is the architecture; each stage is one module, each arrow one verb:
//!
//! `scene → sites → tree → links → transport (R) → solution → pictures`
//!
//! * [`scene`] reads meshes, materials, skies, lamps and cameras into one local, unit-sized frame.
//! * [`rays`] builds a bounding-volume hierarchy and answers closest-hit and occlusion queries, watertight.
//! * [`detail`] cuts a mesh that memory cannot hold into chunks, and makes a coarse stand-in for it.
//! * [`scatter`] grows points over the surfaces, coarse to fine, where they are wanted.
//! * [`sites`] scatters nested Poisson-disk sites (position, normal, area) over the surfaces.
//! * [`tree`] arranges the sites' levels into clusters and interpolates between them.
//! * [`basis`] makes functions of values at scattered supports, in several ways.
//! * [`links`] gathers, per receiver, direct light from lamps, light from the sky and rows of the transport operator R.
//! * [`solve`] iterates pull, gather, push to the radiosity B = E + ρRB.
//! * [`mod@reference`] path traces the same scene to judge the result.
//! * [`output`] turns a solution into meshes, tables and pictures, [`plot`] into figures; [`bake`] runs the job; [`cli`]
//!   is the program.
//!
//! Letters and equations: `docs/theory.md`. Words: `docs/glossary.md`.

pub mod archive;
pub mod bake;
pub mod basis;
pub mod cli;
pub mod compare;
pub mod detail;
pub mod error;
pub mod geometry;
pub mod light;
pub mod links;
pub mod output;
pub mod plot;
pub mod rays;
pub mod reference;
pub mod scatter;
pub mod scene;
pub mod sites;
pub mod solve;
pub mod tree;

pub use error::{Error, Result};
