//! The stages in their order, in memory: scene → sites → links → solution → judgement.

use super::laws::Plan;
use super::model::{Model, materials};
use super::report::progress::{Monitor, Stage};
use super::report::summary::StageTime;
use super::validate::{self, Estimate, ValidateParams};
use crate::error::Result;
use crate::geometry::SurfacePoint;
use crate::links::Surroundings;
use crate::links::direct::Direct;
use crate::links::lamps;
use crate::links::receivers::{Placement, Receivers, Sources, Spread};
use crate::rays::{Bvh, Packet};
use crate::scatter::Candidate;
use crate::scatter::surface::Surface;
use crate::scene::Scene;
use crate::sites::{Cells, Neighbours, Sites};
use crate::solve::Solution;
use crate::solve::iterate::{IterateParams, IterateReport};

/// What the stages did.
#[derive(Debug, Clone, Default)]
pub struct PipelineReport {
    /// Cost by stage.
    pub stages: Vec<StageTime>,
    /// Rays traced, all stages.
    pub rays: u64,
    /// The solver's.
    pub iterate: IterateReport,
    /// The independent gather's.
    pub estimate: Estimate,
}

/// What a bake is asked, as far as the stages know.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// Relative RMS error of irradiance.
    pub error: f64,
    /// Keys every random number.
    pub seed: u64,
    /// Bounces of light; None until converged.
    pub bounces: Option<usize>,
}

/// Rounds of refinement at the most.
const ROUNDS: usize = 3;

/// The first plan aims this much below the target, a plan that missed is followed by one this much tighter.
const AIM: f64 = 0.8;

/// Bakes by plans that tighten until the independent gather says that the target is met; also returns the last plan.
pub fn reach(scene: &Scene, target: &Target, monitor: &dyn Monitor) -> Result<(Model, Plan, PipelineReport)> {
    let mut aim = AIM * target.error;
    let mut spent = PipelineReport::default();
    for round in 1.. {
        let plan = Plan::new(aim, target.seed);
        let (model, mut report) = build(scene.clone(), &plan, target.bounces, monitor)?;
        report.rays += spent.rays;
        spent.stages.append(&mut report.stages);
        let reached = report.estimate.error;
        if reached <= target.error || round == ROUNDS {
            if reached > target.error {
                let percent = |e: f64| format!("{:.2} %", 100.0 * e);
                monitor.warn(&format!(
                    "the target of {} was not reached: estimated error {}",
                    percent(target.error),
                    percent(reached)
                ));
            }
            report.stages = spent.stages;
            return Ok((model, plan, report));
        }
        spent.rays = report.rays;
        aim *= (AIM * target.error / reached).clamp(0.4, AIM);
    }
    unreachable!("the last round returns")
}

/// Lays out sites and links by a plan, solves for the light once and judges the result.
pub fn build(
    scene: Scene,
    plan: &Plan,
    bounces: Option<usize>,
    monitor: &dyn Monitor,
) -> Result<(Model, PipelineReport)> {
    let mut report = PipelineReport::default();
    let stage = Stage::start(monitor, "rays", "triangles", Some(scene.triangles.len() as u64));
    let bvh = Bvh::build(&scene);
    stage.advance(scene.triangles.len() as u64)?;
    report.stages.push(stage.finish());

    let stage = Stage::start(monitor, "rows", "receivers", None);
    let surface = Surface::new(&scene, leaf_order(&bvh));
    let (lamps, glowing) = lamps::split(&scene);
    let tree = lamps::LampTree::new(&lamps);
    let shadows = lamps::shadow::Shadows { tree: &tree, lamps: &lamps, bvh: &bvh };
    let shines = |at: &SurfacePoint| shadows.reach(at);
    let sources = Sources { shines: &shines, glowing: &glowing, sky: scene.sky.is_some() };
    let placement = Placement::grow(&surface, &bvh, &sources, &plan.receivers);
    stage.advance(placement.places.len() as u64)?;
    report.stages.push(stage.finish());

    let stage = Stage::start(monitor, "sites", "sites", None);
    // Light from lamps and albedo vary even where nothing is near: never coarser than this, weighed by how much of the
    // light there comes from surfaces.
    let widest = placement.smallest_radius * plan.widest_spacing;
    let spacing = |at: &Candidate| {
        let (radius, share) =
            placement.radius_at(&at.point).filter(|_| placement.is_lit(&scene, at.triangle, at.back))?;
        Some((radius * plan.site_spacing).min(widest / share.max(1e-6).sqrt()))
    };
    let (sites, plots, samples) = Sites::scatter(&surface, &plan.sites, spacing);
    let (graph, linked) = Neighbours::link(&sites, &bvh);
    let cells = Cells::new(&surface, &plots);
    report.rays += linked.ray_count as u64;
    stage.advance(sites.len() as u64)?;
    report.stages.push(stage.finish());

    let (albedo, exitance) = materials(&scene, &sites, &samples, &glowing);
    let around = Surroundings { scene: &scene, bvh: &bvh, sites: &sites, graph: &graph, cells: &cells };
    let stage = Stage::start(monitor, "direct", "lamps", Some(lamps.len() as u64));
    let direct = Direct::look(around, &samples, &lamps, &plan.direct);
    report.rays += direct.rays;
    stage.advance(lamps.len() as u64)?;
    report.stages.push(stage.finish());

    let stage = Stage::start(monitor, "links", "sites", Some(sites.len() as u64));
    report.rays += placement.rays;
    let receivers = Receivers::settle(around, placement);
    let spread = Spread::fit(around, &receivers);
    report.rays += spread.rays;
    stage.advance(sites.len() as u64)?;
    report.stages.push(stage.finish());

    let field = plan.field();
    let solution = Solution::default();
    let mut model = Model {
        scene,
        bvh,
        sites,
        graph,
        cells,
        plots,
        lamps,
        albedo,
        exitance,
        direct,
        receivers,
        spread,
        solution,
        field,
    };
    solve(&mut model, plan, bounces, (monitor, &mut report))?;
    judge(&model, plan, (monitor, &mut report))?;
    Ok((model, report))
}

fn solve(
    model: &mut Model,
    plan: &Plan,
    bounces: Option<usize>,
    (monitor, report): (&dyn Monitor, &mut PipelineReport),
) -> Result<()> {
    let stage = Stage::start(monitor, "solve", "iterations", None);
    let largest_albedo = model.largest_albedo();
    let tolerance = plan.tolerance * f64::from(1.0 - largest_albedo).max(1e-3);
    let params = IterateParams { tolerance, most: 2000, bounces, largest_albedo };
    let (solution, iterate) = model.problem().solve(&params);
    model.solution = solution;
    stage.advance(iterate.iterations as u64)?;
    report.iterate = iterate;
    report.stages.push(stage.finish());
    Ok(())
}

fn judge(model: &Model, plan: &Plan, (monitor, report): (&dyn Monitor, &mut PipelineReport)) -> Result<()> {
    let stage = Stage::start(monitor, "judge", "points", None);
    let params = ValidateParams { points: plan.judges, rays: 512, seed: plan.sites.seed ^ 0x1d9e };
    report.estimate = validate::judge(&model.field(), &params);
    report.rays += report.estimate.rays;
    stage.advance(params.points as u64)?;
    report.stages.push(stage.finish());
    Ok(())
}

/// The triangles as the ray engine's leaves hold them: a spatially coherent order, without those no ray can meet.
pub fn leaf_order(bvh: &Bvh) -> impl Iterator<Item = u32> + '_ {
    bvh.view().packets().iter().flat_map(Packet::triangles)
}
