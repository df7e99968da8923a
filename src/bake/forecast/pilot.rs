//! Scenes that are held in memory: baked twice at coarser targets, and what grew from the first to the second grows on.

use std::sync::Mutex;

use super::{Forecast, StageForecast};
use crate::bake::laws::Plan;
use crate::bake::model::Model;
use crate::bake::options::Options;
use crate::bake::pictures;
use crate::bake::pipeline::{self, AIM, Stand};
use crate::bake::relight::{RelightParams, Relighter};
use crate::bake::report::progress::{Monitor, Signal};
use crate::bake::report::summary::StageTime;
use crate::bake::report::usage::{Meter, Stopwatch, resident};
use crate::error::Result;
use crate::scene::Scene;

/// Targets of the pilots over that of the bake. What the finer one takes over the coarser one, the bake takes over it.
const FACTORS: [f64; 2] = [4.0, 2.0];

/// No stage grows faster than with this power of the target's inverse.
const STEEPEST: i32 = 2;

/// Archive bytes a triangle (corners, hierarchy, cells) and a site (itself, receivers around, their rows).
const BYTES: [f64; 2] = [84.0, 285.0];

/// Anonymous bytes of what pilots do without: ledgers, packed rows on their way, the picture.
const KEEPING: u64 = 20_000_000;

/// CPU seconds to pack and write what one ray met.
const STORE_SECONDS: f64 = 8.0e-8;

/// Archive bytes of a colour of a transfer.
const TRANSFER_BYTES: f64 = 5.9;

/// What one pilot took.
struct Pilot {
    stages: Vec<StageForecast>,
    sites: u64,
    rays: u64,
    /// Colours of transfers, at sites and receivers, of all lights together.
    transferred: u64,
}

/// Hears of stages in place of the user, and watches the memory of each.
struct Watcher<'a> {
    monitor: &'a dyn Monitor,
    meter: Mutex<Option<Meter>>,
    stages: Mutex<Vec<StageForecast>>,
}

impl Monitor for Watcher<'_> {
    fn start(&self, _: &str, _: &str, _: Option<u64>) {
        if let Ok(mut meter) = self.meter.lock() {
            *meter = Some(Meter::start());
        }
    }

    fn finish(&self, stage: &StageTime) {
        let peak = self.meter.lock().ok().and_then(|meter| Some(meter.as_ref()?.peak_anonymous_bytes()));
        if let Ok(mut stages) = self.stages.lock() {
            stages.push(StageForecast {
                name: stage.name.clone(),
                seconds: stage.seconds,
                cpu_seconds: stage.cpu_seconds,
                peak_anonymous_bytes: peak.unwrap_or_default(),
                disk_bytes: 0,
            });
        }
    }

    fn interrupted(&self) -> Option<Signal> {
        self.monitor.interrupted()
    }
}

/// Predicts a bake by pilots.
///
/// # Errors
/// As a bake's, but for those of writing.
pub fn forecast(scene: Scene, options: &Options, monitor: &dyn Monitor) -> Result<Forecast> {
    let (triangles, vertices) = (scene.triangles.len() as u64, scene.vertices.len() as u64);
    let watcher = Watcher { monitor, meter: Mutex::default(), stages: Mutex::default() };
    let (mut stand, _) = Stand::new(scene, &watcher)?;
    let ready =
        std::mem::take(&mut *watcher.stages.lock().unwrap_or_else(std::sync::PoisonError::into_inner));
    let base = resident().anonymous_bytes;
    let mut pilots = Vec::with_capacity(FACTORS.len());
    for factor in FACTORS {
        monitor.check()?;
        let (pilot, model) = fly(stand, options, factor, &watcher)?;
        pilots.push(pilot);
        stand = Stand { scene: model.scene, bvh: model.bvh, details: model.details };
    }
    let mut stages = ready;
    stages.extend(grow(&pilots, base));
    let [sites, rays, transferred] = [|p: &Pilot| p.sites, |p: &Pilot| p.rays, |p: &Pilot| p.transferred]
        .map(|of| grown(of(&pilots[0]) as f64, of(&pilots[1]) as f64));
    let archives = BYTES[0] * triangles as f64 + BYTES[1] * sites;
    let seconds = STORE_SECONDS * rays;
    let store =
        StageForecast { name: "store".into(), seconds, cpu_seconds: seconds, ..StageForecast::default() };
    // Pictures are made when all is stored.
    let before = stages.iter().position(|stage| stage.name == "mesh").unwrap_or(stages.len());
    stages.insert(before, StageForecast { disk_bytes: archives as u64, ..store });
    for stage in &mut stages {
        stage.disk_bytes += match stage.name.as_str() {
            "mesh" => 47 * vertices + 13 * triangles,
            "preview" => 400_000,
            "transfer" => (TRANSFER_BYTES * transferred) as u64,
            _ => 0,
        };
    }
    let sites = sites as u64;
    // Ledgers hold rows once more until the job is done.
    let passing_bytes = (BYTES[1] * sites as f64) as u64;
    Ok(Forecast { triangles, vertices, sites, passing_bytes, ..Forecast::of(stages) })
}

/// Bakes at a multiple of the target.
fn fly(stand: Stand, options: &Options, factor: f64, watcher: &Watcher<'_>) -> Result<(Pilot, Model)> {
    let target = (factor * options.error).min(1.0);
    let Options { basis, operator, seed, .. } = *options;
    let relightable = options.is_relightable(&stand.scene);
    let plan = Plan { target, basis, operator, relightable, ..Plan::new(AIM * target, seed) };
    let bounces = options.max_bounces.map(|n| n as usize);
    let (model, report) = pipeline::once(stand, &plan, bounces, watcher)?;
    let mut stages =
        std::mem::take(&mut *watcher.stages.lock().unwrap_or_else(std::sync::PoisonError::into_inner));
    if options.preview {
        for (time, share) in pictures::sample(&model, watcher)? {
            stages.push(StageForecast {
                name: time.name,
                seconds: time.seconds / share,
                cpu_seconds: time.cpu_seconds / share,
                peak_anonymous_bytes: resident().anonymous_bytes,
                disk_bytes: 0,
            });
        }
        watcher.stages.lock().unwrap_or_else(std::sync::PoisonError::into_inner).clear();
    }
    let mut pilot = Pilot { stages, sites: model.sites.len() as u64, rays: report.rays, transferred: 0 };
    let model = if relightable { transfer(model, (&plan, options), &mut pilot, watcher)? } else { model };
    Ok((pilot, model))
}

/// Solves for the lights that the job would keep.
fn transfer(
    model: Model,
    (plan, options): (&Plan, &Options),
    pilot: &mut Pilot,
    watcher: &Watcher<'_>,
) -> Result<Model> {
    let watch = Stopwatch::start();
    let bounces = options.max_bounces.map(|n| n as usize);
    let params = RelightParams { seed: plan.sites.seed, bounces, error: plan.tolerance };
    let mut relighter = Relighter::new(model, params).baked_by(options);
    relighter.each_transfer(&|| watcher.check(), &mut |_, transfer| {
        pilot.transferred += (transfer.irradiance.len() + transfer.radiosity.len()) as u64;
        Ok(())
    })?;
    pilot.stages.push(StageForecast {
        name: "transfer".into(),
        seconds: watch.seconds(),
        cpu_seconds: watch.cpu_seconds(),
        peak_anonymous_bytes: resident().anonymous_bytes,
        disk_bytes: 0,
    });
    Ok(relighter.into_model())
}

/// The stages at the target.
fn grow(pilots: &[Pilot], base: u64) -> Vec<StageForecast> {
    let [coarse, fine] = [&pilots[0].stages, &pilots[1].stages];
    let over = |bytes: u64| bytes.saturating_sub(base) as f64;
    // A picture is no more work for a finer target: of two samples the quicker one was disturbed less.
    let next = |name: &str, coarse: f64, fine: f64| match name {
        "preview" => coarse.min(fine),
        _ => grown(coarse, fine),
    };
    let stage = |(coarse, fine): (&StageForecast, &StageForecast)| StageForecast {
        name: fine.name.clone(),
        seconds: next(&fine.name, coarse.seconds, fine.seconds),
        cpu_seconds: next(&fine.name, coarse.cpu_seconds, fine.cpu_seconds),
        peak_anonymous_bytes: base
            + KEEPING
            + grown(over(coarse.peak_anonymous_bytes), over(fine.peak_anonymous_bytes)) as u64,
        disk_bytes: 0,
    };
    coarse.iter().zip(fine).map(stage).collect()
}

/// What comes after the coarser and the finer pilot's figure.
fn grown(coarse: f64, fine: f64) -> f64 {
    let step = FACTORS[0] / FACTORS[1];
    let ratio = if coarse > 0.0 { fine / coarse } else { 1.0 };
    fine * ratio.clamp(1.0, step.powi(STEEPEST))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_grows_goes_on_and_what_does_not_stays() {
        assert_eq!(grown(1.0, 2.0), 4.0);
        assert_eq!(grown(3.0, 3.0), 3.0);
        // Noise of small figures is no law.
        assert_eq!(grown(0.001, 0.1), 0.4);
        assert_eq!(grown(2.0, 1.0), 1.0);
    }
}
