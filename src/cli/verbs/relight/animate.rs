//! `glowtree relight JOB --animate KEYS.toml -o frame_####.png`

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use serde::Serialize;

use crate::bake::relight::Keys;
use crate::bake::{Lighting, Meter, Monitor, Relighter, Stage, Usage};
use crate::cli::arguments::Relight;
use crate::cli::console::Console;
use crate::cli::values::show_seconds;
use crate::cli::verbs::films::{self, Films, MOST_LIGHTS};
use crate::cli::verbs::{export, render};
use crate::error::{Error, Result};
use crate::light::Rgb;
use crate::output::exposure;
use crate::output::file::check_folder;
use crate::output::picture::{View, layers};
use crate::scene::Camera;

/// The figures of a sequence.
#[derive(Debug, Serialize)]
struct Animated {
    output: String,
    /// In all.
    frames: u32,
    /// Found from an earlier run.
    kept_frames: u32,
    /// Shot: one a frame, or one a light where frames are sums of them.
    pictures: u32,
    /// Products with the operator.
    iterations: usize,
    rays: u64,
    #[serde(flatten)]
    usage: Usage,
}

/// Writes the frames that are not there yet. Those that are are passed through all the same, for the light of a frame follows from
/// that of the frames before: a sequence that was stopped ends with the same files.
pub fn run(request: &Relight, keys: &Path, console: &Console) -> Result<()> {
    let meter = Meter::start();
    let pattern = Pattern::of(request.output.as_deref().unwrap_or(Path::new("")))?;
    let mut relighter = Relighter::open(&request.job)?;
    let made_from = [keys, &request.job.join("light.glow")].map(changed_at);
    let mut keys = Keys::read(keys, relighter.scene())?;
    if let Some(order) = request.harmonics {
        keys = keys.with_harmonics(usize::from(order));
    }
    // Files are whole or not there.
    let is_kept = |frame: &u32| {
        let written = changed_at(&pattern.frame(*frame));
        made_from.iter().all(|made| made.is_some() && written >= *made)
    };
    let kept: Vec<bool> = (0..keys.frames()).map(|frame| is_kept(&frame)).collect();
    let report = relighter.relight_with(&keys.lighting(0), &|| console.check())?;
    let model = relighter.model();
    // The same for all frames, that light which changes is seen to.
    let sites = model.solution.radiosity.iter().zip(&model.sites.areas);
    let light = sites.map(|(b, &area)| (exposure::luminance(*b) / std::f32::consts::PI, area));
    let shown_at = exposure::automatic(light);
    let view = View::choose(&model.scene, &model.bvh, request.camera.as_deref(), render::DEFAULT_SIZE)?;
    let stage = Stage::start(console, "frames", "frames", Some(u64::from(keys.frames())));
    let mut sequence = Sequence {
        keys: &keys,
        pattern: &pattern,
        view,
        shown_at,
        relighter,
        told: report.warnings,
        iterations: report.iterations,
        rays: report.rays,
        pictures: 0,
        films: None,
    };
    let last = kept.iter().rposition(|kept| !kept);
    for scenery in sceneries(&keys) {
        if last.is_some_and(|last| scenery.frames.start as usize <= last) {
            sequence.play(&scenery, &kept, (&request.job, console, &stage))?;
        } else {
            stage.advance(scenery.frames.len() as u64)?;
        }
    }
    stage.finish();
    let Sequence { mut told, iterations, rays, pictures, .. } = sequence;
    told.sort_unstable();
    told.dedup();
    told.iter().for_each(|warning| console.warn(warning));
    let kept_frames = kept.iter().filter(|kept| **kept).count() as u32;
    let (output, frames) = (pattern.shown(), keys.frames());
    let animated = Animated { output, frames, kept_frames, pictures, iterations, rays, usage: meter.usage() };
    let seconds = show_seconds(animated.usage.seconds);
    let kept = if kept_frames > 0 { format!(" ({kept_frames} were there)") } else { String::new() };
    console.result(&format!("{}: {frames} frames{kept}, {seconds}\n", animated.output))?;
    console.summary("relight", &animated)
}

/// Frames in a row whose lights differ in strength and colour alone.
struct Scenery {
    frames: Range<u32>,
    /// One of their lightings.
    lighting: Lighting,
    /// The lights that are lit in any.
    numbers: Vec<usize>,
}

impl Scenery {
    /// Whether so many frames are sums of what lights do one by one, rather than found as they are; layers always take it.
    fn is_summed(&self, frames: usize, layers: bool) -> bool {
        let lights = self.numbers.len();
        (1..=MOST_LIGHTS).contains(&lights) && (layers || frames > lights)
    }
}

fn sceneries(keys: &Keys) -> Vec<Scenery> {
    let frames: Vec<u32> = (0..keys.frames()).collect();
    let lightings: Vec<Lighting> = frames.iter().map(|&frame| keys.lighting(frame)).collect();
    let shape = |frame: u32| {
        let lighting = &lightings[frame as usize];
        lighting.with_tints(&vec![Rgb::ONE; lighting.tints().len()])
    };
    let scenery = |run: &[u32]| {
        let frames = run[0]..run[run.len() - 1] + 1;
        let own = &lightings[frames.start as usize..frames.end as usize];
        Scenery { frames, lighting: own[0].clone(), numbers: films::lit(own) }
    };
    frames.chunk_by(|a, b| shape(*a) == shape(*b)).map(scenery).collect()
}

/// A sequence as it is played.
struct Sequence<'a> {
    keys: &'a Keys,
    pattern: &'a Pattern<'a>,
    view: View,
    shown_at: f32,
    relighter: Relighter,
    told: Vec<String>,
    iterations: usize,
    rays: u64,
    pictures: u32,
    /// What the camera last saw of each light of the scenery.
    films: Option<(Camera, Films)>,
}

impl Sequence<'_> {
    fn play(
        &mut self,
        scenery: &Scenery,
        kept: &[bool],
        (job, console, stage): (&Path, &Console, &Stage<'_>),
    ) -> Result<()> {
        self.films = None;
        if scenery.is_summed(scenery.frames.len(), self.pattern.has_layers()) {
            let (lighting, numbers) = (&scenery.lighting, &scenery.numbers);
            let (rays, iterations, told) = films::ready(&mut self.relighter, lighting, numbers, console)?;
            (self.rays, self.iterations) = (self.rays + rays, self.iterations + iterations);
            self.told.extend(told);
        }
        for frame in scenery.frames.clone() {
            let report = self.relighter.relight_with(&self.keys.lighting(frame), &|| console.check())?;
            self.told.extend(report.warnings);
            (self.rays, self.iterations) = (self.rays + report.rays, self.iterations + report.iterations);
            if !kept[frame as usize] {
                self.write(scenery, frame, (job, console))?;
            }
            stage.advance(1)?;
        }
        Ok(())
    }

    /// Writes a frame in the light of now.
    fn write(&mut self, scenery: &Scenery, frame: u32, (job, console): (&Path, &Console)) -> Result<()> {
        let path = self.pattern.frame(frame);
        if self.pattern.is_mesh() {
            return export::write((job, self.relighter.model()), &path, console);
        }
        let camera = self.keys.camera(frame, &self.view.camera);
        let view = View { camera: camera.clone(), ..self.view.clone() };
        let advance = |_| console.check();
        if !self.is_sum(scenery, &camera) {
            let film = films::film(self.relighter.model(), &view, &advance)?;
            self.pictures += 1;
            return match films::is_png(&path) {
                true => films::develop(&film, Some(self.shown_at), &path).map(drop),
                false => layers::write(&path, &film, &[]),
            };
        }
        if self.films.as_ref().is_none_or(|(known, _)| *known != camera) {
            let lights = (&scenery.lighting, &scenery.numbers[..]);
            let films = Films::shoot(&mut self.relighter, lights, &view, &advance)?;
            self.films = Some((camera, films));
            self.pictures += scenery.numbers.len() as u32;
            // As it goes on where the frame was there.
            self.relighter.relight_with(&self.keys.lighting(frame), &|| console.check())?;
        }
        let Some((_, films)) = &self.films else { unreachable!("shot above") };
        films.write(&self.keys.lighting(frame), Some(self.shown_at), &path).map(drop)
    }

    /// Whether the frame is a sum of pictures of each light: they cost less than those of each frame, or are to be layers.
    fn is_sum(&self, scenery: &Scenery, camera: &Camera) -> bool {
        let same = |frame: &u32| self.keys.camera(*frame, &self.view.camera) == *camera;
        scenery.is_summed(scenery.frames.clone().filter(same).count(), self.pattern.has_layers())
    }
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

    /// Whether frames hold a layer for each light.
    fn has_layers(&self) -> bool {
        self.after.to_ascii_lowercase().ends_with(".exr")
    }

    fn shown(&self) -> String {
        self.output.display().to_string()
    }
}
