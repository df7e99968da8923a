//! The lights of a scene, each of which can be another strength without new links.

use std::sync::Arc;

use super::lighting::{Lighting, MeshLight, strength};
use crate::light::Rgb;
use crate::links::lamps::{Lamp, Shape};
use crate::scene::{Scene, Sky, Texture};

/// A light of the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::bake) enum Origin {
    /// A mesh that emits.
    Mesh(usize),
    /// A punctual lamp.
    Lamp(usize),
    /// All light from outside.
    Sky,
    /// A sky that is one of the spherical harmonics, by its number; only transfers are of such.
    Harmonic(usize),
}

impl Origin {
    /// What the scene calls it; `sky` for light from outside.
    pub(in crate::bake) fn name(self, scene: &Scene) -> &str {
        match self {
            Self::Mesh(k) => &scene.meshes[k].name,
            Self::Lamp(k) => &scene.lamps[k].name,
            Self::Sky | Self::Harmonic(_) => "sky",
        }
    }
}

/// The lights of a scene that may be switched: meshes that emit; lamps and sky, though they be off.
pub(in crate::bake) fn switches(scene: &Scene) -> Vec<Origin> {
    let emits = |m: &usize| scene.meshes[*m].radiance.max_element() > 0.0;
    let meshes = (0..scene.meshes.len()).filter(emits).map(Origin::Mesh);
    let sky = scene.sky.as_ref().map(|_| Origin::Sky);
    meshes.chain((0..scene.lamps.len()).map(Origin::Lamp)).chain(sky).collect()
}

/// Which light of the scene a lamp is.
pub(in crate::bake) fn origin_of(lamps: &[Lamp], lamp: usize) -> Origin {
    match &lamps[lamp].shape {
        Shape::Emitter(emitter) => Origin::Mesh(emitter.mesh),
        Shape::Sky(_) => Origin::Sky,
        Shape::Punctual(_) => {
            let before = lamps[..lamp].iter().filter(|lamp| matches!(lamp.shape, Shape::Punctual(_)));
            Origin::Lamp(before.count())
        }
    }
}

/// What multiplies a light's unit.
pub(in crate::bake) fn tint(lighting: &Lighting, origin: Origin) -> Rgb {
    match origin {
        Origin::Mesh(k) => lighting.meshes[k].radiance,
        Origin::Lamp(k) => strength(&lighting.lamps[k]),
        Origin::Sky | Origin::Harmonic(_) => {
            lighting.sky.as_ref().map_or(Rgb::ZERO, |sky| sky.tint * sky.constant.unwrap_or(Rgb::ONE))
        }
    }
}

/// The strength of the lamp that a light is: exitance of a mesh.
pub(in crate::bake) fn lamp_strength(lighting: &Lighting, origin: Origin) -> Rgb {
    let unit = if matches!(origin, Origin::Mesh(_)) { std::f32::consts::PI } else { 1.0 };
    tint(lighting, origin) * unit
}

/// Per mesh the exitance that rows meet.
pub(in crate::bake) fn glow(lighting: &Lighting, glowing: &[bool]) -> Vec<Rgb> {
    let exitance = |(mesh, glows): (&MeshLight, &bool)| {
        if *glows { mesh.radiance * std::f32::consts::PI } else { Rgb::ZERO }
    };
    lighting.meshes.iter().zip(glowing).map(exitance).collect()
}

pub(in crate::bake) fn is_lit(lighting: &Lighting, origin: Origin) -> bool {
    tint(lighting, origin).max_element() > 0.0
}

/// A sky times a colour.
pub(in crate::bake) fn tinted(sky: &Sky, by: Rgb) -> Sky {
    match sky {
        _ if by == Rgb::ONE => sky.clone(),
        Sky::Constant(radiance) => Sky::Constant(*radiance * by),
        Sky::Image { image, to_image } => {
            let pixels = image.pixels.iter().map(|pixel| *pixel * by).collect();
            Sky::Image { image: Arc::new(Texture { pixels, ..**image }), to_image: *to_image }
        }
    }
}
