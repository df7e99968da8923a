//! Lights that are dim or off when a scene is baked for relighting: each by itself, and all at once, within the error target.

#![allow(clippy::unwrap_used)] // a test that cannot go on panics where it stands

use std::path::{Path, PathBuf};

use glowtree::bake::{self, Options, Relighter, Silent, Summary};
use glowtree::compare::known::points_on;
use glowtree::geometry::SurfacePoint;
use glowtree::light::Rgb;
use glowtree::rays::Bvh;
use glowtree::reference::{Estimate, ReferenceParams, irradiance};
use glowtree::scene::{self, LampKind, Scene};

/// Relative RMS error of irradiance that is asked for.
const TARGET: f64 = 0.02;

/// A bulb low behind the door and a spot on the floor of the lit one, neither of which gives light.
const OFF: &str = "\n[[lamp]]\nkind = \"point\"\nname = \"bulb\"\nposition = [4.4, 0.25, 2.6]\nintensity = [0, 0, 0]\n\
    \n[[lamp]]\nkind = \"spot\"\nname = \"spot\"\nposition = [1.0, 2.3, 1.0]\ndirection = [0.3, -1.0, 0.4]\nangle = 50\nblend = 0.3\n\
    intensity = [0, 0, 0]\n";

/// The rooms of the tree with lamps that are off, in a folder.
fn rooms() -> (tempfile::TempDir, PathBuf) {
    let data: PathBuf = [env!("CARGO_MANIFEST_DIR"), "data", "rooms"].iter().collect();
    let folder = tempfile::tempdir().unwrap();
    for entry in std::fs::read_dir(&data).unwrap() {
        let path = entry.unwrap().path();
        std::fs::copy(&path, folder.path().join(path.file_name().unwrap())).unwrap();
    }
    let file = folder.path().join("scene.toml");
    let text = std::fs::read_to_string(&file).unwrap() + OFF;
    std::fs::write(&file, text).unwrap();
    (folder, file)
}

/// One light of the scene by itself, at one.
fn alone(scene: &Scene, name: &str) -> Scene {
    let mut scene = scene.clone();
    for mesh in &mut scene.meshes {
        mesh.radiance = if mesh.name == name { Rgb::ONE } else { Rgb::ZERO };
    }
    scene.lamps.retain(|lamp| lamp.name == name);
    for lamp in &mut scene.lamps {
        let (LampKind::Sun { irradiance: light, .. }
        | LampKind::Point { intensity: light, .. }
        | LampKind::Spot { intensity: light, .. }) = &mut lamp.kind;
        // W·sr⁻¹ over squared metres is what stays.
        *light = Rgb::splat((scene.placement.scale.powi(-2)) as f32);
    }
    scene
}

/// What path tracing says of each light by itself.
fn truths(scene: &Scene, lights: &[&str], points: &[SurfacePoint]) -> Vec<Vec<Estimate>> {
    let params = ReferenceParams { samples: 8192, ..ReferenceParams::default() };
    let truth = |name: &&str| {
        let scene = alone(scene, name);
        irradiance(&scene, &Bvh::build(&scene), points, &params, |_| ())
    };
    lights.iter().map(truth).collect()
}

/// The relative RMS error of a job's answers with lights of some weights, the references' noise taken out, and how well it is
/// known: the standard error of the mean of squares.
fn error(job: &mut Relighter, lights: &[(&str, f32, &[Estimate])], points: &[SurfacePoint]) -> (f64, f64) {
    let mut lighting = job.baked().clone();
    for (name, weight, _) in lights {
        let key = if *name == "light" { "radiance" } else { "intensity" };
        lighting.set(job.scene(), &format!("{name}.{key}={weight}")).unwrap();
    }
    let report = job.relight(&lighting).unwrap();
    assert!(report.converged && report.warnings.is_empty(), "{report:?}");
    let answers = job.evaluate(points);
    let (mut squares, mut sum) = (Vec::new(), 0.0);
    for (k, answer) in answers.iter().enumerate() {
        let square = |v: glam::Vec3| f64::from(v.length_squared()) / 3.0;
        let truth: Rgb = lights.iter().map(|(_, w, truth)| truth[k].mean * *w).sum();
        let noise: f64 = lights.iter().map(|(_, w, truth)| square(truth[k].standard_error * *w)).sum();
        squares.push(square(answer.total() - truth) - noise);
        sum += f64::from(truth.element_sum()) / 3.0;
    }
    let n = points.len() as f64;
    let (mean, square) = (sum / n, squares.iter().sum::<f64>() / n);
    let spread = (squares.iter().map(|s| (s - square).powi(2)).sum::<f64>()).sqrt() / n;
    let error = square.max(0.0).sqrt();
    (error / mean, spread / (2.0 * error.max(f64::MIN_POSITIVE)) / mean)
}

fn bake_to(file: &Path, job: &Path, relightable: Option<bool>) -> Summary {
    let options = Options { error: TARGET, preview: false, relightable, ..Options::default() };
    bake::run(file, job, &options, &Silent).unwrap()
}

#[test]
fn every_light_is_within_the_target_by_itself_and_with_others() {
    let (folder, file) = rooms();
    let scene = scene::load(&file).unwrap();
    let points: Vec<SurfacePoint> =
        (0..3).flat_map(|mesh| points_on(&scene, mesh, [300, 50, 50][mesh], 5)).collect();
    let names = ["light", "bulb", "spot"];
    let truths = truths(&scene, &names, &points);
    let mixes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.3, 1.0, 0.1], [0.0, 0.02, 1.0]];
    let job = folder.path().join("job");
    let summary = bake_to(&file, &job, None);
    let judged: Vec<&str> = summary.lights.iter().map(|light| light.name.as_str()).collect();
    assert_eq!(judged, names, "lights that are off are judged like others");
    for mix in mixes {
        let mut relighter = Relighter::open(&job).unwrap();
        let lights: Vec<_> = (0..3).map(|k| (names[k], mix[k], &truths[k][..])).collect();
        let (error, doubt) = error(&mut relighter, &lights, &points);
        println!("{mix:?}: {:.2} +- {:.2} %", 100.0 * error, 100.0 * doubt);
        // Without --relightable the bulb is known to 2.23 %, and to 2.08 % with the others. Here 1.62 % at the worst.
        assert!(error <= TARGET, "{mix:?}: {error}");
    }
}

#[test]
fn scenes_of_several_lights_are_made_for_relighting_unless_told_otherwise() {
    let (folder, file) = rooms();
    let job = |name: &str| folder.path().join(name);
    let bake = |scene: &Path, name: &str, choice: Option<bool>| {
        let options = Options { error: 0.2, preview: false, relightable: choice, ..Options::default() };
        bake::run(scene, &job(name), &options, &Silent).unwrap().lights.len()
    };
    assert_eq!(bake(&file, "three", None), 3);
    assert_eq!(bake(&file, "plain", Some(false)), 0);
    let text = std::fs::read_to_string(&file).unwrap().replace(OFF, "");
    let one = folder.path().join("one.toml");
    std::fs::write(&one, text).unwrap();
    assert_eq!([bake(&one, "one", None), bake(&one, "asked", Some(true))], [0, 1]);
    let warned = |name: &str| {
        let mut relighter = Relighter::open(&job(name)).unwrap();
        let mut lighting = relighter.baked().clone();
        lighting.set(relighter.scene(), "bulb.intensity=1").unwrap();
        relighter.relight(&lighting).unwrap().warnings
    };
    assert!(warned("three").is_empty(), "the bulb was off, but is known");
    assert!(warned("plain")[0].contains("bulb gave no light when baked"), "{:?}", warned("plain"));
}
