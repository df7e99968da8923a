//! Refinement for lights that may be switched: against each by itself.

use super::alone::Alone;
use super::{Work, refine};
use crate::archive::Ledger;
use crate::bake::laws::Plan;
use crate::bake::pipeline::{PipelineReport, find, judged};
use crate::bake::report::progress::{Monitor, Stage};
use crate::bake::report::summary::LightEstimate;
use crate::error::Result;

/// Points that judge one light of several: what they say is known to a tenth.
const JUDGES: usize = 150;

/// Refines against each light by itself, and judges each.
///
/// # Errors
/// The ledger's.
pub fn refined<'a>(
    mut work: Work<'a>,
    lights: &[Alone],
    (plan, bounces): (&Plan, Option<usize>),
    (monitor, ledger): (&dyn Monitor, &Ledger<'_>),
    report: &mut PipelineReport,
) -> Result<Work<'a>> {
    let stage = Stage::start(monitor, "lights", "lights", Some(2 * lights.len() as u64));
    // Each may ask for as much as one alone would: what one has got the next needs no more.
    let room = refine::room(&work);
    let mut levels = Vec::with_capacity(lights.len());
    for light in lights {
        let level;
        (work, level) = work.lit_by(light, |lit| {
            find(lit, (plan, bounces), ledger)?;
            refine::split(lit, plan, room, ledger)?;
            Ok(lit.solution.level)
        })?;
        levels.push(if level > 0.0 { level.recip() } else { 0.0 });
        stage.advance(1)?;
    }
    // Rows of their own come after all that is split; the same sites ask for them whatever the light (docs/theory.md).
    (work, ()) = work.lit_by(&Alone::together(lights, &levels), |lit| {
        find(lit, (plan, bounces), ledger)?;
        refine::own(lit, plan, ledger)
    })?;
    for light in lights {
        let estimate;
        (work, estimate) = work.lit_by(light, |lit| {
            find(lit, (plan, bounces), ledger)?;
            let smooth = lit.smooth();
            judged(&lit.field(plan, &smooth), plan, (JUDGES, &mut report.rays), ledger)
        })?;
        report.lights.push(LightEstimate { name: light.name.clone(), error: estimate.error });
        stage.advance(1)?;
    }
    report.stages.push(stage.finish());
    Ok(work)
}
