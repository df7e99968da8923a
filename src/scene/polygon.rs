//! Cuts polygons into triangles.
//!
//! This work is based on: L. P. Chew, "Constrained Delaunay Triangulations", Algorithmica 4, 1989, as implemented by
//! spade. The polygon is projected into its plane, its edges become constraints, and the triangles with a winding
//! number other than zero are kept: concave polygons, bridges to holes and repeated loops all come out right.

use std::collections::HashMap;

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};
use spade::handles::FixedVertexHandle;
use spade::{ConstrainedDelaunayTriangulation, Point2, Triangulation};

/// How often something happened and where first.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Count {
    /// How often.
    pub times: u64,
    /// Where first (row or line).
    pub first: u64,
}

impl Count {
    /// Notes one more.
    pub fn note(&mut self, place: u64) {
        if self.times == 0 {
            self.first = place;
        }
        self.times += 1;
    }
}

/// Appends the triangles of a polygon, wound as it is. Repeated corners in a row count once; fewer than three leave
/// nothing. Gives false when the outline crosses itself: then it was cut as a fan.
pub fn triangulate(positions: &[DVec3], corners: &[u32], out: &mut Vec<[u32; 3]>) -> bool {
    triangulate_at(&|corner| positions[corner as usize], corners, out)
}

/// [`triangulate`] with positions by number, from wherever they are.
pub fn triangulate_at(position: &dyn Fn(u32) -> DVec3, corners: &[u32], out: &mut Vec<[u32; 3]>) -> bool {
    let mut outline: Vec<u32> = Vec::with_capacity(corners.len());
    for &corner in corners {
        if outline.last() != Some(&corner) {
            outline.push(corner);
        }
    }
    while outline.len() > 1 && outline.first() == outline.last() {
        outline.pop();
    }
    if outline.len() < 3 {
        return true;
    }
    // Gathered once: positions may come from a file.
    let positions: Vec<DVec3> = outline.iter().map(|&corner| position(corner)).collect();
    let at = |k: usize| positions[k];
    let normal = newell_normal(&positions);
    let turn = |a: usize, b: usize, c: usize| (at(b) - at(a)).cross(at(c) - at(a)).dot(normal);
    let count = outline.len();
    if (1..count - 1).all(|k| turn(0, k, k + 1) > 0.0) && !has_repeats(&outline) {
        push_fan(&outline, out);
        return true;
    }
    if count == 4 && turn(1, 2, 3) > 0.0 && turn(1, 3, 0) > 0.0 {
        out.extend([[outline[1], outline[2], outline[3]], [outline[1], outline[3], outline[0]]]);
        return true;
    }
    if let Some(inside) = constrained_delaunay(&outline, &positions, normal) {
        out.extend(inside);
        return true;
    }
    push_fan(&outline, out);
    // A flat outline has nothing to cut wrongly: its triangles are dropped later, for they have no area.
    (1..count - 1).all(|k| (at(k) - at(0)).cross(at(k + 1) - at(0)) == DVec3::ZERO)
}

fn push_fan(outline: &[u32], out: &mut Vec<[u32; 3]>) {
    out.extend((1..outline.len() - 1).map(|k| [outline[0], outline[k], outline[k + 1]]));
}

fn has_repeats(outline: &[u32]) -> bool {
    if outline.len() <= 8 {
        return outline.iter().enumerate().any(|(k, corner)| outline[..k].contains(corner));
    }
    let mut sorted = outline.to_vec();
    sorted.sort_unstable();
    sorted.windows(2).any(|pair| pair[0] == pair[1])
}

/// Twice the outline's vector area (Newell's method), relative to its first corner for accuracy far from the origin.
fn newell_normal(positions: &[DVec3]) -> DVec3 {
    let relative = |k: usize| positions[k % positions.len()] - positions[0];
    (0..positions.len()).map(|k| relative(k).cross(relative(k + 1))).sum()
}

/// The outline's triangles, or nothing when it crosses itself or has no area.
fn constrained_delaunay(outline: &[u32], positions: &[DVec3], normal: DVec3) -> Option<Vec<[u32; 3]>> {
    let mut plane = ConstrainedDelaunayTriangulation::<Point2<f64>>::new();
    let mut corner_of: HashMap<usize, u32> = HashMap::with_capacity(outline.len());
    let mut handles: Vec<FixedVertexHandle> = Vec::with_capacity(outline.len());
    for (point, &corner) in flattened(positions, normal)?.iter().zip(outline) {
        let handle = plane.insert(Point2::new(point.x, point.y)).ok()?;
        corner_of.entry(handle.index()).or_insert(corner);
        handles.push(handle);
    }
    // Net number of times that the outline runs along each directed edge.
    let mut runs: HashMap<(usize, usize), i32> = HashMap::with_capacity(2 * outline.len());
    for (k, &from) in handles.iter().enumerate() {
        let to = handles[(k + 1) % handles.len()];
        if from == to {
            continue;
        }
        let edges = plane.try_add_constraint(from, to);
        if edges.is_empty() {
            return None;
        }
        for edge in edges {
            let edge = plane.directed_edge(edge);
            let (a, b) = (edge.from().fix().index(), edge.to().fix().index());
            *runs.entry((a, b)).or_insert(0) += 1;
            *runs.entry((b, a)).or_insert(0) -= 1;
        }
    }
    let winding = winding_numbers(&plane, &runs);
    let mut inside = Vec::with_capacity(outline.len());
    for face in plane.inner_faces() {
        let turns = winding.get(&face.fix().index()).copied().unwrap_or(0);
        if turns != 0 {
            let mut triangle = face.vertices().map(|v| corner_of[&v.fix().index()]);
            if turns < 0 {
                triangle.swap(1, 2);
            }
            inside.push(triangle);
        }
    }
    (!inside.is_empty()).then_some(inside)
}

/// The corners in the polygon's plane, counter-clockwise, in a box of about unit size.
fn flattened(positions: &[DVec3], normal: DVec3) -> Option<Vec<DVec2>> {
    let normal = normal.try_normalize()?;
    let (s, t) = normal.any_orthonormal_pair();
    // glam's pair is right-handed only up to sign: make s × t = normal.
    let t = if s.cross(t).dot(normal) < 0.0 { -t } else { t };
    let origin = positions[0];
    let mut flat: Vec<DVec2> = positions
        .iter()
        .map(|&at| {
            let d = at - origin;
            DVec2::new(d.dot(s), d.dot(t))
        })
        .collect();
    let extent = flat.iter().fold(0.0f64, |extent, p| extent.max(p.abs().max_element()));
    for point in &mut flat {
        // spade refuses coordinates that are tiny but not zero; below 1e-100 of the polygon they are zero.
        *point = (*point / extent).map(|x| if x.abs() < 1e-100 { 0.0 } else { x });
    }
    Some(flat)
}

/// Winding number of the outline around each face, spreading inwards from the outer face.
fn winding_numbers(
    plane: &ConstrainedDelaunayTriangulation<Point2<f64>>,
    runs: &HashMap<(usize, usize), i32>,
) -> HashMap<usize, i32> {
    let outer = plane.outer_face().fix().index();
    let mut winding = HashMap::from([(outer, 0)]);
    // Directed edges whose left face is known.
    let mut open: Vec<_> = plane
        .convex_hull()
        .map(|edge| if edge.face().fix().index() == outer { edge } else { edge.rev() })
        .collect();
    while let Some(edge) = open.pop() {
        let left = winding[&edge.face().fix().index()];
        let right = edge.rev().face().fix().index();
        if winding.contains_key(&right) {
            continue;
        }
        // Crossing an edge from its left to its right loses what runs along it.
        let along = runs.get(&(edge.from().fix().index(), edge.to().fix().index())).copied().unwrap_or(0);
        winding.insert(right, left - along);
        open.extend([edge.rev().next(), edge.rev().prev()]);
    }
    winding
}
