//! The side of the comparison that runs glowtree: writes a mesh and rays for `embree_rays`, and times the same rays.
//!
//! `dump DIR LEVELS RAYS` writes; `time DIR` measures. See the README beside this file.

#[allow(dead_code)]
#[path = "../../benches/shapes/mod.rs"]
mod shapes;

use std::fs;
use std::io::Write as _;
use std::path::Path;

use cpu_time::ThreadTime;
use glam::Vec3;
use glowtree::rays::{Bvh, Ray};

fn main() -> std::io::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["dump", directory, levels, rays] => {
            let number = |text: &str| text.parse().map_err(std::io::Error::other);
            dump(Path::new(directory), number(levels)? as u32, number(rays)?)
        }
        ["time", directory] => time(Path::new(directory)),
        _ => {
            println!("usage: dump DIR LEVELS RAYS | time DIR");
            Ok(())
        }
    }
}

fn dump(directory: &Path, levels: u32, count: usize) -> std::io::Result<()> {
    fs::create_dir_all(directory)?;
    let mesh = shapes::bumpy_sphere(levels);
    let mut file = fs::File::create(directory.join("mesh.bin"))?;
    file.write_all(bytemuck::bytes_of(&[mesh.0.len() as u64, mesh.1.len() as u64]))?;
    file.write_all(bytemuck::cast_slice(&mesh.0))?;
    file.write_all(bytemuck::cast_slice(&mesh.1))?;
    write_rays(&directory.join("segments.bin"), &shapes::segments(&mesh, count, 1))?;
    write_rays(&directory.join("hemispheres.bin"), &shapes::hemispheres(&mesh, count, 1))
}

fn write_rays(file: &Path, rays: &[Ray]) -> std::io::Result<()> {
    let flat: Vec<[f32; 8]> = rays
        .iter()
        .map(|r| {
            let ([ox, oy, oz], [dx, dy, dz]) = (r.origin.to_array(), r.direction.to_array());
            [ox, oy, oz, r.t_min, dx, dy, dz, r.t_max]
        })
        .collect();
    fs::write(file, bytemuck::cast_slice(&flat))
}

fn read_rays(file: &Path) -> std::io::Result<Vec<Ray>> {
    let bytes = fs::read(file)?;
    let ray = |f: [f32; 8]| Ray {
        origin: Vec3::new(f[0], f[1], f[2]),
        direction: Vec3::new(f[4], f[5], f[6]),
        t_min: f[3],
        t_max: f[7],
    };
    Ok(bytes.chunks_exact(32).map(|chunk| ray(bytemuck::pod_read_unaligned(chunk))).collect())
}

fn time(directory: &Path) -> std::io::Result<()> {
    let bytes = fs::read(directory.join("mesh.bin"))?;
    let count = |at: usize| bytemuck::pod_read_unaligned::<u64>(&bytes[at..at + 8]) as usize;
    let (vertices, triangles) = bytes[16..].split_at(12 * count(0));
    let vertices: Vec<Vec3> = bytemuck::pod_collect_to_vec(vertices);
    let triangles: Vec<[u32; 3]> = bytemuck::pod_collect_to_vec(triangles);
    drop(bytes);
    let start = cpu_time::ProcessTime::now();
    let bvh = Bvh::build_triangles(&vertices, &triangles);
    let seconds = start.elapsed().as_secs_f64();
    println!("build {:.3} CPU s, {:.3} us/triangle", seconds, seconds * 1e6 / triangles.len() as f64);
    let segments = read_rays(&directory.join("segments.bin"))?;
    let hemispheres = read_rays(&directory.join("hemispheres.bin"))?;
    report("closest", &segments, |ray| bvh.closest(ray).is_some());
    report("occlusion", &segments, |ray| bvh.occluded(ray));
    report("hemisphere", &hemispheres, |ray| bvh.closest(ray).is_some());
    Ok(())
}

/// Prints the best rate of several sweeps and the share of rays that hit.
fn report(name: &str, rays: &[Ray], query: impl Fn(&Ray) -> bool) {
    let mut best = f64::INFINITY;
    let mut hits = 0;
    for _ in 0..5 {
        let start = ThreadTime::now();
        hits = rays.iter().filter(|ray| query(ray)).count();
        best = best.min(start.elapsed().as_secs_f64());
    }
    let rate = rays.len() as f64 / best * 1e-6;
    println!("{name:<11}{rate:.3} Mray/s  hits {:.5}", hits as f64 / rays.len() as f64);
}
