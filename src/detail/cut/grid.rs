//! The grid of cells over a mesh: how fine it is, and where it is cut into chunks.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};
use std::sync::atomic::{AtomicU64, Ordering};

use glam::DVec3;

use crate::geometry::{hash, morton};

/// Bits of a cell's Morton code that tell where it is within its block of 4 × 4 × 4.
pub const BLOCK_BITS: u32 = 6;

/// Cells along an edge of the fine grid that measures a surface, as a power of two: 2²⁷ bits are 16 MB.
const FINE_BITS: u32 = 9;

/// Cells along an edge at the most: Morton codes have 21 bits an axis.
const MOST_CELLS: f64 = 2_097_152.0;

/// A cubic grid. Cells are called by their Morton codes, so that a block of 4 × 4 × 4 is a run of 64 codes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    low: DVec3,
    inverse: f64,
    last: u32,
}

impl Grid {
    /// The grid of cells of edge `cell` from `low` on, over a cube of edge `extent`.
    pub fn new(low: DVec3, extent: f64, cell: f64) -> Self {
        let cells = (extent / cell).ceil().clamp(1.0, MOST_CELLS);
        Self { low, inverse: 1.0 / cell, last: cells as u32 - 1 }
    }

    /// The fine grid over a cube.
    pub fn fine(low: DVec3, extent: f64) -> Self {
        Self::new(low, extent, extent / f64::from(1 << FINE_BITS))
    }

    /// The cell that holds a point of the cube.
    #[inline]
    pub fn cell(&self, at: DVec3) -> u64 {
        let place = (at - self.low) * self.inverse;
        morton::encode([place.x, place.y, place.z].map(|along| (along as u32).min(self.last)))
    }
}

/// Which cells of the fine grid are occupied.
pub struct Occupied(Vec<AtomicU64>);

impl Occupied {
    /// None is.
    pub fn none() -> Self {
        Self((0..1 << (3 * FINE_BITS - 6)).map(|_| AtomicU64::new(0)).collect())
    }

    /// Marks a cell; threads may do so at once.
    #[inline]
    pub fn insert(&self, cell: u64) {
        let (word, bit) = (&self.0[cell as usize / 64], 1 << (cell % 64));
        // Relaxed: bits are only ever set, and read after the threads have ended.
        if word.load(Ordering::Relaxed) & bit == 0 {
            word.fetch_or(bit, Ordering::Relaxed);
        }
    }

    /// The edge of cells of which about `wanted` are occupied, for a cube of edge `extent`.
    ///
    /// The coarsest of the grids by powers of two that has as many tells; from there on the number goes with the inverse
    /// square of the edge. Coarse grids first: the fine ones may be finer than the vertices are dense.
    pub fn cell(self, extent: f64, wanted: f64) -> f64 {
        let mut words: Vec<u64> = self.0.into_iter().map(AtomicU64::into_inner).collect();
        let mut edge = extent / f64::from(1 << FINE_BITS);
        let mut cell = edge * (ones(&words) / wanted).sqrt();
        for _ in 0..FINE_BITS {
            // Eight bits are the cells of one of the next coarser grid.
            let bytes = words.iter().flat_map(|word| word.to_le_bytes());
            let occupied: Vec<bool> = bytes.map(|byte| byte != 0).collect();
            words = occupied.chunks(64).map(word_of).collect();
            edge *= 2.0;
            if ones(&words) < wanted {
                break;
            }
            cell = edge * (ones(&words) / wanted).sqrt();
        }
        cell.clamp(extent / MOST_CELLS, extent)
    }
}

fn ones(words: &[u64]) -> f64 {
    words.iter().map(|word| f64::from(word.count_ones())).sum()
}

fn word_of(bits: &[bool]) -> u64 {
    bits.iter().enumerate().map(|(at, &bit)| u64::from(bit) << at).sum()
}

/// Counts by block of cells; only occupied blocks take memory.
#[derive(Default)]
pub struct Histogram(HashMap<u64, u64, BuildHasherDefault<Mixer>>);

impl Histogram {
    /// Counts of sorted block numbers, as runs.
    pub fn runs(blocks: &[u64]) -> Vec<(u64, u64)> {
        blocks.chunk_by(|a, b| a == b).map(|run| (run[0], run.len() as u64)).collect()
    }

    /// Adds runs.
    pub fn add(&mut self, runs: &[(u64, u64)]) {
        for &(block, count) in runs {
            *self.0.entry(block).or_default() += count;
        }
    }

    /// The first cells of the chunks: runs of blocks of at most `most` counts each, or a single block.
    pub fn cut(self, most: u64) -> Vec<u64> {
        let mut blocks: Vec<(u64, u64)> = self.0.into_iter().collect();
        blocks.sort_unstable();
        let (mut starts, mut sum) = (vec![0], 0);
        for (block, count) in blocks {
            if sum > 0 && sum + count > most {
                starts.push(block << BLOCK_BITS);
                sum = 0;
            }
            sum += count;
        }
        starts
    }
}

/// Hashes one number.
#[derive(Default)]
pub struct Mixer(u64);

impl Hasher for Mixer {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|&byte| self.write_u64(u64::from(byte)));
    }

    fn write_u64(&mut self, number: u64) {
        self.0 = hash::mix(self.0 ^ number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_gets_about_as_many_cells_as_wanted() {
        let (low, extent) = (DVec3::ZERO, 3.0);
        for wanted in [100.0, 1000.0, 30_000.0] {
            let (fine, occupied) = (Grid::fine(low, extent), Occupied::none());
            let points: Vec<DVec3> = (0..90_000u32)
                .map(|k| DVec3::new(f64::from(k % 300), f64::from(k / 300), 150.0) * (extent / 300.0))
                .collect();
            points.iter().for_each(|&at| occupied.insert(fine.cell(at)));
            let grid = Grid::new(low, extent, occupied.cell(extent, wanted));
            let mut cells: Vec<u64> = points.iter().map(|&at| grid.cell(at)).collect();
            cells.sort_unstable();
            cells.dedup();
            // A plane along the grid obeys the inverse square but for the rows of cells at its border.
            let ratio = cells.len() as f64 / wanted;
            assert!((0.75..1.35).contains(&ratio), "{} cells for {wanted}", cells.len());
        }
    }

    #[test]
    fn chunks_are_cut_where_they_are_full() {
        let mut histogram = Histogram::default();
        histogram.add(&Histogram::runs(&[3, 3, 7, 7, 7, 9, 20]));
        histogram.add(&[(9, 1), (30, 10)]);
        // 2 + 3 fit into 5; 2 + 1; a block of 10 stands alone.
        assert_eq!(histogram.cut(5), [0, 9 << BLOCK_BITS, 30 << BLOCK_BITS]);
    }
}
