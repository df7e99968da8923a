//! Direct light at any point: what its site knows, and rays of its own where that is in doubt.

use smallvec::SmallVec;

use super::{Direct, DirectParams, LampLink, Query};
use crate::geometry::SurfacePoint;
use crate::light::{Rgb, mean_channel};
use crate::links::lamps::Lamp;
use crate::links::lamps::light::{Share, Shares, weight};
use crate::links::lamps::shadow::Shadows;
use crate::rays::Bvh;

/// Punctual lights of at least this share of a point's light get a ray each, wherever the site is sure: shadows jump.
const SHARP_SHARE: f32 = 0.02;

/// Rays are per source; more sources than these share the rays of as many, and none of them matters by itself.
const MOST_SOURCES: f32 = 4.0;

/// The light at a point whose visibility only rays can tell.
#[derive(Default)]
struct Doubtful {
    /// Its parts but for sharp ones.
    soft: Shares,
    /// Whether a penumbra is known to be here.
    penumbra: bool,
    /// Σ w² over the clusters, for the number of sources.
    squares: f32,
}

impl Direct {
    /// Direct irradiance at a point if nothing stood in the way of the lamps.
    ///
    /// Cost: the form factors of the clusters that the point tells apart.
    pub fn open_at(&self, lamps: &[Lamp], point: &SurfacePoint) -> Rgb {
        let mut shares = Shares::new();
        self.tree.shares(lamps, point, &mut shares);
        shares.iter().map(|share| share.light).sum()
    }

    /// Direct irradiance at any point, given the site that speaks for it; `key` decorrelates the shadow rays.
    ///
    /// Cost: the form factors of the clusters that the point tells apart, `first` to `penumbra` rays where the site is
    /// in doubt, and one ray for each punctual light that matters.
    pub fn at_point(&self, bvh: &Bvh, lamps: &[Lamp], params: &DirectParams, query: &Query) -> Rgb {
        let links = query.site.map_or(&[][..], |site| self.of(site as usize));
        // As fine as the site's links at least: each has its own visibility.
        let (mut shares, mut ends) = (Shares::new(), SmallVec::<[usize; 32]>::new());
        for link in links {
            self.tree.shares_of(link.cluster, lamps, &query.point, &mut shares);
            ends.push(shares.len());
        }
        if links.is_empty() {
            for &root in &self.tree.roots {
                self.tree.shares_of(root, lamps, &query.point, &mut shares);
                ends.push(shares.len());
            }
        }
        if shares.is_empty() {
            return Rgb::ZERO;
        }
        let shadows = Shadows { tree: &self.tree, lamps, bvh };
        let total = weight(&shares);
        let mut doubtful = Doubtful::default();
        let mut sum = Rgb::ZERO;
        let mut sort = |shares: &[Share], link: Option<&LampLink>| {
            let known = link.filter(|l| !query.rugged && !l.penumbra && !l.visibility.is_nan());
            let mut own = 0.0;
            for share in shares {
                let sharp = share.weight >= SHARP_SHARE * total && share.is_sharp(&self.tree, lamps);
                match known {
                    _ if sharp => sum += shadows.one(&query.point, share),
                    Some(link) => sum += share.light * link.visibility,
                    None => {
                        own += share.weight;
                        doubtful.soft.push(*share);
                    }
                }
            }
            doubtful.squares += own * own;
            doubtful.penumbra |= own > 0.0 && link.is_none_or(|l| l.penumbra);
        };
        let mut start = 0;
        for (k, &end) in ends.iter().enumerate() {
            sort(&shares[start..end], links.get(k));
            start = end;
        }
        let shift = params.shift(0x5eed, query.key);
        sum + doubtful.settle(&shadows, query, (params, total, shift))
    }
}

impl Doubtful {
    /// All rays where a penumbra is known, else a few and more only if they disagree.
    fn settle(
        &self,
        shadows: &Shadows<'_>,
        query: &Query,
        (params, total, shift): (&DirectParams, f32, [f32; 2]),
    ) -> Rgb {
        let own = weight(&self.soft);
        if own <= 0.0 {
            return Rgb::ZERO;
        }
        let light: Rgb = self.soft.iter().map(|s| s.light).sum();
        let sources = (own * own / self.squares.max(f32::MIN_POSITIVE)).clamp(1.0, MOST_SOURCES);
        let part = |count: u32| ((count as f32 * own / total).ceil() as u32).max(1);
        if !self.penumbra {
            let first =
                shadows.trace(&query.point, &self.soft, part((params.first as f32 * sources) as u32), shift);
            if first.all == first.seen || mean_channel(first.seen) == 0.0 {
                return first.dim(light);
            }
        }
        let count = part((params.penumbra as f32 * sources) as u32);
        shadows.trace(&query.point, &self.soft, count, shift).dim(light)
    }
}
