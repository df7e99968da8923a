//! Rows of R: what a receiver's cosine-distributed rays meet, one entry per ray, in lattice order.
//!
//! This work is based on: Kajiya, "The Rendering Equation", 1986 (the integral), and Keller's quasi-Monte Carlo
//! radiosity (1996). A row gathered with cosine-weighted rays has no 1/r² singularity, carries visibility for free and
//! sums to the share of rays that met something: ‖G‖∞ ≤ 1 by construction. The ray's direction is its place in the
//! row, so that gradients and the sky need no further storage.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use rayon::prelude::*;

use super::Surroundings;
use crate::archive::{Ledger, Tag};
use crate::error::Result;
use crate::geometry::{SurfacePoint, hash, hemisphere, tangent_frame};
use crate::rays::{Bvh, Hit, Ray};
use crate::scene::Scene;

/// The ray left the scene.
pub const SKY: u32 = u32::MAX;
/// The ray met the black back of a one-sided surface.
pub const BLACK: u32 = u32::MAX - 1;
/// The ray met a surface that no live site speaks for; it counts as the mean of those that met others.
pub const LOST: u32 = u32::MAX - 2;
/// Values from here on are not sites.
pub const FIRST_MARK: u32 = LOST;

/// Rays of a block: about a second of one core.
const BLOCK_RAYS: usize = 1 << 20;

/// How rows are shot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RowParams {
    /// Rays a row.
    pub rays: u32,
    /// Random seed of the lattices' shifts.
    pub seed: u64,
}

/// What a row's rays met, in numbers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct RowSummary {
    /// Rays that met a surface.
    pub hits: u32,
    /// Σ 1/t over the hits, local units.
    pub inverse_distance: f32,
    /// Rays that met black backs.
    pub black: u32,
    /// Rays that left the scene.
    pub escaped: u32,
}

impl RowSummary {
    /// The harmonic mean of the hit distances; infinite where nothing was hit.
    pub fn harmonic_distance(&self) -> f32 {
        if self.hits == 0 { f32::INFINITY } else { self.hits as f32 / self.inverse_distance.max(1e-30) }
    }

    /// The weight of a site in a row of so many rays, some of them lost.
    pub fn weight(&self, rays: u32, lost: u32) -> f32 {
        let surfaces = rays.saturating_sub(self.escaped);
        let known = surfaces.saturating_sub(lost).max(1);
        surfaces as f32 / (known as f32 * rays as f32)
    }

    /// Whether the receiver sits inside a solid: most of what it sees are backs.
    pub fn is_dead(&self, rays: u32) -> bool {
        2 * self.black > rays
    }
}

/// Where the rays of some receivers met the scene, before anybody speaks for the surfaces: geometry alone.
#[derive(Debug, Clone, Default)]
pub struct RawRows {
    /// Rays a row.
    pub rays: u32,
    /// Per row the key of its lattice shift.
    pub keys: Vec<u64>,
    /// Receivers × rays.
    pub hits: Vec<RawHit>,
    /// Per row.
    pub summaries: Vec<RowSummary>,
}

/// One ray's end: a triangle's side with barycentric coordinates, or a mark.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct RawHit {
    /// Triangle · 2 + 1 for its back, or [`SKY`] or [`BLACK`].
    side: u32,
    u: f32,
    v: f32,
}

impl RawRows {
    /// No rows yet, of this many rays each.
    pub fn new(rays: u32) -> Self {
        Self { rays, ..Self::default() }
    }

    /// Shoots rows from more points, block by block; the keys make the result independent of the order of work.
    ///
    /// # Errors
    /// The ledger's.
    pub fn extend(
        &mut self,
        (scene, bvh): (&Scene, &Bvh),
        (points, keys): (&[SurfacePoint], &[u64]),
        ledger: &Ledger<'_>,
    ) -> Result<()> {
        let n = self.rays as usize;
        let lattice = lattice(self.rays);
        let shoot_rows = |range: Range<usize>| {
            let mut hits = vec![RawHit { side: SKY, u: 0.0, v: 0.0 }; range.len() * n];
            let summaries: Vec<RowSummary> = hits
                .par_chunks_mut(n)
                .zip(points[range.clone()].par_iter().zip(&keys[range]))
                .map(|(out, (point, key))| shoot((scene, bvh), &lattice, (point, *key), out, |_| ()))
                .collect();
            Ok((hits, summaries))
        };
        self.keys.extend_from_slice(keys);
        self.hits.reserve(points.len() * n);
        ledger.blocks(Tag::new("hits"), (points.len(), BLOCK_RAYS / n), shoot_rows, |(hits, summaries)| {
            self.hits.extend(hits);
            self.summaries.extend(summaries);
        })
    }

    /// A single row, shot on this thread alone.
    pub fn single(within: (&Scene, &Bvh), point: &SurfacePoint, key: u64, rays: u32) -> Self {
        Self::measured(within, point, key, rays).0
    }

    /// A single row with the distance of each hit, infinite where there is none.
    pub fn measured(within: (&Scene, &Bvh), point: &SurfacePoint, key: u64, rays: u32) -> (Self, Vec<f32>) {
        let mut hits = vec![RawHit { side: SKY, u: 0.0, v: 0.0 }; rays as usize];
        let mut distances = Vec::with_capacity(rays as usize);
        let told = |distance| distances.push(distance);
        let summary = shoot(within, &lattice(rays), (point, key), &mut hits, told);
        (Self { rays, keys: vec![key], hits, summaries: vec![summary] }, distances)
    }

    /// Adds one row of others.
    pub fn push(&mut self, others: &Self, row: usize) {
        let n = self.rays as usize;
        self.keys.push(others.keys[row]);
        self.summaries.push(others.summaries[row]);
        self.hits.extend_from_slice(&others.hits[row * n..(row + 1) * n]);
    }

    /// Asks for every hit who speaks for the surface there.
    pub fn met(self, around: Surroundings<'_>) -> Rows {
        let met = self.hits.iter().map(|hit| hit.met(around)).collect();
        Rows { rays: self.rays, keys: self.keys, met, summaries: self.summaries }
    }

    /// Asks for every hit who speaks for the surface there, block by block.
    ///
    /// # Errors
    /// The ledger's.
    pub fn resolve(self, around: Surroundings<'_>, ledger: &Ledger<'_>) -> Result<Rows> {
        let n = self.rays as usize;
        let mut met = Vec::with_capacity(self.hits.len());
        let ask = |rows: Range<usize>| {
            let hits = &self.hits[rows.start * n..rows.end * n];
            Ok(hits.par_iter().with_min_len(1024).map(|hit| hit.met(around)).collect::<Vec<u32>>())
        };
        ledger.blocks(Tag::new("met"), (self.keys.len(), BLOCK_RAYS / n), ask, |block| met.extend(block))?;
        Ok(Rows { rays: self.rays, keys: self.keys, met, summaries: self.summaries })
    }
}

impl RawHit {
    /// The triangle and whether its back was met, if a surface was.
    pub fn side(&self) -> Option<(u32, bool)> {
        (self.side < FIRST_MARK).then_some((self.side >> 1, self.side & 1 == 1))
    }

    /// Where a surface was met: triangle, barycentric (u, v), whether from behind.
    pub fn place(&self) -> Option<(u32, [f32; 2], bool)> {
        self.side().map(|(triangle, back)| (triangle, [self.u, self.v], back))
    }

    fn met(&self, around: Surroundings<'_>) -> u32 {
        if self.side >= FIRST_MARK {
            return self.side;
        }
        let back = self.side & 1 == 1;
        around.mark(&Hit { distance: 0.0, triangle: self.side >> 1, u: self.u, v: self.v, back })
    }
}

/// The rays of some receivers, equally many each.
#[derive(Debug, Clone, Default)]
pub struct Rows {
    /// Rays a row.
    pub rays: u32,
    /// Per row the key of its lattice shift.
    pub keys: Vec<u64>,
    /// Receivers × rays: the site met, or a mark.
    pub met: Vec<u32>,
    /// Per row.
    pub summaries: Vec<RowSummary>,
}

impl Rows {
    /// How many rows there are.
    pub fn len(&self) -> usize {
        self.keys.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.keys.is_empty()
    }

    /// Adds the rows of others, which have as many rays each.
    ///
    /// # Panics
    /// When they have not.
    pub fn append(&mut self, mut others: Self) {
        assert_eq!(self.rays, others.rays, "rows of one table are equally long");
        self.keys.append(&mut others.keys);
        self.met.append(&mut others.met);
        self.summaries.append(&mut others.summaries);
    }

    /// What the rays of one row met.
    pub fn row(&self, receiver: usize) -> &[u32] {
        let n = self.rays as usize;
        &self.met[receiver * n..(receiver + 1) * n]
    }

    /// A single row, shot on this thread alone.
    pub fn single(around: Surroundings<'_>, point: &SurfacePoint, key: u64, rays: u32) -> Self {
        RawRows::single((around.scene, around.bvh), point, key, rays).met(around)
    }

    /// The weight of each of a row's sites, so that lost rays count as the mean of the others that met surfaces: rows of
    /// closed scenes stay whole, and nothing lost looks like sky.
    pub fn weight(&self, receiver: usize) -> f32 {
        let lost = self.row(receiver).iter().filter(|&&met| met == LOST).count() as u32;
        self.summaries[receiver].weight(self.rays, lost)
    }
}

/// A lattice point in polar coordinates: the square of its radius on the unit disc, its angle's cosine and sine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LatticePoint {
    square: f32,
    cos: f32,
    sin: f32,
}

impl LatticePoint {
    /// On the unit disc of a row's frame, if the row were shifted outwards by so much of the disc's area.
    pub fn on_disc(self, shift: f32) -> [f32; 2] {
        let radius = (self.square + shift).sqrt();
        [radius * self.cos, radius * self.sin]
    }
}

/// Points of the unit disc, shared.
pub type Lattice = std::sync::Arc<[LatticePoint]>;

/// The canonical lattice in the order rows are stored: along a curve, so that neighbouring rays meet neighbours.
pub fn lattice(rays: u32) -> Lattice {
    static CACHE: std::sync::Mutex<Vec<Lattice>> = std::sync::Mutex::new(Vec::new());
    let mut known = CACHE.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    if let Some(found) = known.iter().find(|l| l.len() == rays as usize) {
        return found.clone();
    }
    let mut points: Vec<[f32; 2]> = (0..rays).map(|i| hemisphere::fibonacci(i, rays, [0.0, 0.0])).collect();
    points.sort_by_key(|p| {
        let w = hemisphere::cosine_hemisphere(*p);
        crate::geometry::morton::code(Vec3::new(w.x, w.y, 0.0), Vec3::new(-1.0, -1.0, 0.0), 1.0 / 128.0)
    });
    let polar = |[u, v]: [f32; 2]| {
        let (sin, cos) = (std::f32::consts::TAU * v).sin_cos();
        LatticePoint { square: u, cos, sin }
    };
    let made: Lattice = points.into_iter().map(polar).collect();
    known.push(made.clone());
    made
}

/// The directions of a row: the lattice shifted by its key, about the receiver's normal.
#[derive(Debug, Clone, Copy)]
pub struct Directions {
    tangent: Vec3,
    bitangent: Vec3,
    normal: Vec3,
    shift: f32,
}

impl Directions {
    /// Of the row with this key at this normal; `rays` is the row's length.
    pub fn new(normal: Vec3, key: u64, rays: u32) -> Self {
        let (s, t) = tangent_frame(normal);
        let [a, b] = hash::unit_pair(key, 0);
        // A shift of the angle is a turn of the frame.
        let (sin, cos) = (std::f32::consts::TAU * b).sin_cos();
        let (tangent, bitangent) = (s * cos + t * sin, t * cos - s * sin);
        Self { tangent, bitangent, normal, shift: a / rays as f32 }
    }

    /// Tangent, bitangent and normal: the axes of the disc on which [`LatticePoint::on_disc`] lies, and its pole.
    pub fn frame(&self) -> [Vec3; 3] {
        [self.tangent, self.bitangent, self.normal]
    }

    /// The world direction of a lattice point.
    #[inline]
    pub fn at(&self, at: LatticePoint) -> Vec3 {
        let square = at.square + self.shift;
        let around = self.tangent * at.cos + self.bitangent * at.sin;
        around * square.sqrt() + self.normal * (1.0 - square).max(0.0).sqrt()
    }
}

fn shoot(
    (scene, bvh): (&Scene, &Bvh),
    lattice: &[LatticePoint],
    (point, key): (&SurfacePoint, u64),
    out: &mut [RawHit],
    mut told: impl FnMut(f32),
) -> RowSummary {
    let directions = Directions::new(point.normal, key, lattice.len() as u32);
    let origin = point.lifted();
    let mut summary = RowSummary::default();
    for (place, at) in out.iter_mut().zip(lattice) {
        let ray = Ray::new(origin, directions.at(*at));
        let Some((distance, hit)) = bvh.closest_fine(&ray) else {
            told(f32::INFINITY);
            place.side = SKY;
            summary.escaped += 1;
            continue;
        };
        told(distance);
        summary.hits += 1;
        summary.inverse_distance += 1.0 / distance.max(crate::geometry::LIFT);
        let Some(hit) = hit else {
            place.side = LOST;
            continue;
        };
        if hit.back && !scene.meshes[scene.mesh_of(hit.triangle)].two_sided {
            summary.black += 1;
            place.side = BLACK;
        } else {
            *place = RawHit { side: hit.triangle << 1 | u32::from(hit.back), u: hit.u, v: hit.v };
        }
    }
    summary
}
