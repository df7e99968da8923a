//! `glowtree render JOB -o out.png`

use std::path::Path;

use crate::bake::model::Model;
use crate::bake::{self, Meter, Relighter, Stage};
use crate::cli::arguments::Render;
use crate::cli::console::Console;
use crate::cli::values::show_bytes;
use crate::cli::verbs::Written;
use crate::cli::verbs::films::{self, Films, MOST_LIGHTS, develop, is_png};
use crate::error::Result;
use crate::output::file::check_folder;
use crate::output::picture::{View, layers};

/// The size of a picture without a camera that says otherwise.
pub const DEFAULT_SIZE: [u32; 2] = [1200, 800];

/// Makes an image of the job from a camera.
pub fn run(request: &Render, console: &Console) -> Result<()> {
    let meter = Meter::start();
    check_folder(&request.output)?;
    let camera = request.camera.as_deref();
    let [width, height] = if is_png(&request.output) {
        shoot(bake::open(&request.job)?.model(), camera, &request.output, console)?
    } else {
        let mut relighter = Relighter::open(&request.job)?;
        apart(&mut relighter, camera, &request.output, console)?
    };
    let written = Written::file(&request.output, &meter);
    console.result(&format!(
        "{}: {width} × {height}, {}\n",
        written.output,
        show_bytes(written.written_bytes)
    ))?;
    console.summary("render", &written)
}

/// Writes an image for the screen of a model from one of its cameras; gives its width and height.
///
/// # Errors
/// [`Error::Usage`](crate::Error::Usage) when there is no such camera, input/output errors, interruptions.
pub fn shoot(model: &Model, camera: Option<&str>, output: &Path, console: &Console) -> Result<[u32; 2]> {
    let view = View::choose(&model.scene, &model.bvh, camera, DEFAULT_SIZE)?;
    let stage = Stage::start(console, "picture", "pixels", Some(pixels(&view)));
    let film = films::film(model, &view, &|pixels| stage.advance(pixels))?;
    let exposure = develop(&film, None, output)?;
    console.remark(&format!("exposure {exposure}"));
    stage.finish();
    Ok(view.camera.size)
}

/// Writes an image with a layer for each light, in the light of now; gives its width and height.
///
/// Cost: a picture for each light. Of more than [`MOST_LIGHTS`] there are no layers.
///
/// # Errors
/// As [`shoot`], and those of [`Relighter::relight_with`].
pub fn apart(
    relighter: &mut Relighter,
    camera: Option<&str>,
    output: &Path,
    console: &Console,
) -> Result<[u32; 2]> {
    let model = relighter.model();
    let view = View::choose(&model.scene, &model.bvh, camera, DEFAULT_SIZE)?;
    let lighting = relighter.lighting().clone();
    let numbers = films::lit(std::slice::from_ref(&lighting));
    let total = pixels(&view) * numbers.len().clamp(1, MOST_LIGHTS) as u64;
    let stage = Stage::start(console, "picture", "pixels", Some(total));
    let advance = |pixels| stage.advance(pixels);
    if numbers.is_empty() || numbers.len() > MOST_LIGHTS {
        console.remark(&format!("{} lights: no layers of each", numbers.len()));
        layers::write(output, &films::film(relighter.model(), &view, &advance)?, &[])?;
    } else {
        films::ready(relighter, &lighting, &numbers, console)?;
        Films::shoot(relighter, (&lighting, &numbers), &view, &advance)?.write(&lighting, None, output)?;
    }
    stage.finish();
    Ok(view.camera.size)
}

fn pixels(view: &View) -> u64 {
    view.camera.size.map(u64::from).iter().product()
}
