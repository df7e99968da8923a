//! Building: obvhs clusters the boxes into a binary tree, which is then folded into branches of eight.
//!
//! This work is based on: Meister and Bittner, "Parallel Locally-Ordered Clustering for Bounding Volume Hierarchy
//! Construction", TVCG 2018 (in obvhs), and Wald, Benthin and Boulos, "Getting Rid of Packets", RT 2008 (folding: open the
//! child with the largest surface until eight are there).

use std::time::Duration;

use glam::{Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;

use super::layout::{Branch, Child, FAN, LANES, Packet};

/// The two arrays under construction.
pub(super) struct Built {
    pub branches: Vec<Branch>,
    pub packets: Vec<Packet>,
}

/// Builds over the triangles that have an area.
pub(super) fn build(vertices: &[Vec3], triangles: &[[u32; 3]]) -> Built {
    let (boxes, numbers) = bounds(vertices, triangles);
    let mut built = Built { branches: Vec::new(), packets: Vec::new() };
    if boxes.is_empty() {
        return built;
    }
    let parameters = BvhBuildParams { max_prims_per_leaf: LANES as u32, ..BvhBuildParams::fast_build() };
    let binary = build_bvh2(&boxes, parameters, &mut Duration::default());
    drop(boxes);
    let corners = |primitive: u32| {
        let number = numbers.as_ref().map_or(primitive, |numbers| numbers[primitive as usize]);
        (number, triangles[number as usize].map(|v| vertices[v as usize]))
    };
    fold(&binary, corners, &mut built);
    built
}

/// The boxes of all triangles with an area, and their numbers where some were left out.
fn bounds(vertices: &[Vec3], triangles: &[[u32; 3]]) -> (Vec<Aabb>, Option<Vec<u32>>) {
    let mut boxes = Vec::with_capacity(triangles.len());
    let mut numbers = None;
    for (number, triangle) in triangles.iter().enumerate() {
        let [a, b, c] = triangle.map(|v| vertices[v as usize]);
        if !has_area([a, b, c]) {
            numbers.get_or_insert_with(|| (0..number as u32).collect::<Vec<_>>());
            continue;
        }
        boxes.push(Aabb { min: Vec3A::from(a.min(b).min(c)), max: Vec3A::from(a.max(b).max(c)) });
        if let Some(numbers) = &mut numbers {
            numbers.push(number as u32);
        }
    }
    (boxes, numbers)
}

/// Whether a ray can meet the triangle: finite corners not on one line.
fn has_area([a, b, c]: [Vec3; 3]) -> bool {
    let cross = (b - a).cross(c - a);
    if cross.is_finite() && cross != Vec3::ZERO {
        return true;
    }
    // f32 may have under- or overflowed, or met a NaN.
    let [a, b, c] = [a, b, c].map(Vec3::as_dvec3);
    let cross = (b - a).cross(c - a);
    cross.is_finite() && cross != glam::DVec3::ZERO
}

/// Folds the binary tree into branches of eight, a branch's children side by side, parents before children.
fn fold(binary: &Bvh2, corners: impl Fn(u32) -> (u32, [Vec3; 3]), built: &mut Built) {
    let inner = binary.nodes.iter().filter(|entry| !entry.is_leaf()).count();
    built.branches.reserve(inner / 3 + 1);
    built.packets.reserve(binary.nodes.len() - inner);
    built.branches.push(Branch::vacant());
    let mut waiting = vec![(0usize, 0usize)];
    while let Some((from, to)) = waiting.pop() {
        let mut chosen = [0usize; FAN];
        let count = open(binary, from, &mut chosen);
        let mut branch = Branch::vacant();
        for (place, &entry) in chosen[..count].iter().enumerate() {
            let source = &binary.nodes[entry];
            let child = if source.is_leaf() {
                let first = source.first_index as usize;
                let run = &binary.primitive_indices[first..first + source.prim_count as usize];
                pack(run, &corners, &mut built.packets)
            } else {
                built.branches.push(Branch::vacant());
                let below = built.branches.len() - 1;
                waiting.push((entry, below));
                Child::branch(below)
            };
            branch.set(place, source.aabb().min.into(), source.aabb().max.into(), child);
        }
        built.branches[to] = branch;
    }
}

/// Chooses up to eight descendants of a binary entry that cover it, opening the largest one while there is room.
fn open(binary: &Bvh2, from: usize, chosen: &mut [usize; FAN]) -> usize {
    chosen[0] = from;
    let mut count = 1;
    while count < FAN {
        let mut largest = None;
        let mut largest_area = f32::NEG_INFINITY;
        for (place, &entry) in chosen[..count].iter().enumerate() {
            let entry = &binary.nodes[entry];
            let area = entry.aabb().half_area();
            if !entry.is_leaf() && area > largest_area {
                largest = Some(place);
                largest_area = area;
            }
        }
        let Some(place) = largest else { break };
        let first = binary.nodes[chosen[place]].first_index as usize;
        chosen[place] = first;
        chosen[count] = first + 1;
        count += 1;
    }
    count
}

/// Copies a leaf's triangles into packets.
fn pack(run: &[u32], corners: impl Fn(u32) -> (u32, [Vec3; 3]), packets: &mut Vec<Packet>) -> Child {
    let first = packets.len();
    for group in run.chunks(LANES) {
        let mut packet = Packet::vacant();
        for (lane, &primitive) in group.iter().enumerate() {
            let (number, corners) = corners(primitive);
            packet.set(lane, corners, number);
        }
        packets.push(packet);
    }
    Child::packets(first, packets.len() - first)
}
