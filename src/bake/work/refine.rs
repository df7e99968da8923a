//! The loop that adds receivers where leaving one out would be missed, until what is left fits the error budget.

use super::Work;
use crate::archive::Ledger;
use crate::bake::laws::Plan;
use crate::error::Result;
use crate::light::mean_channel;
use crate::links::receivers::Receivers;
use crate::links::rows::RowParams;
use crate::links::{Surroundings, refine};
use crate::solve::{Problem, Solution};

/// Dark surroundings count for more than their light does, down to this share of the mean.
const DARKEST: f32 = 0.05;

/// Radii below this share of the median are not split any more: such points gather for themselves.
const TINIEST: f32 = 0.06;

/// After a split the square of the error is about this share of what it was.
const LEFT_BY_SPLIT: f64 = 0.1;

/// One pass lowers the square of the error to this share at the most: the worst first, then they are looked at again.
const LEFT_BY_PASS: f64 = 0.25;

/// Splitting adds at most a receiver for so many that geometry placed: where more are asked for, all of a rugged surface
/// asks, and its points gather for themselves at less cost.
const PLACED_PER_SPLIT: usize = 2;

/// A split adds about this many receivers.
const MADE_BY_SPLIT: usize = 5;

/// Splits receivers until the error of interpolation is within its budget; the solution is carried along. To be done before
/// any [`own`]. About `room` receivers may be added.
///
/// # Errors
/// The ledger's.
pub fn split(work: &mut Work<'_>, plan: &Plan, room: usize, ledger: &Ledger<'_>) -> Result<()> {
    let most = work.receivers.len() + room;
    for _ in 0..plan.passes {
        ledger.pause()?;
        let room = (most.saturating_sub(work.receivers.len()) / MADE_BY_SPLIT).min(work.receivers.len() / 4);
        let chosen = choose(&work.problem(), &work.solution, (plan.interpolation, room));
        if chosen.is_empty() {
            break;
        }
        let seed = plan.receivers.rows.seed ^ 0x511;
        let split = |around: Surroundings<'_>, receivers: &mut Receivers| {
            refine::split(around, receivers, (&chosen, seed), ledger)
        };
        extend(work, split, ledger)?;
    }
    Ok(())
}

/// Receivers that splitting may add to those that geometry placed.
pub fn room(work: &Work<'_>) -> usize {
    work.receivers.len() / PLACED_PER_SPLIT
}

/// Gives rows of their own to sites that nobody speaks for with confidence, as in the clefts of a scan; the solution is carried
/// along. What is wrong with single sites mostly averages out over a row, as the noise of short rows does.
///
/// # Errors
/// The ledger's.
pub fn own(work: &mut Work<'_>, plan: &Plan, ledger: &Ledger<'_>) -> Result<()> {
    // What is left after the first pass sees no receiver at all.
    for limit in [plan.site_error, f64::INFINITY] {
        ledger.pause()?;
        let chosen = work.problem().doubtful_sites(&work.solution, limit);
        if chosen.is_empty() {
            break;
        }
        let params = RowParams { rays: plan.own_rays, seed: plan.receivers.rows.seed ^ 0x0a5 };
        let own = |around: Surroundings<'_>, receivers: &mut Receivers| {
            refine::own(around, receivers, (&chosen, params), ledger)
        };
        extend(work, own, ledger)?;
    }
    Ok(())
}

/// Adds receivers, lets sites know and carries the solution along.
fn extend(
    work: &mut Work<'_>,
    add: impl FnOnce(Surroundings<'_>, &mut Receivers) -> Result<()>,
    ledger: &Ledger<'_>,
) -> Result<()> {
    let first = work.receivers.len();
    let around = work.layout.around(work.grounds);
    add(around, &mut work.receivers)?;
    work.spread.update(around, (&work.receivers, &work.layout.means), first, ledger)?;
    let fresh = work.problem().row_lights(first..work.receivers.len(), &work.solution.radiosity);
    fresh.into_iter().for_each(|light| work.solution.add(light));
    work.solution.surplus = work.problem().surplus(&work.solution);
    Ok(())
}

/// The receivers whose splitting lowers the error most, as many as it takes to come within the budget (a relative RMS
/// error), but at most `room`.
fn choose(problem: &Problem<'_>, solution: &Solution, (budget, room): (f64, usize)) -> Vec<u32> {
    let bias = problem.bias(solution);
    let areas = problem.areas_of_receivers();
    let level = solution.level;
    let median = median_radius(problem);
    let mut stakes: Vec<(f64, u32)> = Vec::with_capacity(bias.len());
    let mut total = 0.0;
    for (r, (&bias, &area)) in bias.iter().zip(&areas).enumerate() {
        let light = problem.direct.at_site(problem.lamps, problem.receivers.homes[r].index())
            + solution.irradiance[r];
        total += area;
        if problem.receivers.index.supports()[r].radius < TINIEST * median {
            continue;
        }
        let weight = (level / mean_channel(light).max(DARKEST * level)).sqrt();
        let bias = bias.min(level);
        stakes.push((area * f64::from(weight * bias * bias), r as u32));
    }
    let allowed = budget * budget * f64::from(level * level) * total;
    let mut left: f64 = stakes.iter().map(|s| s.0).sum();
    stakes.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let allowed = allowed.max(LEFT_BY_PASS * left);
    let mut chosen = Vec::new();
    for (stake, r) in stakes {
        if left <= allowed || chosen.len() >= room {
            break;
        }
        left -= (1.0 - LEFT_BY_SPLIT) * stake;
        chosen.push(r);
    }
    chosen.sort_unstable();
    chosen
}

fn median_radius(problem: &Problem<'_>) -> f32 {
    let mut radii: Vec<f32> = problem.receivers.index.supports().iter().map(|s| s.radius).collect();
    radii.sort_unstable_by(f32::total_cmp);
    radii.get(radii.len() / 2).copied().unwrap_or(0.0)
}
