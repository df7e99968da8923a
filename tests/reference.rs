//! The path tracer against answers known in closed form.
//!
//! Every comparison allows four standard errors, which chance exceeds once in 16,000, plus the stated error of the
//! tessellation; and each demands that the standard error itself is small, so that a wrong answer cannot hide in it.

mod closed_forms;
mod shapes;

use std::f64::consts::PI;
use std::sync::Arc;

use closed_forms as exact;
use glam::{DVec3, Mat3, Vec3};
use glowtree::geometry::SurfacePoint;
use glowtree::light::{Rgb, mean_channel};
use glowtree::rays::Bvh;
use glowtree::reference::{Estimate, ReferenceParams, irradiance};
use glowtree::scene::{Scene, Sky, Texture};
use shapes::{part, points_on};

fn trace(scene: &Scene, points: &[SurfacePoint], params: &ReferenceParams) -> Vec<Estimate> {
    irradiance(scene, &Bvh::build(scene), points, params, |_| ())
}

fn samples(samples: u32) -> ReferenceParams {
    ReferenceParams { samples, seed: 11, ..Default::default() }
}

/// Mean over the points of the mean channel, and its standard error from the points' own.
fn mean(estimates: &[Estimate]) -> (f64, f64) {
    let n = estimates.len() as f64;
    let sum: f64 = estimates.iter().map(|e| f64::from(mean_channel(e.mean))).sum();
    // Channels of grey scenes go together: their errors are one error.
    let square: f64 = estimates.iter().map(|e| f64::from(mean_channel(e.standard_error)).powi(2)).sum();
    (sum / n, square.sqrt() / n)
}

/// Holds a mean to the exact value: four standard errors and `bias` relative, the errors under `noise` relative.
fn hold((mean, error): (f64, f64), want: f64, bias: f64, noise: f64, what: &str) {
    assert!(error <= noise * want, "{what}: standard error {error} of {want}: too noisy to tell");
    let allowed = 4.0 * error + bias * want;
    assert!((mean - want).abs() <= allowed, "{what}: got {mean}, want {want} ± {allowed}");
}

fn cube_of(faces: [(f32, f32); 6]) -> Scene {
    let shapes = shapes::box_faces(DVec3::ZERO, DVec3::ONE, 1);
    let part = |k: usize| part("face", shapes[k].clone().flipped(), faces[k].0).exitance(faces[k].1);
    shapes::scene(&[0, 1, 2, 3, 4, 5].map(part))
}

#[test]
fn furnace_with_an_occluder_is_even() {
    for albedo in [0.0f32, 0.5, 0.9] {
        let room = shapes::cuboid(DVec3::ZERO, DVec3::ONE, 1).flipped();
        let block = shapes::cuboid(DVec3::splat(0.2), DVec3::new(0.5, 0.6, 0.9), 1);
        let material = |name: &str, shape| part(name, shape, albedo).exitance(1.0);
        let scene = shapes::scene(&[material("room", room), material("block", block)]);
        let want = exact::furnace(1.0, f64::from(albedo));
        for mesh in 0..2 {
            let result = trace(&scene, &points_on(&scene, mesh, 100, 3), &samples(256));
            // Flat faces: nothing but f32 rounding, a few 1e-6.
            hold(mean(&result), want, 1e-5, 0.008, &format!("albedo {albedo}, mesh {mesh}"));
        }
    }
}

#[test]
fn bounces_are_counted_as_asked() {
    let scene = cube_of([(0.5, 1.0); 6]);
    let points = points_on(&scene, 2, 64, 5);
    for (max_bounces, want) in [(0, 1.0), (1, 1.5), (2, 1.75), (5, 1.96875)] {
        let result = trace(&scene, &points, &ReferenceParams { max_bounces, ..samples(256) });
        hold(mean(&result), want, 1e-5, 0.003, &format!("{max_bounces} bounces"));
    }
}

#[test]
fn sphere_of_two_halves_is_even() {
    let half = |from, to| shapes::zone(from, to, 64, 256);
    let lower = part("lower", half(0.0, PI / 2.0), 0.5);
    let upper = part("upper", half(PI / 2.0, PI), 0.5).exitance(1.0);
    let scene = shapes::scene(&[lower, upper]);
    for mesh in 0..2 {
        let result = trace(&scene, &points_on(&scene, mesh, 100, 3), &samples(256));
        // Facets of edge h = π/128 replace caps that hold h²/4 of the sphere: 1.5e-4 of all light is misplaced.
        hold(mean(&result), 1.0, 1.5e-4, 0.003, "sphere of two halves");
    }
}

#[test]
fn concentric_spheres_exchange_light() {
    let inner = part("inner", shapes::icosphere(0.5, 4), 0.5).exitance(1.0);
    let outer = part("outer", shapes::icosphere(1.0, 4).flipped(), 0.5);
    let scene = shapes::scene(&[inner, outer]);
    let [b1, b2] = exact::concentric_spheres([0.5, 1.0], [1.0, 0.0], [0.5, 0.5]);
    for (mesh, want) in [(0, (b1 - 1.0) / 0.5), (1, b2 / 0.5)] {
        let result = trace(&scene, &points_on(&scene, mesh, 200, 3), &samples(256));
        // Edges h ≈ 0.075: facets misplace h²/4 = 1.4e-3 of the light.
        hold(mean(&result), want, 1.4e-3, 0.006, &format!("sphere {mesh}"));
    }
}

#[test]
fn crater_under_the_sun_lights_itself_evenly() {
    for (half_angle, elevation, albedo) in [(40.0f64, 15.0f64, 0.3f32), (60.0, 30.0, 0.5), (90.0, 45.0, 0.8)]
    {
        let [half_angle, elevation] = [half_angle.to_radians(), elevation.to_radians()];
        let bowl = part("bowl", shapes::zone(0.0, half_angle, 64, 256), albedo);
        let towards = DVec3::new(elevation.cos(), 0.0, elevation.sin());
        let scene = shapes::with_sun(shapes::scene(&[bowl]), -towards, 1.0);
        let points = points_on(&scene, 0, 200, 3);
        let total = trace(&scene, &points, &samples(1024));
        let direct = trace(&scene, &points, &ReferenceParams { max_bounces: 0, ..samples(16) });
        assert!(direct.iter().all(|e| e.standard_error == Rgb::ZERO), "a lamp's direct light has no noise");
        assert!(direct.iter().any(|e| e.mean == Rgb::ZERO) == (elevation < half_angle), "own shadow");
        let indirect: Vec<Estimate> =
            total.iter().zip(&direct).map(|(t, d)| Estimate { mean: t.mean - d.mean, ..*t }).collect();
        let want = exact::crater(half_angle, elevation, f64::from(albedo), 1.0);
        // Facets of edge h ≤ 2π/256 misplace h²/4 = 1.5e-4 of the light, twice over with the rim's own polygon.
        hold(mean(&indirect), want, 3e-4, 0.01, &format!("crater of {half_angle} rad"));
    }
}

#[test]
fn cube_faces_have_their_means() {
    for cube in exact::CUBES {
        let grey = (cube.albedo as f32, 0.0);
        // Faces in the order −x, +x, −y, +y, −z, +z; the ceiling is +y.
        let scene = cube_of([grey, grey, grey, (cube.ceiling_albedo as f32, 1.0), grey, grey]);
        let wanted =
            [(0, cube.wall / cube.albedo), (2, cube.floor / cube.albedo), (3, cube.ceiling_irradiance)];
        for (face, want) in wanted {
            let result = trace(&scene, &points_on(&scene, face, 1000, 7), &samples(64));
            let (got, _) = mean(&result);
            // The points' own spread bounds the error of choosing 1000 of them, path noise included.
            let spread: f64 = result.iter().map(|e| (f64::from(mean_channel(e.mean)) - got).powi(2)).sum();
            let error = spread.sqrt() / 1000.0;
            hold((got, error), want, 1e-6, 0.02, &format!("albedo {}, face {face}", cube.albedo));
        }
    }
}

#[test]
fn point_lamp_in_a_room_gives_its_mean_and_its_direct_light() {
    let (flux, edge, albedo) = (1e4, 4.0, 0.5f32);
    let room = shapes::cuboid(DVec3::ZERO, DVec3::splat(edge), 1).flipped();
    let scene = shapes::scene(&[part("room", room, albedo)]);
    let scene = shapes::with_point_lamp(scene, DVec3::splat(0.5 * edge), flux / (4.0 * PI));
    let wall = |y: f64, z: f64| SurfacePoint {
        position: scene.placement.to_local(DVec3::new(0.0, y, z)),
        normal: Vec3::X,
    };
    let params = ReferenceParams { max_bounces: 0, ..samples(16) };
    for (y, z) in [(2.0, 2.0), (3.0, 2.5), (0.001, 2.0), (0.001, 0.001)] {
        let got = f64::from(mean_channel(trace(&scene, &[wall(y, z)], &params)[0].mean));
        // In this frame irradiance is per squared local unit of intensity: the flux is the world's all the same.
        let want = exact::point_room_direct(flux, edge, y - 2.0, z - 2.0);
        assert!((got - want).abs() < 1e-5 * want, "direct at ({y}, {z}): got {got}, want {want}");
    }
    let points = points_on(&scene, 0, 1000, 9);
    let (got, noise) = mean(&trace(&scene, &points, &samples(64)));
    let direct: f64 =
        trace(&scene, &points, &params).iter().map(|e| f64::from(mean_channel(e.mean))).sum::<f64>() / 1000.0;
    // Indirect light varies by ±8 % over a wall (about 112 at its centre): 1000 points know its mean to 0.25 %.
    let want = exact::point_room_indirect(flux, 6.0 * edge * edge, f64::from(albedo));
    hold((got - direct, noise + 0.0025 * want), want, 1e-6, 0.006, "indirect mean");
}

#[test]
fn plates_emit_and_block_by_their_sides() {
    let plate = |z: f64| shapes::quad(DVec3::new(-0.5, -0.5, z), DVec3::X, DVec3::Y, 1);
    let factor = exact::point_under_centre(1.0, 1.0, 1.0);
    let below =
        |scene: &Scene| SurfacePoint { position: scene.placement.to_local(DVec3::ZERO), normal: Vec3::Z };
    let emitter = |shape| part("plate", shape, 0.0).exitance(1.0);
    let frame = part("frame", shapes::quad(DVec3::new(5.0, 5.0, 0.0), DVec3::X, DVec3::Y, 1), 0.0);
    let cases = [
        ("the front emits", emitter(plate(1.0).flipped()), None, factor),
        ("the back does not", emitter(plate(1.0)), None, 0.0),
        ("both sides of a two-sided one do", emitter(plate(1.0)).two_sided(), None, factor),
        ("a back hides the sky", part("plate", plate(1.0), 0.9), Some(1.0 / PI as f32), 1.0 - factor),
    ];
    for (what, plate, sky, want) in cases {
        let mut scene = shapes::scene(&[plate, frame.clone()]);
        if let Some(radiance) = sky {
            scene = shapes::under_sky(scene, radiance);
        }
        let result = trace(&scene, &[below(&scene)], &samples(16384));
        if want == 0.0 {
            assert_eq!(result[0].mean, Rgb::ZERO, "{what}");
        } else {
            hold(mean(&result), want, 1e-5, 0.002, what);
        }
    }
}

/// A sky image whose texels hold a function of the direction at their centres.
fn sky(width: u32, height: u32, radiance: impl Fn(Vec3) -> f32) -> Sky {
    let mut pixels = Vec::new();
    for row in 0..height {
        for column in 0..width {
            let (sin, cos) = (PI as f32 * (row as f32 + 0.5) / height as f32).sin_cos();
            let (x, z) = (2.0 * PI as f32 * ((column as f32 + 0.5) / width as f32 - 0.5)).sin_cos();
            pixels.push(Rgb::splat(radiance(Vec3::new(sin * x, cos, -sin * z))));
        }
    }
    Sky::Image { image: Arc::new(Texture { width, height, pixels }), to_image: Mat3::IDENTITY }
}

fn lone_point(sky: Sky, normal: Vec3, params: &ReferenceParams) -> (f64, f64) {
    let speck = part("speck", shapes::quad(DVec3::splat(9.0), DVec3::X, DVec3::Y, 1), 0.5);
    let mut scene = shapes::scene(&[speck]);
    scene.sky = Some(sky);
    mean(&trace(&scene, &[SurfacePoint { position: Vec3::splat(-1e4), normal }], params))
}

#[test]
fn image_skies_light_from_the_right_side() {
    for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
        for (normal, want) in [(axis, PI + PI * 2.0 / 3.0), (-axis, PI - PI * 2.0 / 3.0)] {
            // ∫ (1 + a·ω) cosθ dω = π ± 2π/3 for a along the normal.
            let got = lone_point(sky(256, 128, |d| 1.0 + d.dot(axis)), normal, &samples(16384));
            // Bilinear look-up of a function of curvature 1 on texels of 2π/256: h²/8·2 = 1.5e-4 of the peak, and
            // half a texel at the poles, where rows end.
            hold(got, want, 4e-4, 0.002, &format!("sky along {axis}, normal {normal}"));
        }
    }
}

#[test]
fn small_suns_in_image_skies_are_aimed_at() {
    // A lobe exp(k(cos γ − 1)) about m, far narrower than the horizon is away: H ≈ 2π/k · m·n (1 − 1/k …).
    let k = 400.0f32;
    let m = Vec3::new(0.6, 0.64, 0.48);
    let lobe = move |d: Vec3| (k * (d.dot(m) - 1.0)).exp();
    let got = lone_point(sky(1024, 512, lobe), Vec3::Y, &samples(4096));
    // ∫ ω lobe dω = m · 2π (1/k − 1/k²) up to e^{−k·0.23}.
    let want = 2.0 * PI * f64::from(m.y) * (1.0 / f64::from(k) - 1.0 / f64::from(k * k));
    // Curvature k on texels of h = 2π/1024: bilinear look-ups add h²/12 · k ≈ 1.3e-3 in each of the two directions
    // at the peak, none in the mean, since they keep each texel's sum up to the sine's change across it, h²/4.
    hold(got, want, 2e-4, 0.002, "lobe");
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let scene = cube_of([(0.5, 0.0), (0.5, 0.0), (0.3, 0.0), (0.5, 1.0), (0.7, 0.0), (0.5, 0.0)]);
    let points = points_on(&scene, 2, 50, 1);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a small pool");
        pool.install(|| trace(&scene, &points, &samples(64)))
    };
    let one = with(1);
    assert_eq!(one, with(2));
    assert_eq!(one, with(5));
    assert_ne!(one, trace(&scene, &points, &ReferenceParams { seed: 12, ..samples(64) }), "seeds matter");
}

#[test]
fn standard_errors_are_honest() {
    let grey = (0.5, 0.0);
    let scene = cube_of([grey, grey, grey, (0.5, 1.0), grey, grey]);
    let points = points_on(&scene, 0, 200, 4);
    let truth = trace(&scene, &points, &ReferenceParams { seed: 99, ..samples(4096) });
    let result = trace(&scene, &points, &samples(64));
    let ratio: f64 = result
        .iter()
        .zip(&truth)
        .map(|(e, t)| f64::from((e.mean.x - t.mean.x) / e.standard_error.x).powi(2))
        .sum::<f64>()
        / 200.0;
    // The truth's own error adds 1/64, less than shows. Squares of Student's t with 15 degrees of freedom: mean 15/13, standard deviation about 1.9; the mean of 200 has
    // a standard error of 0.14. Four of them.
    assert!((ratio - 15.0 / 13.0).abs() < 0.54, "mean squared error over variance {ratio}");
}

#[test]
fn progress_ends_at_one_and_no_points_are_no_work() {
    let scene = cube_of([(0.5, 1.0); 6]);
    let bvh = Bvh::build(&scene);
    let heard = std::cell::RefCell::new(Vec::new());
    let points = points_on(&scene, 0, 300, 1);
    let params = ReferenceParams { max_bounces: 0, ..samples(8192) };
    irradiance(&scene, &bvh, &points, &params, |share| heard.borrow_mut().push(share));
    let heard = heard.into_inner();
    assert!(heard.len() > 1 && heard.is_sorted() && heard.last() == Some(&1.0), "{heard:?}");
    assert!(irradiance(&scene, &bvh, &[], &samples(64), |_| ()).is_empty());
}
