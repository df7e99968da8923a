//! The tests' own tools are held to the printed catalogue and to plain geometry, so that they can be trusted.

mod closed_forms;
mod shapes;

use std::f64::consts::PI;

use closed_forms as exact;
use glam::DVec3;

fn near(got: f64, want: f64, tolerance: f64) {
    assert!((got - want).abs() <= tolerance, "got {got}, want {want} ± {tolerance}");
}

#[test]
fn configuration_factors_agree_with_the_catalogue() {
    // The tables print eleven or twelve digits; the formulas lose two or three by cancellation.
    let table = [
        (0.1, 0.1, 0.00316205683876),
        (0.5, 0.5, 0.0685895888186),
        (1.0, 1.0, 0.199824895698),
        (1.0, 2.0, 0.285875384851),
        (10.0, 10.0, 0.826994522397),
    ];
    table.iter().for_each(|(x, y, f)| near(exact::parallel_rectangles(*x, *y), *f, 1e-10));
    let table = [
        (1.0, 1.0, 0.200043776075),
        (2.0, 1.0, 0.232852602795),
        (10.0, 1.0, 0.24920948579),
        (0.5, 1.0, 0.146186679106),
        (0.1, 1.0, 0.0432513694007),
        (5.0, 5.0, 0.0881023945969),
    ];
    table.iter().for_each(|(h, w, f)| near(exact::perpendicular_rectangles(*h, *w), *f, 1e-10));
    near(exact::coaxial_discs(1.0, 1.0, 1.0), 0.38196601125, 1e-10);
    near(exact::coaxial_discs(1.0, 1.0, 2.0), 0.171572875254, 1e-10);
    near(exact::coaxial_discs(1.0, 2.0, 1.0), 0.7639320225, 1e-10);
    near(exact::point_under_centre(1.0, 1.0, 1.0), 0.239456470461, 1e-11);
    near(exact::point_under_corner(1.0, 1.0, 1.0), 0.138531605995, 1e-11);
    let table = [(0.1, 0.22173867087), (0.5, 0.124268909915), (1.0, 0.0557341970026)];
    table.iter().for_each(|(c, f)| near(exact::point_perpendicular_to_square(*c), *f, 1e-10));
}

#[test]
fn lambert_agrees_with_the_rectangle() {
    let square = [(0.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, 0.0)].map(|(x, y)| DVec3::new(x, y, 1.0));
    // Both are closed forms in f64: a dozen roundings.
    near(exact::point_to_polygon(DVec3::ZERO, DVec3::Z, &square), 0.138531605995, 1e-11);
    // A polygon of n corners misses a share of about (2π²/3)/n² of the disc: 7e-6 at n = 1000.
    let n = 1000;
    let disc: Vec<DVec3> = (0..n)
        .map(|i| {
            let (y, x) = (-2.0 * PI * f64::from(i) / f64::from(n)).sin_cos();
            DVec3::new(x, y, 0.5)
        })
        .collect();
    near(exact::point_to_polygon(DVec3::ZERO, DVec3::Z, &disc), exact::point_to_disc(1.0, 0.5), 1e-5);
}

#[test]
fn hinged_squares_agree_where_they_are_perpendicular() {
    let ninety = exact::HINGED_SQUARES[3].1;
    near(ninety, exact::perpendicular_rectangles(1.0, 1.0), 5e-8);
}

#[test]
fn solutions_agree_with_their_printed_figures() {
    let degrees = |d: f64| d * PI / 180.0;
    near(exact::crater(degrees(40.0), degrees(15.0), 0.3, 1.0), 0.008312031503, 1e-12);
    near(exact::crater(degrees(60.0), degrees(30.0), 0.5, 1.0), 0.05357142857, 1e-11);
    near(exact::crater(degrees(90.0), degrees(45.0), 0.8, 1.0), 0.2357022604, 1e-10);
    let [inner, outer] = exact::concentric_spheres([0.5, 1.0], [1.0, 0.0], [0.5, 0.5]);
    near(inner, 10.0 / 9.0, 1e-14);
    near(outer, 2.0 / 9.0, 1e-14);
    let half = |exitance| exact::Zone { share: 0.5, exitance, albedo: 0.5 };
    near(exact::sphere_interior(&[half(1.0), half(0.0)]), 1.0, 1e-14);
    near(exact::point_room_indirect(1e4, 96.0, 0.5), 104.17, 5e-3);
    near(exact::point_room_indirect(1e4, 96.0, 0.95), 1979.17, 5e-3);
    near(exact::point_room_direct(1e4, 4.0, 0.0, 0.0), 198.94, 5e-3);
    near(exact::point_room_direct(1e4, 4.0, 2.0, 2.0), 38.29, 5e-3);
    near(exact::furnace(1.0, 0.5), 2.0, 1e-15);
    near(exact::parallel_plates([1.0, 1.0], [0.5, 0.5]), 2.0, 1e-15);
}

#[test]
fn solved_cubes_conserve_energy() {
    for cube in exact::CUBES.iter().filter(|c| c.albedo == c.ceiling_albedo) {
        let irradiance = |b: f64| b / cube.albedo;
        let mean = (4.0 * irradiance(cube.wall) + irradiance(cube.floor) + cube.ceiling_irradiance) / 6.0;
        // Six face means of radiosity, each good to 1e-7 and divided by an albedo of one half at the least.
        near(mean, exact::enclosure_mean(1.0, 6.0, cube.albedo), 2e-7);
    }
}

#[test]
fn shapes_have_their_areas_and_look_the_right_way() {
    let cube = shapes::cuboid(DVec3::ZERO, DVec3::new(1.0, 2.0, 3.0), 4);
    near(cube.area(), 22.0, 1e-12);
    near(cube.volume(), 6.0, 1e-12);
    near(cube.flipped().volume(), -6.0, 1e-12);
    // Inscribed polyhedra of edge h miss a share of about h²/4 of the area: h ≈ 0.14 after three splits.
    let ball = shapes::icosphere(1.0, 3);
    assert_eq!(ball.triangles.len(), 1280);
    near(ball.area() / (4.0 * PI), 1.0, 0.01);
    near(ball.volume() / (4.0 * PI / 3.0), 1.0, 0.02);
    let inside = shapes::zone(0.0, PI, 32, 64);
    near(inside.area() / (4.0 * PI), 1.0, 0.01);
    assert!(inside.volume() < 0.0, "a zone's front looks inwards");
    near(shapes::zone(0.0, PI / 3.0, 32, 64).area() / PI, 1.0, 0.01);
    near(shapes::disc(2.0, 256).area(), 4.0 * PI, 4.0 * PI * 2e-4);
    let faces = shapes::tetrahedron(2);
    let whole = faces.iter().fold(shapes::Shape::default(), shapes::Shape::with);
    near(whole.volume(), -8.0 / 3.0, 1e-12);
}

#[test]
fn hinged_leaves_face_each_other() {
    for degrees in [30.0, 90.0, 135.0] {
        let scene = shapes::scene(&shapes::hinged_squares(degrees, 1).map(|s| shapes::part("leaf", s, 0.5)));
        let centre = |mesh: usize| shapes::points_on(&scene, mesh, 1, 1)[0];
        let (a, b) = (centre(0), centre(1));
        let to = b.position - a.position;
        assert!(to.dot(a.normal) > 0.0 && to.dot(b.normal) < 0.0, "opened by {degrees}°");
    }
}

#[test]
fn scenes_are_unit_sized_and_points_lie_on_them() {
    let shape = shapes::cuboid(DVec3::splat(1e6), DVec3::splat(1e6 + 50.0), 2);
    let scene = shapes::scene(&[shapes::part("box", shape, 0.5)]);
    let top = scene.vertices.iter().fold(0.0f32, |m, v| m.max(v.abs().max_element()));
    assert!((top - 0.5).abs() < 1e-6, "largest local coordinate {top}");
    for p in shapes::points_on(&scene, 0, 100, 5) {
        // Faces lie at ±½ exactly; interpolation rounds once or twice.
        assert!((p.position.dot(p.normal) - 0.5).abs() < 1e-6, "{p:?}");
    }
}
