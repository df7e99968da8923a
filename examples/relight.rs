//! Bakes a scene once, then changes its lights and paint without new rows, and says how long that takes.
//!
//! `cargo run --release --example relight -- data/cornell/scene.toml light.radiance=5,20,9 white.albedo=0.3`

use std::path::Path;
use std::time::Instant;

use glowtree::bake::{self, Options, Relighter, Silent};
use glowtree::error::{Error, Result};

fn main() -> Result<()> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let Some((scene, changes)) = words.split_first() else {
        return Err(Error::Usage("relight SCENE NAME.KEY=VALUE…".into()));
    };
    let folder = tempfile::tempdir().map_err(|e| Error::io("a temporary folder", "making", e))?;
    let job = folder.path().join("job.glow");
    bake::run(Path::new(scene), &job, &Options { preview: false, ..Options::default() }, &Silent)?;

    let mut relighter = Relighter::open(&job)?;
    let started = Instant::now();
    let report = relighter.prepare()?;
    println!("lights solved one by one: {:.0} ms, {} products", ms(started), report.iterations);

    let mut lighting = relighter.baked().clone();
    for change in changes {
        lighting.set(relighter.scene(), change)?;
        let started = Instant::now();
        let report = relighter.relight(&lighting)?;
        let how = if report.superposed { "summed" } else { "solved" };
        println!(
            "{change}: {how} in {:.2} ms, {} products, {} rays",
            ms(started),
            report.iterations,
            report.rays
        );
        report.warnings.iter().for_each(|warning| println!("  {warning}"));
    }
    let sites = relighter.radiosity();
    let mean = sites.iter().map(|b| b.as_dvec3()).sum::<glam::DVec3>() / sites.len() as f64;
    println!("mean radiosity of {} sites: {mean:.4}", sites.len());
    Ok(())
}

fn ms(started: Instant) -> f64 {
    1e3 * started.elapsed().as_secs_f64()
}
