//! Rays against triangles: a bounding-volume hierarchy in flat arrays, closest hits and occlusion, watertight.

mod build;
mod clusters;
#[cfg(target_arch = "x86_64")]
mod kernels;
mod layout;
mod memory;
pub mod near;
mod prepare;
mod scalar;

use std::sync::Arc;

use glam::Vec3;

pub use layout::{Branch, Child, DEPTH_LIMIT, FAN, LANES, Malformed, NO_TRIANGLE, Packet};
use memory::Slab;
use near::Near;
use prepare::Prepared;

use crate::scene::Scene;

/// A ray segment in local units: origin + t · direction for t in (t_min, t_max).
#[derive(Debug, Clone, Copy)]
pub struct Ray {
    /// Where it starts.
    pub origin: Vec3,
    /// Unit direction.
    pub direction: Vec3,
    /// Hits at or before this distance do not count.
    pub t_min: f32,
    /// Hits at or beyond this distance do not count.
    pub t_max: f32,
}

impl Ray {
    /// A ray that goes on for ever.
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, direction, t_min: 0.0, t_max: f32::INFINITY }
    }

    /// The open segment between two points, as a visibility test wants it.
    pub fn between(from: Vec3, to: Vec3) -> Self {
        let d = to - from;
        let length = d.length();
        Self { origin: from, direction: d / length.max(f32::MIN_POSITIVE), t_min: 0.0, t_max: length }
    }
}

/// Where a ray met the scene first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Distance along the ray, local units.
    pub distance: f32,
    /// The triangle, as numbered in [`Scene::triangles`].
    pub triangle: u32,
    /// Barycentric coordinate of the second corner.
    pub u: f32,
    /// Barycentric coordinate of the third corner.
    pub v: f32,
    /// Whether the ray met the triangle's back: it goes along the normal by the corners' winding. Where it runs within
    /// rounding of the triangle's plane, either answer may be given.
    pub back: bool,
}

/// The hierarchy over borrowed arrays: an owned one's or a mapped archive's.
#[derive(Debug, Clone, Copy)]
pub struct BvhView<'a> {
    branches: &'a [Branch],
    packets: &'a [Packet],
}

impl<'a> BvhView<'a> {
    /// Takes stored arrays after checking every reference in them, in O(branches).
    ///
    /// # Errors
    /// [`Malformed`] when a reference leaves the arrays or leads backward, or the tree is deeper than [`DEPTH_LIMIT`].
    pub fn checked(branches: &'a [Branch], packets: &'a [Packet]) -> Result<Self, Malformed> {
        layout::check(branches, packets.len())?;
        Ok(Self { branches, packets })
    }

    /// Takes arrays that [`BvhView::checked`] took before.
    pub(crate) fn known(branches: &'a [Branch], packets: &'a [Packet]) -> Self {
        Self { branches, packets }
    }

    /// The branches, root first; empty without triangles.
    pub fn branches(&self) -> &'a [Branch] {
        self.branches
    }

    /// The packets of triangles.
    pub fn packets(&self) -> &'a [Packet] {
        self.packets
    }

    /// The nearest hit of the ray, from either side of a triangle.
    ///
    /// Watertight: a ray cannot pass between triangles that share corners. Of hits at the same distance, on a common
    /// edge, the choice is the hierarchy's but always the same. A ray that is not finite meets nothing.
    pub fn closest(&self, ray: &Ray) -> Option<Hit> {
        let ray = Prepared::new(ray)?;
        #[cfg(target_arch = "x86_64")]
        if kernels::available() {
            return kernels::closest(self.branches, self.packets, &ray);
        }
        scalar::closest(self.branches, self.packets, &ray)
    }

    /// Whether anything lies on the segment. Watertight like [`BvhView::closest`].
    pub fn occluded(&self, ray: &Ray) -> bool {
        let Some(ray) = Prepared::new(ray) else { return false };
        #[cfg(target_arch = "x86_64")]
        if kernels::available() {
            return kernels::occluded(self.branches, self.packets, &ray);
        }
        scalar::occluded(self.branches, self.packets, &ray)
    }

    /// [`BvhView::closest`] without vector instructions: the same answer to the last bit, slower; for tests.
    pub fn closest_scalar(&self, ray: &Ray) -> Option<Hit> {
        scalar::closest(self.branches, self.packets, &Prepared::new(ray)?)
    }

    /// [`BvhView::occluded`] without vector instructions: the same answer, slower; for tests.
    pub fn occluded_scalar(&self, ray: &Ray) -> bool {
        Prepared::new(ray).is_some_and(|ray| scalar::occluded(self.branches, self.packets, &ray))
    }
}

/// The acceleration structure over a scene's triangles, owned.
#[derive(Debug)]
pub struct Bvh {
    branches: Slab<Branch>,
    packets: Slab<Packet>,
    /// Full resolution near rays' origins, where these arrays are a proxy.
    near: Option<Arc<Near>>,
}

impl Bvh {
    /// Builds over all triangles of the scene.
    pub fn build(scene: &Scene) -> Self {
        Self::build_triangles(&scene.vertices, &scene.triangles)
    }

    /// Builds over triangles given by corner indices into `vertices`.
    ///
    /// Triangles without area or with corners that are not finite are left out: no ray meets them.
    ///
    /// # Panics
    /// When a corner index is outside `vertices`.
    pub fn build_triangles(vertices: &[Vec3], triangles: &[[u32; 3]]) -> Self {
        let built = build::build(vertices, triangles);
        Self { branches: built.branches, packets: built.packets, near: None }
    }

    /// Copies stored arrays, into huge pages when they are large, after checking them as [`BvhView::checked`] does.
    ///
    /// # Errors
    /// As [`BvhView::checked`].
    pub fn from_slices(branches: &[Branch], packets: &[Packet]) -> Result<Self, Malformed> {
        layout::check(branches, packets.len())?;
        let (empty_branches, empty_packets) = (Slab::zeroed(branches.len()), Slab::zeroed(packets.len()));
        let mut own = Self { branches: empty_branches, packets: empty_packets, near: None };
        own.branches.slice_mut().copy_from_slice(branches);
        own.packets.slice_mut().copy_from_slice(packets);
        Ok(own)
    }

    /// The same queries over borrowed arrays.
    pub fn view(&self) -> BvhView<'_> {
        BvhView { branches: self.branches.slice(), packets: self.packets.slice() }
    }

    /// The nearest hit of the ray, from either side of a triangle; see [`BvhView::closest`].
    pub fn closest(&self, ray: &Ray) -> Option<Hit> {
        self.view().closest(ray)
    }

    /// Whether anything lies on the segment.
    pub fn occluded(&self, ray: &Ray) -> bool {
        self.view().occluded(ray)
    }
}
