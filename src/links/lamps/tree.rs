//! The lamps' parts in a tree of clusters, so that far ones are seen as one.
//!
//! This work is based on: Walter et al., "Lightcuts: A Scalable Approach to Illumination", SIGGRAPH 2005 (clusters cut by
//! what they contribute), and Conty Estevez and Kulla, "Importance Sampling of Many Lights with Adaptive Tree
//! Splitting", HPG 2018 (bounding cones of normals). We keep each cluster's light as a sum of vectors, which is exact
//! for any mixture of orientations and colours as long as all members face the receiver; of the others, see `light`.

use std::ops::Range;

use glam::{Mat3, Vec3};

use super::{Lamp, Shape, beam, texel_light};
use crate::geometry::SurfacePoint;
use crate::light::{Rgb, mean_channel};
use crate::scene::LampKind;

/// Up to this many lamps are never merged: each keeps its own visibility, so relighting it is exact.
pub const MOST_APART: usize = 16;

/// At most this many faces make a leaf.
const LEAF: usize = 4;

/// Clusters whose normals fill a box longer than this are split by normals, others by position.
const NORMAL_SPREAD: f32 = 0.9;

/// The smallest thing that gives light: a face of an emitter, or a punctual lamp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unit {
    /// Index of the lamp.
    pub lamp: u32,
    /// Index of the part within the lamp.
    pub part: u32,
}

/// How a cluster's members send light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// From faces.
    Surface,
    /// From points, falling off with the distance.
    Beam,
    /// From infinitely far; positions are unit vectors towards the source.
    Distant,
}

/// Some units seen as one.
#[derive(Debug, Clone)]
pub struct Cluster {
    /// How they send light; the same for all.
    pub kind: Kind,
    /// Centre of a sphere about them.
    pub centre: Vec3,
    /// Its radius.
    pub radius: f32,
    /// Axis of a cone about the faces' normals.
    pub axis: Vec3,
    /// Cosine of the cone's half-angle; −1 if they look everywhere.
    pub cosine: f32,
    /// Their places in [`LampTree::units`].
    pub units: Range<u32>,
    /// The cluster after this one's descendants, all of which lie between.
    pub next: u32,
    /// Whether they must be seen one by one: spots, whose light depends on the direction.
    pub narrow: bool,
    /// Mean position, by power.
    pub focus: Vec3,
    /// Mean squared distance from there, by power.
    pub spread: f32,
    /// Σ power · normal ⊗ offset from the focus, mean channel: of a convex surface, normals lean the way they lie.
    pub lean: Mat3,
    /// Σ strength · area ⊗ normal of faces, Σ strength ⊗ direction of distant lights.
    pub flow: Mat3,
    /// Σ strength · area of faces, Σ strength of others.
    pub power: Rgb,
}

/// All lamps' units and the clusters over them, parents before children.
#[derive(Debug, Clone, Default)]
pub struct LampTree {
    /// In the clusters' order.
    pub units: Vec<Unit>,
    /// Preorder; one tree per lamp, or per kind where there are many.
    pub clusters: Vec<Cluster>,
    /// The trees' roots.
    pub roots: Vec<u32>,
    /// Mean channel of the power of all.
    pub power: f32,
}

/// A unit while the tree grows.
struct Item {
    unit: Unit,
    kind: Kind,
    position: Vec3,
    radius: f32,
    normal: Vec3,
    narrow: bool,
}

impl LampTree {
    /// Sorts the lamps' units into clusters.
    ///
    /// Deterministic. Cost: O(n log² n) for n units; memory: about 40 B a unit.
    pub fn new(lamps: &[Lamp]) -> Self {
        let mut items: Vec<Item> =
            lamps.iter().enumerate().flat_map(|(k, lamp)| lamp_items(k as u32, lamp)).collect();
        let mut tree = Self::default();
        let apart = lamps.len() <= MOST_APART;
        // Stable: within a tree, units keep the lamps' order.
        items.sort_by_key(|i| if apart { i.unit.lamp } else { i.kind as u32 });
        let same = |a: &Item, b: &Item| if apart { a.unit.lamp == b.unit.lamp } else { a.kind == b.kind };
        for group in items.chunk_by_mut(same) {
            tree.roots.push(tree.clusters.len() as u32);
            tree.grow(group);
        }
        tree.relight(lamps);
        tree
    }

    /// Takes over the lamps' strengths; their shapes must be the same as before.
    pub fn relight(&mut self, lamps: &[Lamp]) {
        for c in (0..self.clusters.len()).rev() {
            let (mut power, mut flow, mut focus) = (Rgb::ZERO, Mat3::ZERO, Vec3::ZERO);
            let mut child = c + 1;
            if self.is_leaf(c) {
                for unit in self.units_of(c) {
                    let (position, axis, own) = unit.weight(lamps);
                    power += own;
                    flow += outer(own, axis);
                    focus += position * mean_channel(own);
                }
            }
            while child < self.clusters[c].next as usize {
                let below = &self.clusters[child];
                power += below.power;
                flow += below.flow;
                focus += below.focus * mean_channel(below.power);
                child = below.next as usize;
            }
            let total = mean_channel(power);
            let focus = if total > 0.0 { focus / total } else { self.clusters[c].centre };
            let (squares, lean) = self.moments(c, focus, lamps);
            let cluster = &mut self.clusters[c];
            (cluster.power, cluster.flow, cluster.focus) = (power, flow, focus);
            (cluster.spread, cluster.lean) = (if total > 0.0 { squares / total } else { 0.0 }, lean);
        }
        self.power = self.roots.iter().map(|&r| mean_channel(self.clusters[r as usize].power)).sum();
    }

    /// Σ power · squared distance from a cluster's focus, and its [`Cluster::lean`], those below it being known.
    fn moments(&self, cluster: usize, focus: Vec3, lamps: &[Lamp]) -> (f32, Mat3) {
        let (mut squares, mut lean) = (0.0, Mat3::ZERO);
        if self.is_leaf(cluster) {
            for unit in self.units_of(cluster) {
                let (position, axis, power) = unit.weight(lamps);
                let offset = position - focus;
                squares += mean_channel(power) * (offset.length_squared() + unit.spread(lamps));
                lean += outer(axis * mean_channel(power), offset);
            }
            return (squares, lean);
        }
        let mut child = cluster + 1;
        while child < self.clusters[cluster].next as usize {
            let below = &self.clusters[child];
            let offset = below.focus - focus;
            squares += mean_channel(below.power) * (offset.length_squared() + below.spread);
            lean += below.lean + outer(below.flow.transpose() * Vec3::splat(1.0 / 3.0), offset);
            child = below.next as usize;
        }
        (squares, lean)
    }

    /// Whether a cluster has no clusters below it.
    pub fn is_leaf(&self, cluster: usize) -> bool {
        self.clusters[cluster].next as usize == cluster + 1
    }

    /// The units of a cluster.
    pub fn units_of(&self, cluster: usize) -> &[Unit] {
        let range = &self.clusters[cluster].units;
        &self.units[range.start as usize..range.end as usize]
    }

    /// Appends the cluster of some items with all its descendants.
    fn grow(&mut self, items: &mut [Item]) {
        let index = self.clusters.len();
        let first = self.units.len() as u32;
        self.clusters.push(bounds(items, first..first + items.len() as u32));
        let alike = items.iter().all(|i| i.unit.lamp == items[0].unit.lamp);
        if items.len() == 1 || (items.len() <= LEAF && alike) {
            self.units.extend(items.iter().map(|i| i.unit));
        } else {
            let middle = divide(items);
            let (left, right) = items.split_at_mut(middle);
            self.grow(left);
            self.grow(right);
        }
        self.clusters[index].next = self.clusters.len() as u32;
    }
}

impl Unit {
    /// Position, normal or direction, and power: strength times area of a face, strength of others.
    fn weight(&self, lamps: &[Lamp]) -> (Vec3, Vec3, Rgb) {
        let lamp = &lamps[self.lamp as usize];
        match &lamp.shape {
            Shape::Emitter(emitter) => {
                let face = &emitter.faces[self.part as usize];
                (centroid(&face.corners), face.normal, lamp.strength * face.area)
            }
            Shape::Sky(bright) => {
                let texel = &bright.texels[self.part as usize];
                (texel.direction, texel.direction, lamp.strength * texel.light)
            }
            Shape::Punctual(LampKind::Sun { direction, .. }) => (-*direction, -*direction, lamp.strength),
            Shape::Punctual(LampKind::Point { position, .. } | LampKind::Spot { position, .. }) => {
                (*position, Vec3::ZERO, lamp.strength)
            }
        }
    }

    /// Mean squared distance of its points from their mean.
    fn spread(&self, lamps: &[Lamp]) -> f32 {
        let Shape::Emitter(emitter) = &lamps[self.lamp as usize].shape else { return 0.0 };
        let [a, b, c] = emitter.faces[self.part as usize].corners;
        (a.distance_squared(b) + b.distance_squared(c) + c.distance_squared(a)) * (1.0 / 36.0)
    }

    /// Strength times area of a face, strength of others.
    pub fn power(&self, lamps: &[Lamp]) -> Rgb {
        self.weight(lamps).2
    }

    /// Exact unoccluded irradiance at a point.
    pub fn light(&self, lamps: &[Lamp], at: &SurfacePoint) -> Rgb {
        let lamp = &lamps[self.lamp as usize];
        let coupling = match &lamp.shape {
            Shape::Emitter(emitter) => Rgb::splat(emitter.faces[self.part as usize].form_factor(at)),
            Shape::Sky(bright) => texel_light(&bright.texels[self.part as usize], at),
            Shape::Punctual(kind) => Rgb::splat(beam(kind, at)),
        };
        lamp.strength * coupling
    }
}

/// The matrix that takes v to a (b · v).
fn outer(a: Vec3, b: Vec3) -> Mat3 {
    Mat3::from_cols(a * b.x, a * b.y, a * b.z)
}

fn centroid(corners: &[Vec3; 3]) -> Vec3 {
    (corners[0] + corners[1] + corners[2]) * (1.0 / 3.0)
}

fn lamp_items(lamp: u32, of: &Lamp) -> Vec<Item> {
    let item = |kind, position, narrow| Item {
        unit: Unit { lamp, part: 0 },
        kind,
        position,
        radius: 0.0,
        normal: Vec3::ZERO,
        narrow,
    };
    match &of.shape {
        Shape::Emitter(emitter) => {
            let faces = emitter.faces.iter().enumerate().map(|(k, face)| {
                let position = centroid(&face.corners);
                let radius = face.corners.iter().map(|c| c.distance(position)).fold(0.0, f32::max);
                let unit = Unit { lamp, part: k as u32 };
                Item { unit, kind: Kind::Surface, position, radius, normal: face.normal, narrow: false }
            });
            faces.collect()
        }
        Shape::Sky(bright) => {
            let texels = bright.texels.iter().enumerate().map(|(k, texel)| {
                let unit = Unit { lamp, part: k as u32 };
                Item { unit, radius: bright.reach(), ..item(Kind::Distant, texel.direction, false) }
            });
            texels.collect()
        }
        Shape::Punctual(LampKind::Sun { direction, .. }) => vec![item(Kind::Distant, -*direction, false)],
        Shape::Punctual(LampKind::Point { position, .. }) => vec![item(Kind::Beam, *position, false)],
        Shape::Punctual(LampKind::Spot { position, .. }) => vec![item(Kind::Beam, *position, true)],
    }
}

/// The cluster of some items, still without light.
fn bounds(items: &[Item], units: Range<u32>) -> Cluster {
    let (low, high) = extent(items, |i| i.position);
    let centre = (low + high) * 0.5;
    let radius = items.iter().map(|i| i.position.distance(centre) + i.radius).fold(0.0, f32::max);
    let axis = items.iter().map(|i| i.normal).sum::<Vec3>().normalize_or_zero();
    let cosine = items.iter().map(|i| i.normal.dot(axis)).fold(1.0, f32::min);
    Cluster {
        kind: items[0].kind,
        centre,
        // Rounding of the positions, so that what lies on the sphere is inside.
        radius: radius * 1.000_01,
        axis,
        cosine: if axis == Vec3::ZERO { -1.0 } else { cosine },
        units,
        next: 0,
        narrow: items.iter().any(|i| i.narrow),
        focus: centre,
        spread: 0.0,
        lean: Mat3::ZERO,
        flow: Mat3::ZERO,
        power: Rgb::ZERO,
    }
}

fn extent(items: &[Item], of: impl Fn(&Item) -> Vec3) -> (Vec3, Vec3) {
    let start = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    items.iter().fold(start, |(low, high), item| (low.min(of(item)), high.max(of(item))))
}

/// Reorders the items so that those before the returned place, neither none nor all, belong together.
fn divide(items: &mut [Item]) -> usize {
    let (low, high) = extent(items, |i| i.normal);
    let spread = high - low;
    if spread.max_element() > NORMAL_SPREAD {
        let axis = spread.max_position();
        let middle = 0.5 * (low[axis] + high[axis]);
        items.sort_by(|a, b| a.normal[axis].total_cmp(&b.normal[axis]));
        return items.partition_point(|i| i.normal[axis] < middle).clamp(1, items.len() - 1);
    }
    let (low, high) = extent(items, |i| i.position);
    let axis = (high - low).max_position();
    let half = items.len() / 2;
    let place = |i: &Item| (i.position[axis], (i.unit.lamp, i.unit.part));
    items.select_nth_unstable_by(half, |a, b| {
        let ((p, own), (q, other)) = (place(a), place(b));
        p.total_cmp(&q).then(own.cmp(&other))
    });
    half
}
