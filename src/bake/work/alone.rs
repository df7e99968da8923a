//! Lights by themselves: what a bake meant for relighting lays sites out for and refines against.
//!
//! A light that gives a hundredth of the light, or none, when the scene is baked may be all there is afterwards: sites lie where
//! each lamp's light varies, shadows are as well known for each, and receivers are split where any light asks for it.

use std::borrow::Cow;

use super::{Grounds, Layout, Work};
use crate::bake::relight::mixture::Mixture;
use crate::bake::relight::origins::{Origin, glow, is_lit, lamp_strength, origin_of, tinted};
use crate::bake::relight::{Lighting, switches, with_strength};
use crate::error::Result;
use crate::geometry::SurfacePoint;
use crate::light::{Rgb, mean_channel};
use crate::links::lamps::light::{Shares, weight};
use crate::links::lamps::tree::MOST_APART;
use crate::links::lamps::{Lamp, LampTree};
use crate::scene::{Scene, Sky};

/// Solutions at the most: more lights than this are taken in groups.
pub const MOST_GROUPS: usize = 16;

/// Places that tell how bright lamps are.
const MOST_PLACES: usize = 500;

/// The lamps and the sky as sites are laid out for them: none off, none brighter than others.
pub struct Even<'a> {
    baked: &'a [Lamp],
    /// Lamps, with other strengths.
    pub lamps: Cow<'a, [Lamp]>,
    /// Light from outside.
    pub sky: Option<Sky>,
}

impl<'a> Even<'a> {
    /// All as bright as one, to begin with; as they are if lights are not to be known by themselves.
    pub fn new(scene: &Scene, lamps: &'a [Lamp], by_themselves: bool) -> Self {
        if !by_themselves {
            return Self { baked: lamps, lamps: Cow::Borrowed(lamps), sky: scene.sky.clone() };
        }
        let unit = |lamp: &Lamp| Lamp { strength: Rgb::ONE, ..lamp.clone() };
        let sky = scene.sky.clone().map(|sky| match sky {
            Sky::Constant(Rgb::ZERO) => Sky::Constant(Rgb::ONE),
            lit => lit,
        });
        Self { baked: lamps, lamps: lamps.iter().map(unit).collect(), sky }
    }

    /// Sets the strengths of lamps that are to be known by themselves so that each sends as much to some places as a sky of
    /// radiance 1/π, were nothing in the way, and the tree's with them. More than [`MOST_APART`] lamps share clusters and are
    /// as they are baked, but for those that are off.
    pub fn level(&mut self, tree: &mut LampTree, places: impl ExactSizeIterator<Item = SurfacePoint>) {
        let Cow::Owned(lamps) = &mut self.lamps else { return };
        if lamps.len() > MOST_APART {
            let lit = || self.baked.iter().map(|lamp| lamp.strength).filter(|s| mean_channel(*s) > 0.0);
            let mean = lit().sum::<Rgb>() / lit().count().max(1) as f32;
            for (own, lamp) in lamps.iter_mut().zip(self.baked) {
                own.strength = if mean_channel(lamp.strength) > 0.0 { lamp.strength } else { mean };
            }
        } else {
            let step = places.len().div_ceil(MOST_PLACES).max(1);
            let places: Vec<SurfacePoint> = places.step_by(step).collect();
            let level = |root: u32| {
                let mut shares = Shares::new();
                places.iter().for_each(|at| tree.shares_of(root, lamps, at, &mut shares));
                weight(&shares) / places.len().max(1) as f32
            };
            let levels: Vec<f32> = tree.roots.iter().map(|&root| level(root)).collect();
            for (&root, level) in tree.roots.iter().zip(levels) {
                let lamp = tree.units[tree.clusters[root as usize].units.start as usize].lamp as usize;
                let baked = self.baked[lamp].strength;
                let hue = if mean_channel(baked) > 0.0 { baked / mean_channel(baked) } else { Rgb::ONE };
                lamps[lamp].strength = if level > 0.0 { hue / level } else { hue };
            }
        }
        tree.relight(lamps);
    }
}

/// Some of the lights, and darkness otherwise.
pub struct Alone {
    /// What the scene calls them.
    pub name: String,
    lamps: Vec<Lamp>,
    exitance: Vec<Rgb>,
    sky: Option<Sky>,
}

impl Alone {
    /// Each light of the scene, or each of [`MOST_GROUPS`] groups of them, as it is lit; those that are off as bright as one.
    /// `mixture` is that of the layout.
    pub fn all(scene: &Scene, (lamps, glowing): (&[Lamp], &[bool]), mixture: &Mixture) -> Vec<Self> {
        let lights = switches(scene);
        let groups = lights.len().min(MOST_GROUPS);
        let group = |g: usize| &lights[g * lights.len() / groups..(g + 1) * lights.len() / groups];
        (0..groups).map(|g| Self::of(group(g), scene, (lamps, glowing), mixture)).collect()
    }

    /// All lights at once, each times a weight.
    ///
    /// # Panics
    /// Without a light.
    pub fn together(lights: &[Self], weights: &[f32]) -> Self {
        let sum = |of: &dyn Fn(&Self) -> Rgb| -> Rgb {
            lights.iter().zip(weights).map(|(light, weight)| of(light) * *weight).sum()
        };
        let first = &lights[0];
        let lamp = |k: usize| Lamp { strength: sum(&|l| l.lamps[k].strength), ..first.lamps[k].clone() };
        let lamps = (0..first.lamps.len()).map(lamp).collect();
        let exitance = (0..first.exitance.len()).map(|site| sum(&|l| l.exitance[site])).collect();
        let sky = lights.iter().zip(weights).find_map(|(l, w)| Some(tinted(l.sky.as_ref()?, Rgb::splat(*w))));
        Self { name: "all lights".to_owned(), lamps, exitance, sky }
    }

    fn of(lights: &[Origin], scene: &Scene, (lamps, glowing): (&[Lamp], &[bool]), mixture: &Mixture) -> Self {
        let lighting = only(scene, lights);
        let lamps: Vec<Lamp> = (0..lamps.len())
            .map(|k| Lamp { strength: lamp_strength(&lighting, origin_of(lamps, k)), ..lamps[k].clone() })
            .collect();
        let glow = glow(&lighting, glowing);
        let exitance = mixture.mean(|mesh, _| glow[mesh]);
        let light = lighting.sky.as_ref().filter(|_| is_lit(&lighting, Origin::Sky));
        let sky = light
            .zip(scene.sky.as_ref())
            .map(|(light, sky)| tinted(&light.untinted(sky, scene.up).split().0, light.tint));
        let names: Vec<&str> = lights.iter().map(|light| light.name(scene)).collect();
        Self { name: names.join(", "), lamps, exitance, sky }
    }
}

/// A lighting of some lights alone.
fn only(scene: &Scene, lights: &[Origin]) -> Lighting {
    let mut lighting = Lighting::of(scene);
    for (k, mesh) in lighting.meshes.iter_mut().enumerate() {
        mesh.radiance = if lights.contains(&Origin::Mesh(k)) { mesh.radiance } else { Rgb::ZERO };
    }
    let baked = lighting.clone();
    for (k, lamp) in lighting.lamps.iter_mut().enumerate() {
        let wanted = lights.contains(&Origin::Lamp(k));
        if !wanted || !is_lit(&baked, Origin::Lamp(k)) {
            *lamp = with_strength(lamp, if wanted { Rgb::ONE } else { Rgb::ZERO });
        }
    }
    if let Some(sky) = &mut lighting.sky {
        let wanted = lights.contains(&Origin::Sky);
        if !wanted {
            sky.tint = Rgb::ZERO;
        } else if !is_lit(&baked, Origin::Sky) {
            sky.constant = Some(Rgb::ONE);
        }
    }
    lighting
}

impl<'a> Work<'a> {
    /// Does something to the work while some lights alone light it; the solution that is left is theirs.
    ///
    /// # Errors
    /// Those of what is done.
    pub fn lit_by<T>(
        mut self,
        light: &Alone,
        change: impl FnOnce(&mut Work<'_>) -> Result<T>,
    ) -> Result<(Self, T)> {
        let Layout { direct, exitance, .. } = &mut self.layout;
        direct.relight(&light.lamps);
        let sky = std::mem::replace(&mut direct.sky, light.sky.clone());
        let exitance = std::mem::replace(exitance, light.exitance.clone());
        let baked = self.grounds;
        let Work { layout, receivers, spread, solution, .. } = self;
        let grounds = Grounds { lamps: &light.lamps, ..baked };
        let mut lit = Work { grounds, layout, receivers, spread, solution };
        let done = change(&mut lit)?;
        let Work { mut layout, receivers, spread, solution, .. } = lit;
        layout.direct.relight(baked.lamps);
        (layout.direct.sky, layout.exitance) = (sky, exitance);
        Ok((Work { grounds: baked, layout, receivers, spread, solution }, done))
    }
}
