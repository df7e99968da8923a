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
    let ramp = ((cosine - outer) / (inner - outer).max(1e-3)).clamp(0.0, 1.0);
    ramp * ramp
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A spot, two point lamps and a sun about the origin; a small triangle hides the second point lamp.
    fn scene() -> (Vec<Lamp>, Bvh, SurfacePoint) {
        let point = |position| LampKind::Point { position, intensity: Rgb::new(1.0, 2.0, 3.0) };
        let spot = LampKind::Spot {
            position: Vec3::Z,
            direction: Vec3::NEG_Z,
            intensity: Rgb::ONE,
            inner_cosine: 0.9,
            outer_cosine: 0.8,
        };
        let sun = LampKind::Sun { direction: Vec3::new(0.6, 0.0, -0.8), irradiance: Rgb::splat(0.5) };
        let kinds = [spot, point(Vec3::new(0.0, 0.6, 0.8)), point(Vec3::new(0.0, -0.6, 0.8)), sun];
        let lamps = kinds.map(|kind| Lamp { name: String::new(), kind }).to_vec();
        let blocker = [Vec3::new(-0.1, -0.3, 0.3), Vec3::new(0.1, -0.3, 0.3), Vec3::new(0.0, -0.3, 0.6)];
        let bvh = Bvh::build_triangles(&blocker, &[[0, 1, 2]]);
        (lamps, bvh, SurfacePoint { position: Vec3::ZERO, normal: Vec3::Z })
    }

    #[test]
    fn lamps_add_up_and_cast_shadows() {
        let (lamps, bvh, at) = scene();
        // Spot on its axis at distance 1; the free point lamp and the sun at cosine 0.8.
        let want = Rgb::ONE + Rgb::new(0.8, 1.6, 2.4) + Rgb::splat(0.4);
        assert!((direct(&lamps, &bvh, &at) - want).length() < 1e-5);
        let below = SurfacePoint { normal: Vec3::NEG_Z, ..at };
        assert_eq!(direct(&lamps, &bvh, &below), Rgb::ZERO);
    }

    #[test]
    fn drawing_one_lamp_is_unbiased() {
        let (lamps, bvh, at) = scene();
        let n = 10_000u16;
        let number = |i: u16| (f32::from(i) + 0.5) / f32::from(n);
        let mean = (0..n).map(|i| one_of(&lamps, &bvh, &at, number(i)).as_dvec3()).sum::<glam::DVec3>()
            / f64::from(n);
        // Equidistant numbers on four intervals: each share is off by 1/n at the most, of estimates below 20.
        assert!((mean - direct(&lamps, &bvh, &at).as_dvec3()).abs().max_element() < 8e-3, "{mean}");
    }

    #[test]
    fn cones_fade_between_their_cosines() {
        assert_eq!([0.95, 0.9, 0.8, 0.1].map(|c| cone(c, 0.9, 0.8)), [1.0, 1.0, 0.0, 0.0]);
        assert!((cone(0.85, 0.9, 0.8) - 0.25).abs() < 1e-5);
    }
}
