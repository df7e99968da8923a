//! Other lights or albedos on the same geometry: R stays as it is, the lamps are looked at and the light is found anew.

use std::path::Path;
use std::sync::OnceLock;

use crate::archive::{Ledger, Tag};
use crate::bake::laws::Plan;
use crate::bake::model::{Model, materials};
use crate::bake::options::Options;
use crate::bake::pipeline::{self, PipelineReport, leaf_order};
use crate::bake::report::progress::{Monitor, Stage};
use crate::bake::store::{self, Purpose};
use crate::bake::work::alone::Even;
use crate::bake::work::look;
use crate::error::Result;
use crate::light::Rgb;
use crate::links::Surroundings;
use crate::links::lamps::{self, LampTree};
use crate::scatter::surface::Surface;
use crate::scene::Scene;
use crate::sites::{SiteId, Sites};

/// The model of a finished job with the lights and albedos of `scene`, whose geometry is the same.
///
/// Cost: rays to the lamps, a solution and the judgement; no site moves, no row is shot. Sites and receivers lie where the
/// light of before asked for them; the estimate says what that costs.
///
/// # Errors
/// What reading the job says, and the ledger's.
pub fn solve(
    job: &Path,
    scene: Scene,
    options: &Options,
    (monitor, ledger): (&dyn Monitor, &Ledger<'_>),
) -> Result<(Model, PipelineReport)> {
    let mut report = PipelineReport::default();
    let stage = Stage::start(monitor, "links", "sites", None);
    let relightable = options.is_relightable(&scene);
    let plan = Plan::new(options.error, options.seed);
    let mut model = Model { scene, smooth: OnceLock::new(), ..store::read(job, Purpose::Light)? };
    let surface = Surface::new(&model.scene, leaf_order(&model.bvh));
    let arrays = model.sites.to_arrays();
    let (sites, samples) = Sites::settle(arrays, &surface, &model.plots, plan.sites.seed);
    let (lamps, glowing) = lamps::split(&model.scene);
    (model.albedo, model.exitance) = materials(&model.scene, &sites, &samples, &glowing);
    // Sites lie on proxies where there are any, and see through them alone.
    let (proxy, near) = model.bvh.without_near();
    model.bvh = proxy;
    let Model { scene, bvh, graph, cells, .. } = &model;
    let around = Surroundings { scene, bvh, sites: &sites, graph, cells };
    let mut even = Even::new(scene, &lamps, relightable);
    even.level(&mut LampTree::new(&even.lamps), (0..sites.len()).map(|s| sites.point(SiteId(s as u32))));
    let (mut direct, rays) = look(around, (&samples, &even.lamps), &model.field.direct, ledger)?;
    direct.relight(&lamps);
    model.direct = direct;
    model.bvh = model.bvh.with_near(near);
    (model.lamps, model.sites) = (lamps, sites);
    report.rays += rays;
    stage.advance(model.sites.len() as u64)?;
    report.stages.push(stage.finish());

    let stage = Stage::start(monitor, "solve", "iterations", None);
    let largest_albedo = model.albedo.iter().map(|a| a.max_element()).fold(0.0, f32::max);
    let params = pipeline::iteration(largest_albedo, &plan, options.max_bounces.map(|n| n as usize));
    let receivers = 0..model.receivers.len() as u64;
    let gather = |radiosity: &[Rgb]| {
        ledger.keep(Tag::new("product"), receivers.clone(), || Ok(model.problem().gather(radiosity)))
    };
    let (solution, iterate) = model.problem().solve_by(gather, &params)?;
    model.solution = solution;
    stage.advance(iterate.iterations as u64)?;
    report.iterate = iterate;
    report.stages.push(stage.finish());

    pipeline::judge(&model, &plan, (monitor, ledger), &mut report)?;
    if report.estimate.error > options.error {
        monitor.warn(&format!(
            "sites lie where the light of before asked for them: estimated error {:.2} %; --restart lays them out anew",
            100.0 * report.estimate.error
        ));
    }
    Ok((model, report))
}
