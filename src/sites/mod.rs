//! Sites: the points at which light is known.

use glam::Vec3;

/// Nested Poisson-disk sites over the surfaces, structure of arrays in Morton order.
pub struct Sites {
    /// Local positions.
    pub positions: Vec<Vec3>,
    /// Unit normals of the sides the sites belong to.
    pub normals: Vec<Vec3>,
    /// Surface area each stands for, squared local units; they sum to the area of all sides that carry sites.
    pub areas: Vec<f32>,
    /// The triangle each lies on.
    pub triangles: Vec<u32>,
    /// Barycentric (u, v) on that triangle.
    pub barycentrics: Vec<[f32; 2]>,
    /// The coarsest level at which each takes part, root = 0.
    pub levels: Vec<u8>,
    /// Poisson spacing of the finest level, local units; level l has spacing · ratio^(finest − l).
    pub spacing: f32,
}
