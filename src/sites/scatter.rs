//! Growing sites by a spacing field: nested Poisson-disk levels, each only where it is wanted.

use glam::Vec3;
use rayon::prelude::*;

use super::{Plot, Samples, SiteArrays, SiteParams, Sites};
use crate::geometry::morton;
use crate::scatter::Candidate;
use crate::scatter::growth::Growth;
use crate::scatter::packing::Packing;
use crate::scatter::surface::{Piece, Surface};

/// Levels never go further than this: 2^-20 of the first spacing.
const DEEPEST: u32 = 20;

/// Points of a piece that are asked for the spacing they want.
const ASKED: u32 = 5;

/// Points that are heard besides a piece's own count from this share of the spacing on: they keep what is small from being
/// missed, but do not make whole pieces finer for every step of the grading.
const UNHEARD: f32 = 0.5;

/// Pieces that go on get this share of the candidates: the next level fills their gaps.
const OPEN_SHARE: f32 = 0.5;

/// A candidate that became a site.
#[derive(Clone, Copy)]
struct Kept {
    candidate: Candidate,
    level: u8,
    /// The level's spacing, or the last one's where its piece went on.
    spacing: f32,
    /// Whether its piece went on.
    open: bool,
}

/// What became of an active piece.
#[derive(Clone, Copy, PartialEq)]
enum Fate {
    /// Nothing reflects there.
    Dead,
    /// Its sites are dense enough.
    Done,
    /// It wants more.
    Finer,
}

impl Sites {
    /// Grows sites over the surface ([`Sites::grow`]) and gives each its share of it ([`Sites::settle`]).
    pub fn scatter(
        surface: &Surface<'_>,
        params: &SiteParams,
        heard: &[Candidate],
        wanted: impl Fn(&Candidate) -> Option<f32> + Sync,
    ) -> (Self, Vec<Plot>, Samples) {
        let (arrays, plots) = Self::grow(surface, params, heard, wanted);
        let (sites, samples) = Self::settle(arrays, surface, &plots, params.seed);
        (sites, plots, samples)
    }

    /// Sites that have grown, with look-up and areas, and the points of the surface that each stands for.
    pub fn settle(arrays: SiteArrays, surface: &Surface<'_>, plots: &[Plot], seed: u64) -> (Self, Samples) {
        let mut sites = Self::from_arrays(arrays);
        let samples = Samples::share(&mut sites, surface, plots, seed);
        (sites, samples)
    }

    /// Grows sites over the surface; they have no areas yet. `wanted` gives the spacing wanted around a point, or None where nothing reflects;
    /// it is met within a factor √2. Also says how each piece of surface was served.
    ///
    /// A piece asks at some five of its points, and at those of `heard` that lie on it: five points of a wide piece miss what
    /// is small. The result depends on the surface, the field and the parameters alone. Cost: about 2.5 µs of one core a site,
    /// and at most five calls of `wanted` a piece of surface and level.
    pub fn grow(
        surface: &Surface<'_>,
        params: &SiteParams,
        heard: &[Candidate],
        wanted: impl Fn(&Candidate) -> Option<f32> + Sync,
    ) -> (SiteArrays, Vec<Plot>) {
        let heard = Heard::new(heard);
        let first = (0.76 * surface.area() / params.coarsest as f64).sqrt() as f32;
        let mut growth = Growth::new(surface, params.aligned(first), params.seed);
        let mut packing = Packing::default();
        let mut kept: Vec<Kept> = Vec::new();
        let mut plots = Vec::new();
        while !growth.active.is_empty() {
            let fates = fates(&growth, (params.density, &heard), &wanted);
            let density = |fate: &Fate| match fate {
                Fate::Dead => 0.0,
                Fate::Done => params.density,
                Fate::Finer => params.density * OPEN_SHARE,
            };
            let densities: Vec<f32> = fates.iter().map(density).collect();
            let (level, spacing) = (growth.level as u8, growth.spacing);
            kept.extend(packing.throw(&growth, &densities).into_iter().map(|candidate| {
                let open = fates[candidate.piece as usize] == Fate::Finer;
                Kept { candidate, level, spacing, open }
            }));
            for (piece, fate) in growth.active.iter().zip(&fates).filter(|(_, fate)| **fate != Fate::Finer) {
                plots.push(Plot { piece: *piece, spacing: if *fate == Fate::Done { spacing } else { 0.0 } });
            }
            let finer: Vec<bool> = fates.iter().map(|f| *f == Fate::Finer).collect();
            growth.descend(&finer);
        }
        plots.par_sort_unstable_by_key(|plot| plot.piece.place());
        settle(&mut kept, &plots);
        (in_order(&kept), plots)
    }
}

impl SiteParams {
    /// The power of two times the spacing to be met that is nearest to a first spacing.
    fn aligned(&self, first: f32) -> f32 {
        if self.met > 0.0 { self.met * (first / self.met).log2().round().exp2() } else { first }
    }
}

/// Where a point lies along the surface.
type Along = (bool, u32, u64);

/// Points that are asked besides a piece's own, in the surface's order.
struct Heard<'a>(Vec<(Along, &'a Candidate)>);

impl<'a> Heard<'a> {
    fn new(points: &'a [Candidate]) -> Self {
        let mut sorted: Vec<(Along, &Candidate)> = points.par_iter().map(|c| (c.along(), c)).collect();
        sorted.par_sort_by_key(|h| h.0);
        Self(sorted)
    }

    /// Those on a piece.
    fn on(&self, piece: &Piece) -> impl Iterator<Item = Candidate> + '_ {
        let from = self.0.partition_point(|h| h.0 < piece.place());
        let to = from + self.0[from..].partition_point(|h| h.0 < piece.end());
        self.0[from..to].iter().map(|h| *h.1)
    }
}

/// What becomes of each active piece, by the smallest spacing wanted at some of its candidates.
fn fates(
    growth: &Growth<'_>,
    (density, heard): (f32, &Heard<'_>),
    wanted: &(impl Fn(&Candidate) -> Option<f32> + Sync),
) -> Vec<Fate> {
    (0..growth.active.len())
        .into_par_iter()
        .with_min_len(64)
        .map(|piece| {
            let count = growth.count(piece, density);
            let own = (0..count).step_by(count.div_ceil(ASKED) as usize);
            let own = own.map(|i| (growth.candidate(piece, (i, count)), 1.0));
            let heard = heard.on(&growth.active[piece]).map(|candidate| (candidate, UNHEARD));
            let mut fate = Fate::Dead;
            for (candidate, share) in own.chain(heard) {
                match wanted(&candidate) {
                    None => {}
                    // One that wants more decides for all.
                    Some(w)
                        if growth.level < DEEPEST
                            && w * std::f32::consts::SQRT_2 < share * growth.spacing =>
                    {
                        return Fate::Finer;
                    }
                    Some(_) => fate = Fate::Done,
                }
            }
            fate
        })
        .collect()
}

/// Gives the sites of pieces that went on the spacing of the plots that those became.
fn settle(kept: &mut [Kept], plots: &[Plot]) {
    kept.par_iter_mut().with_min_len(256).filter(|k| k.open).for_each(|k| {
        let Candidate { back, place, .. } = k.candidate;
        let before = |plot: &Plot| (plot.piece.back, plot.piece.first) <= (back, place);
        let mut plot = plots.partition_point(before).max(1) - 1;
        if plots[plot].piece.path > 1 {
            // Several plots share the triangle.
            let along = k.candidate.along();
            plot = plots.partition_point(|plot| plot.piece.place() <= along).max(1) - 1;
        }
        if plots[plot].spacing > 0.0 {
            k.spacing = plots[plot].spacing;
        }
    });
}

/// The arrays in Morton order, fronts before backs.
fn in_order(kept: &[Kept]) -> SiteArrays {
    let smallest = kept.iter().map(|k| k.spacing).fold(f32::INFINITY, f32::min);
    let corner = kept.iter().map(|k| k.candidate.point.position).fold(Vec3::splat(f32::INFINITY), Vec3::min);
    let mut order: Vec<(u64, u32)> = kept
        .par_iter()
        .zip(0..kept.len() as u32)
        .map(|(k, i)| {
            let code = morton::code(k.candidate.point.position, corner, smallest);
            (code | u64::from(k.candidate.back) << 63, i)
        })
        .collect();
    order.par_sort_unstable();
    let sorted: Vec<Kept> = order.par_iter().map(|(_, i)| kept[*i as usize]).collect();
    SiteArrays {
        positions: sorted.par_iter().map(|k| k.candidate.point.position).collect(),
        normals: sorted.par_iter().map(|k| k.candidate.point.normal).collect(),
        areas: vec![],
        triangles: sorted.par_iter().map(|k| k.candidate.triangle).collect(),
        barycentrics: sorted.par_iter().map(|k| k.candidate.barycentric).collect(),
        levels: sorted.par_iter().map(|k| k.level).collect(),
        spacings: sorted.par_iter().map(|k| k.spacing).collect(),
    }
}
