//! The page of `glowtree export JOB -o view.html` and `glowtree view JOB`.

use std::path::Path;

use crate::bake::model::Model;
use crate::bake::relight::Alone;
use crate::bake::{Monitor, Relighter, Stage};
use crate::cli::console::Console;
use crate::error::{Result, one_line};
use crate::geometry::SurfacePoint;
use crate::light::Rgb;
use crate::output::picture::{Quality, View, render};
use crate::output::viewer::{self, Lit, Picture, ViewLight, ViewMesh};
use crate::solve::Irradiance;

/// The view that a page begins with, when the scene has no camera.
const VIEW_SIZE: [u32; 2] = [1200, 800];

/// The page begins with the exposure of a picture that many times smaller.
const SMALLER: u32 = 8;

/// Points asked together.
const BATCH: usize = 1 << 15;

/// Writes the page that one looks at in a browser, with a slider for each light.
///
/// # Errors
/// Those of opening the job, of [`viewer::write`], and interruptions.
pub fn write(job: &Path, output: &Path, console: &Console) -> Result<()> {
    let mut shown = Shown::open(job, viewer::VERTICES, console)?;
    shown.drop_dark_backs();
    shown.turn_sky(console)?;
    let mut picture = shown.picture(job)?;
    picture.lighten_hidden();
    viewer::write(output, &picture)?;
    shown.relighter.model().bvh.sound()
}

/// A job with its light at the vertices of a page, each light by itself.
pub struct Shown {
    /// In the light that was baked.
    pub relighter: Relighter,
    /// What is drawn.
    pub mesh: ViewMesh,
    /// Where light is asked for.
    pub points: Vec<SurfacePoint>,
    /// The lights.
    pub apart: Vec<Alone>,
    /// Their light.
    pub lit: Lit,
}

impl Shown {
    /// Solves for each light.
    ///
    /// # Errors
    /// Those of opening the job, and interruptions.
    pub fn open(job: &Path, vertices: usize, console: &Console) -> Result<Self> {
        let mut relighter = Relighter::open(job)?;
        relighter.prepare_with(&|| console.check())?;
        let baked = relighter.baked().clone();
        let apart = baked.apart(relighter.scene());
        let model = relighter.model();
        let mesh = ViewMesh::new(&model.scene, vertices);
        let points = model.set_down(&mesh.asked).into_owned();
        let stage =
            Stage::start(console, "mesh", "vertices", Some(points.len() as u64 * (1 + apart.len() as u64)));
        let advance = |amount| stage.advance(amount);
        let mut lit = Lit { lights: Vec::new(), ambient: Vec::new(), error: Vec::new() };
        for light in answers(model, &points, &advance)? {
            lit.ambient.push(light.sky_visibility);
            lit.error.push(light.error);
        }
        for light in &apart {
            relighter.relight_with(&light.lighting, &|| console.check())?;
            lit.lights.push(named(light, &answers(relighter.model(), &points, &advance)?));
        }
        relighter.relight_with(&baked, &|| console.check())?;
        stage.finish();
        Ok(Self { relighter, mesh, points, apart, lit })
    }

    /// Leaves out backs that no light reaches: a page that nobody serves is not lit otherwise.
    pub fn drop_dark_backs(&mut self) {
        self.lit.drop_dark_backs(&mut self.mesh, self.relighter.scene());
        self.points = self.relighter.model().set_down(&self.mesh.asked).into_owned();
    }

    /// Solves for the sky turned, if it is an image: a page that nobody serves adds these up. Light at a point is a periodic function
    /// of the turn, and the page interpolates by waves between its places, which needs no sign in the layers.
    ///
    /// # Errors
    /// Interruptions.
    pub fn turn_sky(&mut self, console: &Console) -> Result<()> {
        let parts = viewer::turns(self.points.len());
        let is_image = |alone: &Alone| alone.lighting.sky.as_ref().is_some_and(|sky| sky.constant.is_none());
        let Some(k) = self.apart.iter().position(|alone| alone.is_sky && is_image(alone)) else {
            return Ok(());
        };
        let total = (parts - 1) * self.points.len();
        let stage = Stage::start(console, "sky", "vertices", Some(total as u64));
        for part in 1..parts {
            let mut lighting = self.apart[k].lighting.clone();
            let sky = lighting.sky.as_mut().expect("an image, found above");
            sky.rotate_degrees += 360.0 * part as f32 / parts as f32;
            self.relighter.relight_with(&lighting, &|| console.check())?;
            let found = answers(self.relighter.model(), &self.points, &|amount| stage.advance(amount))?;
            self.lit.lights[k].turned.push(irradiance(&found));
        }
        let baked = self.relighter.baked().clone();
        self.relighter.relight_with(&baked, &|| console.check())?;
        stage.finish();
        Ok(())
    }

    /// What the page shows; mesh and light are handed over.
    ///
    /// # Errors
    /// Those of looking through a camera.
    pub fn picture(&mut self, job: &Path) -> Result<Picture<'_>> {
        let lit = Lit { lights: Vec::new(), ambient: Vec::new(), error: Vec::new() };
        let (mesh, lit) = (std::mem::take(&mut self.mesh), std::mem::replace(&mut self.lit, lit));
        let model = self.relighter.model();
        let view = View::choose(&model.scene, &model.bvh, None, VIEW_SIZE)?;
        let title =
            job.file_stem().map_or_else(|| "glowtree".into(), |stem| one_line(&stem.to_string_lossy(), 80));
        Ok(Picture {
            title,
            scene: &model.scene,
            mesh,
            lit,
            dots: viewer::dots(&model.sites),
            exposure: exposure(model, &view)?,
            view,
            level: model.solution.level,
        })
    }
}

/// The light of now at all points.
///
/// # Errors
/// What `advance` says, which hears of points done.
pub fn answers(
    model: &Model,
    points: &[SurfacePoint],
    advance: &dyn Fn(u64) -> Result<()>,
) -> Result<Vec<Irradiance>> {
    let mut answers = Vec::with_capacity(points.len());
    for batch in points.chunks(BATCH) {
        answers.extend(model.field().evaluate_crowd(batch));
        advance(batch.len() as u64)?;
    }
    Ok(answers)
}

/// What the page takes of answers.
pub fn irradiance(answers: &[Irradiance]) -> Vec<Rgb> {
    answers.iter().map(|light| light.total().max(Rgb::ZERO)).collect()
}

fn named(light: &Alone, answers: &[Irradiance]) -> ViewLight {
    ViewLight {
        name: light.name.clone(),
        irradiance: irradiance(answers),
        turned: Vec::new(),
        glowing: light.mesh.map(|mesh| mesh as u32).into_iter().collect(),
        is_sky: light.is_sky,
    }
}

/// That of a small picture.
fn exposure(model: &Model, view: &View) -> Result<f32> {
    let mut small = view.clone();
    small.camera.size = view.camera.size.map(|pixels| pixels.div_ceil(SMALLER));
    let evaluate = |points: &[SurfacePoint]| model.field().evaluate(points);
    let film = render(&model.scene, &model.bvh, &evaluate, (&small, Quality::PREVIEW), &|_| Ok(()))?;
    Ok(film.exposure())
}
