//! The links of a row on the disc that its rays fill evenly, in a grid, and which of them a ray is likely to have met.
//!
//! A cosine-distributed row is even on the unit disc under the hemisphere, and turned back by its key it is the same lattice in
//! every row: rays have fixed places and fixed cells. A ray looks at the links in its cell and the eight around: the
//! likeliest is the one of the least squared distance over the rays it still has, as a link's share of the disc grows with its rays.

use glam::{Vec3, Vec4};

use super::merged::Merged;
use crate::links::rows::lattice;

/// Links compared at a time.
const LANES: usize = 4;

/// Where links without rays left are moved to.
const FAR: f32 = 1e6;

/// Keys of links that have rays left are below that of this squared distance.
const NO_LINK: f32 = 8_388_608.0;

/// Numbers of the lanes.
const LANE: Vec4 = Vec4::new(0.0, 1.0, 2.0, 3.0);

/// Rays to a cell of the grid.
const RAYS_A_CELL: f32 = 1.7;

/// Where the rays of a row lie, and in which cell.
#[derive(Debug, Clone, Default)]
pub struct Places {
    /// On the hemisphere over the disc.
    pub rays: Vec<Ray>,
    /// Cells in a row of the grid, with one of border on either side.
    side: usize,
    /// Cells a unit.
    scale: f32,
}

/// A ray's place.
#[derive(Debug, Clone, Copy)]
pub struct Ray {
    at: Vec3,
    cell: u32,
}

impl Places {
    /// Of rows of so many rays.
    pub fn new(rays: u32) -> Self {
        let scale = (rays as f32 / (RAYS_A_CELL * std::f32::consts::PI)).sqrt().max(1.0);
        let mut places = Self { rays: Vec::new(), side: (2.0 * scale) as usize + 3, scale };
        let place = |[x, y]: [f32; 2]| {
            let at = Vec3::new(x, y, (1.0 - x * x - y * y).max(0.0).sqrt());
            Ray { at, cell: places.cell(at) }
        };
        places.rays = lattice(rays).iter().map(|point| place(point.on_disc(0.5 / rays as f32))).collect();
        places
    }

    fn cell(&self, at: Vec3) -> u32 {
        // Rounding may put a place at ±1 beyond the last cell but one.
        let along = |x: f32| (((x + 1.0) * self.scale) as u32).min(self.side as u32 - 3) + 1;
        along(at.y) * self.side as u32 + along(at.x)
    }
}

/// What a ray has around it.
#[derive(Debug, Clone, Copy)]
pub struct Choice {
    /// Key of the likeliest link, and of the next.
    pub best: u32,
    /// The next likeliest's.
    pub second: u32,
    spans: [(u32, u32); 3],
    at: Vec3,
}

/// Which links are ranked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reach {
    /// Those of the ray's cell and the eight around.
    Near,
    /// All of the row.
    All,
}

impl Choice {
    /// How many links near have rays left: none, one, or more.
    pub fn number(&self) -> usize {
        usize::from(self.best < NO_LINK.to_bits()) + usize::from(self.second < NO_LINK.to_bits())
    }
}

/// The links of a row, by cell. A link's number is its slot; its key for a ray is how unlikely it is, then its slot.
#[derive(Debug, Default)]
pub struct Disc {
    /// Of the cells, one more at the end.
    starts: Vec<u32>,
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
    /// One over the rays of all.
    weight: Vec<f32>,
    left: Vec<u32>,
    sites: Vec<u32>,
    /// By fours: how many links have rays left.
    blocks: Vec<u8>,
    /// Bits of a key that are the slot.
    slot_bits: u32,
    /// Rays left of all links.
    pub rays: u32,
    /// Links with rays left.
    pub live: u32,
    room: Vec<(Vec3, u32)>,
    keys: Vec<u32>,
}

impl Disc {
    /// Lays out a row's links seen from a point with this frame.
    pub fn set(
        &mut self,
        places: &Places,
        merged: &Merged,
        (from, frame): (Vec3, [Vec3; 3]),
        positions: &[Vec3],
    ) {
        let n = merged.sites.len();
        self.starts.clear();
        self.starts.resize(places.side * places.side + 2, 0);
        self.room.clear();
        for &site in &merged.sites {
            let way = (positions[site as usize] - from).normalize_or_zero();
            let at = Vec3::new(way.dot(frame[0]), way.dot(frame[1]), way.dot(frame[2]));
            let cell = places.cell(at);
            self.starts[cell as usize + 2] += 1;
            self.room.push((at, cell));
        }
        let mut sum = 0;
        for start in &mut self.starts {
            sum += *start;
            *start = sum;
        }
        for lane in [&mut self.x, &mut self.y, &mut self.z, &mut self.weight] {
            lane.resize(n + LANES, FAR);
        }
        self.left.resize(n, 0);
        self.sites.resize(n, 0);
        self.rays = 0;
        for (k, &(at, cell)) in self.room.iter().enumerate() {
            let start = &mut self.starts[cell as usize + 1];
            let slot = *start as usize;
            *start += 1;
            (self.x[slot], self.y[slot], self.z[slot]) = (at.x, at.y, at.z);
            (self.left[slot], self.sites[slot]) = (merged.counts[k], merged.sites[k]);
            self.weight[slot] = 1.0 / merged.counts[k] as f32;
            self.rays += merged.counts[k];
        }
        self.live = n as u32;
        self.blocks.clear();
        self.blocks.resize(n / LANES, LANES as u8);
        self.blocks.push((n % LANES) as u8);
        self.slot_bits = (n as u32 + LANES as u32).next_power_of_two() - 1;
    }

    /// The slots' sites.
    pub fn sites(&self) -> &[u32] {
        &self.sites
    }

    /// The slot of a key.
    pub fn slot(&self, key: u32) -> usize {
        (key & self.slot_bits) as usize
    }

    #[inline(always)]
    fn key(&self, slot: usize, at: Vec3) -> u32 {
        let (x, y, z) = (self.x[slot] - at.x, self.y[slot] - at.y, self.z[slot] - at.z);
        ((x * x + y * y + z * z) * self.weight[slot]).to_bits() & !self.slot_bits | slot as u32
    }

    /// Keys of the slots of a span, by fours; beyond its end they are [`NO_LINK`].
    #[inline(always)]
    fn keys(&self, (start, end): (u32, u32), at: Vec3, mut take: impl FnMut(Vec4)) {
        let (mut k, end) = (start as usize, end as usize);
        let (x, y, z) = (Vec4::splat(at.x), Vec4::splat(at.y), Vec4::splat(at.z));
        while k < end {
            let (x, y, z) = (four(&self.x, k) - x, four(&self.y, k) - y, four(&self.z, k) - z);
            let unlikely = ((x * x + y * y + z * z) * four(&self.weight, k)).to_array();
            let key = |l: usize| f32::from_bits(unlikely[l].to_bits() & !self.slot_bits | (k + l) as u32);
            let keys = Vec4::new(key(0), key(1), key(2), key(3));
            take(Vec4::select(LANE.cmplt(Vec4::splat((end - k) as f32)), keys, Vec4::splat(NO_LINK)));
            k += LANES;
        }
    }

    /// The likeliest links around a ray.
    #[inline(always)]
    pub fn choice(&self, places: &Places, ray: Ray) -> Choice {
        let cell = ray.cell as usize;
        let spans = [cell - places.side, cell, cell + places.side].map(|row| self.span(row));
        let (mut best, mut second) = (Vec4::splat(NO_LINK), Vec4::splat(NO_LINK));
        for span in spans {
            self.keys(span, ray.at, |keys| {
                second = second.min(best.max(keys));
                best = best.min(keys);
            });
        }
        let (lanes, seconds) = (best.to_array(), second.to_array());
        let mut choice = Choice { best: lanes[0].to_bits(), second: seconds[0].to_bits(), spans, at: ray.at };
        for l in 1..LANES {
            let (best, second) = (lanes[l].to_bits(), seconds[l].to_bits());
            choice.second = choice.second.min(choice.best.max(best)).min(second);
            choice.best = choice.best.min(best);
        }
        choice
    }

    #[inline(always)]
    fn span(&self, middle: usize) -> (u32, u32) {
        (self.starts[middle - 1], self.starts[middle + 2])
    }

    /// Keys of the links within reach of a ray, by fours.
    #[inline(always)]
    fn within(&self, choice: &Choice, reach: Reach, mut take: impl FnMut(Vec4)) {
        if reach == Reach::Near {
            choice.spans.iter().for_each(|&span| self.keys(span, choice.at, &mut take));
            return;
        }
        let all = self.sites.len() as u32;
        for (block, _) in self.blocks.iter().enumerate().filter(|(_, live)| **live > 0) {
            let first = (block * LANES) as u32;
            self.keys((first, all.min(first + LANES as u32)), choice.at, &mut take);
        }
    }

    /// Whether a slot is near a ray.
    pub fn is_near(&self, choice: &Choice, slot: usize) -> bool {
        choice.spans.iter().any(|&(start, end)| (start..end).contains(&(slot as u32)))
    }

    /// How many links within reach of a ray are likelier than a slot's.
    pub fn rank(&self, choice: &Choice, (reach, slot): (Reach, usize)) -> u32 {
        let (own, mut rank) = (Vec4::splat(f32::from_bits(self.key(slot, choice.at))), 0);
        self.within(choice, reach, |keys| rank += keys.cmplt(own).bitmask().count_ones());
        rank
    }

    /// The slot that so many within reach of a ray are likelier than.
    pub fn ranked(&mut self, choice: &Choice, (reach, rank): (Reach, u32)) -> Option<usize> {
        let mut found = std::mem::take(&mut self.keys);
        found.clear();
        self.within(choice, reach, |keys| {
            found.extend(keys.to_array().iter().filter(|&&key| key < NO_LINK).map(|key| key.to_bits()));
        });
        let key = ((rank as usize) < found.len()).then(|| *found.select_nth_unstable(rank as usize).1);
        self.keys = found;
        key.map(|key| self.slot(key))
    }

    /// Accounts for one ray of a link; its site.
    #[inline(always)]
    pub fn take(&mut self, slot: usize) -> u32 {
        self.left[slot] -= 1;
        self.rays -= 1;
        if self.left[slot] == 0 {
            self.x[slot] = FAR;
            self.live -= 1;
            self.blocks[slot / LANES] -= 1;
        }
        self.sites[slot]
    }
}

/// Four numbers from number k on.
#[inline(always)]
fn four(numbers: &[f32], k: usize) -> Vec4 {
    Vec4::from_slice(&numbers[k..k + LANES])
}
