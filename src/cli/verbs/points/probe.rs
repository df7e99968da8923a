//! `glowtree probe JOB --points in.csv -o out.csv`

use glam::Vec3;

use super::{Destination, Written};
use crate::bake::model::Model;
use crate::bake::{self, Meter, Monitor, Stage};
use crate::cli::arguments::Probe;
use crate::cli::console::Console;
use crate::error::Result;
use crate::light::Rgb;
use crate::output::footing::footing;
use crate::output::points::{Column, PointTable};

/// Points answered between two looks at progress and signals: some tenths of a second's work.
const BATCH: usize = 1 << 14;

/// Answers for the points of a table.
pub fn run(request: &Probe, console: &Console) -> Result<()> {
    let meter = Meter::start();
    let destination = Destination::of(request.output.as_deref(), console)?;
    let table = PointTable::read(&request.points)?;
    let job = bake::open(&request.job)?;
    let columns = answers(job.model(), &table, console)?;
    destination.table(&table, &columns)?;
    destination.report("probe", &Written::points(&destination, table.len() as u64, &meter), console)
}

/// The light at the points of a table, as columns to append to it.
///
/// # Errors
/// Interruptions, and those of reading a streamed mesh.
pub fn answers(model: &Model, table: &PointTable, console: &Console) -> Result<[Column; 7]> {
    let (scene, bvh, field) = (&model.scene, &model.bvh, model.field());
    let points = table.local(&scene.placement);
    let stage = Stage::start(console, "probe", "points", Some(points.len() as u64));
    let (mut irradiance, mut radiosity, mut error) = (Vec::new(), Vec::<Rgb>::new(), Vec::new());
    let mut afloat = 0u64;
    for batch in points.chunks(BATCH) {
        for (point, light) in batch.iter().zip(field.evaluate(batch)) {
            let surface = footing(scene, bvh, point);
            afloat += u64::from(surface.is_none());
            irradiance.push(light.total());
            radiosity.push(surface.map_or(Vec3::ZERO, |s| s.exitance + s.albedo * light.total()));
            error.push(light.error);
        }
        stage.advance(batch.len() as u64)?;
    }
    bvh.sound()?;
    stage.finish();
    if afloat > 0 {
        console.warn(&format!(
            "{afloat} points lie farther than a hundredth of the scene from any surface: their radiosity is 0"
        ));
    }
    let [ir, ig, ib] = Column::rgb("irradiance", &irradiance);
    let [br, bg, bb] = Column::rgb("radiosity", &radiosity);
    Ok([ir, ig, ib, br, bg, bb, Column::new("error", error)])
}
