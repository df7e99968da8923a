//! The viewer's mesh: light lies at its vertices, so it has as many as a picture needs, and creases are split.

use std::collections::HashMap;

use glam::Vec3;

use crate::geometry::octahedral;
use crate::light::Rgb;
use crate::output::normals::{Weight, corner_normal, vertex_normals};
use crate::scene::Scene;

/// Vertices, about, that coarse scenes are split to.
const WANTED: f32 = 150_000.0;

/// Scenes of more vertices show the front of two-sided surfaces on both sides; others have a mesh for the backs.
const MOST_BACKED: usize = 200_000;

/// How far towards the middle of its faces a vertex asks for light: on the line where two walls meet, both are in the way.
const INWARDS: f32 = 0.25;

/// What is seen of a surface from behind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Back {
    /// Nothing: it is black.
    Black = 0,
    /// Another surface, which has its own vertices.
    Own = 1,
    /// What is seen from the front.
    Same = 2,
}

/// A vertex with the surface around it.
#[derive(Debug, Clone, Copy)]
pub struct Vertex {
    /// Where it lies, local.
    pub position: Vec3,
    /// Which way the surface looks.
    pub normal: Vec3,
    /// The surface's albedo.
    pub albedo: Rgb,
    /// The mesh of the scene that it is of.
    pub mesh: u32,
    /// What is seen from behind.
    pub back: Back,
}

/// Triangles whose vertices have one normal each.
#[derive(Debug, Clone, Default)]
pub struct DenseMesh {
    /// Vertices.
    pub vertices: Vec<Vertex>,
    /// Corners, the front's counter-clockwise.
    pub triangles: Vec<[u32; 3]>,
}

impl DenseMesh {
    /// Of a scene: corners that a picture shades alike are one vertex, and edges that are long for so few vertices are split.
    pub fn new(scene: &Scene) -> Self {
        let mut mesh = Self::corners(scene);
        let area: f32 = (0..scene.triangles.len() as u32)
            .map(|id| crate::geometry::triangle::area(scene.corners(id)))
            .sum();
        // Two triangles a vertex; halved edges are from half to all of the longest, 0.7 of it in the mean.
        let longest = 1.4 * (area / (2.0 * WANTED) / 0.433).sqrt();
        while mesh.vertices.len() < 2 * WANTED as usize && mesh.split(longest) {}
        if mesh.vertices.len() <= MOST_BACKED {
            mesh.back();
        }
        mesh
    }

    fn corners(scene: &Scene) -> Self {
        let normals = vertex_normals(scene, Weight::Angle);
        let mut mesh = Self::default();
        let mut known: HashMap<(u32, u32), u32> = HashMap::new();
        for (number, of_scene) in scene.meshes.iter().enumerate() {
            let back = if of_scene.two_sided { Back::Same } else { Back::Black };
            for id in of_scene.triangles.clone() {
                let face = scene.normal(id);
                let at = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)];
                let corners = scene.triangles[id as usize];
                let triangle = [0, 1, 2].map(|c| {
                    let normal = corner_normal(&normals, corners[c], face);
                    *known.entry((corners[c], octahedral::encode(normal))).or_insert_with(|| {
                        let albedo = scene.albedo(id, at[c].0, at[c].1);
                        let position = scene.vertices[corners[c] as usize];
                        mesh.vertices.push(Vertex { position, normal, albedo, mesh: number as u32, back });
                        mesh.vertices.len() as u32 - 1
                    })
                });
                mesh.triangles.push(triangle);
            }
        }
        mesh
    }

    /// Splits edges that are longer at their middles, which both sides share; says whether there was one.
    fn split(&mut self, longest: f32) -> bool {
        let mut middles: HashMap<[u32; 2], u32> = HashMap::new();
        let mut triangles = Vec::with_capacity(2 * self.triangles.len());
        for corners in std::mem::take(&mut self.triangles) {
            let middle =
                [0, 1, 2].map(|k| self.middle([corners[k], corners[(k + 1) % 3]], longest, &mut middles));
            pieces(corners, middle, &mut triangles);
        }
        self.triangles = triangles;
        !middles.is_empty()
    }

    fn middle(
        &mut self,
        [a, b]: [u32; 2],
        longest: f32,
        middles: &mut HashMap<[u32; 2], u32>,
    ) -> Option<u32> {
        let (p, q) = (self.vertices[a as usize], self.vertices[b as usize]);
        if p.position.distance(q.position) <= longest {
            return None;
        }
        Some(*middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
            let vertex = Vertex {
                position: 0.5 * (p.position + q.position),
                normal: (p.normal + q.normal).normalize_or(p.normal),
                albedo: 0.5 * (p.albedo + q.albedo),
                ..p
            };
            self.vertices.push(vertex);
            self.vertices.len() as u32 - 1
        }))
    }

    /// Gives the backs of two-sided surfaces vertices of their own.
    fn back(&mut self) {
        let first = self.vertices.len() as u32;
        let mut copies = vec![u32::MAX; self.vertices.len()];
        for k in 0..self.triangles.len() {
            let [a, b, c] = self.triangles[k];
            if self.vertices[a as usize].back != Back::Same {
                continue;
            }
            let copied = [a, c, b].map(|corner| {
                let copy = &mut copies[corner as usize];
                if *copy == u32::MAX {
                    *copy = self.vertices.len() as u32;
                    let front = self.vertices[corner as usize];
                    self.vertices.push(Vertex { normal: -front.normal, back: Back::Own, ..front });
                }
                *copy
            });
            self.triangles.push(copied);
        }
        for vertex in &mut self.vertices[..first as usize] {
            vertex.back = if vertex.back == Back::Same { Back::Own } else { vertex.back };
        }
    }

    /// Gives vertices without light the mean of their neighbours' that have some: those under what stands on a surface would
    /// darken it as far as the next vertex.
    pub fn lighten(&self, unlit: &[bool], light: &mut [Rgb]) {
        let mut sums = vec![(Rgb::ZERO, 0.0f32); light.len()];
        for triangle in &self.triangles {
            for &to in triangle.iter().filter(|&&k| unlit[k as usize]) {
                for &from in triangle.iter().filter(|&&k| !unlit[k as usize]) {
                    let (sum, count) = &mut sums[to as usize];
                    *sum += light[from as usize];
                    *count += 1.0;
                }
            }
        }
        let filled = light.iter_mut().zip(sums).filter(|(_, (_, count))| *count > 0.0);
        filled.for_each(|(light, (sum, count))| *light = sum / count);
    }

    /// Where the vertices ask for light: a little inwards of their faces.
    pub fn asked(&self) -> Vec<Vec3> {
        let mut sums = vec![(Vec3::ZERO, 0.0f32); self.vertices.len()];
        for triangle in &self.triangles {
            let middle = triangle.iter().map(|&k| self.vertices[k as usize].position).sum::<Vec3>() / 3.0;
            for &corner in triangle {
                let (sum, count) = &mut sums[corner as usize];
                *sum += middle;
                *count += 1.0;
            }
        }
        let asked = |(vertex, (sum, count)): (&Vertex, (Vec3, f32))| {
            let inwards = sum / count.max(1.0) - vertex.position;
            // Along the surface: else bumps would ask for light above or below it.
            vertex.position + INWARDS * (inwards - vertex.normal * inwards.dot(vertex.normal))
        };
        self.vertices.iter().zip(sums).map(asked).collect()
    }
}

/// A triangle between its corners and the middles of the edges that begin at them.
fn pieces([a, b, c]: [u32; 3], middles: [Option<u32>; 3], out: &mut Vec<[u32; 3]>) {
    match middles {
        [None, None, None] => out.push([a, b, c]),
        [Some(ab), None, None] => out.extend([[a, ab, c], [ab, b, c]]),
        [None, Some(bc), None] => out.extend([[a, b, bc], [a, bc, c]]),
        [None, None, Some(ca)] => out.extend([[a, b, ca], [ca, b, c]]),
        [Some(ab), Some(bc), None] => out.extend([[a, ab, c], [ab, b, bc], [ab, bc, c]]),
        [None, Some(bc), Some(ca)] => out.extend([[a, b, ca], [b, bc, ca], [bc, c, ca]]),
        [Some(ab), None, Some(ca)] => out.extend([[a, ab, ca], [ab, b, ca], [b, c, ca]]),
        [Some(ab), Some(bc), Some(ca)] => out.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::triangle;
    use crate::output::synthetic;

    #[test]
    fn splitting_keeps_the_surface_and_leaves_no_crack() {
        let scene = synthetic::room();
        let mesh = DenseMesh::new(&scene);
        let corners = |t: &[u32; 3]| t.map(|k| mesh.vertices[k as usize].position);
        let area: f64 = mesh.triangles.iter().map(|t| f64::from(triangle::area(corners(t)))).sum();
        // Six unit squares, in some 10⁵ pieces with edges of powers of two.
        assert!((area - 6.0).abs() < 1e-4, "{area}");
        assert!((50_000..300_000).contains(&mesh.vertices.len()), "{}", mesh.vertices.len());
        // Every edge within a wall has two sides; those along the twelve edges of the room have one on each wall.
        let mut sides: HashMap<[u32; 2], i32> = HashMap::new();
        for t in &mesh.triangles {
            for k in 0..3 {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                *sides.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
            }
        }
        let on_edge = |k: u32| {
            let at = mesh.vertices[k as usize].position;
            at.to_array().iter().filter(|v| **v == 0.0 || **v == 1.0).count() >= 2
        };
        for ([a, b], sum) in sides {
            assert!(sum == 0 || on_edge(a) && on_edge(b), "a crack at {a} {b}");
        }
    }

    #[test]
    fn unlit_vertices_take_the_light_beside_them() {
        let mesh = DenseMesh::new(&synthetic::square());
        let under = |v: &Vertex| v.position.x < 0.5;
        let unlit: Vec<bool> = mesh.vertices.iter().map(under).collect();
        let mut light: Vec<Rgb> =
            unlit.iter().map(|unlit| if *unlit { Rgb::ZERO } else { Rgb::ONE }).collect();
        mesh.lighten(&unlit, &mut light);
        let crosses =
            |t: &&[u32; 3]| t.iter().any(|&k| unlit[k as usize]) && t.iter().any(|&k| !unlit[k as usize]);
        let mut crossing = mesh.triangles.iter().filter(crosses).peekable();
        assert!(
            crossing.peek().is_some() && crossing.all(|t| t.iter().all(|&k| light[k as usize] == Rgb::ONE))
        );
        let dark = light.iter().filter(|light| **light == Rgb::ZERO).count();
        // Half the square, but for a seam.
        assert!(
            2 * dark > light.len() * 9 / 10 && 2 * dark < light.len() * 11 / 10,
            "{dark} of {}",
            light.len()
        );
    }

    #[test]
    fn creases_are_split_and_light_is_asked_for_beside_them() {
        let mesh = DenseMesh::new(&synthetic::room());
        for (vertex, asked) in mesh.vertices.iter().zip(mesh.asked()) {
            let largest = vertex.normal.abs().max_element();
            assert!((largest - 1.0).abs() < 1e-6, "the normal of one wall, not {}", vertex.normal);
            let open = asked.to_array().iter().filter(|v| **v > 0.0 && **v < 1.0).count();
            assert_eq!(open, 2, "{asked} lies on its wall, and on no other");
        }
    }

    #[test]
    fn backs_have_their_own_vertices_where_they_are_lit() {
        let mut scene = synthetic::square();
        let fronts = DenseMesh::new(&scene);
        assert!(fronts.vertices.iter().all(|v| v.back == Back::Black && v.normal == Vec3::Z));
        scene.meshes[0].two_sided = true;
        let both = DenseMesh::new(&scene);
        assert_eq!(both.triangles.len(), 2 * fronts.triangles.len());
        assert!(both.vertices.iter().all(|v| v.back == Back::Own));
        let looks = |t: &[u32; 3]| {
            let face = triangle::normal(t.map(|k| both.vertices[k as usize].position));
            face.dot(both.vertices[t[0] as usize].normal)
        };
        assert!(both.triangles.iter().all(|t| looks(t) > 0.99));
    }
}
