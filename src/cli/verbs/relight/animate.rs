//! `glowtree relight JOB --animate KEYS.toml -o frame_####.png`

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use serde::Serialize;

use crate::bake::relight::Keys;
use crate::bake::{Meter, Monitor, Relighter, Stage, Usage};
use crate::cli::arguments::Relight;
use crate::cli::console::Console;
use crate::cli::values::show_seconds;
use crate::cli::verbs::{export, render};
use crate::error::{Error, Result};
use crate::output::exposure;
use crate::output::file::check_folder;
use crate::output::picture::View;

/// The figures of a sequence.
#[derive(Debug, Serialize)]
struct Animated {
    output: String,
    /// In all.
    frames: u32,
    /// Found from an earlier run.
    kept_frames: u32,
    /// Products with the operator.
    iterations: usize,
    rays: u64,
    #[serde(flatten)]
    usage: Usage,
}

/// Writes the frames that are not there yet.
pub fn run(request: &Relight, keys: &Path, console: &Console) -> Result<()> {
    let meter = Meter::start();
    let pattern = Pattern::of(request.output.as_deref().unwrap_or(Path::new("")))?;
    let mut relighter = Relighter::open(&request.job)?;
    let made_from = [keys, &request.job.join("light.glow")].map(changed_at);
    let mut keys = Keys::read(keys, relighter.scene())?;
    if let Some(order) = request.harmonics {
        keys = keys.with_harmonics(usize::from(order));
    }
    let mut told = relighter.relight_with(&keys.lighting(0), &|| console.check())?.warnings;
    let model = relighter.model();
    // The same for all frames, that light which changes is seen to.
    let sites = model.solution.radiosity.iter().zip(&model.sites.areas);
    let light = sites.map(|(b, &area)| (exposure::luminance(*b) / std::f32::consts::PI, area));
    let shown_at = exposure::automatic(light);
    let view = View::choose(&model.scene, &model.bvh, request.camera.as_deref(), render::DEFAULT_SIZE)?;
    relighter.prepare_with(&|| console.check())?;
    let stage = Stage::start(console, "frames", "frames", Some(u64::from(keys.frames())));
    let (mut kept_frames, mut iterations, mut rays) = (0, 0, 0);
    for frame in 0..keys.frames() {
        let path = pattern.frame(frame);
        // Files are whole or not there.
        if made_from.iter().all(|made| made.is_some() && changed_at(&path) >= *made) {
            kept_frames += 1;
            stage.advance(1)?;
            continue;
        }
        let report = relighter.relight_with(&keys.lighting(frame), &|| console.check())?;
        told.extend(report.warnings);
        (iterations, rays) = (iterations + report.iterations, rays + report.rays);
        let model = relighter.model();
        if pattern.is_mesh() {
            export::write((&request.job, model), &path, console)?;
        } else {
            let camera = keys.camera(frame, &view.camera);
            render::picture(model, (&View { camera, ..view }, Some(shown_at)), &path, &|_| console.check())?;
        }
        stage.advance(1)?;
    }
    stage.finish();
    told.sort_unstable();
    told.dedup();
    told.iter().for_each(|warning| console.warn(warning));
    let (output, frames) = (pattern.shown(), keys.frames());
    let animated = Animated { output, frames, kept_frames, iterations, rays, usage: meter.usage() };
    let seconds = show_seconds(animated.usage.seconds);
    let kept = if kept_frames > 0 { format!(" ({kept_frames} were there)") } else { String::new() };
    console.result(&format!("{}: {frames} frames{kept}, {seconds}\n", animated.output))?;
    console.summary("relight", &animated)
}

fn changed_at(path: &Path) -> Option<SystemTime> {
    std::fs::metadata(path).and_then(|meta| meta.modified()).ok()
}

/// A name with `#` where the frame's number goes.
struct Pattern<'a> {
    output: &'a Path,
    before: String,
    digits: usize,
    after: String,
}

impl<'a> Pattern<'a> {
    fn of(output: &'a Path) -> Result<Self> {
        let name = output.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let ending = Path::new(&name).extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
        let start = name.find('#');
        let (Some(start), Some("ply" | "png" | "exr")) = (start, ending.as_deref()) else {
            let problem = "expected a name like frame_####.png, .exr or .ply";
            return Err(Error::Usage(format!("{}: {problem}", output.display())));
        };
        let digits = name[start..].chars().take_while(|c| *c == '#').count();
        check_folder(output)?;
        let (before, after) = (name[..start].to_owned(), name[start + digits..].to_owned());
        Ok(Self { output, before, digits, after })
    }

    fn frame(&self, number: u32) -> PathBuf {
        let Self { output, before, digits, after } = self;
        output.with_file_name(format!("{before}{number:0digits$}{after}"))
    }

    fn is_mesh(&self) -> bool {
        self.after.to_ascii_lowercase().ends_with(".ply")
    }

    fn shown(&self) -> String {
        self.output.display().to_string()
    }
}
