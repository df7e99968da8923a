//! More receivers where those there are do not suffice: each one asked for is split, its radius halved and the surface
//! around it covered anew.
//!
//! This work is based on: Lehtinen et al., "A Meshless Hierarchical Representation for Light Transport", SIGGRAPH 2008
//! (finer levels only where coarser ones, interpolated, would miss the light).

use std::ops::Range;

use glam::Vec3;
use rayon::prelude::*;

use super::receivers::Receivers;
use super::rows::{RawRows, RowParams, Rows};
use super::{Surroundings, covering};
use crate::archive::{Ledger, Tag};
use crate::error::Result;
use crate::geometry::{SurfacePoint, hash, hemisphere, tangent_frame};
use crate::sites::SiteId;
use crate::sites::cells::Said;
use crate::tree::Support;
use crate::tree::index::SupportIndex;

/// Points thrown around a receiver that is split; about five of them become receivers.
const THROWN: u32 = 24;

/// Receivers split in a block: their points' rays take a fraction of a second.
const THROWN_BLOCK: usize = 1 << 12;

/// Points whose normals' cosine with the receiver's is below this are not its surroundings.
const SAME_SURFACE: f32 = 0.2;

/// Halves the radii of the chosen receivers and gives receivers of that radius to the surface that this leaves uncovered.
///
/// To be done before any [`own`]. Deterministic for any number of threads. Cost: about five rows and fifty short rays a receiver split.
///
/// # Errors
/// The ledger's.
pub fn split(
    around: Surroundings<'_>,
    receivers: &mut Receivers,
    (chosen, seed): (&[u32], u64),
    ledger: &Ledger<'_>,
) -> Result<()> {
    let mut supports = receivers.index.supports().to_vec();
    for &r in chosen {
        supports[r as usize].radius *= 0.5;
    }
    receivers.index = SupportIndex::new(&supports);
    let index = &receivers.index;
    let throw = |found: &mut Vec<(f32, u32)>, &r: &u32| -> Vec<SurfacePoint> {
        let parent = supports[r as usize];
        let key = hash::mix2(seed, u64::from(r) ^ supports.len() as u64);
        (0..THROWN)
            .filter_map(|i| around.thrown(&parent.point, 2.0 * parent.radius, (i, key)))
            .filter(|at| covering(index, at, (receivers.lift, around.bvh), found).0.is_none())
            .collect()
    };
    let throw_all = |range: Range<usize>| {
        let thrown: Vec<_> = chosen[range].par_iter().with_min_len(8).map_init(Vec::new, throw).collect();
        let counts: Vec<u32> = thrown.iter().map(|points| points.len() as u32).collect();
        let points: Vec<[Vec3; 2]> = thrown.concat().iter().map(|at| [at.position, at.normal]).collect();
        Ok((counts, points))
    };
    let mut thrown = Vec::with_capacity(chosen.len());
    ledger.blocks(Tag::new("thrown"), (chosen.len(), THROWN_BLOCK), throw_all, |(counts, points)| {
        let mut points = points.into_iter().map(|[position, normal]| SurfacePoint { position, normal });
        thrown.extend(counts.iter().map(|&count| points.by_ref().take(count as usize).collect::<Vec<_>>()));
    })?;
    let mut fresh = SupportIndex::default();
    for (&r, points) in chosen.iter().zip(thrown) {
        for point in points {
            let mut covered = false;
            fresh.for_each(&point, 1.0, |_, _| covered = true);
            if !covered {
                fresh.push(Support { point, radius: supports[r as usize].radius });
            }
        }
    }
    receivers.extend(around, fresh.supports(), seed, ledger)
}

/// Gives sites receivers of their own, save those that another's own receiver covers; no receiver is split any more.
///
/// Cost: a row a receiver.
///
/// # Errors
/// The ledger's.
pub fn own(
    around: Surroundings<'_>,
    receivers: &mut Receivers,
    (chosen, params): (&[u32], RowParams),
    ledger: &Ledger<'_>,
) -> Result<()> {
    let mut fresh = SupportIndex::default();
    for &site in chosen {
        let Some(point) = around.set_down(&around.sites.point(SiteId(site))) else { continue };
        let mut covered = false;
        fresh.for_each(&point, 1.0, |_, _| covered = true);
        if !covered {
            fresh.push(Support { point, radius: OWN_RADIUS * around.sites.spacings[site as usize] });
        }
    }
    receivers.extend_own(around, fresh.supports(), params, ledger)
}

/// Radius of a site's own receiver over the spacing of sites.
const OWN_RADIUS: f32 = 1.5;

impl Receivers {
    /// Adds receivers that speak for each other's surroundings from now on; their rows, as long as the first, are shot and
    /// resolved here.
    ///
    /// # Panics
    /// When receivers with rows of their own are there already: numbers tell the two kinds apart, these come first.
    fn extend(
        &mut self,
        around: Surroundings<'_>,
        fresh: &[Support],
        seed: u64,
        ledger: &Ledger<'_>,
    ) -> Result<()> {
        let own = self.own.len();
        assert!(own == 0, "receivers are split before sites get rows of their own, but {own} sites have one");
        let rows = self.shoot(around, fresh, RowParams { rays: self.rows.rays, seed }, ledger)?;
        self.rows.append(rows);
        Ok(())
    }

    /// Adds receivers behind all others with rows of another length, always the same; shot and resolved here.
    fn extend_own(
        &mut self,
        around: Surroundings<'_>,
        fresh: &[Support],
        params: RowParams,
        ledger: &Ledger<'_>,
    ) -> Result<()> {
        let rows = self.shoot(around, fresh, params, ledger)?;
        if self.own.is_empty() {
            self.own = rows;
        } else {
            self.own.append(rows);
        }
        Ok(())
    }

    /// Takes in those receivers that are not dead; their rows.
    fn shoot(
        &mut self,
        around: Surroundings<'_>,
        fresh: &[Support],
        params: RowParams,
        ledger: &Ledger<'_>,
    ) -> Result<Rows> {
        let RowParams { rays, seed } = params;
        let points: Vec<SurfacePoint> = fresh.iter().map(|s| s.point).collect();
        let first = self.len() as u64;
        let keys: Vec<u64> = (0..points.len() as u64).map(|k| hash::mix2(seed, first + k)).collect();
        let mut raw = RawRows::new(rays);
        raw.extend((around.scene, around.bvh), (&points, &keys), ledger)?;
        let mut live = RawRows::new(rays);
        for (k, support) in fresh.iter().enumerate() {
            if raw.summaries[k].is_dead(rays) {
                continue;
            }
            live.push(&raw, k);
            self.index.push(*support);
            self.homes.push(around.site_under(&support.point).unwrap_or(SiteId(0)));
        }
        live.resolve(around, ledger)
    }
}

impl Surroundings<'_> {
    /// Point `i` of [`THROWN`] on the surface around another, within a radius; None where the surface ends or is dead.
    fn thrown(&self, centre: &SurfacePoint, radius: f32, (i, key): (u32, u64)) -> Option<SurfacePoint> {
        let [u, v] = hemisphere::fibonacci(i, THROWN, hash::unit_pair(key, 0));
        let (s, t) = tangent_frame(centre.normal);
        let (sin, cos) = (std::f32::consts::TAU * v).sin_cos();
        let offset = (s * cos + t * sin) * (radius * u.sqrt());
        let (hit, at) = self.beside(centre, offset, 0.5 * radius)?;
        let live = matches!(self.cells.site(&hit, hit.back, self.ground()), Said::Site(_));
        (live && at.normal.dot(centre.normal) > SAME_SURFACE).then_some(at)
    }
}
