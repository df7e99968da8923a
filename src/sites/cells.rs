//! Which site stands for the bit of surface that a ray met: a table over small cells of every triangle.
//!
//! A cell's site is the one that minimises d² + 4h²(1 − n·n′) for the cell's centre; when that site is unclean it must
//! also be visible from there, or the next nearest is taken. Cells tile a triangle through Heitz' area-preserving map to
//! the square (2019), so that none is wasted; triangles smaller than a cell have one. The table is filled at first
//! touch; as a cell's site depends on the cell alone, it does not matter who fills it.

use std::sync::atomic::{AtomicU32, Ordering};

use rayon::prelude::*;

use super::candidates::Sides;
use super::neighbours::{Neighbours, mutually_visible};
use super::{SiteId, Sites, grid};
use crate::geometry::{SurfacePoint, triangle};
use crate::rays::{Bvh, Hit};
use crate::scene::Scene;

/// Edge of a cell in spacings. Larger cells blur the borders between sites, smaller ones cost memory by the square.
const CELL_SPACINGS: f32 = 0.6;

/// Nearest sites tried for visibility before a cell is left without one.
const TRIES: usize = 8;

/// Triangles that share a record.
const GROUP: usize = 64;

const UNFILLED: u32 = 0;
const NO_SITE: u32 = u32::MAX;
/// Marks a group whose triangles have one cell each.
const PLAIN: u32 = u32::MAX;

/// Where the cells of [`GROUP`] triangles are.
#[derive(Debug, Clone, Copy)]
struct Group {
    /// First cell, when each triangle has one: fronts, then backs.
    base: u32,
    /// First of the group's [`Tiling`]s, or [`PLAIN`].
    tilings: u32,
}

/// The cells of one triangle: rows of columns, fronts, then backs.
#[derive(Debug, Clone, Copy)]
struct Tiling {
    first: u32,
    columns: u16,
    rows: u16,
}

impl Tiling {
    fn len(self) -> usize {
        usize::from(self.columns) * usize::from(self.rows)
    }

    /// The cell at barycentric (u, v).
    fn cell(self, u: f32, v: f32) -> usize {
        // The inverse of Heitz' map.
        let (x, y) = if v > u { (2.0 * u, u + v) } else { (u + v, 2.0 * v) };
        // Conversions saturate: hits a little outside count to the border.
        let column = ((x * f32::from(self.columns)) as usize).min(usize::from(self.columns) - 1);
        let row = ((y * f32::from(self.rows)) as usize).min(usize::from(self.rows) - 1);
        row * usize::from(self.columns) + column
    }

    /// Barycentric (u, v) of a cell's centre.
    fn centre(self, cell: usize) -> (f32, f32) {
        if self.len() == 1 {
            return (1.0 / 3.0, 1.0 / 3.0);
        }
        let (row, column) = (cell / usize::from(self.columns), cell % usize::from(self.columns));
        let x = (column as f32 + 0.5) / f32::from(self.columns);
        let y = (row as f32 + 0.5) / f32::from(self.rows);
        triangle::uniform_barycentric([x, y])
    }
}

/// The table from surface to sites.
pub struct Cells {
    sides: Sides,
    groups: Vec<Group>,
    tilings: Vec<Tiling>,
    /// Site + 1, [`UNFILLED`] or [`NO_SITE`].
    table: Vec<AtomicU32>,
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

impl Cells {
    /// Lays the cells out; none is filled yet. Memory: 4 bytes a cell, about 7 cells a site or one a triangle, doubled for
    /// two-sided meshes.
    pub fn new(scene: &Scene, sites: &Sites) -> Self {
        let sides = Sides::new(scene);
        let edge = CELL_SPACINGS * sites.spacing;
        let plans: Vec<(usize, Vec<Tiling>)> = (0..scene.triangles.len().div_ceil(GROUP))
            .into_par_iter()
            .map(|group| plan(scene, &sides, edge, group))
            .collect();
        let (mut groups, mut tilings) = (Vec::with_capacity(plans.len()), vec![]);
        let mut total = 0usize;
        for (len, own) in plans {
            let base = total as u32;
            groups.push(Group { base, tilings: if own.is_empty() { PLAIN } else { tilings.len() as u32 } });
            tilings.extend(own.into_iter().map(|t| Tiling { first: base + t.first, ..t }));
            total += len;
        }
        assert!(total < NO_SITE as usize, "{total} surface cells do not fit 32 bits");
        let table = (0..total).into_par_iter().map(|_| AtomicU32::new(UNFILLED)).collect();
        Self { sides, groups, tilings, table }
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.table.len()
    }

    /// Whether there is no cell, as in a scene without triangles.
    pub fn is_empty(&self) -> bool {
        self.table.is_empty()
    }

    /// The site that stands for the surface at a hit, seen from the front or the back. None when no site is near and
    /// visible, and for the backs of one-sided meshes.
    ///
    /// Two reads when the cell is filled; about 200 ns more at its first touch, and up to eight rays next to walls.
    #[inline]
    pub fn site(&self, hit: &Hit, back: bool, ground: Ground<'_>) -> Option<SiteId> {
        if back && !self.sides.two_sided(hit.triangle) {
            return None;
        }
        let (index, cell) = self.locate(hit.triangle, hit.u, hit.v, back);
        match self.table[index].load(Ordering::Relaxed) {
            UNFILLED => self.fill((hit.triangle, cell, back), index, ground),
            NO_SITE => None,
            stored => Some(SiteId(stored - 1)),
        }
    }

    /// Index in the table, and number of the cell within its triangle.
    #[inline]
    fn locate(&self, id: u32, u: f32, v: f32, back: bool) -> (usize, usize) {
        let within = id as usize % GROUP;
        let group = self.groups[id as usize / GROUP];
        if group.tilings == PLAIN {
            return (group.base as usize + within + usize::from(back) * GROUP, 0);
        }
        let tiling = self.tilings[group.tilings as usize + within];
        let cell = tiling.cell(u, v);
        (tiling.first as usize + usize::from(back) * tiling.len() + cell, cell)
    }

    fn tiling(&self, id: u32) -> Tiling {
        match self.groups[id as usize / GROUP].tilings {
            PLAIN => Tiling { first: 0, columns: 1, rows: 1 },
            first => self.tilings[first as usize + id as usize % GROUP],
        }
    }

    /// The centre of a cell, on the side asked for.
    fn centre(&self, scene: &Scene, (id, cell, back): (u32, usize, bool)) -> SurfacePoint {
        let corners = scene.corners(id);
        let (u, v) = self.tiling(id).centre(cell);
        let front = triangle::normal(corners);
        SurfacePoint { position: triangle::point(corners, u, v), normal: if back { -front } else { front } }
    }

    #[cold]
    fn fill(&self, at: (u32, usize, bool), index: usize, ground: Ground<'_>) -> Option<SiteId> {
        let site = ground.represent(self.centre(ground.scene, at));
        self.table[index].store(site.map_or(NO_SITE, |s| s.0 + 1), Ordering::Relaxed);
        site
    }

    /// Fills every cell, in parallel.
    pub fn fill_all(&self, ground: Ground<'_>) {
        (0..ground.scene.triangles.len() as u32).into_par_iter().with_min_len(GROUP).for_each(|id| {
            let tiling = self.tiling(id);
            for back in [false, true].into_iter().take(1 + usize::from(self.sides.two_sided(id))) {
                for cell in 0..tiling.len() {
                    let (u, v) = tiling.centre(cell);
                    let (index, cell) = self.locate(id, u, v, back);
                    if self.table[index].load(Ordering::Relaxed) == UNFILLED {
                        self.fill((id, cell, back), index, ground);
                    }
                }
            }
        });
    }
}

impl Ground<'_> {
    /// The site that stands for any surface point: the nearest, or the nearest visible one when that is unclean.
    pub fn represent(&self, point: SurfacePoint) -> Option<SiteId> {
        let site = self.sites.nearest(point)?;
        if self.graph.unclean(site) { self.nearest_visible(point) } else { Some(site) }
    }

    fn nearest_visible(&self, point: SurfacePoint) -> Option<SiteId> {
        let mut near: Vec<(f32, SiteId)> = vec![];
        self.sites.visit_near(point.position, 2.0 * self.sites.spacing, |site| {
            let d2 = self.sites.positions[site.index()].distance_squared(point.position);
            near.extend(grid::mismatch(self.sites, point, site, d2).map(|value| (value, site)));
        });
        near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        near.truncate(TRIES);
        near.into_iter().map(|n| n.1).find(|&site| mutually_visible(point, self.sites.point(site), self.bvh))
    }
}

/// The number of cells of a group, and its tilings relative to its first cell (none when all triangles have one cell).
fn plan(scene: &Scene, sides: &Sides, edge: f32, group: usize) -> (usize, Vec<Tiling>) {
    let ids = (group * GROUP) as u32..((group + 1) * GROUP).min(scene.triangles.len()) as u32;
    let mut end = 0usize;
    let mut any_two_sided = false;
    let tilings: Vec<Tiling> = ids
        .map(|id| {
            let tiling = Tiling { first: end as u32, ..tile(scene, id, edge) };
            let two_sided = sides.two_sided(id);
            any_two_sided |= two_sided;
            end += tiling.len() * (1 + usize::from(two_sided));
            tiling
        })
        .collect();
    if tilings.iter().all(|t| t.len() == 1) {
        return (GROUP * (1 + usize::from(any_two_sided)), vec![]);
    }
    (end, tilings)
}

/// Rows and columns so that no cell is longer than `edge`: the map halves the third edge.
fn tile(scene: &Scene, id: u32, edge: f32) -> Tiling {
    let [a, b, c] = scene.corners(id);
    let third = 0.5 * b.distance(c);
    let steps = |length: f32| ((length.max(third) / edge).ceil() as u16).max(1);
    Tiling { first: 0, columns: steps(a.distance(b)), rows: steps(a.distance(c)) }
}
