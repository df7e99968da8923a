//! A chunk's share of the proxy: a vertex for every occupied cell, a triangle for every three cells that are joined.
//!
//! This work is based on: Rossignac and Borrel, "Multi-resolution 3D approximations for rendering complex scenes", 1993.
//! Vertices of a cell are replaced by their mean (they take the one of most weight). Of triangles that join the same three
//! cells we keep one with the sense that prevails, so that a closed surface stays closed; where none prevails, as when both
//! sides of a thin sheet fall together, we keep one of each sense.

use std::ops::Range;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::light::Rgb;
use crate::scene::Placement;

/// What the vertices of cells amount to.
pub struct Means {
    /// Occupied cells, ascending.
    pub cells: Vec<u64>,
    /// Local mean position of each cell's vertices.
    pub means: Vec<Vec3>,
    /// Mean colour.
    pub colours: Option<Vec<Rgb>>,
}

/// Means by cell; sums run over vertices in ascending number.
pub fn means(cells: &[u64], world: &[DVec3], colours: Option<&[Rgb]>, placement: &Placement) -> Means {
    let mut order: Vec<(u64, u32)> = cells.iter().copied().zip(0..).collect();
    order.par_sort_unstable();
    let runs: Vec<&[(u64, u32)]> = order.chunk_by(|a, b| a.0 == b.0).collect();
    let mean = |run: &[(u64, u32)], value: &dyn Fn(usize) -> DVec3| {
        run.iter().map(|&(_, at)| value(at as usize)).sum::<DVec3>() / run.len() as f64
    };
    Means {
        cells: runs.iter().map(|run| run[0].0).collect(),
        means: runs.par_iter().map(|run| placement.to_local(mean(run, &|at| world[at]))).collect(),
        colours: colours.map(|colours| {
            let colour = |run: &&[(u64, u32)]| mean(run, &|at| colours[at].as_dvec3()).as_vec3();
            runs.par_iter().map(colour).collect()
        }),
    }
}

/// The triples of cells joined by triangles, the first of each within `own`, sorted.
///
/// All triangles that join three such cells must be among those given.
pub fn faces(triangles: &[[u32; 3]], cells: &[u64], own: Range<u64>) -> Vec<[u64; 3]> {
    let joined = |corners: &[u32; 3]| {
        let [a, b, c] = corners.map(|corner| cells[corner as usize]);
        if a == b || b == c || c == a {
            return None;
        }
        let mut sorted = [a, b, c];
        sorted.sort_unstable();
        // Turned so that the least comes first, the others stand in order or not.
        let ahead = [[a, b, c], [b, c, a], [c, a, b]].contains(&sorted);
        own.contains(&sorted[0]).then_some((sorted, ahead))
    };
    let mut joined: Vec<([u64; 3], bool)> = triangles.par_iter().filter_map(joined).collect();
    joined.par_sort_unstable();
    let mut faces = Vec::new();
    for run in joined.chunk_by(|x, y| x.0 == y.0) {
        let [a, b, c] = run[0].0;
        let ahead = run.iter().filter(|(_, ahead)| *ahead).count();
        if 2 * ahead >= run.len() {
            faces.push([a, b, c]);
        }
        if 2 * ahead <= run.len() {
            faces.push([a, c, b]);
        }
    }
    faces
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sense_that_prevails_is_kept_and_both_of_a_sheet() {
        let cells = [10, 20, 30, 10, 40];
        let triangles = [[0, 1, 2], [2, 1, 0], [1, 2, 3], [0, 3, 1], [4, 2, 1], [1, 2, 4]];
        // 10-20-30 twice ahead and once back; 20-30-40 once each; 10-10-20 is no triangle.
        assert_eq!(faces(&triangles, &cells, 0..100), [[10, 20, 30], [20, 30, 40], [20, 40, 30]]);
        assert_eq!(faces(&triangles, &cells, 20..100), [[20, 30, 40], [20, 40, 30]]);
    }

    #[test]
    fn means_are_those_of_their_cells() {
        let placement = Placement { origin: DVec3::ZERO, scale: 2.0 };
        let world = [DVec3::X, DVec3::Y, DVec3::new(3.0, 0.0, 0.0)];
        let found = means(&[7, 5, 7], &world, Some(&[Rgb::ONE, Rgb::X, Rgb::ZERO]), &placement);
        assert_eq!(found.cells, [5, 7]);
        assert_eq!(found.means, [Vec3::Y * 0.5, Vec3::X]);
        assert_eq!(found.colours, Some(vec![Rgb::X, Rgb::splat(0.5)]));
    }
}
