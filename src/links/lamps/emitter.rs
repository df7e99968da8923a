//! Emitting faces: their exact form factors, and points on them.
//!
//! This work is based on: Lambert, "Photometria", 1760 (the polygon's form factor), as given by Baum, Rushmeier and
//! Winget 1989 (horizon clipping).

use std::collections::HashSet;

use glam::{DVec3, Vec3};
use smallvec::SmallVec;

use crate::geometry::{SurfacePoint, triangle};
use crate::scene::Scene;

/// One side of a triangle that emits: corners run counter-clockwise seen from that side.
#[derive(Debug, Clone, Copy)]
pub struct Face {
    /// Local positions.
    pub corners: [Vec3; 3],
    /// Unit normal of the side that emits.
    pub normal: Vec3,
    /// Squared local units.
    pub area: f32,
}

/// The faces of an emitting mesh; a triangle that emits to both sides is two.
#[derive(Debug, Clone)]
pub struct Emitter {
    /// Those with area, each place and side once.
    pub faces: Vec<Face>,
    /// Mesh index in the scene.
    pub mesh: usize,
}

/// Faces seen so far by their corners' bits: of coincident ones, only the first gives light.
///
/// A ray that meets coincident triangles sees one of them; aimed rays, which end just before, would count each.
pub(super) type Seen = HashSet<[[u32; 3]; 3]>;

impl Emitter {
    /// The faces of a mesh that are not in `seen`, which they enter.
    pub(super) fn new(scene: &Scene, mesh: usize, seen: &mut Seen) -> Self {
        let m = &scene.meshes[mesh];
        let mut faces = Vec::new();
        for t in m.triangles.clone() {
            let [a, b, c] = scene.corners(t);
            let sides = [[a, b, c], [a, c, b]];
            for corners in &sides[..if m.two_sided { 2 } else { 1 }] {
                let area = triangle::area(*corners);
                if area > 0.0 && seen.insert(key(corners)) {
                    faces.push(Face { corners: *corners, normal: triangle::normal(*corners), area });
                }
            }
        }
        Self { faces, mesh }
    }
}

/// The same for the same face, whichever corner comes first.
fn key(corners: &[Vec3; 3]) -> [[u32; 3]; 3] {
    // Adding zero turns -0 into +0.
    let bits = corners.map(|c| (c + Vec3::ZERO).to_array().map(f32::to_bits));
    let first = (0..3).min_by_key(|&k| bits[k]).unwrap_or(0);
    [bits[first], bits[(first + 1) % 3], bits[(first + 2) % 3]]
}

impl Face {
    /// The unoccluded form factor from a surface point to the face.
    pub fn form_factor(&self, at: &SurfacePoint) -> f32 {
        let faces = (at.position - self.corners[0]).dot(self.normal) > 0.0;
        if faces { triangle_form_factor(at, &self.corners) } else { 0.0 }
    }

    /// A point of the face, uniform by area from the unit square.
    pub fn point(&self, numbers: [f32; 2]) -> Vec3 {
        let (u, v) = triangle::uniform_barycentric(numbers);
        triangle::point(self.corners, u, v)
    }

    /// The kernel cosθ cosθ′/(π r²) from a surface point to a point of the face, zero where they do not face.
    pub fn kernel(&self, at: &SurfacePoint, target: Vec3) -> f32 {
        let d = target - at.position;
        let square = d.length_squared();
        let (here, there) = (d.dot(at.normal), -d.dot(self.normal));
        if here <= 0.0 || there <= 0.0 || square <= 0.0 {
            return 0.0;
        }
        here * there / (std::f32::consts::PI * square * square)
    }
}

/// The form factor from a surface element to a triangle, clipped at the element's horizon (Lambert's formula).
///
/// F = (1/2π) |Σ γᵢ n·Γᵢ| over the edges of the clipped polygon. Of a triangle of angular size ε the terms are ε, their sum ε²:
/// in f32, 10⁻⁷ off each, it is noise from ε = 10⁻³ on; in f64, from edges that are exact, it is good to 10⁻¹⁶ / ε.
pub fn triangle_form_factor(at: &SurfacePoint, corners: &[Vec3; 3]) -> f32 {
    let (position, normal) = (at.position.as_dvec3(), at.normal.as_dvec3());
    let relative = corners.map(|c| c.as_dvec3() - position);
    let height = relative.map(|c| c.dot(normal));
    if height.iter().all(|&h| h <= 0.0) {
        return 0.0;
    }
    let mut polygon = SmallVec::<[DVec3; 4]>::new();
    for i in 0..3 {
        let j = (i + 1) % 3;
        if height[i] > 0.0 {
            polygon.push(relative[i]);
        }
        if (height[i] > 0.0) != (height[j] > 0.0) {
            polygon.push(relative[i].lerp(relative[j], height[i] / (height[i] - height[j])));
        }
    }
    let mut sum = 0.0;
    for (i, a) in polygon.iter().enumerate() {
        let b = &polygon[(i + 1) % polygon.len()];
        let cross = a.cross(*b - *a);
        sum += angle_over_sine(cross.length_squared(), a.dot(*b)) * cross.dot(normal);
    }
    (sum.abs() / std::f64::consts::TAU).min(1.0) as f32
}

/// The angle between two vectors over the length of their cross product, from its square and their dot product.
fn angle_over_sine(square: f64, dot: f64) -> f64 {
    let t = square / (dot * dot);
    if dot > 0.0 && t < 1.0 / 256.0 {
        // arctan's series, up to t⁵/11 = 8e-14.
        return (1.0 - t * (1.0 / 3.0 - t * (1.0 / 5.0 - t * (1.0 / 7.0 - t / 9.0)))) / dot;
    }
    let length = square.sqrt();
    if length > 0.0 { length.atan2(dot) / length } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(z: f32) -> [[Vec3; 3]; 2] {
        let p = |x, y| Vec3::new(x, y, z);
        [[p(0.0, 0.0), p(1.0, 0.0), p(1.0, 1.0)], [p(0.0, 0.0), p(1.0, 1.0), p(0.0, 1.0)]]
    }

    #[test]
    fn polygon_factors_match_howells_catalogue() {
        let factor = |position, normal| -> f32 {
            square(1.0).iter().map(|t| triangle_form_factor(&SurfacePoint { position, normal }, t)).sum()
        };
        // Element under the centre and under a corner of a unit square at height 1; sums of two in f32, 3e-8 each.
        assert!((factor(Vec3::new(0.5, 0.5, 0.0), Vec3::Z) - 0.239_456_47).abs() < 2e-7);
        assert!((factor(Vec3::ZERO, Vec3::Z) - 0.138_531_6).abs() < 2e-7);
        assert_eq!(factor(Vec3::ZERO, -Vec3::Z), 0.0);
    }

    #[test]
    fn tiny_triangles_keep_their_digits() {
        let position = Vec3::new(0.3, -0.5, 0.9);
        let at = SurfacePoint { position, normal: Vec3::new(0.2, 0.4, -1.0).normalize() };
        for edge in [1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7] {
            let corners = [(1.0, 0.0), (-0.5, 0.8), (-0.5, -0.8)].map(|(x, y)| Vec3::new(x, y, 0.0) * edge);
            let area = 1.2 * edge * edge;
            let face = Face { corners, normal: Vec3::Z, area };
            // About the centroid the kernel's second term is below 12 σ² / d², σ² = e²/4; f32 kernels are off by 10⁻⁶.
            let (got, want) = (face.form_factor(&at), face.kernel(&at, Vec3::ZERO) * area);
            assert!((got / want - 1.0).abs() < 2e-6 + 3.0 * edge * edge, "edge {edge}: {got}, kernel {want}");
        }
    }

    #[test]
    fn the_horizon_clips() {
        // An element perpendicular to a unit square at distance c under its corner, facing along its edge: Howell's
        // figures; moved under the edge's middle, half of the square lies behind.
        let normal = Vec3::X;
        for (c, expected) in [(0.1, 0.221_738_67), (0.5, 0.124_268_91), (1.0, 0.055_734_2)] {
            let at = SurfacePoint { position: Vec3::new(0.0, 0.0, 1.0 - c), normal };
            let got: f32 = square(1.0).iter().map(|t| triangle_form_factor(&at, t)).sum();
            let across = SurfacePoint { position: Vec3::new(0.5, 0.0, 1.0 - c), normal };
            let clipped: f32 = square(1.0).iter().map(|t| triangle_form_factor(&across, t)).sum();
            assert!((got - expected).abs() < 5e-6 && clipped < got, "c = {c}: {got}, clipped {clipped}");
        }
    }
}
