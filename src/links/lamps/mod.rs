//! Lamps: small emitters and punctual lights, whose light is aimed for rather than met by chance.

pub mod emitter;
pub mod light;
pub mod shadow;
pub mod tree;

use glam::Vec3;

pub use emitter::{Emitter, Face, triangle_form_factor};
pub use tree::LampTree;

use crate::geometry::{SurfacePoint, triangle};
use crate::light::{Rgb, mean_channel};
use crate::scene::bright::{Bright, Texel};
use crate::scene::{LampKind, Scene};

/// Large emitters of few triangles are lamps all the same, their form factors being exact, unless emitters make up this
/// share of the scene's area: in a furnace every point sees them everywhere, and rows are exact.
pub const LARGEST_ANALYTIC_SHARE: f64 = 0.6;

/// Emissive meshes above this share of the scene's area are met by the rows' rays; those below are lamps.
///
/// A row of 256 rays sees an emitter of 5 % of the surroundings with about 13 rays, whose lattice noise is a few
/// per cent of its light; below that, aimed rays are cheaper for the same error.
pub const LARGEST_LAMP_SHARE: f64 = 0.05;

/// Emitters of more triangles than this are not lamps for the exactness of their form factors, …
const MOST_ANALYTIC: usize = 128;

/// … unless they have at most this share of the scene's area: clusters of faces cost little then, whereas sites may be
/// coarser than what glows (a thousand quads of 7 % together: 4.7 % error and 17.7 s by rows, 2.5 % and 3.9 s by lamps).
/// Larger ones surround what they light, and what clusters leave out would add up.
const LARGEST_CLUSTERED_SHARE: f64 = 0.15;

/// Where emitters make up [`LARGEST_ANALYTIC_SHARE`] of the area, those brighter than this many times their mean are lamps.
const OUTSHINES: f64 = 2.0;

/// A light that receivers link to directly.
#[derive(Debug, Clone)]
pub struct Lamp {
    /// The handle for relighting.
    pub name: String,
    /// Multiplies the coupling: exitance of an emitter (W·m⁻²), irradiance of a sun, intensity of a point or spot.
    pub strength: Rgb,
    /// Geometry.
    pub shape: Shape,
}

/// The geometry of a lamp.
#[derive(Debug, Clone)]
pub enum Shape {
    /// Faces that emit.
    Emitter(Emitter),
    /// The bright part of an image sky; its coupling includes its light, so that its strength is one.
    Sky(Bright),
    /// A punctual light; its light fields are unused here.
    Punctual(LampKind),
}

/// Splits the scene's light sources: lamps to aim at, and for each mesh whether the rows meet its emission.
///
/// Coincident faces of emitters give light once. The bright part of an image sky is the last lamp, named "sky"; the rows
/// meet the rest of it, [`super::direct::Direct::sky`].
pub fn split(scene: &Scene) -> (Vec<Lamp>, Vec<bool>) {
    let area_of = |range: &std::ops::Range<u32>| -> f64 {
        range.clone().map(|t| f64::from(triangle::area(scene.corners(t)))).sum()
    };
    let areas: Vec<f64> = scene.meshes.iter().map(|m| area_of(&m.triangles)).collect();
    let total: f64 = areas.iter().sum();
    let radiance = |k: usize| f64::from(mean_channel(scene.meshes[k].radiance));
    let emitting: f64 = (0..areas.len()).filter(|&k| radiance(k) > 0.0).map(|k| areas[k]).sum();
    let power: f64 = (0..areas.len()).map(|k| areas[k] * radiance(k)).sum();
    let furnace = emitting >= LARGEST_ANALYTIC_SHARE * total;
    let (mut lamps, mut seen) = (Vec::new(), emitter::Seen::new());
    let mut glowing = vec![false; scene.meshes.len()];
    for (k, mesh) in scene.meshes.iter().enumerate() {
        if mesh.radiance.max_element() <= 0.0 || areas[k] <= 0.0 {
            continue;
        }
        let large = areas[k] > LARGEST_LAMP_SHARE * total;
        let analytic = mesh.triangles.len() <= MOST_ANALYTIC || areas[k] <= LARGEST_CLUSTERED_SHARE * total;
        let outshines = radiance(k) * emitting > OUTSHINES * power;
        if if furnace { large || !outshines } else { large && !analytic } {
            glowing[k] = true;
            continue;
        }
        let emitter = Emitter::new(scene, k, &mut seen);
        let strength = mesh.radiance * std::f32::consts::PI;
        lamps.push(Lamp { name: mesh.name.clone(), strength, shape: Shape::Emitter(emitter) });
    }
    for lamp in &scene.lamps {
        let strength = match lamp.kind {
            LampKind::Sun { irradiance, .. } => irradiance,
            LampKind::Point { intensity, .. } | LampKind::Spot { intensity, .. } => intensity,
        };
        lamps.push(Lamp { name: lamp.name.clone(), strength, shape: Shape::Punctual(lamp.kind) });
    }
    if let Some(bright) = scene.sky.as_ref().and_then(|sky| sky.split().1) {
        lamps.push(Lamp { name: "sky".into(), strength: Rgb::ONE, shape: Shape::Sky(bright) });
    }
    (lamps, glowing)
}

impl Lamp {
    /// Irradiance at a point per unit of strength, were nothing in the way: each of its parts summed, exactly.
    ///
    /// [`LampTree`] does the same for all lamps at once and in less time.
    pub fn coupling(&self, at: &SurfacePoint) -> f32 {
        match &self.shape {
            Shape::Emitter(emitter) => {
                let sum: f64 = emitter.faces.iter().map(|f| f64::from(f.form_factor(at))).sum();
                sum.min(1.0) as f32
            }
            Shape::Sky(bright) => bright.texels.iter().map(|t| mean_channel(texel_light(t, at))).sum(),
            Shape::Punctual(kind) => beam(kind, at),
        }
    }

    /// Whether one ray tells all: its visibility is 0 or 1 and jumps.
    pub fn is_punctual(&self) -> bool {
        matches!(self.shape, Shape::Punctual(_))
    }
}

/// Irradiance at a point of a bright pixel of the sky.
fn texel_light(texel: &Texel, at: &SurfacePoint) -> Rgb {
    texel.light * texel.direction.dot(at.normal).max(0.0)
}

/// Irradiance at a point per unit of strength of a punctual light.
fn beam(kind: &LampKind, at: &SurfacePoint) -> f32 {
    match kind {
        LampKind::Sun { direction, .. } => (-at.normal.dot(*direction)).max(0.0),
        LampKind::Point { position, .. } => falloff(at, *position),
        LampKind::Spot { position, direction, inner_cosine, outer_cosine, .. } => {
            let cosine = (at.position - *position).normalize_or_zero().dot(*direction);
            let width = (inner_cosine - outer_cosine).max(1e-6);
            let x = ((cosine - outer_cosine) / width).clamp(0.0, 1.0);
            // KHR_lights_punctual.
            falloff(at, *position) * x * x
        }
    }
}

/// cosθ / r² towards a punctual position.
fn falloff(at: &SurfacePoint, position: Vec3) -> f32 {
    let d = position - at.position;
    let square = d.length_squared().max(1e-12);
    (d.dot(at.normal) / square.sqrt()).max(0.0) / square
}
