//! Building: obvhs clusters runs of triangles into a binary tree, which is folded into branches of eight.
//!
//! This work is based on: Meister and Bittner, "Parallel Locally-Ordered Clustering for Bounding Volume Hierarchy
//! Construction", TVCG 2018 (in obvhs), and Ylitie, Karras and Laine, "Efficient Incoherent Ray Traversal on GPUs Through
//! Compressed Wide BVHs", HPG 2017 (folding with the least total surface of branches, by dynamic programming).
//!
//! Build and trace on a bumpy sphere of 327,680 triangles: least CPU time of several one-thread builds (Zen 4, a loaded
//! machine, ±15 %), and exact counts per segment between random surface points:
//!
//! | build | CPU µs/triangle | branches + packets/segment |
//! |---|---|---|
//! | obvhs `fast` over triangles, greedy folding (0.101 branches/triangle) | 0.53 | not counted; 0.8 × the rays/s |
//! | runs (0.060 branches/triangle), distance 1, no reinsertion | 0.22 | 17.40 + 5.03 |
//! | **runs, distance 1, reinsertion 0.01** | **0.25** | **17.36 + 5.03** |
//! | runs, distance 6, no reinsertion | 0.33 | 17.51 + 5.07 |
//! | runs, distance 6, reinsertion 0.01 | 0.33 | 17.32 + 5.05 |
//! | runs, distance 14, reinsertion 0.02 | 0.37 | 17.32 + 5.06 |
//! | runs, distance 6, reinsertion 0.2 | 0.45 | 16.88 + 5.04 |
//! | runs, distance 6, reinsertion 1 | 1.3 | 16.45 + 5.04 |
//! | Embree 3.13, robust | 0.38 | – |
//!
//! The same on 5.2 M triangles: distance 1 without reinsertion 21.80 branches, with 0.01 of it 21.47; distance 6 with it 21.45.

use glam::Vec3;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use rayon::prelude::*;

use super::clusters::{Clusters, cluster};
use super::layout::{Branch, Child, DEPTH_LIMIT, FAN, Packet};
use super::memory::Slab;

/// The share of binary entries that obvhs tries to place better.
///
/// 0 costs 0.2 % more branches a segment on 328 k triangles and 1.5 % on 5.2 M, and saves little; see the file's head.
const REINSERTED: f32 = 0.01;

/// The two arrays.
pub(super) struct Built {
    pub branches: Slab<Branch>,
    pub packets: Slab<Packet>,
}

/// Builds over the triangles that have an area.
pub(super) fn build(vertices: &[Vec3], triangles: &[[u32; 3]]) -> Built {
    let clusters = cluster(vertices, triangles);
    if clusters.boxes.is_empty() {
        return Built { branches: Slab::zeroed(0), packets: Slab::zeroed(0) };
    }
    let corners = |number: u32| triangles[number as usize].map(|v| vertices[v as usize]);
    let binary = clustered_tree(&clusters);
    if let Some(plan) = arrange(&binary, &fold(&binary)) {
        return fill(&binary, &plan, &clusters, corners);
    }
    let binary = halved_tree(&clusters.boxes);
    let plan = arrange(&binary, &fold(&binary)).expect("a balanced tree of fan two is at most 32 deep");
    fill(&binary, &plan, &clusters, corners)
}

/// obvhs' part: locally ordered clustering, then a little reinsertion.
fn clustered_tree(clusters: &Clusters) -> Bvh2 {
    let count = clusters.boxes.len();
    let identity = (0..count as u32).collect();
    let mut builder = PlocBuilder::with_capacity(count);
    let mut binary =
        builder.build(PlocSearchDistance::Minimum, &clusters.boxes, identity, SortPrecision::U64, 0);
    ReinsertionOptimizer::default().run(&mut binary, REINSERTED, None);
    binary
}

/// A tree that halves the sequence of boxes over and over: for input on which clustering makes a chain.
fn halved_tree(boxes: &[Aabb]) -> Bvh2 {
    let mut binary = Bvh2::zeroed(boxes.len());
    binary.primitive_indices = (0..boxes.len() as u32).collect();
    let mut ranges = vec![(0, boxes.len()); binary.nodes.len()];
    let mut used = 1;
    for at in 0..binary.nodes.len() {
        let (start, end) = ranges[at];
        if end - start == 1 {
            binary.nodes[at] = Bvh2Node::new(boxes[start], 1, start as u32);
            continue;
        }
        let middle = start.midpoint(end);
        ranges[used] = (start, middle);
        ranges[used + 1] = (middle, end);
        binary.nodes[at] = Bvh2Node::new(Aabb::INVALID, 0, used as u32);
        used += 2;
    }
    for at in (0..binary.nodes.len()).rev() {
        if !binary.nodes[at].is_leaf() {
            let first = binary.nodes[at].first_index as usize;
            let (a, b) = (*binary.nodes[first].aabb(), *binary.nodes[first + 1].aabb());
            binary.nodes[at].set_aabb(Aabb { min: a.min.min(b.min), max: a.max.max(b.max) });
        }
    }
    binary
}

/// The best ways to fold the tree below one binary entry.
#[derive(Clone, Copy, Default)]
struct Folding {
    /// `cost[k]`: least surface of branches when the entry is covered by up to k + 1 children.
    cost: [f32; FAN],
    /// How many of the k + 1 go to the first of its two halves; 0: the entry is one branch itself.
    first: [u8; FAN],
}

/// Folds bottom-up. A leaf costs nothing; an entry that becomes a branch costs its surface and is covered by eight below.
fn fold(binary: &Bvh2) -> Vec<Folding> {
    let mut downward = Vec::with_capacity(binary.nodes.len() / 2);
    downward.push(0u32);
    let mut at = 0;
    while at < downward.len() {
        let entry = &binary.nodes[downward[at] as usize];
        at += 1;
        if !entry.is_leaf() {
            let halves = [entry.first_index, entry.first_index + 1];
            downward.extend(halves.iter().filter(|&&half| !binary.nodes[half as usize].is_leaf()));
        }
    }
    let mut folding = vec![Folding::default(); binary.nodes.len()];
    for &index in downward.iter().rev() {
        let entry = &binary.nodes[index as usize];
        if !entry.is_leaf() {
            let halves = entry.first_index as usize;
            folding[index as usize] =
                fold_one(&folding[halves].cost, &folding[halves + 1].cost, entry.aabb().half_area());
        }
    }
    folding
}

/// The best ways over an entry whose halves are solved.
fn fold_one(first: &[f32; FAN], second: &[f32; FAN], surface: f32) -> Folding {
    let mut out = Folding { cost: [f32::INFINITY; FAN], first: [0; FAN] };
    for total in 2..=FAN {
        for share in 1..total {
            let cost = first[share - 1] + second[total - share - 1];
            if cost < out.cost[total - 1] {
                out.cost[total - 1] = cost;
                out.first[total - 1] = share as u8;
            }
        }
    }
    out.cost[0] = out.cost[FAN - 1] + surface;
    for k in 1..FAN {
        if out.cost[0] <= out.cost[k] {
            // One branch is cheaper than opening the entry: it takes one place of those offered.
            out.cost[k] = out.cost[0];
            out.first[k] = 0;
        }
    }
    out
}

/// Where a branch comes from and where its children lie.
struct Planned {
    /// The binary entries it covers.
    children: [u32; FAN],
    /// How many.
    count: u8,
    /// Index of its first child branch.
    branch: u32,
    /// Index of its first packet.
    packet: u32,
}

impl Planned {
    fn children(&self) -> &[u32] {
        &self.children[..usize::from(self.count)]
    }
}

/// Lays branches out from the root, a branch's children side by side, parents before children.
///
/// `None` if a branch would lie [`DEPTH_LIMIT`] deep.
fn arrange(binary: &Bvh2, folding: &[Folding]) -> Option<Vec<Planned>> {
    let mut plan: Vec<Planned> = Vec::with_capacity(binary.nodes.len() / 8);
    let mut packets = 0;
    let vacant = || Planned { children: [0; FAN], count: 0, branch: 0, packet: 0 };
    plan.push(vacant());
    let mut waiting = vec![(0u32, 0usize, 0usize)];
    while let Some((from, to, depth)) = waiting.pop() {
        if depth >= DEPTH_LIMIT {
            return None;
        }
        let mut planned = Planned { branch: plan.len() as u32, packet: packets, ..vacant() };
        if binary.nodes[from as usize].is_leaf() {
            planned.children[0] = from;
            planned.count = 1;
        } else {
            open(binary, folding, (from, FAN), &mut planned, true);
        }
        for &child in planned.children() {
            if binary.nodes[child as usize].is_leaf() {
                packets += 1;
            } else {
                waiting.push((child, plan.len(), depth + 1));
                plan.push(vacant());
            }
        }
        plan[to] = planned;
    }
    Some(plan)
}

/// Collects the descendants that cover an entry with up to `places` children as folded; a `root` is always opened.
fn open(binary: &Bvh2, folding: &[Folding], (from, places): (u32, usize), planned: &mut Planned, root: bool) {
    let entry = &binary.nodes[from as usize];
    let ways = &folding[from as usize];
    let share = if root { best_share(binary, folding, from) } else { usize::from(ways.first[places - 1]) };
    if entry.is_leaf() || share == 0 {
        planned.children[usize::from(planned.count)] = from;
        planned.count += 1;
        return;
    }
    open(binary, folding, (entry.first_index, share), planned, false);
    open(binary, folding, (entry.first_index + 1, places - share), planned, false);
}

/// How eight places are best shared between an entry's halves.
fn best_share(binary: &Bvh2, folding: &[Folding], from: u32) -> usize {
    let halves = binary.nodes[from as usize].first_index as usize;
    let (first, second) = (&folding[halves].cost, &folding[halves + 1].cost);
    let cost = |share: usize| first[share - 1] + second[FAN - share - 1];
    (1..FAN).min_by(|&a, &b| cost(a).total_cmp(&cost(b))).unwrap_or(1)
}

/// Writes branches and packets as planned.
fn fill(
    binary: &Bvh2,
    plan: &[Planned],
    clusters: &Clusters,
    corners: impl Fn(u32) -> [Vec3; 3] + Sync,
) -> Built {
    let branch = |planned: &Planned| {
        let mut branch = Branch::vacant();
        let (mut below, mut packet) = (planned.branch as usize, planned.packet as usize);
        for (place, &entry) in planned.children().iter().enumerate() {
            let entry = &binary.nodes[entry as usize];
            let child = if entry.is_leaf() {
                packet += 1;
                Child::packets(packet - 1, 1)
            } else {
                below += 1;
                Child::branch(below - 1)
            };
            branch.set(place, entry.aabb().min.into(), entry.aabb().max.into(), child);
        }
        branch
    };
    let runs = runs_in_order(binary, plan, clusters.boxes.len());
    let packet = |&run: &u32| {
        let (start, end) = (clusters.starts[run as usize], clusters.starts[run as usize + 1]);
        let mut packet = Packet::vacant();
        for (lane, &number) in clusters.order[start as usize..end as usize].iter().enumerate() {
            packet.set(lane, corners(number), number);
        }
        packet
    };
    let mut built = Built { branches: Slab::zeroed(plan.len()), packets: Slab::zeroed(runs.len()) };
    let branches = built.branches.slice_mut().par_iter_mut();
    branches.zip(plan).with_min_len(4096).for_each(|(to, planned)| *to = branch(planned));
    let packets = built.packets.slice_mut().par_iter_mut();
    packets.zip(&runs).with_min_len(4096).for_each(|(to, run)| *to = packet(run));
    built
}

/// The run that goes into each packet.
fn runs_in_order(binary: &Bvh2, plan: &[Planned], count: usize) -> Vec<u32> {
    let mut runs = vec![0; count];
    for planned in plan {
        let leaves = planned.children().iter().map(|&entry| &binary.nodes[entry as usize]);
        for (at, entry) in leaves.filter(|entry| entry.is_leaf()).enumerate() {
            runs[planned.packet as usize + at] = binary.primitive_indices[entry.first_index as usize];
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::hash::Stream;
    use crate::rays::layout;

    /// Boxes of one triangle each, placed by `at`.
    fn triangles(count: u32, mut at: impl FnMut(u32) -> (Vec3, f32)) -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let corners = |k| {
            let (middle, size) = at(k);
            [middle, middle + Vec3::X * size, middle + Vec3::Y * size]
        };
        ((0..count).flat_map(corners).collect(), (0..count).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect())
    }

    fn numbers(built: &Built) -> Vec<u32> {
        let lanes = built.packets.slice().iter().flat_map(|packet| packet.triangle);
        let mut numbers: Vec<u32> = lanes.filter(|&number| number != layout::NO_TRIANGLE).collect();
        numbers.sort_unstable();
        numbers
    }

    #[test]
    fn every_triangle_is_held_once_and_references_hold() {
        for count in [1, 2, 4, 5, 9, 33, 1000, 20_000] {
            let mut stream = Stream::new(5, u64::from(count));
            let (vertices, triangles) =
                triangles(count, |_| (Vec3::new(stream.unit(), stream.unit(), stream.unit()), 0.01));
            let built = build(&vertices, &triangles);
            layout::check(built.branches.slice(), built.packets.slice().len())
                .expect("fresh references hold");
            assert_eq!(numbers(&built), (0..count).collect::<Vec<_>>());
        }
    }

    #[test]
    fn halved_trees_hold_everything_within_the_depth() {
        let (vertices, triangles) = triangles(5000, |k| (Vec3::splat(k as f32), 1.0));
        let clusters = cluster(&vertices, &triangles);
        let binary = halved_tree(&clusters.boxes);
        let plan = arrange(&binary, &fold(&binary)).expect("balanced trees are shallow");
        let built = fill(&binary, &plan, &clusters, |number| {
            triangles[number as usize].map(|v| vertices[v as usize])
        });
        layout::check(built.branches.slice(), built.packets.slice().len()).expect("references hold");
        assert_eq!(numbers(&built), (0..5000).collect::<Vec<_>>());
    }

    #[test]
    fn chains_and_overflowing_surfaces_still_build() {
        // Sizes from 2^-120 to 2^119: every clustering of neighbours is a chain, and the largest surfaces are infinite.
        let (vertices, triangles) = triangles(240, |k| {
            let size = 2.0f32.powi(k as i32 - 120);
            (Vec3::splat(size), size)
        });
        let built = build(&vertices, &triangles);
        layout::check(built.branches.slice(), built.packets.slice().len()).expect("references hold");
        assert_eq!(numbers(&built), (0..240).collect::<Vec<_>>());
    }
}
