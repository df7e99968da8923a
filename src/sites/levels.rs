//! The coarser levels: Poisson subsets of the finest sites, nested by construction.
//!
//! A level's darts are sites of a finer level, at most [`REACH`] times denser, so that a level costs a fraction of the finest one.
//! Every site of that finer level is covered at the level's spacing H, hence every point of the surface within
//! H (1 + 1/8 + 1/64 + …) < 1.15 H.

use super::candidates::Sides;
use super::darts::{self, BLOCK_BITS, Blocks, Dart};
use super::grid::{Frame, pack};
use super::{LevelRatio, SiteArrays};
use crate::scene::Scene;

/// A level's darts are the sites of the level whose spacing is this many times finer.
const REACH: u32 = 8;

/// Chooses the number of levels and every site's level. Sites must be in Morton order.
pub(super) fn assign(arrays: &mut SiteArrays, scene: &Scene, coarsest: usize) {
    let count = arrays.positions.len();
    let growth = f64::from(arrays.ratio.factor()).powi(2);
    let steps = (count as f64 / coarsest.max(1) as f64).ln() / growth.ln();
    arrays.finest = steps.clamp(0.0, 40.0) as u8;
    arrays.levels = vec![arrays.finest; count];
    let group = match arrays.ratio {
        LevelRatio::Two => REACH.ilog2() as u8,
        LevelRatio::RootTwo => 2 * REACH.ilog2() as u8,
    };
    let sides = Sides::new(scene);
    let mut members: Vec<u32> = (0..count as u32).collect();
    let mut fine = arrays.finest;
    while fine > 0 {
        let low = fine.saturating_sub(group);
        for level in low..fine {
            choose(arrays, &sides, &members, level);
        }
        members.retain(|&site| arrays.levels[site as usize] <= low);
        fine = low;
    }
}

/// Adds members to `level` until it is maximal among them.
fn choose(arrays: &mut SiteArrays, sides: &Sides, members: &[u32], level: u8) {
    let spacing = arrays.spacing * arrays.ratio.power(u32::from(arrays.finest - level));
    let doublings = (spacing / arrays.spacing).log2().ceil() as u32;
    let cell = Frame::new(arrays.corner, arrays.spacing).coarser(doublings);
    let dart = |site: u32| Dart {
        position: arrays.positions[site as usize],
        normal: arrays.normals[site as usize],
        two_sided: sides.two_sided(arrays.triangles[site as usize]),
        payload: site,
    };
    // Members are in Morton order, so each block's are one run.
    let (mut keys, mut starts) = (vec![], vec![]);
    let mut accepted: Vec<Vec<Dart<u32>>> = vec![];
    for (i, &site) in members.iter().enumerate() {
        let key = pack(cell(arrays.positions[site as usize]).map(|c| c >> BLOCK_BITS));
        if keys.last() != Some(&key) {
            keys.push(key);
            starts.push(i);
            accepted.push(vec![]);
        }
        if arrays.levels[site as usize] < level {
            accepted[keys.len() - 1].push(dart(site));
        }
    }
    starts.push(members.len());
    let fill = |block: usize, darts: &mut Vec<_>| {
        let run = &members[starts[block]..starts[block + 1]];
        darts
            .extend(run.iter().filter(|&&site| arrays.levels[site as usize] > level).map(|&site| dart(site)));
    };
    darts::throw(&Blocks::new(keys), spacing, &mut accepted, fill, &cell);
    for dart in accepted.iter().flatten() {
        let of = &mut arrays.levels[dart.payload as usize];
        *of = (*of).min(level);
    }
}
