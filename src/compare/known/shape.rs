//! Triangle shapes made in code, world coordinates (f64). A shape's front is the side its triangles run counter-clockwise on.

use glam::DVec3;

/// Triangles over their own vertices, world coordinates.
#[derive(Debug, Clone, Default)]
pub struct Shape {
    /// Corners.
    pub vertices: Vec<DVec3>,
    /// Counter-clockwise seen from the front.
    pub triangles: Vec<[u32; 3]>,
}

impl Shape {
    /// The same surface with its front on the other side.
    pub fn flipped(mut self) -> Self {
        self.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        self
    }

    /// The shape with each vertex moved by `map`.
    pub fn mapped(mut self, map: impl Fn(DVec3) -> DVec3) -> Self {
        self.vertices.iter_mut().for_each(|v| *v = map(*v));
        self
    }

    /// Scaled about the world's origin.
    pub fn scaled(self, factor: f64) -> Self {
        self.mapped(|v| v * factor)
    }

    /// Moved.
    pub fn translated(self, by: DVec3) -> Self {
        self.mapped(|v| v + by)
    }

    /// Both shapes as one; their vertices stay apart.
    pub fn with(mut self, other: &Self) -> Self {
        let first = self.vertices.len() as u32;
        self.vertices.extend(&other.vertices);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|v| v + first)));
        self
    }

    /// Total area of one side.
    pub fn area(&self) -> f64 {
        self.triangles.iter().map(|t| 0.5 * self.area_vector(t).length()).sum()
    }

    /// Volume enclosed by a closed shape, positive when its front looks outwards.
    pub fn volume(&self) -> f64 {
        self.triangles.iter().map(|t| self.vertices[t[0] as usize].dot(self.area_vector(t)) / 6.0).sum()
    }

    pub(super) fn area_vector(&self, t: &[u32; 3]) -> DVec3 {
        let [a, b, c] = t.map(|v| self.vertices[v as usize]);
        (b - a).cross(c - a)
    }
}

/// A grid of `columns` × `rows` quads over the unit square, each vertex placed by `map`; the front is the side from
/// which u to v runs counter-clockwise.
pub fn grid(columns: u32, rows: u32, map: impl Fn(f64, f64) -> DVec3) -> Shape {
    let mut shape = Shape::default();
    for j in 0..=rows {
        for i in 0..=columns {
            shape.vertices.push(map(f64::from(i) / f64::from(columns), f64::from(j) / f64::from(rows)));
        }
    }
    for j in 0..rows {
        for i in 0..columns {
            let a = j * (columns + 1) + i;
            let (b, c, d) = (a + 1, a + columns + 2, a + columns + 1);
            shape.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    shape
}

/// The parallelogram from `corner` along `along` and `up`, n × n quads; the front looks to along × up.
pub fn quad(corner: DVec3, along: DVec3, up: DVec3, n: u32) -> Shape {
    grid(n, n, |u, v| corner + along * u + up * v)
}
