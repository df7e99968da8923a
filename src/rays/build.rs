//! Building: obvhs clusters runs of triangles into a binary tree, which is folded into branches of eight.
//!
//! This work is based on: Meister and Bittner, "Parallel Locally-Ordered Clustering for Bounding Volume Hierarchy
//! Construction", TVCG 2018 (in obvhs), and Ylitie, Karras and Laine, "Efficient Incoherent Ray Traversal on GPUs Through
//! Compressed Wide BVHs", HPG 2017 (folding with the least total surface of branches, by dynamic programming).

use glam::Vec3;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use rayon::prelude::*;

use super::clusters::{Clusters, cluster};
use super::layout::{Branch, Child, FAN, Packet};

/// The two arrays under construction.
pub(super) struct Built {
    pub branches: Vec<Branch>,
    pub packets: Vec<Packet>,
}

/// Builds over the triangles that have an area.
pub(super) fn build(vertices: &[Vec3], triangles: &[[u32; 3]]) -> Built {
    let t0 = cpu_time::ProcessTime::now();
    let clusters = cluster(vertices, triangles);
    let t1 = t0.elapsed();
    if clusters.boxes.is_empty() {
        return Built { branches: Vec::new(), packets: Vec::new() };
    }
    let binary = binary_tree(&clusters);
    let t2 = t0.elapsed();
    let folding = fold(&binary);
    let t3 = t0.elapsed();
    let plan = arrange(&binary, &folding);
    let t4 = t0.elapsed();
    let r = fill(&binary, &plan, &clusters, |number: u32| {
        triangles[number as usize].map(|v| vertices[v as usize])
    });
    println!(
        "clusters {:?} obvhs {:?} fold {:?} arrange {:?} fill {:?}; branches/tri {:.3} packet fill {:.3} surface {:.3}",
        t1,
        t2 - t1,
        t3 - t2,
        t4 - t3,
        t0.elapsed() - t4,
        r.branches.len() as f64 / triangles.len() as f64,
        triangles.len() as f64 / r.packets.len() as f64,
        folding[0].cost[0] / binary.nodes[0].aabb().half_area()
    );
    r
}

/// obvhs' part.
fn binary_tree(clusters: &Clusters) -> Bvh2 {
    let count = clusters.boxes.len();
    let (distance, threshold) = match std::env::var("DIST").as_deref() {
        Ok("min") => (PlocSearchDistance::Minimum, 0),
        Ok("verylow") => (PlocSearchDistance::VeryLow, 0),
        Ok("low") => (PlocSearchDistance::Low, 0),
        Ok("med") => (PlocSearchDistance::Medium, 0),
        Ok("high") => (PlocSearchDistance::High, 0),
        _ => (PlocSearchDistance::Low, 0),
    };
    let ratio: f32 = std::env::var("RATIO").map_or(0.02, |c| c.parse().unwrap());
    let identity = (0..count as u32).collect();
    let mut binary = PlocBuilder::with_capacity(count).build(
        distance,
        &clusters.boxes,
        identity,
        SortPrecision::U64,
        threshold,
    );
    ReinsertionOptimizer::default().run(&mut binary, ratio, None);
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

/// Lays branches out from the root, a branch's children side by side, parents before children.
fn arrange(binary: &Bvh2, folding: &[Folding]) -> Vec<Planned> {
    let mut plan: Vec<Planned> = Vec::with_capacity(binary.nodes.len() / 8);
    let mut packets = 0;
    let vacant = || Planned { children: [0; FAN], count: 0, branch: 0, packet: 0 };
    plan.push(vacant());
    let mut waiting = vec![(0u32, 0usize)];
    while let Some((from, to)) = waiting.pop() {
        let mut planned = Planned { branch: plan.len() as u32, packet: packets, ..vacant() };
        if binary.nodes[from as usize].is_leaf() {
            planned.children[0] = from;
            planned.count = 1;
        } else {
            open(binary, folding, (from, FAN), &mut planned, true);
        }
        for &child in &planned.children[..usize::from(planned.count)] {
            if binary.nodes[child as usize].is_leaf() {
                packets += 1;
            } else {
                waiting.push((child, plan.len()));
                plan.push(vacant());
            }
        }
        plan[to] = planned;
    }
    plan
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
        for (place, &entry) in planned.children[..usize::from(planned.count)].iter().enumerate() {
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
    let runs: Vec<u32> = {
        let mut runs = vec![0; clusters.boxes.len()];
        for planned in plan {
            let leaves = planned.children[..usize::from(planned.count)]
                .iter()
                .map(|&entry| &binary.nodes[entry as usize])
                .filter(|entry| entry.is_leaf());
            for (at, entry) in leaves.enumerate() {
                runs[planned.packet as usize + at] = binary.primitive_indices[entry.first_index as usize];
            }
        }
        runs
    };
    let packet = |&run: &u32| {
        let (start, end) = (clusters.starts[run as usize], clusters.starts[run as usize + 1]);
        let mut packet = Packet::vacant();
        for (lane, &number) in clusters.order[start as usize..end as usize].iter().enumerate() {
            packet.set(lane, corners(number), number);
        }
        packet
    };
    Built {
        branches: plan.par_iter().with_min_len(4096).map(branch).collect(),
        packets: runs.par_iter().with_min_len(4096).map(packet).collect(),
    }
}
