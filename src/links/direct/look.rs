//! Every site looks at the lamps: a cut of clusters, a few rays each, more in penumbrae.

use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;

use super::{Direct, DirectParams, LampLink};
use crate::geometry::SurfacePoint;
use crate::light::mean_channel;
use crate::links::Surroundings;
use crate::links::lamps::light::{Share, Shares, weight};
use crate::links::lamps::shadow::Shadows;
use crate::links::lamps::{Lamp, LampTree};
use crate::sites::{Samples, SiteId};

/// Visibilities that differ by more than this make a penumbra.
const DIFFERENCE: f32 = 0.02;

/// Penumbrae that hold less than this share of a site's light are none.
const NEGLIGIBLE: f32 = 0.01;

/// Clusters are opened from this share of a site's light on …
const LARGE_SHARE: f32 = 1.0 / 16.0;

/// … unless their radius over distance is at most this: who sees one end of them sees the other.
const COMPACT: f32 = 0.25;

/// Sites of more links than this average the lamps' light over [`FEW_SAMPLES`] of their samples only: each link's error is
/// a small share of the light, and rows average over sites.
const MANY: usize = 8;
const FEW_SAMPLES: usize = 4;

/// What a site first sees, and what is found out about it.
struct Seen {
    link: LampLink,
    /// Of the site's unoccluded light.
    share: f32,
    /// Whether visibility varies within the cluster or to the neighbours.
    edge: bool,
}

/// What looking needs.
struct Look<'a> {
    around: Surroundings<'a>,
    samples: &'a Samples,
    shadows: Shadows<'a>,
    params: &'a DirectParams,
    rays: AtomicU64,
}

impl Direct {
    /// Looks at all lamps from every site.
    ///
    /// Deterministic for any number of threads. Cost: one ray a cluster and site, at least `first` rays a site, and
    /// `penumbra` rays at those in doubt; about 20 B a link and at most some forty links a site.
    pub fn look(around: Surroundings<'_>, samples: &Samples, lamps: &[Lamp], params: &DirectParams) -> Self {
        let tree = LampTree::new(lamps);
        let shadows = Shadows { tree: &tree, lamps, bvh: around.bvh };
        let look = Look { around, samples, shadows, params, rays: AtomicU64::new(0) };
        let sites = around.sites.len();
        let mut seen: Vec<Vec<Seen>> = (0..sites).into_par_iter().map(|s| look.first(s)).collect();
        let edges: Vec<Vec<bool>> = (0..sites).into_par_iter().map(|s| look.edges(&seen, s)).collect();
        seen.par_iter_mut().zip(&edges).for_each(|(s, e)| s.iter_mut().zip(e).for_each(|(s, e)| s.edge = *e));
        let links: Vec<Vec<LampLink>> = (0..sites).into_par_iter().map(|s| look.refined(&seen, s)).collect();
        let rays = look.rays.into_inner();
        let sky = around.scene.sky.as_ref().map(|sky| sky.split().0);
        let mut direct = Self { tree, offsets: vec![0], links: Vec::new(), sky, rays };
        for of_site in links {
            direct.links.extend(of_site);
            direct.offsets.push(direct.links.len() as u32);
        }
        direct
    }
}

impl Look<'_> {
    fn tree(&self) -> &LampTree {
        self.shadows.tree
    }

    fn point(&self, site: usize) -> SurfacePoint {
        self.around.sites.point(SiteId(site as u32))
    }

    /// A site's clusters, with a few rays each.
    fn first(&self, site: usize) -> Vec<Seen> {
        let at = self.point(site);
        let mut light = LightAt::new(self.shadows, at);
        let cut = self.cut(&mut light);
        let total = light.total;
        let coupling = self.couplings(site, &cut);
        let seen = cut.iter().zip(coupling).map(|(&cluster, coupling)| {
            let shares = light.of(cluster);
            let share = weight(shares) / total.max(f32::MIN_POSITIVE);
            let visibility = self.visibility((site, &at), shares, (self.params.first, share));
            Seen { link: LampLink { cluster, visibility, coupling, penumbra: false }, share, edge: false }
        });
        seen.collect()
    }

    /// The clusters that a site links to, in the tree's order.
    fn cut(&self, light: &mut LightAt<'_>) -> Vec<u32> {
        let tree = self.tree();
        let (mut cut, mut c) = (Vec::new(), 0);
        while c < tree.clusters.len() {
            let cluster = &tree.clusters[c];
            let closed = tree.is_leaf(c) || cluster.compact(&light.at, COMPACT);
            if closed || weight(light.of(c as u32)) <= LARGE_SHARE * light.total {
                cut.push(c as u32);
                c = cluster.next as usize;
            } else {
                c += 1;
            }
        }
        cut
    }

    /// Visible share of some light at a site, by its part of `count` rays.
    fn visibility(
        &self,
        (site, at): (usize, &SurfacePoint),
        shares: &[Share],
        (count, share): (u32, f32),
    ) -> f32 {
        let Some(first) = shares.first() else { return f32::NAN };
        let sharp = shares.len() == 1 && first.is_sharp(self.tree(), self.shadows.lamps);
        let count = if sharp { 1 } else { ((count as f32 * share).ceil() as u32).max(1) };
        let shift = self.params.shift(u64::from(first.cluster) << 20, site as u64);
        let verdict = self.shadows.trace(at, shares, count, shift);
        self.rays.fetch_add(u64::from(verdict.rays), Ordering::Relaxed);
        verdict.visibility().unwrap_or(f32::NAN)
    }

    /// Per cluster of the cut the unoccluded light per unit of its power, averaged over what the site stands for.
    fn couplings(&self, site: usize, cut: &[u32]) -> Vec<f32> {
        let points = self.samples.of(site);
        let step = if cut.len() > MANY { points.len().div_ceil(FEW_SAMPLES).max(1) } else { 1 };
        let points: Vec<_> = points.iter().step_by(step).collect();
        let area: f32 = points.iter().map(|p| p.1).sum();
        let mut shares = Shares::new();
        let mut light = |cluster: u32, at: &SurfacePoint| {
            shares.clear();
            self.tree().shares_of(cluster, self.shadows.lamps, at, &mut shares);
            weight(&shares)
        };
        let mean = |cluster: &u32| {
            let power = mean_channel(self.tree().clusters[*cluster as usize].power).max(f32::MIN_POSITIVE);
            if points.is_empty() {
                return light(*cluster, &self.point(site)) / power;
            }
            points.iter().map(|p| light(*cluster, &p.0.point) * (p.1 / area)).sum::<f32>() / power
        };
        cut.iter().map(mean).collect()
    }

    /// Which of a site's clusters are seen in part, or differently by a neighbour.
    fn edges(&self, seen: &[Vec<Seen>], site: usize) -> Vec<bool> {
        let differs = |link: &LampLink, o: usize| {
            self.seen_by(&seen[o], link.cluster)
                .is_some_and(|(v, _)| (v - link.visibility).abs() > DIFFERENCE)
        };
        let edge = |s: &Seen| {
            let v = s.link.visibility;
            (v > 0.0 && v < 1.0) || self.neighbours(site).any(|o| differs(&s.link, o))
        };
        seen[site].iter().map(edge).collect()
    }

    fn neighbours(&self, site: usize) -> impl Iterator<Item = usize> + '_ {
        self.around.graph.of(SiteId(site as u32)).iter().map(|o| *o as usize)
    }

    /// How a site sees a cluster that may not be one of its cut: visibility, and whether any of it is an edge.
    fn seen_by(&self, seen: &[Seen], cluster: u32) -> Option<(f32, bool)> {
        let next = self.tree().clusters[cluster as usize].next;
        let first = seen.partition_point(|s| s.link.cluster < cluster);
        let last = seen.partition_point(|s| s.link.cluster < next);
        if first == last {
            // One cluster above it is in the cut, if any.
            let above = seen[..first].last()?;
            let holds = self.tree().clusters[above.link.cluster as usize].next >= next;
            return holds.then_some((above.link.visibility, above.edge));
        }
        let (mut sum, mut weight, mut edge) = (0.0, 0.0, false);
        for s in seen[first..last].iter().filter(|s| !s.link.visibility.is_nan()) {
            sum += s.link.visibility * s.share;
            weight += s.share;
            edge |= s.edge;
        }
        (weight > 0.0).then(|| (sum / weight, edge))
    }

    /// A site's links: penumbrae found, one ring wider than the edges, and edges looked at again.
    fn refined(&self, seen: &[Vec<Seen>], site: usize) -> Vec<LampLink> {
        // The border runs anywhere between two sites that differ.
        let beside = |s: &Seen| {
            s.edge
                || self.neighbours(site).any(|o| self.seen_by(&seen[o], s.link.cluster).is_some_and(|e| e.1))
        };
        let mut links: Vec<LampLink> =
            seen[site].iter().map(|s| LampLink { penumbra: beside(s), ..s.link }).collect();
        let doubtful = links.iter().zip(&seen[site]).filter(|(l, _)| l.penumbra).map(|(_, s)| s.share);
        if doubtful.sum::<f32>() < NEGLIGIBLE {
            links.iter_mut().for_each(|l| l.penumbra = false);
            return links;
        }
        let at = self.point(site);
        let mut shares = Shares::new();
        for (link, s) in links.iter_mut().zip(&seen[site]).filter(|(l, s)| s.edge && !l.visibility.is_nan()) {
            shares.clear();
            self.tree().shares_of(link.cluster, self.shadows.lamps, &at, &mut shares);
            if !shares.iter().all(|s| s.is_sharp(self.tree(), self.shadows.lamps)) {
                link.visibility = self.visibility((site, &at), &shares, (self.params.penumbra, s.share));
            }
        }
        links
    }
}

/// The unoccluded light at one point, ready to be asked for any cluster.
struct LightAt<'a> {
    shadows: Shadows<'a>,
    at: SurfacePoint,
    /// Of all lamps.
    shares: Shares,
    total: f32,
    /// Of a cluster that lies within one of the shares.
    finer: Shares,
}

impl<'a> LightAt<'a> {
    fn new(shadows: Shadows<'a>, at: SurfacePoint) -> Self {
        let mut shares = Shares::new();
        shadows.tree.shares(shadows.lamps, &at, &mut shares);
        let total = weight(&shares);
        Self { shadows, at, shares, total, finer: Shares::new() }
    }

    fn of(&mut self, cluster: u32) -> &[Share] {
        let tree = self.shadows.tree;
        let next = tree.clusters[cluster as usize].next;
        let first = self.shares.partition_point(|s| s.cluster < cluster);
        let last = self.shares.partition_point(|s| s.cluster < next);
        let above = self.shares[..first].last().map(|s| tree.clusters[s.cluster as usize].next);
        if first < last || above.is_none_or(|end| end <= cluster) {
            return &self.shares[first..last];
        }
        self.finer.clear();
        tree.shares_of(cluster, self.shadows.lamps, &self.at, &mut self.finer);
        &self.finer
    }
}
