//! Other lights and other albedos for a finished job, without new rows.

mod answers;
mod apart;
mod arriving;
mod change;
mod keys;
mod lighting;
pub(super) mod mixture;
pub(super) mod origins;
mod relink;
mod sky;

use std::path::Path;
use std::sync::{Arc, OnceLock};

use super::job::{OPTIONS_FILE, read_side};
use super::laws::Plan;
use super::model::Model;
use super::options::Options;
use super::pipeline::leaf_order;
use super::store::{self, Purpose};
use super::transfer::Stored;
use crate::archive::Pause;
use crate::error::{Error, Result};
use crate::geometry::SurfacePoint;
use crate::light::harmonics::Harmonics;
use crate::light::{Rgb, mean_channel};
use crate::links::lamps::{self, Lamp, Shape};
use crate::scatter::surface::Surface;
use crate::scene::{Scene, Sky, Texture};
use crate::sites::{Samples, Sites};
use crate::solve::relight::{Links, Source, TogetherParams, Transfer, solve_together, superpose};
use crate::solve::transport::Transport;
use crate::solve::{Irradiance, Problem};

pub use answers::EachSky;
pub use apart::Alone;
use arriving::Arriving;
pub use keys::Keys;
pub(super) use lighting::with_strength;
pub use lighting::{Lighting, MeshLight, Paint, SkyImage, SkyLight};
use mixture::Mixture;
pub(super) use origins::Origin;
pub(super) use origins::switches;
use origins::{glow, is_lit, lamp_strength, origin_of, tint, tinted};

/// Transfers err by this much of themselves at most, so that sums of them are exact to 1e-5.
const TRANSFER_ERROR: f64 = 1.0e-6;

/// Products with the operator at the most.
const MOST_PRODUCTS: usize = 2000;

/// Lights that are solved together: as many as share a pass over the rows, twice.
const TOGETHER: usize = 10;

/// How a [`Relighter`] works.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RelightParams {
    /// The seed of the bake.
    pub seed: u64,
    /// Bounces of light to keep; None until converged.
    pub bounces: Option<usize>,
    /// Relative error that a solution may add.
    pub error: f64,
}

/// What relighting did.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RelightReport {
    /// Whether known lights were added up, rather than the light solved for.
    pub superposed: bool,
    /// Products with the operator, each for up to five lights.
    pub iterations: usize,
    /// Relative residual.
    pub residual: f64,
    /// Whether it is as small as was asked.
    pub converged: bool,
    /// Rays traced, for lamps that are new, moved or were black.
    pub rays: u64,
    /// What the answer does not know.
    pub warnings: Vec<String>,
}

/// A baked scene whose lights and albedos change: it holds the operator, starts from the light of before, and adds up the
/// lights that it has been told to [`Relighter::prepare`].
///
/// ```no_run
/// # fn main() -> glowtree::Result<()> {
/// use glowtree::bake::Relighter;
///
/// let mut relighter = Relighter::open("cornell.glow".as_ref())?;
/// relighter.prepare()?;
/// let mut lighting = relighter.baked().clone();
/// lighting.set(relighter.scene(), "light.radiance=1,2,3")?;
/// relighter.relight(&lighting)?; // a fraction of a millisecond
/// println!("{}", relighter.radiosity()[0]);
/// # Ok(())
/// # }
/// ```
///
/// Accuracy: sites and receivers lie where the light of the bake asked for them; lights that differ much from it, or were
/// not there, are known less well than the job's error target. Sums of prepared lights are those of a solution to 1e-5.
/// Memory: the rows, 6 B for each of their links once more, and 12 B a site and receiver for each light prepared. Deterministic for any number of threads.
pub struct Relighter {
    model: Model,
    params: RelightParams,
    /// The scene as it was baked, without its geometry.
    baked: Scene,
    baked_lighting: Lighting,
    baked_albedo: Vec<Rgb>,
    now: Lighting,
    /// Per mesh, whether rows meet its emission.
    glowing: Vec<bool>,
    /// Per mesh the exitance that rows meet, as the model's sites have it.
    glow: Vec<Rgb>,
    /// Per lamp of the model, whether its links are known.
    linked: Vec<bool>,
    /// What rows meet of the sky, and the lamp of its bright part, as they are untinted.
    sky: (Option<Sky>, Option<Lamp>),
    /// The sky that they are of.
    split_as: Option<SkyLight>,
    /// The harmonics of an image of a sky, before it is turned.
    projected: Option<(Arc<Texture>, Harmonics)>,
    mixture: Option<Mixture>,
    links: OnceLock<Links>,
    arriving: Arriving,
    /// The sites as they are settled, made when first asked for.
    settled: OnceLock<(Sites, Samples)>,
    transfers: Vec<(Origin, Transfer)>,
    /// Those that the job holds, of the albedos that were baked.
    stored: Option<Stored>,
    /// First guesses for transfers that new albedos made void.
    stale: Vec<(Origin, Transfer)>,
    /// Whether scene, lamps and glow of the model are those of `now`.
    synced: bool,
    /// Whether each light was refined against by itself, those that were off included.
    switched: bool,
    /// Whether a job keeps transfers of its sky's harmonics.
    turns: bool,
    /// Whether the model's solution is all there, not its radiosity and irradiance alone.
    whole: bool,
}

impl Relighter {
    /// Opens a finished job. It is read whole, and not changed. Transfers that it holds ([`super::transfer`]) are read when they
    /// are first asked for.
    ///
    /// # Errors
    /// Those of [`super::open`].
    pub fn open(job: &Path) -> Result<Self> {
        super::report::summary::Summary::read(job)?;
        let mut relighter = Self::read(job)?;
        relighter.stored = Stored::open(job)?;
        Ok(relighter)
    }

    /// Reads a job whose archives are there, finished or not; transfers that it holds are left aside.
    pub(super) fn read(job: &Path) -> Result<Self> {
        let options = read_side::<Options>(&job.join(OPTIONS_FILE))?;
        let options = options.ok_or_else(|| Error::NoJob { job: job.to_path_buf() })?;
        let plan = Plan::new(options.error, options.seed);
        let bounces = options.max_bounces.map(|n| n as usize);
        let params = RelightParams { seed: plan.sites.seed, bounces, error: plan.tolerance };
        Ok(Self::new(store::read(job, Purpose::Light)?, params).baked_by(&options))
    }

    /// Knows what the bake was asked for.
    pub(super) fn baked_by(self, options: &Options) -> Self {
        let (switched, asked) = (options.is_relightable(&self.baked), options.relightable == Some(true));
        // A constant sky looks the same however it is turned.
        let turns = self.baked.sky.as_ref().is_some_and(|sky| asked || matches!(sky, Sky::Image { .. }));
        Self { switched, turns, ..self }
    }

    /// The model; its lamps may be those of another light.
    pub(super) fn into_model(self) -> Model {
        self.model
    }

    /// From a model that holds its rows.
    pub fn new(model: Model, params: RelightParams) -> Self {
        let scene = &model.scene;
        let baked = Scene {
            vertices: Vec::new(),
            triangles: Vec::new(),
            meshes: scene.meshes.clone(),
            sky: scene.sky.clone(),
            lamps: scene.lamps.clone(),
            cameras: scene.cameras.clone(),
            warnings: Vec::new(),
            ..*scene
        };
        let lighting = Lighting::of(scene);
        let (lamps, glowing) = lamps::split(scene);
        let bright = lamps.into_iter().find(|lamp| matches!(lamp.shape, Shape::Sky(_)));
        let linked = linked(&model);
        let mut relighter = Self {
            params,
            baked,
            now: lighting.clone(),
            baked_albedo: model.albedo.clone(),
            glow: glow(&lighting, &glowing),
            glowing,
            linked,
            sky: (None, bright),
            split_as: lighting.sky.clone(),
            projected: None,
            baked_lighting: lighting,
            mixture: None,
            links: OnceLock::new(),
            arriving: Arriving::default(),
            settled: OnceLock::new(),
            transfers: Vec::new(),
            stored: None,
            stale: Vec::new(),
            synced: true,
            switched: false,
            turns: false,
            whole: true,
            model,
        };
        relighter.sky.0 = relighter.unit_sky(&relighter.now).map(|sky| sky.split().0);
        relighter
    }

    /// Names, materials and lights as they were baked, without geometry: what [`Lighting::set`] asks for.
    pub fn scene(&self) -> &Scene {
        &self.baked
    }

    /// The lighting that was baked.
    pub fn baked(&self) -> &Lighting {
        &self.baked_lighting
    }

    /// The lighting of the last [`Relighter::relight`].
    pub fn lighting(&self) -> &Lighting {
        &self.now
    }

    /// How this relighter works; changes hold from the next call on.
    pub fn params_mut(&mut self) -> &mut RelightParams {
        &mut self.params
    }

    /// Radiosity of the sites, W·m⁻², without the lamps' own exitance.
    pub fn radiosity(&self) -> &[Rgb] {
        &self.model.solution.radiosity
    }

    /// Irradiance at the receivers from surfaces and sky, W·m⁻².
    pub fn irradiance(&self) -> &[Rgb] {
        &self.model.solution.irradiance
    }

    /// The model in the light of now, ready to answer at any point; what that takes beyond the sites' radiosity is found when
    /// first asked for.
    ///
    /// Cost: once after each change some products with the operator.
    pub fn model(&mut self) -> &Model {
        self.sync();
        if !self.whole {
            let irradiance = std::mem::take(&mut self.model.solution.irradiance);
            self.model.solution = self.model.problem().completed(irradiance);
            self.model.smooth = OnceLock::new();
            self.whole = true;
        }
        &self.model
    }

    /// Irradiance at surface points, in order, as a job answers.
    pub fn evaluate(&mut self, points: &[SurfacePoint]) -> Vec<Irradiance> {
        self.model().field().evaluate(points)
    }

    /// Solves for each light by itself: those that were lit when baked, those that are now, and those that were off in a bake that
    /// is meant for relighting; from then on other strengths are
    /// sums. New albedos make it all void.
    ///
    /// Cost: a bake's solution for every five lights.
    ///
    /// # Errors
    /// None so far: with a pause, its.
    pub fn prepare(&mut self) -> Result<RelightReport> {
        self.prepare_with(&|| Ok(()))
    }

    /// As [`Relighter::prepare`], asking `pause` before every product.
    ///
    /// # Errors
    /// What `pause` says.
    pub fn prepare_with(&mut self, pause: Pause<'_>) -> Result<RelightReport> {
        let off = if self.switched { switches(&self.baked) } else { Vec::new() };
        let lit = |o: &Origin| is_lit(&self.now, *o) || is_lit(&self.baked_lighting, *o) || off.contains(o);
        let order = self.now.sky.as_ref().and_then(|sky| sky.harmonics);
        let by_harmonics = |o: &Origin| *o == Origin::Sky && order.is_some();
        let wanted = self.origins().into_iter().filter(|o| lit(o) && self.is_linked(*o) && !by_harmonics(o));
        let harmonics = (0..order.unwrap_or(0).pow(2)).map(Origin::Harmonic);
        self.prepare_each(wanted.chain(harmonics).collect(), pause)
    }

    /// Solves for units of lights that are not known yet.
    fn prepare_each(&mut self, mut wanted: Vec<Origin>, pause: Pause<'_>) -> Result<RelightReport> {
        self.recall(&wanted)?;
        wanted.retain(|o| self.transfers.iter().all(|(own, _)| own != o));
        let mut report = RelightReport { converged: true, ..RelightReport::default() };
        for some in wanted.chunks(TOGETHER) {
            let sources: Vec<Source> = some.iter().map(|&origin| self.unit_source(origin)).collect();
            self.synced = false;
            let guesses = some.iter().map(|origin| self.guess(*origin)).collect();
            let params = TogetherParams { error: TRANSFER_ERROR, ..self.together() };
            let (transfers, found) =
                solve_together((&self.transport(), self.links()), &sources, guesses, &params, pause)?;
            self.transfers.extend(some.iter().copied().zip(transfers));
            report.iterations += found.iterations;
            report.residual = report.residual.max(found.residual);
            report.converged &= found.converged;
        }
        Ok(report)
    }

    /// Changes lights and albedos.
    ///
    /// When all lights that are lit have been prepared and no albedo differs, they are added up; otherwise the light is solved
    /// for, starting from that of before. Lamps that are new, have moved, or were black when links were made are looked at: rays
    /// are traced for them alone.
    ///
    /// # Errors
    /// [`Error::Usage`] for values that light transport has no meaning for; nothing has changed then.
    pub fn relight(&mut self, to: &Lighting) -> Result<RelightReport> {
        self.relight_with(to, &|| Ok(()))
    }

    /// As [`Relighter::relight`], asking `pause` before every product.
    ///
    /// # Errors
    /// As there, and what `pause` says.
    pub fn relight_with(&mut self, to: &Lighting, pause: Pause<'_>) -> Result<RelightReport> {
        self.check(to)?;
        let mut report = RelightReport { converged: true, ..RelightReport::default() };
        let painted = self.now.meshes.iter().zip(&to.meshes).any(|(was, is)| was.paint != is.paint);
        let before = std::mem::replace(&mut self.now, to.clone());
        (self.synced, self.whole) = (false, false);
        self.turn_sky();
        self.warn_of_image(&before, &mut report);
        // First what no pause interrupts: `now` holds already.
        if painted {
            self.paint(&before);
        }
        self.link(&before, &mut report, pause)?;
        let coefficients = self.sky_coefficients();
        self.recall_all(coefficients.as_deref())?;
        let transfer = |&(origin, light): &(Origin, Rgb)| {
            self.transfers.iter().find(|(own, _)| *own == origin).map(|(_, c)| (c, light))
        };
        let shining = self.shining(coefficients.as_deref());
        if let Some(parts) = shining.iter().map(transfer).collect::<Option<Vec<_>>>() {
            let solution = &mut self.model.solution;
            superpose(&parts, &mut solution.irradiance, &mut solution.radiosity);
            report.superposed = true;
            return Ok(report);
        }
        self.sync();
        let source = self.source();
        let guess = vec![self.model.solution.irradiance.clone()];
        let params = self.together();
        let (transfers, found) =
            solve_together((&self.transport(), self.links()), &[source], guess, &params, pause)?;
        for Transfer { irradiance, radiosity } in transfers {
            (self.model.solution.irradiance, self.model.solution.radiosity) = (irradiance, radiosity);
        }
        (report.iterations, report.residual, report.converged) =
            (found.iterations, found.residual, found.converged);
        Ok(report)
    }

    fn check(&self, to: &Lighting) -> Result<()> {
        to.check(&self.baked)?;
        for (mesh, _) in &self.model.details {
            if matches!(to.meshes[*mesh].paint, Paint::Scaled(_)) {
                let name = &self.baked.meshes[*mesh].name;
                return Err(Error::Usage(format!(
                    "{name}: albedos of a streamed mesh cannot be scaled: give one"
                )));
            }
        }
        Ok(())
    }

    fn transport(&self) -> Transport<'_> {
        let Model { receivers, spread, albedo, .. } = &self.model;
        Transport { receivers, spread, albedo }
    }

    /// The rows as the product needs them, made when first asked for.
    fn links(&self) -> &Links {
        self.links.get_or_init(|| Links::new(&self.model.receivers))
    }

    fn together(&self) -> TogetherParams {
        let largest_albedo = self.model.albedo.iter().map(|a| a.max_element()).fold(0.0, f32::max);
        let RelightParams { bounces, error, .. } = self.params;
        TogetherParams { error, most: MOST_PRODUCTS, bounces, largest_albedo }
    }

    fn origins(&self) -> Vec<Origin> {
        let meshes = (0..self.now.meshes.len()).map(Origin::Mesh);
        meshes.chain((0..self.now.lamps.len()).map(Origin::Lamp)).chain([Origin::Sky]).collect()
    }

    /// Whether a light's unit may be solved for: rows meet it, or links to it are known.
    fn is_linked(&self, origin: Origin) -> bool {
        let own = |k: &usize| origin_of(&self.model.lamps, *k) == origin;
        let lamp = (0..self.linked.len()).find(own);
        match origin {
            Origin::Mesh(mesh) if self.glowing[mesh] => true,
            Origin::Sky if self.sky.1.is_none() => true,
            Origin::Harmonic(_) => true,
            _ => lamp.is_some_and(|k| self.linked[k]),
        }
    }

    fn guess(&self, origin: Origin) -> Vec<Rgb> {
        let known = self.stale.iter().find(|(own, _)| *own == origin);
        known.map_or_else(|| vec![Rgb::ZERO; self.model.receivers.len()], |(_, c)| c.irradiance.clone())
    }

    /// One light alone, as bright as one.
    fn unit_source(&mut self, origin: Origin) -> Source {
        if let Origin::Harmonic(number) = origin {
            return self.harmonic_source(number);
        }
        let exitance = match origin {
            Origin::Mesh(mesh) if self.glowing[mesh] => {
                let glow = Rgb::splat(std::f32::consts::PI);
                self.mixture().mean(|own, _| if own == mesh { glow } else { Rgb::ZERO })
            }
            _ => vec![Rgb::ZERO; self.model.sites.len()],
        };
        for k in 0..self.model.lamps.len() {
            let own = origin_of(&self.model.lamps, k) == origin;
            let unit = if matches!(origin, Origin::Mesh(_)) { std::f32::consts::PI } else { 1.0 };
            self.model.lamps[k].strength = if own && self.linked[k] { Rgb::splat(unit) } else { Rgb::ZERO };
        }
        self.model.direct.relight(&self.model.lamps);
        let sky = if origin == Origin::Sky { self.sky_light(Rgb::ONE) } else { Vec::new() };
        Source { own: Problem { exitance: &exitance, ..self.model.problem() }.unreflected(), sky }
    }

    /// The sky without its tint and, if it is the same everywhere, its radiance.
    fn unit_sky(&self, lighting: &Lighting) -> Option<Sky> {
        let light = lighting.sky.clone()?;
        let unit = SkyLight { constant: light.constant.map(|_| Rgb::ONE), ..light };
        Some(unit.untinted(self.baked.sky.as_ref().unwrap_or(&Sky::Constant(Rgb::ONE)), self.baked.up))
    }

    fn forget(&mut self, origin: Origin) {
        if let Some(stored) = &mut self.stored {
            stored.forget(origin);
        }
        self.transfers.retain(|(own, _)| *own != origin);
        self.stale.retain(|(own, _)| *own != origin);
    }

    /// Sites with the samples that speak for them. Memory: of a bake's, which is kept.
    fn settled(&self) -> &(Sites, Samples) {
        let settle = |model: &Model| {
            let surface = Surface::new(&model.scene, leaf_order(&model.bvh));
            Sites::settle(model.sites.to_arrays(), &surface, &model.plots, self.params.seed)
        };
        self.settled.get_or_init(|| settle(&self.model))
    }

    fn mixture(&mut self) -> &Mixture {
        if self.mixture.is_none() {
            // Of the albedos that were baked.
            let meshes = std::mem::replace(&mut self.model.scene.meshes, self.baked.meshes.clone());
            let (sites, samples) = self.settled();
            self.mixture = Some(Mixture::new(&self.model.scene, sites, samples));
            self.model.scene.meshes = meshes;
        }
        self.mixture.as_ref().expect("made above")
    }

    /// Takes over the albedos of now.
    fn paint(&mut self, before: &Lighting) {
        let paints: Vec<Paint> = self.now.meshes.iter().map(|mesh| mesh.paint).collect();
        self.model.albedo = if paints.iter().all(|paint| *paint == Paint::Baked) {
            self.baked_albedo.clone()
        } else {
            self.mixture().mean(|mesh, baked| paints[mesh].over(baked))
        };
        for (k, mesh) in self.model.scene.meshes.iter_mut().enumerate() {
            if before.meshes[k].paint != paints[k] {
                mesh.albedo = paints[k].albedo(&self.baked.meshes[k].albedo);
            }
        }
        let fresh = std::mem::take(&mut self.transfers);
        self.stale.retain(|(own, _)| fresh.iter().all(|(origin, _)| origin != own));
        self.stale.extend(fresh);
    }

    fn show_meshes(&mut self) {
        let lights = self.model.scene.meshes.iter_mut().zip(&self.now.meshes);
        lights.for_each(|(mesh, light)| mesh.radiance = light.radiance);
    }

    /// Brings scene, lamps and glow of the model to the lighting of now.
    fn sync(&mut self) {
        if self.synced {
            return;
        }
        self.show_meshes();
        let model = &mut self.model;
        model.scene.lamps.iter_mut().zip(&self.now.lamps).for_each(|(lamp, kind)| lamp.kind = *kind);
        let light = tint(&self.now, Origin::Sky);
        let whole = self.unit_sky(&self.now);
        self.model.scene.sky = whole.map(|sky| tinted(&sky, light));
        self.model.direct.sky = match self.sky_coefficients() {
            Some(coefficients) => Some(self.banded_sky(coefficients)),
            None => self.sky.0.as_ref().map(|sky| tinted(sky, light)),
        };
        let bright = self.bright_strength();
        for k in 0..self.model.lamps.len() {
            // One without links was moved or turned while it was dark, or there is none in such a sky.
            let light = match origin_of(&self.model.lamps, k) {
                Origin::Sky => bright,
                other => lamp_strength(&self.now, other),
            };
            self.model.lamps[k].strength = if self.linked[k] { light } else { Rgb::ZERO };
        }
        self.model.direct.relight(&self.model.lamps);
        let glow = glow(&self.now, &self.glowing);
        if glow != self.glow {
            self.model.exitance = self.mixture().mean(|mesh, _| glow[mesh]);
            self.glow = glow;
        }
        self.synced = true;
    }
}

/// Per lamp, whether links to it are known: it was lit, or looked at all the same by a bake that is meant for relighting.
fn linked(model: &Model) -> Vec<bool> {
    let mut linked: Vec<bool> = model.lamps.iter().map(|lamp| mean_channel(lamp.strength) > 0.0).collect();
    let tree = &model.direct.tree;
    let mut met = vec![false; tree.clusters.len()];
    let links = model.direct.links.iter().filter(|link| link.coupling > 0.0);
    links.for_each(|link| met[link.cluster as usize] = true);
    for (c, _) in met.iter().enumerate().filter(|(_, met)| **met) {
        tree.units_of(c).iter().for_each(|unit| linked[unit.lamp as usize] = true);
    }
    linked
}
