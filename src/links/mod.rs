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

use crate::geometry::SurfacePoint;
use crate::rays::{Bvh, Hit, Ray};
use crate::scene::Scene;
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

/// The surface a ray met: the side it came from, and who speaks for it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Met {
    /// A side that reflects or emits, represented by a site.
    Site(SiteId),
    /// The back of a one-sided surface: black.
    Black,
    /// A side that reflects, but no site can be found that represents it.
    Lost,
}

impl<'a> Surroundings<'a> {
    fn ground(&self) -> Ground<'a> {
        Ground { scene: self.scene, bvh: self.bvh, sites: self.sites, graph: self.graph }
    }

    /// Whether the ray meets the triangle's back.
    pub fn from_behind(&self, ray: &Ray, hit: &Hit) -> bool {
        let [a, b, c] = self.scene.corners(hit.triangle);
        (b - a).cross(c - a).dot(ray.direction) > 0.0
    }

    /// Who speaks for the surface at a hit.
    pub fn met(&self, ray: &Ray, hit: &Hit) -> Met {
        let back = self.from_behind(ray, hit);
        if back && !self.scene.meshes[self.scene.mesh_of(hit.triangle)].two_sided {
            return Met::Black;
        }
        match self.cells.site(hit, back, self.ground()) {
            Some(site) => Met::Site(site),
            None => Met::Lost,
        }
    }

    /// The site that speaks for a surface point: a short ray finds the triangle under it, the cells know the rest.
    pub fn site_under(&self, point: &SurfacePoint) -> Option<SiteId> {
        let lift = 32.0 * crate::geometry::LIFT;
        let ray = Ray {
            origin: point.position + point.normal * lift,
            direction: -point.normal,
            t_min: 0.0,
            t_max: 2.0 * lift,
        };
        let under = self.bvh.closest(&ray).and_then(|hit| match self.met(&ray, &hit) {
            Met::Site(site) => Some(site),
            Met::Black | Met::Lost => None,
        });
        under.or_else(|| self.ground().represent(*point))
    }

    /// Whether two surface points see each other; their ends are lifted by a share of their distance, so that gentle
    /// curvature between them does not count as a wall.
    pub fn mutually_visible(&self, a: &SurfacePoint, b: &SurfacePoint) -> bool {
        crate::sites::neighbours::mutually_visible(*a, *b, self.bvh)
    }
}
