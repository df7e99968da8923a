//! Leaves before the tree: triangles along a Morton curve, cut into runs of up to four with the least total surface.
//!
//! The tree is then built over runs instead of triangles, a third as many, which is where a build's time goes. Cutting is
//! dynamic programming over the sequence: the cost of the first i triangles is the least cost of the first i − k plus the
//! surface of the box around the last k, over k = 1…4. Against leaves that obvhs chooses itself (see `build.rs`).

use glam::{Vec3, Vec3A};
use obvhs::aabb::Aabb;
use rayon::prelude::*;

use super::layout::LANES;
use crate::geometry::morton;

/// Triangles cut at a time; runs do not cross block borders, so that blocks are independent.
const BLOCK: usize = 8192;

/// What one more packet costs, in units of the block's mean triangle surface.
///
/// Smaller values make smaller packets: fewer triangles tested in vain, but more boxes and more memory. With 1, 3
/// and 6 on 328 k triangles: 3.07, 3.40 and 3.61 triangles a packet, 4.71, 5.06 and 5.46 packets and 17.35, 17.22 and 17.27
/// branches a segment. Rays/s from 2 to 4 are the same within noise, at 100 (full packets) they fall by a quarter.
const PACKET_COST: f32 = 3.0;

/// Runs of triangles with their boxes.
pub(super) struct Clusters {
    /// Triangle numbers in Morton order.
    pub order: Vec<u32>,
    /// Where each run begins in `order`, and its end last.
    pub starts: Vec<u32>,
    /// The box around each run.
    pub boxes: Vec<Aabb>,
}

/// Sorts and cuts the triangles that have an area.
pub(super) fn cluster(vertices: &[Vec3], triangles: &[[u32; 3]]) -> Clusters {
    let corners = |number: usize| triangles[number].map(|v| vertices[v as usize]);
    let boxes: Vec<Aabb> = (0..triangles.len())
        .into_par_iter()
        .with_min_len(BLOCK)
        .map(|number| bounds(corners(number)))
        .collect();
    let keys = sorted_keys(&boxes);
    let mask = index_mask(boxes.len());
    let order: Vec<u32> = keys.iter().map(|key| (key & mask) as u32).collect();
    drop(keys);
    let blocks: Vec<(Vec<u8>, Vec<Aabb>)> = order.par_chunks(BLOCK).map(|block| cut(block, &boxes)).collect();
    let count = blocks.iter().map(|(lengths, _)| lengths.len()).sum::<usize>();
    let mut clusters =
        Clusters { order, starts: Vec::with_capacity(count + 1), boxes: Vec::with_capacity(count) };
    let mut at = 0;
    for (lengths, runs) in blocks {
        for length in lengths {
            clusters.starts.push(at);
            at += u32::from(length);
        }
        clusters.boxes.extend(runs);
    }
    clusters.starts.push(at);
    clusters
}

/// The triangle's box, or [`Aabb::INVALID`] if no ray can meet it: corners on one line or not finite.
fn bounds([a, b, c]: [Vec3; 3]) -> Aabb {
    let cross = (b - a).cross(c - a);
    let mut flat = !cross.is_finite() || cross == Vec3::ZERO;
    if flat {
        // f32 may have under- or overflowed; a NaN stays one.
        let [a, b, c] = [a, b, c].map(Vec3::as_dvec3);
        let cross = (b - a).cross(c - a);
        flat = !cross.is_finite() || cross == glam::DVec3::ZERO;
    }
    if flat {
        return Aabb::INVALID;
    }
    let [a, b, c] = [a, b, c].map(Vec3A::from);
    Aabb { min: a.min(b).min(c), max: a.max(b).max(c) }
}

/// The bits of a key that hold the triangle's number.
fn index_mask(count: usize) -> u64 {
    count.next_power_of_two() as u64 - 1
}

/// Morton code of the box's middle above, number below, for each valid box; ascending.
fn sorted_keys(boxes: &[Aabb]) -> Vec<u64> {
    let valid = |b: &Aabb| b.min.x <= b.max.x;
    let mut all = Aabb::INVALID;
    for b in boxes.iter().filter(|b| valid(b)) {
        all.min = all.min.min(b.min);
        all.max = all.max.max(b.max);
    }
    let index_bits = index_mask(boxes.len()).count_ones();
    // 20 bits an axis at the most: f32 has 24.
    let axis_bits = ((64 - index_bits) / 3).min(20);
    let scale = ((1u32 << axis_bits) - 1) as f32 / (all.max - all.min).max_element().max(f32::MIN_POSITIVE);
    let key = |(number, b): (usize, &Aabb)| {
        let at = ((b.min * 0.5 + b.max * 0.5) - all.min) * scale;
        (morton::encode([at.x as u32, at.y as u32, at.z as u32]) << index_bits) | number as u64
    };
    let mut keys: Vec<u64> =
        boxes.par_iter().enumerate().with_min_len(BLOCK).filter(|(_, b)| valid(b)).map(key).collect();
    keys.par_sort_unstable();
    keys
}

/// Lengths and boxes of the runs that cut one block best.
fn cut(block: &[u32], boxes: &[Aabb]) -> (Vec<u8>, Vec<Aabb>) {
    let own: Vec<Aabb> = block.iter().map(|&number| boxes[number as usize]).collect();
    let mean = own.iter().map(Aabb::half_area).sum::<f32>() / own.len() as f32;
    let fixed = PACKET_COST * mean;
    let mut cost = vec![0.0f32; own.len() + 1];
    let mut length = vec![0u8; own.len() + 1];
    for end in 1..=own.len() {
        let mut run = Aabb::INVALID;
        let mut best = f32::INFINITY;
        for k in 1..=LANES.min(end) {
            let start = end - k;
            run.min = run.min.min(own[start].min);
            run.max = run.max.max(own[start].max);
            let total = cost[start] + run.half_area() + fixed;
            if total < best {
                best = total;
                length[end] = k as u8;
            }
        }
        if length[end] == 0 {
            // Surfaces overflowed: any cut will do.
            length[end] = 1;
        }
        cost[end] = best;
    }
    let mut end = own.len();
    let mut lengths = Vec::new();
    while end > 0 {
        lengths.push(length[end]);
        end -= usize::from(length[end]);
    }
    lengths.reverse();
    let mut start = 0;
    let around = |&length: &u8| {
        let run = &own[start..start + usize::from(length)];
        start += usize::from(length);
        run[1..].iter().fold(run[0], |all, b| Aabb { min: all.min.min(b.min), max: all.max.max(b.max) })
    };
    let runs = lengths.iter().map(around).collect();
    (lengths, runs)
}
