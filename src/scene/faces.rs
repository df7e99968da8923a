//! Collects faces as a file lists them: triangles, polygons, strips.

use glam::DVec3;

use crate::light::Rgb;
use crate::scene::polygon::{self, Count};

/// Faces as they come; polygons wait until all vertices are known.
#[derive(Default)]
pub struct Faces {
    vertex_count: u64,
    triangles: Vec<[u32; 3]>,
    polygons: Vec<Polygon>,
    corners: Vec<u32>,
    /// Linear colour per triangle in `triangles`, if faces are coloured.
    colours: Option<Vec<Rgb>>,
    /// Rows with fewer than three corners.
    pub short: Count,
}

/// A corner index as the number of one of `vertex_count` vertices.
pub fn corner(index: i64, vertex_count: u64) -> Result<u32, String> {
    match u64::try_from(index) {
        Ok(at) if at < vertex_count => {
            u32::try_from(at).map_err(|_| format!("vertex index {index} needs more than 32 bits"))
        }
        _ => Err(format!("vertex index {index} is out of range, there are {vertex_count} vertices")),
    }
}

/// Triangle strips being unwound, index by index.
#[derive(Default)]
pub struct Strip {
    last: [u32; 2],
    seen: usize,
}

impl Strip {
    /// The triangle that the next index completes; -1 starts a new strip, every second triangle is turned over.
    pub fn next(&mut self, index: i64, vertex_count: u64) -> Result<Option<[u32; 3]>, String> {
        if index == -1 {
            self.seen = 0;
            return Ok(None);
        }
        let corner = corner(index, vertex_count)?;
        let [a, b] = self.last;
        let triangle = if self.seen.is_multiple_of(2) { [a, b, corner] } else { [b, a, corner] };
        let is_whole = self.seen >= 2;
        self.last = [b, corner];
        self.seen += 1;
        Ok(is_whole.then_some(triangle))
    }
}

/// A face of more than three corners.
struct Polygon {
    /// How many triangles of `Faces::triangles` come before it.
    before: usize,
    /// Its corners in `Faces::corners`.
    start: usize,
    length: usize,
    colour: Option<Rgb>,
}

/// Triangles in file order, with one colour each if faces are coloured.
pub struct Triangles {
    /// Corner indices.
    pub triangles: Vec<[u32; 3]>,
    /// Linear colours.
    pub colours: Option<Vec<Rgb>>,
    /// Polygons that no rule could triangulate and that were cut as fans.
    pub fans: Count,
}

impl Faces {
    /// Room for `count` rows; the caller has checked the count against the file's size.
    pub fn with_capacity(vertex_count: u64, count: usize, coloured: bool) -> Self {
        Self {
            vertex_count,
            triangles: Vec::with_capacity(count),
            colours: coloured.then(|| Vec::with_capacity(count)),
            ..Self::default()
        }
    }

    /// Whether there is neither a triangle nor a polygon.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty() && self.polygons.is_empty()
    }

    /// A corner index as the vertex number it is.
    pub fn corner(&self, index: i64) -> Result<u32, String> {
        corner(index, self.vertex_count)
    }

    /// Adds a triangle.
    pub fn push_triangle(&mut self, triangle: [u32; 3], colour: Option<Rgb>) {
        self.triangles.push(triangle);
        if let Some(colours) = &mut self.colours {
            colours.push(colour.unwrap_or_default());
        }
    }

    /// Adds row `row` with any number of corners.
    pub fn push(
        &mut self,
        row: u64,
        indices: impl ExactSizeIterator<Item = i64>,
        colour: Option<Rgb>,
    ) -> Result<(), String> {
        let length = indices.len();
        let start = self.corners.len();
        for index in indices {
            let corner = self.corner(index)?;
            self.corners.push(corner);
        }
        if length < 3 {
            self.short.note(row);
            self.corners.truncate(start);
        } else if length == 3 {
            let triangle = [self.corners[start], self.corners[start + 1], self.corners[start + 2]];
            self.corners.truncate(start);
            self.push_triangle(triangle, colour);
        } else {
            self.polygons.push(Polygon { before: self.triangles.len(), start, length, colour });
        }
        Ok(())
    }

    /// Adds a row of triangle strips, -1 starting a new one; every second triangle of a strip is turned over.
    pub fn push_strips(&mut self, indices: impl Iterator<Item = i64>) -> Result<(), String> {
        let mut strip = Strip::default();
        for index in indices {
            if let Some(triangle) = strip.next(index, self.vertex_count)? {
                self.push_triangle(triangle, None);
            }
        }
        Ok(())
    }

    /// Cuts the polygons into triangles, in place of each.
    pub fn finish(self, positions: &[DVec3]) -> Triangles {
        self.finish_at(&|vertex| positions[vertex as usize])
    }

    /// [`Faces::finish`] with positions by number, from wherever they are.
    pub fn finish_at(self, position: &dyn Fn(u32) -> DVec3) -> Triangles {
        let mut fans = Count::default();
        if self.polygons.is_empty() {
            return Triangles { triangles: self.triangles, colours: self.colours, fans };
        }
        let mut triangles = Vec::with_capacity(self.triangles.len() + self.corners.len());
        let mut colours = self.colours.as_ref().map(|_| Vec::with_capacity(triangles.capacity()));
        let mut done = 0;
        let mut copy_until = |end: usize, triangles: &mut Vec<[u32; 3]>, colours: &mut Option<Vec<Rgb>>| {
            triangles.extend_from_slice(&self.triangles[done..end]);
            if let (Some(to), Some(from)) = (colours, &self.colours) {
                to.extend_from_slice(&from[done..end]);
            }
            done = end;
        };
        for (number, polygon) in self.polygons.iter().enumerate() {
            copy_until(polygon.before, &mut triangles, &mut colours);
            let corners = &self.corners[polygon.start..polygon.start + polygon.length];
            if !polygon::triangulate_at(position, corners, &mut triangles) {
                fans.note(number as u64);
            }
            if let Some(colours) = &mut colours {
                colours.resize(triangles.len(), polygon.colour.unwrap_or_default());
            }
        }
        copy_until(self.triangles.len(), &mut triangles, &mut colours);
        Triangles { triangles, colours, fans }
    }
}
