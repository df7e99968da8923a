//! Shadow rays: how much of the lamps' light arrives, by rays in proportion to what each cluster would send.
//!
//! Visibility is a ratio, Σ k v / Σ k over points of a lattice that is spread over the light at hand: the form factors
//! are known (nearly) exactly, so that rays only decide about shadows.

use glam::Vec3;

use super::light::{Share, Shares, weight};
use super::tree::{LampTree, Unit};
use super::{Lamp, Shape, beam};
use crate::geometry::{LIFT, SurfacePoint, hemisphere};
use crate::light::{Rgb, mean_channel};
use crate::rays::{Bvh, Ray};
use crate::scene::LampKind;

/// What rays of one point need.
#[derive(Clone, Copy)]
pub struct Shadows<'a> {
    /// Lamps and their clusters.
    pub tree: &'a LampTree,
    /// The same that the tree was made of.
    pub lamps: &'a [Lamp],
    /// What casts the shadows.
    pub bvh: &'a Bvh,
}

/// What the shadow rays of one bundle found.
#[derive(Debug, Clone, Copy, Default)]
pub struct Verdict {
    /// Light of the samples that could be seen from the point but for obstacles.
    pub all: Rgb,
    /// That of those that were.
    pub seen: Rgb,
    /// Rays traced.
    pub rays: u32,
}

impl Verdict {
    /// The visible share, by mean channel; None when no sample could be seen.
    pub fn visibility(&self) -> Option<f32> {
        let all = mean_channel(self.all);
        (all > 0.0).then(|| mean_channel(self.seen) / all)
    }

    /// What is left of some light, by channel; by the mean channel where no sample has any of a channel.
    pub fn dim(&self, light: Rgb) -> Rgb {
        let Some(mean) = self.visibility() else { return Rgb::ZERO };
        let ratio = |k: usize| if self.all[k] > 0.0 { self.seen[k] / self.all[k] } else { mean };
        light * Rgb::new(ratio(0), ratio(1), ratio(2))
    }
}

impl Shadows<'_> {
    /// Traces `count` rays to points spread over the shares in proportion to their light; `shift` decorrelates points.
    pub fn trace(&self, at: &SurfacePoint, shares: &[Share], count: u32, shift: [f32; 2]) -> Verdict {
        let total = weight(shares);
        let mut verdict = Verdict::default();
        if total <= 0.0 {
            return verdict;
        }
        let (mut k, mut before) = (0, 0.0);
        for i in 0..count {
            let [x, y] = hemisphere::fibonacci(i, count, shift);
            let want = x * total;
            while k + 1 < shares.len() && before + shares[k].weight <= want {
                before += shares[k].weight;
                k += 1;
            }
            let rest = ((want - before) / shares[k].weight).clamp(0.0, 0.999_999);
            let (light, ray) = self.sample(at, &shares[k], [rest, y]);
            if light.max_element() > 0.0 {
                verdict.rays += 1;
                verdict.all += light;
                if !self.bvh.occluded_fine(&ray) {
                    verdict.seen += light;
                }
            }
        }
        verdict
    }

    /// What arrives of a punctual light's share, by its one ray.
    pub fn one(&self, at: &SurfacePoint, share: &Share) -> Rgb {
        let (_, ray) = self.sample(at, share, [0.5, 0.5]);
        if self.bvh.occluded_fine(&ray) { Rgb::ZERO } else { share.light }
    }

    /// Whether any of a few rays finds any lamp.
    pub fn reach(&self, at: &SurfacePoint) -> bool {
        let mut shares = Shares::new();
        self.tree.shares(self.lamps, at, &mut shares);
        mean_channel(self.trace(at, &shares, 16, [0.5, 0.5]).seen) > 0.0
    }

    /// The light of one sample of a share over its density there, and the ray that must be free for it.
    fn sample(&self, at: &SurfacePoint, share: &Share, [x, y]: [f32; 2]) -> (Rgb, Ray) {
        let (unit, rest, power) = match share.unit {
            Some(unit) => (self.tree.units[unit as usize], x, None),
            None => {
                let (unit, rest) = self.pick(share.cluster as usize, x);
                (unit, rest, Some(mean_channel(self.tree.clusters[share.cluster as usize].power)))
            }
        };
        let own = unit.power(self.lamps);
        let (kernel, ray) = aim(at, &self.lamps[unit.lamp as usize].shape, unit, [rest, y]);
        // Units of a cluster are drawn by power: what they send is the kernel times the cluster's.
        let power = power.unwrap_or(mean_channel(own));
        (own * (kernel * power / (share.weight * mean_channel(own).max(f32::MIN_POSITIVE))), ray)
    }

    /// The unit of a cluster at a number in [0, 1), drawn by power, and where in its interval the number fell.
    fn pick(&self, cluster: usize, x: f32) -> (Unit, f32) {
        let tree = self.tree;
        let power = |c: usize| mean_channel(tree.clusters[c].power);
        let (mut c, mut rest) = (cluster, x);
        while !tree.is_leaf(c) {
            let (left, right) = (c + 1, tree.clusters[c + 1].next as usize);
            let part = power(left) / (power(left) + power(right)).max(f32::MIN_POSITIVE);
            (c, rest) = narrow(rest, part, left, right);
        }
        let units = tree.units_of(c);
        let amount = |u: &Unit| mean_channel(u.power(self.lamps));
        let mut left: f32 = units.iter().map(amount).sum();
        for unit in &units[..units.len() - 1] {
            let part = amount(unit) / left.max(f32::MIN_POSITIVE);
            left -= amount(unit);
            let (here, inner) = narrow(rest, part, true, false);
            rest = inner;
            if here {
                return (*unit, rest);
            }
        }
        (units[units.len() - 1], rest)
    }
}

/// Takes the first with probability `part`, and stretches the number over the choice made.
fn narrow<T>(x: f32, part: f32, first: T, second: T) -> (T, f32) {
    let (choice, inner) =
        if x < part { (first, x / part) } else { (second, (x - part) / (1.0 - part).max(f32::MIN_POSITIVE)) };
    (choice, inner.clamp(0.0, 0.999_999))
}

/// Kernel and shadow ray of a point of a unit.
fn aim(at: &SurfacePoint, shape: &Shape, unit: Unit, numbers: [f32; 2]) -> (f32, Ray) {
    match shape {
        Shape::Emitter(emitter) => {
            let face = &emitter.faces[unit.part as usize];
            let target = face.point(numbers);
            (face.kernel(at, target), Ray::between(at.lifted(), target + face.normal * LIFT))
        }
        Shape::Sky(bright) => {
            let direction = bright.within(&bright.texels[unit.part as usize], numbers);
            (direction.dot(at.normal).max(0.0), Ray::new(at.lifted(), direction))
        }
        Shape::Punctual(kind) => (beam(kind, at), punctual_ray(kind, at)),
    }
}

/// The one ray that decides over a punctual light.
fn punctual_ray(kind: &LampKind, at: &SurfacePoint) -> Ray {
    let end: Vec3 = match kind {
        LampKind::Point { position, .. } | LampKind::Spot { position, .. } => *position,
        LampKind::Sun { direction, .. } => return Ray::new(at.lifted(), -*direction),
    };
    Ray::between(at.lifted(), end)
}
