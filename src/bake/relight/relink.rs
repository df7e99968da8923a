//! Lamps that are new, moved, or were black when they were looked at: links for them alone, the others' are kept.

use std::ops::Range;

use crate::archive::Ledger;
use crate::bake::model::Model;
use crate::bake::work::look;
use crate::error::Result;
use crate::light::mean_channel;
use crate::links::Surroundings;
use crate::links::direct::{Direct, LampLink};
use crate::links::lamps::tree::MOST_APART;
use crate::links::lamps::{Lamp, LampTree};
use crate::sites::{Samples, Sites};

/// A lamp that is wanted.
pub(super) struct Wanted {
    /// With its strength.
    pub lamp: Lamp,
    /// The same lamp among those of the model, if its links are known.
    pub known: Option<usize>,
}

impl Wanted {
    fn is_lit(&self) -> bool {
        mean_channel(self.lamp.strength) > 0.0
    }

    /// Whether rays must find out who sees it.
    pub fn is_new(&self) -> bool {
        self.known.is_none() && self.is_lit()
    }
}

/// Takes over other lamps. Returns the rays traced, and for each lamp whether its links are known.
///
/// Cost: the rays of a bake's lamp links, for what is new; beyond [`MOST_APART`] lamps for all.
///
/// # Errors
/// What `ledger` says.
pub(super) fn relink(
    model: &mut Model,
    wanted: &[Wanted],
    (sites, samples): (&Sites, &Samples),
    ledger: &Ledger<'_>,
) -> Result<(u64, Vec<bool>)> {
    let apart = model.lamps.len().max(wanted.len()) <= MOST_APART;
    let asked: Vec<usize> = (0..wanted.len()).filter(|&k| wanted[k].is_new() || !apart).collect();
    let looked_at: Vec<Lamp> = asked.iter().map(|&k| wanted[k].lamp.clone()).collect();
    // Sites lie on proxies where there are any, and see through them alone.
    let near = model.bvh.swap_near(None);
    let Model { scene, bvh, graph, cells, .. } = &*model;
    let around = Surroundings { scene, bvh, sites, graph, cells };
    let found = look(around, (samples, &looked_at), &model.field.direct, ledger);
    model.bvh.swap_near(near);
    let (looked, rays) = found?;
    let place = |k: usize| asked.iter().position(|&a| a == k);
    let known = |k: usize| place(k).is_some() || (apart && wanted[k].known.is_some());
    let linked: Vec<bool> = (0..wanted.len()).map(known).collect();
    if apart {
        let before = trees(&model.direct.tree, model.lamps.len());
        let fresh = trees(&looked.tree, looked_at.len());
        let lamps: Vec<Lamp> = wanted.iter().map(|w| w.lamp.clone()).collect();
        let tree = LampTree::new(&lamps);
        let origin = |k: usize| match (place(k), wanted[k].known) {
            (Some(new), _) => Some((&looked, fresh[new].clone())),
            (None, Some(old)) => Some((&model.direct, before[old].clone())),
            (None, None) => None,
        };
        let origins: Vec<_> = (0..lamps.len()).map(origin).collect();
        let (offsets, links) = merged(&origins, &trees(&tree, lamps.len()), sites.len());
        model.direct = Direct { tree, offsets, links, sky: None, rays };
        model.lamps = lamps;
        return Ok((rays, linked));
    }
    // Many lamps share clusters: all are looked at.
    model.direct = looked;
    model.lamps = looked_at;
    Ok((rays, wanted.iter().map(Wanted::is_lit).collect()))
}

/// The clusters of each lamp's own tree; none for lamps without parts.
fn trees(tree: &LampTree, lamps: usize) -> Vec<Range<u32>> {
    let mut ranges = vec![0..0; lamps];
    for &root in &tree.roots {
        let cluster = &tree.clusters[root as usize];
        let lamp = tree.units[cluster.units.start as usize].lamp as usize;
        ranges[lamp] = root..cluster.next;
    }
    ranges
}

/// The links of all sites, lamp by lamp from where they are known, numbered as the clusters are now.
fn merged(
    origins: &[Option<(&Direct, Range<u32>)>],
    trees: &[Range<u32>],
    sites: usize,
) -> (Vec<u32>, Vec<LampLink>) {
    let (mut offsets, mut links) = (vec![0], Vec::new());
    for site in 0..sites {
        for (origin, tree) in origins.iter().zip(trees) {
            let Some((direct, range)) = origin else { continue };
            assert_eq!(range.len(), tree.len(), "a lamp's clusters are the same wherever they stand");
            let all = direct.of(site);
            let first = all.partition_point(|link| link.cluster < range.start);
            let own = all[first..].iter().take_while(|link| link.cluster < range.end);
            links.extend(
                own.map(|link| LampLink { cluster: link.cluster - range.start + tree.start, ..*link }),
            );
        }
        offsets.push(links.len() as u32);
    }
    (offsets, links)
}
