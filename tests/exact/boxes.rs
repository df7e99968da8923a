//! Flat closed rooms: the cube's solved face means, the tetrahedron, the balance of energy, a lamp in a room.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};
use glowtree::bake::model::Model;
use glowtree::geometry::SurfacePoint;
use glowtree::light::{Rgb, mean_channel};
use glowtree::solve::iterate::IterateParams;
use glowtree::solve::transport::Transport;

use crate::closed_forms as exact;
use crate::shapes::{self, Part, part};
use crate::solved::{irradiance, solve, within};

/// A unit cube seen from inside whose ceiling, the last part, emits 1.
fn cube(albedo: f64, ceiling: f64) -> Model {
    let faces = shapes::box_faces(DVec3::ZERO, DVec3::ONE, 16).map(shapes::Shape::flipped);
    let mut parts = Vec::from(faces.map(|face| part("face", face, albedo as f32)));
    parts[5] = Part { albedo: Rgb::splat(ceiling as f32), ..parts[5].clone() }.exitance(1.0);
    solve(shapes::scene(&parts), 0.01)
}

#[test]
fn cube_face_means() {
    for solved in exact::CUBES {
        let model = cube(solved.albedo, solved.ceiling_albedo);
        let means: Vec<f64> = (0..6).map(|face| irradiance(&model, face, 4096).mean()).collect();
        let wall = means[..4].iter().sum::<f64>() / 4.0;
        let title = |face: &str| format!("{face} at {}/{}", solved.albedo, solved.ceiling_albedo);
        // 0.5 % is asked for. A face holds hundreds of rows of 0.7 % noise (4e-4 in the mean), eight points a
        // triangle sample the means to 2e-4 of their range, and interpolation at creases, B ~ r^0.76, adds the rest.
        within(&title("wall"), solved.albedo * wall, solved.wall, 5e-3);
        within(&title("floor"), solved.albedo * means[4], solved.floor, 5e-3);
        within(&title("ceiling"), means[5], solved.ceiling_irradiance, 5e-3);
    }
}

#[test]
fn tetrahedron_factors() {
    let mut parts = shapes::tetrahedron(3).map(|face| part("face", face, 0.0));
    parts[0] = parts[0].clone().exitance(1.0);
    let model = solve(shapes::scene(&parts), 0.01);
    for face in 1..4 {
        // A mean over hundreds of rows of 0.7 % noise; 1 % is what factors are asked for.
        within("factor between faces", irradiance(&model, face, 4096).mean(), exact::TETRAHEDRON, 0.01);
    }
}

/// Mean irradiance over the sites, weighted by the areas they stand for.
fn mean_over_sites(model: &Model) -> f64 {
    let points: Vec<SurfacePoint> =
        (0..model.sites.len()).map(|s| model.sites.point(glowtree::sites::SiteId(s as u32))).collect();
    let answers = model.field().evaluate(&points);
    let areas = || model.sites.areas.iter().map(|a| f64::from(*a));
    let flux: f64 = answers.iter().zip(areas()).map(|(h, a)| f64::from(mean_channel(h.total())) * a).sum();
    flux / areas().sum::<f64>()
}

/// Mean irradiance over all parts by their share of the area, from many points.
fn mean_over_points(model: &Model, parts: &[Part]) -> f64 {
    let area: f64 = parts.iter().map(|p| p.shape.area()).sum();
    let of = |(mesh, p): (usize, &Part)| irradiance(model, mesh, 20_000).mean() * p.shape.area() / area;
    parts.iter().enumerate().map(of).sum()
}

#[test]
fn energy_balance_of_a_cube() {
    for albedo in [0.5, 0.8] {
        let model = cube(albedo, albedo);
        let faces = shapes::box_faces(DVec3::ZERO, DVec3::ONE, 16).map(|f| part("face", f, 0.0));
        let want = exact::enclosure_mean(1.0, 6.0, albedo);
        // 1e-3 as asked: row noise averages to 0.7 % / √2,000 = 2e-4, and nothing may be biased.
        within(&format!("mean over points at {albedo}"), mean_over_points(&model, &faces), want, 1e-3);
        // Areas of sites are estimated from their candidates, which errs where light is steep: the target's tenth
        // for that and for the points above.
        within(&format!("mean over sites at {albedo}"), mean_over_sites(&model), want, 2e-3);
    }
}

#[test]
fn energy_balance_of_a_cave() {
    let waves = |v: DVec3| (5.0 * v.x).sin() * (4.0 * v.y + 1.0).sin() * (6.0 * v.z + 2.0).cos();
    let cave = shapes::icosphere(1.0, 4).mapped(|v| v * (1.0 + 0.2 * waves(v))).flipped();
    let mut halves = [shapes::Shape::default(), shapes::Shape::default()];
    for t in &cave.triangles {
        let up = t.iter().map(|&v| cave.vertices[v as usize].z).sum::<f64>() > 0.0;
        halves[usize::from(up)].triangles.push(*t);
    }
    halves.iter_mut().for_each(|half| half.vertices.clone_from(&cave.vertices));
    let parts = [part("lower", halves[0].clone(), 0.7).exitance(1.0), part("upper", halves[1].clone(), 0.7)];
    let model = solve(shapes::scene(&parts), 0.01);
    let want = exact::enclosure_mean(halves[0].area(), cave.area(), 0.7);
    within("mean in the cave", mean_over_points(&model, &parts), want, 1e-3);
}

/// The light again under another albedo, on the same links.
fn repaint(model: &mut Model, albedo: f32) {
    model.albedo.fill(Rgb::splat(albedo));
    let tolerance = 1e-5 * f64::from(1.0 - albedo);
    let params = IterateParams { tolerance, most: 500, bounces: None, largest_albedo: albedo };
    let (solution, report) = model.problem().solve(&params);
    assert!(report.converged, "{report:?}");
    model.solution = solution;
}

/// Mean indirect irradiance of the solution over the sites' areas.
fn mean_at_sites(model: &Model) -> f64 {
    let problem = model.problem();
    let transport =
        Transport { receivers: problem.receivers, spread: problem.spread, albedo: problem.albedo };
    let light = transport.push(&model.solution.irradiance);
    let areas = model.sites.areas.iter().map(|&a| f64::from(a));
    let total: f64 = areas.clone().sum();
    areas.zip(&light).map(|(a, h)| a * f64::from(mean_channel(*h))).sum::<f64>() / total
}

#[test]
fn lamp_in_a_cubic_room() {
    let flux = 1e4;
    let faces = shapes::box_faces(DVec3::splat(-2.0), DVec3::splat(2.0), 16).map(shapes::Shape::flipped);
    let parts = faces.map(|face| part("face", face, 0.5));
    let scene = shapes::scene(&parts);
    let mut model = solve(shapes::with_point_lamp(scene, DVec3::ZERO, flux / (4.0 * PI)), 0.01);
    let at = |x: f64, y: f64| SurfacePoint {
        position: model.scene.placement.to_local(DVec3::new(x, y, 2.0)),
        normal: Vec3::NEG_Z,
    };
    // The printed 198.94, 70.34 and 38.29; corner and edge a millimetre inside, where the answer differs by 1e-3 at
    // the most. Position and intensity are f32, the formula is exact.
    let places = [at(0.0, 0.0), at(1.999, 0.0), at(1.999, 1.999)];
    let want =
        [(0.0, 0.0), (1.999, 0.0), (1.999, 1.999)].map(|(x, y)| exact::point_room_direct(flux, 4.0, x, y));
    let answers = model.field().evaluate(&places);
    for (answer, want) in answers.iter().zip(want) {
        within("direct light", f64::from(mean_channel(answer.direct)), want, 1e-5);
    }
    let centre = f64::from(mean_channel(answers[0].indirect));
    // "About 112.0": known to half a unit.
    within("indirect at a wall's centre", centre, 112.0, 0.5 / 112.0 + 0.01);
    for albedo in [0.1f32, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95] {
        repaint(&mut model, albedo);
        let mut sum = 0.0;
        for face in 0..6 {
            let points = shapes::points_on(&model.scene, face, 4096, 17);
            sum += model
                .field()
                .evaluate(&points)
                .iter()
                .map(|h| f64::from(mean_channel(h.indirect)))
                .sum::<f64>();
        }
        let want = exact::point_room_indirect(flux, 96.0, f64::from(albedo));
        // The solution's own balance: direct light at the sites sums to the flux, and ρ/(1−ρ) of it must come back.
        within(&format!("indirect of the solution at {albedo}"), mean_at_sites(&model), want, 1e-3);
        // Interpolation to points may err by the target in every point; its mean must be better by half.
        within(&format!("indirect at points at {albedo}"), sum / (6.0 * 4096.0), want, 5e-3);
    }
}
