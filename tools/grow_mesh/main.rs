//! Grows a small scan into a mesh of any size that looks like a scan: `cargo run --release --example grow_mesh -- --help`.
//!
//! Each triangle becomes k² parts, rounded off and displaced by fractal noise along the interpolated normal; vertices
//! stay shared, so that a closed base gives a closed mesh. The noise is a function of the place on the base: meshes of
//! the same seed and different k sample one surface. Memory is that of the base; the bytes are the same for any number
//! of threads and on any platform.

mod base;
mod noise;
mod numbering;
mod order;
mod ply;
mod recipe;
mod surface;

use std::fs::File;
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;

use base::Base;
use recipe::Recipe;

/// Grows a small scan into a mesh of any size: each triangle into k² parts, displaced by seeded fractal noise.
///
/// Writes a binary PLY, the same bytes for the same options; memory is that of the small scan. Shares are of 1. The
/// triangles of the result are k² times those of the base (less the holes): from 100 thousand, k = 10, 22, 45, 63 give
/// 10, 48, 202, 397 million, 0.2, 0.9, 3.8, 7.5 GB.
#[derive(Debug, Parser)]
#[command(name = "grow_mesh")]
struct Arguments {
    /// The small scan: any mesh or scene file that glowtree reads
    base: PathBuf,
    /// The PLY to write
    #[arg(short, long)]
    output: PathBuf,
    #[command(flatten)]
    recipe: Recipe,
    /// Threads; all cores by default
    #[arg(short = 'j', long, default_value_t = 0, hide_default_value = true)]
    threads: usize,
    /// Only count: writes nothing but the line at the end
    #[arg(long)]
    dry_run: bool,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(told) => {
            println!("{told}");
            ExitCode::SUCCESS
        }
        Err(message) => {
            eprintln!("error: {message}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<String, String> {
    let pool =
        rayon::ThreadPoolBuilder::new().num_threads(arguments.threads).build().map_err(|e| e.to_string())?;
    pool.install(|| {
        let name = arguments.base.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let recipe = &arguments.recipe;
        let base = recipe.prepared(Base::load(&arguments.base)?)?;
        let counts = recipe.counts(&base)?;
        if !arguments.dry_run {
            let failed = |error: std::io::Error| format!("{}: {error}", arguments.output.display());
            let mut file = File::create(&arguments.output).map_err(failed)?;
            recipe.grow(&base, &name, &mut file)?.and_then(|()| file.flush()).map_err(failed)?;
        }
        Ok(format!("{} triangles, {} vertices", counts.faces, counts.vertices))
    })
}
