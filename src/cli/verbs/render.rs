//! `glowtree render JOB -o out.png`

use crate::bake::{self, Meter, Stage};
use crate::cli::arguments::Render;
use crate::cli::console::Console;
use crate::cli::values::show_bytes;
use crate::cli::verbs::Written;
use crate::error::Result;
use crate::output::file::check_folder;
use crate::output::picture::{Quality, View, layers, png, render};

/// The size of a picture without a camera that says otherwise.
const DEFAULT_SIZE: [u32; 2] = [1200, 800];

/// Makes an image of the job from a camera.
pub fn run(request: &Render, console: &Console) -> Result<()> {
    let meter = Meter::start();
    check_folder(&request.output)?;
    let job = bake::open(&request.job)?;
    let view = View::choose(job.scene(), job.bvh(), request.camera.as_deref(), DEFAULT_SIZE)?;
    let [width, height] = view.camera.size;
    let stage = Stage::start(console, "picture", "pixels", Some(u64::from(width) * u64::from(height)));
    let evaluate = |points: &[_]| job.evaluate(points);
    let shot = (&view, Quality::FINE);
    let film = render(job.scene(), job.bvh(), &evaluate, shot, &|pixels| stage.advance(pixels))?;
    job.sound()?;
    if request.output.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("png")) {
        let exposure = film.exposure();
        console.remark(&format!("exposure {exposure}"));
        png::write(&request.output, &film, exposure)?;
    } else {
        layers::write(&request.output, &film)?;
    }
    stage.finish();
    let written = Written::file(&request.output, &meter);
    console.result(&format!(
        "{}: {width} × {height}, {}\n",
        written.output,
        show_bytes(written.written_bytes)
    ))?;
    console.summary("render", &written)
}
