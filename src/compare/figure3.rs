//! The seed paper's Figure 3 redone: a simple room with boxes, by ways to find its light, and where each errs.
//!
//! Columns: without radiosity, in Shepard's basis, in the radial one, and after ten bounces; below each the difference of
//! its radiance from a converged bake in the default basis at 0.5 %.

use std::path::{Path, PathBuf};

use glam::DVec3;

use crate::bake::model::Model;
use crate::bake::pipeline::{self, Target};
use crate::bake::{Monitor, Stage};
use crate::basis::Basis;
use crate::compare::known::{self, box_faces, cuboid, part, quad};
use crate::error::{Error, Result};
use crate::light::{Rgb, mean_channel};
use crate::links::points::Operator;
use crate::output::exposure;
use crate::output::picture::{Film, Quality, View, render};
use crate::plot::canvas::{Anchor, Colour, Figure, Picture, Rect, Text};
use crate::plot::key::Colours;
use crate::plot::palette;
use crate::scene::{Camera, Scene};

/// Pixels of each picture, and its edge on the page.
const PIXELS: u32 = 320;
const EDGE: f64 = 220.0;
const GAP: f64 = 14.0;
const HEAD: f64 = 52.0;
/// Room for the bar of colours.
const BAR: f64 = 90.0;

/// Targets of the columns and of what they are held against.
const TARGET: f64 = 0.02;
const CONVERGED: f64 = 0.005;

/// A unit room with coloured side walls, two blocks and a lamp, seen through its open front.
fn scene() -> Scene {
    let faces = box_faces(DVec3::ZERO, DVec3::ONE, 1).map(known::Shape::flipped);
    let colours = [[0.63, 0.06, 0.05], [0.14, 0.45, 0.09], [0.73; 3], [0.73; 3], [0.73; 3], [0.73; 3]];
    let wall = |(face, colour): (known::Shape, [f32; 3])| part("wall", face, 0.0).coloured(colour);
    let mut parts: Vec<known::Part> = faces.into_iter().zip(colours).map(wall).collect();
    // The front, at y = 0, is open.
    parts.remove(2);
    let block = |min, max| part("block", cuboid(min, max, 1), 0.73);
    parts.push(block(DVec3::new(0.14, 0.5, 0.0), DVec3::new(0.44, 0.8, 0.6)));
    parts.push(block(DVec3::new(0.55, 0.2, 0.0), DVec3::new(0.85, 0.5, 0.3)));
    let lamp = quad(DVec3::new(0.38, 0.4, 0.995), DVec3::Y * 0.2, DVec3::X * 0.24, 1);
    parts.push(part("lamp", lamp, 0.0).exitance(30.0));
    let mut scene = known::scene(&parts);
    let local = |x, y, z| scene.placement.to_local(DVec3::new(x, y, z));
    let camera = Camera {
        name: "front".into(),
        eye: local(0.5, -1.4, 0.5),
        target: local(0.5, 0.5, 0.5),
        up: glam::Vec3::Z,
        fov_degrees: 39.0,
        size: [PIXELS, PIXELS],
    };
    scene.cameras.push(camera);
    scene
}

/// Draws the figure into `figure3.svg` and `figure3.png`.
///
/// # Errors
/// [`Error::Interrupted`], [`Error::Io`].
pub fn write(folder: &Path, monitor: &dyn Monitor) -> Result<Vec<PathBuf>> {
    std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, "making the folder", e))?;
    let scene = scene();
    let target = |error, basis, bounces| Target {
        error,
        seed: 1,
        bounces,
        basis,
        operator: Operator::default(),
        relightable: false,
    };
    let bake = |target: Target| pipeline::reach(&scene, &target, monitor).map(|(model, ..)| model);
    let default = Basis::default();
    let converged = shot(&bake(target(CONVERGED, default, None))?, false, monitor)?;
    let plain = bake(target(TARGET, default, None))?;
    let films = [
        ("without radiosity", shot(&plain, true, monitor)?),
        ("Shepard", shot(&bake(target(TARGET, Basis::Shepard, None))?, false, monitor)?),
        ("radial", shot(&bake(target(TARGET, Basis::Radial, None))?, false, monitor)?),
        ("ten bounces, default", shot(&bake(target(TARGET, default, Some(10)))?, false, monitor)?),
    ];
    page(&films, &converged).write(&folder.join("figure3"))
}

/// What the camera sees; of `direct_only` with the first bounce alone.
fn shot(model: &Model, direct_only: bool, monitor: &dyn Monitor) -> Result<Film> {
    let field = model.field();
    let evaluate = |points: &[_]| {
        let mut answers = field.evaluate(points);
        if direct_only {
            answers.iter_mut().for_each(|a| a.indirect = Rgb::ZERO);
        }
        answers
    };
    let size = [PIXELS; 2];
    let view = View::choose(&model.scene, &model.bvh, None, size)?;
    let stage = Stage::start(monitor, "picture", "pixels", Some(u64::from(size[0] * size[1])));
    let quality = Quality { rays_across: 2, lights_across: 1 };
    let film =
        render(&model.scene, &model.bvh, &evaluate, (&view, quality), &|pixels| stage.advance(pixels))?;
    stage.finish();
    Ok(film)
}

fn page(films: &[(&str, Film)], converged: &Film) -> Figure {
    let columns = films.len() as f64;
    let size = [GAP + columns * (EDGE + GAP) + BAR, HEAD + 2.0 * (EDGE + GAP) + 22.0];
    let title = "One room by four ways, and where they err";
    let mut figure = Figure::new(size, title);
    figure.text(Text::new([0.5 * size[0], 20.0], 14.0, title).anchored(Anchor::Middle));
    let exposure = converged.exposure();
    let level = mean_radiance(converged);
    let apart = |film: &Film| -> Vec<f64> {
        film.pixels
            .iter()
            .zip(&converged.pixels)
            .map(|(a, b)| difference(a.radiance(), b.radiance(), level))
            .collect()
    };
    let errors: Vec<Vec<f64>> = films.iter().map(|(_, film)| apart(film)).collect();
    // Radiosity left out errs so much more that it has no say in the scale.
    let colours = Colours::over(errors[1..].concat(), "difference of radiance / mean radiance");
    for (k, ((name, film), errors)) in films.iter().zip(&errors).enumerate() {
        let x = GAP + k as f64 * (EDGE + GAP);
        let above = Rect::sized([x, HEAD], [EDGE, EDGE]);
        let below = Rect::sized([x, HEAD + EDGE + GAP], [EDGE, EDGE]);
        figure.text(Text::new([x + 0.5 * EDGE, HEAD - 8.0], 12.0, *name).anchored(Anchor::Middle));
        figure.picture(above, picture(film, |k| exposure::srgb(film.pixels[k].radiance(), exposure)));
        figure.picture(below, picture(film, |k| bytes(colours.of(errors[k]))));
        let square = errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64;
        let told = format!("RMS {:.2} %", 100.0 * square.sqrt());
        let at = [x + 0.5 * EDGE, below.high[1] + 14.0];
        figure.text(Text::new(at, 10.0, told).anchored(Anchor::Middle).coloured(palette::FAINT));
    }
    let low = [GAP + columns * (EDGE + GAP), HEAD + EDGE + GAP];
    colours.bar(&mut figure, &Rect::sized(low, [14.0, EDGE]));
    figure
}

fn mean_radiance(film: &Film) -> f64 {
    let sum = film.pixels.iter().map(|p| f64::from(mean_channel(p.radiance()))).sum::<f64>();
    (sum / film.pixels.len() as f64).max(f64::MIN_POSITIVE)
}

/// Root mean square over the channels, relative.
fn difference(a: Rgb, b: Rgb, level: f64) -> f64 {
    f64::from((a - b).length_squared() / 3.0).sqrt() / level
}

fn bytes(colour: Colour) -> [u8; 3] {
    [colour.red, colour.green, colour.blue]
}

fn picture(film: &Film, colour: impl Fn(usize) -> [u8; 3]) -> Picture {
    let bytes = (0..film.pixels.len()).flat_map(colour).collect();
    Picture { width: film.width, height: film.height, bytes }
}
