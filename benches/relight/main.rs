//! Milliseconds of relighting: sums of prepared lights, and solutions for other albedos from the light of before, to 1 %.
//!
//! On the Cornell box and the rooms of the tree, lit by their emitter, two bulbs and a sky, with sites laid as densely as it takes
//! for 100,000 and for a million of them: at a target of 1 % with denser sites alone, and for the third row at a target of 0.16 %.
//! `cargo bench --bench relight -- --most 200000` leaves the million out, `--plan 2` measures the third row alone, and `lehtinen`
//! measures a scene of the size of Lehtinen's largest instead ([`lehtinen`]).

mod arcade;
mod lehtinen;

use std::path::PathBuf;

use glowtree::bake::laws::Plan;
use glowtree::bake::model::Model;
use glowtree::bake::pipeline::build;
use glowtree::bake::relight::Paint;
use glowtree::bake::{Lighting, RelightParams, Relighter, Silent, Stopwatch};
use glowtree::light::Rgb;
use glowtree::scene::{self, Lamp, LampKind, Scene, Sky};

/// Each measurement is the best of this many.
const REPEATS: usize = 15;

/// Error target, and factor of the sites' spacing beside what it asks for.
const PLANS: [(&str, f64, f32); 5] = [
    ("cornell", 0.01, 0.28),
    ("rooms", 0.01, 0.42),
    ("rooms", 0.0016, 1.0),
    ("cornell", 0.01, 0.072),
    ("rooms", 0.01, 0.09),
];

fn main() {
    let words: Vec<String> = std::env::args().collect();
    let after = |word: &str| words.iter().position(|w| w == word).and_then(|k| words.get(k + 1));
    let most: f32 = after("--most").and_then(|n| n.parse().ok()).unwrap_or(f32::INFINITY);
    if words.iter().any(|word| word == "lehtinen") {
        return lehtinen::measure().unwrap_or_else(|problem| println!("lehtinen: {problem}"));
    }
    println!("{} threads; milliseconds: best of {REPEATS}", rayon::current_num_threads());
    println!(
        "{:8} {:>6} {:>9} {:>9} {:>7} | {:>9} {:>8} | {:>8} {:>8} | {:>8} {:>8} {:>8} {:>7} | {:>9}",
        "scene",
        "target",
        "sites",
        "receivers",
        "M rays",
        "prepare s",
        "products",
        "sum ms",
        "CPU ms",
        "paint ms",
        "CPU ms",
        "products",
        "error",
        "answer ms"
    );
    let only: Option<usize> = after("--plan").and_then(|n| n.parse().ok());
    for (k, (name, error, spacing)) in PLANS.into_iter().enumerate() {
        if only.is_some_and(|only| only != k) {
            continue;
        }
        if spacing < 0.2 && most < 1e6 {
            continue;
        }
        if let Err(problem) = measure(name, error, spacing) {
            println!("{name}: {problem}");
        }
    }
}

/// The least wall-clock milliseconds of some runs, with their CPU milliseconds.
fn best(mut run: impl FnMut(usize)) -> (f64, f64) {
    let once = |k: usize| {
        let watch = Stopwatch::start();
        run(k);
        (1e3 * watch.seconds(), 1e3 * watch.cpu_seconds())
    };
    (0..REPEATS).map(once).fold((f64::INFINITY, 0.0), |best, now| if now.0 < best.0 { now } else { best })
}

/// A scene of the tree with more lights.
fn lit(name: &str) -> glowtree::Result<Scene> {
    let file: PathBuf = [env!("CARGO_MANIFEST_DIR"), "data", name, "scene.toml"].iter().collect();
    let mut scene = scene::load(&file)?;
    for (k, at) in [[0.1, 0.1, 0.1], [-0.2, 0.0, 0.1]].into_iter().enumerate() {
        let kind = LampKind::Point { position: at.into(), intensity: Rgb::splat(0.05) };
        scene.lamps.push(Lamp { name: format!("bulb{k}"), kind });
    }
    scene.sky = Some(Sky::Constant(Rgb::new(0.5, 0.6, 0.9)));
    Ok(scene)
}

fn planned(scene: Scene, error: f64, spacing: f32) -> glowtree::Result<Model> {
    let mut plan = Plan::new(error, 0);
    plan.site_spacing *= spacing;
    plan.widest_spacing *= spacing;
    // Refinement would give every site of so many its row.
    plan.site_error *= f64::from(spacing).recip();
    Ok(build(scene, &plan, None, &Silent)?.0)
}

fn measure(name: &str, error: f64, spacing: f32) -> glowtree::Result<()> {
    let model = planned(lit(name)?, error, spacing)?;
    let (sites, receivers, rays) = (model.sites.len(), model.receivers.len(), model.receivers.ray_count());
    let mut relighter = Relighter::new(model, RelightParams { seed: 0, bounces: None, error: 0.01 });
    let watch = Stopwatch::start();
    let prepared = relighter.prepare()?;
    let seconds = watch.seconds();
    let baked = relighter.baked().clone();
    let dimmed = |k: usize| -> Lighting {
        let mut lighting = baked.clone();
        lighting.meshes.iter_mut().for_each(|mesh| mesh.radiance *= 1.0 + k as f32);
        lighting
    };
    let (sum, sum_cpu) = best(|k| assert!(relighter.relight(&dimmed(k)).is_ok_and(|r| r.superposed)));
    let mesh =
        (0..baked.meshes.len()).max_by_key(|&m| relighter.scene().meshes[m].triangles.len()).unwrap_or(0);
    let painted = |k: usize| -> Lighting {
        let mut lighting = baked.clone();
        let albedo = if k.is_multiple_of(2) { Rgb::new(0.3, 0.5, 0.7) } else { Rgb::new(0.7, 0.4, 0.3) };
        lighting.meshes[mesh].paint = Paint::Plain(albedo);
        lighting
    };
    relighter.relight(&painted(1))?;
    let mut products = 0;
    let (paint, paint_cpu) =
        best(|k| products = relighter.relight(&painted(k)).map_or(0, |report| report.iterations));
    let loose = relighter.radiosity().to_vec();
    relighter.params_mut().error = 1e-6;
    relighter.relight(&painted(REPEATS - 1))?;
    let off = relative(&loose, relighter.radiosity());
    let watch = Stopwatch::start();
    relighter.model();
    println!(
        "{name:8} {:5.1}% {sites:9} {receivers:9} {:7.1} | {seconds:9.2} {:8} | {sum:8.2} {sum_cpu:8.2} | {paint:8.1} {paint_cpu:8.1} \
         {products:8} {:6.2}% | {:9.0}",
        100.0 * error,
        rays as f64 / 1e6,
        prepared.iterations,
        100.0 * off,
        1e3 * watch.seconds(),
    );
    Ok(())
}

/// RMS of the differences over that of the values.
fn relative(a: &[Rgb], b: &[Rgb]) -> f64 {
    let square = |v: Rgb| v.as_dvec3().length_squared();
    let difference: f64 = a.iter().zip(b).map(|(a, b)| square(*a - *b)).sum();
    (difference / b.iter().map(|b| square(*b)).sum::<f64>()).sqrt()
}
