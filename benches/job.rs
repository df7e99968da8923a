//! What keeping costs: CPU seconds of a whole bake with ledgers, checksums and archives over one that keeps nothing.
//!
//! On the Cornell box and the rooms of the tree, and on every scene named on the command line:
//! `cargo bench --bench job -- scene.toml`. Runs alternate, and the least of each kind counts: the machine's other work only adds.

use std::path::{Path, PathBuf};

use glowtree::bake::pipeline::{Target, reach};
use glowtree::bake::{Options, Silent, Stopwatch, run};
use glowtree::scene;

/// Each kind runs this often.
const REPEATS: usize = 7;

/// The targets measured.
const ERRORS: [f64; 2] = [0.02, 0.01];

fn main() {
    println!("{:28} {:>6} {:>12} {:>12} {:>8}", "scene", "target", "nothing, s", "job, s", "more");
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
    let target = Target { error, seed, bounces: None, basis, operator };
    let (mut nothing, mut kept) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..REPEATS {
        let watch = Stopwatch::start();
        let scene = scene::load(file)?;
        std::hint::black_box(reach(&scene, &target, &Silent)?);
        nothing = nothing.min(watch.cpu_seconds());
        let folder =
            tempfile::tempdir().map_err(|e| glowtree::Error::io("a temporary folder", "making", e))?;
        let watch = Stopwatch::start();
        run(file, &folder.path().join("job.glow"), &options, &Silent)?;
        kept = kept.min(watch.cpu_seconds());
    }
    let name: PathBuf = file.components().rev().take(2).collect::<Vec<_>>().into_iter().rev().collect();
    let more = 100.0 * (kept / nothing - 1.0);
    println!("{:28} {:>5}% {nothing:>12.3} {kept:>12.3} {more:>7.1}%", name.display(), 100.0 * error);
    Ok(())
}
