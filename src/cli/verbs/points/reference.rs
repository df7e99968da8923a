//! `glowtree reference SCENE --points in.csv --spp N -o out.csv`

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use super::{Destination, Written};
use crate::bake::{Meter, Monitor, Stage};
use crate::cli::arguments::Reference;
use crate::cli::console::Console;
use crate::error::Result;
use crate::light::Rgb;
use crate::output::points::{Column, PointTable};
use crate::rays::Bvh;
use crate::reference::{self, ReferenceParams};
use crate::scene;

/// Between two looks for a signal: one point of many paths may take hours, people wait less.
const LOOK_INTERVAL: Duration = Duration::from_millis(50);

/// Path traces the points of a table.
pub fn run(request: &Reference, console: &Console) -> Result<()> {
    let meter = Meter::start();
    let destination = Destination::of(request.output.as_deref(), console)?;
    let table = PointTable::read(&request.points)?;
    let scene = scene::load(&request.scene)?;
    for warning in &scene.warnings {
        console.warn(&format!("{}: {}", warning.file.display(), warning.message));
    }
    let bvh = Bvh::build(&scene);
    let points = table.local(&scene.placement);
    let params = ReferenceParams {
        samples: request.spp,
        seed: request.seed,
        max_bounces: request.max_bounces.unwrap_or(u32::MAX),
    };
    let stage = Stage::start(console, "reference", "points", Some(points.len() as u64));
    let told = AtomicU64::new(0);
    let advance = |share: f64| {
        let done = (share * points.len() as f64).round() as u64;
        console.advance(done - told.swap(done, Ordering::Relaxed).min(done));
    };
    let estimates = interruptible(console, || reference::irradiance(&scene, &bvh, &points, &params, advance));
    stage.finish();
    let (means, errors): (Vec<Rgb>, Vec<Rgb>) = estimates.iter().map(|e| (e.mean, e.standard_error)).unzip();
    let [r, g, b] = Column::rgb("irradiance", &means);
    let [er, eg, eb] = Column::rgb("stderr", &errors);
    destination.table(&table, &[r, g, b, er, eg, eb])?;
    destination.report("reference", &Written::points(&destination, points.len() as u64, &meter), console)
}

/// Runs work that keeps nothing; the program leaves at once when a signal comes meanwhile.
fn interruptible<T>(console: &Console, work: impl FnOnce() -> T) -> T {
    let (working, done) = mpsc::channel::<()>();
    thread::scope(|scope| {
        scope.spawn(move || {
            while done.recv_timeout(LOOK_INTERVAL) == Err(RecvTimeoutError::Timeout) {
                console.leave_if_interrupted();
            }
        });
        let result = work();
        drop(working);
        result
    })
}
