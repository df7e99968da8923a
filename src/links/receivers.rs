//! Receivers: the points that carry rows of their own, placed before the sites and by geometry alone.
//!
//! This work is based on: Ward, Rubinstein and Clear, "A Ray Tracing Solution for Diffuse Interreflection", 1988, and
//! Tabellion and Lamorlette 2004 (clamping the harmonic mean). We divide by the rays that hit, not by all: in open
//! scenes escaped rays would otherwise inflate the radius of surfaces that are close to others.

use std::ops::Range;

use rayon::prelude::*;

use super::rows::{RawHit, RawRows, RowParams, Rows};
use super::{Surroundings, covering};
use crate::archive::{Ledger, Tag};
use crate::error::Result;
use crate::geometry::{SurfacePoint, hash};
use crate::rays::Bvh;
use crate::scatter::Candidate;
use crate::scatter::growth::Growth;
use crate::scatter::octaves::Octaves;
use crate::scatter::surface::Surface;
use crate::scatter::thin::Darts;
use crate::scene::Scene;
use crate::sites::SiteId;
use crate::sites::neighbours::mutually_visible;
use crate::tree::Support;
use crate::tree::index::{REACH, SupportIndex};

/// How receivers are chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReceiverParams {
    /// Validity radius over harmonic mean distance.
    pub factor: f32,
    /// Upper limit of the validity radius, local units.
    pub largest_radius: f32,
    /// The smallest radius is √(0.76 A / this), A the area that exchanges light with other surfaces.
    pub finest: f64,
    /// Candidates per squared spacing and level.
    pub density: f32,
    /// Their rows.
    pub rows: RowParams,
}

/// The ends of visibility rays are lifted by at most this share of the local spacing.
const LIFT_SHARE: f32 = 0.03;

/// Candidates of a block: their visibility rays take a fraction of a second.
const COVERED_BLOCK: usize = 1 << 16;

/// The first level has about this many receivers.
const COARSEST: f64 = 64.0;

/// Receivers by geometry alone: where rays ended, not who speaks for the surface there.
pub struct Placement {
    /// Their points and radii.
    pub index: SupportIndex,
    /// Where each lies.
    pub places: Vec<Candidate>,
    /// Their rays' ends.
    pub raw: RawRows,
    /// Points inside solids, with the radius in which they speak for others.
    pub dead: SupportIndex,
    /// Rays traced.
    pub rays: u64,
    /// The smallest radius, local units.
    pub smallest_radius: f32,
    /// Per mesh its front and back: whether light can get there at all.
    pub lit: Vec<[bool; 2]>,
}

/// Where light comes from, as far as placing receivers needs to know.
pub struct Sources<'a> {
    /// Whether a lamp shines on a point.
    pub shines: &'a (dyn Fn(&SurfacePoint) -> bool + Sync),
    /// Per mesh, whether its surface emits.
    pub glowing: &'a [bool],
    /// Whether there is light outside.
    pub sky: bool,
}

/// Surfaces in front of less than this share of a hemisphere, or of all surface, count as this much: where every ray
/// escapes, lengths that follow from what was met stay above zero.
pub const LEAST_SHARE: f32 = 1e-6;

/// A side of a mesh with fewer receivers than this is never taken for dark.
const ENOUGH_TO_TELL: u32 = 8;

/// Light's way is followed once this many receivers know what they see; sides it does not reach get no more.
const ENOUGH_TO_FOLLOW: usize = 250;

impl Placement {
    /// Places receivers level by level until every bit of surface is covered by one that it sees.
    ///
    /// Deterministic for any number of threads. Cost: a row a receiver, about fifteen coverage tests a receiver.
    ///
    /// # Errors
    /// The ledger's.
    pub fn grow(
        surface: &Surface<'_>,
        bvh: &Bvh,
        sources: &Sources<'_>,
        params: &ReceiverParams,
        ledger: &Ledger<'_>,
    ) -> Result<Self> {
        let first = (0.76 * surface.area() / COARSEST).sqrt() as f32;
        let mut growth = Growth::new(surface, first, params.rows.seed);
        let mut placement = Self {
            index: SupportIndex::default(),
            places: Vec::new(),
            raw: RawRows::new(params.rows.rays),
            dead: SupportIndex::default(),
            rays: 0,
            smallest_radius: 0.0,
            lit: vec![[true; 2]; surface.scene().meshes.len()],
        };
        let mut followed = false;
        let mut settled = 0.0;
        while !growth.active.is_empty() {
            let candidates = growth.candidates(params.density);
            if !followed && placement.places.len() >= ENOUGH_TO_FOLLOW {
                placement.follow_light(surface.scene(), sources);
                followed = true;
            }
            let candidate_is_lit = |c: &Candidate| placement.is_lit(surface.scene(), c.triangle, c.back);
            let lit: Vec<bool> = candidates.par_iter().with_min_len(256).map(candidate_is_lit).collect();
            let lift = LIFT_SHARE * growth.spacing;
            let mut shares = placement.cover(&candidates, (bvh, lift), ledger)?;
            shares.iter_mut().zip(&lit).filter(|(_, lit)| !**lit).for_each(|(s, _)| *s = Some(0.0));
            let mut keep = vec![false; growth.active.len()];
            candidates.iter().zip(&shares).for_each(|(c, s)| keep[c.piece as usize] |= s.is_none());
            placement.add_rows((surface, bvh), params, (&growth, &candidates, &shares), ledger)?;
            let exchanging = exchange(&growth, &candidates, &shares);
            settled += exchanging.iter().zip(&keep).filter(|(_, k)| !**k).map(|(e, _)| e).sum::<f64>();
            let open: f64 = exchanging.iter().zip(&keep).filter(|(_, k)| **k).map(|(e, _)| e).sum();
            let exchanged = (settled + open).max(f64::from(LEAST_SHARE) * surface.area());
            placement.smallest_radius = (0.76 * exchanged / params.finest).sqrt() as f32;
            if growth.spacing < placement.smallest_radius {
                break;
            }
            growth.descend(&keep);
        }
        placement.widen();
        Ok(placement)
    }

    /// Whether light can get to a side of a triangle.
    pub fn is_lit(&self, scene: &Scene, triangle: u32, back: bool) -> bool {
        self.lit[scene.mesh_of(triangle)][usize::from(back)]
    }

    /// Finds the sides of meshes that light can reach: those that shine, that lamps shine on, that see the sky, and those
    /// that see any of these. The inside of a closed scan is none.
    fn follow_light(&mut self, scene: &Scene, sources: &Sources<'_>) {
        let mut lit: Vec<[bool; 2]> = sources.glowing.iter().map(|&g| [g; 2]).collect();
        let rays = self.raw.rays as usize;
        let own = |r: usize| (scene.mesh_of(self.places[r].triangle), usize::from(self.places[r].back));
        let shone: Vec<bool> = self.index.supports().par_iter().map(|s| (sources.shines)(&s.point)).collect();
        for (r, shone) in shone.into_iter().enumerate() {
            let (mesh, side) = own(r);
            lit[mesh][side] |= shone || (sources.sky && self.raw.summaries[r].escaped > 0);
        }
        loop {
            let before = lit.clone();
            for r in 0..self.places.len() {
                let (mesh, side) = own(r);
                if !lit[mesh][side] {
                    let sees = |hit: &RawHit| {
                        hit.side().is_some_and(|(t, back)| lit[scene.mesh_of(t)][usize::from(back)])
                    };
                    lit[mesh][side] = self.raw.hits[r * rays..(r + 1) * rays].iter().any(sees);
                }
            }
            if lit == before {
                break;
            }
        }
        // A side that holds too few receivers to tell stays lit.
        let mut told = vec![[0; 2]; lit.len()];
        (0..self.places.len()).map(own).for_each(|(mesh, side)| told[mesh][side] += 1);
        for (lit, told) in lit.iter_mut().zip(&told) {
            (0..2).for_each(|side| lit[side] |= told[side] < ENOUGH_TO_TELL);
        }
        self.lit = lit;
    }

    /// Per candidate, whether a receiver covers it: the share of the receiver's rays that met surfaces (zero for the
    /// dead); None if uncovered.
    fn cover(
        &mut self,
        candidates: &[Candidate],
        lifted: (&Bvh, f32),
        ledger: &Ledger<'_>,
    ) -> Result<Vec<Option<f32>>> {
        let (mut covered, mut rays) = (Vec::with_capacity(candidates.len()), 0);
        let look = |range: Range<usize>| {
            let answer = |found: &mut Vec<(f32, u32)>, c: &Candidate| self.covered(&c.point, lifted, found);
            let answers = candidates[range].par_iter().with_min_len(64).map_init(Vec::new, answer);
            Ok(answers.unzip::<f32, u32, Vec<f32>, Vec<u32>>())
        };
        ledger.blocks(Tag::new("covered"), (candidates.len(), COVERED_BLOCK), look, |(shares, used)| {
            covered.extend(shares.into_iter().map(|share| (share >= 0.0).then_some(share)));
            rays += used.into_iter().map(u64::from).sum::<u64>();
        })?;
        self.rays += rays;
        Ok(covered)
    }

    /// One candidate's answer, −1 if uncovered, and the rays that it took.
    fn covered(
        &self,
        at: &SurfacePoint,
        (bvh, lift): (&Bvh, f32),
        found: &mut Vec<(f32, u32)>,
    ) -> (f32, u32) {
        let mut buried = false;
        self.dead.for_each(at, 1.0, |id, _| {
            buried |= mutually_visible(*at, self.dead.supports()[id as usize].point, lift, bvh);
        });
        if buried {
            return (0.0, 0);
        }
        let (by, rays) = covering(&self.index, at, (lift, bvh), found);
        let share = |id: u32| self.raw.summaries[id as usize].hits as f32 / self.raw.rays as f32;
        (by.map_or(-1.0, share), rays as u32)
    }

    /// Gives rows to the uncovered candidates that keep the level's distance from each other.
    fn add_rows(
        &mut self,
        (surface, bvh): (&Surface<'_>, &Bvh),
        params: &ReceiverParams,
        (growth, candidates, shares): (&Growth<'_>, &[Candidate], &[Option<f32>]),
        ledger: &Ledger<'_>,
    ) -> Result<()> {
        let mut darts = Darts::new(growth.spacing, 256);
        let mut chosen: Vec<&Candidate> = Vec::new();
        for (candidate, _) in candidates.iter().zip(shares).filter(|(_, s)| s.is_none()) {
            if !darts.conflicts(&candidate.point) {
                darts.keep(candidate.point);
                chosen.push(candidate);
            }
        }
        let points: Vec<SurfacePoint> = chosen.iter().map(|c| c.point).collect();
        let clear = clearances(growth.spacing, candidates, &points);
        let first = (self.places.len() + self.dead.supports().len()) as u64;
        let keys: Vec<u64> =
            (0..chosen.len() as u64).map(|k| hash::mix2(params.rows.seed, first + k)).collect();
        let mut fresh = RawRows::new(params.rows.rays);
        fresh.extend((surface.scene(), bvh), (&points, &keys), ledger)?;
        self.rays += fresh.hits.len() as u64;
        for (k, candidate) in chosen.into_iter().enumerate() {
            let wanted = params.factor * fresh.summaries[k].harmonic_distance();
            let radius = wanted
                .min(params.largest_radius)
                .min(CLEARANCE_SHARE * (clear[k] - BLIND * growth.spacing).max(0.25 * clear[k]))
                .max(self.smallest_radius)
                .max(1e-6);
            let support = Support { point: points[k], radius };
            if fresh.summaries[k].is_dead(params.rows.rays) {
                // A solid's inside ends where nobody has looked yet.
                self.dead.push(Support { radius: radius.min(BURIED_SPACINGS * growth.spacing), ..support });
            } else {
                self.index.push(support);
                self.places.push(*candidate);
                self.raw.push(&fresh, k);
            }
        }
        Ok(())
    }

    /// Widens radii below the smallest, which became known on the way.
    fn widen(&mut self) {
        let supports: Vec<Support> = self
            .index
            .supports()
            .iter()
            .map(|s| Support { radius: s.radius.max(self.smallest_radius), ..*s })
            .collect();
        self.index = SupportIndex::new(&supports);
    }

    /// What the placement says of the spacing of sites.
    pub fn radii(&self) -> Radii<'_> {
        Radii { index: &self.index, dead: &self.dead, raw: &self.raw, smallest: self.smallest_radius }
    }
}

/// The radii of receivers as a field over the surface.
#[derive(Clone, Copy)]
pub struct Radii<'a> {
    index: &'a SupportIndex,
    dead: &'a SupportIndex,
    raw: &'a RawRows,
    /// The smallest radius that was placed by geometry alone, local units.
    pub smallest: f32,
}

impl Radii<'_> {
    /// The radius that speaks for a point, and the share of rays that meet surfaces there: its best support's. None inside
    /// solids.
    pub fn at(&self, at: &SurfacePoint) -> Option<(f32, f32)> {
        let mut best = (f32::INFINITY, Some((self.smallest, 0.5)));
        self.index.for_each(at, REACH, |id, distance| {
            if distance < best.0 {
                let share = self.raw.summaries[id as usize].hits as f32 / self.raw.rays as f32;
                best = (distance, Some((self.index.supports()[id as usize].radius, share)));
            }
        });
        self.dead.for_each(at, REACH, |_, distance| {
            if distance < best.0 {
                best = (distance, None);
            }
        });
        best.1
    }

    /// Points that stand for the surface, each with a weight by the area that exchanges light around it and the share of the
    /// sky that it sees.
    pub fn representatives(&self) -> impl Iterator<Item = (SurfacePoint, f32, f32)> + '_ {
        let supports = self.index.supports().iter().zip(&self.raw.summaries);
        let rays = self.raw.rays as f32;
        supports
            .map(move |(s, row)| (s.point, row.hits as f32 * s.radius * s.radius, row.escaped as f32 / rays))
    }
}

/// Points inside solids speak for no more than this many spacings of their level around them.
const BURIED_SPACINGS: f32 = 0.25;

/// Validity radius over the distance to the nearest surface in front: rays miss small things far away, candidates do not.
const CLEARANCE_SHARE: f32 = 0.5;

/// The nearest candidate is farther than the nearest surface by up to this many spacings.
const BLIND: f32 = 0.5;

/// Surfaces count as in front when seen under this sine of elevation; bumps of the own surface do not.
const CLEARANCE_ELEVATION: f32 = 0.08;

/// How far surfaces are looked for, in spacings of the level.
const CLEARANCE_SPACINGS: f32 = 3.0;

/// Per point the distance to the nearest candidate in front of it, at most [`CLEARANCE_SPACINGS`].
fn clearances(spacing: f32, candidates: &[Candidate], points: &[SurfacePoint]) -> Vec<f32> {
    let reach = CLEARANCE_SPACINGS * spacing;
    let mut near = Octaves::default();
    for (k, candidate) in candidates.iter().enumerate() {
        near.push(k as u32, candidate.point.position, reach);
    }
    points
        .par_iter()
        .with_min_len(16)
        .map(|point| {
            let mut square = reach * reach;
            near.for_each(point.position, |k| {
                let d = candidates[k as usize].point.position - point.position;
                let length = d.length_squared();
                if length < square && d.dot(point.normal) > CLEARANCE_ELEVATION * length.sqrt() {
                    square = length;
                }
            });
            square.sqrt()
        })
        .collect()
}

/// Per active piece the area that exchanges light: its area times the share of rays that meet surfaces there.
fn exchange(growth: &Growth<'_>, candidates: &[Candidate], shares: &[Option<f32>]) -> Vec<f64> {
    let mut sums = vec![(0.0f64, 0u32); growth.active.len()];
    for (candidate, share) in candidates.iter().zip(shares) {
        let (sum, count) = &mut sums[candidate.piece as usize];
        // Nobody knows yet what an uncovered point sees: half.
        *sum += f64::from(share.unwrap_or(0.5));
        *count += 1;
    }
    growth
        .active
        .iter()
        .zip(&sums)
        .map(|(p, (s, n))| f64::from(p.area) * s / f64::from((*n).max(1)))
        .collect()
}

/// The receivers with their rows of sites.
#[derive(Default)]
pub struct Receivers {
    /// Their points and radii.
    pub index: SupportIndex,
    /// The site under each.
    pub homes: Vec<SiteId>,
    /// Visibility rays' ends are lifted by at most this much.
    pub lift: f32,
    /// Long rows, of the first receivers: they are interpolated between.
    pub rows: Rows,
    /// Short rows, of all further receivers: they serve as the radiosity at hits, where a row averages their noise.
    pub own: Rows,
}

impl Receivers {
    /// Finds out who speaks for the surfaces that the rays met, and for the receivers' own places.
    ///
    /// # Errors
    /// The ledger's.
    pub fn settle(around: Surroundings<'_>, placement: Placement, ledger: &Ledger<'_>) -> Result<Self> {
        let home = |s: &Support| around.site_under(&s.point).unwrap_or(SiteId(0));
        Ok(Self {
            homes: placement.index.supports().par_iter().with_min_len(64).map(home).collect(),
            index: placement.index,
            lift: LIFT_SHARE * placement.smallest_radius,
            rows: placement.raw.resolve(around, ledger)?,
            own: Rows::default(),
        })
    }

    /// How many receivers there are.
    pub fn len(&self) -> usize {
        self.rows.len() + self.own.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The table that holds a receiver's row, and the row's number in it.
    #[inline]
    pub fn row(&self, receiver: usize) -> (&Rows, usize) {
        match receiver.checked_sub(self.rows.len()) {
            None => (&self.rows, receiver),
            Some(own) => (&self.own, own),
        }
    }

    /// Both tables, each with the number of its first receiver.
    pub fn tables(&self) -> [(usize, &Rows); 2] {
        [(0, &self.rows), (self.rows.len(), &self.own)]
    }

    /// Rays of all rows.
    pub fn ray_count(&self) -> u64 {
        self.tables().iter().map(|(_, rows)| rows.len() as u64 * u64::from(rows.rays)).sum()
    }
}
