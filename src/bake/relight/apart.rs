//! The lights of a lighting, each by itself.

use super::lighting::{Lighting, with_strength};
use super::origins::{Origin, is_lit};
use crate::light::Rgb;
use crate::scene::Scene;

/// One light of a scene and darkness otherwise.
#[derive(Debug, Clone, PartialEq)]
pub struct Alone {
    /// What the scene calls it; `sky` for light from outside.
    pub name: String,
    /// The mesh that it is, for meshes that emit.
    pub mesh: Option<usize>,
    /// Whether it is the sky.
    pub is_sky: bool,
    /// Nothing but it.
    pub lighting: Lighting,
}

impl Lighting {
    /// The lights that are lit, each alone: their sum is this lighting.
    pub fn apart(&self, scene: &Scene) -> Vec<Alone> {
        let meshes = (0..self.meshes.len()).map(Origin::Mesh);
        let lamps = (0..self.lamps.len()).map(Origin::Lamp);
        let lit = meshes.chain(lamps).chain([Origin::Sky]).filter(|origin| is_lit(self, *origin));
        lit.map(|origin| self.alone(scene, origin)).collect()
    }

    fn alone(&self, scene: &Scene, origin: Origin) -> Alone {
        let mut lighting = self.clone();
        for (k, mesh) in lighting.meshes.iter_mut().enumerate() {
            mesh.radiance = if origin == Origin::Mesh(k) { mesh.radiance } else { Rgb::ZERO };
        }
        for (k, lamp) in lighting.lamps.iter_mut().enumerate() {
            *lamp = if origin == Origin::Lamp(k) { *lamp } else { with_strength(lamp, Rgb::ZERO) };
        }
        if let Some(sky) = lighting.sky.as_mut().filter(|_| origin != Origin::Sky) {
            sky.tint = Rgb::ZERO;
        }
        let (name, mesh) = match origin {
            Origin::Mesh(k) => (scene.meshes[k].name.clone(), Some(k)),
            Origin::Lamp(k) => (scene.lamps[k].name.clone(), None),
            Origin::Sky | Origin::Harmonic(_) => ("sky".to_owned(), None),
        };
        Alone { name, mesh, is_sky: origin == Origin::Sky, lighting }
    }
}
