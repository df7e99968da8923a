//! Which spheres reach a point: hash grids, one per octave of radius, that grow as spheres are added.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use glam::Vec3;
use smallvec::SmallVec;

use crate::geometry::hash;

/// A hasher for keys that are well mixed already.
#[derive(Default, Clone)]
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

type Grid = HashMap<u64, SmallVec<[u32; 6]>, BuildHasherDefault<Passing>>;

/// Spheres by octave of their radius; each stands in every cell that it touches, so that a query reads one cell an octave.
/// Memory: about 200 bytes a sphere.
#[derive(Default, Clone)]
pub struct Octaves {
    /// (octave, cell edge, cells), finest first.
    grids: Vec<(i32, f32, Grid)>,
}

impl Octaves {
    /// Adds sphere `id`; its radius is the reach within which [`Octaves::for_each`] shows it.
    pub fn push(&mut self, id: u32, centre: Vec3, radius: f32) {
        let octave = radius.log2().ceil() as i32;
        let slot = self.grids.partition_point(|g| g.0 < octave);
        if self.grids.get(slot).is_none_or(|g| g.0 != octave) {
            // A cell at least as wide as the octave's radii: a sphere touches 8 to 27 of them.
            self.grids.insert(slot, (octave, f32::powi(2.0, octave), Grid::default()));
        }
        let (_, edge, grid) = &mut self.grids[slot];
        let (low, high) = (cell(centre - radius, *edge), cell(centre + radius, *edge));
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for z in low[2]..=high[2] {
                    let corner = Vec3::new(x as f32, y as f32, z as f32) * *edge;
                    let nearest = centre.clamp(corner, corner + *edge);
                    if nearest.distance_squared(centre) <= radius * radius {
                        grid.entry(key([x, y, z])).or_default().push(id);
                    }
                }
            }
        }
    }

    /// Calls `visit(id)` for every sphere that holds the point, and some that do not, the small ones first.
    #[inline]
    pub fn for_each(&self, at: Vec3, mut visit: impl FnMut(u32)) {
        for (_, edge, grid) in &self.grids {
            if let Some(ids) = grid.get(&key(cell(at, *edge))) {
                ids.iter().for_each(|&id| visit(id));
            }
        }
    }
}

fn cell(position: Vec3, edge: f32) -> [i32; 3] {
    super::floor(position * edge.recip())
}

fn key([x, y, z]: [i32; 3]) -> u64 {
    let pack = |v: i32| u64::from(v as u32) & 0x1f_ffff;
    hash::mix(pack(x) | pack(y) << 21 | pack(z) << 42)
}
