//! Tighter targets, smaller true errors: a ladder of bakes of the Cornell box against the path tracer.
//!
//! Through the command line alone, as users bake: the target is what is tested, rounds and estimate included.

mod command;
mod shapes;

use std::path::Path;

use command::{Place, code, stderr};
use glowtree::geometry::triangle;
use glowtree::output::points::PointTable;
use glowtree::scene::{self, Scene};

/// Targets, percent, loosest first.
const TARGETS: [u32; 4] = [8, 4, 2, 1];

/// Points judged.
const POINTS: usize = 2000;

/// Paths a point of the reference.
const PATHS: u32 = 2048;

/// A step is said to rise when it does by more than that many standard errors. By chance alone that befalls 0.4 % of
/// all ladders of three steps whose errors stay as they are.
const SIGNIFICANT: f64 = 3.0;

fn scene_file() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/data/cornell/scene.toml"))
}

/// Points over all meshes that reflect and do not shine, by area, as a table.
fn table(scene: &Scene) -> String {
    let area = |mesh: usize| -> f32 {
        let ids = scene.meshes[mesh].triangles.clone();
        ids.map(|id| triangle::area(scene.corners(id))).sum()
    };
    let dull: Vec<usize> =
        (0..scene.meshes.len()).filter(|&m| scene.meshes[m].radiance.max_element() == 0.0).collect();
    let total: f32 = dull.iter().map(|&mesh| area(mesh)).sum();
    let mut text = String::from("x,y,z,nx,ny,nz\n");
    for &mesh in &dull {
        let count = (POINTS as f32 * area(mesh) / total).round() as usize;
        for point in shapes::points_on(scene, mesh, count, 29) {
            let (at, normal) = (scene.placement.to_world(point.position), point.normal);
            text += &format!("{},{},{},{},{},{}\n", at.x, at.y, at.z, normal.x, normal.y, normal.z);
        }
    }
    text
}

/// The named columns of a table, as RGB rows.
fn rgb(path: &Path, head: &str) -> Vec<[f64; 3]> {
    let table = PointTable::read(path).expect("a table of answers");
    let column = |channel: &str| -> Vec<f64> {
        let name = format!("{head}_{channel}");
        table.column(&name).expect("a column").map(|text| text.parse().expect("a number")).collect()
    };
    let [r, g, b] = ["r", "g", "b"].map(column);
    (0..r.len()).map(|k| [r[k], g[k], b[k]]).collect()
}

/// Mean over the channels.
fn mean_of(values: [f64; 3]) -> f64 {
    values.iter().sum::<f64>() / 3.0
}

/// Mean over the points.
fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Standard deviation over the points.
fn deviation(values: &[f64]) -> f64 {
    let centre = mean(values);
    mean(&values.iter().map(|v| (v - centre).powi(2)).collect::<Vec<_>>()).sqrt()
}

/// How many standard errors the mean square falls by from one step to the next.
///
/// `ladder` holds for each target the squared difference from the reference at each point. The points and the
/// reference are the same for all targets, so its noise, and the luck of the points, cancel from the differences
/// of squares; what is left of chance is these differences' spread over the points, divided by √n.
fn falls(ladder: &[Vec<f64>]) -> Vec<f64> {
    let fall = |step: &[Vec<f64>]| {
        let differences: Vec<f64> = step[0].iter().zip(&step[1]).map(|(a, b)| a - b).collect();
        let doubt = deviation(&differences) / (differences.len() as f64).sqrt();
        mean(&differences) / doubt.max(f64::MIN_POSITIVE)
    };
    ladder.windows(2).map(fall).collect()
}

/// Squared differences of a bake at one target, mean over channels.
fn judged(place: &Place, target: u32, truth: &[[f64; 3]]) -> Vec<f64> {
    let (job, out) = (format!("job{target}"), format!("out{target}.csv"));
    let scene = scene_file().to_str().expect("a path in UTF-8");
    let error = format!("{target}%");
    let baked =
        place.run(&["bake", scene, "-o", &job, "--error", &error, "--seed", "1", "--no-preview", "-q"]);
    assert_eq!(code(&baked), 0, "bake at {target} %: {}", stderr(&baked));
    let probed = place.run(&["probe", &job, "--points", "points.csv", "-o", &out, "-q"]);
    assert_eq!(code(&probed), 0, "probe at {target} %: {}", stderr(&probed));
    let square = |(got, want): (&[f64; 3], &[f64; 3])| {
        mean_of([0, 1, 2].map(|channel| (got[channel] - want[channel]).powi(2)))
    };
    rgb(&place.path(&out), "irradiance").iter().zip(truth).map(square).collect()
}

/// The reference at the points, and the mean square of its standard error.
fn traced(place: &Place) -> (Vec<[f64; 3]>, f64) {
    let (scene, paths) = (scene_file().to_str().expect("a path in UTF-8"), PATHS.to_string());
    let words = ["reference", scene, "--points", "points.csv", "--spp", &paths, "-o", "truth.csv", "-q"];
    let traced = place.run(&words);
    assert_eq!(code(&traced), 0, "reference: {}", stderr(&traced));
    let errors = rgb(&place.path("truth.csv"), "stderr");
    let noise: Vec<f64> = errors.iter().map(|e| mean_of(e.map(|v| v * v))).collect();
    (rgb(&place.path("truth.csv"), "irradiance"), mean(&noise))
}

fn percent(error: f64) -> String {
    format!("{:.3} %", 100.0 * error)
}

/// Prints every step of the ladder; returns those that rise.
fn risen(errors: &[f64], falls: &[f64]) -> Vec<String> {
    let told = |k: usize| {
        let (from, to) = (percent(errors[k]), percent(errors[k + 1]));
        let step = format!("{} % to {} %: true error {from} to {to}", TARGETS[k], TARGETS[k + 1]);
        println!("{step}, a fall of {:.1} standard errors", falls[k]);
        step
    };
    let steps: Vec<String> = (0..falls.len()).map(told).collect();
    steps.into_iter().zip(falls).filter(|(_, fall)| **fall < -SIGNIFICANT).map(|(step, _)| step).collect()
}

#[test]
fn tighter_targets_have_smaller_errors() {
    let place = Place::new();
    let scene = scene::load(scene_file()).expect("the Cornell box");
    std::fs::write(place.path("points.csv"), table(&scene)).expect("writing the points");
    let (truth, noise) = traced(&place);
    let level = mean(&truth.iter().map(|&e| mean_of(e)).collect::<Vec<_>>());
    let ladder: Vec<Vec<f64>> = TARGETS.iter().map(|&target| judged(&place, target, &truth)).collect();

    let error_of = |squares: &Vec<f64>| (mean(squares) - noise).max(0.0).sqrt() / level;
    let errors: Vec<f64> = ladder.iter().map(error_of).collect();
    println!("noise of the reference {}", percent(noise.sqrt() / level));

    let risen = risen(&errors, &falls(&ladder));
    assert!(risen.is_empty(), "the true error rises although the target is tighter: {}", risen.join("; "));
    for ((target, error), squares) in TARGETS.iter().zip(&errors).zip(&ladder) {
        // The mean of n squares has a standard error of their deviation over √n, its root that over twice the root.
        let doubt = deviation(squares) / (POINTS as f64).sqrt() / (2.0 * error * level * level);
        let limit = f64::from(*target) / 100.0 + SIGNIFICANT * doubt;
        println!("{target} %: {} ± {}", percent(*error), percent(doubt));
        assert!(*error < limit, "a target of {target} % ended at {}", percent(*error));
    }
    // Rows grow as 1/error, so that their noise alone falls by √8 = 2.8 from 8 % to 1 %, interpolation by 8. Half of
    // 2.8 is the least that a knob of quality must do; a knob that does nothing stays near 1.
    assert!(
        errors[3] < errors[0] * (2.0 / 8.0f64.sqrt()),
        "eight times tighter: {} to {} only",
        percent(errors[0]),
        percent(errors[3])
    );
}

/// Ladders that rise are noticed and the step is named; chance is not taken for a rise.
#[test]
fn a_ladder_that_rises_is_noticed() {
    let mut stream = glowtree::geometry::hash::Stream::new(7, 0);
    // Squares of errors of size 1 and as much noise of a reference shared by both steps.
    let mut step = |size: f64, shared: &[f64]| -> Vec<f64> {
        let own = |noise: &f64| (size * 3.46 * (f64::from(stream.unit()) - 0.5) + noise).powi(2);
        shared.iter().map(own).collect()
    };
    let noise: Vec<f64> = (0..POINTS).map(|k| ((k as f64 * 0.618).fract() - 0.5) * 3.46).collect();
    let [one, again, larger] = [1.0, 1.0, 1.2].map(|size| step(size, &noise));
    let falls_of = |a: &Vec<f64>, b: &Vec<f64>| falls(&[a.clone(), b.clone()])[0];
    // The mean square rises from 2 to 2.44. Squares of the sum of two uniform values of variance 1 have a variance of
    // 2 · 1.8 + 6 − 4 = 5.6; two of them in a difference, were they independent: √(11.2 / 2000) = 0.075. A rise of six.
    assert!(falls_of(&one, &larger) < -SIGNIFICANT, "{} standard errors", falls_of(&one, &larger));
    assert!(falls_of(&larger, &one) > SIGNIFICANT);
    assert!(falls_of(&one, &again).abs() < SIGNIFICANT, "{} standard errors", falls_of(&one, &again));
    let named = risen(&[0.02, 0.01, 0.03], &[5.0, -5.0]);
    assert!(named.len() == 1 && named[0].starts_with("4 % to 2 %"), "{named:?}");
}
