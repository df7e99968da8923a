//! The scene comparable to the largest of Lehtinen et al., "A Meshless Hierarchical Representation for Light Transport", 2008, who
//! report 7 to 21 frames a second on up to 2.3 million triangles after about half an hour of precomputation.
//!
//! What is measured of ours: the bake with its error against the path tracer, and frames of sites' light by sums of prepared
//! lights, by full solutions from the light before, and for a lamp that moves.

use glowtree::bake::relight::Paint;
use glowtree::bake::{self, Lighting, Options, Relighter, Silent, Stopwatch, usage};
use glowtree::error::{Error, Result};
use glowtree::geometry::{SurfacePoint, hash, triangle};
use glowtree::light::{Rgb, mean_channel};
use glowtree::rays::Bvh;
use glowtree::reference::{self, ReferenceParams};
use glowtree::scene::{LampKind, Scene};

use super::arcade;

/// The bake's target.
const ERROR: f64 = 0.02;

/// Points that are compared with the path tracer, and its paths for each.
const POINTS: u32 = 300;
const PATHS: u32 = 4096;

/// Frames of each kind.
const FRAMES: usize = 40;

/// Solutions are good to this.
const LOOSE: f64 = 0.01;

pub fn measure() -> Result<()> {
    let folder = tempfile::tempdir().map_err(|e| Error::io("a temporary folder", "making", e))?;
    arcade::write(folder.path())?;
    let job = folder.path().join("job.glow");
    // All in memory, as it is for the compared.
    let options = Options { error: ERROR, preview: false, resident: Some(u64::MAX), ..Options::default() };
    let baked = bake::run(&folder.path().join("scene.toml"), &job, &options, &Silent)?;
    println!(
        "{} threads; {} triangles, {} sites, {} links, {} rays",
        rayon::current_num_threads(),
        baked.triangles,
        baked.sites,
        baked.links,
        baked.rays
    );
    let gigabytes = |bytes: u64| bytes as f64 / 1e9;
    println!(
        "bake: {:.1} s, {:.1} CPU s, {:.2} GB at most, archives {:.3} GB, claims {:.2} %",
        baked.usage.seconds,
        baked.usage.cpu_seconds,
        gigabytes(baked.usage.peak_anonymous_bytes),
        gigabytes(baked.archive_bytes),
        100.0 * baked.estimated_error
    );
    let watch = Stopwatch::start();
    let mut relighter = Relighter::open(&job)?;
    println!("read in {:.2} s", watch.seconds());
    judge(&mut relighter);
    solved(&mut relighter)?;
    moved(&mut relighter)?;
    // The bulb is back where it was.
    relighter.relight(&relighter.baked().clone())?;
    let watch = Stopwatch::start();
    let report = relighter.prepare()?;
    println!(
        "lights solved one by one: {:.2} s, {:.2} CPU s, {} products",
        watch.seconds(),
        watch.cpu_seconds(),
        report.iterations
    );
    summed(&mut relighter)?;
    println!("{:.2} GB held", gigabytes(usage::resident().anonymous_bytes));
    Ok(())
}

/// The error against the path tracer at points of all surfaces, by area.
fn judge(relighter: &mut Relighter) {
    let watch = Stopwatch::start();
    let model = relighter.model();
    let points = points(&model.scene);
    let params = ReferenceParams { samples: PATHS, seed: 7, ..ReferenceParams::default() };
    let truth = reference::irradiance(&model.scene, &Bvh::build(&model.scene), &points, &params, |_| {});
    let reference_seconds = watch.seconds();
    let watch = Stopwatch::start();
    let ours = relighter.evaluate(&points);
    let probe_seconds = watch.seconds();
    let count = f64::from(POINTS);
    let level = truth.iter().map(|t| f64::from(mean_channel(t.mean))).sum::<f64>() / count;
    let square = |v: f32| f64::from(v).powi(2);
    let pairs = || ours.iter().zip(&truth);
    let error = pairs().map(|(o, t)| square(mean_channel(o.total() - t.mean))).sum::<f64>();
    let noise = truth.iter().map(|t| square(mean_channel(t.standard_error))).sum::<f64>();
    let share = |sum: f64| 100.0 * (sum / count).sqrt() / level;
    println!(
        "error at {POINTS} points: {:.2} % of the mean, of which the path tracer's own {:.2} % ({PATHS} paths each, {reference_seconds:.0} s; \
         answered in {:.0} ms)",
        share(error),
        share(noise),
        1e3 * probe_seconds
    );
}

/// Points on surfaces, by area.
fn points(scene: &Scene) -> Vec<SurfacePoint> {
    let mut sum = 0.0;
    let area = |k: usize| {
        let [a, b, c] = scene.corners(k as u32);
        sum += 0.5 * f64::from((b - a).cross(c - a).length());
        sum
    };
    let areas: Vec<f64> = (0..scene.triangles.len()).map(area).collect();
    let point = |k: u32| {
        let at = f64::from(hash::unit(11, u64::from(k))) * sum;
        let id = areas.partition_point(|&sum| sum <= at).min(areas.len() - 1) as u32;
        let [u, v] = hash::unit_pair(12, u64::from(k));
        let [u, v] = if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] };
        SurfacePoint { position: triangle::point(scene.corners(id), u, v), normal: scene.normal(id) }
    };
    (0..POINTS).map(point).collect()
}

/// Frames a second of some lightings, each changed from the one before.
fn frames(relighter: &mut Relighter, what: &str, lighting: impl Fn(usize, &mut Lighting)) -> Result<()> {
    let mut lightings = vec![relighter.baked().clone(); FRAMES];
    lightings.iter_mut().enumerate().for_each(|(k, own)| lighting(k, own));
    relighter.relight(&lightings[FRAMES - 1])?;
    let (mut products, mut rays, mut best) = (0, 0, f64::INFINITY);
    let watch = Stopwatch::start();
    for own in &lightings {
        let frame = Stopwatch::start();
        let report = relighter.relight(own)?;
        best = best.min(frame.seconds());
        (products, rays) = (products + report.iterations, rays + report.rays);
    }
    let (seconds, cpu_seconds) = (watch.seconds(), watch.cpu_seconds());
    let count = FRAMES as f64;
    println!(
        "{what}: {:.1} frames/s ({:.2} ms, {:.2} CPU ms, best {:.2} ms; {:.1} products and {:.0} rays a frame)",
        count / seconds,
        1e3 * seconds / count,
        1e3 * cpu_seconds / count,
        1e3 * best,
        products as f64 / count,
        rays as f64 / count
    );
    let watch = Stopwatch::start();
    relighter.model();
    println!("  ready to answer anywhere after {:.0} ms more", 1e3 * watch.seconds());
    Ok(())
}

/// A number that swings over the frames, about 1.
fn swing(frame: usize, phase: f32) -> f32 {
    1.0 + 0.8 * (0.7 * frame as f32 + phase).sin()
}

fn dimmed(frame: usize, lighting: &mut Lighting) {
    for (k, mesh) in lighting.meshes.iter_mut().enumerate() {
        mesh.radiance *= swing(frame, k as f32);
    }
    for (k, lamp) in lighting.lamps.iter_mut().enumerate() {
        if let LampKind::Point { intensity, .. } | LampKind::Sun { irradiance: intensity, .. } = lamp {
            *intensity *= Rgb::new(swing(frame, k as f32), swing(frame, k as f32 + 1.0), 1.0);
        }
    }
}

fn summed(relighter: &mut Relighter) -> Result<()> {
    frames(relighter, "sums: all lights change strength and colour", dimmed)
}

fn solved(relighter: &mut Relighter) -> Result<()> {
    let params = *relighter.params_mut();
    relighter.params_mut().error = LOOSE;
    frames(relighter, "solved to 1 %: all lights change strength and colour", dimmed)?;
    frames(relighter, "solved to 1 %: the panel alone", |k, own| {
        own.meshes.iter_mut().for_each(|mesh| mesh.radiance *= swing(k, 0.0));
    })?;
    frames(relighter, "solved to 1 %: walls repainted", |k, own| {
        let colour = Rgb::new(0.5, 0.5, 0.4) * Rgb::new(swing(k, 0.0), swing(k, 2.0), swing(k, 4.0));
        own.meshes[1].paint = Paint::Plain(colour.min(Rgb::splat(0.9)));
    })?;
    *relighter.params_mut() = params;
    Ok(())
}

fn moved(relighter: &mut Relighter) -> Result<()> {
    let params = *relighter.params_mut();
    relighter.params_mut().error = LOOSE;
    let step = 0.1 / relighter.scene().placement.scale as f32;
    frames(relighter, "solved to 1 %: the bulb moves by 10 cm a frame", |k, own| {
        if let LampKind::Point { position, .. } = &mut own.lamps[1] {
            position.x += step * k as f32;
        }
    })?;
    *relighter.params_mut() = params;
    Ok(())
}
