//! Punctual lamps: what one sends to a point when nothing stands between.

use glam::Vec3;

use super::origins::lifted;
use crate::geometry::SurfacePoint;
use crate::light::Rgb;
use crate::rays::{Bvh, Ray};
use crate::scene::{Lamp, LampKind};

/// Unoccluded irradiance of a lamp on a point, and the ray that must be free for it; `None` when there is none.
pub(super) fn beam(lamp: &Lamp, at: &SurfacePoint) -> Option<(Rgb, Ray)> {
    let origin = lifted(at);
    let (light, ray) = match lamp.kind {
        LampKind::Sun { direction, irradiance } => {
            (irradiance * at.normal.dot(-direction), Ray::new(origin, -direction))
        }
        LampKind::Point { position, intensity } => from_point(at, origin, position, intensity),
        LampKind::Spot { position, direction, intensity, inner_cosine, outer_cosine } => {
            let cosine = (at.position - position).normalize_or_zero().dot(direction);
            from_point(at, origin, position, intensity * cone(cosine, inner_cosine, outer_cosine))
        }
    };
    (light.max_element() > 0.0).then_some((light, ray))
}

/// Irradiance of all lamps on a point, shadows cast.
pub(super) fn direct(lamps: &[Lamp], bvh: &Bvh, at: &SurfacePoint) -> Rgb {
    let free = |(light, ray): (Rgb, Ray)| if bvh.occluded(&ray) { Rgb::ZERO } else { light };
    lamps.iter().filter_map(|lamp| beam(lamp, at)).map(free).sum()
}

/// An unbiased estimate of [`direct`] by one ray: a lamp is drawn by what it would send unoccluded.
pub(super) fn one_of(lamps: &[Lamp], bvh: &Bvh, at: &SurfacePoint, number: f32) -> Rgb {
    let mut total = 0.0;
    let mut rest = number;
    let mut chosen = None;
    for (light, ray) in lamps.iter().filter_map(|lamp| beam(lamp, at)) {
        // Reservoir of one: the newcomer takes over with its share of the total so far.
        let weight = light.element_sum();
        total += weight;
        let share = weight / total;
        if rest < share {
            chosen = Some((light, ray, weight));
            rest /= share;
        } else {
            rest = (rest - share) / (1.0 - share);
        }
    }
    match chosen {
        Some((light, ray, weight)) if !bvh.occluded(&ray) => light * (total / weight),
        _ => Rgb::ZERO,
    }
}

fn from_point(at: &SurfacePoint, origin: Vec3, position: Vec3, intensity: Rgb) -> (Rgb, Ray) {
    let to = position - at.position;
    let square = to.length_squared().max(f32::MIN_POSITIVE);
    let cosine = at.normal.dot(to) / square.sqrt();
    (intensity * (cosine / square), Ray::between(origin, position))
}

/// Share of a spot's light at an angle off its axis: the square of the linear ramp between the cosines, as in
/// KHR_lights_punctual.
fn cone(cosine: f32, inner: f32, outer: f32) -> f32 {
    let ramp = ((cosine - outer) / (inner - outer).max(1e-4)).clamp(0.0, 1.0);
    ramp * ramp
}
