//! Links per second: the product with the rows from memory and as a stream from the archive, beside what memory gives.
//!
//! On the Cornell box and the rooms of the tree at a target of 1 %, and on every scene named on the command line:
//! `cargo bench --bench operator -- scene.toml`.

use std::path::{Path, PathBuf};
use std::time::Instant;

use glowtree::archive::{Archive, Digest, Digests, Tag};
use glowtree::bake::Silent;
use glowtree::bake::laws::Plan;
use glowtree::bake::pipeline::build;
use glowtree::bake::store::{self, Purpose};
use glowtree::links::compress::merged::Block;
use glowtree::solve::transport::{Transport, gather_stored};
use rayon::prelude::*;

/// Each measurement is the best of this many.
const REPEATS: usize = 9;

fn main() {
    let threads = rayon::current_num_threads();
    println!("memory: {:.1} GB/s read on {threads} threads", bandwidth() / 1e9);
    println!(
        "{:10} {:>10} {:>10} {:>7} | {:>12} {:>12} {:>8} | {:>12} {:>8} | {:>12} {:>7} {:>7}",
        "M/s",
        "rays",
        "links",
        "B/link",
        "memory: rays",
        "links",
        "GB/s",
        "stored: links",
        "GB/s",
        "bounce: rays",
        "write s",
        "read s"
    );
    let own =
        |name: &str| -> PathBuf { [env!("CARGO_MANIFEST_DIR"), "data", name, "scene.toml"].iter().collect() };
    let named = std::env::args().skip(1).filter(|a| !a.starts_with("--")).map(PathBuf::from);
    for file in [own("cornell"), own("rooms")].into_iter().chain(named) {
        if let Err(problem) = measure(&file) {
            println!("{}: {problem}", file.display());
        }
    }
}

/// The least seconds of [`REPEATS`] runs.
fn best<T>(mut run: impl FnMut() -> T) -> f64 {
    let once = || {
        let started = Instant::now();
        std::hint::black_box(run());
        started.elapsed().as_secs_f64()
    };
    std::iter::repeat_with(once).take(REPEATS).fold(f64::INFINITY, f64::min)
}

/// Bytes per second that all threads together read, of 512 MB.
fn bandwidth() -> f64 {
    let words = vec![1u64; 64 << 20];
    let sum = |part: &[u64]| part.iter().fold(0u64, |sum, w| sum.wrapping_add(*w));
    let seconds = best(|| words.par_chunks(1 << 16).map(sum).sum::<u64>());
    8.0 * words.len() as f64 / seconds
}

fn measure(file: &Path) -> glowtree::Result<()> {
    let (model, _) = build(glowtree::scene::load(file)?, &Plan::new(0.0075, 0), None, &Silent)?;
    let receivers = &model.receivers;
    let folder = tempfile::tempdir().map_err(|e| glowtree::Error::Usage(e.to_string()))?;
    let digests = Digests { inputs: Digest::of_bytes(b""), options: Digest::of_bytes(b"") };
    let started = Instant::now();
    let report = store::write(&model, folder.path(), digests)?;
    let write = started.elapsed().as_secs_f64();
    let read = best(|| store::read(folder.path(), Purpose::Light).map(|model| model.sites.len()));
    let archive = Archive::open(folder.path().join("links.glow"))?;
    let mut blocks = Vec::new();
    for block in archive.blocks(Tag::new("rows")) {
        let (range, (rows, _)) = (block.range(), receivers.row(block.range().start as usize));
        blocks.extend(Block::new(block.stored()?, (range.end - range.start) as usize, rows.rays));
    }
    let links = report.links as f64;
    let radiosity = &model.solution.radiosity;
    let transport = Transport { receivers, spread: &model.spread, albedo: &model.albedo };
    let memory = best(|| transport.gather(radiosity));
    let stored = best(|| gather_stored(&blocks, receivers, radiosity));
    let bounce = best(|| transport.apply(&model.solution.irradiance));
    let rays = receivers.ray_count() as f64;
    let name = file.parent().and_then(Path::file_name).map_or(String::new(), |n| n.to_string_lossy().into());
    println!(
        "{name:10} {:10.3} {:10.3} {:7.3} | {:12.0} {:12.0} {:8.2} | {:12.0} {:8.2} | {:12.0} {:7.2} {:7.2}",
        rays / 1e6,
        links / 1e6,
        report.link_bytes as f64 / links,
        rays / memory / 1e6,
        links / memory / 1e6,
        4.0 * rays / memory / 1e9,
        links / stored / 1e6,
        report.link_bytes as f64 / stored / 1e9,
        rays / bounce / 1e6,
        write,
        read
    );
    Ok(())
}
