//! Which cells lie on which plot, so that a plot's cells are filled together.

use std::ops::Range;

use super::Plot;
use super::cells::{centres, depth};
use crate::geometry::{SurfacePoint, triangle};
use crate::scatter::surface::{side_normal, unfold};
use crate::scene::Scene;

/// Plots of more cells than this are slivers, of which rays meet a part; theirs are filled one by one.
const MOST_TOGETHER: usize = 2048;

/// The plots with cells, in the order of their cells.
#[derive(Default)]
pub(super) struct Plots {
    plots: Vec<Plot>,
    /// First cell of each, and the number of all.
    cells: Vec<u32>,
    /// First triangle of each in `order`, and the number of all.
    starts: Vec<u32>,
    /// The triangles, plot after plot.
    order: Vec<u32>,
}

impl Plots {
    /// Adds a plot whose triangles' cells begin at `first`.
    pub(super) fn push(&mut self, plot: &Plot, triangles: &[u32], first: u32) {
        self.plots.push(*plot);
        self.cells.push(first);
        self.starts.push(self.order.len() as u32);
        self.order.extend_from_slice(triangles);
    }

    /// Ends with the number of cells.
    pub(super) fn end(&mut self, cells: u32) {
        self.cells.push(cells);
        self.starts.push(self.order.len() as u32);
    }

    /// The plot of a cell, and all of its cells; None where they are too many.
    pub(super) fn together(&self, cell: usize) -> Option<(usize, Range<usize>)> {
        let number = self.cells.partition_point(|&first| first as usize <= cell) - 1;
        let cells = self.cells[number] as usize..self.cells[number + 1] as usize;
        (cells.len() <= MOST_TOGETHER).then_some((number, cells))
    }

    /// A plot and the centres of its cells, in their order.
    pub(super) fn centres(&self, scene: &Scene, number: usize) -> (&Plot, Vec<SurfacePoint>) {
        let plot = &self.plots[number];
        let mut points = vec![];
        for &id in &self.order[self.starts[number] as usize..self.starts[number + 1] as usize] {
            let corners = scene.corners(id);
            let normal = side_normal(scene, id, plot.piece.back);
            points.extend(centres(depth(scene, id, plot)).map(|at| {
                let [u, v] = unfold(plot.piece.path, at);
                SurfacePoint { position: triangle::point(corners, u, v), normal }
            }));
        }
        (plot, points)
    }
}
