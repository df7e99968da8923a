//! A point's own row against the solved radiosities, looked at more closely where surfaces are nearer than sites are dense.
//!
//! This work is based on: Christensen, "Faster Photon Map Global Illumination", 1999, and Tabellion and Lamorlette 2004
//! (a gather must not trust stored light at hits that are near: many rays then meet the same wrong value).

use super::Field;
use super::light::RowLight;
use crate::geometry::{SurfacePoint, hash, triangle};
use crate::light::{Rgb, mean_channel};
use crate::links::direct::{DirectParams, Query};
use crate::links::rows::{FIRST_MARK, RawHit, RawRows, Rows};
use crate::scatter::surface::side_normal;
use crate::sites::SiteId;

/// Hits closer than this many spacings of the site they meet are looked at.
const NEAR: f32 = 1.0;

/// Rays of such a look.
const LOOK: u32 = 4;

impl Field<'_> {
    /// What a point's own row brings; `key` shifts its lattice.
    ///
    /// Cost: `rays` rays, and five for each that ends nearby where sites differ. Returns the rays traced, too.
    pub fn gather_row(&self, point: &SurfacePoint, key: u64, rays: u32) -> (RowLight, u64) {
        let around = self.problem.around;
        let raw = RawRows::single((around.scene, around.bvh), point, key, rays);
        let hits = raw.hits.clone();
        let row = raw.met(around);
        let mut seen = Vec::with_capacity(rays as usize);
        self.problem.look((&row, 0), point.normal, &self.solution.radiosity, &mut seen);
        let mut looked = 0;
        for (k, (hit, light)) in hits.iter().zip(&mut seen).enumerate() {
            if let Some(better) = self.look_closer(point, (hit, row.met[k]), hash::mix2(key, k as u64)) {
                *light = better;
                looked += 1;
            }
        }
        (RowLight::new((&row, 0), point.normal, &seen), u64::from(rays) + looked * u64::from(LOOK + 1))
    }

    /// The radiosity at a hit that is near, if its site cannot be trusted to speak for it.
    fn look_closer(&self, from: &SurfacePoint, (hit, met): (&RawHit, u32), key: u64) -> Option<Rgb> {
        let problem = &self.problem;
        if met >= FIRST_MARK {
            return None;
        }
        let (id, [u, v], back) = hit.place()?;
        let scene = problem.around.scene;
        let position = triangle::point(scene.corners(id), u, v);
        let site = met as usize;
        let near = NEAR * problem.around.sites.spacings[site];
        if position.distance_squared(from.position) > near * near || !self.contrasts(site) {
            return None;
        }
        let at = problem.around.set_down(&SurfacePoint { position, normal: side_normal(scene, id, back) })?;
        let row = Rows::single(problem.around, &at, key, LOOK);
        let mut seen = Vec::with_capacity(LOOK as usize);
        problem.look((&row, 0), at.normal, &self.solution.radiosity, &mut seen);
        let indirect = seen.into_iter().sum::<Rgb>() / LOOK as f32;
        let shadows = DirectParams { first: 1, penumbra: 1, ..self.params.direct };
        let query = Query { point: at, site: Some(met), rugged: true, key };
        let direct = problem.direct.at_point(problem.around.bvh, problem.lamps, &shadows, &query);
        Some(problem.exitance[site] + scene.albedo(id, u, v) * (indirect + direct))
    }

    /// Whether a site's radiosity differs from a neighbour's by more than is doubted.
    fn contrasts(&self, site: usize) -> bool {
        let radiosity = &self.solution.radiosity;
        let least = self.params.doubt * self.solution.level;
        let differs = |&o: &u32| mean_channel(radiosity[o as usize] - radiosity[site]).abs() > least;
        self.problem.around.graph.of(SiteId(site as u32)).iter().any(differs)
    }
}
