//! What a job holds, drawn: sites and who neighbours whom, levels, links, rows, and where errors are.

mod error_map;
mod levels;
mod links;
pub mod neighbourhood;
mod neighbourhoods;
mod row;
mod view;

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::links::rows::FIRST_MARK;
use crate::output::Advance;
use crate::solve::Field;
use view::Shot;

/// Surpluses from here on say that there were too few receivers around to tell.
const UNTOLD: f32 = 1.0e17;

/// What was drawn.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Drawn {
    /// The files, in the order they were written.
    pub files: Vec<PathBuf>,
    /// The receivers whose rows are shown.
    pub receivers: Vec<u32>,
}

/// A receiver and why it is shown.
#[derive(Debug, Clone, PartialEq)]
struct Chosen {
    receiver: u32,
    reason: String,
}

/// Writes all figures of a job into a folder that is there: `neighbourhoods`, `levels`, `links`, `row`, `error_map` and
/// `link_levels`, each as .svg and .png. `asked` names the receiver to show; without it those with the largest and the
/// median surplus and the one with the widest radius are.
///
/// The field's rows must be in memory. `advance` counts the pixels of the picture beneath two of the figures, about a
/// quarter of a million. The same job gives the same bytes.
///
/// # Errors
/// [`Error::Usage`] when there is no such receiver; what `advance` says; input/output errors.
pub fn write(field: &Field<'_>, asked: Option<u32>, folder: &Path, advance: &Advance<'_>) -> Result<Drawn> {
    let chosen = chosen(field, asked)?;
    let shot = Shot::of(field, advance)?;
    let shown = chosen.iter().find(|c| shot.shows_receiver(field, c.receiver)).or(chosen.first());
    let figures = [
        ("neighbourhoods", neighbourhoods::figure(field)),
        ("levels", levels::of_sites(field)),
        ("links", links::figure(field, &shot, shown)),
        ("row", row::figure(field, &chosen)),
        ("error_map", error_map::figure(field, &shot)),
        ("link_levels", levels::of_links(field)),
    ];
    let mut drawn = Drawn { receivers: chosen.iter().map(|c| c.receiver).collect(), ..Drawn::default() };
    for (name, figure) in figures {
        drawn.files.extend(figure.write(&folder.join(name))?);
        advance(0)?;
    }
    Ok(drawn)
}

/// The one that is asked for; else the largest and the median surplus among those that are known, and the widest radius.
fn chosen(field: &Field<'_>, asked: Option<u32>) -> Result<Vec<Chosen>> {
    let receivers = field.problem.receivers;
    let count = receivers.len() as u32;
    if let Some(receiver) = asked {
        if receiver >= count {
            let known = if count == 0 { "none".to_owned() } else { format!("0 to {}", count - 1) };
            return Err(Error::Usage(format!("the job has no receiver {receiver}; it has {known}")));
        }
        return Ok(vec![Chosen { receiver, reason: "as asked".into() }]);
    }
    let surplus = |r: &u32| field.solution.surplus[*r as usize];
    let mut by_surplus: Vec<u32> = (0..count).filter(|r| surplus(r) < UNTOLD).collect();
    by_surplus.sort_by(|a, b| surplus(a).total_cmp(&surplus(b)).then(b.cmp(a)));
    let radius = |r: &u32| receivers.index.supports()[*r as usize].radius;
    let widest = (0..count).max_by(|a, b| radius(a).total_cmp(&radius(b)).then(b.cmp(a)));
    let candidates = [
        (by_surplus.last().copied(), "largest surplus"),
        (by_surplus.get(by_surplus.len() / 2).copied(), "median surplus"),
        (widest, "widest radius"),
    ];
    let mut chosen: Vec<Chosen> = Vec::new();
    for (receiver, reason) in candidates {
        let Some(receiver) = receiver else { continue };
        match chosen.iter_mut().find(|c| c.receiver == receiver) {
            Some(known) => known.reason = format!("{}, {reason}", known.reason),
            None => chosen.push(Chosen { receiver, reason: reason.into() }),
        }
    }
    Ok(chosen)
}

/// What a receiver's rays met, the key of their lattice and their number: all that figures know of how rows are kept.
fn row<'a>(field: &Field<'a>, receiver: u32) -> (&'a [u32], u64) {
    let (rows, r) = field.problem.receivers.row(receiver as usize);
    (rows.row(r), rows.keys[r])
}

/// The sites that a row meets, ascending, and how many rays meet each.
fn links_of(met: &[u32]) -> Vec<(u32, u32)> {
    let mut sites: Vec<u32> = met.iter().copied().filter(|&m| m < FIRST_MARK).collect();
    sites.sort_unstable();
    sites.chunk_by(|a, b| a == b).map(|same| (same[0], same.len() as u32)).collect()
}

/// A length with three digits, in scene units.
fn length(field: &Field<'_>, local: f32) -> String {
    let value = f64::from(local) * field.problem.around.scene.placement.scale;
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let decimals = (2 - value.abs().log10().floor() as i32).max(0);
    if decimals > 8 { format!("{value:.2e}") } else { format!("{value:.*}", decimals as usize) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::links::rows::{BLACK, LOST, SKY};

    #[test]
    fn links_are_counted_without_marks() {
        assert_eq!(links_of(&[7, SKY, 3, 7, BLACK, 7, LOST, 3]), [(3, 2), (7, 3)]);
        assert_eq!(links_of(&[SKY]), []);
    }
}
