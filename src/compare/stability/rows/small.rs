//! Rows 7, 8 and 13: a thin table leg, a tiny bright lamp, a speck in the air.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};

use super::Numbers;
use crate::bake::Monitor;
use crate::bake::model::Model;
use crate::compare::known::{self, Part, Shape, cuboid, disc, icosphere, part, with_point_lamp};
use crate::compare::stability::Measured;
use crate::compare::stability::bakes::{SEED, apart, asked, light, mean, on, planned, traced, worst};
use crate::compare::textbook::interpolation;
use crate::error::Result;
use crate::geometry::{SurfacePoint, hash, hemisphere, tangent_frame};
use crate::light::mean_channel;
use crate::rays::Ray;
use crate::scene::Scene;

/// What may be left of the lamp's light in the middle of the leg's shadow.
const LEFT: f64 = 0.02;

/// How much larger than the estimate the true error may be: estimates by 500 points were within 0.67 to 1.61 of the truth.
const HONEST: f64 = 1.61;

/// The lamp, and the leg's middle and height.
const LAMP: DVec3 = DVec3::new(0.2, 0.5, 0.9);
const LEG: DVec3 = DVec3::new(0.5, 0.5, 0.5);

/// A unit room under a point lamp, with a leg of this width on its floor.
fn room(width: Option<f64>) -> Scene {
    let mut parts = vec![part("room", cuboid(DVec3::ZERO, DVec3::ONE, 1).flipped(), 0.5)];
    parts.extend(width.map(|w| {
        let foot = DVec3::new(LEG.x - 0.5 * w, LEG.y - 0.5 * w, 0.0);
        part("leg", cuboid(foot, foot + DVec3::new(w, w, LEG.z), 1), 0.5)
    }));
    with_point_lamp(known::scene(&parts), LAMP, 1.0)
}

/// Points along the middle of the shadow on the floor, from the leg's foot to its end.
fn shadow(scene: &Scene) -> Vec<SurfacePoint> {
    let reach = LAMP.x + (LEG.x - LAMP.x) * LAMP.z / (LAMP.z - LEG.z);
    let x = |k: usize| LEG.x + (reach - LEG.x) * (0.2 + 0.7 * k as f64 / 49.0);
    let at = |k: usize| scene.placement.to_local(DVec3::new(x(k), LEG.y, 0.0));
    (0..50).map(|k| SurfacePoint { position: at(k), normal: Vec3::Z }).collect()
}

/// The shadow of a leg half a site's spacing wide is there, and the error is what the report says.
///
/// The spacing is that of the room without the leg. In the middle of the shadow the lamp's light is nought.
/// Seen to fail: on one shadow ray a site, interpolated.
pub fn leg(monitor: &dyn Monitor) -> Result<Numbers> {
    const TARGET: f64 = 0.02;
    let (bare, _) = asked(&room(None), TARGET, SEED, monitor)?;
    let mut spacings = bare.sites.spacings.clone();
    spacings.sort_by(f32::total_cmp);
    let width = 0.5 * f64::from(spacings[spacings.len() / 2]) * bare.scene.placement.scale;
    let (model, report) = asked(&room(Some(width)), TARGET, SEED, monitor)?;
    let direct = |model: &Model| -> Vec<f64> {
        let answers = model.field().evaluate(&shadow(&model.scene));
        answers.iter().map(|a| f64::from(mean_channel(a.direct))).collect()
    };
    let left = mean(&direct(&model)) / mean(&direct(&bare));
    let points = [on(&model, 0, 1500), on(&model, 1, 100)].concat();
    let (truth, noise) = traced(&model.scene, &points, 512);
    let got = light(&model, &points);
    let error = (apart(&got, &truth).powi(2) - noise / mean(&truth).powi(2)).max(0.0).sqrt();
    let name = "lamp's light left in the shadow";
    let textbook = vec![Measured::share(name, left_of_sites(&bare, &model), LEFT)];
    let honesty = Measured::plain("true error over estimate", error / report.estimate.error, HONEST);
    Ok((textbook, vec![Measured::share(name, left, LEFT), honesty]))
}

/// One shadow ray from each site of the bare room, against the leg, interpolated to the shadow's middle.
fn left_of_sites(bare: &Model, with_leg: &Model) -> f64 {
    let lamp = bare.scene.placement.to_local(LAMP);
    let seen = |site: usize| {
        let at = SurfacePoint { position: bare.sites.positions[site], normal: bare.sites.normals[site] };
        let free = !with_leg.bvh.occluded(&Ray::between(at.lifted(), lamp));
        if free { 1.0 } else { 0.0 }
    };
    let seen: Vec<f64> = (0..bare.sites.len()).map(seen).collect();
    mean(&shadow(&bare.scene).iter().map(|p| interpolation::blind(bare, &seen, p)).collect::<Vec<_>>())
}

/// What is asked of the direct light of a tiny emitter.
const DIRECT: f64 = 0.02;

/// Exitance of the tiny emitters: they light the room as one of size 1 and exitance 1 would.
const BRIGHT: f64 = 1e6;

/// The area over π that an emitter shows along a way to it, world units.
type Shown<'a> = &'a dyn Fn(DVec3) -> f64;

/// Direct light of a ball and of a disc of radius 10⁻³ in a room of half-width 1 within 2 % at the worst of 1,200 points.
///
/// Of the ball H = E₀ (r/d)² cosθ, r² its area over 4π, from which 1,280 facets differ by 0.2 %; of the disc
/// H = E₀ A cosθ cosθ′ / (π d²), up to (r/d)² = 10⁻⁶.
/// Seen to fail: on rows of 256 rays, none of which meets the emitter.
pub fn emitter(monitor: &dyn Monitor) -> Result<Numbers> {
    let (mut textbook, mut ours) = (Vec::new(), Vec::new());
    let (ball, disc) = (icosphere(1e-3, 3), disc(1e-3, 64).flipped());
    let [ball_square, disc_square] = [ball.area() / (4.0 * PI), disc.area() / PI];
    // From the point, at world position -way: the ball shows the same to all sides, the disc looks down.
    let of_ball = |_: DVec3| ball_square;
    let of_disc = |way: DVec3| disc_square * way.normalize().z.max(0.0);
    let emitters: [(&str, Shape, Shown<'_>); 2] = [("ball", ball, &of_ball), ("disc", disc, &of_disc)];
    for (name, shape, square) in emitters {
        let walls = cuboid(DVec3::splat(-1.0), DVec3::ONE, 1).flipped();
        let parts = [part("walls", walls, 0.5), part("emitter", shape, 0.0).exitance(BRIGHT as f32)];
        let (model, _) = planned(known::scene(&parts), 0.02, monitor)?;
        let way = |p: &SurfacePoint| -model.scene.placement.to_world(p.position);
        let exact = |p: &SurfacePoint| {
            BRIGHT * square(way(p)) * way(p).dot(p.normal.as_dvec3()) / way(p).length().powi(3)
        };
        // Edge-on the disc is dark: those points would ask 2 % of nothing.
        let points: Vec<SurfacePoint> =
            on(&model, 0, 1200).into_iter().filter(|p| square(way(p)) > 0.1e-6).collect();
        let answers = model.field().evaluate(&points);
        let ratio = |k: usize| f64::from(mean_channel(answers[k].direct)) / exact(&points[k]);
        let rays = |p: &SurfacePoint| BRIGHT * share_of_rays(&model, p, 1) / exact(p);
        let what = format!("direct light of a {name}, worst point");
        ours.push(Measured::share(what.clone(), worst((0..points.len()).map(ratio)), DIRECT));
        textbook.push(Measured::share(what, worst(points.iter().map(rays)), DIRECT));
    }
    Ok((textbook, ours))
}

/// The share of 256 cosine-weighted rays that meet a mesh.
fn share_of_rays(model: &Model, point: &SurfacePoint, mesh: usize) -> f64 {
    let (s, t) = tangent_frame(point.normal);
    let shift = hash::unit_pair(3, u64::from(point.position.x.to_bits()));
    let meets = |i: &u32| {
        let way = hemisphere::cosine_hemisphere(hemisphere::fibonacci(*i, 256, shift));
        let ray = Ray::new(point.lifted(), s * way.x + t * way.y + point.normal * way.z);
        model.bvh.closest(&ray).is_some_and(|hit| model.scene.mesh_of(hit.triangle) == mesh)
    };
    (0..256).filter(meets).count() as f64 / 256.0
}

/// A triangle of 10⁻⁵ of the room, alone in the air.
fn speck() -> Part {
    let corners = [DVec3::ZERO, DVec3::X * 1e-5, DVec3::Y * 1e-5];
    let shape = Shape { vertices: corners.to_vec(), triangles: vec![[0, 1, 2]] };
    part("speck", shape.translated(DVec3::new(0.4, 0.55, 0.6)), 0.5).exitance(1.0).two_sided()
}

/// The irradiance of a speck in a furnace is the furnace's, on both of its sides, within the target.
///
/// Seen to fail: on interpolation by distance, where no site is within reach of the speck: NaN.
pub fn speck_in_the_air(monitor: &dyn Monitor) -> Result<Numbers> {
    const TARGET: f64 = 0.03;
    let room = part("room", cuboid(DVec3::ZERO, DVec3::ONE, 2).flipped(), 0.5).exitance(1.0);
    let (model, _) = planned(known::scene(&[room.clone(), speck()]), TARGET, monitor)?;
    let front = on(&model, 1, 16);
    let back = front.iter().map(|p| SurfacePoint { normal: -p.normal, ..*p });
    let sides: Vec<SurfacePoint> = front.iter().copied().chain(back).collect();
    let off = worst(light(&model, &sides).iter().map(|h| h / 2.0));
    let (bare, _) = planned(known::scene(&[room]), TARGET, monitor)?;
    let sites = interpolation::at_sites(&bare);
    let local = |p: &SurfacePoint| SurfacePoint {
        position: bare.scene.placement.to_local(model.scene.placement.to_world(p.position)),
        ..*p
    };
    let blind = worst(sides.iter().map(|p| interpolation::blind(&bare, &sites, &local(p)) / 2.0));
    let name = "irradiance, worst of both sides";
    Ok((vec![Measured::share(name, blind, TARGET)], vec![Measured::share(name, off, TARGET)]))
}
