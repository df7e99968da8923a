//! The loop that adds receivers where leaving one out would be missed, until what is left fits the error budget.

use super::laws::Plan;
use super::report::progress::Monitor;
use super::work::Work;
use crate::error::Result;
use crate::light::mean_channel;
use crate::links::refine;
use crate::solve::Problem;

/// Dark surroundings count for more than their light does, down to this share of the mean.
const DARKEST: f32 = 0.05;

/// Radii below this share of the median are not split any more: such points gather for themselves.
const TINIEST: f32 = 0.06;

/// After a split the square of the error is about this share of what it was.
const LEFT_BY_SPLIT: f64 = 0.1;

/// One pass lowers the square of the error to this share at the most: the worst first, then they are looked at again.
const LEFT_BY_PASS: f64 = 0.25;


/// Splits receivers until the error of interpolation is within its budget; the solution is carried along.
pub fn refine(work: &mut Work<'_>, plan: &Plan, monitor: &dyn Monitor) -> Result<()> {
    for pass in 0..plan.passes {
        monitor.check()?;
        let chosen = choose(&work.problem(), &work.solution, plan.interpolation);
        if std::env::var_os("TRACE").is_some() {
            eprintln!("pass {pass}: {} receivers, {} chosen", work.receivers.len(), chosen.len());
        }
        if chosen.is_empty() {
            break;
        }
        let first = work.receivers.len();
        let around = work.layout.around(work.grounds);
        refine::split(around, &mut work.receivers, &chosen, plan.receivers.rows.seed ^ 0x511);
        work.spread.update(around, &work.receivers, &work.layout.means, first);
        let fresh = work.problem().row_lights(first..work.receivers.len(), &work.solution.radiosity);
        fresh.into_iter().for_each(|light| work.solution.add(light));
        work.solution.surplus = work.problem().surplus(&work.solution);
    }
    Ok(())
}

/// The receivers whose splitting lowers the error most, as many as it takes to come within the budget (a relative RMS
/// error).
fn choose(problem: &Problem<'_>, solution: &crate::solve::Solution, budget: f64) -> Vec<u32> {
    let bias = problem.bias(solution);
    let areas = problem.areas_of_receivers();
    let level = solution.level;
    let mut radii: Vec<f32> = problem.receivers.index.supports().iter().map(|s| s.radius).collect();
    radii.sort_unstable_by(f32::total_cmp);
    let smallest = radii[radii.len() / 2];
    let mut stakes: Vec<(f64, u32)> = Vec::with_capacity(bias.len());
    let mut total = 0.0;
    for (r, (&bias, &area)) in bias.iter().zip(&areas).enumerate() {
        let light = problem.direct.at_site(problem.lamps, problem.receivers.homes[r].index()) + solution.irradiance[r];
        let weight = (level / mean_channel(light).max(DARKEST * level)).sqrt();
        let tiny = problem.receivers.index.supports()[r].radius < smallest * TINIEST;
        if tiny { total += area; continue; }
        let bias = bias.min(level);
        stakes.push((area * f64::from(weight * bias * bias), r as u32));
        total += area;
    }
    let allowed = budget * budget * f64::from(level * level) * total;
    let mut left: f64 = stakes.iter().map(|s| s.0).sum();
    if std::env::var_os("TRACE").is_some() {
        let unknown: Vec<usize> = (0..bias.len()).filter(|&r| bias[r] > 1e10).collect();
        let area_unknown: f64 = unknown.iter().map(|&r| areas[r]).sum();
        eprintln!("   unknown {} of {} area {:.4}", unknown.len(), bias.len(), area_unknown / total);
        for &r in unknown.iter().step_by(unknown.len() / 8 + 1) { let s = problem.receivers.index.supports()[r]; eprintln!("      {:?} r {:.4} list {} home {:?} light {:?}", s.point, s.radius, problem.spread.receivers_of(problem.receivers.homes[r].index()).len(), problem.around.sites.point(problem.receivers.homes[r]), solution.irradiance[r]); }
        let mut radii: Vec<f32> = problem.receivers.index.supports().iter().map(|s| s.radius).collect(); radii.sort_unstable_by(f32::total_cmp);
        eprintln!("   radii {:?}", (0..=8).map(|k| radii[(radii.len() - 1) * k / 8]).collect::<Vec<_>>());
        eprintln!("   interpolation {:.3} % of {:.3} %", 100.0 * (left / total).sqrt() / f64::from(level), 100.0 * budget);
    }
    stakes.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let allowed = allowed.max(LEFT_BY_PASS * left);
    let mut chosen = Vec::new();
    for (stake, r) in stakes {
        if left <= allowed {
            break;
        }
        left -= (1.0 - LEFT_BY_SPLIT) * stake;
        chosen.push(r);
    }
    chosen.sort_unstable();
    chosen
}
