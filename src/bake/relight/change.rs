//! What a change of lights asks of the links: a sky split anew, lamps that are looked at.

use super::lighting::{SkyLight, with_strength};
use super::origins::{Origin, is_lit, lamp_strength, origin_of, switches};
use super::relink::{Wanted, relink};
use super::{Lighting, RelightReport, Relighter};
use crate::archive::{Ledger, Pause};
use crate::error::Result;
use crate::light::Rgb;
use crate::links::lamps::tree::MOST_APART;
use crate::links::lamps::{self, Lamp, Shape};
use crate::scene::LampKind;

impl Relighter {
    /// Splits the sky anew where it is another than it was split as. One that is seen by harmonics is not split at all.
    pub(super) fn turn_sky(&mut self) {
        let now = self.now.sky.as_ref();
        if now.is_some_and(|sky| sky.harmonics.is_some()) || is_same_sky(now, self.split_as.as_ref()) {
            return;
        }
        self.split_as = self.now.sky.clone();
        let split = self.unit_sky(&self.now).map(|sky| sky.split());
        let (rest, bright) = split.map_or((None, None), |(rest, bright)| (Some(rest), bright));
        let lamp = |bright| Lamp { name: "sky".into(), strength: Rgb::ONE, shape: Shape::Sky(bright) };
        self.sky = (rest, bright.map(lamp));
        self.forget(Origin::Sky);
        self.arriving.forget_sky();
        let skies = |k: &usize| matches!(self.model.lamps[*k].shape, Shape::Sky(_));
        (0..self.linked.len())
            .filter(skies)
            .collect::<Vec<_>>()
            .into_iter()
            .for_each(|k| self.linked[k] = false);
    }

    /// Makes links to lamps that have none.
    pub(super) fn link(
        &mut self,
        before: &Lighting,
        report: &mut RelightReport,
        pause: Pause<'_>,
    ) -> Result<()> {
        for k in 0..self.now.lamps.len() {
            let shape = |kind: &LampKind| with_strength(kind, Rgb::ZERO);
            if shape(&before.lamps[k]) != shape(&self.now.lamps[k]) {
                self.forget(Origin::Lamp(k));
                for lamp in 0..self.linked.len() {
                    self.linked[lamp] &= origin_of(&self.model.lamps, lamp) != Origin::Lamp(k);
                }
            }
        }
        self.warn_of_new(report);
        let wanted = self.wanted(report);
        if !wanted.iter().any(Wanted::is_new) {
            return Ok(());
        }
        self.settled();
        let Some((sites, samples)) = self.settled.get() else { unreachable!("settled above") };
        let ledger = Ledger::idle(pause);
        let (rays, linked) = relink(&mut self.model, &wanted, (sites, samples), &ledger)?;
        (report.rays, self.linked) = (rays, linked);
        self.arriving.forget_lamps();
        Ok(())
    }

    fn warn_of_new(&self, report: &mut RelightReport) {
        let known = if self.switched { switches(&self.baked) } else { Vec::new() };
        let new = |o: &Origin| !is_lit(&self.baked_lighting, *o) && !known.contains(o);
        let fresh = |o: &Origin| is_lit(&self.now, *o) && new(o);
        for origin in self.origins().into_iter().filter(fresh) {
            let name = origin.name(&self.baked);
            report.warnings.push(format!(
                "{name} gave no light when baked: sites lie where the light of then asked for them; bake with it lit for the error \
                 target to hold"
            ));
        }
        if self.model.lamps.len() > MOST_APART && self.now != self.baked_lighting {
            report.warnings.push(format!(
                "more than {MOST_APART} lamps are seen as clusters: lamps of one cluster share what they are seen of"
            ));
        }
    }

    /// The lamps of the lighting now. Meshes that did not emit become lamps or are met by rows, as a bake would have it.
    fn wanted(&mut self, report: &mut RelightReport) -> Vec<Wanted> {
        let is_lamp =
            |m: usize| (0..self.linked.len()).any(|k| origin_of(&self.model.lamps, k) == Origin::Mesh(m));
        let fresh: Vec<usize> = (0..self.now.meshes.len())
            .filter(|&m| is_lit(&self.now, Origin::Mesh(m)) && !self.glowing[m] && !is_lamp(m))
            .collect();
        let mut new_emitters = Vec::new();
        if !fresh.is_empty() {
            self.show_meshes();
            let (lamps, glowing) = lamps::split(&self.model.scene);
            let own = |lamp: &Lamp| matches!(&lamp.shape, Shape::Emitter(e) if fresh.contains(&e.mesh));
            new_emitters.extend(lamps.into_iter().filter(own));
            for &m in fresh.iter().filter(|&&m| glowing[m]) {
                self.glowing[m] = true;
                let name = &self.baked.meshes[m].name;
                report.warnings.push(format!("{name} is large: its light is met by rows, not aimed for"));
            }
        }
        let mut wanted: Vec<Wanted> = Vec::new();
        for (k, lamp) in self.model.lamps.iter().enumerate() {
            let shape = match &lamp.shape {
                Shape::Sky(_) => continue,
                Shape::Punctual(_) => {
                    let Origin::Lamp(own) = origin_of(&self.model.lamps, k) else { continue };
                    Shape::Punctual(self.now.lamps[own])
                }
                Shape::Emitter(emitter) => Shape::Emitter(emitter.clone()),
            };
            let strength = lamp_strength(&self.now, origin_of(&self.model.lamps, k));
            let lamp = Lamp { strength, shape, name: lamp.name.clone() };
            wanted.push(Wanted { lamp, known: Some(k).filter(|&k| self.linked[k]) });
        }
        wanted.extend(new_emitters.into_iter().map(|lamp| Wanted { lamp, known: None }));
        if let Some(bright) = &self.sky.1 {
            let strength = self.bright_strength();
            let known = (0..self.linked.len())
                .find(|&k| self.linked[k] && matches!(self.model.lamps[k].shape, Shape::Sky(_)));
            wanted.push(Wanted { lamp: Lamp { strength, ..bright.clone() }, known });
        }
        wanted
    }
}

/// Whether two skies differ in their tints at most; constant ones are each other's.
fn is_same_sky(a: Option<&SkyLight>, b: Option<&SkyLight>) -> bool {
    match (a, b) {
        (Some(a), Some(b)) => match (a.constant, b.constant) {
            (Some(_), Some(_)) => true,
            (None, None) => a.rotate_degrees == b.rotate_degrees && a.image == b.image,
            _ => false,
        },
        (a, b) => a.is_none() && b.is_none(),
    }
}
