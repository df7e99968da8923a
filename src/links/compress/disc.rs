//! The links of a row on the disc that its rays fill evenly, and which of them a ray is likely to have met.
//!
//! A cosine-distributed row is even on the unit disc under the hemisphere, and turned back by its key it is the same lattice in
//! every row: rays have fixed places and fixed cells of a grid. A ray looks at the links [`NEAR`] to it in its own row of
//! cells and in the two beside; the likeliest is the one of the least squared distance over all its rays, as a link's share
//! of the disc grows with them. It is always the same number of links, so that nothing branches.

use glam::{Vec3, Vec4, Vec4Swizzles};

use super::merged::Merged;
use crate::links::rows::lattice;

/// Links compared at a time.
const LANES: usize = 4;

/// Links that a ray looks at in a row of cells.
const NEAR: usize = 2 * LANES;

/// Rays to a cell. With 1.7 to 4 the order of three scenes takes the same within 5 %; smaller cells make more links be sought
/// among all, larger ones put nearer ones out of sight.
const RAYS_A_CELL: f32 = 2.2;

/// How far away slots without a link, or whose rays are all accounted for, are.
const FAR: f32 = 1e9;

/// Keys of links that have rays left are below this.
const NO_LINK: f32 = 1e6;

/// Keeps what rounding leaves of a squared distance positive.
const ROUNDING: f32 = 2e-6;

/// Where the rays of a row lie, and in which cell.
#[derive(Debug, Clone, Default)]
pub struct Places {
    /// On the hemisphere over the disc.
    pub rays: Vec<Ray>,
    /// Cells in a row of the grid; two rows more are its border.
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
        let mut places = Self { rays: Vec::new(), side: (2.0 * scale) as usize + 1, scale };
        let place = |[x, y]: [f32; 2]| {
            let at = Vec3::new(x, y, (1.0 - x * x - y * y).max(0.0).sqrt());
            Ray { at, cell: places.cell(at) }
        };
        // The row's own shift is a part of a ray's share of the disc: its mean will do.
        places.rays = lattice(rays).iter().map(|point| place(point.on_disc(0.5 / rays as f32))).collect();
        places
    }

    #[inline(always)]
    fn cell(&self, at: Vec3) -> u32 {
        let along = |x: f32| (((x + 1.0) * self.scale) as u32).min(self.side as u32 - 1);
        (along(at.y) + 1) * self.side as u32 + along(at.x)
    }
}

/// What a ray has near it.
#[derive(Debug, Clone, Copy)]
pub struct Choice {
    /// Key of the likeliest link.
    pub best: u32,
    /// The next likeliest's.
    pub second: u32,
    begins: [u32; 3],
    at: Vec3,
}

impl Choice {
    /// How many links near have rays left: none, one, or more.
    pub fn number(&self) -> usize {
        usize::from(self.best < NO_LINK.to_bits()) + usize::from(self.second < NO_LINK.to_bits())
    }
}

/// Which links are ranked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reach {
    /// Those near the ray.
    Near,
    /// All of the row.
    All,
}

/// The links of a row, by cell. A link's number is its slot; its key for a ray is how unlikely it is, then its slot.
#[derive(Debug, Default)]
pub struct Disc {
    /// Of every cell: its links, its next free slot, and the first slot that its rays look at.
    numbers: Vec<u32>,
    starts: Vec<u32>,
    begins: Vec<u32>,
    /// Of every slot: the way to the site, times twice the weight, one over the link's rays; and twice the weight.
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
    weight: Vec<f32>,
    left: Vec<u32>,
    sites: Vec<u32>,
    /// By fours of slots: how many links have rays left.
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
    /// Lays out a row's links seen from a point with this frame; `slot(site, slot)` hears of each.
    pub fn set(
        &mut self,
        places: &Places,
        merged: &Merged,
        (from, frame): (Vec3, [Vec3; 3]),
        positions: &[Vec3],
        mut slot: impl FnMut(u32, u32),
    ) {
        self.numbers.clear();
        self.numbers.resize(places.side * (places.side + 2), 0);
        self.room.clear();
        self.room.extend(merged.sites.iter().map(|&site| {
            let way = positions[site as usize] - from;
            let at = Vec3::new(way.dot(frame[0]), way.dot(frame[1]), way.dot(frame[2]));
            let at = at * (1.0 / at.length().max(f32::MIN_POSITIVE));
            // What is no direction may be anywhere, but must be a number.
            let at = if at.is_finite() { at } else { Vec3::ZERO };
            (at, places.cell(at))
        }));
        self.room.iter().for_each(|&(_, cell)| self.numbers[cell as usize] += 1);
        self.lay_out(places);
        (self.rays, self.live) = (0, merged.sites.len() as u32);
        for (k, &(at, cell)) in self.room.iter().enumerate() {
            let start = &mut self.starts[cell as usize];
            let own = *start as usize;
            *start += 1;
            let weight = 2.0 / merged.counts[k] as f32;
            (self.x[own], self.y[own], self.z[own]) = (at.x * weight, at.y * weight, at.z * weight);
            self.weight[own] = weight + ROUNDING;
            (self.left[own], self.sites[own]) = (merged.counts[k], merged.sites[k]);
            self.blocks[own / LANES] += 1;
            self.rays += merged.counts[k];
            slot(merged.sites[k], own as u32);
        }
    }

    /// Gives every cell its slots, with room after every row of cells, and all slots no link.
    fn lay_out(&mut self, places: &Places) {
        self.starts.clear();
        self.begins.clear();
        let mut next = 0;
        for row in self.numbers.chunks_exact(places.side) {
            let first = next;
            for &number in row {
                self.starts.push(next);
                next += number;
            }
            let last = (next - first).saturating_sub(NEAR as u32) + first;
            let starts = &self.starts[self.starts.len() - row.len()..];
            let begin = |(start, number): (&u32, &u32)| {
                (start + number / 2).saturating_sub(NEAR as u32 / 2).clamp(first, last)
            };
            self.begins.extend(starts.iter().zip(row).map(begin));
            next += NEAR as u32;
        }
        let slots = next as usize;
        for axis in [&mut self.x, &mut self.y, &mut self.z] {
            axis.resize(slots, 0.0);
        }
        self.weight.clear();
        self.weight.resize(slots, FAR);
        self.left.resize(slots, 0);
        self.sites.resize(slots, 0);
        self.blocks.clear();
        self.blocks.resize(slots / LANES + 1, 0);
        self.slot_bits = next.next_power_of_two() - 1;
    }

    /// The slot of a key.
    pub fn slot(&self, key: u32) -> usize {
        (key & self.slot_bits) as usize
    }

    /// Keys of four slots.
    #[inline(always)]
    fn keys(&self, first: usize, at: Vec3) -> Vec4 {
        let along = four(&self.x, first) * at.x + four(&self.y, first) * at.y + four(&self.z, first) * at.z;
        let unlikely = (four(&self.weight, first) - along).to_array();
        let key = |l: usize| f32::from_bits(unlikely[l].to_bits() & !self.slot_bits | (first + l) as u32);
        Vec4::new(key(0), key(1), key(2), key(3))
    }

    /// The likeliest links near a ray.
    #[inline(always)]
    pub fn choice(&self, places: &Places, ray: Ray) -> Choice {
        let cell = ray.cell as usize;
        let begins = [cell - places.side, cell, cell + places.side].map(|cell| self.begins[cell]);
        let (mut best, mut second) = (Vec4::splat(FAR), Vec4::splat(FAR));
        for begin in begins {
            for first in [begin as usize, begin as usize + LANES] {
                let keys = self.keys(first, ray.at);
                second = second.min(best.max(keys));
                best = best.min(keys);
            }
        }
        for turn in [Vec4::zwxy, Vec4::yxwz] {
            let others = turn(best);
            second = second.min(turn(second)).min(best.max(others));
            best = best.min(others);
        }
        Choice { best: best.x.to_bits(), second: second.x.to_bits(), begins, at: ray.at }
    }

    /// Keys of the links within reach of a ray, by fours.
    #[inline(always)]
    fn within(&self, choice: &Choice, reach: Reach, mut take: impl FnMut(Vec4)) {
        if reach == Reach::Near {
            for begin in choice.begins {
                take(self.keys(begin as usize, choice.at));
                take(self.keys(begin as usize + LANES, choice.at));
            }
            return;
        }
        for (block, &live) in self.blocks.iter().enumerate() {
            if live > 0 {
                take(self.keys(block * LANES, choice.at));
            }
        }
    }

    /// Whether a slot is near a ray.
    pub fn is_near(&self, choice: &Choice, slot: usize) -> bool {
        choice.begins.iter().any(|&begin| (slot as u32).wrapping_sub(begin) < NEAR as u32)
    }

    /// How many links within reach of a ray are likelier than a slot's.
    pub fn rank(&self, choice: &Choice, (reach, slot): (Reach, usize)) -> u32 {
        let block = self.keys(slot / LANES * LANES, choice.at);
        let (own, mut rank) = (Vec4::splat(block.to_array()[slot % LANES]), 0);
        self.within(choice, reach, |keys| rank += keys.cmplt(own).bitmask().count_ones());
        rank
    }

    /// The slot that so many within reach of a ray are likelier than.
    pub fn ranked(&mut self, choice: &Choice, (reach, rank): (Reach, u32)) -> Option<usize> {
        if rank == 0 {
            let mut best = Vec4::splat(FAR);
            self.within(choice, reach, |keys| best = best.min(keys));
            let best = best.min_element();
            return (best < NO_LINK).then(|| self.slot(best.to_bits()));
        }
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
            self.weight[slot] = FAR;
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

#[cfg(test)]
mod tests {
    use super::*;

    const RAYS: u32 = 341;

    fn disc(places: &Places, positions: &[Vec3]) -> Disc {
        let links = positions.len();
        let merged = Merged { sites: (0..links as u32).collect(), counts: vec![1; links], lost: 0 };
        let mut disc = Disc::default();
        disc.set(places, &merged, (Vec3::ZERO, [Vec3::X, Vec3::Y, Vec3::Z]), positions, |_, _| ());
        disc
    }

    #[test]
    fn the_likeliest_is_the_one_straight_ahead() {
        let places = Places::new(RAYS);
        // Every second ray has a site ahead, near or far. That puts 1.1 links into a cell, so that four on either
        // side of the middle hold a ray's own cell, and rays are 0.1 apart, far more than keys are rounded by.
        let positions: Vec<Vec3> =
            places.rays.iter().step_by(2).map(|ray| ray.at * (1.0 + ray.at.x)).collect();
        let mut disc = disc(&places, &positions);
        for (k, ray) in places.rays.iter().step_by(2).enumerate() {
            let choice = disc.choice(&places, *ray);
            let slot = disc.slot(choice.best);
            assert!(disc.is_near(&choice, slot), "ray {k}");
            assert_eq!(disc.rank(&choice, (Reach::All, slot)), 0, "ray {k}");
            assert_eq!(disc.ranked(&choice, (Reach::All, 0)), Some(slot), "ray {k}");
            assert_eq!(disc.take(slot), k as u32);
        }
        assert_eq!((disc.rays, disc.live), (0, 0));
        assert_eq!(disc.choice(&places, places.rays[0]).number(), 0);
    }

    #[test]
    fn ranks_and_slots_are_each_others_inverse() {
        let places = Places::new(RAYS);
        // Sites above and below the horizon, in one place, at the receiver and nowhere.
        let at = |k: u64| Vec3::from_array([1, 2, 3].map(|axis| crate::geometry::hash::unit(axis, k) - 0.5));
        let mut positions: Vec<Vec3> = (0..150).map(|k| at(k / 2)).collect();
        positions.extend([Vec3::ZERO, Vec3::NAN, Vec3::INFINITY]);
        let mut disc = disc(&places, &positions);
        for ray in &places.rays {
            let choice = disc.choice(&places, *ray);
            for rank in 0..positions.len() as u32 {
                let slot = disc.ranked(&choice, (Reach::All, rank)).expect("as many as there are links");
                assert_eq!(disc.rank(&choice, (Reach::All, slot)), rank);
            }
            assert_eq!(disc.ranked(&choice, (Reach::Near, 1)), Some(disc.slot(choice.second)));
            assert_eq!(disc.ranked(&choice, (Reach::All, positions.len() as u32)), None);
        }
    }
}
