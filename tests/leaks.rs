//! No light through walls: a lit and a dark room with a thin wall between them, on floors that run under both.

mod shapes;

use glam::DVec3;
use glowtree::bake::Silent;
use glowtree::bake::laws::Plan;
use glowtree::bake::model::Model;
use glowtree::bake::pipeline::build;
use glowtree::light::mean_channel;
use glowtree::scene::Scene;
use shapes::{Part, part};

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
    let shell = shapes::box_faces(DVec3::ZERO, DVec3::new(2.0, 1.0, 1.0), 1).map(shapes::Shape::flipped);
    let mut parts: Vec<Part> = shell.map(|face| part("shell", face, 0.7)).into();
    let wall = if thickness == 0.0 {
        part("wall", shapes::quad(DVec3::X, DVec3::Y, DVec3::Z, 1), 0.7).two_sided()
    } else {
        part("wall", shapes::cuboid(DVec3::X, DVec3::new(1.0 + thickness, 1.0, 1.0), 1), 0.7)
    };
    parts.push(wall);
    match light {
        Light::Glow => parts[0] = parts[0].clone().exitance(1.0),
        Light::Lamp => {
            let lamp = shapes::quad(DVec3::new(0.4, 0.4, 0.99), DVec3::Y * 0.2, DVec3::X * 0.2, 1);
            parts.push(part("lamp", lamp, 0.0).exitance(25.0));
        }
    }
    shapes::scene(&parts)
}

fn bake(thickness: f64, light: Light) -> Model {
    build(rooms(thickness, light), &Plan::new(0.03, 1), None, &Silent).expect("nothing interrupts").0
}

/// Spacing of the sites, world units: the square root of the median of their areas.
fn spacing(model: &Model) -> f64 {
    let mut areas = model.sites.areas.clone();
    areas.sort_by(f32::total_cmp);
    f64::from(areas[areas.len() / 2]).sqrt() * model.scene.placement.scale
}

/// Mean irradiance of the lit room, mean and largest of the dark one, over floor, ceiling, side walls and the far wall.
fn sides(model: &Model, thickness: f64) -> (f64, f64, f64) {
    let (mut lit, mut dark) = (Vec::new(), Vec::new());
    for mesh in 0..6 {
        let points = shapes::points_on(&model.scene, mesh, 4000, 5);
        let answers = model.field().evaluate(&points);
        for (point, answer) in points.iter().zip(&answers) {
            let x = model.scene.placement.to_world(point.position).x;
            let light = f64::from(mean_channel(answer.total()));
            if x < 1.0 {
                lit.push(light);
            } else if x > 1.0 + thickness {
                dark.push(light);
            }
        }
    }
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    (mean(&lit), mean(&dark), dark.iter().copied().fold(0.0, f64::max))
}

/// No ray passes the wall, so that the true answer is nought. Asked: 1e-3 of the lit side, in the mean and, so that no
/// bright fringe hides in it, ten times that at the worst of 14,000 points.
fn stays_dark(thickness: f64, light: Light, model: &Model) {
    let (lit, dark, worst) = sides(model, thickness);
    println!(
        "{light:?}, thickness {thickness:.5}: lit {lit:.4}, dark {:.2e}, worst {:.2e}",
        dark / lit,
        worst / lit
    );
    assert!(lit > 0.1, "{light:?}: the lit room has {lit}");
    assert!(dark < 1e-3 * lit, "{light:?}, thickness {thickness}: {dark} leaks of {lit}");
    assert!(worst < 1e-2 * lit, "{light:?}, thickness {thickness}: {worst} at one point, of {lit}");
}

fn walls(light: Light) {
    let sheet = bake(0.0, light);
    stays_dark(0.0, light, &sheet);
    let spacing = spacing(&sheet);
    println!("sites are {spacing:.4} apart");
    for share in [0.01, 0.1] {
        stays_dark(share * spacing, light, &bake(share * spacing, light));
    }
}

#[test]
fn a_glowing_wall_stays_on_its_side() {
    walls(Light::Glow);
}

#[test]
fn a_lamp_stays_on_its_side() {
    walls(Light::Lamp);
}

#[test]
fn the_far_side_of_the_wall_is_dark_too() {
    // A point of the sheet's own back: the site under it is millimetres from lit ones with the opposite normal.
    let model = bake(0.0, Light::Glow);
    let mut points = shapes::points_on(&model.scene, 6, 2000, 5);
    // Points lie on the front, whose normal is Y × Z = X: the dark side.
    assert!(points[0].normal.x > 0.9);
    let mean = |points: &[glowtree::geometry::SurfacePoint]| {
        let answers = model.field().evaluate(points);
        answers.iter().map(|a| f64::from(mean_channel(a.total()))).sum::<f64>() / points.len() as f64
    };
    let dark = mean(&points);
    points.iter_mut().for_each(|p| p.normal = -p.normal);
    let lit = mean(&points);
    println!("sheet: lit {lit:.4}, dark {:.2e}", dark / lit);
    assert!(lit > 0.1 && dark < 1e-3 * lit, "dark {dark}, lit {lit}");
}

/// A block that hovers a five-hundredth of its width above a two-sided sheet, under a white sky. The sheet's other side, as
/// near to the block's bottom and turned alike, sees all of the sky.
#[test]
fn light_from_under_the_ground_stays_there() {
    const GAP: f64 = 2e-3;
    let ground = shapes::quad(DVec3::new(-2.0, -2.0, 0.0), DVec3::X * 4.0, DVec3::Y * 4.0, 1);
    let block = shapes::cuboid(DVec3::new(-0.5, -0.5, GAP), DVec3::new(0.5, 0.5, 0.5), 8);
    let scene = shapes::scene(&[part("block", block, 0.5), part("ground", ground, 0.5).two_sided()]);
    let plan = Plan::new(0.05, 1);
    let model = build(shapes::under_sky(scene, 1.0), &plan, None, &Silent).expect("nothing interrupts").0;
    let below: Vec<_> = shapes::points_on(&model.scene, 0, 20_000, 3)
        .into_iter()
        .filter(|p| {
            let world = model.scene.placement.to_world(p.position);
            p.normal.z < -0.9 && world.x.abs().max(world.y.abs()) < 0.3
        })
        .collect();
    assert!(below.len() > 500, "{} points", below.len());
    let answers = model.field().evaluate(&below);
    let worst = answers.iter().map(|a| f64::from(mean_channel(a.total()))).fold(0.0, f64::max);
    // From 0.2 inside, sky is seen below an elevation of g/0.2 = 0.01: of π, 0.01² at the most, from four sides 4e-4. The
    // ground below gets as little, and what is passed on inwards is halved within each gap's width. A hundredth is allowed.
    println!("under the block: {:.2e} of the open sky at the most", worst / std::f64::consts::PI);
    assert!(worst < 0.01 * std::f64::consts::PI, "{worst} under the block");
}
