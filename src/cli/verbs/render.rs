//! `glowtree render JOB -o out.png`

use std::path::Path;

use crate::bake::model::Model;
use crate::bake::{self, Meter, Stage};
use crate::cli::arguments::Render;
use crate::cli::console::Console;
use crate::cli::values::show_bytes;
use crate::cli::verbs::Written;
use crate::error::Result;
use crate::output::Advance;
use crate::output::file::check_folder;
use crate::output::picture::{Quality, View, layers, png, render};

/// The size of a picture without a camera that says otherwise.
pub const DEFAULT_SIZE: [u32; 2] = [1200, 800];

/// Makes an image of the job from a camera.
pub fn run(request: &Render, console: &Console) -> Result<()> {
    let meter = Meter::start();
    check_folder(&request.output)?;
    let job = bake::open(&request.job)?;
    let [width, height] = shoot(job.model(), request.camera.as_deref(), &request.output, console)?;
    let written = Written::file(&request.output, &meter);
    console.result(&format!(
        "{}: {width} × {height}, {}\n",
        written.output,
        show_bytes(written.written_bytes)
    ))?;
    console.summary("render", &written)
}

/// Writes an image of a model from one of its cameras; gives its width and height.
///
/// # Errors
/// [`Error::Usage`](crate::Error::Usage) when there is no such camera, input/output errors, interruptions.
pub fn shoot(model: &Model, camera: Option<&str>, output: &Path, console: &Console) -> Result<[u32; 2]> {
    let view = View::choose(&model.scene, &model.bvh, camera, DEFAULT_SIZE)?;
    let [width, height] = view.camera.size;
    let stage = Stage::start(console, "picture", "pixels", Some(u64::from(width) * u64::from(height)));
    let exposure = picture(model, (&view, None), output, &|pixels| stage.advance(pixels))?;
    exposure.iter().for_each(|exposure| console.remark(&format!("exposure {exposure}")));
    stage.finish();
    Ok([width, height])
}

/// Writes an image of a model; gives the exposure if it has one: the given, or what suits it.
///
/// # Errors
/// Input/output errors, and what `advance` says.
pub fn picture(
    model: &Model,
    (view, exposure): (&View, Option<f32>),
    output: &Path,
    advance: &Advance<'_>,
) -> Result<Option<f32>> {
    let field = model.field();
    let evaluate = |points: &[_]| field.evaluate(points);
    let film = render(&model.scene, &model.bvh, &evaluate, (view, Quality::FINE), advance)?;
    model.bvh.sound()?;
    if !output.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("png")) {
        layers::write(output, &film)?;
        return Ok(None);
    }
    let exposure = exposure.unwrap_or_else(|| film.exposure());
    png::write(output, &film, exposure)?;
    Ok(Some(exposure))
}
