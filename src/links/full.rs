//! Where the scene's triangles are a proxy of a surface in full resolution: from the one to the other.

use super::Surroundings;
use super::receivers::Placement;
use super::rows::{RawRows, RowParams};
use crate::archive::Ledger;
use crate::error::Result;
use crate::geometry::{GIVEN_TOLERANCE, SurfacePoint};
use crate::rays::{Bvh, Ray};
use crate::scene::Scene;
use crate::sites::SiteId;
use crate::tree::Support;
use crate::tree::index::SupportIndex;
use rayon::prelude::*;

/// As [`Surroundings::set_down`].
fn set_down(bvh: &Bvh, point: &SurfacePoint) -> Option<SurfacePoint> {
    let Some(near) = bvh.near() else { return Some(*point) };
    let rise = near.apart();
    let origin = point.position + point.normal * rise;
    let ray = Ray { origin, direction: -point.normal, t_min: 0.0, t_max: 2.0 * rise };
    let met = bvh.surface(&ray)?;
    Some(SurfacePoint { position: origin + ray.direction * met.distance, normal: met.normal })
}

impl Surroundings<'_> {
    /// The full surface next to a point of the proxy, along its normal; the point itself where there is no proxy. None where
    /// the full surface is not there.
    pub fn set_down(&self, point: &SurfacePoint) -> Option<SurfacePoint> {
        set_down(self.bvh, point)
    }

    /// The site that speaks for a point of the surface, without a look at the surface itself.
    pub fn site_below(&self, point: &SurfacePoint) -> Option<SiteId> {
        let Some(hit) = self.bvh.beside(point.position, point.normal) else { return self.site_under(point) };
        match self.mark(&hit) {
            super::rows::BLACK => None,
            super::rows::LOST => self.ground().represent(point),
            site => Some(SiteId(site)),
        }
    }

    /// As [`Surroundings::footing`], for a point of the full surface: the proxy next to it knows the site.
    pub(super) fn footing_beside(&self, point: &SurfacePoint) -> (Option<SiteId>, SurfacePoint) {
        let down = |lift: f32| Ray {
            origin: point.position + point.normal * lift,
            direction: -point.normal,
            t_min: 0.0,
            t_max: 2.0 * lift,
        };
        let set = [0.01 * GIVEN_TOLERANCE, GIVEN_TOLERANCE].into_iter().find_map(|lift| {
            let ray = down(lift);
            let (distance, _) = self.bvh.closest_fine(&ray)?;
            Some(SurfacePoint { position: ray.origin + ray.direction * distance, ..*point })
        });
        let set = set.unwrap_or(*point);
        match self.bvh.beside(set.position, set.normal).map(|hit| self.mark(&hit)) {
            Some(super::rows::BLACK) => (None, set),
            Some(super::rows::LOST) | None => (self.ground().represent(point), set),
            Some(site) => (Some(SiteId(site)), set),
        }
    }
}

impl Placement {
    /// Moves receivers from the proxy onto the full surface next to them and shoots their rows there. Those whose place is
    /// not on it, or inside a solid, go.
    ///
    /// # Errors
    /// The ledger's.
    pub fn set_down(
        self,
        (scene, bvh): (&Scene, &Bvh),
        params: &RowParams,
        ledger: &Ledger<'_>,
    ) -> Result<Self> {
        if bvh.near().is_none() {
            return Ok(self);
        }
        let down = |s: &Support| set_down(bvh, &s.point);
        let moved: Vec<Option<SurfacePoint>> =
            self.index.supports().par_iter().with_min_len(64).map(down).collect();
        let kept: Vec<usize> = (0..moved.len()).filter(|&k| moved[k].is_some()).collect();
        let points: Vec<SurfacePoint> = moved.into_iter().flatten().collect();
        let keys: Vec<u64> = kept.iter().map(|&k| self.raw.keys[k]).collect();
        let mut fresh = RawRows::new(params.rays);
        fresh.extend((scene, bvh), (&points, &keys), ledger)?;
        let (mut index, mut places, mut raw) = (SupportIndex::default(), vec![], RawRows::new(params.rays));
        for (k, &old) in kept.iter().enumerate() {
            if fresh.summaries[k].is_dead(params.rays) {
                continue;
            }
            index.push(Support { point: points[k], ..self.index.supports()[old] });
            places.push(self.places[old]);
            raw.push(&fresh, k);
        }
        let rays = self.rays + fresh.hits.len() as u64;
        Ok(Self { index, places, raw, rays, ..self })
    }
}
