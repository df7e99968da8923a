//! How well skies are known by four bands of their harmonics: a scene is baked under an even sky with its own lights off, and relit by
//! sums of transfers, against paths traced under each sky's bands, and under the sky itself.
//!
//! `cargo run --release --example sky -- data/cornell/scene.toml ../shared/data/env/pmndrs-venice.exr …`

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use glam::Vec3;
use glowtree::bake::pipeline::{Target, reach};
use glowtree::bake::relight::{SkyImage, SkyLight};
use glowtree::bake::{Options, RelightParams, Relighter, Silent};
use glowtree::error::{Error, Result};
use glowtree::geometry::{SurfacePoint, hash, triangle};
use glowtree::light::harmonics::Harmonics;
use glowtree::light::{Rgb, mean_channel};
use glowtree::rays::Bvh;
use glowtree::reference::{ReferenceParams, irradiance};
use glowtree::scene::{self, Scene, Sky, Texture, sky};
use glowtree::solve::Irradiance;

/// Points that are judged, and paths of each.
const POINTS: u64 = 600;
const PATHS: u32 = 16_384;

/// Of the bake.
const ERROR: f64 = 0.02;

/// Rows of images of harmonics.
const ROWS: u32 = 256;

fn main() -> Result<()> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let Some((path, skies)) = words.split_first() else {
        return Err(Error::Usage("sky SCENE IMAGE…".into()));
    };
    let mut scene = scene::load(Path::new(path))?;
    scene.meshes.iter_mut().for_each(|mesh| mesh.radiance = Rgb::ZERO);
    scene.lamps.clear();
    scene.sky = Some(Sky::Constant(Rgb::ONE));
    let options = Options::default();
    let target = Target {
        error: ERROR,
        seed: options.seed,
        bounces: None,
        basis: options.basis,
        operator: options.operator,
        relightable: false,
    };
    let (model, plan, report) = reach(&scene, &target, &Silent)?;
    println!("{} sites, estimated error {:.2} %", model.sites.len(), 100.0 * report.estimate.error);
    let params = RelightParams { seed: plan.sites.seed, bounces: None, error: plan.tolerance };
    let mut relighter = Relighter::new(model, params);
    let started = Instant::now();
    let report = relighter.prepare_sky(4)?;
    println!("16 transfers: {:.2} s, {} products", started.elapsed().as_secs_f64(), report.iterations);
    let points = points(&mut relighter, &scene);
    for file in skies {
        judge(&mut relighter, (&mut scene, &points), Path::new(file))?;
    }
    Ok(())
}

/// One sky: its bands by transfers and by paths, and the sky itself by paths.
fn judge(
    relighter: &mut Relighter,
    (scene, points): (&mut Scene, &[SurfacePoint]),
    file: &Path,
) -> Result<()> {
    let image = SkyImage::read(file)?;
    let own = Harmonics::project(image.texture.width as usize, &image.texture.pixels, 4);
    // Light that is nowhere negative: a constant is added where bands ring below nought.
    let least = sky::panorama(&own, ROWS).pixels.into_iter().fold(Rgb::ZERO, Vec3::min);
    let mut lifted = own.clone();
    lifted.coefficients[0] += Harmonics::constant(-least, 1).coefficients[0];
    let banded = Arc::new(sky::panorama(&lifted, ROWS));
    let bands = by_harmonics(relighter, points, &banded)?;
    let whole = by_harmonics(relighter, points, &image.texture)?;
    let bvh = Bvh::build(scene);
    let mut traced = |image: &Arc<Texture>| {
        let to_image = sky::to_image(scene.up, 0.0);
        scene.sky = Some(Sky::Image { image: Arc::clone(image), to_image });
        let params = ReferenceParams { samples: PATHS, ..ReferenceParams::default() };
        let found = irradiance(scene, &bvh, points, &params, |_| {});
        found.into_iter().map(|e| (e.mean, e.standard_error)).collect::<Vec<_>>()
    };
    let (banded_truth, truth) = (traced(&banded), traced(&image.texture));
    let name = file.file_stem().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let (error, noise) = off(&bands, &banded_truth);
    let (cut, cut_noise) = off(&whole, &truth);
    println!(
        "{name}: lifted by {:.3}; four bands {:.2} % off (paths {:.2} %), the whole sky {:.1} % (paths {:.2} %)",
        mean_channel(-least),
        100.0 * error,
        100.0 * noise,
        100.0 * cut,
        100.0 * cut_noise
    );
    Ok(())
}

/// Irradiance under an image seen by four bands.
fn by_harmonics(
    relighter: &mut Relighter,
    points: &[SurfacePoint],
    image: &Arc<Texture>,
) -> Result<Vec<Rgb>> {
    let image = Some(SkyImage { texture: Arc::clone(image), warnings: Vec::new() });
    let mut lighting = relighter.baked().clone();
    lighting.sky = Some(SkyLight { constant: None, image, harmonics: Some(4), ..SkyLight::DARK });
    let started = Instant::now();
    let report = relighter.relight(&lighting)?;
    assert!(report.superposed, "transfers were prepared");
    println!("  relit in {:.2} ms", 1e3 * started.elapsed().as_secs_f64());
    Ok(relighter.evaluate(points).iter().map(Irradiance::total).collect())
}

/// RMS difference of the mean channel over the mean, the paths' own noise taken off, and that noise.
fn off(found: &[Rgb], truth: &[(Rgb, Rgb)]) -> (f64, f64) {
    let count = found.len() as f64;
    let level = truth.iter().map(|(mean, _)| f64::from(mean_channel(*mean))).sum::<f64>() / count;
    let square: f64 =
        found.iter().zip(truth).map(|(a, (b, _))| f64::from(mean_channel(*a - *b)).powi(2)).sum();
    let noise: f64 = truth.iter().map(|(_, e)| f64::from(mean_channel(*e)).powi(2)).sum();
    (((square - noise) / count).max(0.0).sqrt() / level, (noise / count).sqrt() / level)
}

/// Points that see some of an even sky's light, spread by area.
fn points(relighter: &mut Relighter, scene: &Scene) -> Vec<SurfacePoint> {
    let mut sum = 0.0;
    let cumulative: Vec<f64> = (0..scene.triangles.len() as u32)
        .map(|t| {
            sum += f64::from(triangle::area(scene.corners(t)));
            sum
        })
        .collect();
    let point = |k: u64| {
        let want = f64::from(hash::unit(11, k)) * sum;
        let t = cumulative.partition_point(|&c| c <= want).min(cumulative.len() - 1) as u32;
        let [u, v] = hash::unit_pair(12, k);
        let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
        let [a, b, c] = scene.corners(t);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        SurfacePoint { position: triangle::point([a, b, c], u, v), normal }
    };
    let all: Vec<SurfacePoint> = (0..4 * POINTS).map(point).collect();
    let lights = relighter.evaluate(&all);
    let lit = all.into_iter().zip(lights).filter(|(_, light)| light.total().max_element() > 1.0e-3);
    lit.map(|(point, _)| point).take(POINTS as usize).collect()
}
