//! The stages in their order, in memory: scene → sites → links → solution → judgement.

use std::sync::{Arc, OnceLock};

use super::job::streams::Details;
use super::laws::Plan;
use super::model::Model;
use super::report::progress::{Monitor, Stage};
use super::report::summary::LightEstimate;
use super::report::summary::StageTime;
use super::validate::{self, Estimate, ValidateParams};
use super::work::alone::{Alone, Even};
use super::work::grading::Shine;
use super::work::{Grounds, Layout, Work, refine, switched};
use crate::archive::{Ledger, One, Pause, Tag};
use crate::basis::Basis;
use crate::detail;
use crate::error::{Error, Result};
use crate::geometry::SurfacePoint;
use crate::light::Rgb;
use crate::links::lamps::shadow::Shadows;
use crate::links::lamps::{self, LampTree};
use crate::links::points::{Dense, MOST_SITES, Operator};
use crate::links::receivers::{LEAST_SHARE, Placement, Receivers, Sources};
use crate::links::spread::Spread;
use crate::rays::{Bvh, Packet};
use crate::scatter::Candidate;
use crate::scatter::surface::Surface;
use crate::scene::{Scene, Sky};
use crate::sites::SiteParams;
use crate::solve::iterate::{IterateParams, IterateReport};
use crate::solve::{Field, Solution};

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
    /// The same by light, of a bake that is meant for relighting.
    pub lights: Vec<LightEstimate>,
}

impl PipelineReport {
    /// The largest error of all that was judged.
    fn worst(&self) -> f64 {
        self.lights.iter().map(|light| light.error).fold(self.estimate.error, f64::max)
    }
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
    /// How light is interpolated.
    pub basis: Basis,
    /// What turns radiosity into irradiance.
    pub operator: Operator,
    /// Whether the error is each light's by itself.
    pub relightable: bool,
}

/// Rounds of refinement at the most.
const ROUNDS: u32 = 3;

/// The first plan aims this much below the target.
pub(super) const AIM: f64 = 0.9;

/// The estimate of a few hundred points is this uncertain: no plan is thrown away for less, but it is warned.
const LENIENCE: f64 = 1.15;

/// A plan that missed is followed by one that makes up for it, and this much tighter.
const TIGHTER: f64 = 0.85;

/// A scene ready for rays: what all plans share.
pub struct Stand {
    /// Triangles, materials and lights.
    pub scene: Scene,
    /// The ray engine.
    pub bvh: Bvh,
    /// What proxies in the scene stand for.
    pub details: Details,
}

impl Stand {
    /// Anonymous memory that the ray engine takes at least, on top of the scene: the archive of a scan of 1.3 million triangles
    /// holds 65 bytes of branches and packets for each. Building it takes more for a while, which the budget's watch sees.
    pub fn bytes(scene: &Scene) -> u64 {
        64 * scene.triangles.len() as u64
    }

    /// Builds the ray engine.
    ///
    /// # Errors
    /// [`Error::Interrupted`].
    pub fn new(scene: Scene, monitor: &dyn Monitor) -> Result<(Self, StageTime)> {
        let triangles = scene.triangles.len() as u64;
        let stage = Stage::start(monitor, "rays", "triangles", Some(triangles));
        let bvh = Bvh::build(&scene);
        stage.advance(triangles)?;
        Ok((Self { scene, bvh, details: Details::new() }, stage.finish()))
    }

    /// With what proxies in the scene stand for.
    #[must_use]
    pub fn with_details(self, details: Details) -> Self {
        if details.is_empty() {
            return self;
        }
        let near = Arc::new(detail::near(&self.scene, &details));
        Self { bvh: self.bvh.with_near(Some(near)), details, ..self }
    }
}

/// Where rounds keep what they have done.
pub trait Journal {
    /// What became of the rounds so far.
    fn rounds(&self) -> &Ledger<'_>;
    /// The blocks of a round, from 1; those of rounds before are not needed any more.
    ///
    /// # Errors
    /// What the ledger says on being resumed.
    fn round(&self, number: u32) -> Result<Ledger<'_>>;
}

/// Bakes by plans that tighten until the independent gather says that the target is met; also returns the last plan.
/// Keeps nothing on disk.
///
/// # Errors
/// [`Error::Interrupted`], and [`Error::Usage`] when the operator is not for so many sites.
pub fn reach(scene: &Scene, target: &Target, monitor: &dyn Monitor) -> Result<(Model, Plan, PipelineReport)> {
    let (stand, built) = Stand::new(scene.clone(), monitor)?;
    let (model, plan, mut report) = reach_on(stand, target, monitor)?;
    report.stages.insert(0, built);
    Ok((model, plan, report))
}

/// As [`reach`], from a scene that is ready for rays.
///
/// # Errors
/// As [`reach`].
pub fn reach_on(
    stand: Stand,
    target: &Target,
    monitor: &dyn Monitor,
) -> Result<(Model, Plan, PipelineReport)> {
    let pause = || monitor.check();
    reach_kept(stand, target, monitor, &Nothing(Ledger::idle(&pause), &pause))
}

/// A journal that keeps nothing.
struct Nothing<'a>(Ledger<'a>, Pause<'a>);

impl Journal for Nothing<'_> {
    fn rounds(&self) -> &Ledger<'_> {
        &self.0
    }

    fn round(&self, _: u32) -> Result<Ledger<'_>> {
        Ok(Ledger::idle(self.1))
    }
}

/// As [`reach`], with a journal: rounds and blocks that it holds are not done again.
///
/// # Errors
/// As [`reach`], and the journal's.
pub fn reach_kept(
    stand: Stand,
    target: &Target,
    monitor: &dyn Monitor,
    journal: &dyn Journal,
) -> Result<(Model, Plan, PipelineReport)> {
    let mut aim = AIM * target.error;
    let mut spent = PipelineReport::default();
    let mut stand = Some(stand);
    for round in 1..=ROUNDS {
        let Target { error, basis, operator, relightable, .. } = *target;
        let plan = Plan { target: error, basis, operator, relightable, ..Plan::new(aim, target.seed) };
        let mut made = None;
        let mut make = || -> Result<_> {
            let stand = stand.take().expect("each round gives the scene back");
            let ledger = journal.round(round)?;
            build_kept(stand, &plan, target.bounces, (monitor, &ledger))
        };
        let rounds = u64::from(round)..u64::from(round) + 1;
        let One([reached, rays]) = journal.rounds().keep(Tag::new("round"), rounds, || {
            let (model, report) = make()?;
            let found = [report.worst(), report.rays as f64];
            made = Some((model, report));
            Ok(One(found))
        })?;
        // No plan makes a contraction of the dense operator.
        let last = round == ROUNDS || operator == Operator::Dense;
        if reached <= LENIENCE * target.error || last {
            // An earlier run may have come to this end: its blocks make the model again.
            let (model, mut report) = made.map_or_else(make, Ok)?;
            if reached > target.error {
                let percent = |e: f64| format!("{:.2} %", 100.0 * e);
                monitor.warn(&format!(
                    "the target of {} was not reached: estimated error {}",
                    percent(target.error),
                    percent(reached)
                ));
            }
            report.rays += spent.rays;
            spent.stages.append(&mut report.stages);
            report.stages = spent.stages;
            return Ok((model, plan, report));
        }
        spent.rays += rays as u64;
        if let Some((model, mut report)) = made {
            spent.stages.append(&mut report.stages);
            stand = Some(Stand { scene: model.scene, bvh: model.bvh, details: model.details });
        }
        aim *= (TIGHTER * target.error / reached).clamp(0.4, TIGHTER);
    }
    unreachable!("the last round returns")
}

/// Radii up to this many times the smallest belong to corners, whose true radius is smaller still.
const CORNER: f32 = 1.5;

/// Lays out sites and links by a plan, solves for the light once and judges the result. Keeps nothing on disk.
///
/// # Errors
/// As [`reach`].
pub fn build(
    scene: Scene,
    plan: &Plan,
    bounces: Option<usize>,
    monitor: &dyn Monitor,
) -> Result<(Model, PipelineReport)> {
    let (stand, built) = Stand::new(scene, monitor)?;
    let (model, mut report) = once(stand, plan, bounces, monitor)?;
    report.stages.insert(0, built);
    Ok((model, report))
}

/// As [`build`], from a scene that is ready for rays.
///
/// # Errors
/// As [`reach`].
pub(super) fn once(
    stand: Stand,
    plan: &Plan,
    bounces: Option<usize>,
    monitor: &dyn Monitor,
) -> Result<(Model, PipelineReport)> {
    let pause = || monitor.check();
    build_kept(stand, plan, bounces, (monitor, &Ledger::idle(&pause)))
}

/// As [`build`], with a ledger: blocks that it holds are not made again.
fn build_kept(
    Stand { scene, bvh, details }: Stand,
    plan: &Plan,
    bounces: Option<usize>,
    (monitor, ledger): (&dyn Monitor, &Ledger<'_>),
) -> Result<(Model, PipelineReport)> {
    let mut report = PipelineReport::default();
    let stage = Stage::start(monitor, "rows", "receivers", None);
    // Where the scene is a proxy, sites lie on it and see each other through it.
    let (bvh, near) = bvh.without_near();
    let surface = Surface::new(&scene, leaf_order(&bvh));
    let (lamps, glowing) = lamps::split(&scene);
    let mut even = Even::new(&scene, &lamps, plan.relightable);
    let mut tree = LampTree::new(&even.lamps);
    let shadows = Shadows { tree: &tree, lamps: &even.lamps, bvh: &bvh };
    let shines = |at: &SurfacePoint| shadows.reach(at);
    let sources = Sources { shines: &shines, glowing: &glowing, sky: scene.sky.is_some() };
    let placement = Placement::grow(&surface, &bvh, &sources, &plan.receivers, ledger)?;
    stage.advance(placement.places.len() as u64)?;
    report.stages.push(stage.finish());

    let stage = Stage::start(monitor, "sites", "sites", None);
    even.level(&mut tree, placement.places.iter().map(|place| place.point));
    let grounds =
        Grounds { scene: &scene, bvh: &bvh, surface: &surface, lamps: &even.lamps, glowing: &glowing };
    let mut layout = lay(grounds, plan, (&placement, &tree, even.sky.as_ref()), ledger)?;
    layout.direct.relight(&lamps);
    stage.advance(layout.sites.len() as u64)?;
    report.rays += layout.rays;
    report.stages.push(stage.finish());

    // Receivers lie on the surface itself, and so does all that is asked from here on.
    let bvh = bvh.with_near(near);
    let grounds = Grounds { scene: &scene, bvh: &bvh, surface: &surface, lamps: &lamps, glowing: &glowing };
    let stage = Stage::start(monitor, "links", "sites", Some(layout.sites.len() as u64));
    let placement = placement.set_down((&scene, &bvh), &plan.receivers.rows, ledger)?;
    report.rays += placement.rays;
    let receivers = Receivers::settle(layout.around(grounds), placement, ledger)?;
    let spread = Spread::fit(layout.around(grounds), (&receivers, &layout.means), plan.basis, ledger)?;
    let placed = receivers.ray_count();
    let mut work = Work { grounds, layout, receivers, spread, solution: Solution::default() };
    stage.advance(work.layout.sites.len() as u64)?;
    report.stages.push(stage.finish());
    let watch = (monitor, ledger);
    let mixture = work.layout.mixture.take();
    let lights = mixture.map_or_else(Vec::new, |m| Alone::all(&scene, (&lamps, &glowing), &m));
    let mut work = refined(work, &lights, (plan, bounces), watch, &mut report)?;

    solve(&mut work, "solve", (plan, bounces), watch, &mut report)?;
    if plan.operator == Operator::Dense {
        solve_dense(&mut work, (plan, bounces), watch, &mut report)?;
    }
    // Those of the receivers placed by geometry are counted already.
    report.rays += work.receivers.ray_count() - placed + work.spread.rays;

    let Work { layout, receivers, spread, solution, .. } = work;
    let Layout { sites, graph, cells, plots, albedo, exitance, direct, .. } = layout;
    let field = plan.field();
    let model = Model {
        scene,
        bvh,
        details,
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
        smooth: OnceLock::new(),
    };
    judge(&model, plan, watch, &mut report)?;
    model.bvh.sound()?;
    Ok((model, report))
}

/// Splits receivers and gives sites rows of their own where the light asks for it, or each of several lights.
fn refined<'a>(
    mut work: Work<'a>,
    lights: &[Alone],
    (plan, bounces): (&Plan, Option<usize>),
    (monitor, ledger): (&dyn Monitor, &Ledger<'_>),
    report: &mut PipelineReport,
) -> Result<Work<'a>> {
    if !lights.is_empty() {
        return switched::refined(work, lights, (plan, bounces), (monitor, ledger), report);
    }
    solve(&mut work, "first light", (plan, bounces), (monitor, ledger), report)?;
    let stage = Stage::start(monitor, "refine", "receivers", None);
    let room = refine::room(&work);
    refine::split(&mut work, plan, room, ledger)?;
    refine::own(&mut work, plan, ledger)?;
    stage.advance(work.receivers.len() as u64)?;
    report.stages.push(stage.finish());
    Ok(work)
}

/// Lays out sites by what the receivers' rays met and by how the lamps' light varies in corners.
fn lay(
    grounds: Grounds<'_>,
    plan: &Plan,
    (placement, tree, sky): (&Placement, &LampTree, Option<&Sky>),
    ledger: &Ledger<'_>,
) -> Result<Layout> {
    let Grounds { scene, bvh, lamps, .. } = grounds;
    let shadows = Shadows { tree, lamps, bvh };
    let (radii, smallest) = (placement.radii(), placement.smallest_radius);
    let shine = Shine::new(shadows, sky, radii.representatives());
    let spacing = |at: &Candidate| {
        // Who asks to stop wants no sites: levels end here, the layout then errors.
        if ledger.pause().is_err() {
            return None;
        }
        let (radius, share) =
            radii.at(&at.point).filter(|_| placement.is_lit(scene, at.triangle, at.back))?;
        // Light from lamps and albedo vary even where nothing is near: never coarser than this, weighed by how much of
        // the light there comes from surfaces.
        let spacing =
            (radius * plan.site_spacing).min(smallest * plan.widest_spacing / share.max(LEAST_SHARE).sqrt());
        if radius > CORNER * smallest {
            return Some(spacing);
        }
        let variation = shine.variation(&at.point, 0.5 * spacing);
        Some(spacing * (plan.variation / variation).clamp(plan.closest, 1.0))
    };
    // Where surfaces are nearest most sites are: those get what they want, not up to twice as many.
    let sites = SiteParams { met: smallest * plan.site_spacing, ..plan.sites };
    let layout = Layout::new(grounds, plan, (&sites, &placement.places), spacing, ledger)?;
    if plan.operator == Operator::Dense && layout.sites.len() > MOST_SITES {
        let sites = layout.sites.len();
        let problem = format!("--operator dense is for at most {MOST_SITES} sites, here are {sites}");
        return Err(Error::Usage(format!("{problem}: raise --error, or leave the operator to rows")));
    }
    Ok(layout)
}

/// Solves for the light; what the solver did.
pub(super) fn find(
    work: &mut Work<'_>,
    (plan, bounces): (&Plan, Option<usize>),
    ledger: &Ledger<'_>,
) -> Result<IterateReport> {
    let params = iteration(work.largest_albedo(), plan, bounces);
    let gather = |radiosity: &[Rgb]| {
        ledger.keep(Tag::new("product"), 0..work.receivers.len() as u64, || {
            Ok(work.problem().gather(radiosity))
        })
    };
    let (solution, iterate) = work.problem().solve_by(gather, &params)?;
    work.solution = solution;
    Ok(iterate)
}

fn solve(
    work: &mut Work<'_>,
    name: &'static str,
    (plan, bounces): (&Plan, Option<usize>),
    (monitor, ledger): (&dyn Monitor, &Ledger<'_>),
    report: &mut PipelineReport,
) -> Result<()> {
    let stage = Stage::start(monitor, name, "iterations", None);
    report.iterate = find(work, (plan, bounces), ledger)?;
    stage.advance(report.iterate.iterations as u64)?;
    report.stages.push(stage.finish());
    Ok(())
}

/// When the solver stops: the tolerance is of the residual, the error is up to 1 / (1 − ρ) times as large.
pub(super) fn iteration(largest_albedo: f32, plan: &Plan, bounces: Option<usize>) -> IterateParams {
    let tolerance = plan.tolerance * f64::from(1.0 - largest_albedo).max(1e-3);
    IterateParams { tolerance, most: 2000, bounces, largest_albedo }
}

/// Solves once more, by the kernel between points in place of the rows.
fn solve_dense(
    work: &mut Work<'_>,
    (plan, bounces): (&Plan, Option<usize>),
    (monitor, ledger): (&dyn Monitor, &Ledger<'_>),
    report: &mut PipelineReport,
) -> Result<()> {
    let stage = Stage::start(monitor, "dense", "iterations", None);
    let dense = Dense::couple(work.layout.around(work.grounds), &work.receivers);
    let largest = dense.largest_row_sum();
    if largest > 1.0 {
        monitor.warn(&format!("rows of the dense operator sum to up to {largest:.2}: it makes light"));
    }
    let params = iteration(work.largest_albedo(), plan, bounces);
    let gather = |radiosity: &[Rgb]| {
        ledger.pause()?;
        Ok::<_, Error>(dense.gather(radiosity))
    };
    let (solution, iterate) = work.problem().solve_by(gather, &params)?;
    work.solution = solution;
    stage.advance(iterate.iterations as u64)?;
    report.iterate = iterate;
    report.stages.push(stage.finish());
    Ok(())
}

/// Judges a model by independent gathers.
pub(super) fn judge(
    model: &Model,
    plan: &Plan,
    (monitor, ledger): (&dyn Monitor, &Ledger<'_>),
    report: &mut PipelineReport,
) -> Result<()> {
    let stage = Stage::start(monitor, "judge", "points", None);
    report.estimate = judged(&model.field(), plan, (plan.judges, &mut report.rays), ledger)?;
    stage.advance(plan.judges as u64)?;
    report.stages.push(stage.finish());
    Ok(())
}

/// What so many independent gathers say; before a plan is thrown away it is heard again, by more.
pub(super) fn judged(
    field: &Field<'_>,
    plan: &Plan,
    (points, rays): (usize, &mut u64),
    ledger: &Ledger<'_>,
) -> Result<Estimate> {
    let params = ValidateParams { points, rays: plan.judge_rays, seed: plan.sites.seed ^ 0x1d9e };
    let mut estimate = validate::judge(field, &params, ledger)?;
    *rays += estimate.rays;
    if estimate.error > LENIENCE * plan.target {
        let params = ValidateParams { points: APPEAL * points, seed: params.seed ^ 0xa99e, ..params };
        estimate = validate::judge(field, &params, ledger)?;
        *rays += estimate.rays;
    }
    Ok(estimate)
}

/// A second judgement is by this many times as many points.
const APPEAL: usize = 3;

/// The triangles as the ray engine's leaves hold them: a spatially coherent order, without those no ray can meet.
pub fn leaf_order(bvh: &Bvh) -> impl Iterator<Item = u32> + '_ {
    bvh.view().packets().iter().flat_map(Packet::triangles)
}
