//! Which supports reach a point: hash grids, one per octave of radius, that grow as supports are added.

use super::Support;
use crate::geometry::SurfacePoint;
use crate::scatter::octaves::Octaves;

/// Supports weigh in up to this interpolation distance, hence within this many radii.
pub const REACH: f32 = 2.0;

/// Finds the supports whose reach includes a point. Memory: about 40 bytes a support.
#[derive(Default)]
pub struct SupportIndex {
    supports: Vec<Support>,
    octaves: Octaves,
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
        self.octaves.push(id, support.point.position, REACH * support.radius);
    }

    /// Calls `visit(number, interpolation distance)` for every support within `reach` (≤ [`REACH`]) of the point.
    pub fn for_each(&self, at: &SurfacePoint, reach: f32, mut visit: impl FnMut(u32, f32)) {
        self.octaves.for_each(at.position, |id| {
            let distance = self.supports[id as usize].distance(at);
            if distance < reach {
                visit(id, distance);
            }
        });
    }

    /// The supports within `reach`, nearest first, into `found` (cleared before); ties by number.
    pub fn nearest(&self, at: &SurfacePoint, reach: f32, found: &mut Vec<(f32, u32)>) {
        found.clear();
        self.for_each(at, reach, |id, distance| found.push((distance, id)));
        found.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::geometry::hash;

    #[test]
    fn finds_what_brute_force_finds() {
        let supports: Vec<Support> = (0..500u64)
            .map(|i| {
                let [x, y] = hash::unit_pair(1, i);
                let [z, r] = hash::unit_pair(2, i);
                let normal = crate::geometry::hemisphere::uniform_sphere(hash::unit_pair(3, i));
                Support {
                    point: SurfacePoint { position: Vec3::new(x, y, z) * 2.0 - 1.0, normal },
                    radius: 0.01 + 0.6 * r * r,
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
