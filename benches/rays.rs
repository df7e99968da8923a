//! Rays per second and triangles per second of the ray engine, on bumpy spheres.
//!
//! 82 k and 328 k triangles; with the environment variable GLOWTREE_BENCH_LARGE set, 5.2 M too. One thread for rays.

use std::sync::LazyLock;

use divan::Bencher;
use divan::counter::ItemsCount;
use glowtree::rays::{Bvh, Ray};

mod shapes;

/// Rays of each kind.
const RAYS: usize = 50_000;

struct Case {
    mesh: shapes::Mesh,
    bvh: Bvh,
    segments: Vec<Ray>,
    hemispheres: Vec<Ray>,
}

fn case(levels: u32) -> &'static Case {
    static CASES: [LazyLock<Case>; 3] =
        [LazyLock::new(|| prepare(6)), LazyLock::new(|| prepare(7)), LazyLock::new(|| prepare(9))];
    &CASES[match levels {
        6 => 0,
        7 => 1,
        _ => 2,
    }]
}

fn prepare(levels: u32) -> Case {
    let mesh = shapes::bumpy_sphere(levels);
    let bvh = Bvh::build_triangles(&mesh.0, &mesh.1);
    let (segments, hemispheres) = (shapes::segments(&mesh, RAYS, 1), shapes::hemispheres(&mesh, RAYS, 1));
    Case { mesh, bvh, segments, hemispheres }
}

fn levels() -> Vec<u32> {
    if std::env::var_os("GLOWTREE_BENCH_LARGE").is_some() { vec![6, 7, 9] } else { vec![6, 7] }
}

#[divan::bench(args = levels(), sample_count = 5)]
fn build(bencher: Bencher<'_, '_>, levels: u32) {
    let (vertices, triangles) = &case(levels).mesh;
    bencher
        .counter(ItemsCount::new(triangles.len()))
        .bench_local(|| Bvh::build_triangles(vertices, triangles));
}

#[divan::bench(args = levels(), sample_count = 5, sample_size = 1)]
fn closest(bencher: Bencher<'_, '_>, levels: u32) {
    let case = case(levels);
    let hits = || case.segments.iter().filter(|ray| case.bvh.closest(ray).is_some()).count();
    bencher.counter(ItemsCount::new(RAYS)).bench_local(hits);
}

#[divan::bench(args = levels(), sample_count = 5, sample_size = 1)]
fn closest_without_vectors(bencher: Bencher<'_, '_>, levels: u32) {
    let view = case(levels).bvh.view();
    let hits = || case(levels).segments.iter().filter(|ray| view.closest_scalar(ray).is_some()).count();
    bencher.counter(ItemsCount::new(RAYS)).bench_local(hits);
}

#[divan::bench(args = levels(), sample_count = 5, sample_size = 1)]
fn occlusion(bencher: Bencher<'_, '_>, levels: u32) {
    let case = case(levels);
    let hits = || case.segments.iter().filter(|ray| case.bvh.occluded(ray)).count();
    bencher.counter(ItemsCount::new(RAYS)).bench_local(hits);
}

#[divan::bench(args = levels(), sample_count = 5, sample_size = 1)]
fn hemisphere(bencher: Bencher<'_, '_>, levels: u32) {
    let case = case(levels);
    let hits = || case.hemispheres.iter().filter(|ray| case.bvh.closest(ray).is_some()).count();
    bencher.counter(ItemsCount::new(RAYS)).bench_local(hits);
}

fn main() {
    divan::main();
}
