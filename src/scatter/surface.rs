//! The surface as pieces: runs of neighbouring triangles, then single triangles, then parts of triangles.

use glam::Vec3;
use smallvec::SmallVec;

use super::Candidate;
use crate::geometry::{SurfacePoint, hash, triangle};
use crate::scene::Scene;

/// The triangles that can carry points, in a spatially coherent order, with running areas.
pub struct Surface<'a> {
    scene: &'a Scene,
    /// Fronts, then backs of two-sided meshes.
    sides: [Side; 2],
}

#[derive(Default)]
struct Side {
    order: Vec<u32>,
    /// One more than `order`: area before each triangle.
    before: Vec<f64>,
}

/// A piece of surface: triangles `first..last` of a side's order, or a quarter of a quarter … of one triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// First triangle in the side's order.
    pub first: u32,
    /// One past the last.
    pub last: u32,
    /// Which part of the single triangle: a leading one, then two bits a split (0, 1, 2: at that corner; 3: middle).
    pub path: u64,
    /// Whether on the back.
    pub back: bool,
    /// Area, squared local units.
    pub area: f32,
}

/// Splits of one triangle stop here: the path's bits are used up.
const DEEPEST: u64 = 1 << 60;

impl<'a> Surface<'a> {
    /// The surface of a scene, its triangles in the given order; those without area are left out.
    pub fn new(scene: &'a Scene, order: impl Iterator<Item = u32>) -> Self {
        let mut sides: [Side; 2] = Default::default();
        for id in order {
            let area = f64::from(triangle::area(scene.corners(id)));
            if area <= 0.0 {
                continue;
            }
            let count = 1 + usize::from(scene.meshes[scene.mesh_of(id)].two_sided);
            for side in &mut sides[..count] {
                let end = side.before.last().copied().unwrap_or(0.0);
                if side.before.is_empty() {
                    side.before.push(0.0);
                }
                side.order.push(id);
                side.before.push(end + area);
            }
        }
        Self { scene, sides }
    }

    /// The scene it belongs to.
    pub fn scene(&self) -> &'a Scene {
        self.scene
    }

    /// As [`Scene::corners`], which the compiler does not inline.
    #[inline(always)]
    fn corners(&self, id: u32) -> [Vec3; 3] {
        let [a, b, c] = self.scene.triangles[id as usize];
        let vertices = &self.scene.vertices;
        [vertices[a as usize], vertices[b as usize], vertices[c as usize]]
    }

    /// Area of all sides that can carry points, squared local units.
    pub fn area(&self) -> f64 {
        self.sides.iter().filter_map(|s| s.before.last()).sum()
    }

    /// One piece a side.
    pub fn whole(&self) -> Vec<Piece> {
        let piece = |(back, side): (bool, &Side)| {
            let last = side.order.len() as u32;
            (last > 0).then(|| Piece {
                first: 0,
                last,
                path: 1,
                back,
                area: side.before[last as usize] as f32,
            })
        };
        [false, true].into_iter().zip(&self.sides).filter_map(piece).collect()
    }

    /// The triangles of a piece.
    pub fn triangles(&self, piece: &Piece) -> &[u32] {
        &self.sides[usize::from(piece.back)].order[piece.first as usize..piece.last as usize]
    }

    /// Halves a run of triangles by area, or quarters a triangle. A triangle at the limit of splitting stays whole.
    pub fn split(&self, piece: &Piece) -> SmallVec<[Piece; 4]> {
        if piece.last - piece.first > 1 {
            let before = &self.sides[usize::from(piece.back)].before;
            let (start, end) = (before[piece.first as usize], before[piece.last as usize]);
            let middle = before.partition_point(|&b| b < 0.5 * (start + end)) as u32;
            let middle = middle.clamp(piece.first + 1, piece.last - 1);
            let part = |first: u32, last: u32| {
                let area = (before[last as usize] - before[first as usize]) as f32;
                Piece { first, last, area, ..*piece }
            };
            return SmallVec::from_iter([part(piece.first, middle), part(middle, piece.last)]);
        }
        if piece.path >= DEEPEST {
            return SmallVec::from_iter([*piece]);
        }
        let part = |quarter| Piece { path: piece.path << 2 | quarter, area: 0.25 * piece.area, ..*piece };
        (0..4).map(part).collect()
    }

    /// Point `i` of `count` stratified ones on a piece, random by `seed`.
    pub fn candidate(&self, (number, piece): (u32, &Piece), (i, count): (u32, u32), seed: u64) -> Candidate {
        let draw = Draw::new(&self.sides[usize::from(piece.back)], piece, count, seed);
        let [x, y] = hash::unit_pair(draw.key, u64::from(i));
        let (place, barycentric) = draw.place((i as f32 + x) / draw.count, y, draw.first);
        self.stand(number, &Spot { place: place as u32, barycentric, back: piece.back })
    }

    /// Point `i` of the `count` of a piece's lattice.
    pub fn spot(&self, piece: &Piece, (i, count): (u32, u32), seed: u64) -> Spot {
        let draw = Draw::new(&self.sides[usize::from(piece.back)], piece, count, seed);
        let (place, barycentric) = draw.at(i, draw.first);
        Spot { place: place as u32, barycentric, back: piece.back }
    }

    /// A piece's lattice: `count` points, ascending. With the strata along the piece they spread evenly, so that a third
    /// fewer leave as few gaps as those of [`Surface::candidate`] do.
    pub fn spots(&self, piece: &Piece, count: u32, seed: u64) -> impl Iterator<Item = Spot> + '_ {
        let draw = Draw::new(&self.sides[usize::from(piece.back)], piece, count, seed);
        let back = piece.back;
        (0..count).scan(draw.first, move |k, i| {
            let (place, barycentric) = draw.at(i, *k);
            *k = place;
            Some(Spot { place: place as u32, barycentric, back })
        })
    }

    /// The candidate at a spot; `number` is that of its piece.
    pub fn stand(&self, number: u32, spot: &Spot) -> Candidate {
        let &Spot { place, barycentric, back } = spot;
        let id = self.sides[usize::from(back)].order[place as usize];
        let corners = self.corners(id);
        let position = triangle::point(corners, barycentric[0], barycentric[1]);
        let point = SurfacePoint { position, normal: facing(corners, back) };
        Candidate { point, triangle: id, barycentric, back, piece: number, place }
    }

    /// Calls `visit` with what throwing needs of a piece's lattice, the points of [`Surface::spots`].
    pub fn darts(&self, (number, piece): (u32, &Piece), count: u32, seed: u64, mut visit: impl FnMut(Dart)) {
        let draw = Draw::new(&self.sides[usize::from(piece.back)], piece, count, seed);
        let mut current = usize::MAX;
        let mut corners = [Vec3::ZERO; 3];
        let mut normal = Vec3::ZERO;
        let mut k = draw.first;
        for i in 0..count {
            let [u, v];
            (k, [u, v]) = draw.at(i, k);
            if k != current {
                current = k;
                corners = self.corners(draw.side.order[k]);
                normal = facing(corners, piece.back);
            }
            visit(Dart { position: triangle::point(corners, u, v), piece: number, normal, number: i });
        }
    }
}

/// Where a candidate lies.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Spot {
    /// The triangle's place in its side's order.
    pub place: u32,
    /// Barycentric (u, v) there.
    pub barycentric: [f32; 2],
    /// Whether on the back.
    pub back: bool,
}

/// A candidate before anybody needs to know more of it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Dart {
    /// Local position.
    pub position: Vec3,
    /// The active piece it was drawn from.
    pub piece: u32,
    /// Unit normal of its side.
    pub normal: Vec3,
    /// Its number among the piece's candidates.
    pub number: u32,
}

fn facing(corners: [Vec3; 3], back: bool) -> Vec3 {
    let front = triangle::normal(corners);
    if back { -front } else { front }
}

/// What is the same for all candidates of a piece.
struct Draw<'s> {
    side: &'s Side,
    first: usize,
    last: usize,
    key: u64,
    /// Where the lattice of the points begins.
    shift: u32,
    count: f32,
    /// The part of the triangle: its first corner and its signed scale.
    part: ([f32; 2], f32),
}

impl<'s> Draw<'s> {
    fn new(side: &'s Side, piece: &Piece, count: u32, seed: u64) -> Self {
        let key = hash::mix2(seed ^ u64::from(piece.first) << 32 ^ u64::from(piece.back), piece.path);
        let corner = unfold(piece.path, [0.0, 0.0]);
        let scale = unfold(piece.path, [1.0, 0.0])[0] - corner[0];
        let (first, last) = (piece.first as usize, piece.last as usize);
        Self { side, first, last, key, count: count as f32, shift: (key >> 32) as u32, part: (corner, scale) }
    }

    /// Place in the side's order, not before `from`, and barycentric (u, v) of point `i` of the lattice.
    #[inline(always)]
    fn at(&self, i: u32, from: usize) -> (usize, [f32; 2]) {
        let x = hash::unit(self.key, u64::from(i));
        // Multiples of the golden ratio.
        let y = (self.shift.wrapping_add(i.wrapping_mul(0x9e37_79b9)) >> 8) as f32 * (1.0 / 16_777_216.0);
        self.place((i as f32 + x) / self.count, y, from)
    }

    /// Place in the side's order, not before `from`, and barycentric (u, v): `along` the piece in [0, 1), `across` it.
    #[inline(always)]
    fn place(&self, along: f32, across: f32, from: usize) -> (usize, [f32; 2]) {
        let along = f64::from(along);
        let before = &self.side.before;
        let (k, within) = if self.last - self.first == 1 {
            (self.first, along)
        } else {
            let (start, end) = (before[self.first], before[self.last]);
            let want = start + along * (end - start);
            let k = self.find(want, from);
            (k, (want - before[k]) / (before[k + 1] - before[k]))
        };
        // A triangle whose area was lost to rounding gives NaN, which is not less than anything.
        let within = if within > 0.0 { (within as f32).min(0.999_999) } else { 0.0 };
        let (u, v) = triangle::uniform_barycentric([within, across]);
        let ([du, dv], scale) = self.part;
        (k, [du + scale * u, dv + scale * v])
    }

    /// The last triangle of the piece that begins at or before `want`, looked for from `from` on with growing steps.
    #[inline]
    fn find(&self, want: f64, from: usize) -> usize {
        let before = &self.side.before;
        let (mut low, mut step) = (from, 1);
        let mut high = low + 1;
        while high < self.last && before[high] <= want {
            low = high;
            high = (low + step).min(self.last);
            step *= 2;
        }
        // before[low] <= want (or low == from), and before[high] > want (or high == last).
        while high - low > 1 {
            let middle = low.midpoint(high);
            if before[middle] <= want { low = middle } else { high = middle }
        }
        low
    }
}

impl Piece {
    /// Sorts pieces that tile the surface along it: side, first triangle, part of the triangle.
    pub fn place(&self) -> (bool, u32, u64) {
        let bits = 63 - self.path.leading_zeros();
        (self.back, self.first, (self.path ^ (1 << bits)) << (60 - bits))
    }

    /// Where the piece ends in the order of [`Piece::place`].
    pub fn end(&self) -> (bool, u32, u64) {
        if self.path == 1 {
            return (self.back, self.last, 0);
        }
        let (back, first, path) = self.place();
        (back, first, path + (1 << (60 - (63 - self.path.leading_zeros()))))
    }
}

impl Candidate {
    /// Where a candidate lies along the order of [`Piece::place`]: in the last piece that is not beyond.
    pub fn along(&self) -> (bool, u32, u64) {
        let mut at = self.barycentric;
        let mut path = 0;
        for _ in 0..30 {
            let (part, within) = quarter(at);
            (path, at) = (path << 2 | part, within);
        }
        (self.back, self.place, path)
    }
}

/// Barycentric (u, v) of the whole triangle from those within the part that `path` names.
pub fn unfold(path: u64, [mut u, mut v]: [f32; 2]) -> [f32; 2] {
    let mut rest = path;
    while rest > 1 {
        (u, v) = match rest & 3 {
            0 => (0.5 * u, 0.5 * v),
            1 => (0.5 + 0.5 * u, 0.5 * v),
            2 => (0.5 * u, 0.5 + 0.5 * v),
            // The middle part is turned around: its corners are the midpoints opposite the triangle's.
            _ => (0.5 - 0.5 * u, 0.5 - 0.5 * v),
        };
        rest >>= 2;
    }
    [u, v]
}

/// The quarter that holds barycentric (u, v), and the coordinates within it: one step of [`unfold`] back.
#[inline]
pub fn quarter([u, v]: [f32; 2]) -> (u64, [f32; 2]) {
    if u > 0.5 {
        (1, [2.0 * u - 1.0, 2.0 * v])
    } else if v > 0.5 {
        (2, [2.0 * u, 2.0 * v - 1.0])
    } else if u + v < 0.5 {
        (0, [2.0 * u, 2.0 * v])
    } else {
        (3, [1.0 - 2.0 * u, 1.0 - 2.0 * v])
    }
}

/// A triangle's normal as the scene has it, on the side asked for.
pub fn side_normal(scene: &Scene, id: u32, back: bool) -> Vec3 {
    let front = scene.normal(id);
    if back { -front } else { front }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quarters_and_paths_are_inverses() {
        for i in 0..1000u64 {
            let (u, v) = triangle::uniform_barycentric(hash::unit_pair(4, i));
            let mut at = [u, v];
            let mut parts = Vec::new();
            for _ in 0..6 {
                let (part, within) = quarter(at);
                parts.push(part);
                at = within;
            }
            let path = parts.iter().fold(1, |path, part| path << 2 | part);
            let [x, y] = unfold(path, at);
            // Six doublings amplify the rounding of 6e-8 by 64, the way back divides again.
            assert!((x - u).abs() < 1e-6 && (y - v).abs() < 1e-6, "{u} {v} became {x} {y}");
        }
    }
}
