//! Normals at vertices.
//!
//! This work is based on: Thürmer and Wüthrich, "Computing Vertex Normals from Polygonal Facets", Journal of Graphics
//! Tools 1998 (weights by angle, for pictures).

use glam::Vec3;

use crate::geometry::triangle;
use crate::scene::{Mesh, Scene};

/// Beyond this angle between a face and the normal at its corner the corner is a crease and keeps the face's own
/// normal in pictures (cosine of 40 degrees): box corners differ by 45 degrees or more, faces of a scan by less.
const CREASE_COSINE: f32 = 0.766;

/// How faces share in the normal of a vertex that has none of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Weight {
    /// By area: the mean orientation of the surface around the vertex.
    Area,
    /// By the angle at the vertex: does not depend on how a wall is cut into triangles.
    Angle,
}

/// One unit normal per vertex of the scene: the file's where it has one, on the side that the faces' winding makes the
/// front, else the weighted mean of the faces; zero for vertices that no face with area uses.
///
/// Cost: two passes over the triangles, 12 bytes per vertex.
pub fn vertex_normals(scene: &Scene, weight: Weight) -> Vec<Vec3> {
    let mut normals = vec![Vec3::ZERO; scene.vertices.len()];
    for triangle in &scene.triangles {
        let corners = triangle.map(|k| scene.vertices[k as usize]);
        let along = triangle::area_vector(corners);
        for (k, &vertex) in triangle.iter().enumerate() {
            normals[vertex as usize] += match weight {
                Weight::Area => along,
                Weight::Angle => along.normalize_or_zero() * angle(corners, k),
            };
        }
    }
    // Sums that cancel (the two sides of a sheet) or underflow take any face's normal.
    let lost = |sum: Vec3| !sum.is_finite() || sum.normalize_or_zero() == Vec3::ZERO;
    for triangle in &scene.triangles {
        if triangle.iter().any(|&k| lost(normals[k as usize])) {
            let normal = triangle::normal(triangle.map(|k| scene.vertices[k as usize]));
            for &k in triangle.iter().filter(|_| normal.is_finite()) {
                let slot = &mut normals[k as usize];
                *slot = if lost(*slot) { normal } else { *slot };
            }
        }
    }
    for normal in &mut normals {
        *normal = if lost(*normal) { Vec3::ZERO } else { normal.normalize() };
    }
    for mesh in &scene.meshes {
        take_file_normals(mesh, &mut normals);
    }
    normals
}

/// The angle at corner `k`, radians; 0 without extent.
fn angle(corners: [Vec3; 3], k: usize) -> f32 {
    let a = corners[(k + 1) % 3] - corners[k];
    let b = corners[(k + 2) % 3] - corners[k];
    let angle = a.cross(b).length().atan2(a.dot(b));
    if angle.is_finite() { angle } else { 0.0 }
}

/// Replaces face means by the file's normals where both exist.
fn take_file_normals(mesh: &Mesh, normals: &mut [Vec3]) {
    let Some(given) = &mesh.normals else { return };
    let own = mesh.vertices.start as usize..mesh.vertices.end as usize;
    for (slot, file) in normals[own].iter_mut().zip(given) {
        let unit = file.normalize_or_zero();
        if *slot != Vec3::ZERO && unit != Vec3::ZERO && unit.is_finite() {
            *slot = if unit.dot(*slot) < 0.0 { -unit } else { unit };
        }
    }
}

/// The normal that a picture shades with at (u, v) of a triangle: corner normals interpolated, creases kept.
pub fn smooth_normal(scene: &Scene, normals: &[Vec3], id: u32, [u, v]: [f32; 2]) -> Vec3 {
    let face = scene.normal(id);
    let [a, b, c] = scene.triangles[id as usize].map(|k| {
        let normal = normals[k as usize];
        if normal.dot(face) > CREASE_COSINE { normal } else { face }
    });
    (a * (1.0 - u - v) + b * u + c * v).normalize_or(face)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::synthetic;

    #[test]
    fn file_normals_win_and_unused_vertices_have_none() {
        let mut scene = synthetic::square();
        scene.vertices.push(Vec3::ONE);
        scene.meshes[0].vertices.end += 1;
        let tilted = Vec3::new(0.0, 0.6, -0.8);
        scene.meshes[0].normals = Some(vec![tilted; 5]);
        let normals = vertex_normals(&scene, Weight::Area);
        // The square's front looks to +z: the file's normal is turned to that side.
        assert!((normals[0] + tilted).length() < 1e-6, "{}", normals[0]);
        assert_eq!(normals[4], Vec3::ZERO);
    }

    #[test]
    fn both_sides_of_a_sheet_give_a_normal_all_the_same() {
        let mut scene = synthetic::square();
        scene.triangles = vec![[0, 1, 2], [2, 1, 0]];
        scene.meshes[0].triangles = 0..2;
        let normals = vertex_normals(&scene, Weight::Area);
        assert!((normals[0].z.abs() - 1.0).abs() < 1e-6 && normals[3] == Vec3::ZERO, "{normals:?}");
    }

    #[test]
    fn smooth_normals_keep_the_edges_of_a_box() {
        let scene = synthetic::room();
        let normals = vertex_normals(&scene, Weight::Angle);
        for id in 0..scene.triangles.len() as u32 {
            // Corner normals of a box lie 45 to 55 degrees off: all creases.
            assert!((smooth_normal(&scene, &normals, id, [0.2, 0.1]) - scene.normal(id)).length() < 1e-6);
        }
    }
}
