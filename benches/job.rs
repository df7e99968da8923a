//! What keeping costs: CPU seconds of a whole bake with ledgers, checksums and archives over one that keeps nothing, and over
//! one that packs its rows as the archive has them but keeps nothing: packing is what the archive's size costs, not its safety.
//!
//! On the Cornell box and the rooms of the tree, and on every scene named on the command line:
//! `cargo bench --bench job -- scene.toml`. Runs alternate, and the least of each kind counts: the machine's other work only adds.

use std::path::{Path, PathBuf};

use glowtree::bake::model::Model;
use glowtree::bake::pipeline::{Target, reach};
use glowtree::bake::{Options, Silent, Stopwatch, run};
use glowtree::links::compress::order::View;
use glowtree::links::compress::{merged, order};
use glowtree::scene;

/// Each kind runs this often.
const REPEATS: usize = 7;

/// The targets measured.
const ERRORS: [f64; 2] = [0.02, 0.01];

fn main() {
    println!(
        "{:28} {:>6} {:>11} {:>11} {:>11} {:>9} {:>9}",
        "scene", "target", "nothing, s", "packed, s", "job, s", "packing", "keeping"
    );
    let own =
        |name: &str| -> PathBuf { [env!("CARGO_MANIFEST_DIR"), "data", name, "scene.toml"].iter().collect() };
    let named = std::env::args().skip(1).filter(|a| !a.starts_with("--")).map(PathBuf::from);
    for file in [own("cornell"), own("rooms")].into_iter().chain(named) {
        for error in ERRORS {
            if let Err(problem) = measure(&file, error) {
                println!("{}: {problem}", file.display());
            }
        }
    }
}

fn measure(file: &Path, error: f64) -> glowtree::Result<()> {
    let options = Options { error, preview: false, ..Options::default() };
    let Options { seed, basis, operator, .. } = options;
    let target = Target { error, seed, bounces: None, basis, operator, relightable: false };
    let (mut nothing, mut packed, mut kept) = (f64::INFINITY, f64::INFINITY, f64::INFINITY);
    for _ in 0..REPEATS {
        let watch = Stopwatch::start();
        let scene = scene::load(file)?;
        let (model, ..) = reach(&scene, &target, &Silent)?;
        let alone = watch.cpu_seconds();
        pack(&model);
        (nothing, packed) = (nothing.min(alone), packed.min(watch.cpu_seconds()));
        drop((scene, model));
        let folder =
            tempfile::tempdir().map_err(|e| glowtree::Error::io("a temporary folder", "making", e))?;
        let watch = Stopwatch::start();
        run(file, &folder.path().join("job.glow"), &options, &Silent)?;
        kept = kept.min(watch.cpu_seconds());
    }
    let name: PathBuf = file.components().rev().take(2).collect::<Vec<_>>().into_iter().rev().collect();
    let percent = |more: f64, base: f64| 100.0 * more / base;
    println!(
        "{:28} {:>5}% {nothing:>11.3} {packed:>11.3} {kept:>11.3} {:>8.1}% {:>8.1}%",
        name.display(),
        100.0 * error,
        percent(packed - nothing, nothing),
        percent(kept - packed, packed),
    );
    Ok(())
}

/// Rows in a block of the archive.
const BLOCK_ROWS: usize = 4096;

/// Packs all rows as the archive does.
fn pack(model: &Model) {
    let supports = model.receivers.index.supports();
    for (before, rows) in model.receivers.tables() {
        let view = View { supports: &supports[before..], positions: &model.sites.positions };
        for first in (0..rows.len()).step_by(BLOCK_ROWS) {
            let block = (first, (first + BLOCK_ROWS).min(rows.len()));
            std::hint::black_box((merged::encode(rows, block), order::encode(view, rows, block)));
        }
    }
}
