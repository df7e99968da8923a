//! Candidates for sites: stratified by area over the triangles, evenly spread within each, grouped by block of cells.
//!
//! This work is based on: Heitz, "A Low-Distortion Map Between Triangle and Square" (2019), and Roberts' R2 sequence
//! (2018). A candidate is eight bytes (triangle, number within it); its place is computed again wherever it is needed.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::grid::{Frame, KeyMap, pack};
use crate::geometry::{hash, triangle};
use crate::scene::Scene;

/// Candidates a job makes at the most: 64 Ki of eight bytes stay in the second-level cache.
const JOB_CANDIDATES: u64 = 1 << 16;

/// Which triangles belong to two-sided meshes.
pub(super) struct Sides {
    /// Ends of runs of triangles of equal sidedness, ascending.
    runs: Vec<(u32, bool)>,
}

impl Sides {
    /// Collects the runs.
    pub(super) fn new(scene: &Scene) -> Self {
        let mut runs: Vec<(u32, bool)> = vec![];
        for mesh in &scene.meshes {
            match runs.last_mut() {
                Some(last) if last.1 == mesh.two_sided => last.0 = mesh.triangles.end,
                _ => runs.push((mesh.triangles.end, mesh.two_sided)),
            }
        }
        Self { runs }
    }

    /// Whether there is a two-sided mesh.
    pub(super) fn any(&self) -> bool {
        self.runs.iter().any(|run| run.1)
    }

    /// Whether a triangle is two-sided.
    pub(super) fn two_sided(&self, triangle: u32) -> bool {
        if self.runs.len() == 1 {
            return self.runs[0].1;
        }
        self.runs.get(self.runs.partition_point(|run| run.0 <= triangle)).is_some_and(|run| run.1)
    }
}

/// Area in squared local units; 0 for triangles too small to have a normal in f32, which carry no sites.
///
/// The cross product is taken in f64: in f32 a sliver of aspect 10⁴ would be off by 10⁻³.
pub(super) fn usable_area(scene: &Scene, id: u32) -> f64 {
    let corners = scene.corners(id);
    let [a, b, c] = corners.map(Vec3::as_dvec3);
    let doubled: DVec3 = (b - a).cross(c - a);
    // Squares of 1e-18 are still normal numbers of f32.
    if triangle::area_vector(corners).length_squared() > 1e-36 { 0.5 * doubled.length() } else { 0.0 }
}

/// The cumulative area at the start of every run of `chunk` triangles.
pub(super) struct AreaTable {
    chunk: usize,
    starts: Vec<f64>,
    /// Triangles without usable area.
    pub(super) degenerate_count: usize,
}

impl AreaTable {
    /// Sums the areas, in f64 and in an order that does not depend on threads.
    pub(super) fn new(scene: &Scene, wanted: usize) -> Self {
        let count = scene.triangles.len();
        let chunk = (count as u64 * JOB_CANDIDATES / wanted.max(1) as u64).clamp(1 << 10, 1 << 16) as usize;
        let sums: Vec<(f64, usize)> = (0..count.div_ceil(chunk))
            .into_par_iter()
            .map(|c| {
                let ids = (c * chunk) as u32..((c + 1) * chunk).min(count) as u32;
                ids.map(|id| usable_area(scene, id))
                    .fold((0.0, 0), |(sum, flat), area| (sum + area, flat + usize::from(area == 0.0)))
            })
            .collect();
        let mut starts = vec![0.0];
        let mut total = 0.0;
        for (sum, _) in &sums {
            total += sum;
            starts.push(total);
        }
        Self { chunk, starts, degenerate_count: sums.iter().map(|s| s.1).sum() }
    }

    /// Area of all triangles.
    pub(super) fn total(&self) -> f64 {
        self.starts.last().copied().unwrap_or(0.0)
    }
}

/// Knows every candidate by its triangle and number.
pub(super) struct Candidates<'a> {
    scene: &'a Scene,
    areas: &'a AreaTable,
    seed: u64,
    /// Candidates per unit of area.
    density: f64,
}

/// A candidate: its triangle and its number within it.
pub(super) type Candidate = [u32; 2];

/// Part of a chunk of triangles: its candidates from `skip` on.
struct Job {
    chunk: usize,
    skip: u64,
    take: u64,
}

/// A job's candidates, grouped by block.
pub(super) struct Batch {
    /// Block after block.
    pub(super) candidates: Vec<Candidate>,
    /// Packed block coordinates and the end of its candidates.
    pub(super) runs: Vec<(u64, u32)>,
}

impl<'a> Candidates<'a> {
    /// About `count` candidates over the scene.
    pub(super) fn new(scene: &'a Scene, areas: &'a AreaTable, seed: u64, count: usize) -> Self {
        Self { scene, areas, seed, density: count as f64 / areas.total() }
    }

    /// How many stratified samples lie before cumulative area `area`: one in each stratum, at a hashed place.
    fn before(&self, area: f64) -> u64 {
        let at = area * self.density;
        let stratum = at as u64;
        stratum + u64::from(f64::from(hash::unit(self.seed, stratum)) < at - stratum as f64)
    }

    fn jobs(&self) -> Vec<Job> {
        let mut jobs = vec![];
        for (chunk, ends) in self.areas.starts.windows(2).enumerate() {
            let count = self.before(ends[1]) - self.before(ends[0]);
            let parts = count.div_ceil(JOB_CANDIDATES);
            for part in 0..parts {
                let skip = count * part / parts;
                jobs.push(Job { chunk, skip, take: count * (part + 1) / parts - skip });
            }
        }
        jobs
    }

    /// Makes all candidates, grouped by block of 2^`block_bits` cells.
    pub(super) fn batches(&self, frame: Frame, block_bits: u32) -> Vec<Batch> {
        self.jobs().par_iter().map(|job| self.batch(job, frame, block_bits)).collect()
    }

    fn batch(&self, job: &Job, frame: Frame, block_bits: u32) -> Batch {
        let mut made: Vec<(Candidate, u32)> = Vec::with_capacity(job.take as usize);
        let mut directory = KeyMap::with_capacity(256);
        let mut runs: Vec<(u64, u32)> = vec![];
        let mut last = (u64::MAX, 0u32);
        self.each(job, |candidate, place| {
            let key = pack(frame.cell(place).map(|c| c >> block_bits));
            if key != last.0 {
                last = (key, directory.find_or_insert(key, runs.len() as u32));
                if last.1 as usize == runs.len() {
                    runs.push((key, 0));
                }
            }
            runs[last.1 as usize].1 += 1;
            made.push((candidate, last.1));
        });
        // Counting sort by block.
        let mut next: Vec<u32> = Vec::with_capacity(runs.len());
        let mut end = 0;
        for run in &mut runs {
            next.push(end);
            end += run.1;
            run.1 = end;
        }
        let mut candidates = vec![[0; 2]; made.len()];
        for (candidate, block) in made {
            let at = &mut next[block as usize];
            candidates[*at as usize] = candidate;
            *at += 1;
        }
        Batch { candidates, runs }
    }

    /// Calls `make` with each of the job's candidates and its position.
    fn each(&self, job: &Job, mut make: impl FnMut(Candidate, Vec3)) {
        let start = self.areas.starts[job.chunk];
        let first = (job.chunk * self.areas.chunk) as u32;
        let end = (first as usize + self.areas.chunk).min(self.scene.triangles.len()) as u32;
        let (mut partial, mut done) = (0.0, self.before(start));
        let (low, high) = (done + job.skip, done + job.skip + job.take);
        for id in first..end {
            // The same sums as in the table, so that chunks meet without a gap.
            partial += usable_area(self.scene, id);
            let after = self.before(start + partial);
            if after > low && after > done {
                let shape = self.shape(id);
                for k in low.max(done)..high.min(after) {
                    let number = (k - done) as u32;
                    let (u, v) = shape.barycentric(number);
                    make([id, number], shape.point(u, v));
                }
            }
            done = after;
            if done >= high {
                return;
            }
        }
    }

    /// What a triangle's candidates have in common.
    pub(super) fn shape(&self, id: u32) -> Shape {
        let bits = hash::mix2(self.seed ^ 0x51_7e5e, u64::from(id));
        let [a, b, c] = self.scene.corners(id);
        Shape { corner: a, edges: [b - a, c - a], shift: [bits as u32, (bits >> 32) as u32] }
    }
}

/// A triangle with its own shift of the R2 sequence.
#[derive(Clone, Copy)]
pub(super) struct Shape {
    corner: Vec3,
    edges: [Vec3; 2],
    shift: [u32; 2],
}

impl Shape {
    /// Where candidate `number` lies: the R2 sequence in 32-bit fixed point, through Heitz' map.
    pub(super) fn barycentric(&self, number: u32) -> (f32, f32) {
        // 2³² × 0.754877666… and 2³² × 0.569840290…
        let x = number.wrapping_mul(3_242_174_889).wrapping_add(self.shift[0]);
        let y = number.wrapping_mul(2_447_445_414).wrapping_add(self.shift[1]);
        let unit = |bits: u32| (bits >> 8) as f32 * (1.0 / 16_777_216.0);
        triangle::uniform_barycentric([unit(x), unit(y)])
    }

    /// The point at barycentric (u, v).
    pub(super) fn point(&self, u: f32, v: f32) -> Vec3 {
        self.corner + self.edges[0] * u + self.edges[1] * v
    }

    /// Unit normal of the front.
    pub(super) fn normal(&self) -> Vec3 {
        self.edges[0].cross(self.edges[1]).normalize_or_zero()
    }
}
