//! Links: what each receiver needs to know of the scene's geometry to turn sources into irradiance.
//!
//! A link is owned by, sorted by and indexed by its receiver. Three kinds, kept apart because they are relit apart:
//! lamps → sites ([`direct`]), sky → receivers and sites → receivers (both in [`rows`]).

pub mod compress;
pub mod dense;
pub mod direct;
mod full;
pub mod lamps;
pub mod points;
pub mod receivers;
pub mod refine;
pub mod rows;
pub mod spread;

use glam::Vec3;

use crate::geometry::SurfacePoint;
use crate::rays::{Bvh, Hit, Ray};
use crate::scatter::surface::side_normal;
use crate::scene::Scene;
use crate::sites::cells::Said;
use crate::sites::neighbours::mutually_visible;
use crate::sites::{Cells, Ground, Neighbours, SiteId, Sites};
use crate::tree::index::SupportIndex;

/// What rays are traced in and what they find: the scene, its hierarchy, its sites and their cells.
#[derive(Clone, Copy)]
pub struct Surroundings<'a> {
    /// Triangles and materials.
    pub scene: &'a Scene,
    /// The ray engine over them.
    pub bvh: &'a Bvh,
    /// Where radiosity is known.
    pub sites: &'a Sites,
    /// Which sites see each other.
    pub graph: &'a Neighbours,
    /// Which site speaks for which bit of surface.
    pub cells: &'a Cells,
}

/// How many of the nearest supports are asked for visibility before a point counts as uncovered.
const MOST_ASKED: usize = 8;

/// The support nearest to a point that covers it and sees it, and the rays that it took to tell; `found` is room to work in.
fn covering(
    index: &SupportIndex,
    at: &SurfacePoint,
    (lift, bvh): (f32, &Bvh),
    found: &mut Vec<(f32, u32)>,
) -> (Option<u32>, u64) {
    index.nearest(at, 1.0, found);
    let mut rays = 0;
    let by = found.iter().take(MOST_ASKED).find(|(_, id)| {
        rays += 1;
        mutually_visible(*at, index.supports()[*id as usize].point, lift, bvh)
    });
    (by.map(|(_, id)| *id), rays)
}

impl<'a> Surroundings<'a> {
    /// What cells are filled from.
    pub fn ground(&self) -> Ground<'a> {
        Ground { scene: self.scene, bvh: self.bvh, sites: self.sites, graph: self.graph }
    }

    /// The site that speaks for the side that was hit, or a mark of [`rows`].
    #[inline]
    pub fn mark(&self, hit: &Hit) -> u32 {
        match self.cells.site(hit, hit.back, self.ground()) {
            Said::Site(site) => site.0,
            Said::Dead => rows::BLACK,
            Said::Nobody => rows::LOST,
        }
    }

    /// Where the surface lies under or above a place beside a point, `rise` away at the most: the hit, and the point with its
    /// side's normal.
    pub fn beside(&self, centre: &SurfacePoint, offset: Vec3, rise: f32) -> Option<(Hit, SurfacePoint)> {
        let origin = centre.position + offset + centre.normal * rise;
        let ray = Ray { origin, direction: -centre.normal, t_min: 0.0, t_max: 2.0 * rise };
        if self.bvh.near().is_some() {
            let met = self.bvh.surface(&ray)?;
            let position = origin + ray.direction * met.distance;
            return met.hit.map(|hit| (hit, SurfacePoint { position, normal: met.normal }));
        }
        let hit = self.bvh.closest(&ray)?;
        let normal = side_normal(self.scene, hit.triangle, hit.back);
        let position = origin + ray.direction * hit.distance;
        Some((hit, SurfacePoint { position, normal }))
    }

    /// The site that speaks for a surface point, and the point itself set onto the surface: a short ray finds the triangle
    /// under it, the cells know the rest.
    pub fn footing(&self, point: &SurfacePoint) -> (Option<SiteId>, SurfacePoint) {
        if self.bvh.near().is_some() {
            return self.footing_beside(point);
        }
        let lift = crate::geometry::GIVEN_TOLERANCE;
        // From close above first: a wrinkle may hang over the point.
        for lift in [0.01 * lift, lift] {
            let origin = point.position + point.normal * lift;
            let ray = Ray { origin, direction: -point.normal, t_min: 0.0, t_max: 2.0 * lift };
            let Some(hit) = self.bvh.closest(&ray) else { continue };
            let set = SurfacePoint { position: origin - point.normal * hit.distance, normal: point.normal };
            match self.mark(&hit) {
                rows::BLACK => return (None, set),
                rows::LOST => {}
                site => return (Some(SiteId(site)), set),
            }
        }
        (self.ground().represent(point), *point)
    }

    /// The site that speaks for a surface point.
    pub fn site_under(&self, point: &SurfacePoint) -> Option<SiteId> {
        self.footing(point).0
    }
}
