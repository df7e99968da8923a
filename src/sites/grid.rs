//! Look-up of sites by place: blocks of 4 × 4 × 4 cells with one bit per occupied cell, in a flat hash.
//!
//! Sites come in Morton order of their cells, so a block's sites are one run and the rank of a cell's bit finds its
//! sites: one probe answers for up to 64 cells, where a hash of cells needs one each.

use glam::Vec3;

use super::{SiteId, Sites};
use crate::geometry::{SurfacePoint, morton};

/// Cells are this much larger than the spacing, so that sites closer than the spacing are in adjacent cells in spite of
/// rounding: a cell coordinate of 10⁴ carries 24 − 14 = 10 bits of fraction.
pub(super) const CELL_MARGIN: f32 = 1.0 + 1.0 / 512.0;

/// How far [`Sites::nearest`] looks, in spacings. The nearest site of a covered point is within 1.5; further off only
/// specks between the candidates are served.
pub const SEARCH_SPACINGS: f32 = 4.0;

/// Cells are numbered from here so that those a few below the corner still have numbers.
const FIRST_CELL: f32 = 64.0;

/// Cells of about one spacing, axis-aligned.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    corner: Vec3,
    inverse: f32,
}

impl Frame {
    /// The frame for sites of this spacing whose bounds begin at `corner`.
    pub(super) fn new(corner: Vec3, spacing: f32) -> Self {
        Self { corner, inverse: 1.0 / (spacing * CELL_MARGIN) }
    }

    /// The same frame with cells 2^`doublings` times as large: its cells are unions of this one's.
    pub(super) fn coarser(self, doublings: u32) -> impl Fn(Vec3) -> [u32; 3] {
        move |p| self.cell(p).map(|c| c >> doublings)
    }

    /// The cell that holds a point; 21 bits each.
    pub(super) fn cell(&self, p: Vec3) -> [u32; 3] {
        // The conversion saturates, so points far outside get border cells.
        let q = (p - self.corner) * self.inverse + FIRST_CELL;
        [q.x as u32, q.y as u32, q.z as u32].map(|c| c.min(0x1f_ffff))
    }

    /// The Morton code of a point's cell.
    pub(super) fn code(&self, p: Vec3) -> u64 {
        morton::encode(self.cell(p))
    }
}

/// Three coordinates of 21 bits as one key; cheaper than a Morton code where order does not matter.
pub(super) fn pack([x, y, z]: [u32; 3]) -> u64 {
    u64::from(x) | (u64::from(y) << 21) | (u64::from(z) << 42)
}

/// The inverse of [`pack`].
pub(super) fn unpack(key: u64) -> [u32; 3] {
    [key, key >> 21, key >> 42].map(|k| (k & 0x1f_ffff) as u32)
}

const EMPTY: u64 = u64::MAX;

/// A flat open-addressing map from packed cells to numbers, at most half full.
#[derive(Debug, Clone)]
pub(super) struct KeyMap {
    slots: Vec<(u64, u32)>,
    len: usize,
    shift: u32,
}

impl KeyMap {
    /// An empty map with room for `capacity` keys.
    pub(super) fn with_capacity(capacity: usize) -> Self {
        let bits = (2 * capacity.max(8)).next_power_of_two().trailing_zeros();
        Self { slots: vec![(EMPTY, 0); 1 << bits], len: 0, shift: 64 - bits }
    }

    fn slot(&self, key: u64) -> usize {
        let mut at = (key.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> self.shift) as usize;
        loop {
            let found = self.slots[at].0;
            if found == key || found == EMPTY {
                return at;
            }
            at = (at + 1) & (self.slots.len() - 1);
        }
    }

    /// The number stored for a key.
    pub(super) fn find(&self, key: u64) -> Option<u32> {
        let (found, value) = self.slots[self.slot(key)];
        (found == key).then_some(value)
    }

    /// The number stored for a key, which is `fresh` if it was not there.
    pub(super) fn find_or_insert(&mut self, key: u64, fresh: u32) -> u32 {
        let at = self.slot(key);
        if self.slots[at].0 == key {
            return self.slots[at].1;
        }
        self.slots[at] = (key, fresh);
        self.len += 1;
        if 2 * self.len > self.slots.len() {
            self.grow();
        }
        fresh
    }

    fn grow(&mut self) {
        let mut larger = Self::with_capacity(self.slots.len());
        for &(key, value) in self.slots.iter().filter(|slot| slot.0 != EMPTY) {
            larger.find_or_insert(key, value);
        }
        *self = larger;
    }
}

/// The cells of a block whose coordinate along an axis is 0, 1, 2, 3: bit i is the cell of Morton code i.
const SLABS: [[u64; 4]; 3] = slabs();

const fn slabs() -> [[u64; 4]; 3] {
    let mut out = [[0; 4]; 3];
    let mut bit = 0;
    while bit < 64 {
        let mut axis = 0;
        while axis < 3 {
            let coordinate = ((bit >> axis) & 1) | (((bit >> (axis + 3)) & 1) << 1);
            out[axis][coordinate] |= 1 << bit;
            axis += 1;
        }
        bit += 1;
    }
    out
}

/// A block's occupied cells and the number of occupied cells before it.
#[derive(Debug, Clone, Copy)]
struct Block {
    mask: u64,
    rank: u32,
}

/// A run of Morton-ordered sites by cell.
#[derive(Debug, Clone)]
pub(super) struct SiteGrid {
    frame: Frame,
    directory: KeyMap,
    blocks: Vec<Block>,
    /// First site of each occupied cell, and the end.
    starts: Vec<u32>,
}

impl SiteGrid {
    /// Indexes `positions`, which are in Morton order of the frame's cells and belong to the sites from `first` on.
    pub(super) fn build(frame: Frame, positions: &[Vec3], first: u32) -> Self {
        let mut grid = Self {
            frame,
            directory: KeyMap::with_capacity(positions.len() / 12),
            blocks: vec![],
            starts: vec![],
        };
        let mut last = ([u32::MAX; 3], u64::MAX);
        for (i, &p) in positions.iter().enumerate() {
            let cell = frame.cell(p);
            let (block, bit) = (cell.map(|c| c >> 2), morton::encode(cell.map(|c| c & 3)));
            if block != last.0 {
                grid.directory.find_or_insert(pack(block), grid.blocks.len() as u32);
                grid.blocks.push(Block { mask: 0, rank: grid.starts.len() as u32 });
            }
            if (block, bit) != last {
                if let Some(block) = grid.blocks.last_mut() {
                    block.mask |= 1 << bit;
                }
                grid.starts.push(first + i as u32);
            }
            last = (block, bit);
        }
        grid.starts.push(first + positions.len() as u32);
        grid
    }

    /// Calls `visit` with every site in the cells at most `reach` from that of `position` along each axis.
    pub(super) fn visit(&self, position: Vec3, reach: u32, mut visit: impl FnMut(u32)) {
        if self.blocks.is_empty() {
            return;
        }
        let cell = self.frame.cell(position);
        let (low, high) = (cell.map(|c| c.saturating_sub(reach)), cell.map(|c| c + reach));
        for z in low[2] >> 2..=high[2] >> 2 {
            let mask_z = slab_range(2, z, low[2], high[2]);
            for y in low[1] >> 2..=high[1] >> 2 {
                let mask_yz = mask_z & slab_range(1, y, low[1], high[1]);
                for x in low[0] >> 2..=high[0] >> 2 {
                    if let Some(found) = self.directory.find(pack([x, y, z])) {
                        let block = self.blocks[found as usize];
                        self.visit_block(block, mask_yz & slab_range(0, x, low[0], high[0]), &mut visit);
                    }
                }
            }
        }
    }

    fn visit_block(&self, block: Block, wanted: u64, visit: &mut impl FnMut(u32)) {
        let mut cells = block.mask & wanted;
        while cells != 0 {
            let before = (cells & cells.wrapping_neg()) - 1;
            let rank = (block.rank + (block.mask & before).count_ones()) as usize;
            for site in self.starts[rank]..self.starts[rank + 1] {
                visit(site);
            }
            cells &= cells - 1;
        }
    }
}

/// The cells of block `block` whose coordinate along `axis` is in low..=high.
fn slab_range(axis: usize, block: u32, low: u32, high: u32) -> u64 {
    (0..4)
        .filter(|i| (low..=high).contains(&(4 * block + i)))
        .fold(0, |mask, i| mask | SLABS[axis][i as usize])
}

/// The site with the least d² + 4h²(1 − n·n′), with that value; see [`Sites::nearest`].
pub(super) fn nearest(sites: &Sites, point: SurfacePoint) -> Option<(SiteId, f32)> {
    let h2 = sites.spacing * sites.spacing;
    let limit = SEARCH_SPACINGS * SEARCH_SPACINGS * h2;
    let mut best: Option<(SiteId, f32)> = None;
    for reach in [1, 2, 4] {
        let mut bound = best.map_or(f32::INFINITY, |b| b.1);
        let mut offer = |s: u32| {
            let site = SiteId(s);
            let d2 = sites.positions[site.index()].distance_squared(point.position);
            if d2 > bound || d2 > limit {
                return;
            }
            if let Some(value) = mismatch(sites, point, site, d2)
                && best.is_none_or(|b| value < b.1 || (value == b.1 && site < b.0))
            {
                best = Some((site, value));
                bound = value;
            }
        };
        sites.fronts.visit(point.position, reach, &mut offer);
        sites.backs.visit(point.position, reach, &mut offer);
        // All sites within `reach` spacings have been seen.
        if best.is_some_and(|b| b.1 <= (reach * reach) as f32 * h2) {
            break;
        }
    }
    best
}

/// d² + 4h²(1 − n·n′), or none when the normals look apart.
pub(super) fn mismatch(sites: &Sites, point: SurfacePoint, site: SiteId, d2: f32) -> Option<f32> {
    let cosine = sites.normals[site.index()].dot(point.normal);
    (cosine > 0.0).then_some(d2 + 4.0 * sites.spacing * sites.spacing * (1.0 - cosine))
}
