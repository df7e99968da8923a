//! The whole scene as one PLY in world coordinates, for inputs that are not one PLY.

use std::path::Path;

use glam::Vec3;

use super::columns::{Plan, encode, values};
use super::{Work, put};
use crate::error::Result;
use crate::output::file::write_whole;
use crate::scene::Scene;
use crate::scene::ply::header::Element;
use crate::scene::ply::scalar::Scalar;

/// Farther from the origin than that many times its size, a scene's coordinates need doubles: floats would lose more
/// than a millionth of the size.
const FAR: f64 = 16.0;

/// Writes all meshes' vertices with normals and light, and all triangles, in the scene's order.
pub fn write(path: &Path, scene: &Scene, normals: &[Vec3], work: &Work<'_>) -> Result<()> {
    let far = scene.placement.origin.abs().max_element() > FAR * scene.placement.scale;
    let scalar = if far { Scalar::F64 } else { Scalar::F32 };
    let plan = Plan::of(&Element { name: "vertex".into(), count: 0, properties: vec![] });
    let coordinate = if far { "double" } else { "float" };
    let head = format!(
        "ply\nformat binary_little_endian 1.0\n{}element vertex {}\n\
         property {coordinate} x\nproperty {coordinate} y\nproperty {coordinate} z\n\
         property float nx\nproperty float ny\nproperty float nz\n{}{}\
         element face {}\nproperty list uchar uint vertex_indices\nend_header\n",
        work.comments(),
        scene.vertices.len(),
        plan.appended_lines(),
        work.transfers.lines(),
        scene.triangles.len(),
    );
    let vertex_bytes = 3 * scalar.size() as u64 + 12 + 35 + work.transfers.bytes();
    let bytes = vertex_bytes * scene.vertices.len() as u64 + 13 * scene.triangles.len() as u64;
    write_whole(path, bytes + head.len() as u64, |sink| {
        put(path, sink, head.as_bytes())?;
        let mut row = Vec::new();
        work.for_each(scene.vertices.len(), |vertex, light| {
            row.clear();
            let world = scene.placement.to_world(scene.vertices[vertex]);
            world.to_array().into_iter().for_each(|value| encode(scalar, value, &mut row));
            for value in normals[vertex].to_array() {
                row.extend(value.to_le_bytes());
            }
            plan.apply(&mut row, &[], &values(light, work.exposure));
            work.transfers.put(vertex, &mut row);
            put(path, sink, &row)
        })?;
        scene.triangles.iter().try_for_each(|triangle| {
            row.clear();
            row.push(3);
            triangle.iter().for_each(|k| row.extend(k.to_le_bytes()));
            put(path, sink, &row)
        })
    })
}
