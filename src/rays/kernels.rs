//! Traversal with AVX2: eight boxes at a time, four triangles at a time.
//!
//! The one file of the module with `unsafe` in it: calls into code compiled for AVX2, behind run-time detection, and
//! accesses without bounds checks, whose bounds `layout::check` (or the builder) has established.
//!
//! Twin of `scalar.rs`: the same operations in the same order, no fused multiply-add, so the same bits.

#![allow(unsafe_code)]

use std::arch::x86_64::*;

use super::Hit;
use super::layout::{Branch, Child, FAN, Packet};
use super::prepare::{FAR_FACTOR, Prepared};
use super::scalar::STACK;

/// Whether this processor has what the kernels are compiled for.
#[inline]
pub(super) fn available() -> bool {
    is_x86_feature_detected!("avx2") && is_x86_feature_detected!("bmi1") && is_x86_feature_detected!("lzcnt")
}

/// The nearest hit. The caller has seen [`available`]; the arrays come from a `BvhView`.
#[inline]
pub(super) fn closest(branches: &[Branch], packets: &[Packet], ray: &Prepared) -> Option<Hit> {
    debug_assert!(available());
    // SAFETY: the processor has the features (the caller has asked `available`), and the references within the arrays
    // were checked when the view was made.
    unsafe { closest_avx2(branches, packets, ray) }
}

/// Whether there is any hit. The caller has seen [`available`]; the arrays come from a `BvhView`.
#[inline]
pub(super) fn occluded(branches: &[Branch], packets: &[Packet], ray: &Prepared) -> bool {
    debug_assert!(available());
    // SAFETY: as in `closest`.
    unsafe { occluded_avx2(branches, packets, ray) }
}

/// A ray's numbers, one per vector.
struct Wide {
    origin: [__m256; 3],
    inverse: [__m256; 3],
    near: [usize; 3],
    t_min: __m256,
}

impl Wide {
    #[inline]
    #[target_feature(enable = "avx2,bmi1,lzcnt")]
    fn new(ray: &Prepared) -> Self {
        let [ox, oy, oz] = ray.origin;
        let [ix, iy, iz] = ray.inverse;
        Self {
            origin: [_mm256_set1_ps(ox), _mm256_set1_ps(oy), _mm256_set1_ps(oz)],
            inverse: [_mm256_set1_ps(ix), _mm256_set1_ps(iy), _mm256_set1_ps(iz)],
            near: ray.near,
            t_min: _mm256_set1_ps(ray.t_min),
        }
    }

    /// Entry distances of the eight boxes and a bit for each one met before `t_max`.
    #[inline]
    #[target_feature(enable = "avx2,bmi1,lzcnt")]
    fn boxes(&self, branch: &Branch, t_max: f32) -> (__m256, u32) {
        let mut near = self.t_min;
        let mut far = _mm256_set1_ps(f32::INFINITY);
        let planes = branch.planes.as_ptr().cast::<f32>();
        for axis in 0..3 {
            // SAFETY: `near` holds 0..6 and every row has eight floats, 32-byte aligned as `Branch` is.
            let (enter, leave) = unsafe {
                let row = *self.near.get_unchecked(axis);
                (_mm256_load_ps(planes.add(row * FAN)), _mm256_load_ps(planes.add((row ^ 1) * FAN)))
            };
            let enter = _mm256_mul_ps(_mm256_sub_ps(enter, self.origin[axis]), self.inverse[axis]);
            let leave = _mm256_mul_ps(_mm256_sub_ps(leave, self.origin[axis]), self.inverse[axis]);
            // Of a NaN and a number these return the second operand.
            near = _mm256_max_ps(enter, near);
            far = _mm256_min_ps(leave, far);
        }
        let far = _mm256_mul_ps(far, _mm256_set1_ps(FAR_FACTOR));
        let far = _mm256_min_ps(_mm256_set1_ps(t_max), far);
        let met = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(near, far));
        (near, met as u32)
    }
}

/// A ray's numbers for the triangle test.
struct Sheared {
    origin: [__m128; 3],
    shear: [__m128; 3],
    axes: [usize; 3],
}

/// The edge functions and sheared depths of a packet.
struct Edges {
    u: __m128,
    v: __m128,
    w: __m128,
    depth: [__m128; 3],
}

impl Sheared {
    #[inline]
    #[target_feature(enable = "avx2,bmi1,lzcnt")]
    fn new(ray: &Prepared) -> Self {
        let origin = ray.axes.map(|axis| ray.origin[axis]);
        Self {
            origin: [_mm_set1_ps(origin[0]), _mm_set1_ps(origin[1]), _mm_set1_ps(origin[2])],
            shear: [_mm_set1_ps(ray.shear[0]), _mm_set1_ps(ray.shear[1]), _mm_set1_ps(ray.shear[2])],
            axes: ray.axes,
        }
    }

    /// One corner of the four triangles, moved to the origin and sheared.
    #[inline]
    #[target_feature(enable = "avx2,bmi1,lzcnt")]
    fn corner(&self, corner: &[[f32; 4]; 3]) -> [__m128; 3] {
        let row = corner.as_ptr();
        // SAFETY: `axes` holds 0..3, rows are 16-byte aligned as `Packet` is.
        let [x, y, z] = unsafe {
            [0, 1, 2].map(|k| {
                let row = row.add(*self.axes.get_unchecked(k));
                _mm_sub_ps(_mm_load_ps(row.cast()), self.origin[k])
            })
        };
        [_mm_sub_ps(x, _mm_mul_ps(self.shear[0], z)), _mm_sub_ps(y, _mm_mul_ps(self.shear[1], z)), z]
    }

    /// Woop's test up to the signs: the edge functions, and a bit for each triangle the line passes through.
    #[inline]
    #[target_feature(enable = "avx2,bmi1,lzcnt")]
    fn edges(&self, packet: &Packet) -> (Edges, u32) {
        let a = self.corner(&packet.corners[0]);
        let b = self.corner(&packet.corners[1]);
        let c = self.corner(&packet.corners[2]);
        let u = _mm_sub_ps(_mm_mul_ps(c[0], b[1]), _mm_mul_ps(c[1], b[0]));
        let v = _mm_sub_ps(_mm_mul_ps(a[0], c[1]), _mm_mul_ps(a[1], c[0]));
        let w = _mm_sub_ps(_mm_mul_ps(b[0], a[1]), _mm_mul_ps(b[1], a[0]));
        let mut edges = Edges { u, v, w, depth: [a[2], b[2], c[2]] };
        let mut inside = edges.inside();
        if inside != 0 {
            let zero = edges.zeros();
            if _mm_movemask_ps(zero) as u32 & inside != 0 {
                edges.u = _mm_blendv_ps(u, edge(c, b), zero);
                edges.v = _mm_blendv_ps(v, edge(a, c), zero);
                edges.w = _mm_blendv_ps(w, edge(b, a), zero);
                inside = edges.inside();
            }
        }
        (edges, inside)
    }
}

impl Edges {
    /// No two of the three have opposite signs; false for NaNs, which vacant lanes hold.
    #[inline]
    #[target_feature(enable = "avx2,bmi1,lzcnt")]
    fn inside(&self) -> u32 {
        let least = _mm_min_ps(_mm_min_ps(self.u, self.v), self.w);
        let most = _mm_max_ps(_mm_max_ps(self.u, self.v), self.w);
        let zero = _mm_setzero_ps();
        _mm_movemask_ps(_mm_or_ps(_mm_cmpge_ps(least, zero), _mm_cmple_ps(most, zero))) as u32
    }

    /// Where an edge function is exactly zero and its sign therefore unknown.
    #[inline]
    #[target_feature(enable = "avx2,bmi1,lzcnt")]
    fn zeros(&self) -> __m128 {
        let zero = _mm_setzero_ps();
        let some = _mm_or_ps(_mm_cmpeq_ps(self.u, zero), _mm_cmpeq_ps(self.v, zero));
        _mm_or_ps(some, _mm_cmpeq_ps(self.w, zero))
    }

    /// Distances, and a bit for each of the triangles `inside` that is met between `t_min` and `t_max`.
    #[inline]
    #[target_feature(enable = "avx2,bmi1,lzcnt")]
    fn distances(&self, scale: __m128, inside: u32, t_min: f32, t_max: f32) -> (__m128, __m128, u32) {
        let determinant = _mm_add_ps(_mm_add_ps(self.u, self.v), self.w);
        let reciprocal = _mm_div_ps(_mm_set1_ps(1.0), determinant);
        let [a, b, c] = self.depth;
        let depth = _mm_add_ps(_mm_mul_ps(self.u, a), _mm_mul_ps(self.v, b));
        let depth = _mm_add_ps(depth, _mm_mul_ps(self.w, c));
        let distance = _mm_mul_ps(_mm_mul_ps(depth, scale), reciprocal);
        let after = _mm_cmpgt_ps(distance, _mm_set1_ps(t_min));
        let before = _mm_cmplt_ps(distance, _mm_set1_ps(t_max));
        let proper = _mm_cmpneq_ps(determinant, _mm_setzero_ps());
        let met = _mm_movemask_ps(_mm_and_ps(_mm_and_ps(after, before), proper)) as u32;
        (distance, reciprocal, met & inside)
    }
}

/// An edge function in f64, rounded without losing its sign.
#[cold]
#[target_feature(enable = "avx2,bmi1,lzcnt")]
fn edge(p: [__m128; 3], q: [__m128; 3]) -> __m128 {
    let [p0, p1, q0, q1] = [p[0], p[1], q[0], q[1]].map(|x| _mm256_cvtps_pd(x));
    let difference = _mm256_sub_pd(_mm256_mul_pd(p0, q1), _mm256_mul_pd(p1, q0));
    let rounded = _mm256_cvtpd_ps(difference);
    let mut lanes = [0.0f32; 4];
    let mut exact = [0.0f64; 4];
    // SAFETY: both arrays have room for four.
    unsafe {
        _mm_storeu_ps(lanes.as_mut_ptr(), rounded);
        _mm256_storeu_pd(exact.as_mut_ptr(), difference);
    }
    for (lane, exact) in lanes.iter_mut().zip(exact) {
        if *lane == 0.0 && exact != 0.0 {
            *lane = f32::MIN_POSITIVE.copysign(exact as f32);
        }
    }
    // SAFETY: four floats.
    unsafe { _mm_loadu_ps(lanes.as_ptr()) }
}

/// Asks for a child's memory ahead of its use.
#[inline]
#[target_feature(enable = "avx2,bmi1,lzcnt")]
fn prefetch(branches: &[Branch], packets: &[Packet], child: Child) {
    // Addresses are only formed, not read: a prefetch of any address is harmless.
    if child.is_packets() {
        let at = packets.as_ptr().wrapping_add(child.packet_range().start).cast::<i8>();
        _mm_prefetch::<_MM_HINT_T0>(at);
        _mm_prefetch::<_MM_HINT_T0>(at.wrapping_add(64));
        _mm_prefetch::<_MM_HINT_T0>(at.wrapping_add(128));
    } else {
        let at = branches.as_ptr().wrapping_add(child.bits() as usize).cast::<i8>();
        _mm_prefetch::<_MM_HINT_T0>(at);
        _mm_prefetch::<_MM_HINT_T0>(at.wrapping_add(64));
        _mm_prefetch::<_MM_HINT_T0>(at.wrapping_add(128));
        _mm_prefetch::<_MM_HINT_T0>(at.wrapping_add(192));
    }
}

/// Children left waiting, with their entry distances.
struct Stack {
    entries: [std::mem::MaybeUninit<(Child, f32)>; STACK],
    height: usize,
}

impl Stack {
    #[inline]
    fn new() -> Self {
        Self { entries: [const { std::mem::MaybeUninit::uninit() }; STACK], height: 0 }
    }

    #[inline]
    fn push(&mut self, child: Child, entry: f32) {
        debug_assert!(self.height < STACK);
        // SAFETY: at most seven per depth wait, and the depth is limited when a view is made.
        unsafe { self.entries.get_unchecked_mut(self.height).write((child, entry)) };
        self.height += 1;
    }

    /// The last one pushed whose box does not begin beyond `t_max`.
    #[inline]
    fn pop(&mut self, t_max: f32) -> Option<Child> {
        while self.height > 0 {
            self.height -= 1;
            // SAFETY: below the height everything has been written.
            let (child, entry) = unsafe { self.entries.get_unchecked(self.height).assume_init_read() };
            if entry <= t_max {
                return Some(child);
            }
        }
        None
    }

    /// Pushes the children of `met`, the nearest last, and takes that one off again.
    #[inline]
    #[target_feature(enable = "avx2,bmi1,lzcnt")]
    fn sort_in(
        &mut self,
        branch: &Branch,
        near: __m256,
        mut met: u32,
        arrays: (&[Branch], &[Packet]),
    ) -> Child {
        let mut distances = [0.0f32; FAN];
        // SAFETY: room for eight.
        unsafe { _mm256_storeu_ps(distances.as_mut_ptr(), near) };
        let base = self.height;
        let mut nearest = branch.children[(met.trailing_zeros() & 7) as usize];
        let mut nearest_entry = distances[(met.trailing_zeros() & 7) as usize];
        prefetch(arrays.0, arrays.1, nearest);
        met &= met - 1;
        while met != 0 {
            let place = (met.trailing_zeros() & 7) as usize;
            met &= met - 1;
            let (mut child, mut entry) = (branch.children[place], distances[place]);
            prefetch(arrays.0, arrays.1, child);
            if entry <= nearest_entry {
                std::mem::swap(&mut child, &mut nearest);
                std::mem::swap(&mut entry, &mut nearest_entry);
            }
            self.push(child, entry);
            let mut at = self.height - 1;
            // SAFETY: `base <= at` and both are below the height.
            unsafe {
                let entries = self.entries.as_mut_ptr().cast::<(Child, f32)>();
                while at > base && (*entries.add(at - 1)).1 < (*entries.add(at)).1 {
                    std::ptr::swap(entries.add(at - 1), entries.add(at));
                    at -= 1;
                }
            }
        }
        nearest
    }
}

#[target_feature(enable = "avx2,bmi1,lzcnt")]
fn closest_avx2(branches: &[Branch], packets: &[Packet], ray: &Prepared) -> Option<Hit> {
    let wide = Wide::new(ray);
    let sheared = Sheared::new(ray);
    let mut stack = Stack::new();
    let mut t_max = ray.t_max;
    let mut best = None;
    let mut branch = branches.first()?;
    loop {
        let (near, met) = wide.boxes(branch, t_max);
        let mut child = if met == 0 {
            let Some(child) = stack.pop(t_max) else { return best };
            child
        } else if met & (met - 1) == 0 {
            branch.children[(met.trailing_zeros() & 7) as usize]
        } else {
            stack.sort_in(branch, near, met, (branches, packets))
        };
        while child.is_packets() {
            for index in child.packet_range() {
                // SAFETY: the reference was checked.
                let packet = unsafe { packets.get_unchecked(index) };
                nearest_of(packet, &sheared, ray.t_min, &mut t_max, &mut best);
            }
            let Some(next) = stack.pop(t_max) else { return best };
            child = next;
        }
        // SAFETY: the reference was checked.
        branch = unsafe { branches.get_unchecked(child.bits() as usize) };
    }
}

/// Replaces the best hit by the packet's nearest one if that is nearer.
#[inline]
#[target_feature(enable = "avx2,bmi1,lzcnt")]
fn nearest_of(packet: &Packet, sheared: &Sheared, t_min: f32, t_max: &mut f32, best: &mut Option<Hit>) {
    let (edges, inside) = sheared.edges(packet);
    if inside == 0 {
        return;
    }
    let (distance, reciprocal, mut met) = edges.distances(sheared.shear[2], inside, t_min, *t_max);
    if met == 0 {
        return;
    }
    let lanes = |x: __m128| -> [f32; 4] {
        let mut out = [0.0; 4];
        // SAFETY: room for four.
        unsafe { _mm_storeu_ps(out.as_mut_ptr(), x) };
        out
    };
    let distances = lanes(distance);
    let mut lane = (met.trailing_zeros() & 3) as usize;
    met &= met - 1;
    while met != 0 {
        let other = (met.trailing_zeros() & 3) as usize;
        if distances[other] < distances[lane] {
            lane = other;
        }
        met &= met - 1;
    }
    *t_max = distances[lane];
    *best = Some(Hit {
        distance: distances[lane],
        triangle: packet.triangle[lane],
        u: lanes(_mm_mul_ps(edges.v, reciprocal))[lane],
        v: lanes(_mm_mul_ps(edges.w, reciprocal))[lane],
        back: _mm_movemask_ps(reciprocal) >> lane & 1 != 0,
    });
}

#[target_feature(enable = "avx2,bmi1,lzcnt")]
fn occluded_avx2(branches: &[Branch], packets: &[Packet], ray: &Prepared) -> bool {
    let wide = Wide::new(ray);
    let sheared = Sheared::new(ray);
    let mut stack = Stack::new();
    let Some(mut branch) = branches.first() else { return false };
    loop {
        let (near, met) = wide.boxes(branch, ray.t_max);
        let mut child = if met == 0 {
            let Some(child) = stack.pop(ray.t_max) else { return false };
            child
        } else if met & (met - 1) == 0 {
            branch.children[(met.trailing_zeros() & 7) as usize]
        } else {
            stack.sort_in(branch, near, met, (branches, packets))
        };
        while child.is_packets() {
            for index in child.packet_range() {
                // SAFETY: the reference was checked.
                let packet = unsafe { packets.get_unchecked(index) };
                let (edges, inside) = sheared.edges(packet);
                if inside != 0 && edges.distances(sheared.shear[2], inside, ray.t_min, ray.t_max).2 != 0 {
                    return true;
                }
            }
            let Some(next) = stack.pop(ray.t_max) else { return false };
            child = next;
        }
        // SAFETY: the reference was checked.
        branch = unsafe { branches.get_unchecked(child.bits() as usize) };
    }
}
