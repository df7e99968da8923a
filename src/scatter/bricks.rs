//! Points that stay, by place: grids of cells in bricks of 4³, one grid per octave of reach.
//!
//! Every point stands in one cell. A brick knows by a bit which of its 64 cells hold points, so that empty space costs no
//! look-up: on a surface a query reads two bricks and a handful of cells, whose points lie side by side.

use glam::Vec3;
use smallvec::SmallVec;

use super::floor;
use crate::geometry::hash;

/// Cells along a brick, as a power of two.
const BITS: i32 = 2;
const SIDE: i32 = 1 << BITS;

/// A cell is this many reaches wide: a point whose nearest is at 0.57 reaches needs no second look.
const CELL: f32 = 1.15;

/// Points laid out for searches around a place.
#[derive(Clone, Default)]
pub struct Bricks<T> {
    /// By octave of reach, the smallest first.
    grids: Vec<Grid>,
    /// Grid after grid, brick after brick, cell after cell.
    entries: Vec<T>,
}

/// The points whose reach lies within one octave.
#[derive(Clone)]
struct Grid {
    /// The largest reach of its points.
    reach: f32,
    inverse_edge: f32,
    /// Open addressing, a power of two long; free where `mask` is zero.
    slots: Vec<Brick>,
    /// Where each occupied cell's entries begin; one more at the end.
    starts: Vec<u32>,
}

#[derive(Clone, Copy, Default)]
struct Brick {
    at: [i32; 3],
    /// Place of the first occupied cell in `starts`.
    first: u32,
    /// A bit for each occupied cell, x running fastest.
    mask: u64,
}

impl<T: Copy> Bricks<T> {
    /// Lays out points, each given by its position and its reach; `entry` makes what visitors see of a point.
    pub fn new(points: &[(Vec3, f32)], entry: impl Fn(usize) -> T) -> Self {
        let mut octaves: Vec<i32> = points.iter().map(|p| octave(p.1)).collect();
        octaves.sort_unstable();
        octaves.dedup();
        let mut bricks = Self { grids: vec![], entries: Vec::with_capacity(points.len()) };
        for of in octaves {
            let members: Vec<u32> =
                (0..points.len() as u32).filter(|&i| octave(points[i as usize].1) == of).collect();
            let (grid, order) = Grid::new(points, &members, bricks.entries.len() as u32);
            bricks.grids.push(grid);
            bricks.entries.extend(order.into_iter().map(|i| entry(i as usize)));
        }
        bricks
    }

    /// Calls `visit` with every point within its reach of the place, and with some that are farther.
    #[inline]
    pub fn within_reach(&self, at: Vec3, mut visit: impl FnMut(&T)) {
        for grid in &self.grids {
            let reach = Vec3::splat(grid.reach * 1.0001);
            let (low, high) = (grid.cell(at - reach), grid.cell(at + reach));
            grid.runs(low, high, |first, last| self.entries[first..last].iter().for_each(&mut visit));
        }
    }

    /// Calls `visit` with every point in a box, and with some that are not, until it says no more.
    pub fn within_box(&self, low: Vec3, high: Vec3, mut visit: impl FnMut(&T) -> bool) {
        let mut more = true;
        for grid in &self.grids {
            grid.bricks_within((grid.cell(low), grid.cell(high)), |first, last| {
                more = more && self.entries[first..last].iter().all(&mut visit);
                more
            });
            if !more {
                return;
            }
        }
    }

    /// The least `value` over all points within their reach, where `value(point, so far)` is at least the squared
    /// distance, and infinite for points that are too far; points that cannot beat `so far` may be given any larger value.
    #[inline]
    pub fn least(
        &self,
        at: Vec3,
        touch: impl Fn(&T) -> u32,
        mut value: impl FnMut(&T, (f32, u32)) -> (f32, u32),
    ) -> (f32, u32) {
        let mut best = (f32::INFINITY, u32::MAX);
        for grid in &self.grids {
            let mut known = 0.0;
            if best.0 == f32::INFINITY {
                // The 2³ cells around: whatever is as near as their border has been seen.
                let scaled = at * grid.inverse_edge;
                let cell = floor(scaled - 0.5);
                let low = Vec3::from_array(cell.map(|c| c as f32));
                let inside = (scaled - low).min(low + 2.0 - scaled).min_element();
                known = (inside / grid.inverse_edge) * 0.9999;
                let mut runs: SmallVec<[(u32, u32); 16]> = SmallVec::new();
                let mut touched = 0;
                grid.runs(cell, cell.map(|c| c.saturating_add(1)), |first, last| {
                    runs.push((first as u32, last as u32));
                    // Begins to load all runs before the first is looked at: their misses overlap.
                    touched ^= touch(&self.entries[first]);
                });
                std::hint::black_box(touched);
                for (first, last) in runs {
                    for entry in &self.entries[first as usize..last as usize] {
                        best = value(entry, best);
                    }
                }
            }
            let reach = grid.reach.min(best.0.sqrt()) * 1.0001;
            if reach > known {
                grid.runs(grid.cell(at - reach), grid.cell(at + reach), |first, last| {
                    for entry in &self.entries[first..last] {
                        best = value(entry, best);
                    }
                });
            }
        }
        best
    }
}

impl Grid {
    /// The grid of some points, and the order in which their entries lie; the first will be entry `start`.
    fn new(points: &[(Vec3, f32)], members: &[u32], start: u32) -> (Self, Vec<u32>) {
        let reach = members.iter().map(|&i| points[i as usize].1).fold(0.0, f32::max);
        let inverse_edge = 1.0 / (CELL * reach);
        let mut grid = Self { reach, inverse_edge, slots: vec![Brick::default(); 64], starts: vec![] };
        let mut count = 0;
        let mut last = (0, [i32::MAX; 3]);
        // Bricks are numbered as they are met; until all are known, `first` is a brick's number.
        let places: Vec<(u32, u8)> = members
            .iter()
            .map(|&i| {
                let cell = grid.cell(points[i as usize].0);
                let at = cell.map(|c| c >> BITS);
                let bit = bit(cell) as u8;
                if last.1 != at {
                    if 2 * count >= grid.slots.len() {
                        grid.widen();
                    }
                    last = (grid.slot(at), at);
                }
                let brick = &mut grid.slots[last.0];
                if brick.mask == 0 {
                    *brick = Brick { at, first: count as u32, mask: 0 };
                    count += 1;
                }
                brick.mask |= 1 << bit;
                (brick.first, bit)
            })
            .collect();
        let mut masks = vec![0; count];
        grid.slots.iter().filter(|b| b.mask != 0).for_each(|b| masks[b.first as usize] = b.mask);
        let firsts: Vec<u32> = masks
            .iter()
            .scan(0, |sum, mask| Some(std::mem::replace(sum, *sum + mask.count_ones())))
            .collect();
        grid.slots.iter_mut().filter(|b| b.mask != 0).for_each(|b| b.first = firsts[b.first as usize]);
        let cells = masks.iter().map(|mask| mask.count_ones() as usize).sum::<usize>();
        let cell_of = |(brick, bit): (u32, u8)| {
            (firsts[brick as usize] + (masks[brick as usize] & ((1 << bit) - 1)).count_ones()) as usize
        };
        let mut starts = vec![0u32; cells + 1];
        places.iter().for_each(|&place| starts[cell_of(place) + 1] += 1);
        (0..cells).for_each(|c| starts[c + 1] += starts[c]);
        let mut next = starts.clone();
        let mut order = vec![0; members.len()];
        for (&place, &i) in places.iter().zip(members) {
            let at = &mut next[cell_of(place)];
            order[*at as usize] = i;
            *at += 1;
        }
        starts.iter_mut().for_each(|s| *s += start);
        grid.starts = starts;
        (grid, order)
    }

    #[inline]
    fn cell(&self, at: Vec3) -> [i32; 3] {
        floor(at * self.inverse_edge)
    }

    /// The slot that holds a brick, or the free one where it belongs.
    #[inline]
    fn slot(&self, at: [i32; 3]) -> usize {
        let mask = self.slots.len() - 1;
        let [x, y, z] = [u64::from(at[0] as u32), u64::from(at[1] as u32), u64::from(at[2] as u32)];
        let mut slot = hash::mix(x ^ y << 21 ^ z << 42) as usize & mask;
        while self.slots[slot].mask != 0 && self.slots[slot].at != at {
            slot = (slot + 1) & mask;
        }
        slot
    }

    fn widen(&mut self) {
        let wider = vec![Brick::default(); 2 * self.slots.len()];
        let old = std::mem::replace(&mut self.slots, wider);
        for brick in old.into_iter().filter(|b| b.mask != 0) {
            let slot = self.slot(brick.at);
            self.slots[slot] = brick;
        }
    }

    /// Calls `visit(first, last)` with the runs of entries that fill the cells from `low` to `high`.
    #[inline]
    fn runs(&self, low: [i32; 3], high: [i32; 3], mut visit: impl FnMut(usize, usize)) {
        let part = |[x, y, z]: [i32; 3]| [x >> BITS, y >> BITS, z >> BITS];
        let (from, to) = (part(low), part(high));
        for z in from[2]..=to[2] {
            for y in from[1]..=to[1] {
                for x in from[0]..=to[0] {
                    let brick = self.slots[self.slot([x, y, z])];
                    if brick.mask != 0 {
                        self.rows(&brick, low, high, &mut visit);
                    }
                }
            }
        }
    }

    /// As [`Grid::runs`] for large boxes, until `visit` says no more: where the box has more bricks than the grid, the
    /// grid's are asked whether they are in it, in no particular order.
    fn bricks_within(&self, (low, high): ([i32; 3], [i32; 3]), mut visit: impl FnMut(usize, usize) -> bool) {
        let span = |k: usize| i64::from(high[k] >> BITS) - i64::from(low[k] >> BITS) + 1;
        let bricks = span(0).saturating_mul(span(1)).saturating_mul(span(2));
        let mut more = true;
        let mut rows = |brick: &Brick| {
            self.rows(brick, low, high, &mut |first, last| more = more && visit(first, last));
            more
        };
        let range = |k: usize| low[k] >> BITS..=high[k] >> BITS;
        if bricks > self.slots.len() as i64 {
            let inside = |b: &&Brick| b.mask != 0 && (0..3).all(|k| range(k).contains(&b.at[k]));
            self.slots.iter().filter(inside).all(rows);
            return;
        }
        for z in range(2) {
            for y in range(1) {
                for x in range(0) {
                    let brick = self.slots[self.slot([x, y, z])];
                    if brick.mask != 0 && !rows(&brick) {
                        return;
                    }
                }
            }
        }
    }

    /// As [`Grid::runs`], within one brick.
    #[inline]
    fn rows(&self, brick: &Brick, low: [i32; 3], high: [i32; 3], visit: &mut impl FnMut(usize, usize)) {
        let least = |k: usize| low[k].saturating_sub(brick.at[k] << BITS).max(0);
        let most = |k: usize| high[k].saturating_sub(brick.at[k] << BITS).min(SIDE - 1);
        let (first_x, last_x) = (least(0), most(0));
        // Bits of a row's cells from the first to the last.
        let cells = (0xf_u64 >> (SIDE - 1 - last_x)) & (0xf << first_x);
        for z in least(2)..=most(2) {
            for y in least(1)..=most(1) {
                let row = SIDE * (y + SIDE * z);
                let wanted = (brick.mask >> row) & cells;
                if wanted != 0 {
                    let before = brick.mask & ((1u64 << (row + first_x)) - 1);
                    let first = brick.first + before.count_ones();
                    let last = first + wanted.count_ones();
                    visit(self.starts[first as usize] as usize, self.starts[last as usize] as usize);
                }
            }
        }
    }
}

/// A cell's bit in its brick.
fn bit([x, y, z]: [i32; 3]) -> i32 {
    let part = |c: i32| c & (SIDE - 1);
    part(x) + SIDE * (part(y) + SIDE * part(z))
}

fn octave(reach: f32) -> i32 {
    reach.log2().ceil() as i32
}
