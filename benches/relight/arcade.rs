//! A courtyard with arcades of fluted columns, curtains and galleries, open to the sky: 2.36 million triangles, five lights.

use std::f32::consts::{PI, TAU};
use std::io::Write as _;
use std::path::Path;

use glowtree::error::{Error, Result};
use glowtree::light::Rgb;

/// Metres along x, up to the open sky, and along z.
const SIZE: [f32; 3] = [24.0, 8.0, 12.0];

/// The undersides of the galleries, their thickness, and how far they reach into the court.
const GALLERY: [f32; 3] = [4.0, 0.2, 3.0];

const COLUMNS: usize = 8;

const SCENE: &str = r#"
[[mesh]]
file = "floor.ply"
albedo = [0.5, 0.47, 0.42]
sides = 1

[[mesh]]
file = "walls.ply"
albedo = [0.7, 0.64, 0.55]
sides = 1

[[mesh]]
file = "columns.ply"
albedo = [0.62, 0.6, 0.56]
sides = 1

[[mesh]]
file = "galleries.ply"
albedo = [0.7, 0.68, 0.64]
sides = 1

[[mesh]]
file = "curtains.ply"
albedo = [0.6, 0.12, 0.08]
sides = 2

[[mesh]]
file = "panel.ply"
albedo = [0.5, 0.5, 0.5]
sides = 1
radiance = [30, 27, 22]

[[lamp]]
name = "sun"
kind = "sun"
direction = [0.35, -1, 0.25]
irradiance = [8, 7.5, 6.5]

[[lamp]]
name = "bulb"
kind = "point"
position = [6, 2.5, 1.5]
intensity = [6, 5, 3.5]

[[lamp]]
name = "torch"
kind = "point"
position = [18, 2, 10.5]
intensity = [4, 2.5, 1]

[sky]
radiance = [0.8, 1.0, 1.4]
"#;

/// Writes its meshes and `scene.toml` into a folder.
pub fn write(folder: &Path) -> Result<()> {
    for (name, mesh) in [
        ("floor", floor()),
        ("walls", walls()),
        ("columns", columns()),
        ("galleries", galleries()),
        ("curtains", curtains()),
        ("panel", panel()),
    ] {
        mesh.write(&folder.join(format!("{name}.ply")))?;
    }
    let path = folder.join("scene.toml");
    std::fs::write(&path, SCENE).map_err(|e| Error::io(&path, "writing", e))
}

#[derive(Default)]
struct Mesh {
    vertices: Vec<Rgb>,
    triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// A bent rectangle of so many quads each way; its front is the side that u × v looks to.
    fn sheet(&mut self, [across, along]: [u32; 2], at: impl Fn(f32, f32) -> Rgb) {
        let first = self.vertices.len() as u32;
        for j in 0..=along {
            for i in 0..=across {
                self.vertices.push(at(i as f32 / across as f32, j as f32 / along as f32));
            }
        }
        for j in 0..along {
            for i in 0..across {
                let a = first + j * (across + 1) + i;
                let (b, c) = (a + 1, a + across + 1);
                self.triangles.extend([[a, b, c + 1], [a, c + 1, c]]);
            }
        }
    }

    fn write(&self, path: &Path) -> Result<()> {
        let mut bytes = format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
             element face {}\nproperty list uchar int vertex_indices\nend_header\n",
            self.vertices.len(),
            self.triangles.len()
        )
        .into_bytes();
        self.vertices.iter().for_each(|v| bytes.extend(v.to_array().iter().flat_map(|c| c.to_le_bytes())));
        for triangle in &self.triangles {
            bytes.push(3);
            bytes.extend(triangle.iter().flat_map(|k| k.to_le_bytes()));
        }
        let mut file = std::fs::File::create(path).map_err(|e| Error::io(path, "creating", e))?;
        file.write_all(&bytes).map_err(|e| Error::io(path, "writing", e))
    }
}

/// Stone: waves of two lengths, millimetres high.
fn relief(a: f32, b: f32) -> f32 {
    0.004 * (9.0 * a).sin() * (7.0 * b).cos() + 0.0015 * (41.0 * a + 3.0 * b).sin() * (37.0 * b).sin()
}

fn floor() -> Mesh {
    let mut mesh = Mesh::default();
    let [x, _, z] = SIZE;
    mesh.sheet([240, 480], |u, v| Rgb::new(x * v, relief(x * v, z * u), z * u));
    mesh
}

fn walls() -> Mesh {
    let mut mesh = Mesh::default();
    let [x, y, z] = SIZE;
    // Below the floor's waves and beyond the corners'.
    let (low, tall) = (-0.02, y + 0.02);
    let beyond = |u: f32, length: f32| (length + 0.04) * u - 0.02;
    mesh.sheet([480, 200], |u, v| Rgb::new(beyond(u, x), low + tall * v, relief(x * u, y * v)));
    mesh.sheet([480, 200], |u, v| Rgb::new(beyond(1.0 - u, x), low + tall * v, z + relief(x * u, y * v)));
    mesh.sheet([240, 200], |u, v| Rgb::new(relief(z * u, y * v), low + tall * v, beyond(1.0 - u, z)));
    mesh.sheet([240, 200], |u, v| Rgb::new(x + relief(z * u, y * v), low + tall * v, beyond(u, z)));
    mesh
}

fn columns() -> Mesh {
    let mut mesh = Mesh::default();
    for k in 0..COLUMNS {
        for z in [GALLERY[2] - 0.4, SIZE[2] - GALLERY[2] + 0.4] {
            let x = SIZE[0] * (k as f32 + 0.5) / COLUMNS as f32;
            mesh.sheet([160, 240], |u, v| {
                // Narrower above; base and capital swell.
                let swell = 0.06 * (-(v * 14.0)).exp() + 0.08 * (-(1.0 - v) * 12.0).exp();
                let r = (0.3 - 0.05 * v + swell) * (1.0 + 0.05 * (16.0 * TAU * u).cos());
                let (sin, cos) = (-TAU * u).sin_cos();
                Rgb::new(x + r * cos, -0.02 + (GALLERY[0] + 0.03) * v, z + r * sin)
            });
        }
    }
    mesh
}

fn galleries() -> Mesh {
    let mut mesh = Mesh::default();
    let [under, thick, deep] = GALLERY;
    let [x, _, z] = SIZE;
    for far in [false, true] {
        // The far one is the near one, turned by half a circle.
        let place = |a: f32, y: f32, b: f32| if far { Rgb::new(x - a, y, z - b) } else { Rgb::new(a, y, b) };
        let bump = |u: f32, v: f32| 0.5 * relief(x * u, deep * v);
        mesh.sheet([300, 60], |u, v| place(x * u, under + bump(u, v), deep * v));
        mesh.sheet([300, 60], |u, v| place(x * (1.0 - u), under + thick + bump(u, v), deep * v));
        mesh.sheet([300, 8], |u, v| place(x * u, under - 0.01 + (thick + 0.02) * v, deep));
    }
    mesh
}

fn curtains() -> Mesh {
    let mut mesh = Mesh::default();
    for k in 0..6 {
        let near = k % 2 == 0;
        let x = SIZE[0] * (k as f32 + 1.0) / COLUMNS as f32;
        let z = if near { GALLERY[2] - 0.4 } else { SIZE[2] - GALLERY[2] + 0.4 };
        mesh.sheet([120, 120], |u, v| {
            let fold = 0.12 * (7.0 * TAU * u + 0.8 * (PI * v).sin()).sin() * (0.4 + 0.6 * (1.0 - v));
            Rgb::new(x - 0.9 + 1.8 * u, 1.4 + 2.4 * v, z + fold)
        });
    }
    mesh
}

fn panel() -> Mesh {
    let mut mesh = Mesh::default();
    mesh.sheet([4, 4], |u, v| Rgb::new(11.0 + 2.0 * u, GALLERY[0] - 0.05, 1.0 + v));
    mesh
}
