//! Rays against triangles: a bounding-volume hierarchy in flat arrays, closest hits and occlusion, watertight.

use glam::Vec3;

use crate::scene::Scene;

/// A ray segment in local units: origin + t · direction for t in (t_min, t_max).
#[derive(Debug, Clone, Copy)]
pub struct Ray {
    /// Where it starts.
    pub origin: Vec3,
    /// Unit direction.
    pub direction: Vec3,
    /// Hits at or before this distance do not count.
    pub t_min: f32,
    /// Hits at or beyond this distance do not count.
    pub t_max: f32,
}

impl Ray {
    /// A ray that goes on for ever.
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, direction, t_min: 0.0, t_max: f32::INFINITY }
    }

    /// The open segment between two points, as a visibility test wants it.
    pub fn between(from: Vec3, to: Vec3) -> Self {
        let d = to - from;
        let length = d.length();
        Self { origin: from, direction: d / length.max(f32::MIN_POSITIVE), t_min: 0.0, t_max: length }
    }
}

/// Where a ray met the scene first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Distance along the ray, local units.
    pub distance: f32,
    /// The triangle, as numbered in [`Scene::triangles`].
    pub triangle: u32,
    /// Barycentric coordinate of the second corner.
    pub u: f32,
    /// Barycentric coordinate of the third corner.
    pub v: f32,
}

/// The acceleration structure over a scene's triangles, owned.
pub struct Bvh {}

impl Bvh {
    /// Builds over all triangles of the scene.
    pub fn build(scene: &Scene) -> Self {
        let _ = scene;
        Self {}
    }

    /// The nearest hit of the ray, from either side of a triangle.
    pub fn closest(&self, ray: &Ray) -> Option<Hit> {
        let _ = ray;
        None
    }

    /// Whether anything lies on the segment.
    pub fn occluded(&self, ray: &Ray) -> bool {
        let _ = ray;
        false
    }
}
