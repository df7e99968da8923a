//! The viewer's mesh: vertices dense enough to carry the light between them.
//!
//! Pictures shade every point by itself; a viewer has what its vertices know. Corners whose normals agree are one vertex,
//! creases are split, and edges longer than a bound are halved. Whether an edge is halved depends on its end points alone,
//! so that the triangles on its two sides agree and no crack opens.

use std::collections::HashMap;

use glam::{Vec2, Vec3};
use smallvec::SmallVec;

use crate::geometry::{SurfacePoint, triangle};
use crate::light::Rgb;
use crate::output::normals::{Weight, smooth_normal, vertex_normals};
use crate::scene::{Albedo, Scene};

/// Normals of one place that agree this well are one vertex: the faces of a flat wall, up to rounding.
const SAME_COSINE: f32 = 0.999_99;

/// Steps of the search for the longest edge: the count of vertices goes with its inverse square, and 16 steps find it
/// within a few percent between the longest edge and a thousandth of it.
const BISECTIONS: u32 = 16;

/// How far from a rim towards the middle of a triangle light is asked for: on the very line where two walls meet, each
/// hides the other's lamps, and next to it rays end on the other's far side. At a hundredth of a triangle a block on a floor
/// had dark spots along its foot; what happens within a quarter of one is not told by its vertices anyway.
const WITHIN: f32 = 0.25;

/// What the viewer draws: points with a side, their material, and triangles between them.
#[derive(Debug, Clone, Default)]
pub struct ViewMesh {
    /// What is drawn; a point for each side that may be lit.
    pub points: Vec<SurfacePoint>,
    /// Where light is asked for: the same, but a little within its surface for points on rims and creases.
    pub asked: Vec<SurfacePoint>,
    /// Diffuse reflectance of each.
    pub albedo: Vec<Rgb>,
    /// The mesh of the scene that each belongs to.
    pub meshes: Vec<u32>,
    /// Triangles whose back is black.
    pub one_sided: Vec<[u32; 3]>,
    /// Triangles that are seen from their front alone; another, turned, shows the back.
    pub two_sided: Vec<[u32; 3]>,
}

/// A vertex before its material is looked up.
#[derive(Debug, Clone, Copy)]
struct Corner {
    position: Vec3,
    normal: Vec3,
    albedo: Rgb,
    uv: Vec2,
    mesh: u32,
}

impl Corner {
    /// Half way between two; the same whichever comes first.
    fn between(a: &Self, b: &Self) -> Self {
        Self {
            position: 0.5 * (a.position + b.position),
            normal: (a.normal + b.normal).normalize_or(a.normal),
            albedo: 0.5 * (a.albedo + b.albedo),
            uv: 0.5 * (a.uv + b.uv),
            mesh: a.mesh,
        }
    }
}

/// A surface as it is cut finer.
#[derive(Clone)]
struct Cut {
    corners: Vec<Corner>,
    triangles: Vec<[u32; 3]>,
}

impl ViewMesh {
    /// The surface of a scene at about `target` vertices, or half as many above what the scene itself has.
    ///
    /// Two-sided meshes have points on both sides. Triangles without area are left out. Cost: some twenty passes over the
    /// result; 100 bytes a vertex.
    pub fn new(scene: &Scene, target: usize) -> Self {
        let whole = welded(scene);
        let both = whole.corners.iter().filter(|c| scene.meshes[c.mesh as usize].two_sided).count();
        // Back sides take a second vertex: as many fewer places.
        let share = (whole.corners.len() + both) as f64 / whole.corners.len().max(1) as f64;
        Self::sided(scene, &refined(whole, (target as f64 / share) as usize))
    }

    /// Puts the back sides in.
    fn sided(scene: &Scene, cut: &Cut) -> Self {
        let two_sided = |corner: &Corner| scene.meshes[corner.mesh as usize].two_sided;
        let mut mesh = Self::default();
        let asked = asked(cut);
        for (corner, asked) in cut.corners.iter().zip(&asked) {
            mesh.put(scene, corner, *asked);
        }
        let mut backs = HashMap::new();
        for &triangle in &cut.triangles {
            if !two_sided(&cut.corners[triangle[0] as usize]) {
                mesh.one_sided.push(triangle);
                continue;
            }
            mesh.two_sided.push(triangle);
            let [a, b, c] = triangle.map(|k| {
                *backs.entry(k).or_insert_with(|| {
                    let front = cut.corners[k as usize];
                    mesh.put(scene, &Corner { normal: -front.normal, ..front }, asked[k as usize])
                })
            });
            mesh.two_sided.push([a, c, b]);
        }
        mesh
    }

    fn put(&mut self, scene: &Scene, corner: &Corner, asked: Vec3) -> u32 {
        let albedo = match &scene.meshes[corner.mesh as usize].albedo {
            Albedo::Constant(albedo) => *albedo,
            Albedo::Vertex(_) => corner.albedo,
            Albedo::Texture { texture, factor, .. } => texture.bilinear_repeat(corner.uv) * *factor,
        };
        self.points.push(SurfacePoint { position: corner.position, normal: corner.normal });
        self.asked.push(SurfacePoint { position: asked, normal: corner.normal });
        self.albedo.push(albedo);
        self.meshes.push(corner.mesh);
        (self.points.len() - 1) as u32
    }
}

/// The scene's triangles with one vertex for corners of one place whose shading normals agree.
fn welded(scene: &Scene) -> Cut {
    let normals = vertex_normals(scene, Weight::Angle);
    let mut known: HashMap<u32, SmallVec<[u32; 2]>> = HashMap::new();
    let mut cut = Cut { corners: Vec::new(), triangles: Vec::new() };
    for (id, triangle) in scene.triangles.iter().enumerate() {
        let id = id as u32;
        if scene.normal(id) == Vec3::ZERO {
            continue;
        }
        let at = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
        let mesh = scene.mesh_of(id);
        let corners = [0, 1, 2].map(|k| {
            let vertex = triangle[k];
            let normal = smooth_normal(scene, &normals, id, at[k]);
            let here = known.entry(vertex).or_default();
            let same = |other: &&u32| cut.corners[**other as usize].normal.dot(normal) > SAME_COSINE;
            if let Some(&same) = here.iter().find(same) {
                return same;
            }
            let own = (vertex - scene.meshes[mesh].vertices.start) as usize;
            let (albedo, uv) = match &scene.meshes[mesh].albedo {
                Albedo::Vertex(values) => (values[own], Vec2::ZERO),
                Albedo::Texture { uv, .. } => (Rgb::ZERO, uv[own]),
                Albedo::Constant(_) => (Rgb::ZERO, Vec2::ZERO),
            };
            let position = scene.vertices[vertex as usize];
            cut.corners.push(Corner { position, normal, albedo, uv, mesh: mesh as u32 });
            let new = (cut.corners.len() - 1) as u32;
            here.push(new);
            new
        });
        cut.triangles.push(corners);
    }
    cut
}

/// Halves edges until there are about `target` vertices, or half as many again beside a mesh that has more itself: the
/// ground below a scan takes shadows too.
fn refined(whole: Cut, target: usize) -> Cut {
    let most = target.max(whole.corners.len() + target / 2);
    if whole.triangles.is_empty() {
        return whole;
    }
    let edge = |[a, b]: [u32; 2]| {
        whole.corners[a as usize].position.distance_squared(whole.corners[b as usize].position)
    };
    let longest = whole.triangles.iter().flat_map(|&t| edges(t)).map(edge).fold(0.0, f32::max).sqrt();
    let (mut short, mut long) = ((longest * 1.0e-3).ln(), longest.ln());
    let mut best = whole.clone();
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (short + long);
        match halved(whole.clone(), middle.exp(), most) {
            Some(cut) => (long, best) = (middle, cut),
            None => short = middle,
        }
    }
    best
}

fn edges([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]]
}

/// Halves all edges longer than `bound`; None when that takes more than `most` vertices.
fn halved(mut cut: Cut, bound: f32, most: usize) -> Option<Cut> {
    let mut open = std::mem::take(&mut cut.triangles);
    let mut middles: HashMap<[u32; 2], u32> = HashMap::new();
    while let Some(triangle) = open.pop() {
        let middle = edges(triangle).map(|[a, b]| {
            let [p, q] = [a, b].map(|k| cut.corners[k as usize]);
            (p.position.distance_squared(q.position) > bound * bound).then(|| {
                *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                    cut.corners.push(Corner::between(&p, &q));
                    (cut.corners.len() - 1) as u32
                })
            })
        });
        if cut.corners.len() > most {
            return None;
        }
        match parts(triangle, middle, &cut.corners) {
            parts if parts.is_empty() => cut.triangles.push(triangle),
            parts => open.extend(parts),
        }
    }
    Some(cut)
}

/// The triangles between the corners of one and the middles of its edges (first the edge from corner 0 to 1); none when
/// no edge is halved.
fn parts(triangle: [u32; 3], middle: [Option<u32>; 3], corners: &[Corner]) -> SmallVec<[[u32; 3]; 4]> {
    // Turned so that the first edge is the halved one of one, and the last the whole one of two.
    let turn = match middle.map(|m| m.is_some()) {
        [false, true, false] | [false, true, true] => 1,
        [false, false, true] | [true, false, true] => 2,
        _ => 0,
    };
    let at = |k: usize| (k + turn) % 3;
    let ([a, b, c], [ab, bc, ca]) = ([0, 1, 2].map(|k| triangle[at(k)]), [0, 1, 2].map(|k| middle[at(k)]));
    let apart = |p: u32, q: u32| corners[p as usize].position.distance_squared(corners[q as usize].position);
    match (ab, bc, ca) {
        (Some(ab), Some(bc), Some(ca)) => [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]].into(),
        (Some(ab), Some(bc), None) if apart(ab, c) < apart(a, bc) => {
            [[ab, b, bc], [a, ab, c], [ab, bc, c]].as_slice().into()
        }
        (Some(ab), Some(bc), None) => [[ab, b, bc], [a, ab, bc], [a, bc, c]].as_slice().into(),
        (Some(ab), None, None) => [[a, ab, c], [ab, b, c]].as_slice().into(),
        _ => SmallVec::new(),
    }
}

/// Where light is asked for at each corner: those with an edge of one triangle alone are drawn towards the middle of their
/// largest triangle.
fn asked(cut: &Cut) -> Vec<Vec3> {
    let mut sides: HashMap<[u32; 2], u32> = HashMap::with_capacity(2 * cut.triangles.len());
    for [a, b] in cut.triangles.iter().flat_map(|&t| edges(t)) {
        *sides.entry([a.min(b), a.max(b)]).or_default() += 1;
    }
    let mut on_rim = vec![false; cut.corners.len()];
    for (edge, _) in sides.iter().filter(|(_, count)| **count == 1) {
        edge.iter().for_each(|&k| on_rim[k as usize] = true);
    }
    let mut asked: Vec<Vec3> = cut.corners.iter().map(|corner| corner.position).collect();
    let mut largest = vec![0.0; cut.corners.len()];
    for triangle in &cut.triangles {
        let corners = triangle.map(|k| cut.corners[k as usize].position);
        let (area, middle) = (triangle::area(corners), triangle::point(corners, 1.0 / 3.0, 1.0 / 3.0));
        for (k, corner) in triangle.map(|k| k as usize).into_iter().zip(corners) {
            if on_rim[k] && area > largest[k] {
                (largest[k], asked[k]) = (area, corner.lerp(middle, WITHIN));
            }
        }
    }
    asked
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::synthetic;

    fn area(mesh: &ViewMesh) -> f32 {
        let corners = |t: &[u32; 3]| t.map(|k| mesh.points[k as usize].position);
        mesh.one_sided.iter().chain(&mesh.two_sided).map(|t| triangle::area(corners(t))).sum()
    }

    #[test]
    fn a_room_is_cut_to_the_count_without_cracks_and_its_creases_are_kept() {
        let mesh = ViewMesh::new(&synthetic::room(), 20_000);
        // Equal squares are halved all at once, edges and diagonals in turn: the count goes in steps of two.
        assert!((10_000..=20_000).contains(&mesh.points.len()), "{}", mesh.points.len());
        // 40,000 areas of 1.5e-4 are summed in single precision: each sum rounds by 6 · 6e-8, at random.
        assert!((area(&mesh) - 6.0).abs() < 1e-3, "{}", area(&mesh));
        assert!(mesh.points.iter().all(|p| p.normal.abs().max_element() > 0.999_99));
        // Rims of the six walls are asked for within; nothing else is. A quarter of two thirds of an edge of 0.03 or less.
        let moved = |(p, a): (&SurfacePoint, &SurfacePoint)| p.position.distance(a.position);
        for (pair, point) in mesh.points.iter().zip(&mesh.asked).map(|pair| (moved(pair), pair.0.position)) {
            let rim = point.to_array().iter().filter(|x| **x == 0.0 || **x == 1.0).count() > 1;
            assert!(if rim { pair > 0.0 && pair < 6.0e-3 } else { pair == 0.0 }, "{point} moved by {pair}");
        }
        // Closed: each edge lies between two triangles, by places, for creases split their vertices.
        let mut sides: HashMap<[[u32; 3]; 2], i32> = HashMap::new();
        for [a, b] in mesh.one_sided.iter().flat_map(|&t| edges(t)) {
            let [a, b] = [a, b].map(|k| mesh.points[k as usize].position.to_array().map(f32::to_bits));
            *sides.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
        }
        assert!(sides.values().all(|&both| both == 0));
    }

    #[test]
    fn two_sided_meshes_have_points_on_both_sides() {
        let mut scene = synthetic::square();
        scene.meshes[0].two_sided = true;
        let mesh = ViewMesh::new(&scene, 1_000);
        let up = mesh.points.iter().filter(|p| p.normal == Vec3::Z).count();
        assert_eq!((2 * up, mesh.one_sided.len()), (mesh.points.len(), 0));
        assert!((area(&mesh) - 2.0).abs() < 1e-4 && mesh.points.len() <= 1_000);
        for triangle in &mesh.two_sided {
            let corners = triangle.map(|k| mesh.points[k as usize]);
            let normal = triangle::normal(corners.map(|c| c.position));
            assert!(normal.dot(corners[0].normal) > 0.99);
        }
    }

    #[test]
    fn fine_meshes_keep_their_vertices() {
        let mesh = ViewMesh::new(&synthetic::square(), 1);
        assert_eq!((mesh.points.len(), mesh.one_sided.len()), (4, 2));
        // What is coarse beside them is cut all the same: six walls of four corners each, and up to eight more.
        let count = ViewMesh::new(&synthetic::room(), 16).points.len();
        assert!((25..=32).contains(&count), "{count}");
        assert!(ViewMesh::new(&synthetic::scene(vec![], vec![]), 10).points.is_empty());
    }

    #[test]
    fn albedo_is_carried_to_the_new_vertices() {
        let mut scene = synthetic::square();
        let ramp = |x: f32| Vec3::new(x, 0.5, 1.0 - x);
        scene.meshes[0].albedo = Albedo::Vertex(scene.vertices.iter().map(|v| ramp(v.x)).collect());
        let mesh = ViewMesh::new(&scene, 500);
        assert!(mesh.points.len() >= 250, "{}", mesh.points.len());
        for (point, albedo) in mesh.points.iter().zip(&mesh.albedo) {
            // Halves of halves of binary fractions: exact.
            assert_eq!(*albedo, ramp(point.position.x));
        }
    }
}
