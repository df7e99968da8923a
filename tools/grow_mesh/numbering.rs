//! Numbers of the grown mesh's vertices and faces: which place has which number, and back, in no memory of its size.
//!
//! Vertices: the base's, then k − 1 on each edge, then (k − 1)(k − 2)/2 inside each triangle, then 3k copies for each
//! triangle that is torn off. Faces: k² of each triangle in turn, row by row away from its first side.

use glowtree::geometry::hash::mix2;

use crate::base::{Base, SIDES};
use crate::surface::{PARTS, Place};

/// The largest k: squares of it times eight stay below 2³².
pub const LARGEST_K: u32 = 4096;

/// How much of a row's distance the squeezed row keeps: slivers of longest edge squared over area near 230.
const SQUEEZED: u32 = PARTS / 100;

/// What of a triangle's own numbers is left to chance.
#[derive(Debug, Clone, Copy, Default)]
pub struct Flaws {
    /// Share of the faces that are slivers.
    pub slivers: f64,
    /// Share of the base's triangles whose border vertices are copies of their own.
    pub duplicates: f64,
    /// What the triangles are drawn by.
    pub seed: u64,
}

/// The numbers over a base.
#[derive(Debug)]
pub struct Numbering<'a> {
    base: &'a Base,
    k: u32,
    torn: Vec<u32>,
    squeezed_below: f64,
    seed: u64,
}

impl<'a> Numbering<'a> {
    /// The numbers for k parts of each edge.
    ///
    /// # Errors
    /// A line that says what is too large.
    pub fn new(base: &'a Base, k: u32, flaws: Flaws) -> Result<Self, String> {
        let torn_off = |id: &u32| chance(flaws.seed, 2 * u64::from(*id)) < flaws.duplicates;
        let torn = (0..base.triangles.len() as u32).filter(torn_off).collect();
        let most = f64::from(slivers_in(k)) / (f64::from(k) * f64::from(k));
        if flaws.slivers > most {
            return Err(format!("k = {k} has room for {most:.3} slivers, not for {}", flaws.slivers));
        }
        let squeezed_below = if most > 0.0 { flaws.slivers / most } else { 0.0 };
        let made = Self { base, k, torn, squeezed_below, seed: flaws.seed };
        let count = made.vertex_count();
        if count > u64::from(u32::MAX) {
            return Err(format!("{count} vertices: a PLY numbers at most {}", u32::MAX));
        }
        Ok(made)
    }

    /// How many vertices there are.
    pub fn vertex_count(&self) -> u64 {
        self.copies_from() + self.torn.len() as u64 * 3 * u64::from(self.k)
    }

    /// How many faces there are.
    pub fn face_count(&self) -> u64 {
        self.base.triangles.len() as u64 * u64::from(self.k * self.k)
    }

    /// The place of a vertex.
    pub fn place(&self, vertex: u64) -> Place {
        let (k, inside) = (u64::from(self.k), u64::from(inside_count(self.k)));
        if vertex < self.edges_from() {
            Place::Corner(vertex as u32)
        } else if vertex < self.inside_from() {
            let at = vertex - self.edges_from();
            Place::Edge((at / (k - 1)) as u32, (at % (k - 1)) as u32 + 1)
        } else if vertex < self.copies_from() {
            let at = vertex - self.inside_from();
            self.inside_place((at / inside) as u32, (at % inside) as u32)
        } else {
            let at = vertex - self.copies_from();
            self.border_place(self.torn[(at / (3 * k)) as usize], (at % (3 * k)) as u32)
        }
    }

    /// The corners of a face.
    pub fn face(&self, number: u64) -> [u32; 3] {
        let square = self.k * self.k;
        let triangle = (number / u64::from(square)) as u32;
        let part = (number % u64::from(square)) as u32;
        // Rows from the one of n parts on hold n² faces.
        let n = (square - part - 1).isqrt() + 1;
        let (i, j) = ((part + n * n - square) / 2, self.k - n);
        let down = (part + n * n - square) % 2 == 1;
        let corners =
            if down { [[i + 1, j], [i + 1, j + 1], [i, j + 1]] } else { [[i, j], [i + 1, j], [i, j + 1]] };
        let copy = self.torn.binary_search(&triangle).ok();
        corners.map(|at| self.number(triangle, copy, at))
    }

    fn edges_from(&self) -> u64 {
        self.base.vertices.len() as u64
    }

    fn inside_from(&self) -> u64 {
        self.edges_from() + self.base.edges.len() as u64 * u64::from(self.k - 1)
    }

    fn copies_from(&self) -> u64 {
        self.inside_from() + self.base.triangles.len() as u64 * u64::from(inside_count(self.k))
    }

    /// The number of the lattice point i parts towards corner 1 and j towards corner 2.
    fn number(&self, triangle: u32, copy: Option<usize>, [i, j]: [u32; 2]) -> u32 {
        let (k, id) = (self.k, triangle as usize);
        if i > 0 && j > 0 && i + j < k {
            let row = inside_count(k) - rest_from(k - 1 - j);
            let first = self.inside_from() + u64::from(triangle) * u64::from(inside_count(k));
            return (first + u64::from(row + i - 1)) as u32;
        }
        let border = match (i, j) {
            (0, 0) => 0,
            (_, 0) if i == k => 1,
            (0, _) if j == k => 2,
            (_, 0) => 3 + i - 1,
            (0, _) => 3 + (k - 1) + j - 1,
            _ => 3 + 2 * (k - 1) + j - 1,
        };
        if let Some(copy) = copy {
            return (self.copies_from() + copy as u64 * 3 * u64::from(k) + u64::from(border)) as u32;
        }
        match self.border_place(triangle, border) {
            Place::Edge(edge, step) => {
                (self.edges_from() + u64::from(edge) * u64::from(k - 1)) as u32 + step - 1
            }
            _ => self.base.triangles[id][border as usize],
        }
    }

    /// The place of a triangle's border point: its corners, then k − 1 on each of its sides.
    fn border_place(&self, triangle: u32, border: u32) -> Place {
        let corners = self.base.triangles[triangle as usize];
        if border < 3 {
            return Place::Corner(corners[border as usize]);
        }
        let (side, step) = (((border - 3) / (self.k - 1)) as usize, (border - 3) % (self.k - 1) + 1);
        let forward = corners[SIDES[side][0]] < corners[SIDES[side][1]];
        Place::Edge(self.base.sides[triangle as usize][side], if forward { step } else { self.k - step })
    }

    /// The place of a triangle's inner point; in squeezed triangles every second row lies close to the one before.
    fn inside_place(&self, triangle: u32, at: u32) -> Place {
        let rest = inside_count(self.k) - at;
        // The shortest rows that hold so many points: n (n + 1)/2 ≥ rest.
        let n = (8 * rest - 7).isqrt().div_ceil(2);
        let j = self.k - 1 - n;
        let i = at + rest_from(n) - inside_count(self.k) + 1;
        let mut parts = [i * PARTS, j * PARTS];
        if j % 2 == 1 && self.is_squeezed(triangle) {
            let moved = PARTS - SQUEEZED;
            parts = [parts[0] + moved / 2, parts[1] - moved];
        }
        Place::Inside(triangle, parts)
    }

    fn is_squeezed(&self, triangle: u32) -> bool {
        self.squeezed_below > 0.0 && chance(self.seed, 2 * u64::from(triangle) + 1) < self.squeezed_below
    }
}

/// Points inside a triangle.
fn inside_count(k: u32) -> u32 {
    (k - 1) * k.saturating_sub(2) / 2
}

/// Inner points of the rows of n and fewer.
fn rest_from(n: u32) -> u32 {
    n * (n + 1) / 2
}

/// Slivers of a squeezed triangle: below each squeezed row of n points n faces with one corner in it, n − 1 with two.
fn slivers_in(k: u32) -> u32 {
    (1..k.saturating_sub(1)).step_by(2).map(|j| 2 * (k - 1 - j) - 1).sum()
}

/// An even number of [0, 1).
fn chance(seed: u64, counter: u64) -> f64 {
    (mix2(seed, counter) >> 11) as f64 / (1u64 << 53) as f64
}
