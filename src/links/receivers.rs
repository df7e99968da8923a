//! Receivers: the few sites that carry rows of their own, as dense as the light's variation asks.
//!
//! This work is based on: Ward, Rubinstein and Clear, "A Ray Tracing Solution for Diffuse Interreflection", 1988, and
//! Tabellion and Lamorlette 2004 (clamping the harmonic mean). We divide by the rays that hit, not by all: in open
//! scenes escaped rays would otherwise inflate the radius of surfaces that are close to others.

use rayon::prelude::*;

use super::Surroundings;
use super::rows::{RowParams, Rows};
use crate::geometry::{SurfacePoint, hash};
use crate::sites::SiteId;
use crate::tree::Support;
use crate::tree::index::{REACH, SupportIndex};
use crate::tree::mls::{self, Sign};

/// How receivers are chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReceiverParams {
    /// Validity radius over harmonic mean distance.
    pub factor: f32,
    /// Upper limit of the validity radius, local units.
    pub largest_radius: f32,
    /// Their rows.
    pub rows: RowParams,
}

/// How many of the nearest supports are asked for visibility before a point counts as uncovered.
const MOST_ASKED: usize = 12;

/// The receivers, their rows, and the index that finds them.
#[derive(Default)]
pub struct Receivers {
    /// The site each sits on.
    pub sites: Vec<SiteId>,
    /// Their points and radii, numbered alike.
    pub index: SupportIndex,
    /// Their rows, numbered alike.
    pub rows: Rows,
    /// Sites that sit inside solids: they see backs, reflect nothing and are never interpolated from.
    pub dead: Vec<SiteId>,
    /// Rays traced for rows and visibility.
    pub rays: u64,
}

impl Receivers {
    /// Places receivers until every live site is covered by one that it sees.
    pub fn place(around: Surroundings<'_>, params: &ReceiverParams) -> Self {
        let mut receivers = Self { rows: Rows::new(params.rows.rays), ..Self::default() };
        let order = visiting_order(around, params.rows.seed);
        receivers.cover(around, params, &order);
        receivers
    }

    /// How many receivers there are.
    pub fn len(&self) -> usize {
        self.sites.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.sites.is_empty()
    }

    /// Visits sites in order, in batches: the uncovered ones of a batch that do not crowd each other get rows.
    fn cover(&mut self, around: Surroundings<'_>, params: &ReceiverParams, order: &[SiteId]) {
        let mut waiting: Vec<SiteId> = Vec::new();
        let mut rest = order;
        let mut size = 32;
        while !rest.is_empty() || !waiting.is_empty() {
            let (now, later) = rest.split_at(size.min(rest.len()));
            rest = later;
            waiting.extend_from_slice(now);
            let (uncovered, rays) = self.uncovered(around, &waiting);
            self.rays += rays;
            let (chosen, postponed) = self.choose(around, &uncovered);
            waiting = postponed;
            self.shoot(around, params, &chosen);
            size = (self.len() / 2).max(64);
        }
    }

    /// The sites of a batch that no receiver covers, and the rays it took to tell.
    fn uncovered(&self, around: Surroundings<'_>, batch: &[SiteId]) -> (Vec<SiteId>, u64) {
        let answers: Vec<(bool, u64)> = batch
            .par_iter()
            .map_init(Vec::new, |found, site| {
                let at = around.sites.point(*site);
                self.index.nearest(&at, 1.0, found);
                let mut rays = 0;
                let covered = found.iter().take(MOST_ASKED).any(|(_, id)| {
                    rays += 1;
                    around.mutually_visible(&at, &self.index.supports()[*id as usize].point)
                });
                (covered, rays)
            })
            .collect();
        let rays = answers.iter().map(|a| a.1).sum();
        (batch.iter().zip(&answers).filter(|(_, a)| !a.0).map(|(s, _)| *s).collect(), rays)
    }

    /// Of uncovered sites, those that can get rows at once, and those that wait for their neighbours' radii.
    fn choose(&self, around: Surroundings<'_>, uncovered: &[SiteId]) -> (Vec<SiteId>, Vec<SiteId>) {
        let guess = |at: &SurfacePoint| {
            let mut best = (f32::INFINITY, around.sites.spacing);
            self.index.for_each(at, REACH, |id, distance| {
                if distance < best.0 {
                    best = (distance, self.index.supports()[id as usize].radius);
                }
            });
            best.1
        };
        let points: Vec<Support> = uncovered
            .par_iter()
            .map(|s| {
                let point = around.sites.point(*s);
                Support { point, radius: guess(&point) }
            })
            .collect();
        let mut taken = SupportIndex::default();
        let (mut chosen, mut postponed) = (Vec::new(), Vec::new());
        for (site, support) in uncovered.iter().zip(&points) {
            let mut crowded = false;
            taken.for_each(&support.point, 1.0, |_, _| crowded = true);
            if crowded {
                postponed.push(*site);
            } else {
                chosen.push(*site);
                taken.push(*support);
            }
        }
        (chosen, postponed)
    }

    /// Gives rows to sites; those that turn out to sit inside solids are put aside.
    fn shoot(&mut self, around: Surroundings<'_>, params: &ReceiverParams, chosen: &[SiteId]) {
        let points: Vec<SurfacePoint> = chosen.iter().map(|s| around.sites.point(*s)).collect();
        let keys: Vec<u64> = chosen.iter().map(|s| hash::mix2(params.rows.seed, u64::from(s.0))).collect();
        let mut fresh = Rows::new(params.rows.rays);
        fresh.extend(around, &points, &keys);
        self.rays += (chosen.len() * params.rows.rays as usize) as u64;
        for (k, site) in chosen.iter().enumerate() {
            if fresh.summaries[k].is_dead(params.rows.rays) {
                self.dead.push(*site);
                continue;
            }
            let wanted = params.factor * fresh.summaries[k].harmonic_distance();
            let radius = wanted.min(params.largest_radius).max(around.sites.spacing);
            self.sites.push(*site);
            self.index.push(Support { point: points[k], radius });
            self.rows.keys.push(keys[k]);
            self.rows.summaries.push(fresh.summaries[k]);
            self.rows.met.extend_from_slice(fresh.row(k));
        }
    }
}

/// Coarse levels first, each in hashed order: a blue-noise order at every prefix.
fn visiting_order(around: Surroundings<'_>, seed: u64) -> Vec<SiteId> {
    let mut order: Vec<(u8, u64, u32)> = (0..around.sites.len())
        .map(|s| (around.sites.levels[s], hash::mix2(seed ^ 0x0bde, s as u64), s as u32))
        .collect();
    order.par_sort_unstable();
    order.into_iter().map(|(_, _, s)| SiteId(s)).collect()
}

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
}

impl Spread {
    /// Finds every site's receivers by visibility and fits their weights.
    pub fn fit(around: Surroundings<'_>, receivers: &Receivers) -> Self {
        let fits: Vec<(Vec<u32>, Vec<f32>, u64)> = (0..around.sites.len())
            .into_par_iter()
            .map_init(Vec::new, |found, site| fit_site(around, receivers, SiteId(site as u32), found))
            .collect();
        let mut spread = Self { offsets: vec![0], ..Self::default() };
        for (ids, weights, rays) in fits {
            spread.receivers.extend_from_slice(&ids);
            spread.weights.extend_from_slice(&weights);
            spread.offsets.push(spread.receivers.len() as u32);
            spread.rays += rays;
        }
        spread
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

fn fit_site(
    around: Surroundings<'_>,
    receivers: &Receivers,
    site: SiteId,
    found: &mut Vec<(f32, u32)>,
) -> (Vec<u32>, Vec<f32>, u64) {
    let at = around.sites.point(site);
    receivers.index.nearest(&at, REACH, found);
    let mut rays = 0;
    let mut ids = Vec::with_capacity(mls::MOST);
    let mut supports = Vec::with_capacity(mls::MOST);
    for (_, id) in found.iter() {
        let support = receivers.index.supports()[*id as usize];
        rays += 1;
        if around.mutually_visible(&at, &support.point) {
            ids.push(*id);
            supports.push(support);
            if ids.len() == mls::MOST {
                break;
            }
        }
    }
    let weights = mls::weights(&at, &supports, Sign::NonNegative);
    if weights.is_empty() {
        ids.clear();
    }
    (ids, weights.to_vec(), rays)
}
