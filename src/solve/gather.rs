//! A point's own row against the solved radiosities, looked at more closely where surfaces are nearer than sites are dense.
//!
//! This work is based on: Christensen, "Faster Photon Map Global Illumination", 1999, and Tabellion and Lamorlette 2004
//! (a gather must not trust stored light at hits that are near: many rays then meet the same wrong value).

use glam::Vec3;
use smallvec::SmallVec;

use super::Field;
use super::light::RowLight;
use crate::geometry::{SurfacePoint, hash, triangle};
use crate::light::{Rgb, mean_channel};
use crate::links::direct::{DirectParams, Query};
use crate::links::rows::{self, Directions, FIRST_MARK, RawHit, RawRows, Rows};
use crate::scatter::surface::side_normal;
use crate::sites::SiteId;

/// Hits closer than this many spacings of the site they meet are looked at, if sites around it differ.
const NEAR: f32 = 1.0;

/// On full surfaces all hits closer than this are, where the ray met them: sites of the proxy do not know their folds.
/// Measured at vertices of a scan (docs/theory.md): 3.1 % as in memory, 2.5 % so, for 3 % more time.
const NEAR_FULL: f32 = 2.0;

/// Hits closer than this share of that spacing are on the other wall of a slit.
const SLIT: f32 = 0.1;

/// Rays of such a look.
const LOOK: u32 = 4;

impl Field<'_> {
    /// What a point's own row brings; `key` shifts its lattice.
    ///
    /// Cost: `rays` rays, and five for each that ends nearby where sites differ. Returns the rays traced, too.
    pub fn gather_row(&self, point: &SurfacePoint, key: u64, rays: u32) -> (RowLight, u64) {
        let around = self.problem.around;
        let (raw, distances) = RawRows::measured((around.scene, around.bvh), point, key, rays);
        let hits = raw.hits.clone();
        let row = raw.met(around);
        let mut seen = Vec::with_capacity(rays as usize);
        self.problem.look((&row, 0), point.normal, &self.solution.radiosity, &mut seen);
        let slit = self.is_in_slit(&row, &distances);
        let (directions, lattice) = (Directions::new(point.normal, key, rays), rows::lattice(rays));
        let mut looked = 0;
        for (k, (hit, light)) in hits.iter().zip(&mut seen).enumerate() {
            if slit.contains(&(k as u32)) {
                continue;
            }
            let reached = point.position + directions.at(lattice[k]) * distances[k];
            let key = hash::mix2(key, k as u64);
            if let Some(better) = self.look_closer((point, reached), (hit, row.met[k]), key) {
                *light = better;
                looked += 1;
            }
        }
        self.light_slit(&row, &slit, &mut seen);
        (RowLight::new((&row, 0), point.normal, &seen), u64::from(rays) + looked * u64::from(LOOK + 1))
    }

    /// The rays that end on what is next to the point, of full surfaces: the other wall of a slit.
    fn is_in_slit(&self, row: &Rows, distances: &[f32]) -> SmallVec<[u32; 16]> {
        let around = self.problem.around;
        if around.bvh.near().is_none() {
            return SmallVec::new();
        }
        let next = |&k: &u32| {
            let met = row.met[k as usize];
            met < FIRST_MARK && distances[k as usize] < SLIT * around.sites.spacings[met as usize]
        };
        (0..row.rays).filter(next).collect()
    }

    /// What is next to a point gets the light that the point gets: sites, which are much farther apart, know nothing of what a
    /// slit keeps away. H = (Σ far + Σ ρ H) / N over the rays.
    fn light_slit(&self, row: &Rows, slit: &[u32], seen: &mut [Rgb]) {
        if slit.is_empty() {
            return;
        }
        let (mut reflected, mut sum) = (Rgb::ZERO, seen.iter().sum::<Rgb>());
        for &k in slit {
            let site = row.met[k as usize] as usize;
            reflected += self.problem.albedo[site];
            sum += self.problem.exitance[site] - seen[k as usize];
        }
        let sum = if self.judge.is_some() { sum } else { sum.max(Rgb::ZERO) };
        let light = sum / (Rgb::splat(row.rays as f32) - reflected).max(Rgb::splat(1.0e-3));
        for &k in slit {
            let site = row.met[k as usize] as usize;
            seen[k as usize] = self.problem.exitance[site] + self.problem.albedo[site] * light;
        }
    }

    /// The radiosity at a hit that is near, if its site cannot be trusted to speak for it; `reached` is where the ray ended.
    fn look_closer(
        &self,
        (from, reached): (&SurfacePoint, Vec3),
        (hit, met): (&RawHit, u32),
        key: u64,
    ) -> Option<Rgb> {
        let problem = &self.problem;
        if met >= FIRST_MARK {
            return None;
        }
        let (id, [u, v], back) = hit.place()?;
        let scene = problem.around.scene;
        let site = met as usize;
        let full = problem.around.bvh.near().is_some();
        let position = if full { reached } else { triangle::point(scene.corners(id), u, v) };
        let near = if full { NEAR_FULL } else { NEAR } * problem.around.sites.spacings[site];
        if position.distance_squared(from.position) > near * near || !(full || self.contrasts(site)) {
            return None;
        }
        let at = SurfacePoint { position, normal: side_normal(scene, id, back) };
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
        let radiosity = &self.judge().radiosity;
        let least = self.params.doubt * self.judge().level;
        let differs = |&o: &u32| mean_channel(radiosity[o as usize] - radiosity[site]).abs() > least;
        self.problem.around.graph.of(SiteId(site as u32)).iter().any(differs)
    }
}
