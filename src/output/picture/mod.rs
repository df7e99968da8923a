//! Images: a camera, the rays it shoots, the film they fall on, the files that hold it.

pub mod camera;
pub mod film;
pub mod framing;
pub mod layers;
pub mod lights;
pub mod png;
pub mod render;

pub use camera::Pinhole;
pub use film::Film;
pub use framing::{View, frame};
pub use layers::LightLayer;
pub use lights::LightFilm;
pub use render::{Quality, render};
