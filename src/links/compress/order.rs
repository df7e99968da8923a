//! Which ray met which: the order of a row's links along the lattice, as far as geometry does not tell it.
//!
//! Once a row's links are known, a ray mostly met the one whose site lies nearest to its direction and still has rays to
//! be accounted for. So what is coded is the rank of the true one among the links around the ray (`disc.rs`), mostly nought, with an
//! adaptive coder whose contexts are how clear the choice is and what the rays before met. Where geometry knows nothing it costs bits, never
//! truth: any row comes back bit by bit. Both ends must round sines alike; a seal tells where they do not.

use glam::Vec3;
use rayon::prelude::*;

use super::coins::{Coder, Coin, Reader, Writer};
use super::disc::{Choice, Disc, Places, Reach};
use super::merged::{Links, Merged};
use crate::geometry::hash;
use crate::links::rows::{BLACK, Directions, FIRST_MARK, LOST, Rows, SKY};
use crate::tree::Support;

/// Rows a run: the coder starts anew in each.
pub const RUN: usize = 4 * super::merged::RUN;

/// Where rows start and what they end at.
#[derive(Clone, Copy)]
pub struct View<'a> {
    /// The receivers.
    pub supports: &'a [Support],
    /// The sites' positions.
    pub positions: &'a [Vec3],
}

/// The order of rows `first..last` as bytes: offsets of the runs (u32), runs.
pub fn encode(view: View<'_>, rows: &Rows, (first, last): (usize, usize)) -> Vec<u8> {
    let run = |start: usize| {
        let mut walk = Walk::new(Writer::default(), rows.rays);
        let (mut merged, mut links) = (Merged::default(), Links::default());
        let mut slots = vec![0; view.positions.len()];
        let mut row = vec![0; rows.rays as usize];
        for r in start..(start + RUN).min(last) {
            row.copy_from_slice(rows.row(r));
            links.merge(&row, &mut merged);
            // What is written is known to be right.
            let _ = walk.row((view, r, rows.keys[r]), &merged, &mut slots, &mut row);
        }
        walk.seal(&rows.met[start * rows.rays as usize..(start + RUN).min(last) * rows.rays as usize]);
        walk.coder.finish()
    };
    super::concatenate((first..last).into_par_iter().step_by(RUN).map(run).collect())
}

/// Puts links back into the order of their rays: rows `first …` into `met`.
///
/// Errors with a description when the bytes name a link that is not there.
pub fn decode(
    bytes: &[u8],
    (view, keys, first): (View<'_>, &[u64], usize),
    links: &[Merged],
    met: &mut [u32],
) -> Result<(), String> {
    let rays = met.len() / links.len().max(1);
    let mut walk = Walk::new(Reader::new(bytes), rays as u32);
    for (k, (merged, row)) in links.iter().zip(met.chunks_exact_mut(rays)).enumerate() {
        walk.row((view, first + k, keys[first + k]), merged, &mut [], row)?;
    }
    if walk.seal(met) {
        Ok(())
    } else {
        Err("the order of rays is another: damaged, or other sines".to_owned())
    }
}

/// Ranks from this on are refused: more than there are rays.
const MOST_DIGITS: u32 = 20;

/// One order in 2¹⁶ that is wrong is believed.
const SEAL_BITS: u32 = 16;

/// 2⁶⁴ over the golden ratio: odd, with bits everywhere.
const SEAL_FACTOR: u64 = 0x9e37_79b9_7f4a_7c15;

/// Chances of ranks beyond the first: of the number of digits, of the highest behind the leading one, of all others.
#[derive(Default)]
struct Ranks {
    digits: [Coin; MOST_DIGITS as usize],
    high: [Coin; MOST_DIGITS as usize],
    low: Coin,
}

impl Ranks {
    /// Codes a rank of at least 1.
    fn rank<C: Coder>(&mut self, coder: &mut C, rank: u32) -> Result<u32, String> {
        let highest = rank.max(1).ilog2();
        let mut digits = 0;
        while !coder.flip(&mut self.digits[digits as usize], digits == highest) {
            digits += 1;
            if digits == MOST_DIGITS {
                return Err("a rank without end".to_owned());
            }
        }
        let mut value = 1;
        for digit in (0..digits).rev() {
            let coin = if digit + 1 == digits { &mut self.high[digits as usize] } else { &mut self.low };
            value = value << 1 | u32::from(coder.flip(coin, rank >> digit & 1 == 1));
        }
        Ok(value)
    }
}

/// What the coder has learnt, and its state.
struct Walk<C> {
    coder: C,
    places: Places,
    disc: Disc,
    /// By what the last three rays met, how near the likeliest link is, and the share of marks among what is left.
    hit: [[[Coin; 4]; 10]; 8],
    /// By the last mark: whether it is the sky, whether it is black.
    mark: [[Coin; 2]; 3],
    /// By how clear the choice is and whether the last one was the first.
    first: [[Coin; 2]; 12],
    /// The next, by how clear the choice is.
    next: [Coin; 12],
    /// Whether another was near.
    near: Coin,
    /// Ranks near the ray, and in all.
    ranks: [Ranks; 2],
}

impl<C: Coder> Walk<C> {
    fn new(coder: C, rays: u32) -> Self {
        Self {
            coder,
            places: Places::new(rays),
            disc: Disc::default(),
            hit: Default::default(),
            mark: Default::default(),
            first: Default::default(),
            next: Default::default(),
            near: Coin::default(),
            ranks: Default::default(),
        }
    }

    /// Writes a row's order, or reads it.
    fn row(
        &mut self,
        (view, receiver, key): (View<'_>, usize, u64),
        merged: &Merged,
        slots: &mut [u32],
        row: &mut [u32],
    ) -> Result<(), String> {
        let at = view.supports[receiver].point;
        let frame = Directions::new(at.normal, key, row.len() as u32).frame();
        let note = |site, slot| {
            if C::WRITES {
                slots[site as usize] = slot;
            }
        };
        self.disc.set(&self.places, merged, (at.position, frame), view.positions, note);
        let mut marks = row.len() as u32 - self.disc.rays;
        let (mut before, mut last_mark, mut sure) = (7, 0, 1);
        let rays = row.len() as u32;
        for (k, place) in row.iter_mut().enumerate() {
            let left = rays - k as u32;
            let choice = self.disc.choice(&self.places, self.places.rays[k]);
            let hits = if self.disc.rays == 0 || marks == 0 {
                marks == 0
            } else {
                let near = near(choice.best, rays);
                let coin = &mut self.hit[before][near][(4 * marks / (left + 1)) as usize];
                self.coder.flip(coin, *place < FIRST_MARK)
            };
            before = (before << 1 | usize::from(hits)) & 7;
            if hits {
                let slot = if C::WRITES { slots[*place as usize] as usize } else { 0 };
                let slot = self.slot(&choice, slot, &mut sure)?;
                *place = self.disc.take(slot);
            } else {
                marks -= 1;
                last_mark = self.mark(*place, last_mark);
                *place = [SKY, BLACK, LOST][last_mark];
            }
        }
        Ok(())
    }

    /// Codes sixteen bits of a hash of what was met; whether they agree. Directions rounded otherwise must not go unnoticed.
    fn seal(&mut self, met: &[u32]) -> bool {
        let turn = |hash: u64, &met: &u32| (hash.rotate_left(23) ^ u64::from(met)).wrapping_mul(SEAL_FACTOR);
        let hash = hash::mix(met.iter().fold(0, turn));
        (0..SEAL_BITS).fold(true, |agrees, bit| {
            let own = hash >> bit & 1 == 1;
            agrees & (self.coder.flip(&mut Coin::default(), own) == own)
        })
    }

    fn mark(&mut self, met: u32, last: usize) -> usize {
        let coins = &mut self.mark[last];
        if self.coder.flip(&mut coins[0], met == SKY) {
            0
        } else if self.coder.flip(&mut coins[1], met == BLACK) {
            1
        } else {
            2
        }
    }

    /// Codes the slot of what was met: the likeliest near, the next, one by its rank near the ray, or by its rank in all.
    #[inline(always)]
    fn slot(&mut self, choice: &Choice, slot: usize, sure: &mut usize) -> Result<usize, String> {
        let number = choice.number();
        if number == 0 {
            return self.ranked(choice, (Reach::All, slot));
        }
        let (best, next) = (self.disc.slot(choice.best), self.disc.slot(choice.second));
        let clear = ((choice.second - choice.best) >> 22).min(11) as usize;
        let first = self.coder.flip(&mut self.first[clear][*sure], slot == best);
        *sure = usize::from(first);
        if first {
            return Ok(best);
        }
        if number == 1 {
            return self.ranked(choice, (Reach::All, slot));
        }
        if self.coder.flip(&mut self.next[clear], slot == next) {
            return Ok(next);
        }
        let near = C::WRITES && self.disc.is_near(choice, slot);
        let near = self.coder.flip(&mut self.near, near);
        self.ranked(choice, (if near { Reach::Near } else { Reach::All }, slot))
    }

    /// Codes a slot by its rank: of those near a ray, the first two are known to be none.
    fn ranked(&mut self, choice: &Choice, (reach, slot): (Reach, usize)) -> Result<usize, String> {
        let (ranks, known) = match reach {
            Reach::Near => (&mut self.ranks[0], 2),
            Reach::All => (&mut self.ranks[1], 0),
        };
        if C::WRITES {
            let rank = self.disc.rank(choice, (reach, slot));
            return ranks.rank(&mut self.coder, rank + 1 - known).map(|_| slot);
        }
        let rank = ranks.rank(&mut self.coder, 1)? - 1 + known;
        self.disc
            .ranked(choice, (reach, rank))
            .ok_or_else(|| format!("rank {rank} of {} links", self.disc.live))
    }
}

/// How near a key's link is, in octaves from a tenth of a ray's share of the disc or less to 9.
fn near(key: u32, rays: u32) -> usize {
    let octave = (f32::from_bits(key) * rays as f32 * 0.5).max(1.0).to_bits() >> 23;
    octave.saturating_sub(127).min(9) as usize
}
