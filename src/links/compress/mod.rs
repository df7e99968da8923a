//! Rows as bytes, in two parts: the links, all that the product needs, and the order in which the rays met them.
//!
//! The [`merged`] links of a row say which sites it sees and by how many rays each; they are read as a stream. The
//! [`order`] says which ray met which: gradients, and the sky, ask for directions. Both together are the row bit by bit.

pub mod bits;
pub mod coins;
mod disc;
pub mod merged;
pub mod order;

use rayon::prelude::*;

use merged::{Block, Merged};
use order::View;

/// Puts rows back together: those from number `first` on, of which `keys` are the keys, into `met`, rows × rays.
///
/// Deterministic for any number of threads. Errors with a description when the bytes are no such rows of links to sites
/// that the view has.
pub fn decode(
    (links, order): (&[u8], &[u8]),
    (view, keys, first): (View<'_>, &[u64], usize),
    rays: u32,
    met: &mut [u32],
) -> Result<(), String> {
    let rows = met.len() / rays.max(1) as usize;
    let links = Block::new(links, rows, rays)?;
    let order = Runs::new(order, rows.div_ceil(order::RUN))?;
    let sites = view.positions.len() as u32;
    let a_run = order::RUN / merged::RUN;
    met.par_chunks_mut(order::RUN * rays.max(1) as usize).enumerate().try_for_each(|(run, met)| {
        let mut rows: Vec<Merged> = Vec::with_capacity(order::RUN);
        for part in (run * a_run..(run + 1) * a_run).take_while(|part| part * merged::RUN < links.rows()) {
            rows.append(&mut links.merged(part, sites)?);
        }
        order::decode(order.bytes(run), (view, keys, first + run * order::RUN), &rows, met)
    })
}

/// Streams behind a table of where each begins.
#[derive(Debug, Clone, Copy)]
struct Runs<'a> {
    bytes: &'a [u8],
    count: usize,
}

impl<'a> Runs<'a> {
    fn new(bytes: &'a [u8], count: usize) -> Result<Self, String> {
        let runs = Self { bytes, count };
        let table = 4 * count;
        if bytes.len() < table {
            return Err(format!("expected {count} offsets, got {} bytes", bytes.len()));
        }
        let starts: Vec<usize> = (0..count).map(|run| runs.start(run)).collect();
        if !starts.is_sorted()
            || starts.first().is_some_and(|&s| s < table)
            || runs.start(count) > bytes.len()
        {
            return Err("offsets out of range".to_owned());
        }
        if starts.last().is_some_and(|&s| s > bytes.len()) {
            return Err("offsets out of range".to_owned());
        }
        Ok(runs)
    }

    fn start(&self, run: usize) -> usize {
        let at = self.bytes.get(4 * run..4 * run + 4).filter(|_| run < self.count);
        at.and_then(|b| b.try_into().ok()).map_or(self.bytes.len(), |b| u32::from_le_bytes(b) as usize)
    }

    /// One stream, and what follows it.
    fn bytes(&self, run: usize) -> &'a [u8] {
        self.bytes.get(self.start(run)..).unwrap_or_default()
    }
}

/// Streams behind a table of where each begins, u32 each.
fn concatenate(runs: Vec<Vec<u8>>) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut start = 4 * runs.len();
    for run in &runs {
        bytes.extend_from_slice(&(start as u32).to_le_bytes());
        start += run.len();
    }
    runs.into_iter().for_each(|run| bytes.extend(run));
    bytes
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::geometry::{SurfacePoint, hash};
    use crate::links::rows::{BLACK, LOST, Rows, SKY};
    use crate::tree::Support;

    const RAYS: u32 = 77;

    /// Rows whose entries have nothing to do with directions, with every mark; some rows are all sky, lost or one site.
    fn rows(count: u64, sites: u32) -> Rows {
        let met = (0..count * u64::from(RAYS)).map(|i| {
            let row = i / u64::from(RAYS);
            match (row % 7, hash::mix2(1, i) % 8) {
                (1, _) | (_, 0) => SKY,
                (2, _) | (_, 1) => LOST,
                (3, _) => 5,
                (_, 2) => BLACK,
                (4, 3) => (hash::mix2(2, i) % u64::from(sites)) as u32,
                _ => (row % 40 + hash::mix2(2, i) % 50) as u32,
            }
        });
        Rows { rays: RAYS, keys: (0..count).collect(), met: met.collect(), summaries: vec![] }
    }

    fn places(rows: u64, sites: u32) -> (Vec<Support>, Vec<Vec3>) {
        let at = |i: u64| Vec3::new(hash::unit(3, i), hash::unit(4, i), hash::unit(5, i));
        let support = |i| Support { point: SurfacePoint { position: at(i), normal: Vec3::Z }, radius: 1.0 };
        ((0..rows).map(support).collect(), (0..u64::from(sites)).map(|s| at(s / 2)).collect())
    }

    #[test]
    fn rows_without_rhyme_or_reason_round_trip() {
        for count in [0, 1, 64, 65, 600] {
            let (rows, (supports, positions)) = (rows(count, 900), places(count, 900));
            let view = View { supports: &supports, positions: &positions };
            let whole = (0, count as usize);
            let (links, order) = (merged::encode(&rows, whole).0, order::encode(view, &rows, whole));
            let mut met = vec![0; rows.met.len()];
            decode((&links, &order), (view, &rows.keys, 0), RAYS, &mut met).expect("what was written");
            assert!(met == rows.met, "{count} rows");
        }
    }

    #[test]
    fn damage_is_named_or_harmless() {
        let (rows, (supports, positions)) = (rows(70, 900), places(70, 900));
        let view = View { supports: &supports, positions: &positions };
        let (links, order) = (merged::encode(&rows, (0, 70)).0, order::encode(view, &rows, (0, 70)));
        let mut met = vec![0; rows.met.len()];
        let mut read = |links: &[u8], order: &[u8]| {
            let outcome = decode((links, order), (view, &rows.keys, 0), RAYS, &mut met);
            // Whatever comes out, sites are sites.
            assert!(outcome.is_err() || met.iter().all(|m| !(900..LOST).contains(m)));
            outcome
        };
        assert!(read(&links[..7], &order).unwrap_err().contains("offsets"));
        assert!(read(&links[..links.len() / 2], &order).is_err());
        for at in 0..links.len() {
            let mut broken = links.clone();
            broken[at] ^= 1 << (at % 8);
            let _ = read(&broken, &order);
        }
        for at in 0..order.len().min(400) {
            let mut broken = order.clone();
            broken[at] ^= 1 << (at % 8);
            let _ = read(&links, &broken);
        }
        let _ = read(&links, &order[..order.len() / 2]);
    }

    #[test]
    fn sites_that_are_not_there_are_named() {
        let (rows, (supports, positions)) = (rows(9, 900), places(9, 900));
        let (few, many) = (&positions[..400], View { supports: &supports, positions: &positions });
        let (links, order) = (merged::encode(&rows, (0, 9)).0, order::encode(many, &rows, (0, 9)));
        let view = View { supports: &supports, positions: few };
        let mut met = vec![0; rows.met.len()];
        let problem = decode((&links, &order), (view, &rows.keys, 0), RAYS, &mut met).unwrap_err();
        assert!(problem.contains("names site"), "{problem}");
    }
}
