//! Refinement: receivers split where leaving one out would be missed make interpolation better, and for the same price.

mod shapes;

use glam::DVec3;
use glowtree::bake::Silent;
use glowtree::bake::laws::Plan;
use glowtree::bake::model::Model;
use glowtree::bake::pipeline::build;
use glowtree::geometry::{SurfacePoint, hash};
use glowtree::light::mean_channel;
use glowtree::links::rows::Rows;
use glowtree::scene::Scene;
use glowtree::sites::SiteId;
use shapes::part;

/// A block on the floor of a room and a slab that hovers beside it: corners, contact and a gap, away from which light is
/// smooth.
fn scene() -> Scene {
    let room = shapes::cuboid(DVec3::ZERO, DVec3::ONE, 1).flipped();
    let block = shapes::cuboid(DVec3::new(0.2, 0.25, 0.0), DVec3::new(0.45, 0.55, 0.4), 1);
    let slab = shapes::cuboid(DVec3::new(0.55, 0.3, 0.04), DVec3::new(0.85, 0.7, 0.1), 1);
    let lamp = shapes::quad(DVec3::new(0.4, 0.4, 0.98), DVec3::Y * 0.2, DVec3::X * 0.2, 1);
    shapes::scene(&[
        part("room", room, 0.7),
        part("block", block, 0.5),
        part("slab", slab, 0.5),
        part("lamp", lamp, 0.0).exitance(20.0),
    ])
}

fn baked(passes: usize) -> Model {
    let mut plan = Plan::new(0.02, 3);
    (plan.passes, plan.own_passes) = (passes, 0);
    // Points must not gather for themselves: interpolation is what is measured.
    plan.doubt = f32::INFINITY;
    plan.judges = 10;
    // A budget that asks for splits.
    plan.interpolation = 0.003;
    build(scene(), &plan, None, &Silent).expect("nothing interrupts").0
}

/// Root mean square of interpolated less gathered irradiance by area, over the mean.
fn interpolation_error(model: &Model, points: &[(SurfacePoint, f64)]) -> f64 {
    let field = model.field();
    let (mut square, mut mean, mut total) = (0.0, 0.0, 0.0);
    for (k, (point, area)) in points.iter().enumerate() {
        let got = field.evaluate(std::slice::from_ref(point))[0];
        let row = Rows::single(model.around(), point, hash::mix2(41, k as u64), 1024);
        let want = mean_channel(field.row_light(&row, point));
        square += area * f64::from(mean_channel(got.indirect) - want).powi(2);
        mean += area * f64::from(want);
        total += area;
    }
    (square / total).sqrt() / (mean / total)
}

#[test]
fn splitting_lowers_the_error_of_interpolation() {
    let (coarse, fine) = (baked(0), baked(8));
    let point = |s: usize| (coarse.sites.point(SiteId(s as u32)), f64::from(coarse.sites.areas[s]));
    let points: Vec<(SurfacePoint, f64)> = (0..coarse.sites.len()).step_by(5).map(point).collect();
    assert!(points.len() > 400, "{} points", points.len());
    let (before, after) = (interpolation_error(&coarse, &points), interpolation_error(&fine, &points));
    let (few, many) = (coarse.receivers.len() as f64, fine.receivers.len() as f64);
    println!("{few} receivers {:.2} %, {many} receivers {:.2} %", 100.0 * before, 100.0 * after);
    assert!(many > few && many < 4.5 * few, "{few} receivers became {many}");
    // Spread evenly, a linear fit's error falls as 1/receivers; splitting where it matters must do better than that.
    assert!(after < before * few / many, "{before} with {few} became {after} with {many}");
}

#[test]
fn nothing_is_split_where_light_is_uniform() {
    let furnace = || {
        let cube = shapes::cuboid(DVec3::ZERO, DVec3::ONE, 2).flipped();
        shapes::scene(&[part("cube", cube, 0.5).exitance(1.0)])
    };
    let counts = [0, 8].map(|passes| {
        let mut plan = Plan::new(0.05, 1);
        plan.passes = passes;
        build(furnace(), &plan, None, &Silent).expect("nothing interrupts").0.receivers.len()
    });
    assert_eq!(counts[0], counts[1]);
}
