//! Growing sites by a spacing field: nested Poisson-disk levels, each only where it is wanted.

use rayon::prelude::*;

use super::{Plot, SiteArrays, SiteId, SiteParams, Sites};
use crate::geometry::morton;
use crate::scatter::Candidate;
use crate::scatter::growth::Growth;
use crate::scatter::surface::Surface;
use crate::scatter::thin::Darts;

/// Levels never go further than this: 2^-20 of the first spacing.
const DEEPEST: u32 = 20;

/// Points of a piece that decide which sites its area goes to.
const AREA_POINTS: u32 = 96;

/// A candidate that became a site.
struct Kept {
    candidate: Candidate,
    level: u8,
    spacing: f32,
}

impl Sites {
    /// Grows sites over the surface. `wanted` gives the spacing wanted around a point, or None where nothing reflects;
    /// it is met within a factor √2. Also says how each piece of surface was served.
    ///
    /// The result depends on the surface, the field and the parameters alone. Cost: about 1 µs a site and level.
    pub fn scatter(
        surface: &Surface<'_>,
        params: &SiteParams,
        wanted: impl Fn(&Candidate) -> Option<f32> + Sync,
    ) -> (Self, Vec<Plot>, Samples) {
        let first = (0.76 * surface.area() / params.coarsest as f64).sqrt() as f32;
        let mut growth = Growth::new(surface, first, params.seed);
        let mut kept: Vec<Kept> = Vec::new();
        let mut plots = Vec::new();
        while !growth.active.is_empty() {
            let candidates = growth.candidates(params.density);
            let wants = wants(&growth, &candidates, &wanted);
            throw(&growth, &candidates, &wants, &mut kept);
            let finer = |w: &Option<f32>| {
                growth.level < DEEPEST && w.is_some_and(|w| w * std::f32::consts::SQRT_2 < growth.spacing)
            };
            let keep: Vec<bool> = wants.iter().map(finer).collect();
            for (k, piece) in growth.active.iter().enumerate().filter(|(k, _)| !keep[*k]) {
                plots.push(Plot { piece: *piece, spacing: wants[k].map_or(0.0, |_| growth.spacing) });
            }
            growth.descend(&keep);
        }
        plots.par_sort_unstable_by_key(|plot| plot.piece.place());
        let plot_of = |k: &Kept| {
            let along = k.candidate.along();
            plots[plots.partition_point(|plot| plot.piece.place() <= along).max(1) - 1].spacing
        };
        let spacings: Vec<f32> =
            kept.par_iter().map(|k| Some(plot_of(k)).filter(|&s| s > 0.0).unwrap_or(k.spacing)).collect();
        let mut sites = Self::from_arrays(in_order(&kept, &spacings));
        let samples = share(&mut sites, surface, &plots, params.seed);
        (sites, plots, samples)
    }
}

/// Points of a piece that are asked for the spacing they want.
const ASKED: usize = 5;

/// Per active piece the smallest spacing wanted at some of its candidates.
fn wants(
    growth: &Growth<'_>,
    candidates: &[Candidate],
    wanted: &(impl Fn(&Candidate) -> Option<f32> + Sync),
) -> Vec<Option<f32>> {
    (0..growth.active.len())
        .into_par_iter()
        .with_min_len(64)
        .map(|piece| {
            let first = candidates.partition_point(|c| (c.piece as usize) < piece);
            let own = candidates[first..].partition_point(|c| c.piece as usize == piece);
            let step = own.div_ceil(ASKED).max(1);
            let asked = candidates[first..first + own].iter().step_by(step);
            asked.filter_map(wanted).min_by(f32::total_cmp)
        })
        .collect()
}

fn throw(growth: &Growth<'_>, candidates: &[Candidate], wants: &[Option<f32>], kept: &mut Vec<Kept>) {
    let mut darts = Darts::new(growth.spacing, 2 * kept.len());
    kept.iter().for_each(|k| darts.keep(k.candidate.point));
    for candidate in candidates.iter().filter(|c| wants[c.piece as usize].is_some()) {
        if !darts.conflicts(&candidate.point) {
            darts.keep(candidate.point);
            kept.push(Kept { candidate: *candidate, level: growth.level as u8, spacing: growth.spacing });
        }
    }
}

/// The arrays in Morton order, fronts before backs.
fn in_order(kept: &[Kept], spacings: &[f32]) -> SiteArrays {
    let smallest = spacings.iter().copied().fold(f32::INFINITY, f32::min).max(1e-6);
    let corner = kept
        .iter()
        .map(|k| k.candidate.point.position)
        .fold(glam::Vec3::splat(f32::INFINITY), glam::Vec3::min);
    let mut order: Vec<(bool, u64, u32)> = kept
        .iter()
        .enumerate()
        .map(|(i, k)| {
            (k.candidate.back, morton::code(k.candidate.point.position, corner, smallest), i as u32)
        })
        .collect();
    order.par_sort_unstable();
    let mut arrays = SiteArrays::default();
    for (_, _, i) in order {
        let Kept { candidate, level, .. } = &kept[i as usize];
        arrays.positions.push(candidate.point.position);
        arrays.normals.push(candidate.point.normal);
        arrays.triangles.push(candidate.triangle);
        arrays.barycentrics.push(candidate.barycentric);
        arrays.levels.push(*level);
        arrays.spacings.push(spacings[i as usize]);
    }
    arrays
}

/// Points of the surface by the site that stands for them.
#[derive(Debug, Clone, Default)]
pub struct Samples {
    /// Sites + 1 offsets.
    offsets: Vec<u32>,
    /// The points, and the area that each stands for.
    points: Vec<(Candidate, f32)>,
}

impl Samples {
    /// The points that a site stands for, each with its area; few, sometimes none.
    pub fn of(&self, site: usize) -> &[(Candidate, f32)] {
        &self.points[self.offsets[site] as usize..self.offsets[site + 1] as usize]
    }
}

/// Every piece's area goes to the sites nearest to a few of its points; says which points.
fn share(sites: &mut Sites, surface: &Surface<'_>, plots: &[Plot], seed: u64) -> Samples {
    let served: Vec<(f32, Vec<(SiteId, Candidate)>)> = plots
        .par_iter()
        .filter(|plot| plot.spacing > 0.0)
        .map(|plot| {
            let point = |i| surface.candidate((0, &plot.piece), (i, AREA_POINTS), seed ^ 0xa2ea);
            let serve = |c: Candidate| sites.nearest(&c.point).map(|site| (site, c));
            (plot.piece.area, (0..AREA_POINTS).map(point).filter_map(serve).collect())
        })
        .collect();
    let mut sums = vec![0.0f64; sites.len()];
    let mut offsets = vec![0u32; sites.len() + 1];
    for (area, points) in &served {
        for (site, _) in points {
            sums[site.index()] += f64::from(*area) / points.len() as f64;
            offsets[site.index() + 1] += 1;
        }
    }
    (0..sites.len()).for_each(|i| offsets[i + 1] += offsets[i]);
    let mut next = offsets.clone();
    let total = *offsets.last().unwrap_or(&0) as usize;
    let mut points: Vec<Option<(Candidate, f32)>> = vec![None; total];
    for (area, members) in served {
        let part = area / members.len() as f32;
        for (site, candidate) in members {
            points[next[site.index()] as usize] = Some((candidate, part));
            next[site.index()] += 1;
        }
    }
    sites.areas = sums.into_iter().map(|a| a as f32).collect();
    Samples { offsets, points: points.into_iter().flatten().collect() }
}
