//! Rows as links: per row the sites met, ascending, and by how many rays each; in runs that are read on their own.
//!
//! Sites are in Morton order and a row's lie in clumps, so that the difference of one to the next is mostly small: an
//! exponential Golomb code with the row's best k, and the count by a code of its own. A weight is the count, an
//! exact small whole number, times the row's own factor: rows stay closed and nothing is lost.

use rayon::prelude::*;

use super::bits::{BitReader, BitWriter, SLACK_BYTES};
use crate::links::rows::{FIRST_MARK, LOST, Rows};

/// Rows a run: what one thread takes at a time.
pub const RUN: usize = 64;

/// k of the codes for how many sites there are.
const LENGTH_K: u32 = 5;

/// Bits for a row's k.
const K_BITS: u32 = 4;

/// One row's links.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Merged {
    /// The sites met, ascending.
    pub sites: Vec<u32>,
    /// By how many rays each.
    pub counts: Vec<u32>,
    /// Rays without an answer.
    pub lost: u32,
}

impl Merged {
    /// The links of a row of rays; `hits` is room to work in.
    pub fn set(&mut self, row: &[u32], hits: &mut Vec<u32>) {
        hits.clear();
        hits.extend(row.iter().copied().filter(|&met| met < FIRST_MARK));
        hits.sort_unstable();
        self.clear();
        self.lost = row.iter().filter(|&&met| met == LOST).count() as u32;
        for same in hits.chunk_by(|a, b| a == b) {
            self.sites.push(same[0]);
            self.counts.push(same.len() as u32);
        }
    }

    fn clear(&mut self) {
        self.sites.clear();
        self.counts.clear();
    }

    fn write(&self, out: &mut BitWriter, counts: &mut BitWriter) {
        let k = self.best_k();
        out.golomb(u64::from(self.lost), 0);
        out.golomb(self.sites.len() as u64, LENGTH_K);
        out.push(u64::from(k), K_BITS);
        let mut next = 0;
        for (&site, &count) in self.sites.iter().zip(&self.counts) {
            out.golomb(u64::from(site - next), k);
            counts.golomb(u64::from(count - 1), 0);
            next = site + 1;
        }
    }

    /// The k of about the fewest bits, by the differences' numbers of digits.
    fn best_k(&self) -> u32 {
        let mut digits = [0u64; 33];
        let mut next = 0;
        for &site in &self.sites {
            digits[(u32::BITS - (site - next).leading_zeros()) as usize] += 1;
            next = site + 1;
        }
        // Codes must stay below 57 bits: 2 · 32 + 1 − k.
        let least = if digits[28..].iter().any(|&n| n > 0) { 10 } else { 0 };
        let cost = |k: u32| -> u64 {
            let length = |d: usize| u64::from(2 * (d as u32).saturating_sub(k) + 1 + k);
            digits.iter().enumerate().map(|(d, n)| n * length(d)).sum()
        };
        (least..1 << K_BITS).min_by_key(|&k| cost(k)).unwrap_or(least)
    }
}

/// Merges rows into links: each ray finds the link of its site at once, without sorting rays.
#[derive(Debug, Default)]
pub struct Links {
    /// By site: where its link is, if that is the site's; never cleared.
    slots: Vec<u32>,
    /// Site and rays, in the order met, then sorted.
    met: Vec<u64>,
}

impl Links {
    /// The links of a row, as [`Merged::set`] finds them.
    pub fn merge(&mut self, row: &[u32], merged: &mut Merged) {
        self.met.clear();
        let mut lost = 0;
        for &site in row {
            if site >= FIRST_MARK {
                lost += u32::from(site == LOST);
                continue;
            }
            let site = site as usize;
            if site >= self.slots.len() {
                self.slots.resize(site + 1 + site / 2, 0);
            }
            let slot = self.slots[site] as usize;
            match self.met.get_mut(slot) {
                Some(link) if *link >> 32 == site as u64 => *link += 1,
                _ => {
                    self.slots[site] = self.met.len() as u32;
                    self.met.push((site as u64) << 32 | 1);
                }
            }
        }
        self.met.sort_unstable();
        merged.clear();
        merged.lost = lost;
        merged.sites.extend(self.met.iter().map(|link| (link >> 32) as u32));
        merged.counts.extend(self.met.iter().map(|&link| link as u32));
    }
}

/// The links of rows `first..last` as bytes: offsets of the streams (u32), streams, zeros. A run is a stream of sites and one
/// of counts, so that the processor decodes both at a time. Returns how many links they are, too.
pub fn encode(rows: &Rows, (first, last): (usize, usize)) -> (Vec<u8>, u64) {
    let run = |start: usize| {
        let (mut sites, mut counts) = (BitWriter::default(), BitWriter::default());
        let (mut merged, mut links) = (Merged::default(), Links::default());
        let mut number = 0;
        for r in start..(start + RUN).min(last) {
            links.merge(rows.row(r), &mut merged);
            merged.write(&mut sites, &mut counts);
            number += merged.sites.len() as u64;
        }
        ([sites.finish(), counts.finish()], number)
    };
    let (runs, numbers): (Vec<[Vec<u8>; 2]>, Vec<u64>) =
        (first..last).into_par_iter().step_by(RUN).map(run).unzip();
    let mut bytes = super::concatenate(runs.into_iter().flatten().collect());
    bytes.extend([0; SLACK_BYTES]);
    (bytes, numbers.into_iter().sum())
}

/// A block of links as stored, to be read run by run, in any order and by any number of threads.
#[derive(Debug, Clone, Copy)]
pub struct Block<'a> {
    runs: super::Runs<'a>,
    rows: usize,
    rays: u32,
}

impl<'a> Block<'a> {
    /// Over the bytes of `rows` rows of `rays` rays. Errors with a description when the offsets are not what they should be.
    pub fn new(bytes: &'a [u8], rows: usize, rays: u32) -> Result<Self, String> {
        let runs = super::Runs::new(bytes, 2 * rows.div_ceil(RUN))?;
        Ok(Self { runs, rows, rays })
    }

    /// How many rows it holds.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Rays a row.
    pub fn rays(&self) -> u32 {
        self.rays
    }

    /// Reads the rows of one run in order: each row is folded from a default value by `link(value, site, count)`, and
    /// `row(number in the block, value, lost rays)` takes what comes out.
    ///
    /// Errors with a description where the bytes are no rows of so many rays. What sites there are is for `link` to
    /// check, which answers false to one that it does not know.
    #[inline]
    pub fn fold<T: Default>(
        &self,
        run: usize,
        mut link: impl FnMut(&mut T, u32, u32) -> bool,
        mut row: impl FnMut(usize, T, u32),
    ) -> Result<(), String> {
        let mut reader = BitReader::new(self.runs.bytes(2 * run));
        let mut counts = BitReader::new(self.runs.bytes(2 * run + 1));
        for r in run * RUN..((run + 1) * RUN).min(self.rows) {
            let mut value = T::default();
            let head = (reader.golomb(0), reader.golomb(LENGTH_K), reader.bits(K_BITS) as u32);
            let (Some(lost), Some(length), k) = head else {
                return Err(format!("row {r} has no beginning"));
            };
            let (mut site, mut rays) = (u64::MAX, lost);
            for _ in 0..length {
                let (Some(ahead), Some(more)) = (reader.golomb(k), counts.golomb(0)) else {
                    return Err(format!("row {r} ends early"));
                };
                site = site.wrapping_add(ahead + 1);
                rays += more + 1;
                if site > u64::from(u32::MAX) || !link(&mut value, site as u32, more as u32 + 1) {
                    return Err(format!("row {r} names site {site}"));
                }
            }
            if rays > u64::from(self.rays) {
                return Err(format!("row {r}: expected {} rays at the most, got {rays}", self.rays));
            }
            row(r, value, lost as u32);
        }
        Ok(())
    }

    /// The rows of one run; sites are below `sites`.
    pub fn merged(&self, run: usize, sites: u32) -> Result<Vec<Merged>, String> {
        let mut rows = Vec::with_capacity(RUN);
        let link = |row: &mut Merged, site, count| {
            row.sites.push(site);
            row.counts.push(count);
            site < sites
        };
        self.fold(run, link, |_, row, lost| rows.push(Merged { lost, ..row }))?;
        Ok(rows)
    }
}
