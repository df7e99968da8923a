//! What is true at which points: a reference beside the scene, or one of our own that is kept in the chart's folder.

use std::fmt::Write;
use std::path::Path;

use super::Request;
use crate::archive::Digest;
use crate::bake::{Monitor, Stage};
use crate::compare::known::points_on;
use crate::error::{Error, Result};
use crate::geometry::{SurfacePoint, hash, triangle};
use crate::light::Rgb;
use crate::output::points::{Column, PointTable};
use crate::rays::Bvh;
use crate::reference::{self, Estimate, ReferenceParams};
use crate::scene::Scene;

/// Points and their irradiance.
pub struct Truth {
    /// In the scene's frame.
    pub points: Vec<SurfacePoint>,
    /// W·m⁻².
    pub irradiance: Vec<Rgb>,
    /// Mean square of its standard error, over points and channels.
    pub noise: f64,
    /// Of the table it was read from.
    pub digest: Digest,
}

/// Points of references of our own.
const POINTS: usize = 2000;

/// Seed of references of our own, which nothing that is measured shares.
const SEED: u64 = 0x7e57;

/// Points traced between two looks for a signal at the most, and paths: a quarter of a second.
const BLOCK_POINTS: usize = 32;
const BLOCK_PATHS: usize = 1 << 18;

/// The truth of a scene: `reference.csv` beside it, else the one in the folder, else a new one that is left there.
pub fn of(
    path: &Path,
    (name, digest): (&str, Digest),
    scene: &Scene,
    request: &Request,
    monitor: &dyn Monitor,
) -> Result<Truth> {
    let beside = path.with_file_name("reference.csv");
    if beside.is_file() {
        return read(&beside, scene);
    }
    let own = request.folder.join(format!("{name}.{digest}.{}.csv", request.reference_paths));
    if !own.is_file() {
        make(&own, scene, request.reference_paths, monitor)?;
    }
    read(&own, scene)
}

/// Reads a table of points with `irradiance_r` … or `E_r` …, and `stderr_r` … or one `stderr` for all channels.
fn read(path: &Path, scene: &Scene) -> Result<Truth> {
    let table = PointTable::read(path)?;
    let column = |names: [&str; 2]| {
        let found = names.iter().find_map(|name| table.column(name).map(Iterator::collect::<Vec<_>>));
        let wanted = || {
            let (place, problem) =
                ("header".to_string(), format!("there is no column {}", names.join(" or ")));
            Error::input(path, place, problem, "write it by `glowtree reference`")
        };
        let number = |text: &str| {
            let bad = || Error::input(path, names[0], format!("{text:?} is no number"), "write it anew");
            text.trim().parse::<f32>().ok().filter(|v| v.is_finite()).ok_or_else(bad)
        };
        found.ok_or_else(wanted)?.into_iter().map(number).collect::<Result<Vec<f32>>>()
    };
    let rgb = |names: [[&str; 2]; 3]| -> Result<Vec<Rgb>> {
        let [r, g, b] = [column(names[0])?, column(names[1])?, column(names[2])?];
        Ok((0..r.len()).map(|k| Rgb::new(r[k], g[k], b[k])).collect())
    };
    let irradiance = rgb([["irradiance_r", "E_r"], ["irradiance_g", "E_g"], ["irradiance_b", "E_b"]])?;
    let errors = rgb([["stderr_r", "stderr"], ["stderr_g", "stderr"], ["stderr_b", "stderr"]])?;
    if irradiance.is_empty() {
        return Err(Error::input(path, "rows", "there are no points", "write it by `glowtree reference`"));
    }
    let square = errors.iter().map(|e| f64::from(e.length_squared()) / 3.0).sum::<f64>();
    Ok(Truth {
        points: table.local(&scene.placement),
        noise: square / irradiance.len() as f64,
        irradiance,
        digest: Digest::of_file(path)?,
    })
}

/// Traces points over all that reflects and does not shine, by area.
fn make(path: &Path, scene: &Scene, samples: u32, monitor: &dyn Monitor) -> Result<()> {
    let table = PointTable::from_reader(places(scene).as_bytes(), path)?;
    let points = table.local(&scene.placement);
    if points.is_empty() {
        return Err(Error::Usage("every mesh of the scene shines: there is nowhere to judge light".into()));
    }
    let estimates = traced(scene, &points, (samples, SEED), ("reference", monitor))?;
    let (means, errors): (Vec<Rgb>, Vec<Rgb>) = estimates.iter().map(|e| (e.mean, e.standard_error)).unzip();
    let ([r, g, b], [er, eg, eb]) = (Column::rgb("irradiance", &means), Column::rgb("stderr", &errors));
    table.write(path, &[r, g, b, er, eg, eb])
}

/// Points as a table, world coordinates.
fn places(scene: &Scene) -> String {
    let area = |mesh: usize| -> f64 {
        scene.meshes[mesh].triangles.clone().map(|id| f64::from(triangle::area(scene.corners(id)))).sum()
    };
    let dull: Vec<usize> =
        (0..scene.meshes.len()).filter(|&m| scene.meshes[m].radiance.max_element() == 0.0).collect();
    let total: f64 = dull.iter().map(|&mesh| area(mesh)).sum();
    let mut text = String::from("x,y,z,nx,ny,nz\n");
    for &mesh in &dull {
        let count = (POINTS as f64 * area(mesh) / total).round() as usize;
        for point in points_on(scene, mesh, count, SEED) {
            let (at, n) = (scene.placement.to_world(point.position), point.normal);
            // Writing to a String cannot fail.
            let _ = writeln!(text, "{},{},{},{},{},{}", at.x, at.y, at.z, n.x, n.y, n.z);
        }
    }
    text
}

/// Path traces points in blocks, each with random numbers of its own, and stops when a signal came.
pub fn traced(
    scene: &Scene,
    points: &[SurfacePoint],
    (samples, seed): (u32, u64),
    (name, monitor): (&str, &dyn Monitor),
) -> Result<Vec<Estimate>> {
    let stage = Stage::start(monitor, name, "points", Some(points.len() as u64));
    let bvh = Bvh::build(scene);
    let mut estimates = Vec::with_capacity(points.len());
    let block = (BLOCK_PATHS / samples as usize).clamp(1, BLOCK_POINTS);
    for (k, block) in points.chunks(block).enumerate() {
        let seed = hash::mix2(seed, k as u64);
        let params = ReferenceParams { samples, seed, ..ReferenceParams::default() };
        estimates.extend(reference::irradiance(scene, &bvh, block, &params, |_| ()));
        stage.advance(block.len() as u64)?;
    }
    stage.finish();
    Ok(estimates)
}
