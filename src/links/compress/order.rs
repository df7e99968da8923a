//! Which ray met which: the order of a row's links along the lattice, as far as geometry does not tell it.
//!
//! Once a row's links are known, a ray mostly met the one whose site lies nearest to its direction and still has rays to
//! be accounted for. So what is coded is the rank of the true one by angle, mostly nought, with an adaptive coder whose
//! contexts are how clear the choice is and what the rays before met. Where geometry knows nothing it costs bits, never
//! truth: any row comes back bit by bit. Both ends must round sines alike; a seal tells where they do not.

use std::cmp::Ordering;

use glam::Vec3;
use rayon::prelude::*;

use super::coins::{Coder, Coin};
use super::merged::Merged;
use crate::geometry::hash;
use crate::links::rows::{BLACK, Directions, FIRST_MARK, LOST, Lattice, Rows, SKY, lattice};
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
        let mut walk = Walk::new(Coder::writer(), rows.rays);
        let (mut merged, mut hits) = (Merged::default(), Vec::new());
        for r in start..(start + RUN).min(last) {
            let mut row = rows.row(r).to_vec();
            merged.set(&row, &mut hits);
            // What is written is known to be right.
            let _ = walk.row((view, r, rows.keys[r]), &merged, &mut row);
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
    let mut walk = Walk::new(Coder::reader(bytes), rays as u32);
    for (k, (merged, row)) in links.iter().zip(met.chunks_exact_mut(rays)).enumerate() {
        walk.row((view, first + k, keys[first + k]), merged, row)?;
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

/// What the coder has learnt, and its state.
struct Walk<'a> {
    coder: Coder<'a>,
    lattice: Lattice,
    candidates: Candidates,
    /// By what the last three rays met, how near the nearest link is, and the share of marks among what is left.
    hit: [[[Coin; 4]; 10]; 8],
    /// By the last mark: whether it is the sky, whether it is black.
    mark: [[Coin; 2]; 3],
    /// By how clear the choice is and whether the last one was the first.
    first: [[Coin; 2]; 12],
    /// Digits of the rank beyond the first, and the highest of them.
    digits: [Coin; MOST_DIGITS as usize],
    high: [Coin; MOST_DIGITS as usize],
    low: Coin,
}

impl<'a> Walk<'a> {
    fn new(coder: Coder<'a>, rays: u32) -> Self {
        Self {
            coder,
            lattice: lattice(rays),
            candidates: Candidates::default(),
            hit: Default::default(),
            mark: Default::default(),
            first: Default::default(),
            digits: Default::default(),
            high: Default::default(),
            low: Coin::default(),
        }
    }

    /// Writes a row's order, or reads it.
    fn row(
        &mut self,
        (view, receiver, key): (View<'_>, usize, u64),
        merged: &Merged,
        row: &mut [u32],
    ) -> Result<(), String> {
        let at = view.supports[receiver].point;
        let directions = Directions::new(at.normal, key, row.len() as u32);
        self.candidates.set(merged, |site| view.positions[site as usize] - at.position);
        let mut marks = row.len() as u32 - self.candidates.rays;
        let (mut before, mut last_mark, mut sure) = (7, 0, 1);
        let lattice = self.lattice.clone();
        for (k, (place, point)) in row.iter_mut().zip(lattice.iter()).enumerate() {
            let left = (lattice.len() - k) as u32;
            let (best, second) = self.candidates.score(directions.at(*point));
            let hits = if self.candidates.rays == 0 || marks == 0 {
                marks == 0
            } else {
                let near = octave((1.0 - best) * lattice.len() as f32, 9);
                let coin = &mut self.hit[before][near][(4 * marks / (left + 1)) as usize];
                self.coder.flip(coin, *place < FIRST_MARK)
            };
            before = (before << 1 | usize::from(hits)) & 7;
            if hits {
                let clear = octave_halves((1.0 - second + 1e-7) / (1.0 - best + 1e-7), 11);
                let (rank, number) = self.rank(*place, (best, clear, sure))?;
                sure = usize::from(rank == 0);
                *place = self.candidates.take(number);
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
        let hash = met.iter().fold(0, |hash, &met| hash::mix2(hash, u64::from(met)));
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

    /// Codes the rank of what was met among the candidates; also its number.
    fn rank(&mut self, met: u32, (best, clear, sure): (f32, usize, usize)) -> Result<(usize, usize), String> {
        if self.candidates.sites.len() == 1 {
            return Ok((0, 0));
        }
        let known = self.coder.writes().then(|| self.candidates.rank(met, best));
        let (rank, number) = known.unwrap_or_default();
        let place = |candidates: &mut Candidates, rank| match known {
            Some(_) => number,
            None => candidates.at_rank(rank, best),
        };
        if self.coder.flip(&mut self.first[clear][sure], rank == 0) {
            return Ok((0, place(&mut self.candidates, 0)));
        }
        let highest = (rank.max(1) as u32).ilog2();
        let mut digits = 0;
        while !self.coder.flip(&mut self.digits[digits as usize], digits == highest) {
            digits += 1;
            if digits == MOST_DIGITS {
                return Err("a rank without end".to_owned());
            }
        }
        let mut value = 1;
        for digit in (0..digits).rev() {
            let coin = if digit + 1 == digits { &mut self.high[digits as usize] } else { &mut self.low };
            value = value << 1 | usize::from(self.coder.flip(coin, rank >> digit & 1 == 1));
        }
        if value >= self.candidates.sites.len() {
            return Err(format!("rank {value} of {} links", self.candidates.sites.len()));
        }
        Ok((value, place(&mut self.candidates, value)))
    }
}

/// ⌊log₂ x⌋, from 0 for what is below 2 to `most`.
fn octave(x: f32, most: usize) -> usize {
    (x.max(1.0).to_bits() >> 23).saturating_sub(127).min(most as u32) as usize
}

/// Half octaves of x, from 0 for what is below about 1.5 to `most`.
fn octave_halves(x: f32, most: usize) -> usize {
    (x.max(1.0).to_bits() >> 22).saturating_sub(254).min(most as u32) as usize
}

/// Lanes in which scores are compared.
const LANES: usize = 8;

/// The links of a row that still have rays to be accounted for.
#[derive(Default)]
struct Candidates {
    sites: Vec<u32>,
    counts: Vec<u32>,
    /// Unit vectors to the sites, padded to whole lanes with what is no number and never the greater.
    x: Vec<[f32; LANES]>,
    y: Vec<[f32; LANES]>,
    z: Vec<[f32; LANES]>,
    scores: Vec<[f32; LANES]>,
    /// All counts.
    rays: u32,
    /// Room to sort in.
    places: Vec<u32>,
}

impl Candidates {
    fn set(&mut self, merged: &Merged, offset: impl Fn(u32) -> Vec3) {
        self.sites.clone_from(&merged.sites);
        self.counts.clone_from(&merged.counts);
        self.rays = merged.counts.iter().sum();
        let blocks = merged.sites.len().div_ceil(LANES);
        for axis in [&mut self.x, &mut self.y, &mut self.z, &mut self.scores] {
            axis.clear();
            axis.resize(blocks, [f32::NAN; LANES]);
        }
        for (k, &site) in merged.sites.iter().enumerate() {
            self.place(k, offset(site).normalize_or_zero());
        }
    }

    fn place(&mut self, k: usize, v: Vec3) {
        (self.x[k / LANES][k % LANES], self.y[k / LANES][k % LANES], self.z[k / LANES][k % LANES]) =
            (v.x, v.y, v.z);
    }

    /// Scores all by their cosine with a direction; the two highest, at least −1.
    fn score(&mut self, w: Vec3) -> (f32, f32) {
        let (mut best, mut second) = ([-1.0f32; LANES], [-1.0f32; LANES]);
        let blocks = self.sites.len().div_ceil(LANES);
        let axes = self.x[..blocks].iter().zip(&self.y).zip(&self.z);
        for (scores, ((x, y), z)) in self.scores.iter_mut().zip(axes) {
            for lane in 0..LANES {
                let score = x[lane] * w.x + y[lane] * w.y + z[lane] * w.z;
                scores[lane] = score;
                let beaten = if score >= best[lane] { best[lane] } else { score };
                second[lane] = if beaten > second[lane] { beaten } else { second[lane] };
                best[lane] = if score > best[lane] { score } else { best[lane] };
            }
        }
        let top = best.iter().copied().fold(-1.0, f32::max);
        let mut met = false;
        let next = best.iter().zip(&second).fold(-1.0f32, |next, (&b, &s)| {
            let first = b == top && !met;
            met |= first;
            next.max(if first { s } else { b })
        });
        (top, next)
    }

    fn scored(&self, k: usize) -> f32 {
        self.scores[k / LANES][k % LANES]
    }

    /// How many come before the one that holds a site, by score and then by number; also its number.
    fn rank(&mut self, site: u32, best: f32) -> (usize, usize) {
        let first = self.at_rank(0, best);
        if self.sites[first] == site {
            return (0, first);
        }
        let own = self.sites.iter().position(|&s| s == site).unwrap_or(0);
        let score = self.scored(own);
        let count = |lanes: &[f32; LANES], matches: &dyn Fn(f32) -> bool| {
            lanes.iter().map(|&s| usize::from(matches(s))).sum::<usize>()
        };
        let (before, at) = self.scores.split_at(own / LANES);
        let mut rank = before.iter().map(|lanes| count(lanes, &|s| s == score)).sum::<usize>();
        rank += at[0][..own % LANES].iter().filter(|&&s| s == score).count();
        if score < best {
            let blocks = self.sites.len().div_ceil(LANES);
            rank += self.scores[..blocks].iter().map(|lanes| count(lanes, &|s| s > score)).sum::<usize>();
        }
        (rank, own)
    }

    /// The number of the one that so many come before.
    fn at_rank(&mut self, rank: usize, best: f32) -> usize {
        let live = &self.scores[..self.sites.len().div_ceil(LANES)];
        if rank == 0
            && let Some(block) = live.iter().position(|lanes| lanes.contains(&best))
            && let Some(lane) = live[block].iter().position(|&s| s == best)
        {
            return block * LANES + lane;
        }
        let Self { places, scores, sites, .. } = self;
        places.clear();
        places.extend(0..sites.len() as u32);
        let scored = |k: u32| scores[k as usize / LANES][k as usize % LANES];
        let by_score = |a: &u32, b: &u32| {
            let order = scored(*b).partial_cmp(&scored(*a));
            order.unwrap_or(Ordering::Equal).then(a.cmp(b))
        };
        *places.select_nth_unstable_by(rank, by_score).1 as usize
    }

    /// Accounts for one ray of a link; its site.
    fn take(&mut self, k: usize) -> u32 {
        let site = self.sites[k];
        self.counts[k] -= 1;
        self.rays -= 1;
        if self.counts[k] == 0 {
            let last = self.sites.len() - 1;
            let (b, l) = (last / LANES, last % LANES);
            self.place(k, Vec3::new(self.x[b][l], self.y[b][l], self.z[b][l]));
            self.place(last, Vec3::NAN);
            self.sites.swap_remove(k);
            self.counts.swap_remove(k);
        }
        site
    }
}
