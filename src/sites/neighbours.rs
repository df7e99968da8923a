//! Which sites are near and see each other, and which sites have something in between.

use glam::Vec3;
use rayon::prelude::*;

use super::{SiteId, Sites};
use crate::geometry::{LIFT, SurfacePoint};
use crate::rays::{Bvh, Ray};

/// Pairs closer than this many spacings are tried: in a saturated packing sites that share a border lie within two.
///
/// At 1.7 sites missed the wall between them, counted as clean and spoke for the floor behind it.
pub const LINK_SPACINGS: f32 = 2.1;

/// Pairs whose normals' cosine is below this are no neighbours.
pub const LINK_COSINE: f32 = 0.3;

/// Both ends of a visibility ray are lifted by this share of their distance, so that bumps below the spacing do not
/// count as walls; larger values look over real steps.
pub const LINK_LIFT: f32 = 0.03;

/// Sites a task links: enough to hide the cost of a task, few enough to balance.
const TASK_SITES: usize = 1024;

/// Site indices.
type Pairs = Vec<[u32; 2]>;

/// The graph of sites that are near and see each other, in compressed rows.
#[derive(Debug, Clone, PartialEq)]
pub struct Neighbours {
    starts: Vec<u32>,
    targets: Vec<u32>,
    unclean: Vec<bool>,
}

/// What linking cost.
#[derive(Debug, Clone, PartialEq)]
pub struct NeighbourReport {
    /// Visibility rays: one for each near pair.
    pub ray_count: usize,
    /// Pairs that see each other.
    pub edge_count: usize,
    /// Sites with at least one blocked pair.
    pub unclean_count: usize,
    /// Wall time.
    pub elapsed_seconds: f64,
}

/// Whether two surface points see each other, both lifted along their own normals by a share of their distance, at most
/// `limit`: small bumps between them do not count as walls, sheets that lie close to each other do. Where a lift would go
/// through a surface, none is made.
///
/// Points of the full surface may lie below its proxy: those are lifted above it first.
pub fn mutually_visible(a: SurfacePoint, b: SurfacePoint, limit: f32, bvh: &Bvh) -> bool {
    let ends = |lift: f32| [a.position + a.normal * lift, b.position + b.normal * lift];
    // Ends that coincide but for rounding have nothing between them.
    let clear = |[from, to]: [Vec3; 2]| {
        from.distance_squared(to) <= LIFT * LIFT || !bvh.occluded(&Ray::between(from, to))
    };
    let (distance, blur) = (a.position.distance(b.position), bvh.blur());
    let lift = (LINK_LIFT * distance).min(limit).max(LIFT);
    if blur > 0.0 {
        return distance <= 2.0 * blur || clear(ends(lift.max(blur)));
    }
    let (low, high) = (ends(LIFT), ends(lift));
    clear(high) && (lift <= LIFT || [0, 1].iter().all(|&k| clear([low[k], high[k]])) || clear(low))
}

impl Neighbours {
    /// Links all pairs within [`LINK_SPACINGS`] spacings and [`LINK_COSINE`] that see each other.
    ///
    /// Cost: about 2.4 rays a site. The result does not depend on the number of threads.
    pub fn link(sites: &Sites, bvh: &Bvh) -> (Self, NeighbourReport) {
        let started = std::time::Instant::now();
        let tasks: Vec<(Pairs, Pairs)> = (0..sites.len().div_ceil(TASK_SITES))
            .into_par_iter()
            .map(|task| {
                let (mut seen, mut blocked) = (vec![], vec![]);
                let mut near = vec![];
                for site in task * TASK_SITES..((task + 1) * TASK_SITES).min(sites.len()) {
                    later_pairs(sites, site as u32, &mut near);
                    for &other in &near {
                        let ends = [SiteId(site as u32), SiteId(other)].map(|s| sites.point(s));
                        let open = mutually_visible(ends[0], ends[1], f32::INFINITY, bvh);
                        if open { &mut seen } else { &mut blocked }.push([site as u32, other]);
                    }
                }
                (seen, blocked)
            })
            .collect();
        let mut unclean = vec![false; sites.len()];
        for end in tasks.iter().flat_map(|task| task.1.iter().flatten()) {
            unclean[*end as usize] = true;
        }
        let blocked_count: usize = tasks.iter().map(|task| task.1.len()).sum();
        let edges = || tasks.iter().flat_map(|task| task.0.iter().copied());
        let (starts, targets) = rows(sites.len(), edges);
        let report = NeighbourReport {
            ray_count: targets.len() / 2 + blocked_count,
            edge_count: targets.len() / 2,
            unclean_count: unclean.iter().filter(|&&u| u).count(),
            elapsed_seconds: started.elapsed().as_secs_f64(),
        };
        (Self { starts, targets, unclean }, report)
    }

    /// From arrays that [`Neighbours::to_arrays`] gave.
    pub fn from_arrays(starts: Vec<u32>, targets: Vec<u32>, unclean: &[u8]) -> Self {
        Self { starts, targets, unclean: unclean.iter().map(|&u| u != 0).collect() }
    }

    /// Row starts, targets, and 1 for each unclean site; for storage.
    pub fn to_arrays(&self) -> (&[u32], &[u32], Vec<u8>) {
        (&self.starts, &self.targets, self.unclean.iter().map(|&u| u8::from(u)).collect())
    }

    /// The neighbours of a site, ascending.
    pub fn of(&self, site: SiteId) -> &[u32] {
        &self.targets[self.starts[site.index()] as usize..self.starts[site.index() + 1] as usize]
    }

    /// Whether something stands between the site and one near it.
    pub fn unclean(&self, site: SiteId) -> bool {
        self.unclean[site.index()]
    }
}

/// The sites that are near enough and turned alike, ascending; of a pair that would find each other, only the later.
fn later_pairs(sites: &Sites, site: u32, near: &mut Vec<u32>) {
    let point = sites.point(SiteId(site));
    let own = LINK_SPACINGS * sites.spacings[site as usize];
    near.clear();
    sites.visit_near(point.position, |other| {
        let there = sites.point(other);
        let square = there.position.distance_squared(point.position);
        let reach = LINK_SPACINGS * sites.spacings[other.index()];
        let mutual = square < own * own;
        if square < reach * reach
            && (other.0 > site || (other.0 != site && !mutual))
            && there.normal.dot(point.normal) > LINK_COSINE
        {
            near.push(other.0);
        }
    });
    near.sort_unstable();
}

/// Compressed rows of a symmetric graph from its edges, each given once; rows come out sorted.
fn rows<I: Iterator<Item = [u32; 2]>>(count: usize, edges: impl Fn() -> I) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0u32; count + 1];
    for end in edges().flatten() {
        starts[end as usize + 1] += 1;
    }
    for i in 0..count {
        starts[i + 1] += starts[i];
    }
    let mut next = starts.clone();
    let mut targets = vec![0; starts[count] as usize];
    for [low, high] in edges() {
        for (row, target) in [(low, high), (high, low)] {
            let at = &mut next[row as usize];
            targets[*at as usize] = target;
            *at += 1;
        }
    }
    for row in starts.windows(2) {
        targets[row[0] as usize..row[1] as usize].sort_unstable();
    }
    (starts, targets)
}
