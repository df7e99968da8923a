//! Which spheres reach a point: hash grids, one per octave of radius, that grow as spheres are added.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use glam::Vec3;

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

type Grid = HashMap<u64, Vec<u32>, BuildHasherDefault<Passing>>;

/// Spheres by octave of their radius. Memory: about 40 bytes a sphere.
#[derive(Default, Clone)]
pub struct Octaves {
    /// (octave, cell edge, cells), finest first.
    grids: Vec<(i32, f32, Grid)>,
}

impl Octaves {
    /// Adds sphere `id`; its radius is the reach within which [`Octaves::for_each`] shows it.
    pub fn push(&mut self, id: u32, centre: Vec3, radius: f32) {
        let octave = radius.log2().floor() as i32;
        let slot = self.grids.partition_point(|g| g.0 < octave);
        if self.grids.get(slot).is_none_or(|g| g.0 != octave) {
            // A cell as wide as the largest diameter of the octave: eight cells hold all that can reach.
            self.grids.insert(slot, (octave, 2.0 * f32::powi(2.0, octave + 1), Grid::default()));
        }
        let (_, edge, grid) = &mut self.grids[slot];
        grid.entry(key(cell(centre, *edge))).or_default().push(id);
    }

    /// Calls `visit(id)` for every sphere that may hold the point, and some that do not, the small ones first.
    #[inline]
    pub fn for_each(&self, at: Vec3, mut visit: impl FnMut(u32)) {
        for (_, edge, grid) in &self.grids {
            // The point's cell and its neighbours towards the nearer corner.
            let corner = cell(at - Vec3::splat(0.5 * edge), *edge);
            for offset in 0..8 {
                let near =
                    [corner[0] + (offset & 1), corner[1] + (offset >> 1 & 1), corner[2] + (offset >> 2)];
                if let Some(ids) = grid.get(&key(near)) {
                    ids.iter().for_each(|&id| visit(id));
                }
            }
        }
    }
}

fn cell(position: Vec3, edge: f32) -> [i32; 3] {
    (position / edge).floor().as_ivec3().to_array()
}

fn key([x, y, z]: [i32; 3]) -> u64 {
    let pack = |v: i32| u64::from(v as u32) & 0x1f_ffff;
    hash::mix(pack(x) | pack(y) << 21 | pack(z) << 42)
}
