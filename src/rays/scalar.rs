//! Traversal in plain Rust: the fallback where AVX2 is missing, and the reference the vector kernels are tested against.
//!
//! Every operation here has its twin in `kernels.rs`, in the same order and without fused multiply-add, so both give the
//! same bits.

use super::Hit;
use super::layout::{Branch, Child, DEPTH_LIMIT, FAN, LANES, Packet};
use super::prepare::{FAR_FACTOR, Prepared};

/// Room for the children left waiting: seven at each depth, and the one in hand.
pub(super) const STACK: usize = (FAN - 1) * DEPTH_LIMIT + 1;

/// The nearest hit.
pub(super) fn closest(branches: &[Branch], packets: &[Packet], ray: &Prepared) -> Option<Hit> {
    let mut ray = *ray;
    let mut best = None;
    walk(branches, &mut ray, |child, ray| {
        for packet in &packets[child.packet_range()] {
            if let Some(found) = meet(packet, ray) {
                ray.t_max = found.distance;
                best = Some(found);
            }
        }
        false
    });
    best
}

/// Whether there is any hit.
pub(super) fn occluded(branches: &[Branch], packets: &[Packet], ray: &Prepared) -> bool {
    let mut ray = *ray;
    let mut any = false;
    walk(branches, &mut ray, |child, ray| {
        any = packets[child.packet_range()].iter().any(|packet| meet(packet, ray).is_some());
        any
    });
    any
}

/// Visits the leaves whose boxes the ray meets, near ones first, until `visit` says true.
fn walk(branches: &[Branch], ray: &mut Prepared, mut visit: impl FnMut(Child, &mut Prepared) -> bool) {
    if branches.is_empty() {
        return;
    }
    let mut stack = [(Child::NONE, 0.0f32); STACK];
    let mut height = 0;
    let mut current = 0;
    loop {
        height = push_children(&branches[current], ray, &mut stack, height);
        loop {
            if height == 0 {
                return;
            }
            height -= 1;
            let (child, entry) = stack[height];
            if entry > ray.t_max {
                continue;
            }
            if let Some(below) = child.as_branch() {
                current = below;
                break;
            }
            if visit(child, ray) {
                return;
            }
        }
    }
}

/// Pushes the children that the ray meets, the nearest on top; returns the new height.
fn push_children(branch: &Branch, ray: &Prepared, stack: &mut [(Child, f32); STACK], height: usize) -> usize {
    let mut top = height;
    for place in 0..FAN {
        let (near, far) = slab(branch, ray, place);
        let met = near <= far;
        if !met {
            continue;
        }
        let mut at = top;
        while at > height && stack[at - 1].1 < near {
            stack[at] = stack[at - 1];
            at -= 1;
        }
        stack[at] = (branch.children[place], near);
        top += 1;
    }
    top
}

/// Entry and exit distance of one box; NaNs (zero direction within a face's plane) leave the interval as it is.
#[inline]
fn slab(branch: &Branch, ray: &Prepared, place: usize) -> (f32, f32) {
    let mut near = ray.t_min;
    let mut far = f32::INFINITY;
    for axis in 0..3 {
        let row = ray.near[axis];
        let enter = (branch.planes[row][place] - ray.origin[axis]) * ray.inverse[axis];
        let leave = (branch.planes[row ^ 1][place] - ray.origin[axis]) * ray.inverse[axis];
        near = if enter > near { enter } else { near };
        far = if leave < far { leave } else { far };
    }
    far *= FAR_FACTOR;
    (near, if ray.t_max < far { ray.t_max } else { far })
}

/// The nearest hit within a packet.
fn meet(packet: &Packet, ray: &Prepared) -> Option<Hit> {
    let mut best: Option<Hit> = None;
    for lane in 0..LANES {
        if let Some(found) = meet_lane(packet, lane, ray)
            && best.is_none_or(|b| found.distance < b.distance)
        {
            best = Some(found);
        }
    }
    best
}

/// Woop's test of one triangle; exact zeros of the edge functions are settled in f64.
fn meet_lane(packet: &Packet, lane: usize, ray: &Prepared) -> Option<Hit> {
    let [kx, ky, kz] = ray.axes;
    let sheared = packet.corners.map(|corner| {
        let z = corner[kz][lane] - ray.origin[kz];
        let x = (corner[kx][lane] - ray.origin[kx]) - ray.shear[0] * z;
        let y = (corner[ky][lane] - ray.origin[ky]) - ray.shear[1] * z;
        [x, y, z]
    });
    let [a, b, c] = sheared;
    let mut u = c[0] * b[1] - c[1] * b[0];
    let mut v = a[0] * c[1] - a[1] * c[0];
    let mut w = b[0] * a[1] - b[1] * a[0];
    if u == 0.0 || v == 0.0 || w == 0.0 {
        u = edge(c, b);
        v = edge(a, c);
        w = edge(b, a);
    }
    if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
        return None;
    }
    let determinant = (u + v) + w;
    let reciprocal = 1.0 / determinant;
    let depth = (u * a[2] + v * b[2]) + w * c[2];
    let distance = (depth * ray.shear[2]) * reciprocal;
    // NaNs (vacant lanes, determinant zero) fail these comparisons.
    (distance > ray.t_min && distance < ray.t_max && determinant != 0.0).then(|| Hit {
        distance,
        triangle: packet.triangle[lane],
        u: v * reciprocal,
        v: w * reciprocal,
        // Looking along the ray, the edge functions of a front are positive.
        back: determinant < 0.0,
    })
}

/// An edge function whose sign is right: products of f32 are exact in f64.
#[inline]
fn edge(p: [f32; 3], q: [f32; 3]) -> f32 {
    let difference = f64::from(p[0]) * f64::from(q[1]) - f64::from(p[1]) * f64::from(q[0]);
    // f32's exponent range is narrower: what would vanish keeps its sign.
    let rounded = difference as f32;
    if rounded == 0.0 && difference != 0.0 { f32::MIN_POSITIVE.copysign(difference as f32) } else { rounded }
}
