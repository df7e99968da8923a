//! Sites: the points at which light is known, nested in levels, as dense as the light's variation asks.
//!
//! [`Sites::scatter`] grows them over the surface, [`neighbours`] links those that see each other, and [`cells`]
//! answers which site stands for the bit of surface that a ray met.

pub mod cells;
mod crowd;
pub mod neighbours;
mod plots;
mod samples;
mod scatter;

use glam::Vec3;

use crate::archive::{Keep, Parcel, Parts};
use crate::geometry::SurfacePoint;
use crate::scatter::bricks::Bricks;
use crate::scatter::surface::Piece;

pub use cells::{Cells, Ground};
pub use neighbours::Neighbours;
pub use samples::Samples;

/// The index of a site.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SiteId(pub u32);

impl SiteId {
    /// The id as an index into the arrays of [`Sites`].
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// What to scatter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SiteParams {
    /// Keys every random number.
    pub seed: u64,
    /// Level 0 has about this many sites.
    pub coarsest: usize,
    /// A spacing that is met exactly, local units: levels are this times powers of two. Zero leaves them where they fall.
    pub met: f32,
    /// Candidates thrown per squared spacing: fewer leave gaps, more cost time. Of 6, 0.5 % of the surface is farther than
    /// one spacing from its site, and 0.03 % farther than 1.2.
    pub density: f32,
}

impl Default for SiteParams {
    fn default() -> Self {
        Self { seed: 1, coarsest: 64, met: 0.0, density: 6.0 }
    }
}

/// The plain arrays of [`Sites`], as stored in an archive; see there for each field.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SiteArrays {
    /// See [`Sites::positions`].
    pub positions: Vec<Vec3>,
    /// See [`Sites::normals`].
    pub normals: Vec<Vec3>,
    /// See [`Sites::areas`].
    pub areas: Vec<f32>,
    /// See [`Sites::triangles`].
    pub triangles: Vec<u32>,
    /// See [`Sites::barycentrics`].
    pub barycentrics: Vec<[f32; 2]>,
    /// See [`Sites::levels`].
    pub levels: Vec<u8>,
    /// See [`Sites::spacings`].
    pub spacings: Vec<f32>,
}

/// A piece of surface at the level at which it was satisfied.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plot {
    /// Which.
    pub piece: Piece,
    /// Local spacing of its sites; zero where nothing reflects.
    pub spacing: f32,
}

impl Keep for SiteArrays {
    fn put<'a>(&'a self, parts: &mut Parts<'a>) {
        parts.put(&self.positions);
        parts.put(&self.normals);
        parts.put(&self.areas);
        parts.put(&self.triangles);
        parts.put(&self.barycentrics);
        parts.put(&self.levels);
        parts.put(&self.spacings);
    }

    fn take(parcel: &mut Parcel) -> Result<Self, String> {
        Ok(Self {
            positions: parcel.take()?,
            normals: parcel.take()?,
            areas: parcel.take()?,
            triangles: parcel.take()?,
            barycentrics: parcel.take()?,
            levels: parcel.take()?,
            spacings: parcel.take()?,
        })
    }
}

impl Plot {
    /// As words, for storage.
    pub fn to_words(&self) -> [u32; 7] {
        let Piece { first, last, path, back, area } = self.piece;
        let [low, high] = [path as u32, (path >> 32) as u32];
        [first, last, low, high, u32::from(back), area.to_bits(), self.spacing.to_bits()]
    }

    /// From words that [`Plot::to_words`] gave.
    pub fn from_words(&[first, last, low, high, back, area, spacing]: &[u32; 7]) -> Self {
        let path = u64::from(high) << 32 | u64::from(low);
        let piece = Piece { first, last, path, back: back != 0, area: f32::from_bits(area) };
        Self { piece, spacing: f32::from_bits(spacing) }
    }
}

/// Nested Poisson-disk sites over the surfaces, structure of arrays, in Morton order.
///
/// Two sites conflict at a spacing when they are closer than it and n·n′ > 0.7. The sites of levels ≤ l are free of
/// conflicts at the spacing of l.
pub struct Sites {
    /// Local positions.
    pub positions: Vec<Vec3>,
    /// Unit normals of the sides the sites belong to.
    pub normals: Vec<Vec3>,
    /// Surface area each stands for, squared local units; they sum to the area of all sides that reflect.
    pub areas: Vec<f32>,
    /// The triangle each lies on.
    pub triangles: Vec<u32>,
    /// Barycentric (u, v) on that triangle.
    pub barycentrics: Vec<[f32; 2]>,
    /// The coarsest level at which each takes part, root = 0.
    pub levels: Vec<u8>,
    /// The Poisson spacing around each, local units.
    pub spacings: Vec<f32>,
    near: Bricks<Near>,
}

/// What a search reads of a site.
#[derive(Clone, Copy)]
struct Near {
    position: Vec3,
    id: u32,
    normal: Vec3,
    spacing: f32,
}

/// How far a site is looked for, in its own spacings: the nearest site of a covered point is within 1.2, a neighbour
/// within [`neighbours::LINK_SPACINGS`].
pub const REACH: f32 = 2.1;

impl Sites {
    /// Sites from arrays that [`Sites::to_arrays`] gave, with the look-up built anew.
    pub fn from_arrays(a: SiteArrays) -> Self {
        let places: Vec<(Vec3, f32)> =
            a.positions.iter().zip(&a.spacings).map(|(p, spacing)| (*p, REACH * spacing)).collect();
        let near = Bricks::new(&places, |s| Near {
            position: a.positions[s],
            id: s as u32,
            normal: a.normals[s],
            spacing: a.spacings[s],
        });
        Self {
            positions: a.positions,
            normals: a.normals,
            areas: a.areas,
            triangles: a.triangles,
            barycentrics: a.barycentrics,
            levels: a.levels,
            spacings: a.spacings,
            near,
        }
    }

    /// The plain arrays, for storage and comparison.
    pub fn to_arrays(&self) -> SiteArrays {
        SiteArrays {
            positions: self.positions.clone(),
            normals: self.normals.clone(),
            areas: self.areas.clone(),
            triangles: self.triangles.clone(),
            barycentrics: self.barycentrics.clone(),
            levels: self.levels.clone(),
            spacings: self.spacings.clone(),
        }
    }

    /// How many sites there are.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there is none, as in a scene without area.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Position and normal of a site.
    pub fn point(&self, site: SiteId) -> SurfacePoint {
        SurfacePoint { position: self.positions[site.index()], normal: self.normals[site.index()] }
    }

    /// Number of levels.
    pub fn level_count(&self) -> usize {
        self.levels.iter().max().map_or(0, |&l| usize::from(l) + 1)
    }

    /// The site that matches a point best; ties go to the lower id. No visibility test: [`Ground::represent`] makes one
    /// where it is needed.
    pub fn nearest(&self, point: &SurfacePoint) -> Option<SiteId> {
        let best = self.near.least(
            point.position,
            |near| near.id,
            |near, best| match near.mismatch(point) {
                Some(value) if (value, near.id) < best => (value, near.id),
                _ => best,
            },
        );
        (best.1 != u32::MAX).then_some(SiteId(best.1))
    }

    /// Calls `visit` with every site that matches a point at all, and its mismatch.
    pub fn visit_matching(&self, point: &SurfacePoint, mut visit: impl FnMut(SiteId, f32)) {
        self.near.within_reach(point.position, |near| {
            if let Some(value) = near.mismatch(point) {
                visit(SiteId(near.id), value);
            }
        });
    }

    /// Calls `visit` with every site whose reach may hold the position, and some that do not.
    pub fn visit_near(&self, position: Vec3, mut visit: impl FnMut(SiteId)) {
        self.near.within_reach(position, |near| visit(SiteId(near.id)));
    }
}

impl Near {
    /// The mismatch d² + 4(d·m)² + 4h²(1 − n·n′) between a point and a site that is near and turned alike, m their mean
    /// normal; None for others.
    #[inline]
    fn mismatch(&self, point: &SurfacePoint) -> Option<f32> {
        let d = self.position - point.position;
        let square = d.length_squared();
        let h2 = self.spacing * self.spacing;
        if square >= REACH * REACH * h2 {
            return None;
        }
        let cosine = self.normal.dot(point.normal);
        let offset = d.dot(self.normal + point.normal);
        (cosine > 0.0).then_some(square + offset * offset + 4.0 * h2 * (1.0 - cosine))
    }
}
