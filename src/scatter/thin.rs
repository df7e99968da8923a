//! Dart throwing at one spacing: of points in order, those that keep their distance from all kept before.

use glam::Vec3;

use crate::geometry::{SurfacePoint, hash};

/// Points conflict only when their normals' cosine exceeds this: about 45°.
pub const CONFLICT_COSINE: f32 = 0.7;

const EMPTY: u32 = u32::MAX;

/// A flat hash of cells one spacing wide.
pub struct Darts {
    spacing: f32,
    mask: usize,
    heads: Vec<(u64, u32)>,
    points: Vec<(SurfacePoint, u32)>,
}

impl Darts {
    /// For about `expected` points at this spacing.
    pub fn new(spacing: f32, expected: usize) -> Self {
        let size = (4 * expected.max(16)).next_power_of_two();
        Self { spacing, mask: size - 1, heads: vec![(u64::MAX, EMPTY); size], points: Vec::new() }
    }

    /// Whether a kept point is closer than the spacing and turned alike.
    pub fn conflicts(&self, point: &SurfacePoint) -> bool {
        let square = self.spacing * self.spacing;
        let centre = self.cell(point.position);
        (0..27).any(|k| {
            let near = [centre[0] + k % 3 - 1, centre[1] + k / 3 % 3 - 1, centre[2] + k / 9 - 1];
            let mut next = self.heads[self.slot(key(near))].1;
            while next != EMPTY {
                let (other, after) = &self.points[next as usize];
                if other.position.distance_squared(point.position) < square
                    && other.normal.dot(point.normal) > CONFLICT_COSINE
                {
                    return true;
                }
                next = *after;
            }
            false
        })
    }

    /// Keeps a point.
    pub fn keep(&mut self, point: SurfacePoint) {
        if 2 * self.points.len() >= self.heads.len() {
            self.grow();
        }
        let key = key(self.cell(point.position));
        let slot = self.slot(key);
        let next = self.heads[slot].1;
        self.heads[slot] = (key, self.points.len() as u32);
        self.points.push((point, next));
    }

    fn grow(&mut self) {
        let mut larger = Self::new(self.spacing, self.heads.len());
        for (point, _) in &self.points {
            larger.keep(*point);
        }
        *self = larger;
    }

    fn cell(&self, p: Vec3) -> [i32; 3] {
        super::floor(p / self.spacing)
    }

    /// The slot that holds a key, or the free one where it belongs.
    fn slot(&self, key: u64) -> usize {
        let mut at = key as usize & self.mask;
        while self.heads[at].1 != EMPTY && self.heads[at].0 != key {
            at = (at + 1) & self.mask;
        }
        at
    }
}

fn key([x, y, z]: [i32; 3]) -> u64 {
    let pack = |v: i32| u64::from(v as u32) & 0x1f_ffff;
    hash::mix(pack(x) | pack(y) << 21 | pack(z) << 42)
}
