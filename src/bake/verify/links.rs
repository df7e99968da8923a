//! Invariants of the links: lamps, receivers and their rows, and who speaks for which site.

use glam::Vec3;

use super::archives::Opened;
use super::rows::{self, Tables};
use super::sites::{Sited, is_unit};
use super::{Report, ascending, each};
use crate::bake::report::progress::Stage;
use crate::error::Result;
use crate::light::Rgb;
use crate::links::direct::PENUMBRA;
use crate::links::lamps::tree::Cluster;
use crate::links::lamps::{self, LampTree};
use crate::scene::Scene;

/// What the light is held against; None where it is damaged.
pub(super) struct Linked<'a> {
    /// How many receivers there are.
    pub receivers: Option<usize>,
    /// Links in all rows.
    pub links: Option<u64>,
    pub tables: Option<Tables>,
    /// Per row: hits, Σ 1/t, black, escaped.
    pub sums: Option<&'a [[u32; 4]]>,
    pub lamps: Option<LampLinks<'a>>,
    pub spread: Option<Weights<'a>>,
}

/// Lamp links as they are stored. They were checked, and are looked up with care all the same: another program may write over
/// the file meanwhile.
pub(super) struct LampLinks<'a> {
    tree: LampTree,
    offsets: &'a [u32],
    clusters: &'a [u32],
    factors: &'a [[f32; 2]],
}

/// Interpolation to sites as it is stored; looked up as lamp links are.
pub(super) struct Weights<'a> {
    offsets: &'a [u32],
    receivers: &'a [u32],
    weights: &'a [f32],
}

/// Checks `links.glow`.
pub(super) fn check<'a>(
    file: &'a Opened,
    (scene, sites): (Option<&Scene>, &Sited<'_>),
    report: &mut Report,
    stage: &Stage<'_>,
) -> Result<Linked<'a>> {
    let ids = file.array::<u32>(report, "receiver");
    let count = ids.map(<[u32]>::len);
    if let (Some(ids), Some(n)) = (ids, sites.count) {
        let wanted = format!("sites below {n}");
        file.hold(report, "receiver", each(ids, &wanted, |&s| (s as usize) < n));
    }
    let mut linked =
        Linked { receivers: count, links: None, tables: None, sums: None, lamps: None, spread: None };
    if let Some(n) = sites.count {
        linked.lamps = scene.and_then(|scene| lamp_links(file, n, scene, report));
        linked.spread = spread(file, (n, count), report);
    }
    let Some(count) = count else { return Ok(linked) };
    points(file, count, report);
    linked.tables = rows::tables(file, count, report);
    linked.sums = file.sized::<[u32; 4]>(report, "row_sums", count);
    if let (Some(tables), Some(sums)) = (linked.tables, linked.sums) {
        file.hold(report, "row_sums", rows::sums(&tables, sums));
    }
    linked.links = rows::check(file, linked.tables, (linked.sums, sites.positions), report, stage)?;
    Ok(linked)
}

fn points(file: &Opened, count: usize, report: &mut Report) {
    if let Some(radii) = file.sized::<f32>(report, "radius", count) {
        file.hold(report, "radius", each(radii, "finite radii above 0", |r| r.is_finite() && *r > 0.0));
    }
    if let Some(points) = file.sized::<[Vec3; 2]>(report, "point", count) {
        let placed = |p: &[Vec3; 2]| p[0].is_finite() && is_unit(&p[1]);
        let outcome = each(points, "finite places and unit vectors", placed);
        file.hold(report, "point", outcome);
    }
    file.sized::<u64>(report, "row_key", count);
}

/// A site's clusters follow each other and hold all units of light once.
fn lamp_links<'a>(
    file: &'a Opened,
    sites: usize,
    scene: &Scene,
    report: &mut Report,
) -> Option<LampLinks<'a>> {
    let offsets = file.sized::<u32>(report, "lamp_at", sites + 1);
    let clusters = file.array::<u32>(report, "lamp_to")?;
    let factors = file.sized::<[f32; 2]>(report, "lamp_by", clusters.len())?;
    let offsets = offsets?;
    let tree = LampTree::new(&lamps::split(scene).0);
    let known = each(clusters, &format!("clusters below {}", tree.clusters.len()), |&c| {
        ((c & !PENUMBRA) as usize) < tree.clusters.len()
    });
    let seen = |&[visibility, coupling]: &[f32; 2]| {
        (visibility.is_nan() || (0.0..=1.0).contains(&visibility)) && coupling.is_finite() && coupling >= 0.0
    };
    let within = file.hold(report, "lamp_at", ascending(offsets, clusters.len()));
    let sound = file.hold(report, "lamp_to", known)
        & file.hold(report, "lamp_by", each(factors, "visibility within [0, 1], finite coupling", seen));
    if !(within && sound) {
        return None;
    }
    let lamp_links = LampLinks { tree, offsets, clusters, factors };
    file.hold(report, "lamp_to", lamp_links.cover()).then_some(lamp_links)
}

impl LampLinks<'_> {
    fn of(&self, site: usize) -> std::ops::Range<usize> {
        self.offsets[site] as usize..self.offsets[site + 1] as usize
    }

    fn cluster(&self, link: u32) -> Option<&Cluster> {
        self.tree.clusters.get((link & !PENUMBRA) as usize)
    }

    fn cover(&self) -> Result<(), String> {
        let all = self.tree.units.len() as u32;
        for site in 0..self.offsets.len() - 1 {
            let mut next = 0;
            for &cluster in self.clusters.get(self.of(site)).unwrap_or_default() {
                let Some(units) = self.cluster(cluster).map(|cluster| &cluster.units) else { break };
                if units.start != next {
                    return Err(format!("site {site}: expected light from unit {next} on, got {units:?}"));
                }
                next = units.end;
            }
            if next != all {
                return Err(format!("site {site}: expected light of {all} units, got {next}"));
            }
        }
        Ok(())
    }

    /// Direct irradiance of a site, added up as [`crate::links::direct::Direct::at_site`] does.
    pub(super) fn at(&self, site: usize) -> Rgb {
        let link = |(&cluster, &[visibility, coupling]): (&u32, &[f32; 2])| {
            let seen = Some(visibility * coupling).filter(|v| *v > 0.0);
            self.cluster(cluster).zip(seen).map(|(cluster, v)| cluster.power * v)
        };
        let own = |k: std::ops::Range<usize>| self.clusters.get(k.clone()).zip(self.factors.get(k));
        let (clusters, factors) = own(self.of(site)).unwrap_or_default();
        clusters.iter().zip(factors).filter_map(link).sum()
    }
}

/// Weights are given to fewer than this below nought by rounding.
const BELOW: f32 = -1e-6;

/// Sums of at most 32 weights round by less than this.
const SUM: f32 = 1e-5;

/// Every site's receivers are there, each once, with weights of an average; a site without any has none at all.
fn spread<'a>(
    file: &'a Opened,
    (sites, receivers): (usize, Option<usize>),
    report: &mut Report,
) -> Option<Weights<'a>> {
    let offsets = file.sized::<u32>(report, "fit_at", sites + 1);
    let ids = file.array::<u32>(report, "fit_to")?;
    let weights = file.sized::<f32>(report, "fit_by", ids.len())?;
    let (offsets, receivers) = (offsets?, receivers?);
    let within = file.hold(report, "fit_at", ascending(offsets, ids.len()));
    let wanted = format!("receivers below {receivers}");
    let known = file.hold(report, "fit_to", each(ids, &wanted, |&r| (r as usize) < receivers));
    let finite = |w: &f32| w.is_finite() && *w >= BELOW;
    let sound = file.hold(report, "fit_by", each(weights, "finite weights, not below 0", finite));
    if !(within && known && sound) {
        return None;
    }
    let spread = Weights { offsets, receivers: ids, weights };
    let once = file.hold(report, "fit_to", spread.once());
    (file.hold(report, "fit_by", spread.average()) && once).then_some(spread)
}

impl Weights<'_> {
    fn of(&self, site: usize) -> std::ops::Range<usize> {
        self.offsets[site] as usize..self.offsets[site + 1] as usize
    }

    fn once(&self) -> Result<(), String> {
        let mut own = Vec::new();
        for site in 0..self.offsets.len() - 1 {
            own.clear();
            own.extend_from_slice(self.receivers.get(self.of(site)).unwrap_or_default());
            own.sort_unstable();
            if let Some(pair) = own.windows(2).find(|pair| pair[0] == pair[1]) {
                return Err(format!("site {site} has receiver {} twice", pair[0]));
            }
        }
        Ok(())
    }

    fn average(&self) -> Result<(), String> {
        for site in 0..self.offsets.len() - 1 {
            let own = self.weights.get(self.of(site)).unwrap_or_default();
            let sum: f32 = own.iter().sum();
            if !own.is_empty() && (sum - 1.0).abs() > SUM {
                return Err(format!("site {site}: expected weights that sum to 1, got {sum}"));
            }
        }
        Ok(())
    }

    /// Irradiance at a site, interpolated as the solver does.
    pub(super) fn push(&self, site: usize, irradiance: &[Rgb]) -> Rgb {
        let (receivers, weights) = (self.receivers.get(self.of(site)), self.weights.get(self.of(site)));
        let of = |(&r, &w): (&u32, &f32)| irradiance.get(r as usize).map(|light| *light * w);
        receivers.unwrap_or_default().iter().zip(weights.unwrap_or_default()).filter_map(of).sum()
    }
}
