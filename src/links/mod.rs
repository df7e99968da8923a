//! Links: what each receiver needs to know of the scene's geometry to turn sources into irradiance.
//!
//! A link is owned by, sorted by and indexed by its receiver. Three kinds, kept apart because they are relit apart:
//! lamps → sites ([`direct`]), sky → receivers and sites → receivers (both in [`rows`]).

pub mod compress;
pub mod dense;
pub mod direct;
pub mod lamps;
pub mod receivers;
pub mod rows;

use crate::geometry::{SurfacePoint, triangle};
use crate::rays::{Bvh, Hit, Ray};
use crate::scene::Scene;
use crate::sites::cells::Said;
use crate::sites::{Cells, Ground, Neighbours, SiteId, Sites};

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

/// Whether the ray meets the triangle's back.
pub fn from_behind(scene: &Scene, ray: &Ray, hit: &Hit) -> bool {
    triangle::area_vector(scene.corners(hit.triangle)).dot(ray.direction) > 0.0
}

impl<'a> Surroundings<'a> {
    fn ground(&self) -> Ground<'a> {
        Ground { scene: self.scene, bvh: self.bvh, sites: self.sites, graph: self.graph }
    }

    /// The site that speaks for a side at a hit, or a mark of [`rows`].
    #[inline]
    pub fn mark(&self, hit: &Hit, back: bool) -> u32 {
        match self.cells.site(hit, back, self.ground()) {
            Said::Site(site) => site.0,
            Said::Dead => rows::BLACK,
            Said::Nobody => rows::LOST,
        }
    }

    /// The site that speaks for a surface point: a short ray finds the triangle under it, the cells know the rest.
    pub fn site_under(&self, point: &SurfacePoint) -> Option<SiteId> {
        let lift = crate::geometry::GIVEN_TOLERANCE;
        let ray = Ray {
            origin: point.position + point.normal * lift,
            direction: -point.normal,
            t_min: 0.0,
            t_max: 2.0 * lift,
        };
        let mark = self.bvh.closest(&ray).map(|hit| self.mark(&hit, from_behind(self.scene, &ray, &hit)));
        match mark {
            Some(site) if site < rows::FIRST_MARK => Some(SiteId(site)),
            Some(rows::BLACK) => None,
            _ => self.ground().represent(point),
        }
    }
}
