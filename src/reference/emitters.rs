//! Emissive triangles, drawn by their power.

use glam::Vec3;

use super::pattern::{Density, Pick, unit};
use crate::geometry::triangle;
use crate::light::{Rgb, mean_channel};
use crate::scene::Scene;

/// All emissive triangles of a scene with a density over their points proportional to radiance.
pub(super) struct Emitters<'a> {
    scene: &'a Scene,
    triangles: Vec<u32>,
    picks: Density,
}

/// A point of an emitter.
#[derive(Debug, Clone, Copy)]
pub(super) struct EmitterPoint {
    /// Local position.
    pub position: Vec3,
    /// Unit normal of the front.
    pub normal: Vec3,
    /// Whether the back emits as well.
    pub two_sided: bool,
    /// Emitted radiance.
    pub radiance: Rgb,
    /// Density by area with which it is drawn.
    pub density: f32,
}

impl<'a> Emitters<'a> {
    /// Collects the emitters; `None` when nothing emits.
    pub fn new(scene: &'a Scene) -> Option<Self> {
        let triangles: Vec<u32> = scene
            .meshes
            .iter()
            .filter(|mesh| mean_channel(mesh.radiance) > 0.0)
            .flat_map(|mesh| mesh.triangles.clone())
            .collect();
        let power = |id: &u32| {
            let radiance = mean_channel(scene.meshes[scene.mesh_of(*id)].radiance);
            f64::from(radiance) * f64::from(triangle::area(scene.corners(*id)))
        };
        let picks = Density::new(triangles.iter().map(power))?;
        Some(Self { scene, triangles, picks })
    }

    /// A point at two numbers given in 32-bit fractions of one.
    pub fn draw(&self, [x, y]: [u32; 2]) -> EmitterPoint {
        let Pick { entry, rest, .. } = self.picks.pick(x);
        let id = self.triangles[entry];
        let mesh = &self.scene.meshes[self.scene.mesh_of(id)];
        let corners = self.scene.corners(id);
        let (u, v) = triangle::uniform_barycentric([rest as f32, unit(y)]);
        EmitterPoint {
            position: triangle::point(corners, u, v),
            normal: triangle::normal(corners),
            two_sided: mesh.two_sided,
            radiance: mesh.radiance,
            density: self.density(mesh.radiance),
        }
    }

    /// The density by area with which a point that emits this radiance is drawn.
    pub fn density(&self, radiance: Rgb) -> f32 {
        (f64::from(mean_channel(radiance)) / self.picks.total()) as f32
    }
}
