//! Closed test surfaces and rays over them, for the tests and benches of the ray engine.

use std::collections::HashMap;

use glam::Vec3;
use glowtree::geometry::hash::Stream;
use glowtree::geometry::hemisphere::cosine_hemisphere;
use glowtree::geometry::{LIFT, tangent_frame, triangle};
use glowtree::rays::Ray;

/// A mesh: vertices and corner indices.
pub type Mesh = (Vec<Vec3>, Vec<[u32; 3]>);

/// An icosahedron of radius 1, each triangle split in four `levels` times: 20 · 4^levels triangles.
pub fn icosphere(levels: u32) -> Mesh {
    let g = (1.0 + 5.0f32.sqrt()) / 2.0;
    let mut vertices = Vec::new();
    for (a, b) in [(1.0, g), (-1.0, g), (1.0, -g), (-1.0, -g)] {
        vertices.extend([Vec3::new(0.0, a, b), Vec3::new(a, b, 0.0), Vec3::new(b, 0.0, a)]);
    }
    for vertex in &mut vertices {
        *vertex = vertex.normalize();
    }
    let mut triangles = corners_at_distance(&vertices, 1.1);
    for _ in 0..levels {
        let mut middles = HashMap::with_capacity(triangles.len() * 2);
        let mut finer = Vec::with_capacity(triangles.len() * 4);
        for [a, b, c] in triangles {
            let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(i, j)| {
                *middles.entry((i.min(j), i.max(j))).or_insert_with(|| {
                    vertices.push((vertices[i as usize] + vertices[j as usize]).normalize());
                    vertices.len() as u32 - 1
                })
            });
            finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        triangles = finer;
    }
    (vertices, triangles)
}

/// The triangles of a convex solid whose edges are shorter than `edge`, wound outwards.
fn corners_at_distance(vertices: &[Vec3], edge: f32) -> Vec<[u32; 3]> {
    let near = |i: usize, j: usize| vertices[i].distance(vertices[j]) < edge;
    let mut triangles = Vec::new();
    for i in 0..vertices.len() {
        for j in i + 1..vertices.len() {
            for k in j + 1..vertices.len() {
                if near(i, j) && near(j, k) && near(i, k) {
                    let normal = triangle::area_vector([vertices[i], vertices[j], vertices[k]]);
                    let [i, j, k] = [i as u32, j as u32, k as u32];
                    triangles.push(if normal.dot(vertices[i as usize]) > 0.0 {
                        [i, j, k]
                    } else {
                        [i, k, j]
                    });
                }
            }
        }
    }
    triangles
}

/// An icosphere with bumps of three sizes, star-shaped about the origin, radius 0.75 to 1.25.
pub fn bumpy_sphere(levels: u32) -> Mesh {
    let (mut vertices, triangles) = icosphere(levels);
    for vertex in &mut vertices {
        let p = *vertex;
        let bump = |frequency: f32| {
            let q = p * frequency;
            (q.x + 0.3).sin() * (q.y + 1.1).sin() * (q.z + 2.3).sin() + 0.5 * (q.x - q.y + q.z).sin()
        };
        *vertex *= 1.0 + 0.12 * bump(5.0) + 0.03 * bump(23.0) + 0.006 * bump(131.0);
    }
    (vertices, triangles)
}

/// A point drawn on a random triangle, and that triangle's normal.
pub fn surface_point((vertices, triangles): &Mesh, stream: &mut Stream) -> (Vec3, Vec3) {
    let number = ((stream.bits() >> 32) * triangles.len() as u64) >> 32;
    let corners = triangles[number as usize].map(|v| vertices[v as usize]);
    let (u, v) = triangle::uniform_barycentric(stream.unit_pair());
    (triangle::point(corners, u, v), triangle::normal(corners))
}

/// Segments between random surface points through the inside, lifted off the surface: incoherent, some blocked.
pub fn segments(mesh: &Mesh, count: usize, seed: u64) -> Vec<Ray> {
    let mut stream = Stream::new(seed, 0);
    let mut point = || {
        let (position, normal) = surface_point(mesh, &mut stream);
        position - normal * LIFT
    };
    (0..count).map(|_| Ray::between(point(), point())).collect()
}

/// Rays over the outer hemispheres of random surface points, cosine-weighted.
pub fn hemispheres(mesh: &Mesh, count: usize, seed: u64) -> Vec<Ray> {
    let mut stream = Stream::new(seed, 1);
    let one = |_| {
        let (position, normal) = surface_point(mesh, &mut stream);
        let (s, t) = tangent_frame(normal);
        let d = cosine_hemisphere(stream.unit_pair());
        Ray::new(position + normal * LIFT, s * d.x + t * d.y + normal * d.z)
    };
    (0..count).map(one).collect()
}
