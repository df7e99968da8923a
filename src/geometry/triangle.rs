//! One triangle: area, normal, points by barycentric coordinates.

use glam::Vec3;

/// Twice the area times the unit normal: the cross product of two edges.
pub fn area_vector([a, b, c]: [Vec3; 3]) -> Vec3 {
    (b - a).cross(c - a)
}

/// Area in squared local units.
pub fn area(corners: [Vec3; 3]) -> f32 {
    0.5 * area_vector(corners).length()
}

/// Unit normal by the corners' winding; zero for a triangle without area.
pub fn normal(corners: [Vec3; 3]) -> Vec3 {
    area_vector(corners).normalize_or_zero()
}

/// The point a + u (b − a) + v (c − a).
pub fn point([a, b, c]: [Vec3; 3], u: f32, v: f32) -> Vec3 {
    a + (b - a) * u + (c - a) * v
}

/// Uniform barycentric coordinates (u, v) from the unit square, by Heitz' low-distortion map
/// ("A Low-Distortion Map Between Triangle and Square", 2019).
pub fn uniform_barycentric([x, y]: [f32; 2]) -> (f32, f32) {
    let half = 0.5 * if y < x { y } else { x };
    (x - half, y - half)
}
