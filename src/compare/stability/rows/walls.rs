//! Rows 5 and 6: no light through a thin wall, nor along a floor that runs under it.

use glam::DVec3;

use super::Numbers;
use crate::bake::Monitor;
use crate::bake::model::Model;
use crate::compare::known::{self, Part, Shape, box_faces, cuboid, part, points_on, quad};
use crate::compare::stability::Measured;
use crate::compare::stability::bakes::{light, mean, planned};
use crate::compare::textbook::interpolation;
use crate::error::Result;
use crate::geometry::SurfacePoint;
use crate::scene::Scene;

/// What may reach the dark side, of the mean of the lit one.
const LEAK: f64 = 1e-3;

/// How the lit room is lit.
#[derive(Debug, Clone, Copy)]
enum Light {
    /// A small emitter, aimed at by the sites.
    Lamp,
    /// A whole glowing wall, met by the rows.
    Glow,
}

/// Two unit rooms in one box of single polygons, x from 0 to 2; the wall stands at x = 1 with its lit face there.
///
/// A wall of no thickness is one two-sided polygon, any other a block whose faces touch floor, ceiling and walls.
fn rooms(thickness: f64, light: Light) -> Scene {
    let shell = box_faces(DVec3::ZERO, DVec3::new(2.0, 1.0, 1.0), 1).map(Shape::flipped);
    let mut parts: Vec<Part> = shell.map(|face| part("shell", face, 0.7)).into();
    parts.push(if thickness == 0.0 {
        part("wall", quad(DVec3::X, DVec3::Y, DVec3::Z, 1), 0.7).two_sided()
    } else {
        part("wall", cuboid(DVec3::X, DVec3::new(1.0 + thickness, 1.0, 1.0), 1), 0.7)
    });
    match light {
        Light::Glow => parts[0] = parts[0].clone().exitance(1.0),
        Light::Lamp => {
            let lamp = quad(DVec3::new(0.4, 0.4, 0.99), DVec3::Y * 0.2, DVec3::X * 0.2, 1);
            parts.push(part("lamp", lamp, 0.0).exitance(25.0));
        }
    }
    known::scene(&parts)
}

/// Spacing of the sites, world units: the square root of the median of their areas.
fn spacing(model: &Model) -> f64 {
    let mut areas = model.sites.areas.clone();
    areas.sort_by(f32::total_cmp);
    f64::from(areas[areas.len() / 2]).sqrt() * model.scene.placement.scale
}

/// Points of some faces on the lit side and on the dark one.
fn sides(model: &Model, faces: &[usize], thickness: f64) -> [Vec<SurfacePoint>; 2] {
    let all = || faces.iter().flat_map(|&mesh| points_on(&model.scene, mesh, 3000, 5));
    let x = |p: &SurfacePoint| model.scene.placement.to_world(p.position).x;
    [all().filter(|p| x(p) < 1.0).collect(), all().filter(|p| x(p) > 1.0 + thickness).collect()]
}

/// The largest value.
fn most(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |most, &v| if v.is_nan() { v } else { most.max(v) })
}

/// Mean of the dark side, and its worst point, over the mean of the lit one, by the program and by the textbook.
fn leaks(model: &Model, faces: &[usize], thickness: f64) -> [[f64; 2]; 2] {
    let sides = sides(model, faces, thickness);
    let sites = interpolation::at_sites(model);
    let blind = |points: &[SurfacePoint]| -> Vec<f64> {
        // Every tenth will do: each asks all sites. Where none is within reach there is no leak either.
        let values = points.iter().step_by(10).map(|p| interpolation::blind(model, &sites, p));
        values.filter(|v| !v.is_nan()).collect()
    };
    let told = |[lit, dark]: [Vec<f64>; 2]| [mean(&dark), most(&dark)].map(|v| v / mean(&lit));
    [told([0, 1].map(|k| light(model, &sides[k]))), told([0, 1].map(|k| blind(&sides[k])))]
}

fn measure(numbers: &mut Numbers, (name, model): (&str, &Model), faces: &[usize], thickness: f64) {
    let [[mean, worst], [blind, _]] = leaks(model, faces, thickness);
    numbers.0.push(Measured::share(name, blind, LEAK));
    numbers.1.push(Measured::share(name, mean, LEAK));
    // So that no bright fringe hides in the mean.
    numbers.1.push(Measured::share(format!("{name}, worst point"), worst, 10.0 * LEAK));
}

/// Under 1e-3 of the lit side's light in the dark room, its wall 0, h/100 and h/10 thick.
///
/// No ray passes the wall: the true answer is nought. Seen to fail: on interpolation by distance.
pub fn thin(monitor: &dyn Monitor) -> Result<Numbers> {
    let mut numbers = (Vec::new(), Vec::new());
    for (light, lit) in [(Light::Glow, "glowing wall"), (Light::Lamp, "lamp")] {
        let (sheet, _) = planned(rooms(0.0, light), 0.03, monitor)?;
        measure(&mut numbers, (&format!("{lit}, thickness 0"), &sheet), &[0, 1, 2, 3, 4, 5], 0.0);
        for (share, thick) in [(0.01, "h/100"), (0.1, "h/10")] {
            let thickness = share * spacing(&sheet);
            let (model, _) = planned(rooms(thickness, light), 0.03, monitor)?;
            let name = format!("{lit}, thickness {thick}");
            measure(&mut numbers, (&name, &model), &[0, 1, 2, 3, 4, 5], thickness);
        }
    }
    Ok(numbers)
}

/// The same on the one polygon that is the floor of both rooms, alone.
///
/// Seen to fail: on interpolation by distance.
pub fn common_floor(monitor: &dyn Monitor) -> Result<Numbers> {
    let mut numbers = (Vec::new(), Vec::new());
    for (light, lit) in [(Light::Glow, "glowing wall"), (Light::Lamp, "lamp")] {
        let (model, _) = planned(rooms(0.0, light), 0.03, monitor)?;
        measure(&mut numbers, (lit, &model), &[4], 0.0);
    }
    Ok(numbers)
}
