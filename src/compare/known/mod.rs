//! Scenes made in code and what is known of their light in closed form.

pub mod answers;
pub mod scenes;
pub mod shape;
pub mod solids;

pub use scenes::{Part, part, points_on, scene, under_sky, with_point_lamp, with_sun};
pub use shape::{Shape, grid, quad};
pub use solids::{
    box_faces, cuboid, disc, hinged_squares, icosphere, parallel_rectangles, tetrahedron, zone,
};
