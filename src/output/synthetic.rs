//! Small scenes and made-up light for the tests of this folder.

use glam::{DVec3, Vec3};

use crate::geometry::SurfacePoint;
use crate::scene::{Albedo, Mesh, Placement, Scene, Sky};
use crate::solve::Irradiance;

/// A scene of one grey mesh under a white sky.
pub fn scene(vertices: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Scene {
    let mesh = Mesh {
        name: "mesh".into(),
        file: "mesh.ply".into(),
        triangles: 0..triangles.len() as u32,
        vertices: 0..vertices.len() as u32,
        two_sided: false,
        albedo: Albedo::Constant(Vec3::splat(0.5)),
        radiance: Vec3::ZERO,
        normals: None,
    };
    Scene {
        placement: Placement { origin: DVec3::ZERO, scale: 1.0 },
        vertices,
        triangles,
        meshes: vec![mesh],
        sky: Some(Sky::Constant(Vec3::ONE)),
        lamps: vec![],
        cameras: vec![],
        up: Vec3::Y,
        warnings: vec![],
    }
}

/// The square [0, 1]² at z = 0, its front towards +z.
pub fn square() -> Scene {
    let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
    scene(corners.map(|(x, y)| Vec3::new(x, y, 0.0)).to_vec(), vec![[0, 1, 2], [0, 2, 3]])
}

/// The closed box [0, 1]³ with its fronts inside.
pub fn room() -> Scene {
    let vertices = (0..8).map(|i| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32)).collect();
    let walls = [[0, 2, 6, 4], [1, 5, 7, 3], [0, 4, 5, 1], [2, 3, 7, 6], [0, 1, 3, 2], [4, 6, 7, 5]];
    let turned = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
    scene(vertices, walls.into_iter().flat_map(turned).collect())
}

/// The same box seen as a solid: fronts outside.
pub fn block() -> Scene {
    let mut scene = room();
    for triangle in &mut scene.triangles {
        triangle.reverse();
    }
    scene
}

/// Direct light coloured by normal, indirect 0.25, a third of the sky, error 0.125.
pub fn light(points: &[SurfacePoint]) -> Vec<Irradiance> {
    points
        .iter()
        .map(|point| Irradiance {
            direct: 0.5 + 0.5 * point.normal,
            indirect: Vec3::splat(0.25),
            sky_visibility: 1.0 / 3.0,
            error: 0.125,
        })
        .collect()
}

#[test]
fn the_room_looks_inwards_and_the_block_outwards() {
    for (scene, sign) in [(room(), 1.0), (block(), -1.0)] {
        for id in 0..scene.triangles.len() as u32 {
            let [a, b, c] = scene.corners(id);
            let inwards = Vec3::splat(0.5) - (a + b + c) / 3.0;
            assert!(scene.normal(id).dot(inwards) * sign > 0.0, "triangle {id}");
        }
    }
}
