//! The lights of a lighting, each by itself.

use super::lighting::{Lighting, SkyLight, with_strength};
use super::origins::{Origin, is_lit, tint};
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
        let lit = self.origins().filter(|origin| is_lit(self, *origin));
        lit.map(|origin| self.alone(scene, origin)).collect()
    }

    /// What multiplies each light's unit, by channel: meshes, lamps and the sky, in this order, those that are dark included.
    pub fn tints(&self) -> Vec<Rgb> {
        self.origins().map(|origin| tint(self, origin)).collect()
    }

    /// The same with other tints. Lightings that are equal with equal tints are sums of the same units.
    #[must_use]
    pub fn with_tints(&self, tints: &[Rgb]) -> Self {
        let mut lighting = self.clone();
        let (meshes, others) = tints.split_at(self.meshes.len());
        lighting.meshes.iter_mut().zip(meshes).for_each(|(mesh, tint)| mesh.radiance = *tint);
        lighting.lamps.iter_mut().zip(others).for_each(|(lamp, tint)| *lamp = with_strength(lamp, *tint));
        let sky = lighting.sky.get_or_insert(SkyLight::DARK);
        sky.constant = sky.constant.map(|_| Rgb::ONE);
        sky.tint = others.last().copied().unwrap_or_default();
        lighting
    }

    /// A light by its number among the tints, alone and as bright as one.
    pub fn unit(&self, scene: &Scene, number: usize) -> Option<Alone> {
        let origin = self.origins().nth(number)?;
        let mut tints = vec![Rgb::ZERO; self.meshes.len() + self.lamps.len() + 1];
        tints[number] = Rgb::ONE;
        Some(self.with_tints(&tints).alone(scene, origin))
    }

    fn origins(&self) -> impl Iterator<Item = Origin> + use<> {
        let (meshes, lamps) = (0..self.meshes.len(), 0..self.lamps.len());
        meshes.map(Origin::Mesh).chain(lamps.map(Origin::Lamp)).chain([Origin::Sky])
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
        let mesh = if let Origin::Mesh(k) = origin { Some(k) } else { None };
        Alone { name: origin.name(scene).to_owned(), mesh, is_sky: origin == Origin::Sky, lighting }
    }
}
