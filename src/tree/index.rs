//! Which supports reach a point: hash grids, one per octave of radius, that grow as supports are added.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use glam::Vec3;

use super::Support;
use crate::geometry::{SurfacePoint, hash};

/// Supports weigh in up to this interpolation distance, hence within this many radii.
pub const REACH: f32 = 2.0;

/// A hasher for keys that are well mixed already.
#[derive(Default)]
pub struct Passing(u64);

impl Hasher for Passing {
    fn finish(&self) -> u64 {
        self.0
    }
    fn write(&mut self, _: &[u8]) {
        unreachable!("keys are u64");
    }
    fn write_u64(&mut self, key: u64) {
        self.0 = key;
    }
}

type Grid = HashMap<u64, Vec<u32>, BuildHasherDefault<Passing>>;

/// Finds the supports whose reach includes a point. Memory: about 40 bytes a support.
#[derive(Default)]
pub struct SupportIndex {
    supports: Vec<Support>,
    /// By octave of the radius: (octave, cell edge, cells).
    octaves: Vec<(i32, f32, Grid)>,
}

impl SupportIndex {
    /// An index over the given supports, numbered by their position.
    pub fn new(supports: &[Support]) -> Self {
        let mut index = Self::default();
        for support in supports {
            index.push(*support);
        }
        index
    }

    /// All supports, in the order they were added.
    pub fn supports(&self) -> &[Support] {
        &self.supports
    }

    /// Adds a support; it gets the next number.
    pub fn push(&mut self, support: Support) {
        let id = self.supports.len() as u32;
        self.supports.push(support);
        let octave = support.radius.log2().floor() as i32;
        let slot = match self.octaves.iter().position(|(o, _, _)| *o == octave) {
            Some(slot) => slot,
            None => {
                // A cell as wide as the largest reach of the octave's supports: eight cells hold all that can reach.
                let edge = 2.0 * REACH * f32::powi(2.0, octave + 1);
                self.octaves.push((octave, edge, Grid::default()));
                self.octaves.len() - 1
            }
        };
        let (_, edge, grid) = &mut self.octaves[slot];
        grid.entry(key(cell(support.point.position, *edge))).or_default().push(id);
    }

    /// Calls `visit(number, interpolation distance)` for every support within `reach` (≤ [`REACH`]) of the point.
    pub fn for_each(&self, at: &SurfacePoint, reach: f32, mut visit: impl FnMut(u32, f32)) {
        for (_, edge, grid) in &self.octaves {
            // The point's cell and its neighbours towards the nearer corner.
            let corner = cell(at.position - Vec3::splat(0.5 * edge), *edge);
            for offset in 0..8 {
                let near =
                    [corner[0] + (offset & 1), corner[1] + (offset >> 1 & 1), corner[2] + (offset >> 2)];
                let Some(ids) = grid.get(&key(near)) else { continue };
                for &id in ids {
                    let distance = self.supports[id as usize].distance(at);
                    if distance < reach {
                        visit(id, distance);
                    }
                }
            }
        }
    }

    /// The supports within `reach`, nearest first, into `found` (cleared before); ties by number.
    pub fn nearest(&self, at: &SurfacePoint, reach: f32, found: &mut Vec<(f32, u32)>) {
        found.clear();
        self.for_each(at, reach, |id, distance| found.push((distance, id)));
        found.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    }
}

fn cell(position: Vec3, edge: f32) -> [i32; 3] {
    (position / edge).floor().as_ivec3().to_array()
}

fn key([x, y, z]: [i32; 3]) -> u64 {
    let pack = |v: i32| u64::from(v as u32) & 0x1f_ffff;
    hash::mix(pack(x) | pack(y) << 21 | pack(z) << 42)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_what_brute_force_finds() {
        let supports: Vec<Support> = (0..500u64)
            .map(|i| {
                let [x, y] = hash::unit_pair(1, i);
                let [z, r] = hash::unit_pair(2, i);
                let normal = crate::geometry::hemisphere::uniform_sphere(hash::unit_pair(3, i));
                Support {
                    point: SurfacePoint { position: Vec3::new(x, y, z) * 2.0 - 1.0, normal },
                    radius: 0.01 + 0.4 * r * r,
                }
            })
            .collect();
        let index = SupportIndex::new(&supports);
        let mut found = Vec::new();
        let mut total = 0;
        for query in supports.iter().map(|s| s.point) {
            index.nearest(&query, REACH, &mut found);
            let mut ids: Vec<u32> = found.iter().map(|f| f.1).collect();
            ids.sort_unstable();
            let brute: Vec<u32> =
                (0..500).filter(|&i| supports[i as usize].distance(&query) < REACH).collect();
            assert_eq!(ids, brute);
            total += brute.len();
        }
        assert!(total > 1000, "the test must find more than each point itself, found {total}");
    }
}
