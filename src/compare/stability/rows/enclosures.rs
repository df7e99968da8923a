//! Rows 2, 3 and 14: furnaces, the cost of high albedos, and the balance of an open scene.

use glam::DVec3;

use super::Numbers;
use crate::bake::Monitor;
use crate::bake::model::Model;
use crate::compare::known::{self, Part, Shape, answers, box_faces, cuboid, icosphere, part};
use crate::compare::stability::Measured;
use crate::compare::stability::bakes::{light, mean, on, over, planned, worst};
use crate::compare::textbook::points;
use crate::error::Result;
use crate::geometry::hash;
use crate::light::Rgb;
use crate::solve::iterate::{IterateParams, solve};
use crate::solve::transport::Transport;

/// What is asked of B in a furnace, at the worst of all points.
const FURNACE: f64 = 1e-3;

/// Radius 1 and waves of four sizes on it, as a scan of a hollow has: closed, 20,480 triangles, seen whole from its middle.
fn cave() -> Shape {
    let wave = |v: DVec3, size: f64| (size * v.x).sin() * (size * v.y + 1.0).sin() * (size * v.z + 2.0).cos();
    let height = |v: DVec3| (0..4).map(|k| 0.12 * 0.5f64.powi(k) * wave(v, 4.0 * 2f64.powi(k))).sum::<f64>();
    icosphere(1.0, 5).mapped(|v| v * (1.0 + height(v))).flipped()
}

/// B within 0.1 % of E₀/(1 − ρ) at the worst of 4,000 points of a cube, a sphere and a cave, up to ρ = 0.999.
///
/// A point of a furnace can only err by light that is lost: a share ε lowers B by ερ/(1 − ρ).
/// Seen to fail: on the textbook scheme, whose rows do not sum to one.
pub fn furnace(monitor: &dyn Monitor) -> Result<Numbers> {
    let (mut textbook, mut ours) = (Vec::new(), Vec::new());
    let cube = cuboid(DVec3::ZERO, DVec3::ONE, 2).flipped();
    let coarse = [cuboid(DVec3::ZERO, DVec3::ONE, 6).flipped(), icosphere(1.0, 3).flipped()];
    let shapes = [("cube", cube), ("sphere", icosphere(1.0, 4).flipped()), ("cave", cave())];
    for albedo in [0.5f32, 0.9, 0.99, 0.999] {
        let want = answers::furnace(1.0, f64::from(albedo));
        for (name, shape) in &shapes {
            let walls = part("walls", shape.clone(), albedo).exitance(1.0);
            let (model, report) = planned(known::scene(&[walls]), 0.03, monitor)?;
            let off = worst(over(&model, 0, 4000).iter().map(|h| (1.0 + f64::from(albedo) * h) / want));
            let off = if report.iterate.converged { off } else { f64::INFINITY };
            ours.push(Measured::share(format!("{name}, albedo {albedo}"), off, FURNACE));
        }
        for (name, shape) in ["cube", "sphere"].iter().zip(&coarse) {
            let walls = part("walls", shape.clone(), albedo).exitance(1.0);
            let light = points::irradiance(&points::of_parts(&[walls]));
            let off = light.map_or(f64::INFINITY, |light| {
                worst(light.iter().map(|h| (1.0 + f64::from(albedo) * h) / want))
            });
            textbook.push(Measured::share(format!("{name}, albedo {albedo}"), off, FURNACE));
        }
    }
    Ok((textbook, ours))
}

/// Products for 1e-6 by conjugate gradients' bound, by albedo.
const BOUNDS: [(f32, usize); 6] = [(0.5, 13), (0.8, 22), (0.9, 32), (0.95, 45), (0.99, 102), (0.999, 324)];

/// A closed room with two blocks; one wall glows.
fn room() -> Vec<Part> {
    let faces = box_faces(DVec3::ZERO, DVec3::ONE, 1).map(Shape::flipped);
    let mut parts: Vec<Part> = faces.map(|face| part("shell", face, 0.7)).into();
    parts[0] = parts[0].clone().exitance(1.0);
    let block = |from, to| part("block", cuboid(from, to, 1), 0.7);
    parts.push(block(DVec3::new(0.2, 0.5, 0.0), DVec3::new(0.4, 0.8, 0.6)));
    parts.push(block(DVec3::new(0.5, 0.1, 0.0), DVec3::new(0.9, 0.4, 0.3)));
    parts
}

/// Products with the operator for a residual of 1e-6 within 1.5 times the bound, for three lights at once.
///
/// Seen to fail: on Neumann's series.
pub fn products(monitor: &dyn Monitor) -> Result<Numbers> {
    let (model, _) = planned(known::scene(&room()), 0.1, monitor)?;
    let (mut textbook, mut ours) = (Vec::new(), Vec::new());
    for (albedo, bound) in BOUNDS {
        let (name, limit) = (format!("albedo {albedo}"), 1.5 * bound as f64);
        // A low albedo in the parameters alone selects Neumann's series.
        let [neumann, accelerated] = [0.0, albedo].map(|told| count(&model, albedo, told));
        textbook.push(Measured::plain(name.clone(), neumann, limit));
        ours.push(Measured::plain(name, accelerated, limit));
    }
    Ok((textbook, ours))
}

/// Products until the residual is 1e-6 for a lit wall, sparks here and there, and a slow wave; infinite if it never is.
fn count(model: &Model, albedo: f32, told: f32) -> f64 {
    let spark = |s: usize| if hash::mix2(4, s as u64).is_multiple_of(50) { 3.0 } else { 0.0 };
    let wave = |s: usize| 1.0 + (5.0 * model.sites.positions[s].x).sin();
    let own: Vec<Rgb> =
        (0..model.sites.len()).map(|s| Rgb::new(model.exitance[s].x, spark(s), wave(s))).collect();
    let albedos = vec![Rgb::splat(albedo); own.len()];
    let transport = Transport { receivers: &model.receivers, spread: &model.spread, albedo: &albedos };
    let params = IterateParams { tolerance: 1e-6, most: 20_000, bounces: None, largest_albedo: told };
    let (_, report) = solve(|x| transport.apply(x), &transport.gather(&own), &params);
    if report.converged { report.iterations as f64 } else { f64::INFINITY }
}

/// A box without its ceiling, the floor glows.
fn open_box(albedo: f32, n: u32) -> Vec<Part> {
    let faces = box_faces(DVec3::ZERO, DVec3::ONE, n).map(Shape::flipped);
    let mut parts: Vec<Part> = faces.into_iter().take(5).map(|face| part("shell", face, albedo)).collect();
    parts[4] = parts[4].clone().exitance(1.0);
    parts
}

/// The share of light that leaves a point through the opening, by Lambert's formula.
fn escapes(position: DVec3, normal: DVec3) -> f64 {
    let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| DVec3::new(x, y, 1.0));
    let above: Vec<DVec3> = if normal.z > 0.5 {
        corners.into()
    } else {
        // A wall's plane holds one edge of the opening; the rest lies above it.
        corners.iter().map(|c| *c + normal * 1e-12).collect()
    };
    answers::point_to_polygon(position, normal, &above).abs()
}

/// What is emitted is absorbed or escapes, to 1e-3 of it.
///
/// Every face has area 1, so that means over faces add up: Σ⟨E₀⟩ = Σ(1 − ρ)⟨H⟩ + Σ⟨B·F⟩, F the form factor to the opening in
/// closed form, nothing of the program's own. Means over hundreds of rows of 0.7 % noise: 4e-4.
/// Seen to fail: on the textbook scheme.
pub fn open(monitor: &dyn Monitor) -> Result<Numbers> {
    let (mut textbook, mut ours) = (Vec::new(), Vec::new());
    for albedo in [0.3f32, 0.8] {
        let (name, kept) = (format!("albedo {albedo}"), f64::from(1.0 - albedo));
        let (model, _) = planned(known::scene(&open_box(albedo, 8)), 0.005, monitor)?;
        let mut spent = 0.0;
        for face in 0..5 {
            let points = on(&model, face, 8192);
            let own = if face == 4 { 1.0 } else { 0.0 };
            let fate = light(&model, &points).into_iter().zip(&points).map(|(light, p)| {
                let place = model.scene.placement.to_world(p.position);
                let away = escapes(place, p.normal.as_dvec3());
                light * kept + (own + f64::from(albedo) * light) * away
            });
            spent += mean(&fate.collect::<Vec<_>>());
        }
        ours.push(Measured::share(name.clone(), (spent - 1.0).abs(), 1e-3));
        textbook.push(Measured::share(name, (balance(albedo) - 1.0).abs(), 1e-3));
    }
    Ok((textbook, ours))
}

/// What is absorbed and escapes of 1 emitted, by the textbook's matrix.
fn balance(albedo: f32) -> f64 {
    let all = points::of_parts(&open_box(albedo, 8));
    let Some(light) = points::irradiance(&all) else { return f64::INFINITY };
    let fate = |(k, p): (usize, &points::Point)| {
        let away = escapes(p.position, p.normal);
        p.area * ((1.0 - p.albedo) * light[k] + (p.exitance + p.albedo * light[k]) * away)
    };
    all.iter().enumerate().map(fate).sum()
}
