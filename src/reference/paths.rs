//! One path: from a point into the scene by cosine-distributed directions, at each vertex aimed at the lights.
//!
//! This work is based on: Kajiya, "The Rendering Equation", SIGGRAPH 1986; Veach and Guibas, "Optimally Combining
//! Sampling Techniques", SIGGRAPH 1995 (the power heuristic); Arvo and Kirk, "Particle Transport and Image
//! Synthesis", SIGGRAPH 1990 (Russian roulette).

use std::f32::consts::{FRAC_1_PI, PI};

use glam::Vec3;

use super::emitters::Emitters;
use super::lamps;
use super::origins::{lifted, lifted_end};
use super::pattern::{Draws, Purpose, unit};
use super::sky::SkyLight;
use crate::geometry::{SurfacePoint, hemisphere, tangent_frame, triangle};
use crate::light::Rgb;
use crate::rays::{Bvh, Hit, Ray};
use crate::scene::Scene;

/// Paths of fewer bounces are never ended by chance: they carry most of the light. Squared error times cost at 64 samples
/// for 0, 1, 2, 4 (Cornell box, scan, two rooms): 158, 140, 132, 125; 65, 42, 35, 34; 751, 655, 663, 720.
const CERTAIN_BOUNCES: u32 = 3;

/// A scene ready to be traced: its triangles and everything in it that can be aimed at.
pub(super) struct Tracer<'a> {
    pub scene: &'a Scene,
    pub bvh: &'a Bvh,
    pub emitters: Option<Emitters<'a>>,
    pub sky: SkyLight<'a>,
    pub max_bounces: u32,
}

/// A vertex of a path: where it lies and what the surface does there, on the side that was hit.
struct Vertex {
    at: SurfacePoint,
    albedo: Rgb,
    radiance: Rgb,
}

impl<'a> Tracer<'a> {
    pub fn new(scene: &'a Scene, bvh: &'a Bvh, max_bounces: u32) -> Self {
        let sky = SkyLight::new(scene.sky.as_ref());
        Self { scene, bvh, emitters: Emitters::new(scene), sky, max_bounces }
    }

    /// An unbiased estimate of the irradiance at a point, the direct light of punctual lamps left out.
    pub fn irradiance(&self, start: &SurfacePoint, draws: &Draws) -> Rgb {
        let mut at = *start;
        // Share of the radiance met so far on the way that still arrives: a product of albedos.
        let mut weight = Rgb::ONE;
        let mut light = Rgb::ZERO;
        for bounce in 0.. {
            light += weight * self.aimed(&at, draws, bounce);
            let [x, y] = draws.pair(bounce, Purpose::Direction);
            let local = hemisphere::cosine_hemisphere([x, y]);
            let (tangent, bitangent) = tangent_frame(at.normal);
            let direction = tangent * local.x + bitangent * local.y + at.normal * local.z;
            let chance = local.z * FRAC_1_PI;
            let Some(hit) = self.bvh.closest(&Ray::new(lifted(&at), direction)) else {
                light += weight * self.sky_met(direction, chance);
                break;
            };
            let Some(vertex) = self.vertex(&hit, direction) else { break };
            light += weight * self.emission_met(&vertex, &hit, direction, chance);
            weight *= vertex.albedo;
            let survival = weight.max_element().min(1.0);
            if bounce >= self.max_bounces || survival <= 0.0 {
                break;
            }
            if bounce >= CERTAIN_BOUNCES {
                if draws.pair(bounce, Purpose::Choice)[1] >= survival {
                    break;
                }
                weight /= survival;
            }
            at = vertex.at;
        }
        light * PI
    }

    /// The surface at a hit, seen against `direction`; `None` on the black back of a one-sided mesh.
    fn vertex(&self, hit: &Hit, direction: Vec3) -> Option<Vertex> {
        let corners = self.scene.corners(hit.triangle);
        let front = triangle::normal(corners);
        let facing = front.dot(direction);
        let mesh = &self.scene.meshes[self.scene.mesh_of(hit.triangle)];
        if facing == 0.0 || (facing > 0.0 && !mesh.two_sided) {
            return None;
        }
        let normal = if facing < 0.0 { front } else { -front };
        let position = triangle::point(corners, hit.u, hit.v);
        let albedo = self.scene.albedo(hit.triangle, hit.u, hit.v);
        Some(Vertex { at: SurfacePoint { position, normal }, albedo, radiance: mesh.radiance })
    }

    /// Light over π from the emitters and the sky that was aimed at, and beyond the first vertex from a lamp.
    fn aimed(&self, at: &SurfacePoint, draws: &Draws, bounce: u32) -> Rgb {
        let mut light = self.aimed_at_emitter(at, draws, bounce);
        light += self.aimed_at_sky(at, draws, bounce);
        if bounce > 0 && !self.scene.lamps.is_empty() {
            let number = unit(draws.bits(bounce, Purpose::Choice)[0]);
            light += lamps::one_of(&self.scene.lamps, self.bvh, at, number) * FRAC_1_PI;
        }
        light
    }

    fn aimed_at_emitter(&self, at: &SurfacePoint, draws: &Draws, bounce: u32) -> Rgb {
        let Some(emitters) = &self.emitters else { return Rgb::ZERO };
        let point = emitters.draw(draws.bits(bounce, Purpose::Emitter));
        let to = point.position - at.position;
        let square = to.length_squared();
        let direction = to * square.max(f32::MIN_POSITIVE).sqrt().recip();
        let (cosine, front) = (at.normal.dot(direction), -point.normal.dot(direction));
        let emitted = if point.two_sided { front.abs() } else { front };
        if cosine <= 0.0 || emitted <= 0.0 {
            return Rgb::ZERO;
        }
        // Ends just before the emitter, on the side that is seen.
        let end = lifted_end(point.position, point.normal, front);
        if self.bvh.occluded(&Ray::between(lifted(at), end)) {
            return Rgb::ZERO;
        }
        let density = point.density * square / emitted;
        let share = power_share(density, cosine * FRAC_1_PI);
        point.radiance * (cosine * FRAC_1_PI * share / density)
    }

    fn aimed_at_sky(&self, at: &SurfacePoint, draws: &Draws, bounce: u32) -> Rgb {
        let SkyLight::Image(panorama) = &self.sky else { return Rgb::ZERO };
        let Some((direction, density)) = panorama.draw(draws.bits(bounce, Purpose::Sky)) else {
            return Rgb::ZERO;
        };
        let cosine = at.normal.dot(direction);
        if cosine <= 0.0 || density <= 0.0 || self.bvh.occluded(&Ray::new(lifted(at), direction)) {
            return Rgb::ZERO;
        }
        let share = power_share(density, cosine * FRAC_1_PI);
        panorama.radiance(direction) * (cosine * FRAC_1_PI * share / density)
    }

    /// Sky light met by a ray that leaves the scene, weighted against having aimed at it.
    fn sky_met(&self, direction: Vec3, chance: f32) -> Rgb {
        match &self.sky {
            SkyLight::Dark => Rgb::ZERO,
            SkyLight::Even(radiance) => *radiance,
            SkyLight::Image(panorama) => {
                panorama.radiance(direction) * power_share(chance, panorama.density(direction))
            }
        }
    }

    /// Emitted light met by a ray, weighted against having aimed at it.
    fn emission_met(&self, vertex: &Vertex, hit: &Hit, direction: Vec3, chance: f32) -> Rgb {
        let Some(emitters) = &self.emitters else { return Rgb::ZERO };
        if vertex.radiance == Rgb::ZERO {
            return Rgb::ZERO;
        }
        let emitted = -vertex.at.normal.dot(direction);
        let density =
            emitters.density(vertex.radiance) * hit.distance * hit.distance / emitted.max(f32::MIN_POSITIVE);
        vertex.radiance * power_share(chance, density)
    }
}

/// The share of a sample drawn with density `own` that might as well have been drawn with density `other`.
fn power_share(own: f32, other: f32) -> f32 {
    // As a ratio, so that huge densities do not overflow; both zero means the sample does not exist.
    let ratio = other / own.max(f32::MIN_POSITIVE);
    1.0 / (1.0 + ratio * ratio)
}
