//! Live solves: the light at the page's vertices after an edit, each light by itself, in the page's own encoding.

use std::time::Instant;

use serde_json::json;

use super::desk::{Desk, Order, Outcome};
use super::edit::Edit;
use crate::archive::Pause;
use crate::bake::relight::{Alone, SkyLight};
use crate::bake::{Lighting, Relighter};
use crate::cli::verbs::page::{Shown, answers, irradiance};
use crate::error::{Error, Result};
use crate::geometry::SurfacePoint;
use crate::light::Rgb;
use crate::output::viewer::{Layer, Seams, ViewMesh};
use crate::scene::LampKind;

/// A job that edits are solved for.
pub struct Live {
    relighter: Relighter,
    mesh: ViewMesh,
    points: Vec<SurfacePoint>,
    level: f32,
    /// The lights, as `raw` has them.
    apart: Vec<Alone>,
    /// Each light's irradiance at the points.
    raw: Vec<Vec<Rgb>>,
    /// What pages are told, and how often it changed: albedo, then each light.
    layers: Vec<(u64, Layer)>,
}

/// Figures of a solve.
#[derive(Debug, Clone, Copy, Default)]
struct Effort {
    lights: usize,
    iterations: usize,
    rays: u64,
}

impl Live {
    /// From a job whose mesh and light a page was made of, lightened as the page has it.
    pub fn new(shown: Shown, mesh: ViewMesh, raw: Vec<Vec<Rgb>>, level: f32) -> Self {
        let Shown { relighter, points, apart, .. } = shown;
        let mut live = Self { relighter, mesh, points, level, apart, raw, layers: Vec::new() };
        let albedo = Layer::plain(&live.mesh.albedo);
        live.layers = [albedo].into_iter().chain(live.encoded()).map(|layer| (0, layer)).collect();
        live
    }

    /// Solves what comes, until the process ends.
    pub fn work(mut self, desk: &Desk) {
        loop {
            let order = desk.next();
            let outcome = match self.solve(&order.edit, &|| newest(desk)) {
                Ok(bytes) => Outcome::Done(bytes),
                Err(Error::Interrupted { .. }) => Outcome::Superseded,
                Err(Error::Usage(problem)) => Outcome::Refused(problem),
                Err(other) => Outcome::Failed(other.to_string()),
            };
            Order::answer(order, outcome);
        }
    }

    /// The answer to an edit: the layers that differ from those that the page has.
    fn solve(&mut self, edit: &Edit, pause: Pause<'_>) -> Result<Vec<u8>> {
        let started = Instant::now();
        let lighting = edit.lighting(self.relighter.scene(), self.relighter.baked())?;
        let effort = self.light(&lighting, pause)?;
        let albedo = Layer::plain(&self.albedo(&lighting));
        let layers: Vec<Layer> = [albedo].into_iter().chain(self.encoded()).collect();
        for ((version, old), new) in self.layers.iter_mut().zip(layers) {
            if *old != new {
                (*version, *old) = (*version + 1, new);
            }
        }
        Ok(self.reply(edit, effort, started.elapsed().as_secs_f64()))
    }

    /// Finds each light anew that is another than before.
    fn light(&mut self, lighting: &Lighting, pause: Pause<'_>) -> Result<Effort> {
        let wanted = lighting.apart(self.relighter.scene());
        let stale: Vec<usize> =
            (0..wanted.len()).filter(|&k| !is_same(&self.apart[k].lighting, &wanted[k].lighting)).collect();
        let mut effort = Effort { lights: stale.len(), ..Effort::default() };
        for (turn, &k) in stale.iter().enumerate() {
            let report = self.relighter.relight_with(&wanted[k].lighting, pause)?;
            effort.iterations += report.iterations;
            effort.rays += report.rays;
            if turn == 0 && stale.len() > 2 {
                // The others are solved for together.
                effort.iterations += self.relighter.prepare_with(pause)?.iterations;
            }
            let found = answers(self.relighter.model(), &self.points, &|_| pause())?;
            (self.raw[k], self.apart[k]) = (irradiance(&found), wanted[k].clone());
        }
        Ok(effort)
    }

    fn albedo(&self, lighting: &Lighting) -> Vec<Rgb> {
        let paints: Vec<_> = lighting.meshes.iter().map(|mesh| mesh.paint).collect();
        let vertices = self.mesh.albedo.iter().zip(&self.mesh.meshes);
        vertices.map(|(&baked, &mesh)| paints[mesh as usize].over(baked)).collect()
    }

    /// The lights as the page has them.
    fn encoded(&self) -> Vec<Layer> {
        let lights: Vec<&[Rgb]> = self.raw.iter().map(Vec::as_slice).collect();
        let seams = Seams::new(&self.mesh, &lights, self.level);
        let encode = |light: &Vec<Rgb>| {
            let mut light = light.clone();
            seams.lighten(&mut light);
            Layer::scaled(&light)
        };
        self.raw.iter().map(encode).collect()
    }

    /// A header's length, 4 bytes little-endian, the header in JSON, filled up with blanks to a multiple of four, and the words of
    /// its layers.
    fn reply(&self, edit: &Edit, effort: Effort, seconds: f64) -> Vec<u8> {
        let known = |k: usize| edit.have.get(k).is_some_and(|&version| version == self.layers[k].0);
        let sent: Vec<usize> = (0..self.layers.len()).filter(|&k| !known(k)).collect();
        let layer = |&k: &usize| {
            let (version, Layer { scale, .. }) = &self.layers[k];
            json!({ "layer": k, "version": version, "scale": scale })
        };
        let header = json!({
            "layers": sent.iter().map(layer).collect::<Vec<_>>(),
            "lights": effort.lights,
            "iterations": effort.iterations,
            "rays": effort.rays,
            "seconds": seconds,
        });
        let mut header = header.to_string();
        header.push_str(&" ".repeat(header.len().next_multiple_of(4) - header.len()));
        let mut bytes = (header.len() as u32).to_le_bytes().to_vec();
        bytes.extend(header.bytes());
        sent.iter().for_each(|&k| bytes.extend(&self.layers[k].1.words));
        bytes
    }
}

/// Whether no newer edit waits.
fn newest(desk: &Desk) -> Result<()> {
    if desk.has_newer() { Err(Error::Interrupted { terminated: false }) } else { Ok(()) }
}

/// Whether one light alone does what another does: lamps that are off may be anywhere.
fn is_same(a: &Lighting, b: &Lighting) -> bool {
    let lit = |kind: &&LampKind| {
        let (LampKind::Sun { irradiance: light, .. }
        | LampKind::Point { intensity: light, .. }
        | LampKind::Spot { intensity: light, .. }) = kind;
        *light != Rgb::ZERO
    };
    fn sky(lighting: &Lighting) -> Option<&SkyLight> {
        lighting.sky.as_ref().filter(|sky| sky.tint != Rgb::ZERO)
    }
    a.meshes == b.meshes && a.lamps.iter().filter(lit).eq(b.lamps.iter().filter(lit)) && sky(a) == sky(b)
}
