//! The finest level: candidates, darts, and each site's share of the surface.

use std::sync::atomic::{AtomicU32, Ordering};

use glam::Vec3;
use rayon::prelude::*;

use super::candidates::{AreaTable, Batch, Candidate, Candidates, Sides};
use super::darts::{self, BLOCK_BITS, BlockGrid, Blocks, Dart};
use super::grid::{Frame, unpack};
use super::{SiteArrays, SiteParams, SiteReport};
use crate::geometry::morton;
use crate::scene::Scene;

/// Sites per squared spacing that a saturated packing comes near: spacing = √(0.76 A / n).
const PACKING: f64 = 0.76;

/// Few wanted sites still deserve enough candidates to cover the surface and to share out its area.
const LEAST_CANDIDATES: usize = 1024;

/// Triangle and barycentric (u, v).
type Place = (u32, [f32; 2]);

/// All candidates by block: each block has a run in some of the batches.
struct Gathered {
    blocks: Blocks,
    batches: Vec<Batch>,
    /// (batch, start, end) for block after block.
    runs: Vec<[u32; 3]>,
    /// First run of each block, and the end.
    starts: Vec<u32>,
}

impl Gathered {
    fn new(batches: Vec<Batch>) -> Self {
        let mut runs: Vec<(u64, u64, [u32; 3])> = vec![];
        for (b, batch) in batches.iter().enumerate() {
            let mut start = 0;
            for &(key, end) in &batch.runs {
                runs.push((morton::encode(unpack(key)), key, [b as u32, start, end]));
                start = end;
            }
        }
        runs.par_sort_unstable_by_key(|run| (run.0, run.2[0]));
        let (mut keys, mut starts) = (vec![], vec![]);
        for (i, run) in runs.iter().enumerate() {
            if keys.last() != Some(&run.1) {
                keys.push(run.1);
                starts.push(i as u32);
            }
        }
        starts.push(runs.len() as u32);
        Self { blocks: Blocks::new(keys), batches, runs: runs.into_iter().map(|run| run.2).collect(), starts }
    }

    /// The candidates of a block, in a fixed order.
    fn of_block(&self, block: usize) -> impl Iterator<Item = Candidate> + '_ {
        let range = self.starts[block] as usize..self.starts[block + 1] as usize;
        self.runs[range].iter().flat_map(|&[batch, start, end]| {
            self.batches[batch as usize].candidates[start as usize..end as usize].iter().copied()
        })
    }
}

/// Turns candidates into darts.
fn fill_darts(
    gathered: &Gathered,
    candidates: &Candidates<'_>,
    sides: &Sides,
    block: usize,
    darts: &mut Vec<Dart<Place>>,
) {
    let mut last = None;
    for [triangle, number] in gathered.of_block(block) {
        let (shape, normal, two_sided) = match last {
            Some((id, known)) if id == triangle => known,
            _ => {
                let shape = candidates.shape(triangle);
                let fresh = (shape, shape.normal(), sides.two_sided(triangle));
                last = Some((triangle, fresh));
                fresh
            }
        };
        let (u, v) = shape.barycentric(number);
        darts.push(Dart { position: shape.point(u, v), normal, two_sided, payload: (triangle, [u, v]) });
    }
}

/// Scatters the sites of the finest level over the fronts, in Morton order; levels are not assigned yet.
pub(super) fn scatter_fronts(scene: &Scene, params: &SiteParams) -> (SiteArrays, SiteReport) {
    let wanted = params.count.max(1);
    let candidate_count =
        ((wanted as f64 * f64::from(params.candidates_per_site)) as usize).max(LEAST_CANDIDATES);
    let areas = AreaTable::new(scene, candidate_count);
    let mut report = SiteReport {
        wanted_count: params.count,
        front_count: 0,
        back_count: 0,
        candidate_count: 0,
        degenerate_count: areas.degenerate_count,
        front_area: areas.total(),
        level_counts: vec![],
        elapsed_seconds: 0.0,
    };
    let mut arrays = SiteArrays { spacing: 1.0, ratio: params.ratio, ..SiteArrays::default() };
    if areas.total() <= 0.0 {
        return (arrays, report);
    }
    let (low, high) = bounds(scene);
    // Cells are numbered with 21 bits an axis.
    arrays.spacing =
        ((PACKING * areas.total() / wanted as f64).sqrt() as f32).max((high - low).max_element() * 1e-6);
    arrays.corner = low;
    let frame = Frame::new(low, arrays.spacing);
    let candidates = Candidates::new(scene, &areas, params.seed, candidate_count);
    let gathered = Gathered::new(candidates.batches(frame, BLOCK_BITS));
    let sides = Sides::new(scene);
    let mut accepted = vec![vec![]; gathered.blocks.keys.len()];
    let fill = |block: usize, darts: &mut Vec<_>| fill_darts(&gathered, &candidates, &sides, block, darts);
    darts::throw(&gathered.blocks, arrays.spacing, &mut accepted, fill, |p| frame.cell(p));
    accepted.par_iter_mut().for_each(|darts| darts.sort_by_cached_key(|dart| frame.code(dart.position)));
    let counts = share(&gathered.blocks, frame, arrays.spacing, &accepted, fill);
    report.candidate_count = gathered.batches.iter().map(|b| b.candidates.len()).sum();
    report.front_count = counts.len();
    let share = areas.total() / report.candidate_count as f64;
    arrays.areas = counts.iter().map(|&count| (f64::from(count) * share) as f32).collect();
    unzip(&accepted, &mut arrays);
    (arrays, report)
}

/// How many candidates are nearest to each site, block after block. No site is without: it was a candidate itself.
fn share(
    blocks: &Blocks,
    frame: Frame,
    spacing: f32,
    accepted: &[Vec<Dart<Place>>],
    fill: impl Fn(usize, &mut Vec<Dart<Place>>) + Sync,
) -> Vec<u32> {
    let mut firsts = Vec::with_capacity(accepted.len());
    let mut total = 0usize;
    for darts in accepted {
        firsts.push(total);
        total += darts.len();
    }
    let counts: Vec<AtomicU32> = (0..total).map(|_| AtomicU32::new(0)).collect();
    (0..accepted.len()).into_par_iter().for_each_init(
        || (BlockGrid::new(), vec![], vec![], vec![]),
        |(grid, darts, ids, tally), block| {
            grid.start(blocks.keys[block]);
            ids.clear();
            for near in std::iter::once(block).chain(blocks.around(block)) {
                for (i, dart) in accepted[near].iter().enumerate() {
                    if grid.insert(frame.cell(dart.position), dart) {
                        ids.push(firsts[near] + i);
                    }
                }
            }
            tally.clear();
            tally.resize(ids.len(), 0u32);
            darts.clear();
            fill(block, darts);
            for dart in darts.iter() {
                if let Some(index) = grid.nearest(frame.cell(dart.position), dart, spacing * spacing) {
                    tally[index as usize] += 1;
                }
            }
            for (&id, &count) in ids.iter().zip(tally.iter()).filter(|pair| *pair.1 > 0) {
                counts[id].fetch_add(count, Ordering::Relaxed);
            }
        },
    );
    counts.into_iter().map(AtomicU32::into_inner).collect()
}

fn unzip(accepted: &[Vec<Dart<Place>>], arrays: &mut SiteArrays) {
    let count = arrays.areas.len();
    arrays.positions.reserve_exact(count);
    arrays.normals.reserve_exact(count);
    arrays.triangles.reserve_exact(count);
    arrays.barycentrics.reserve_exact(count);
    for dart in accepted.iter().flatten() {
        arrays.positions.push(dart.position);
        arrays.normals.push(dart.normal);
        arrays.triangles.push(dart.payload.0);
        arrays.barycentrics.push(dart.payload.1);
    }
}

/// The box of all vertices that triangles use.
fn bounds(scene: &Scene) -> (Vec3, Vec3) {
    scene
        .triangles
        .par_iter()
        .map(|corners| corners.map(|v| scene.vertices[v as usize]))
        .map(|[a, b, c]| (a.min(b).min(c), a.max(b).max(c)))
        .reduce(
            || (Vec3::splat(f32::INFINITY), Vec3::splat(f32::NEG_INFINITY)),
            |x, y| (x.0.min(y.0), x.1.max(y.1)),
        )
}
