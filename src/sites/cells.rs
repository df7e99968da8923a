//! Which site stands for the bit of surface that a ray met: a table over small cells of every triangle.
//!
//! A cell's site is the one that minimises d² + 4h²(1 − n·n′) for the cell's centre; when that site is not sure (unclean, or not in its plane) it must
//! also be visible from there, or the next nearest is taken. A triangle is quartered until its parts are as small as the
//! sites around are dense; triangles smaller than that have one cell. The table is filled at first touch, all cells of a
//! plot together, and looked over for visibility at each cell's own; as a cell's site depends on the cell alone, it does
//! not matter who fills it.

use std::sync::atomic::{AtomicU32, Ordering};

use super::crowd::Crowd;
use super::neighbours::{Neighbours, mutually_visible};
use super::plots::Plots;
use super::{Plot, SiteId, Sites};
use crate::geometry::{LIFT, SurfacePoint, triangle};
use crate::rays::{Bvh, Hit};
use crate::scatter::surface::{Surface, quarter, side_normal, unfold};
use crate::scene::Scene;

/// Edge of a cell in spacings. Larger cells blur the borders between sites, smaller ones cost memory by the square.
const CELL_SPACINGS: f32 = 1.0;

/// Nearest sites tried for visibility before a cell is left without one.
const TRIES: usize = 8;

/// Quarterings within one slot at the most.
const FINEST: u32 = 12;

const UNFILLED: u32 = 0;
/// Points this near to a site's plane lie in it, local units: a few roundings of f32.
const PLANE: f32 = 4.0 * LIFT;

/// From here on cells hold the nearest site + 1, which is not sure, and not yet whether it is visible; here, no site yet.
const UNSURE: u32 = 1 << 31;
const NO_SITE: u32 = UNSURE - 1;

/// What became of one triangle or part of one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Slot {
    /// First cell, or the first of four slots.
    first: u32,
    /// Quarterings that its cells are apart, or [`SPLIT`], or [`DEAD`].
    depth: u32,
}

const SPLIT: u32 = 100;
const DEAD: u32 = 101;
const NOTHING: Slot = Slot { first: 0, depth: DEAD };

/// What a cell says of the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Said {
    /// This site stands for it.
    Site(SiteId),
    /// Nothing reflects here.
    Dead,
    /// No site that is near is visible from here.
    Nobody,
}

/// What a cell is filled from; the same as the table was laid out for.
#[derive(Clone, Copy)]
pub struct Ground<'a> {
    /// The triangles.
    pub scene: &'a Scene,
    /// The ray engine over them.
    pub bvh: &'a Bvh,
    /// The sites on them.
    pub sites: &'a Sites,
    /// Which sites see each other.
    pub graph: &'a Neighbours,
}

/// The table from surface to sites.
pub struct Cells {
    /// Per triangle its front, then per triangle its back; then the parts.
    slots: Vec<Slot>,
    triangles: u32,
    /// Site + 1, that from [`UNSURE`] on, [`UNFILLED`] or [`NO_SITE`].
    table: Vec<AtomicU32>,
    plots: Plots,
}

impl Cells {
    /// Lays the cells out by how the surface was served; none is filled yet. Memory: 16 bytes a triangle, 4
    /// bytes a side that reflects, and 4 bytes a cell, about 8 cells a site or one a triangle.
    pub fn new(surface: &Surface<'_>, plots: &[Plot]) -> Self {
        let triangles = surface.scene().triangles.len();
        let mut cells = Self {
            slots: vec![NOTHING; 2 * triangles],
            triangles: triangles as u32,
            table: vec![],
            plots: Plots::default(),
        };
        let mut end = 0u64;
        for plot in plots.iter().filter(|p| p.spacing > 0.0) {
            cells.plots.push(plot, surface.triangles(&plot.piece), end as u32);
            for &id in surface.triangles(&plot.piece) {
                let depth = depth(surface.scene(), id, plot);
                let at = cells.place(id, plot.piece.back, plot.piece.path);
                cells.slots[at] = Slot { first: end as u32, depth };
                end += 1u64 << (2 * depth);
            }
        }
        assert!(end < u64::from(u32::MAX), "{end} surface cells do not fit 32 bits");
        cells.plots.end(end as u32);
        // Zeroed pages cost nothing until a ray touches them.
        cells.table =
            bytemuck::allocation::zeroed_vec::<u32>(end as usize).into_iter().map(AtomicU32::new).collect();
        cells
    }

    /// The slot of a part of a triangle, splitting on the way.
    fn place(&mut self, id: u32, back: bool, path: u64) -> usize {
        let mut at = id as usize + if back { self.triangles as usize } else { 0 };
        let splits = (63 - path.leading_zeros()) / 2;
        for k in (0..splits).rev() {
            if self.slots[at].depth != SPLIT {
                self.slots[at] = Slot { first: self.slots.len() as u32, depth: SPLIT };
                self.slots.extend([NOTHING; 4]);
            }
            at = self.slots[at].first as usize + (path >> (2 * k) & 3) as usize;
        }
        at
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.table.len()
    }

    /// Whether there is no cell, as in a scene without triangles.
    pub fn is_empty(&self) -> bool {
        self.table.is_empty()
    }

    /// The site that stands for the surface at a hit, seen from the front or the back.
    ///
    /// A few reads when the cell is filled; about 0.1 µs more for each cell of a plot at the plot's first touch, and up to
    /// eight rays at the cell's own next to walls.
    #[inline]
    pub fn site(&self, hit: &Hit, back: bool, ground: Ground<'_>) -> Said {
        let mut slot = self.slots[hit.triangle as usize + if back { self.triangles as usize } else { 0 }];
        let mut at = [hit.u, hit.v];
        let mut path = 1u64;
        while slot.depth == SPLIT {
            let (part, within) = quarter(at);
            slot = self.slots[slot.first as usize + part as usize];
            (path, at) = (path << 2 | part, within);
        }
        if slot.depth == DEAD {
            return Said::Dead;
        }
        let (cell, centre) = cell_of(at, slot.depth);
        let index = slot.first as usize + cell as usize;
        let stored = match self.table[index].load(Ordering::Relaxed) {
            known @ 1..UNSURE => known,
            _ => self.settle(index, (hit.triangle, unfold(path, centre), back), ground),
        };
        if stored == NO_SITE { Said::Nobody } else { Said::Site(SiteId(stored - 1)) }
    }

    /// What a cell shall hold for good.
    #[cold]
    fn settle(&self, index: usize, (id, [u, v], back): (u32, [f32; 2], bool), ground: Ground<'_>) -> u32 {
        if self.table[index].load(Ordering::Relaxed) == UNFILLED {
            self.fill(index, ground);
        }
        let stored = self.table[index].load(Ordering::Relaxed);
        if let 1..UNSURE = stored {
            return stored;
        }
        let centre = SurfacePoint {
            position: triangle::point(ground.scene.corners(id), u, v),
            normal: side_normal(ground.scene, id, back),
        };
        let site = match stored.checked_sub(UNSURE + 1) {
            Some(nearest) => ground.visible(&centre, SiteId(nearest)),
            None => ground.represent(&centre),
        };
        let stored = site.map_or(NO_SITE, |s| s.0 + 1);
        self.table[index].store(stored, Ordering::Relaxed);
        stored
    }

    /// Fills the cells of the plot that one is on, save for visibility.
    fn fill(&self, index: usize, ground: Ground<'_>) {
        let Some((number, cells)) = self.plots.together(index) else { return };
        let (plot, points) = self.plots.centres(ground.scene, number);
        let mut crowd = Crowd::default();
        crowd.gather(ground.sites, plot, &points);
        let crowded = crowd.overflows();
        let mut nearest = |point| match crowd.nearest(ground.sites, point) {
            None => NO_SITE,
            Some(site) if ground.is_sure(point, site) => site.0 + 1,
            Some(site) => UNSURE + site.0 + 1,
        };
        for (cell, point) in self.table[cells].iter().zip(&points) {
            let stored = if crowded { UNSURE } else { nearest(point) };
            // Others may have been here meanwhile, and know more.
            let _ = cell.compare_exchange(UNFILLED, stored, Ordering::Relaxed, Ordering::Relaxed);
        }
    }
}

/// How often a triangle, or the part of it that a plot is, is quartered into cells.
pub(super) fn depth(scene: &Scene, id: u32, plot: &Plot) -> u32 {
    let [a, b, c] = scene.corners(id);
    let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
    let splits = (63 - plot.piece.path.leading_zeros()) / 2;
    let edge = longest * f32::powi(0.5, splits as i32);
    let cells = edge / (CELL_SPACINGS * plot.spacing);
    if cells <= 1.0 { 0 } else { (cells.log2().ceil() as u32).min(FINEST) }
}

/// Which of the 4^depth cells of a triangle holds barycentric (u, v), and the barycentric centre of the cell.
///
/// The cells are those of `depth` quarterings, row after row: row j holds 2 (n − j) − 1 of n = 2^depth. No branch depends
/// on where the ray met, as the steps of [`quarter`] do.
#[inline]
fn cell_of([u, v]: [f32; 2], depth: u32) -> (u32, [f32; 2]) {
    let n = 1u32 << depth;
    let (x, y) = (u * n as f32, v * n as f32);
    // Casts saturate: rounding may put a hit just outside of its triangle.
    let j = (y as u32).min(n - 1);
    let i = (x as u32).min(n - 1 - j);
    let turned = (x - i as f32) + (y - j as f32) >= 1.0 && i + j + 1 < n;
    let third = if turned { 2.0 / 3.0 } else { 1.0 / 3.0 };
    let inverse = 1.0 / n as f32;
    let cell = j * (2 * n - j) + 2 * i + u32::from(turned);
    (cell, [(i as f32 + third) * inverse, (j as f32 + third) * inverse])
}

/// The centres of the 4^depth cells of a triangle, in the order of [`cell_of`].
pub(super) fn centres(depth: u32) -> impl Iterator<Item = [f32; 2]> {
    let n = 1u32 << depth;
    let inverse = 1.0 / n as f32;
    let centre =
        move |i: u32, j: u32, third: f32| [(i as f32 + third) * inverse, (j as f32 + third) * inverse];
    (0..n).flat_map(move |j| {
        // Every other cell of a row is turned.
        (0..2 * (n - j) - 1).map(move |k| centre(k / 2, j, if k % 2 == 1 { 2.0 / 3.0 } else { 1.0 / 3.0 }))
    })
}

impl Ground<'_> {
    /// The site that stands for any surface point: the nearest, or the nearest visible one where that is not sure.
    pub fn represent(&self, point: &SurfacePoint) -> Option<SiteId> {
        let site = self.sites.nearest(point)?;
        if self.is_sure(point, site) { Some(site) } else { self.visible(point, site) }
    }

    /// Whether a site speaks for a point near it without a look: nothing stands around it, and the point lies in its plane.
    /// A sheet close behind it has no sites of its own there, which would have told.
    pub fn is_sure(&self, point: &SurfacePoint, site: SiteId) -> bool {
        let at = self.sites.point(site);
        !self.graph.unclean(site)
            && (point.position - at.position).dot(at.normal).abs() <= PLANE + self.bvh.blur()
    }

    /// The nearest site if it is visible, else the nearest one that is.
    fn visible(&self, point: &SurfacePoint, nearest: SiteId) -> Option<SiteId> {
        // Next to walls, too, the nearest is mostly seen; only where it is not, the others are gathered.
        if self.sees(point, nearest) { Some(nearest) } else { self.next_visible(point) }
    }

    fn sees(&self, point: &SurfacePoint, site: SiteId) -> bool {
        mutually_visible(*point, self.sites.point(site), f32::INFINITY, self.bvh)
    }

    /// The nearest visible site but for the very nearest.
    #[cold]
    fn next_visible(&self, point: &SurfacePoint) -> Option<SiteId> {
        let mut near: Vec<(f32, SiteId)> = vec![];
        self.sites.visit_matching(point, |site, value| near.push((value, site)));
        near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        near.into_iter().take(TRIES).skip(1).map(|n| n.1).find(|&site| self.sees(point, site))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::hash;

    #[test]
    fn cells_are_numbered_once_and_hold_their_centres() {
        for depth in 0..6 {
            let mut seen = vec![false; 1 << (2 * depth)];
            for i in 0..50 << (2 * depth) {
                let (u, v) = triangle::uniform_barycentric(hash::unit_pair(7, i));
                let (cell, centre) = cell_of([u, v], depth);
                seen[cell as usize] = true;
                assert_eq!(cell_of(centre, depth), (cell, centre), "depth {depth}, cell {cell}");
                // The centre of the same quarter of a quarter ...: the paths agree.
                let path = |mut at: [f32; 2]| {
                    let step = |_| {
                        let (part, within) = quarter(at);
                        at = within;
                        part
                    };
                    (0..depth).map(step).collect::<Vec<_>>()
                };
                assert_eq!(path([u, v]), path(centre), "depth {depth}, cell {cell}");
            }
            let all: Vec<_> = centres(depth).map(|at| cell_of(at, depth).0).collect();
            assert!(all.iter().copied().eq(0..1 << (2 * depth)), "depth {depth}: {all:?}");
            // Fifty points a cell leave none out but with a chance of e^-50 each.
            assert!(seen.iter().all(|&s| s), "depth {depth}");
        }
        for outside in [[-1e-7, 0.5], [1.000_001, 0.0], [0.6, 0.400_001], [0.0, 1.5]] {
            assert!(cell_of(outside, 3).0 < 64, "{outside:?}");
        }
    }
}
