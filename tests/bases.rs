//! The bases on smooth and on broken light over the unit square: what each is good for, and where it breaks.
//!
//! The table of `docs/bases.md`: `cargo test --release --test bases -- --nocapture`.

#![allow(clippy::unwrap_used)] // a test that cannot go on panics where it stands

mod shapes;

use glam::{DVec3, Vec3};
use glowtree::bake::Silent;
use glowtree::bake::laws::Plan;
use glowtree::bake::model::Model;
use glowtree::bake::pipeline::build;
use glowtree::basis::hierarchical::{Ladder, Residuals};
use glowtree::basis::multistep::{Multistep, Steps};
use glowtree::basis::radial::{Normalised, Radial, Trend, Widths};
use glowtree::basis::shepard::{Averaged, Linear, Shepard};
use glowtree::basis::{Basis, Reconstruction};
use glowtree::geometry::{SurfacePoint, hash};
use glowtree::light::mean_channel;
use glowtree::links::points::Operator;
use glowtree::scene::Scene;
use glowtree::tree::Support;
use glowtree::tree::mls::Sign;

/// A point of the unit square.
fn point(x: f32, y: f32) -> SurfacePoint {
    SurfacePoint { position: Vec3::new(x, y, 0.0), normal: Vec3::Z }
}

/// Scattered supports: a grid of spacing 1/n over the square and one row beyond, each moved by up to 0.3 of the spacing, in
/// random order, with radii of one spacing.
fn scatter(n: i32, seed: u64) -> Vec<Support> {
    let h = 1.0 / n as f32;
    let mut made: Vec<(u64, Support)> = Vec::new();
    for i in 0..=n {
        for j in 0..=n {
            let index = (i * (n + 1) + j) as u64;
            let [x, y] = hash::unit_pair(seed, index).map(|v| 0.6 * (v - 0.5));
            let at = point((i as f32 + x) * h, (j as f32 + y) * h);
            made.push((hash::mix2(seed, index), Support { point: at, radius: h }));
        }
    }
    made.sort_unstable_by_key(|m| m.0);
    made.into_iter().map(|m| m.1).collect()
}

/// Smooth light: a slope, a wave and a bump; it ranges over about 0.3 … 2.3.
fn smooth(p: &SurfacePoint) -> f64 {
    let (x, y) = (f64::from(p.position.x), f64::from(p.position.y));
    let bump = (-((x - 0.6).powi(2) + (y - 0.4).powi(2)) / 0.08).exp();
    1.0 + 0.5 * x + 0.3 * (3.0 * x).sin() * (2.0 * y).cos() + 0.5 * bump
}

/// A shadow's edge.
fn step(p: &SurfacePoint) -> f64 {
    f64::from(u8::from(p.position.x + 0.3 * p.position.y > 0.6))
}

fn values(supports: &[Support], light: impl Fn(&SurfacePoint) -> f64) -> Vec<[f64; 1]> {
    supports.iter().map(|s| [light(&s.point)]).collect()
}

/// Points that judge: random ones inside of the square.
fn judges() -> Vec<SurfacePoint> {
    (0..4000).map(|i| hash::unit_pair(99, i)).map(|[x, y]| point(0.02 + 0.96 * x, 0.02 + 0.96 * y)).collect()
}

/// Root mean square error, and the range of the function.
fn judge(function: &dyn Reconstruction<1>, light: impl Fn(&SurfacePoint) -> f64) -> (f64, [f64; 2]) {
    let points = judges();
    let answers = function.evaluate(&points);
    let (mut square, mut range) = (0.0, [f64::INFINITY, f64::NEG_INFINITY]);
    for (p, answer) in points.iter().zip(answers) {
        let [value] = answer.unwrap_or_else(|| panic!("nothing reaches {p:?}"));
        square += (value - light(p)).powi(2);
        range = [range[0].min(value), range[1].max(value)];
    }
    ((square / points.len() as f64).sqrt(), range)
}

fn positions(supports: &[Support]) -> Vec<SurfacePoint> {
    supports.iter().map(|s| s.point).collect()
}

/// A single level of functions `reach` spacings wide, the textbook form.
fn single(n: i32, reach: f32, light: impl Fn(&SurfacePoint) -> f64) -> Radial<1> {
    let supports = scatter(n, 1);
    let widths = Widths { unit: 1.0 / n as f32, reach, with_normals: false };
    Radial::uniform(&positions(&supports), &values(&supports, light), widths, Trend::Zero).unwrap()
}

fn steps(levels: usize, reach: f32) -> Steps {
    Steps { coarsest: 0.5, most: levels, reach, with_normals: false, ridge: 0.0 }
}

/// The spacings of the table.
const FINENESS: [i32; 4] = [8, 16, 32, 64];

#[test]
fn the_seed_papers_inverse_distance_does_not_converge() {
    let error = |law, n| {
        let supports = scatter(n, 1);
        judge(&Averaged::new(law, &supports, &values(&supports, smooth)), smooth).0
    };
    let bad = FINENESS.map(|n| error(Shepard::InverseDistance, n));
    let good = FINENESS.map(|n| error(Shepard::FrankeLittle, n));
    print_row("1/d", &bad);
    print_row("Franke–Little, R = 2h", &good);
    // Σ_j f_j / d_j over Σ_j 1/d_j tends to ∫ f/d over ∫ 1/d, a blur over the whole square, however small h: it stays.
    assert!(bad[3] > 0.7 * bad[0], "{bad:?}");
    // An average of first order at least: a halved spacing halves the error, within a quarter for chance.
    assert!(good.windows(2).all(|e| e[1] < 0.75 * e[0]), "{good:?}");
    assert!(good[3] < 0.1 * bad[3]);
}

#[test]
fn a_single_level_saturates_and_steps_do_not() {
    let reach = 4.0;
    let one = FINENESS.map(|n| judge(&single(n, reach, smooth), smooth).0);
    let mut worst: f64 = 0.0;
    let many = FINENESS.map(|n| {
        let supports = scatter(n, 1);
        let function = Multistep::fit(&supports, &values(&supports, smooth), &steps(12, reach)).unwrap();
        let conditions = function.conditions();
        println!("n = {n}: {} levels, conditions {conditions:.0?}", conditions.len());
        worst = conditions.iter().fold(worst, |w, c| w.max(c.2));
        judge(&function, smooth).0
    });
    print_row("one level, R = 4h", &one);
    print_row("multistep, R = 4h", &many);
    assert!(4.0 * many[3] <= one[3], "{many:?} against {one:?}");
    assert!(many.windows(2).all(|e| e[1] < 0.5 * e[0]), "second order would quarter: {many:?}");
    assert!(worst < 1e3, "the width over spacing bounds the condition, got {worst}");
}

#[test]
fn condition_grows_with_width_not_with_number() {
    let condition = |n, reach| single(n, reach, smooth).condition();
    let by_width = [2.0, 4.0, 8.0].map(|reach| condition(16, reach));
    let by_number = [8, 16, 32].map(|n| condition(n, 4.0));
    println!(
        "condition at R = 2h, 4h, 8h: {by_width:.0?}; at R = 4h with 8², 16², 32² supports: {by_number:.0?}"
    );
    // Wendland's C² function in d = 2 has a spectrum that falls as k^−(d+3): (width/spacing)⁵, 32 a doubling.
    assert!(by_width[2] > 8.0 * by_width[1] && by_width[1] > 8.0 * by_width[0], "{by_width:?}");
    assert!(by_number[2] < 4.0 * by_number[0], "{by_number:?}");
}

#[test]
fn residual_levels_beat_one_level_of_the_same_weights() {
    let mut rows = (Vec::new(), Vec::new(), Vec::new());
    for n in FINENESS {
        let supports = scatter(n, 1);
        let data = values(&supports, smooth);
        let widths = Widths { unit: 1.0 / n as f32, reach: 3.0, with_normals: false };
        rows.0.push(judge(&Normalised::new(&positions(&supports), &data, widths), smooth).0);
        let ladder = Ladder { coarsest: 0.5, most: 12, reach: 3.0 };
        rows.1.push(judge(&Residuals::fit(&supports, &data, &ladder), smooth).0);
        rows.2.push(judge(&Linear::new(Sign::Any, &supports, &data), smooth).0);
    }
    print_row("normalised weights, R = 3h", &rows.0);
    print_row("residual levels, R = 3h_l", &rows.1);
    print_row("linear MLS (the default)", &rows.2);
    assert!(4.0 * rows.1[3] <= rows.0[3], "{rows:?}");
    assert!(4.0 * rows.2[3] <= rows.0[3], "{rows:?}");
}

#[test]
fn at_a_shadows_edge_interpolants_ring_and_averages_do_not() {
    let supports = scatter(32, 1);
    let data = values(&supports, step);
    let ladder = Ladder { coarsest: 0.5, most: 12, reach: 3.0 };
    let functions: [(&str, Box<dyn Reconstruction<1>>); 6] = [
        ("Franke–Little", Box::new(Averaged::new(Shepard::FrankeLittle, &supports, &data))),
        ("linear MLS, non-negative", Box::new(Linear::new(Sign::NonNegative, &supports, &data))),
        ("linear MLS", Box::new(Linear::new(Sign::Any, &supports, &data))),
        ("residual levels", Box::new(Residuals::fit(&supports, &data, &ladder))),
        ("one radial level", Box::new(single(32, 8.0, step))),
        ("multistep", Box::new(Multistep::fit(&supports, &data, &steps(12, 4.0)).unwrap())),
    ];
    let ranges = functions.map(|(name, function)| {
        let (error, range) = judge(function.as_ref(), step);
        println!("step 0/1, h = 1/32: {name}: error {error:.4}, range {:.3} … {:.3}", range[0], range[1]);
        range
    });
    // Weights of one sign that sum to one, but for rounding of f32 weights: 20 · 6e-8.
    for range in &ranges[..2] {
        assert!(range[0] >= -2e-6 && range[1] <= 1.0 + 2e-6, "{range:?}");
    }
    // Weights whose magnitudes sum to at most 3 stay within [−1, 2]; here far better.
    assert!(ranges[2][0] > -0.3 && ranges[2][1] < 1.3, "{ranges:?}");
    // An interpolant of a step through C² functions must ring, Gibbs: negative light.
    assert!(ranges[4][0] < -0.05 && ranges[4][1] > 1.05, "{ranges:?}");
}

#[test]
fn graded_supports_with_normals_are_met_within_the_ridge() {
    // Supports over a half cylinder, denser towards one end, normals all around; and a flat sheet close under it that faces down
    // and is dark: its normals part it from the cylinder.
    let mut supports = Vec::new();
    let light = |p: &SurfacePoint| {
        if p.normal.z < -0.9 { 0.0 } else { 1.0 + 0.3 * f64::from(p.normal.x + p.position.y) }
    };
    let mut y = 0.0f32;
    while y < 1.0 {
        let radius = 0.03 + 0.12 * y;
        let count = (1.5 / radius) as i32;
        for k in 0..=count {
            let (sin, cos) = (std::f32::consts::PI * k as f32 / count as f32).sin_cos();
            let normal = Vec3::new(cos, 0.0, sin);
            supports.push(Support {
                point: SurfacePoint { position: normal * 0.3 + Vec3::Y * y, normal },
                radius,
            });
            let under = Vec3::new(0.28 * cos, y, 0.28 * sin - 0.01);
            supports.push(Support { point: SurfacePoint { position: under, normal: -Vec3::Z }, radius });
        }
        y += 0.8 * radius;
    }
    let data = values(&supports, light);
    let radial = Radial::graded(&supports, &data).unwrap();
    let multistep = Multistep::fit(&supports, &data, &Steps::graded(&supports)).unwrap();
    println!(
        "{} graded supports: condition {:.0}, {:.0?}",
        supports.len(),
        radial.condition(),
        multistep.conditions()
    );
    assert!(radial.condition() < 1e5);
    for (name, function) in [("radial", &radial as &dyn Reconstruction<1>), ("multistep", &multistep)] {
        let (mut square, mut between, mut worst) = (0.0, 0.0, 0.0f64);
        for (k, s) in supports.iter().enumerate() {
            let [value] = function.at(&s.point).unwrap();
            square += (value - data[k][0]).powi(2);
            worst = worst.max((value - data[k][0]).abs());
            let offset = SurfacePoint { position: s.point.position + Vec3::Y * (0.4 * s.radius), ..s.point };
            between += (function.at(&offset).unwrap()[0] - light(&offset)).powi(2);
        }
        let rms = |square: f64| (square / supports.len() as f64).sqrt();
        println!("{name}: rms at supports {:.4}, worst {worst:.3}, between {:.4}", rms(square), rms(between));
        // The ridge ε leaves ε / (λ + ε) of the residuals' parts by eigenvalue λ: a tenth where λ = 1, nearly all where λ is
        // small. Residuals over averages of a linear function within three radii, 0.3 of change each, are a tenth at the most.
        assert!(rms(square) < 0.02, "{name}");
        assert!(rms(between) < 0.04, "{name}");
    }
}

#[test]
fn noise_is_kept_by_interpolants_and_halved_by_fits() {
    let supports = scatter(32, 1);
    let level = 0.03;
    // Uniform noise of standard error 0.03: what a row of few rays brings.
    let mut data = values(&supports, smooth);
    for (k, value) in data.iter_mut().enumerate() {
        value[0] += level * 12f64.sqrt() * (f64::from(hash::unit(77, k as u64)) - 0.5);
    }
    let ladder = Ladder { coarsest: 0.5, most: 12, reach: 3.0 };
    let fitted = Steps { ridge: 0.3, ..steps(12, 4.0) };
    // As wide as the program's: about 20 supports in reach.
    let wide: Vec<Support> = supports.iter().map(|s| Support { radius: 1.3 * s.radius, ..*s }).collect();
    let functions: [(&str, Box<dyn Reconstruction<1>>); 5] = [
        ("Franke–Little", Box::new(Averaged::new(Shepard::FrankeLittle, &wide, &data))),
        ("linear MLS", Box::new(Linear::new(Sign::Any, &wide, &data))),
        ("residual levels", Box::new(Residuals::fit(&supports, &data, &ladder))),
        ("multistep", Box::new(Multistep::fit(&supports, &data, &steps(12, 4.0)).unwrap())),
        ("multistep, ridge 0.3", Box::new(Multistep::fit(&supports, &data, &fitted).unwrap())),
    ];
    let errors = functions.map(|(name, function)| {
        let error = judge(function.as_ref(), smooth).0;
        println!("smooth + noise of {level}, h = 1/32: {name}: {error:.4}");
        error
    });
    // A fit of twenty values to three parameters would keep √(3/20) = 0.39 of the noise at equal weights; the kernel prefers
    // the near, three quarters are allowed. An interpolant keeps all at its supports; between them it averages about four.
    assert!(errors[1] < 0.75 * level, "{errors:?}");
    assert!(errors[3] > 0.75 * level, "{errors:?}");
}

/// A closed box of one albedo; every face glows, or the first alone.
fn closed(size: DVec3, albedo: f32, all: bool) -> Vec<shapes::Part> {
    let glowing = |k: usize| if all || k == 0 { 1.0 } else { 0.0 };
    let faces = shapes::box_faces(DVec3::ZERO, size, 1).into_iter().enumerate();
    faces.map(|(k, f)| shapes::part("shell", f.flipped(), albedo).exitance(glowing(k))).collect()
}

fn bake(scene: Scene, plan: &Plan) -> Model {
    build(scene, plan, None, &Silent).expect("nothing interrupts").0
}

/// Mean-channel irradiance at points of the six walls, by their place along x.
fn walls(model: &Model) -> Vec<(f64, f64)> {
    let mut all = Vec::new();
    for mesh in 0..6 {
        let points = shapes::points_on(&model.scene, mesh, 1000, 5);
        for (point, answer) in points.iter().zip(model.field().evaluate(&points)) {
            assert!(answer.total().min_element() >= 0.0, "negative light at {point:?}");
            let x = model.scene.placement.to_world(point.position).x;
            all.push((x, f64::from(mean_channel(answer.total()))));
        }
    }
    all
}

#[test]
fn the_furnace_glows_evenly_in_every_basis() {
    for basis in Basis::ALL {
        let scene = shapes::scene(&closed(DVec3::ONE, 0.5, true));
        let model = bake(scene, &Plan { basis, ..Plan::new(0.03, 1) });
        // B = 1 / (1 − ½) = 2 = H. Rows all see 2 and every basis reproduces constants; the solver stops at 3e-4 · ½ of the first
        // bounce, which leaves at most 3e-4.
        for (x, light) in walls(&model) {
            assert!((light - 2.0).abs() < 2e-3, "{basis}: {light} at x = {x}");
        }
    }
}

#[test]
fn no_basis_leaks_through_a_sheet() {
    let mut parts = closed(DVec3::new(2.0, 1.0, 1.0), 0.7, false);
    parts.push(shapes::part("wall", shapes::quad(DVec3::X, DVec3::Y, DVec3::Z, 1), 0.7).two_sided());
    let mut means = Vec::new();
    for basis in Basis::ALL {
        let model = bake(shapes::scene(&parts), &Plan { basis, ..Plan::new(0.03, 1) });
        let all = walls(&model);
        let mean = |side: &dyn Fn(f64) -> bool| {
            let of: Vec<f64> = all.iter().filter(|w| side(w.0)).map(|w| w.1).collect();
            of.iter().sum::<f64>() / of.len() as f64
        };
        let (lit, dark) = (mean(&|x| x < 1.0), mean(&|x| x > 1.0));
        println!("{basis}: lit {lit:.4}, dark {dark:.2e}");
        // The stability suite's limit for walls of no thickness.
        assert!(dark < 1e-3 * lit, "{basis}: {dark} beside {lit}");
        means.push(lit);
    }
    // Two answers within 3 % each.
    assert!(means.iter().all(|m| (m / means[0] - 1.0).abs() < 0.06), "{means:?}");
}

#[test]
fn the_dense_operator_makes_light() {
    let scene = || shapes::scene(&closed(DVec3::ONE, 0.5, true));
    let model = bake(scene(), &Plan { operator: Operator::Dense, ..Plan::new(0.2, 1) });
    let around = model.around();
    let dense = glowtree::links::points::Dense::couple(around, &model.receivers);
    let sums = dense.gather(&vec![glowtree::light::Rgb::ONE; model.sites.len()]);
    let mean = sums.iter().map(|s| f64::from(s.x)).sum::<f64>() / sums.len() as f64;
    println!(
        "dense: {} sites, mean row sum {mean:.3}, largest {:.3}",
        model.sites.len(),
        dense.largest_row_sum()
    );
    // Receivers see the walls all around: each sum should be one. Away from edges centres stand for areas well enough; next to
    // a wall the kernel of the nearest site is some 1/(π d²) of its area too much or too little.
    assert!((mean - 1.0).abs() < 0.2, "{mean}");
    assert!(dense.largest_row_sum() > 1.05);
    // As many sites as one percent asks for are refused before any ray of the operator is traced.
    let refused = build(scene(), &Plan { operator: Operator::Dense, ..Plan::new(0.002, 1) }, None, &Silent);
    assert_eq!(
        refused.err().map(|e| (e.exit_code(), e.to_string().contains("raise --error"))),
        Some((2, true))
    );
}

fn print_row(name: &str, errors: &[f64]) {
    let shown: Vec<String> = errors.iter().map(|e| format!("{e:.2e}")).collect();
    println!("rmse at h = 1/8, 1/16, 1/32, 1/64: {name}: {}", shown.join(", "));
}
