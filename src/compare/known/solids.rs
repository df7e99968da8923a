//! Squares, boxes, spheres, zones, discs and tetrahedra.

use std::f64::consts::TAU;

use glam::DVec3;

use super::shape::{Shape, grid, quad};

/// Two opposed rectangles a × b, at z = 0 looking up and at z = c looking down, n × n quads each.
pub fn parallel_rectangles(a: f64, b: f64, c: f64, n: u32) -> [Shape; 2] {
    let floor = quad(DVec3::ZERO, DVec3::X * a, DVec3::Y * b, n);
    [floor.clone(), floor.flipped().translated(DVec3::Z * c)]
}

/// Two unit squares hinged along the y axis, opened by `degrees` from +x upwards, facing each other.
pub fn hinged_squares(degrees: f64, n: u32) -> [Shape; 2] {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let floor = quad(DVec3::ZERO, DVec3::X, DVec3::Y, n);
    let leaf = quad(DVec3::ZERO, DVec3::Y, DVec3::new(cos, 0.0, sin), n);
    [floor, leaf]
}

/// The faces of a box, n × n quads each, fronts outwards: −x, +x, −y, +y, −z, +z. Vertices are not shared.
pub fn box_faces(min: DVec3, max: DVec3, n: u32) -> [Shape; 6] {
    let size = max - min;
    let [x, y, z] = [DVec3::X * size.x, DVec3::Y * size.y, DVec3::Z * size.z];
    [
        quad(min, z, y, n),
        quad(min + x, y, z, n),
        quad(min, x, z, n),
        quad(min + y, z, x, n),
        quad(min, y, x, n),
        quad(min + z, x, y, n),
    ]
}

/// A whole box, front outwards.
pub fn cuboid(min: DVec3, max: DVec3, n: u32) -> Shape {
    box_faces(min, max, n).iter().fold(Shape::default(), Shape::with)
}

/// An icosahedron split `levels` times, on the sphere of `radius` about the origin, front outwards:
/// 20 · 4^levels triangles.
pub fn icosphere(radius: f64, levels: u32) -> Shape {
    let mut shape = icosahedron();
    for _ in 0..levels {
        shape = split(&shape);
    }
    shape.mapped(|v| v.normalize() * radius)
}

fn icosahedron() -> Shape {
    let golden = 0.5 * (1.0 + 5.0f64.sqrt());
    let mut vertices = Vec::new();
    for s in [-1.0, 1.0] {
        for t in [-golden, golden] {
            vertices.extend([DVec3::new(0.0, s, t), DVec3::new(s, t, 0.0), DVec3::new(t, 0.0, s)]);
        }
    }
    // Faces are the triples at the least distance, 2, turned outwards.
    let near = |a: DVec3, b: DVec3| (a.distance(b) - 2.0).abs() < 1e-9;
    let mut triangles = Vec::new();
    for a in 0..12u32 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                let [p, q, r] = [a, b, c].map(|k| vertices[k as usize]);
                if near(p, q) && near(q, r) && near(r, p) {
                    triangles.push(if p.dot(q.cross(r)) > 0.0 { [a, b, c] } else { [a, c, b] });
                }
            }
        }
    }
    Shape { vertices, triangles }
}

fn split(shape: &Shape) -> Shape {
    let mut middles = std::collections::HashMap::new();
    let mut vertices = shape.vertices.clone();
    let mut triangles = Vec::with_capacity(4 * shape.triangles.len());
    for &[a, b, c] in &shape.triangles {
        let mut middle = |p: u32, q: u32| {
            *middles.entry((p.min(q), p.max(q))).or_insert_with(|| {
                vertices.push((vertices[p as usize] + vertices[q as usize]).normalize());
                vertices.len() as u32 - 1
            })
        };
        let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
        triangles.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    Shape { vertices, triangles }
}

/// The zone of the unit sphere between two polar angles from −z (radians), seen from inside: front inwards.
/// `cap(0, β)` is a crater of half-angle β whose rim lies at z = −cos β; `cap(0, π)` the whole sphere.
pub fn zone(from: f64, to: f64, rings: u32, segments: u32) -> Shape {
    let mut shape = grid(segments, rings, |u, v| {
        let (sin, cos) = (from + (to - from) * v).sin_cos();
        let (y, x) = (TAU * u).sin_cos();
        DVec3::new(sin * x, sin * y, -cos)
    });
    // The last column repeats the first, bit by bit, or the seam would gape.
    for ring in 0..=rings {
        let first = (ring * (segments + 1)) as usize;
        shape.vertices[first + segments as usize] = shape.vertices[first];
    }
    // At the poles one of each quad's triangles has no area.
    let whole: Vec<_> =
        shape.triangles.iter().copied().filter(|t| shape.area_vector(t).length() > 1e-12).collect();
    Shape { triangles: whole, ..shape }.flipped()
}

/// A disc about the origin in the plane z = 0, a fan of `segments` triangles looking to +z.
pub fn disc(radius: f64, segments: u32) -> Shape {
    let mut shape = Shape { vertices: vec![DVec3::ZERO], triangles: Vec::new() };
    for i in 0..segments {
        let (y, x) = (TAU * f64::from(i) / f64::from(segments)).sin_cos();
        shape.vertices.push(DVec3::new(x, y, 0.0) * radius);
        shape.triangles.push([0, i + 1, (i + 1) % segments + 1]);
    }
    shape
}

/// The faces of a regular tetrahedron of edge √8, fronts inwards, `levels` times split into four.
pub fn tetrahedron(levels: u32) -> [Shape; 4] {
    let corner = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
    let c =
        [corner(1.0, 1.0, 1.0), corner(1.0, -1.0, -1.0), corner(-1.0, 1.0, -1.0), corner(-1.0, -1.0, 1.0)];
    [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]].map(|face| {
        let mut shape = Shape { vertices: face.map(|k: usize| c[k]).to_vec(), triangles: vec![[0, 1, 2]] };
        for _ in 0..levels {
            shape = split_flat(&shape);
        }
        shape
    })
}

fn split_flat(shape: &Shape) -> Shape {
    let mut out = Shape::default();
    for t in &shape.triangles {
        let [a, b, c] = t.map(|v| shape.vertices[v as usize]);
        let first = out.vertices.len() as u32;
        out.vertices.extend([a, b, c, (a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5]);
        out.triangles
            .extend([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]].map(|t: [u32; 3]| t.map(|v| v + first)));
    }
    out
}
