//! Rows 9, 11, 15 and 16: the same scene at other targets, places, tessellations, orders, turns and seeds.

use glam::{DQuat, DVec3};

use super::Numbers;
use crate::bake::Monitor;
use crate::bake::model::Model;
use crate::compare::known::{self, Part, Shape, box_faces, cuboid, part, points_on, quad};
use crate::compare::stability::Measured;
use crate::compare::stability::bakes::{SEED, apart, asked, light, mean, planned, traced};
use crate::compare::textbook::{interpolation, points};
use crate::error::Result;
use crate::geometry::SurfacePoint;
use crate::scene::Scene;

/// A room with two blocks and a lamp under the ceiling, n × n quads a face.
fn room(n: u32) -> Vec<Part> {
    let walls = cuboid(DVec3::ZERO, DVec3::ONE, n).flipped();
    let low = cuboid(DVec3::new(0.15, 0.2, 0.0), DVec3::new(0.4, 0.5, 0.35), n);
    let high = cuboid(DVec3::new(0.6, 0.5, 0.0), DVec3::new(0.8, 0.75, 0.6), n);
    let lamp = quad(DVec3::new(0.4, 0.35, 0.98), DVec3::Y * 0.25, DVec3::X * 0.25, n);
    vec![
        part("walls", walls, 0.7),
        part("low", low, 0.5),
        part("high", high, 0.5),
        part("lamp", lamp, 0.0).exitance(10.0),
    ]
}

/// Points of everything but the lamp.
fn asked_at(scene: &Scene, count: usize) -> Vec<SurfacePoint> {
    let share = [(0, count * 6 / 10), (1, count * 2 / 10), (2, count * 2 / 10)];
    share.iter().flat_map(|&(mesh, n)| points_on(scene, mesh, n, 29)).collect()
}

/// Targets of the sweep, two decades.
const TARGETS: [f64; 7] = [0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002];

/// The true error falls at every step of a sweep of the target over two decades, or the report says that it was missed.
///
/// The truth is path-traced; its noise, measured by itself, is taken out of the errors.
/// Seen to fail: Shepard's interpolation keeps its error from 8² to 32² sites.
pub fn sweep(monitor: &dyn Monitor) -> Result<Numbers> {
    let scene = known::scene(&room(1));
    let all = asked_at(&scene, 1000);
    let (truth, noise) = traced(&scene, &all, 4096);
    let level = mean(&truth);
    let mut steps = Vec::new();
    for target in TARGETS {
        let (model, report) = asked(&scene, target, SEED, monitor)?;
        let square = apart(&light(&model, &all), &truth).powi(2) - noise / level.powi(2);
        steps.push((target, square.max(0.0).sqrt(), report.estimate.error > target));
    }
    let step = |pair: &[(f64, f64, bool)]| {
        let ((from, larger, _), (to, smaller, told)) = (pair[0], pair[1]);
        let name = format!(
            "{} % to {} %: error {:.2} % to {:.2} %",
            100.0 * from,
            100.0 * to,
            100.0 * larger,
            100.0 * smaller
        );
        let (name, limit) = if told { (name + ", told", f64::INFINITY) } else { (name, 1.0) };
        Measured::plain(name, smaller / larger, limit)
    };
    let shepard = [8, 16, 32].map(interpolation::shepard_error);
    let textbook =
        shepard.windows(2).map(|w| Measured::plain("error over that at twice the spacing", w[1] / w[0], 0.9));
    Ok((textbook.collect(), steps.windows(2).map(step).collect()))
}

/// What a map of world space makes of the parts.
fn mapped(parts: &[Part], map: impl Fn(DVec3) -> DVec3) -> Vec<Part> {
    parts.iter().map(|p| Part { shape: p.shape.clone().mapped(&map), ..p.clone() }).collect()
}

/// RMS difference of a model's light at the images of a base model's points.
fn differs(base: &Model, other: &Model, map: impl Fn(DVec3) -> DVec3, turn: DQuat) -> f64 {
    let all = asked_at(&base.scene, 2000);
    let image = |p: &SurfacePoint| SurfacePoint {
        position: other.scene.placement.to_local(map(base.scene.placement.to_world(p.position))),
        normal: (turn * p.normal.as_dvec3()).as_vec3(),
    };
    apart(&light(other, &all.iter().map(image).collect::<Vec<_>>()), &light(base, &all))
}

/// What two bakes of the same room at other places may differ by.
const SAME: f64 = 1e-4;

/// Scales and offsets of the georeferenced scenes.
const PLACES: [(f64, f64); 4] = [(1e-4, 0.0), (1e3, 0.0), (1e6, 0.0), (1.0, 1e6)];

/// The light of the same room at scales from 10⁻⁴ to 10⁶, and a million units away, is the same to 10⁻⁴.
///
/// Coordinates are f64 until they are local. Seen to fail: with world coordinates rounded to f32 first.
pub fn placed(monitor: &dyn Monitor) -> Result<Numbers> {
    let (mut textbook, mut ours) = (Vec::new(), Vec::new());
    let parts = room(1);
    let (base, _) = planned(known::scene(&parts), 0.05, monitor)?;
    for (scale, offset) in PLACES {
        let map = |v: DVec3| v * scale + DVec3::splat(offset);
        let name = format!("scale {scale:e}, offset {offset:e}");
        let there = mapped(&parts, map);
        let (model, _) = planned(known::scene(&there), 0.05, monitor)?;
        ours.push(Measured::share(name.clone(), differs(&base, &model, map, DQuat::IDENTITY), SAME));
        // The bakes themselves: asked at the same local coordinates, before any point is rounded on its way there.
        let all = asked_at(&base.scene, 2000);
        let bakes = apart(&light(&model, &all), &light(&base, &all));
        ours.push(Measured::share(format!("{name}, local points"), bakes, SAME));
        let rounded = mapped(&there, |v| v.as_vec3().as_dvec3());
        let (model, _) = planned(known::scene(&rounded), 0.05, monitor)?;
        textbook.push(Measured::share(name, differs(&base, &model, map, DQuat::IDENTITY), SAME));
    }
    Ok((textbook, ours))
}

/// The target of the variants; two bakes may differ by it.
const TARGET: f64 = 0.02;

/// Eleven times the triangles, the same light within the target.
///
/// Seen to fail: on one value a triangle.
pub fn retessellated(monitor: &dyn Monitor) -> Result<Numbers> {
    let (few, _) = asked(&known::scene(&room(3)), TARGET, SEED, monitor)?;
    let (many, _) = asked(&known::scene(&room(10)), TARGET, SEED, monitor)?;
    let ours = differs(&few, &many, |v| v, DQuat::IDENTITY);
    let name = "RMS difference of 11 × the triangles";
    let [coarse, fine] = [3, 10].map(flat_values);
    let textbook = apart(&coarse, &fine);
    Ok((vec![Measured::share(name, textbook, TARGET)], vec![Measured::share(name, ours, TARGET)]))
}

/// Irradiance at 2,000 points of an empty cube with a glowing ceiling, constant on each of its triangles.
fn flat_values(n: u32) -> Vec<f64> {
    let faces = box_faces(DVec3::ZERO, DVec3::ONE, n).map(Shape::flipped);
    let mut parts = faces.map(|face| part("face", face, 0.5));
    parts[5] = parts[5].clone().exitance(1.0);
    let all = points::of_parts(&parts);
    let Some(values) = points::irradiance(&all) else { return vec![f64::NAN; 1] };
    // The same points for every n: those of the coarsest cube.
    let cube = known::scene(&[part("cube", cuboid(DVec3::ZERO, DVec3::ONE, 1).flipped(), 0.5)]);
    let nearest = |p: &SurfacePoint| {
        let at = cube.placement.to_world(p.position);
        let turned = |k: &usize| all[*k].normal.dot(p.normal.as_dvec3()) > 0.9;
        let distance = |k: &usize| all[*k].position.distance_squared(at);
        let best = (0..all.len()).filter(turned).min_by(|a, b| distance(a).total_cmp(&distance(b)));
        best.map_or(f64::NAN, |k| values[k])
    };
    points_on(&cube, 0, 2000, 29).iter().map(nearest).collect()
}

/// Triangles in another order, the scene turned, another seed: the same light within the target.
///
/// Of two bakes each errs by at most the target, independently; what is asked is stricter than √2 of it.
/// Seen to fail: between bakes at a target of 20 % (`tests/stability.rs` keeps that).
pub fn reordered(monitor: &dyn Monitor) -> Result<Numbers> {
    let parts = room(3);
    let (base, _) = asked(&known::scene(&parts), TARGET, SEED, monitor)?;
    let shuffled: Vec<Part> = parts.iter().map(|p| Part { shape: shuffled(&p.shape), ..p.clone() }).collect();
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.6);
    let rotated = mapped(&parts, |v| turn * v);
    let (shuffled, _) = asked(&known::scene(&shuffled), TARGET, SEED, monitor)?;
    let (rotated, _) = asked(&known::scene(&rotated), TARGET, SEED, monitor)?;
    let (seeded, _) = asked(&known::scene(&parts), TARGET, SEED + 1, monitor)?;
    let same = |v: DVec3| v;
    let ours = [
        ("triangles in another order", differs(&base, &shuffled, same, DQuat::IDENTITY)),
        ("scene turned", differs(&base, &rotated, |v| turn * v, turn)),
        ("another seed", differs(&base, &seeded, same, DQuat::IDENTITY)),
    ];
    Ok((Vec::new(), ours.map(|(name, value)| Measured::share(name, value, TARGET)).into()))
}

/// The triangles in a stride through their order, each begun at another corner.
fn shuffled(shape: &Shape) -> Shape {
    let count = shape.triangles.len();
    // Counts are 12 n²; 7 divides none of those used.
    let triangle = |k: usize| {
        let [a, b, c] = shape.triangles[(7 * k + 3) % count];
        [b, c, a]
    };
    Shape { vertices: shape.vertices.clone(), triangles: (0..count).map(triangle).collect() }
}
