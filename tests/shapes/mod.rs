//! Shapes and scenes made in code, for integration tests.
//!
//! Shapes are in world coordinates (f64); [`scene`] brings parts into one unit-sized local frame as the readers do.
//! A shape's front is the side its triangles run counter-clockwise on.

#![allow(dead_code)] // Each integration test takes the shapes that it needs.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::path::PathBuf;

use glam::{DVec3, Vec3};
use glowtree::geometry::hash::Stream;
use glowtree::geometry::{SurfacePoint, triangle};
use glowtree::light::Rgb;
use glowtree::scene::{Albedo, Lamp, LampKind, Mesh, Placement, Scene, Sky};

/// Triangles over their own vertices, world coordinates.
#[derive(Debug, Clone, Default)]
pub struct Shape {
    /// Corners.
    pub vertices: Vec<DVec3>,
    /// Counter-clockwise seen from the front.
    pub triangles: Vec<[u32; 3]>,
}

impl Shape {
    /// The same surface with its front on the other side.
    pub fn flipped(mut self) -> Self {
        self.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        self
    }

    /// The shape with each vertex moved by `map`.
    pub fn mapped(mut self, map: impl Fn(DVec3) -> DVec3) -> Self {
        self.vertices.iter_mut().for_each(|v| *v = map(*v));
        self
    }

    /// Scaled about the world's origin.
    pub fn scaled(self, factor: f64) -> Self {
        self.mapped(|v| v * factor)
    }

    /// Moved.
    pub fn translated(self, by: DVec3) -> Self {
        self.mapped(|v| v + by)
    }

    /// Both shapes as one; their vertices stay apart.
    pub fn with(mut self, other: &Self) -> Self {
        let first = self.vertices.len() as u32;
        self.vertices.extend(&other.vertices);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|v| v + first)));
        self
    }

    /// Total area of one side.
    pub fn area(&self) -> f64 {
        self.triangles.iter().map(|t| 0.5 * self.area_vector(t).length()).sum()
    }

    /// Volume enclosed by a closed shape, positive when its front looks outwards.
    pub fn volume(&self) -> f64 {
        self.triangles.iter().map(|t| self.vertices[t[0] as usize].dot(self.area_vector(t)) / 6.0).sum()
    }

    fn area_vector(&self, t: &[u32; 3]) -> DVec3 {
        let [a, b, c] = t.map(|v| self.vertices[v as usize]);
        (b - a).cross(c - a)
    }
}

/// A grid of `columns` × `rows` quads over the unit square, each vertex placed by `map`; the front is the side from
/// which u to v runs counter-clockwise.
pub fn grid(columns: u32, rows: u32, map: impl Fn(f64, f64) -> DVec3) -> Shape {
    let mut shape = Shape::default();
    for j in 0..=rows {
        for i in 0..=columns {
            shape.vertices.push(map(f64::from(i) / f64::from(columns), f64::from(j) / f64::from(rows)));
        }
    }
    for j in 0..rows {
        for i in 0..columns {
            let a = j * (columns + 1) + i;
            let (b, c, d) = (a + 1, a + columns + 2, a + columns + 1);
            shape.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    shape
}

/// The parallelogram from `corner` along `along` and `up`, n × n quads; the front looks to along × up.
pub fn quad(corner: DVec3, along: DVec3, up: DVec3, n: u32) -> Shape {
    grid(n, n, |u, v| corner + along * u + up * v)
}

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

/// A mesh to be: a shape and what it is made of.
#[derive(Debug, Clone)]
pub struct Part {
    /// Handle.
    pub name: String,
    /// Surface.
    pub shape: Shape,
    /// Albedo.
    pub albedo: Rgb,
    /// Emitted radiance; exitance is π times this.
    pub radiance: Rgb,
    /// Whether the back reflects and emits too.
    pub two_sided: bool,
}

/// A grey, one-sided, dark part.
pub fn part(name: &str, shape: Shape, albedo: f32) -> Part {
    Part { name: name.into(), shape, albedo: Rgb::splat(albedo), radiance: Rgb::ZERO, two_sided: false }
}

impl Part {
    /// Emitting the exitance E₀ [W·m⁻²].
    pub fn exitance(mut self, exitance: f32) -> Self {
        self.radiance = Rgb::splat(exitance / std::f32::consts::PI);
        self
    }

    /// With a coloured albedo.
    pub fn coloured(mut self, albedo: [f32; 3]) -> Self {
        self.albedo = albedo.into();
        self
    }

    /// Reflecting and emitting on both sides.
    pub fn two_sided(mut self) -> Self {
        self.two_sided = true;
        self
    }
}

/// The parts as one scene, normalised: the box's centre is the local origin and its longest edge the unit.
pub fn scene(parts: &[Part]) -> Scene {
    let placement = framing(parts);
    let mut scene = Scene {
        placement,
        vertices: Vec::new(),
        triangles: Vec::new(),
        meshes: Vec::new(),
        sky: None,
        lamps: Vec::new(),
        cameras: Vec::new(),
        up: Vec3::Z,
        warnings: Vec::new(),
    };
    for part in parts {
        append(&mut scene, part);
    }
    scene
}

fn framing(parts: &[Part]) -> Placement {
    let all = || parts.iter().flat_map(|p| p.shape.vertices.iter().copied());
    let min = all().fold(DVec3::INFINITY, DVec3::min);
    let max = all().fold(DVec3::NEG_INFINITY, DVec3::max);
    Placement { origin: (min + max) * 0.5, scale: (max - min).max_element() }
}

fn append(scene: &mut Scene, part: &Part) {
    let (vertex, triangle) = (scene.vertices.len() as u32, scene.triangles.len() as u32);
    scene.vertices.extend(part.shape.vertices.iter().map(|v| scene.placement.to_local(*v)));
    scene.triangles.extend(part.shape.triangles.iter().map(|t| t.map(|v| v + vertex)));
    scene.meshes.push(Mesh {
        name: part.name.clone(),
        file: PathBuf::from(format!("{}.ply", part.name)),
        triangles: triangle..scene.triangles.len() as u32,
        vertices: vertex..scene.vertices.len() as u32,
        two_sided: part.two_sided,
        albedo: Albedo::Constant(part.albedo),
        radiance: part.radiance,
        normals: None,
    });
}

/// The scene under a uniform sky.
pub fn under_sky(mut scene: Scene, radiance: f32) -> Scene {
    scene.sky = Some(Sky::Constant(Rgb::splat(radiance)));
    scene
}

/// The scene with a sun whose light travels along `direction` (any length).
pub fn with_sun(mut scene: Scene, direction: DVec3, irradiance: f32) -> Scene {
    let direction = direction.normalize().as_vec3();
    let kind = LampKind::Sun { direction, irradiance: Rgb::splat(irradiance) };
    scene.lamps.push(Lamp { name: "sun".into(), kind });
    scene
}

/// The scene with a point lamp at a world position, `intensity` in W·sr⁻¹ of world units.
pub fn with_point_lamp(mut scene: Scene, position: DVec3, intensity: f64) -> Scene {
    let local = (intensity / (scene.placement.scale * scene.placement.scale)) as f32;
    let kind = LampKind::Point { position: scene.placement.to_local(position), intensity: Rgb::splat(local) };
    scene.lamps.push(Lamp { name: "point".into(), kind });
    scene
}

/// `n` points spread evenly over the front of one mesh (jittered strata along its cumulative area), seeded.
pub fn points_on(scene: &Scene, mesh: usize, n: usize, seed: u64) -> Vec<SurfacePoint> {
    let ids: Vec<u32> = scene.meshes[mesh].triangles.clone().collect();
    let mut sums = vec![0.0f64];
    for &id in &ids {
        sums.push(sums[sums.len() - 1] + f64::from(triangle::area(scene.corners(id))));
    }
    let total = sums[ids.len()];
    let mut stream = Stream::new(seed, mesh as u64);
    (0..n)
        .map(|i| {
            let at = (i as f64 + f64::from(stream.unit())) / n as f64 * total;
            let id = ids[(sums.partition_point(|s| *s <= at) - 1).min(ids.len() - 1)];
            let (u, v) = triangle::uniform_barycentric(stream.unit_pair());
            SurfacePoint { position: triangle::point(scene.corners(id), u, v), normal: scene.normal(id) }
        })
        .collect()
}

/// A quarter turn.
pub const RIGHT_ANGLE: f64 = FRAC_PI_2;
/// Half a turn.
pub const STRAIGHT_ANGLE: f64 = PI;
