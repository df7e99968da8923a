//! Streaming a mesh: triangles/s of reading the faces, of cutting, and of building the chunks.

#[allow(dead_code)]
mod shapes;

use std::path::PathBuf;
use std::sync::LazyLock;

use divan::Bencher;
use divan::counter::ItemsCount;
use glam::DAffine3;
use glowtree::detail::{CutParams, Shards};
use glowtree::scene::Placement;
use glowtree::scene::ply::stream::Stream;

/// A bumpy sphere of 1.3 M triangles, binary: the folder with the file, and how many triangles.
static MESH: LazyLock<(tempfile::TempDir, PathBuf, usize)> = LazyLock::new(|| {
    let (vertices, triangles) = shapes::bumpy_sphere(8);
    let (count, faces) = (vertices.len(), triangles.len());
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {count}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    .into_bytes();
    vertices.iter().flat_map(glam::Vec3::to_array).for_each(|value| bytes.extend(value.to_le_bytes()));
    for triangle in &triangles {
        bytes.push(3);
        triangle.iter().for_each(|corner| bytes.extend(corner.to_le_bytes()));
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("mesh.ply");
    std::fs::write(&path, bytes).expect("writing the mesh");
    (folder, path, faces)
});

const PARAMS: CutParams = CutParams { chunk_triangles: 1 << 18, proxy_triangles: 100_000 };

fn main() {
    divan::main();
}

fn stream() -> Stream {
    Stream::open(&MESH.1, MESH.0.path()).expect("a mesh")
}

fn cut(stream: &Stream) -> Shards {
    let scratch = tempfile::tempdir_in(MESH.0.path()).expect("a temporary folder");
    Shards::make(stream, &DAffine3::IDENTITY, &PARAMS, scratch.path(), &|| Ok(())).expect("a cut")
}

#[divan::bench(sample_count = 5)]
fn faces(bencher: Bencher<'_, '_>) {
    let stream = stream();
    let look = |triangles: &[[u32; 3]]| {
        divan::black_box(triangles);
        Ok(())
    };
    let read = || stream.faces(look).expect("faces");
    bencher.counter(ItemsCount::new(MESH.2)).bench(read);
}

#[divan::bench(sample_count = 5)]
fn shards(bencher: Bencher<'_, '_>) {
    let stream = stream();
    bencher.counter(ItemsCount::new(MESH.2)).bench(|| cut(&stream));
}

#[divan::bench(sample_count = 5)]
fn chunks(bencher: Bencher<'_, '_>) {
    let stream = stream();
    let shards = cut(&stream);
    let [low, high] = shards.bounds();
    let placement = Placement { origin: low * 0.5 + high * 0.5, scale: (high - low).max_element() };
    let build = |number| shards.chunk(&stream, number, &placement).map(|chunk| chunk.triangles);
    let all = || (0..shards.chunk_count()).map(|number| build(number).expect("a chunk")).sum::<u64>();
    bencher.counter(ItemsCount::new(MESH.2)).bench(all);
}
