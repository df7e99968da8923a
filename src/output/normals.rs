//! Normals at the vertices of a scene in memory.

use glam::Vec3;

pub use crate::geometry::normals::Weight;
use crate::geometry::normals::{means_of_faces, own_or_mean};
use crate::scene::{Mesh, Scene};

/// Beyond this angle between a face and the normal at its corner the corner is a crease and keeps the face's own
/// normal in pictures (cosine of 40 degrees): box corners differ by 45 degrees or more, faces of a scan by less.
const CREASE_COSINE: f32 = 0.766;

/// One unit normal per vertex of the scene: the file's where it has one, on the side that the faces' winding makes the
/// front, else the weighted mean of the faces; zero for vertices that no face with area uses.
///
/// Cost: two passes over the triangles, 12 bytes per vertex.
pub fn vertex_normals(scene: &Scene, weight: Weight) -> Vec<Vec3> {
    let mut normals = means_of_faces(&scene.vertices, &scene.triangles, weight);
    for mesh in &scene.meshes {
        take_file_normals(mesh, &mut normals);
    }
    normals
}

/// Replaces face means by the file's normals where both exist.
fn take_file_normals(mesh: &Mesh, normals: &mut [Vec3]) {
    let Some(given) = &mesh.normals else { return };
    let own = mesh.vertices.start as usize..mesh.vertices.end as usize;
    for (slot, file) in normals[own].iter_mut().zip(given) {
        *slot = own_or_mean(file.normalize_or_zero(), *slot);
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
