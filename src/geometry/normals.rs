//! Normals of vertices from the faces around them, and how normals move: one set of rules for meshes in memory and for
//! those that stay in their files.
//!
//! This work is based on: Thürmer and Wüthrich, "Computing Vertex Normals from Polygonal Facets", Journal of Graphics
//! Tools 1998 (weights by angle, for pictures).

use glam::{DMat3, Vec3};
use rayon::prelude::*;

use super::triangle;

/// How faces share in the normal of a vertex that has none of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Weight {
    /// By area: the mean orientation of the surface around the vertex.
    Area,
    /// By the angle at the vertex: does not depend on how a wall is cut into triangles.
    Angle,
}

/// Weighted means of the faces around each vertex, unit vectors; zero for vertices that no face with area uses.
///
/// Sums that cancel (the two sides of a sheet) or underflow take any face's normal. Deterministic: sums are in f32 and in the
/// triangles' order. Cost: a pass over the triangles, a second one if any sum is lost; 12 bytes per vertex.
pub fn means_of_faces(points: &[Vec3], triangles: &[[u32; 3]], weight: Weight) -> Vec<Vec3> {
    let corners = |triangle: &[u32; 3]| triangle.map(|k| points[k as usize]);
    let mut sums = vec![Vec3::ZERO; points.len()];
    for triangle in triangles {
        let corners = corners(triangle);
        let along = triangle::area_vector(corners);
        for (k, &vertex) in triangle.iter().enumerate() {
            sums[vertex as usize] += match weight {
                Weight::Area => along,
                Weight::Angle => along.normalize_or_zero() * angle(corners, k),
            };
        }
    }
    let any_lost = sums.par_iter().any(|&sum| is_lost(sum));
    for triangle in triangles.iter().filter(|_| any_lost) {
        if triangle.iter().any(|&k| is_lost(sums[k as usize])) {
            let normal = triangle::normal(corners(triangle));
            for &k in triangle.iter().filter(|_| normal.is_finite()) {
                let slot = &mut sums[k as usize];
                *slot = if is_lost(*slot) { normal } else { *slot };
            }
        }
    }
    sums.par_iter_mut().for_each(|sum| *sum = if is_lost(*sum) { Vec3::ZERO } else { sum.normalize() });
    sums
}

fn is_lost(sum: Vec3) -> bool {
    !sum.is_finite() || sum.normalize_or_zero() == Vec3::ZERO
}

/// The angle at corner `k`, radians; 0 without extent.
fn angle(corners: [Vec3; 3], k: usize) -> f32 {
    let a = corners[(k + 1) % 3] - corners[k];
    let b = corners[(k + 2) % 3] - corners[k];
    let angle = a.cross(b).length().atan2(a.dot(b));
    if angle.is_finite() { angle } else { 0.0 }
}

/// A vertex's normal: `own` (a unit vector, or zero for none), on the side that the faces' winding makes the front, else
/// the faces' `mean`; zero where no face with area is.
pub fn own_or_mean(own: Vec3, mean: Vec3) -> Vec3 {
    if mean == Vec3::ZERO || own == Vec3::ZERO || !own.is_finite() {
        mean
    } else if own.dot(mean) < 0.0 {
        -own
    } else {
        own
    }
}

/// The matrix of cofactors, which cross products, and with them normals by winding, go with when points go with `linear`,
/// mirrored or not. Unlike the inverse it always exists.
pub fn cofactors(linear: DMat3) -> DMat3 {
    let (x, y, z) = (linear.x_axis, linear.y_axis, linear.z_axis);
    DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y))
}

/// The unit vector in the direction that a matrix turns `vector` to; zero where it has none.
pub fn turned(matrix: DMat3, vector: Vec3) -> Vec3 {
    (matrix * vector.as_dvec3()).normalize_or_zero().as_vec3()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_stay_upright_on_what_they_stand_on() {
        let linear = DMat3::from_cols_array(&[2.0, 0.5, 0.0, -0.3, 1.0, 0.2, 0.0, 0.7, -3.0]);
        let corners = [Vec3::ZERO, Vec3::new(1.0, 0.2, 0.4), Vec3::new(-0.3, 1.0, 0.1)];
        let moved = corners.map(|p| (linear * p.as_dvec3()).as_vec3());
        assert!(linear.determinant() < 0.0, "a mirror, the harder case");
        let (turned, normal) =
            (turned(cofactors(linear), triangle::normal(corners)), triangle::normal(moved));
        // A dozen f32 operations on numbers of size one: 1e-6 is eight ulps.
        assert!((turned - normal).length() < 1e-6, "{turned} for {normal}");
    }

    #[test]
    fn weights_by_angle_do_not_see_how_a_wall_is_cut() {
        // A corner of three walls at the origin, one of them cut in two.
        let points = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z, Vec3::new(0.5, 0.5, 0.0)];
        let triangles = [[0, 1, 4], [0, 4, 2], [0, 2, 3], [0, 3, 1]];
        let by = |weight| means_of_faces(&points, &triangles, weight)[0];
        let even = Vec3::ONE.normalize();
        assert!((by(Weight::Angle) - even).length() < 1e-6, "{}", by(Weight::Angle));
        let long = [points[0], points[1], points[2], 9.0 * points[3]];
        let stretched = means_of_faces(&long, &[[0, 1, 2], [0, 2, 3], [0, 3, 1]], Weight::Area)[0];
        assert!((stretched - even).length() > 0.1, "{stretched}");
    }

    #[test]
    fn own_normals_take_the_side_of_the_faces() {
        let tilted = Vec3::new(0.0, 0.6, -0.8);
        assert_eq!(own_or_mean(tilted, Vec3::Z), -tilted);
        assert_eq!(own_or_mean(-tilted, Vec3::Z), -tilted);
        assert_eq!(own_or_mean(Vec3::ZERO, Vec3::Z), Vec3::Z);
        assert_eq!(own_or_mean(Vec3::NAN, Vec3::Z), Vec3::Z);
        assert_eq!(own_or_mean(tilted, Vec3::ZERO), Vec3::ZERO);
    }
}
