//! Shapes become scenes: materials, one unit-sized local frame, skies and lamps, and points to ask at.

use std::path::PathBuf;

use glam::{DVec3, Vec3};

use super::shape::Shape;
use crate::geometry::hash::Stream;
use crate::geometry::{SurfacePoint, triangle};
use crate::light::Rgb;
use crate::scene::{Albedo, Lamp, LampKind, Mesh, Placement, Scene, Sky};

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
