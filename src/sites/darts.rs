//! Poisson-disk dart throwing, parallel over blocks of cells in eight colours.
//!
//! This work is based on: Wei, "Parallel Poisson Disk Sampling", SIGGRAPH 2008 (phases of cells that cannot conflict).
//! Our phases are over blocks of 16³ cells: a block's darts meet in a dense grid that fits the first-level cache, and
//! what earlier phases accepted around it is copied into a halo of one cell. The result depends on no thread.

use glam::Vec3;
use rayon::prelude::*;

use super::grid::{KeyMap, pack, unpack};

/// Blocks are 2^4 cells wide: narrower ones spend more on halos, wider ones leave the first-level cache.
pub(super) const BLOCK_BITS: u32 = 4;

/// Sites conflict only when their normals' cosine exceeds this: about 45°.
pub(super) const CONFLICT_COSINE: f32 = 0.7;

/// Cells along a block with its halo.
const SIDE: usize = (1 << BLOCK_BITS) + 2;
const EMPTY: u32 = u32::MAX;

/// A site that is, or wants to be.
#[derive(Debug, Clone, Copy)]
pub(super) struct Dart<P> {
    pub(super) position: Vec3,
    pub(super) normal: Vec3,
    /// Sites of one- and two-sided meshes do not stand for each other.
    pub(super) two_sided: bool,
    /// What the caller knows it by.
    pub(super) payload: P,
}

/// The occupied blocks, in Morton order, with a directory.
pub(super) struct Blocks {
    /// Packed coordinates.
    pub(super) keys: Vec<u64>,
    directory: KeyMap,
}

impl Blocks {
    /// From packed coordinates, each once.
    pub(super) fn new(keys: Vec<u64>) -> Self {
        let mut directory = KeyMap::with_capacity(keys.len());
        for (i, &key) in keys.iter().enumerate() {
            directory.find_or_insert(key, i as u32);
        }
        Self { keys, directory }
    }

    /// Blocks of one colour: no two of them touch.
    fn of_colour(&self, colour: u32) -> Vec<usize> {
        let matches = |&i: &usize| {
            let [x, y, z] = unpack(self.keys[i]);
            (x & 1) | ((y & 1) << 1) | ((z & 1) << 2) == colour
        };
        (0..self.keys.len()).filter(matches).collect()
    }

    /// The occupied blocks around block `at`, without it.
    pub(super) fn around(&self, at: usize) -> impl Iterator<Item = usize> + '_ {
        let [x, y, z] = unpack(self.keys[at]);
        (0..27u32).filter(|&i| i != 13).filter_map(move |i| {
            let near = |c: u32, step: u32| (c + step).checked_sub(1);
            let key = pack([near(x, i % 3)?, near(y, i / 3 % 3)?, near(z, i / 9)?]);
            self.directory.find(key).map(|b| b as usize)
        })
    }
}

/// One entry of the dense grid.
#[derive(Debug, Clone, Copy)]
struct Entry {
    position: Vec3,
    next: u32,
    normal: Vec3,
    two_sided: bool,
}

/// A block's darts by cell, halo included.
pub(super) struct BlockGrid {
    heads: Vec<u32>,
    entries: Vec<Entry>,
    /// The cell in the grid's corner.
    corner: [u32; 3],
}

impl BlockGrid {
    /// A grid to be used for many blocks.
    pub(super) fn new() -> Self {
        Self { heads: vec![EMPTY; SIDE * SIDE * SIDE], entries: vec![], corner: [0; 3] }
    }

    /// Empties the grid and moves it to a block.
    pub(super) fn start(&mut self, key: u64) {
        self.heads.fill(EMPTY);
        self.entries.clear();
        self.corner = unpack(key).map(|b| (b << BLOCK_BITS).wrapping_sub(1));
    }

    /// Index of a cell in the grid, if it is in the block or its halo.
    fn place(&self, cell: [u32; 3]) -> Option<usize> {
        let [x, y, z] = [0, 1, 2].map(|i| cell[i].wrapping_sub(self.corner[i]) as usize);
        (x < SIDE && y < SIDE && z < SIDE).then_some(x + SIDE * (y + SIDE * z))
    }

    /// Adds a dart; says whether it is in the block or its halo.
    pub(super) fn insert<P>(&mut self, cell: [u32; 3], dart: &Dart<P>) -> bool {
        let Some(at) = self.place(cell) else { return false };
        let &Dart { position, normal, two_sided, .. } = dart;
        self.entries.push(Entry { position, next: self.heads[at], normal, two_sided });
        self.heads[at] = (self.entries.len() - 1) as u32;
        true
    }

    /// Whether an entry conflicts with the dart at this spacing. The cell must lie in the block, not in its halo.
    fn conflicts<P>(&self, cell: [u32; 3], dart: &Dart<P>, spacing_squared: f32) -> bool {
        let Some(at) = self.place(cell) else { return true };
        NEAR.iter().any(|&offset| {
            self.chain((at as isize + offset) as usize).any(|(_, entry)| {
                entry.position.distance_squared(dart.position) < spacing_squared
                    && entry.normal.dot(dart.normal) > CONFLICT_COSINE
                    && entry.two_sided == dart.two_sided
            })
        })
    }

    /// The entry with the least d² + 4h²(1 − n·n′) among the 27 cells around.
    pub(super) fn nearest<P>(&self, cell: [u32; 3], dart: &Dart<P>, spacing_squared: f32) -> Option<u32> {
        let at = self.place(cell)?;
        let mut best = (f32::INFINITY, None);
        for offset in NEAR {
            for (index, entry) in self.chain((at as isize + offset) as usize) {
                if entry.two_sided == dart.two_sided {
                    let turned = 4.0 * spacing_squared * (1.0 - entry.normal.dot(dart.normal));
                    let value = entry.position.distance_squared(dart.position) + turned;
                    if value < best.0 {
                        best = (value, Some(index));
                    }
                }
            }
        }
        best.1
    }

    fn chain(&self, at: usize) -> impl Iterator<Item = (u32, &Entry)> + '_ {
        let mut next = self.heads[at];
        std::iter::from_fn(move || {
            let index = next;
            let entry = self.entries.get(index as usize)?;
            next = entry.next;
            Some((index, entry))
        })
    }
}

/// Offsets of the 27 cells around a cell, nearest first.
const NEAR: [isize; 27] = near();

const fn near() -> [isize; 27] {
    let mut out = [0; 27];
    let (mut filled, mut ring) = (0, 0);
    while ring <= 3 {
        let mut i = 0;
        while i < 27 {
            let (x, y, z) = (i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1);
            if x * x + y * y + z * z == ring {
                out[filled] = x + SIDE as isize * (y + SIDE as isize * z);
                filled += 1;
            }
            i += 1;
        }
        ring += 1;
    }
    out
}

/// Throws each block's candidates in their order; a dart stays when nothing that stays conflicts with it.
///
/// `accepted` holds, per block, what is already there and gains what stays. `candidates` appends a block's candidates
/// to a buffer, `cell` finds the cell of a position; cells are at least one spacing wide.
pub(super) fn throw<P: Copy + Send + Sync>(
    blocks: &Blocks,
    spacing: f32,
    accepted: &mut [Vec<Dart<P>>],
    candidates: impl Fn(usize, &mut Vec<Dart<P>>) + Sync,
    cell: impl Fn(Vec3) -> [u32; 3] + Sync,
) {
    for colour in 0..8 {
        let chosen = blocks.of_colour(colour);
        let before: &[Vec<Dart<P>>] = accepted;
        let stay: Vec<Vec<Dart<P>>> = chosen
            .par_iter()
            .map_init(
                || (BlockGrid::new(), Vec::new()),
                |(grid, darts), &block| {
                    grid.start(blocks.keys[block]);
                    for near in std::iter::once(block).chain(blocks.around(block)) {
                        for dart in &before[near] {
                            grid.insert(cell(dart.position), dart);
                        }
                    }
                    darts.clear();
                    candidates(block, darts);
                    let mut stay = vec![];
                    for dart in darts.iter() {
                        let at = cell(dart.position);
                        if !grid.conflicts(at, dart, spacing * spacing) {
                            grid.insert(at, dart);
                            stay.push(*dart);
                        }
                    }
                    stay
                },
            )
            .collect();
        for (&block, darts) in chosen.iter().zip(stay) {
            accepted[block].extend(darts);
        }
    }
}
