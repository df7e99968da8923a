//! Sites per second and processor time a site: uniform and graded spacing, 100 thousand and a million sites.
//!
//! On a bumpy sphere of 82 thousand triangles, a big box of twelve, and every mesh named on the command line:
//! `cargo bench --bench sites -- mesh.ply`.

use std::path::Path;
use std::time::Instant;

use cpu_time::ProcessTime;
use glam::{DVec3, Vec3};
use glowtree::bake::pipeline::leaf_order;
use glowtree::geometry::SurfacePoint;
use glowtree::light::Rgb;
use glowtree::rays::Bvh;
use glowtree::scatter::Candidate;
use glowtree::scatter::surface::Surface;
use glowtree::scene::{Albedo, Mesh, Placement, Scene};
use glowtree::sites::{SiteParams, Sites};

#[allow(dead_code)] // Rays are for another bench.
mod shapes;

/// Each measurement is the best of this many.
const REPEATS: usize = 3;

fn main() {
    println!(
        "{:28} {:>9} {:>9} {:>12} {:>12} {:>14}",
        "", "sites", "wall s", "sites/s", "cpu us/site", "ns/nearest"
    );
    let mut scenes = vec![
        ("bumpy sphere".to_string(), scene_of(shapes::bumpy_sphere(6))),
        ("box".to_string(), scene_of(cuboid(Vec3::new(2.0, 1.0, 1.5)))),
    ];
    for file in std::env::args().skip(1).filter(|a| !a.starts_with("--")) {
        match glowtree::scene::load(Path::new(&file)) {
            Ok(mut scene) => {
                scene.meshes.iter_mut().for_each(|mesh| mesh.two_sided = false);
                let name = Path::new(&file).file_stem().map_or(String::new(), |s| s.to_string_lossy().into());
                scenes.push((name, scene));
            }
            Err(error) => println!("{file}: {error}"),
        }
    }
    for (name, scene) in &scenes {
        let bvh = Bvh::build_triangles(&scene.vertices, &scene.triangles);
        let surface = Surface::new(scene, leaf_order(&bvh));
        for (coarsest, level) in [(98, 5), (61, 7)] {
            // `coarsest` · 4^level sites: 100 thousand, a million.
            let uniform = |_: &Candidate| f32::powi(0.5, level);
            measure(&format!("{name}, uniform"), &surface, coarsest, uniform);
            // Eight times finer at one end than at the other.
            let graded = |c: &Candidate| {
                f32::powi(0.5, level) * (0.5 + 2.0 * (1.0 + c.point.position.x).clamp(0.0, 2.0))
            };
            measure(&format!("{name}, graded"), &surface, coarsest, graded);
        }
    }
}

/// Scatters with `share` of the first level's spacing wanted, and looks up the nearest site of many points.
fn measure(name: &str, surface: &Surface<'_>, coarsest: usize, share: impl Fn(&Candidate) -> f32 + Sync) {
    let params = SiteParams { coarsest, ..SiteParams::default() };
    let first = (0.76 * surface.area() / coarsest as f64).sqrt() as f32;
    let wanted = |c: &Candidate| Some(first * share(c));
    let mut best = (f64::INFINITY, f64::INFINITY);
    let mut last = None;
    for _ in 0..REPEATS {
        drop(last.take());
        let (cpu, wall) = (ProcessTime::now(), Instant::now());
        last = Some(Sites::scatter(surface, &params, &[], wanted).0);
        let (cpu, wall) = (cpu.elapsed().as_secs_f64(), wall.elapsed().as_secs_f64());
        best = (best.0.min(wall), best.1.min(cpu));
    }
    let Some(sites) = last else { return };
    let count = sites.len() as f64;
    println!(
        "{name:28} {:9} {:9.3} {:12.0} {:12.2} {:14.0}",
        sites.len(),
        best.0,
        count / best.0,
        best.1 * 1e6 / count,
        nearest(surface, &sites)
    );
}

/// Nanoseconds a look-up takes, for points in random order.
fn nearest(surface: &Surface<'_>, sites: &Sites) -> f64 {
    let scene = surface.scene();
    let mesh = (scene.vertices.clone(), scene.triangles.clone());
    let mut stream = glowtree::geometry::hash::Stream::new(5, 0);
    let points: Vec<SurfacePoint> = (0..200_000)
        .map(|_| {
            let (position, normal) = shapes::surface_point(&mesh, &mut stream);
            SurfacePoint { position, normal }
        })
        .collect();
    let started = ProcessTime::now();
    let found = points.iter().filter(|p| sites.nearest(p).is_some()).count();
    assert!(found * 10 > points.len() * 9, "only {found} of {} points have a site", points.len());
    started.elapsed().as_secs_f64() * 1e9 / points.len() as f64
}

fn cuboid(size: Vec3) -> shapes::Mesh {
    let corner = |i: u32| (Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) - 0.5) * size;
    let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    ((0..8).map(corner).collect(), triangles)
}

fn scene_of((vertices, triangles): shapes::Mesh) -> Scene {
    let mesh = Mesh {
        name: "shape".to_string(),
        file: "shape".into(),
        triangles: 0..triangles.len() as u32,
        vertices: 0..vertices.len() as u32,
        two_sided: false,
        albedo: Albedo::Constant(Rgb::ONE * 0.7),
        radiance: Rgb::ZERO,
        normals: None,
    };
    Scene {
        placement: Placement { origin: DVec3::ZERO, scale: 1.0 },
        vertices,
        triangles,
        meshes: vec![mesh],
        sky: None,
        lamps: vec![],
        cameras: vec![],
        up: Vec3::Y,
        warnings: vec![],
    }
}
