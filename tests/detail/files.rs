//! Meshes written as PLY in every way that matters to the stream.

use std::fmt::Write as _;

use glam::{DVec3, Vec3};

use super::shapes::Mesh;

/// What a file is to hold besides positions and triangles.
#[derive(Clone, Default)]
pub struct Form {
    /// "ascii", "binary_little_endian" or "binary_big_endian".
    pub format: &'static str,
    /// Moves positions and makes them doubles.
    pub far: Option<DVec3>,
    /// Normals.
    pub normals: Option<Vec<Vec3>>,
    /// sRGB bytes.
    pub colours: Option<Vec<[u8; 3]>>,
}

/// Little-endian singles.
pub fn little() -> Form {
    Form { format: "binary_little_endian", ..Form::default() }
}

/// The mesh as a file. Text has all digits of an f64.
pub fn ply((vertices, triangles): &Mesh, form: &Form) -> Vec<u8> {
    let real = if form.far.is_some() { "double" } else { "float" };
    let mut head = format!("ply\nformat {} 1.0\nelement vertex {}\n", form.format, vertices.len());
    let mut columns = |kind: &str, names: &[&str]| {
        names.iter().for_each(|name| writeln!(head, "property {kind} {name}").unwrap());
    };
    columns(real, &["x", "y", "z"]);
    form.normals.iter().for_each(|_| columns("float", &["nx", "ny", "nz"]));
    form.colours.iter().for_each(|_| columns("uchar", &["red", "green", "blue"]));
    write!(head, "element face {}\nproperty list uchar int vertex_indices\nend_header\n", triangles.len())
        .unwrap();
    let mut out =
        Out { bytes: head.into_bytes(), text: form.format == "ascii", big: form.format.contains("big") };
    for (at, vertex) in vertices.iter().enumerate() {
        for value in vertex.to_array().iter().enumerate().map(|(axis, &x)| (axis, f64::from(x))) {
            match form.far {
                Some(far) => out.number(value.1 + far[value.0], &(value.1 + far[value.0]).to_le_bytes()),
                None => out.number(value.1, &(value.1 as f32).to_le_bytes()),
            }
        }
        for value in form.normals.iter().flat_map(|normals| normals[at].to_array()) {
            out.number(f64::from(value), &value.to_le_bytes());
        }
        for byte in form.colours.iter().flat_map(|colours| colours[at]) {
            out.number(f64::from(byte), &[byte]);
        }
        out.end();
    }
    for triangle in triangles {
        out.number(3.0, &[3]);
        triangle.iter().for_each(|&corner| out.number(f64::from(corner), &corner.to_le_bytes()));
        out.end();
    }
    out.bytes
}

struct Out {
    bytes: Vec<u8>,
    text: bool,
    big: bool,
}

impl Out {
    fn number(&mut self, value: f64, little: &[u8]) {
        if self.text {
            self.bytes.extend(format!("{value} ").bytes());
        } else if self.big {
            self.bytes.extend(little.iter().rev());
        } else {
            self.bytes.extend(little);
        }
    }

    fn end(&mut self) {
        if self.text {
            self.bytes.push(b'\n');
        }
    }
}

/// The mesh with its triangles in another order, from a seed.
pub fn shuffled((vertices, triangles): &Mesh, seed: u64) -> Mesh {
    let mut keyed: Vec<(u64, [u32; 3])> = triangles
        .iter()
        .enumerate()
        .map(|(at, &triangle)| (glowtree::geometry::hash::mix2(seed, at as u64), triangle))
        .collect();
    keyed.sort_unstable();
    (vertices.clone(), keyed.into_iter().map(|(_, triangle)| triangle).collect())
}
