//! Which receivers speak for each site, and by which weights.

use std::ops::Range;

use rayon::prelude::*;

use super::Surroundings;
use super::receivers::Receivers;
use crate::archive::{Ledger, One, Tag};
use crate::basis::{Basis, shepard};
use crate::error::Result;
use crate::geometry::SurfacePoint;
use crate::sites::SiteId;
use crate::sites::neighbours::mutually_visible;
use crate::tree::index::{REACH, SupportIndex};
use crate::tree::mls::{self, Sign};

/// Interpolation from receivers to sites: for each site the receivers it sees, and non-negative weights.
#[derive(Debug, Clone, Default)]
pub struct Spread {
    /// Sites + 1 offsets into the other two.
    pub offsets: Vec<u32>,
    /// Receiver numbers, nearest first.
    pub receivers: Vec<u32>,
    /// Their weights; non-negative, summing to one over a site with any.
    pub weights: Vec<f32>,
    /// Visibility rays traced.
    pub rays: u64,
    /// What the weights are of: Franke and Little's, or non-negative linear fits for every other basis. Cardinal functions of
    /// the radial bases change sign and do not sum to one: light that they push would not keep its energy.
    pub basis: Basis,
}

impl Spread {
    /// Finds every site's receivers by visibility and fits their weights.
    ///
    /// `means` are the mean points and mean normals of the surface that each site stands for: light is near to linear in
    /// both, so that a fit there is the mean over the surface.
    ///
    /// # Errors
    /// The ledger's.
    pub fn fit(
        around: Surroundings<'_>,
        (receivers, means): (&Receivers, &[SurfacePoint]),
        basis: Basis,
        ledger: &Ledger<'_>,
    ) -> Result<Self> {
        let mut spread = Self { offsets: vec![0; around.sites.len() + 1], basis, ..Self::default() };
        spread.refit(around, (receivers, means), |_| true, ledger)?;
        Ok(spread)
    }

    /// Finds and fits anew the sites that the receivers from number `first` on reach.
    ///
    /// # Errors
    /// The ledger's.
    pub fn update(
        &mut self,
        around: Surroundings<'_>,
        (receivers, means): (&Receivers, &[SurfacePoint]),
        first: usize,
        ledger: &Ledger<'_>,
    ) -> Result<()> {
        let fresh = SupportIndex::new(&receivers.index.supports()[first..]);
        let stale = |site| {
            let mut reached = false;
            fresh.for_each(&around.sites.point(SiteId(site as u32)), REACH, |_, _| reached = true);
            reached
        };
        self.refit(around, (receivers, means), stale, ledger)
    }

    fn refit(
        &mut self,
        around: Surroundings<'_>,
        (receivers, means): (&Receivers, &[SurfacePoint]),
        stale: impl Fn(usize) -> bool + Sync,
        ledger: &Ledger<'_>,
    ) -> Result<()> {
        let basis = self.basis;
        let fit = |sites: Range<usize>| {
            let one = |found: &mut Vec<(f32, u32)>, site: usize| {
                let place = (SiteId(site as u32), &means[site], basis);
                stale(site).then(|| fit_site(around, receivers, place, found))
            };
            let fits = sites.into_par_iter().with_min_len(64).map_init(Vec::new, one);
            Ok(gathered(&fits.collect::<Vec<_>>()))
        };
        let mut spread = Self { offsets: vec![0], rays: self.rays, basis, ..Self::default() };
        let take =
            |(counts, ids, weights, One(rays)): Fits| spread.append(self, &counts, (&ids, &weights, rays));
        ledger.blocks(Tag::new("spread"), (around.sites.len(), FITTED_BLOCK), fit, take)?;
        *self = spread;
        Ok(())
    }

    /// Appends the sites that follow: fitted ones, or those of before that are not stale.
    fn append(&mut self, before: &Self, counts: &[u32], (ids, weights, rays): (&[u32], &[f32], u64)) {
        let mut next = 0;
        for &count in counts {
            if count == UNCHANGED {
                let site = self.offsets.len() - 1;
                self.receivers.extend_from_slice(before.receivers_of(site));
                self.weights.extend_from_slice(before.weights_of(site));
            } else {
                let range = next..next + count as usize;
                self.receivers.extend_from_slice(&ids[range.clone()]);
                self.weights.extend_from_slice(&weights[range.clone()]);
                next = range.end;
            }
            self.offsets.push(self.receivers.len() as u32);
        }
        self.rays += rays;
    }

    /// The receivers a site sees.
    pub fn receivers_of(&self, site: usize) -> &[u32] {
        &self.receivers[self.offsets[site] as usize..self.offsets[site + 1] as usize]
    }

    /// The weights of those receivers at the site.
    pub fn weights_of(&self, site: usize) -> &[f32] {
        &self.weights[self.offsets[site] as usize..self.offsets[site + 1] as usize]
    }
}

/// Receivers that a site sees, their weights, visibility rays.
type SiteFit = (Vec<u32>, Vec<f32>, u64);

/// Sites of a block: their visibility rays take a fraction of a second.
const FITTED_BLOCK: usize = 1 << 14;

/// In place of a count: the site is not stale.
const UNCHANGED: u32 = u32::MAX;

/// The fits of some sites: how many receivers each, receivers, weights, visibility rays.
type Fits = (Vec<u32>, Vec<u32>, Vec<f32>, One<u64>);

/// The fits of some sites as arrays; None is not stale.
fn gathered(fits: &[Option<SiteFit>]) -> Fits {
    let some = || fits.iter().flatten();
    (
        fits.iter().map(|fit| fit.as_ref().map_or(UNCHANGED, |fit| fit.0.len() as u32)).collect(),
        some().flat_map(|fit| &fit.0).copied().collect(),
        some().flat_map(|fit| &fit.1).copied().collect(),
        One(some().map(|fit| fit.2).sum()),
    )
}

/// How many receivers a site lists: points around it fit the nearest of them.
const LISTED: usize = 32;

fn fit_site(
    around: Surroundings<'_>,
    receivers: &Receivers,
    (site, mean, basis): (SiteId, &SurfacePoint, Basis),
    found: &mut Vec<(f32, u32)>,
) -> SiteFit {
    let at = around.sites.point(site);
    receivers.index.nearest(&at, REACH, found);
    let mut rays = 0;
    let mut ids = Vec::with_capacity(LISTED);
    let mut supports = Vec::with_capacity(LISTED);
    for (_, id) in found.iter() {
        let support = receivers.index.supports()[*id as usize];
        rays += 1;
        if mutually_visible(at, support.point, receivers.lift, around.bvh) {
            ids.push(*id);
            supports.push(support);
            if ids.len() == LISTED {
                break;
            }
        }
    }
    let weights = match basis {
        Basis::Shepard => shepard::weights(mean, &supports),
        _ => mls::weights(mean, &supports, Sign::NonNegative),
    };
    if weights.is_empty() {
        ids.clear();
    }
    (ids, weights.to_vec(), rays)
}
