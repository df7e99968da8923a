//! Dart throwing in blocks: many at a time, with the same outcome for any number of threads.
//!
//! This work is based on: Wei, "Parallel Poisson Disk Sampling", SIGGRAPH 2008 (phases of cells that cannot conflict).
//! Our phases are over blocks of 16³ cells, one spacing wide, in eight colours. Instead of asking for every candidate
//! whether a kept point is near, each kept point strikes out the candidates around it: there are a dozen candidates to a
//! kept point, so that cells are looked up a dozen times less, and the candidates of a row of cells lie side by side.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};
use std::ops::Range;

use glam::Vec3;
use rayon::prelude::*;

use super::Candidate;
use super::floor;
use super::growth::Growth;
use super::surface::Dart;
use super::thin::CONFLICT_COSINE;
use crate::geometry::{SurfacePoint, hash};

/// Cells along a block: larger blocks leave the second-level cache, smaller ones are mostly border.
const SIDE: i32 = 16;

/// Pieces whose candidates one task draws.
const TASK_PIECES: usize = 64;

/// Tasks whose candidates are held at a time: about a million candidates, 40 MB.
const BATCH_TASKS: usize = 128;

/// Block coordinates.
type Key = [i32; 3];

/// Folds block coordinates into a hash.
#[derive(Default, Clone)]
struct Folding(u64);

impl Hasher for Folding {
    fn finish(&self) -> u64 {
        hash::mix(self.0)
    }
    fn write(&mut self, bytes: &[u8]) {
        for part in bytes.chunks_exact(4) {
            let part = u32::from_ne_bytes([part[0], part[1], part[2], part[3]]);
            self.0 = self.0.wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(23) ^ u64::from(part);
        }
    }
    fn write_usize(&mut self, _: usize) {}
}

type Directory = HashMap<Key, u32, BuildHasherDefault<Folding>>;

/// Kept points of one level by block.
struct Layer {
    spacing: f32,
    directory: Directory,
    members: Vec<Vec<SurfacePoint>>,
}

/// Points kept so far, level by level: on each, none is closer to another than the level's spacing.
#[derive(Default)]
pub struct Packing {
    layers: Vec<Layer>,
}

/// The candidates that a task drew, by block.
struct Drawn {
    /// Blocks, and where the darts of each end.
    blocks: Vec<(Key, u32)>,
    darts: Vec<Dart>,
}

/// A block that candidates of a batch lie in.
struct Block {
    key: Key,
    /// (task, darts), in the order of tasks.
    parts: Vec<(usize, Range<usize>)>,
}

impl Packing {
    /// Throws candidates on the active pieces, so many a squared spacing as `densities` says of each, none where that is
    /// zero. Gives those kept, in an order that depends on no thread.
    pub fn throw(&mut self, growth: &Growth<'_>, densities: &[f32]) -> Vec<Candidate> {
        let layer = Layer { spacing: growth.spacing, directory: Directory::default(), members: vec![] };
        self.layers.push(layer);
        let pieces: Vec<u32> = (0..densities.len() as u32).filter(|&p| densities[p as usize] > 0.0).collect();
        let mut kept = Vec::new();
        for batch in pieces.chunks(TASK_PIECES * BATCH_TASKS) {
            let drawn: Vec<Drawn> =
                batch.par_chunks(TASK_PIECES).map(|pieces| Drawn::new(growth, pieces, densities)).collect();
            let blocks = blocks(&drawn);
            for colour in 0..8 {
                let fresh: Vec<(Key, Vec<Candidate>)> = blocks
                    .par_iter()
                    .filter(|block| colour_of(block.key) == colour)
                    .map_init(Arena::default, |arena, block| {
                        arena.fill(block, &drawn, growth.spacing);
                        self.strike(arena);
                        (block.key, arena.keep(growth, densities))
                    })
                    .collect();
                for (key, candidates) in fresh {
                    self.add(key, &candidates);
                    kept.extend(candidates);
                }
            }
        }
        kept
    }

    /// Strikes out the arena's candidates that conflict with points kept before.
    fn strike(&self, arena: &mut Arena) {
        // One cell around, and a margin for the rounding of coordinates.
        let margin = arena.spacing * 1.02 + 1e-6 * arena.corner.abs().max_element();
        let low = arena.corner - margin;
        let high = arena.corner + SIDE as f32 * arena.spacing + margin;
        for layer in &self.layers {
            let (first, last) = (block_of(low, layer.spacing), block_of(high, layer.spacing));
            for x in first[0]..=last[0] {
                for y in first[1]..=last[1] {
                    for z in first[2]..=last[2] {
                        let Some(&block) = layer.directory.get(&[x, y, z]) else { continue };
                        for point in &layer.members[block as usize] {
                            if point.position.cmpge(low).all() && point.position.cmple(high).all() {
                                arena.strike(point, 0);
                            }
                        }
                    }
                }
            }
        }
    }

    fn add(&mut self, key: Key, candidates: &[Candidate]) {
        let Some(layer) = self.layers.last_mut() else { return };
        let block = *layer.directory.entry(key).or_insert_with(|| {
            layer.members.push(vec![]);
            layer.members.len() as u32 - 1
        });
        layer.members[block as usize].extend(candidates.iter().map(|c| c.point));
    }
}

fn block_of(position: Vec3, spacing: f32) -> Key {
    floor(position * (1.0 / (SIDE as f32 * spacing)))
}

fn colour_of([x, y, z]: Key) -> i32 {
    (x & 1) | (y & 1) << 1 | (z & 1) << 2
}

impl Drawn {
    fn new(growth: &Growth<'_>, pieces: &[u32], densities: &[f32]) -> Self {
        let count = |&p: &u32| growth.count(p as usize, densities[p as usize]) as usize;
        let total = pieces.iter().map(count).sum();
        let mut darts: Vec<Dart> = Vec::with_capacity(total);
        let mut members: Vec<u32> = Vec::with_capacity(total);
        let mut blocks: Vec<(Key, u32)> = Vec::new();
        let mut directory = Directory::default();
        let mut last = (Key::default(), u32::MAX);
        for &piece in pieces {
            growth.darts(piece as usize, densities[piece as usize], |dart| {
                let key = block_of(dart.position, growth.spacing);
                if last.1 == u32::MAX || last.0 != key {
                    let block = *directory.entry(key).or_insert_with(|| {
                        blocks.push((key, 0));
                        blocks.len() as u32 - 1
                    });
                    last = (key, block);
                }
                blocks[last.1 as usize].1 += 1;
                members.push(last.1);
                darts.push(dart);
            });
        }
        let mut sum = 0;
        let mut next: Vec<u32> = Vec::with_capacity(blocks.len());
        for (_, count) in &mut blocks {
            next.push(sum);
            sum += *count;
            *count = sum;
        }
        let mut sorted = vec![Dart::default(); total];
        for (dart, block) in darts.iter().zip(&members) {
            let at = &mut next[*block as usize];
            sorted[*at as usize] = *dart;
            *at += 1;
        }
        Self { blocks, darts: sorted }
    }
}

/// The blocks of a batch, in the order in which its tasks met them.
fn blocks(drawn: &[Drawn]) -> Vec<Block> {
    let mut directory = Directory::default();
    let mut blocks: Vec<Block> = Vec::new();
    for (task, drawn) in drawn.iter().enumerate() {
        let mut start = 0;
        for &(key, end) in &drawn.blocks {
            let block = *directory.entry(key).or_insert_with(|| {
                blocks.push(Block { key, parts: vec![] });
                blocks.len() as u32 - 1
            });
            blocks[block as usize].parts.push((task, start..end as usize));
            start = end as usize;
        }
    }
    blocks
}

/// A block's candidates by cell, structure of arrays.
#[derive(Default)]
struct Arena {
    spacing: f32,
    inverse: f32,
    corner: Vec3,
    /// Where the candidates of each cell begin, x running fastest; one more at the end.
    starts: Vec<u32>,
    position: [Vec<f32>; 3],
    normal: [Vec<f32>; 3],
    /// Not zero for candidates that conflict with a kept point.
    struck: Vec<u32>,
    /// Piece and number.
    origin: Vec<[u32; 2]>,
    cells: Vec<u16>,
}

impl Arena {
    /// Sorts a block's candidates into cells.
    fn fill(&mut self, block: &Block, drawn: &[Drawn], spacing: f32) {
        self.spacing = spacing;
        self.corner = Vec3::from_array(block.key.map(|k| k as f32)) * (SIDE as f32 * spacing);
        let darts = || block.parts.iter().flat_map(|(task, range)| &drawn[*task].darts[range.clone()]);
        self.inverse = 1.0 / spacing;
        self.cells.clear();
        self.starts.clear();
        self.starts.resize((SIDE * SIDE * SIDE) as usize + 1, 0);
        for dart in darts() {
            let [x, y, z] = within((dart.position - self.corner) * self.inverse);
            let cell = x + SIDE * (y + SIDE * z);
            self.cells.push(cell as u16);
            self.starts[cell as usize] += 1;
        }
        let mut sum = 0;
        for start in &mut self.starts {
            sum += *start;
            *start = sum;
        }
        let count = self.cells.len();
        for column in self.position.iter_mut().chain(&mut self.normal) {
            column.resize(count, 0.0);
        }
        self.struck.clear();
        self.struck.resize(count, 0);
        self.origin.resize(count, [0; 2]);
        for (dart, cell) in darts().zip(&self.cells) {
            let start = &mut self.starts[usize::from(*cell)];
            *start -= 1;
            let at = *start as usize;
            for axis in 0..3 {
                self.position[axis][at] = dart.position[axis];
                self.normal[axis][at] = dart.normal[axis];
            }
            self.origin[at] = [dart.piece, dart.number];
        }
    }

    /// Strikes out what conflicts with a point, from candidate `from` on.
    #[inline]
    fn strike(&mut self, point: &SurfacePoint, from: usize) {
        let at = (point.position - self.corner) * self.inverse;
        // Cells are as wide as the spacing; a little more makes up for rounding.
        let (low, high) = (within(at - 1.001), within(at + 1.001));
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                let row = SIDE * (y + SIDE * z);
                let end = self.starts[(row + high[0]) as usize + 1] as usize;
                let start = (self.starts[(row + low[0]) as usize] as usize).max(from);
                if start < end {
                    self.strike_run(point, start..end);
                }
            }
        }
    }

    #[inline]
    fn strike_run(&mut self, point: &SurfacePoint, run: Range<usize>) {
        let square = self.spacing * self.spacing;
        let [px, py, pz] = point.position.to_array();
        let [nx, ny, nz] = point.normal.to_array();
        let position = [0, 1, 2].map(|axis| &self.position[axis][run.clone()]);
        let normal = [0, 1, 2].map(|axis| &self.normal[axis][run.clone()]);
        let struck = &mut self.struck[run];
        let count = struck.len();
        let (x, y, z) = (&position[0][..count], &position[1][..count], &position[2][..count]);
        let (a, b, c) = (&normal[0][..count], &normal[1][..count], &normal[2][..count]);
        for i in 0..count {
            let (dx, dy, dz) = (x[i] - px, y[i] - py, z[i] - pz);
            let near = dx * dx + dy * dy + dz * dz < square;
            let alike = a[i] * nx + b[i] * ny + c[i] * nz > CONFLICT_COSINE;
            struck[i] |= u32::from(near & alike);
        }
    }

    /// Keeps one candidate after the other that no kept one has struck out.
    fn keep(&mut self, growth: &Growth<'_>, densities: &[f32]) -> Vec<Candidate> {
        let mut kept = Vec::new();
        for i in 0..self.struck.len() {
            if self.struck[i] == 0 {
                let part = |columns: &[Vec<f32>; 3]| Vec3::new(columns[0][i], columns[1][i], columns[2][i]);
                let point = SurfacePoint { position: part(&self.position), normal: part(&self.normal) };
                self.strike(&point, i + 1);
                let [piece, number] = self.origin[i];
                let piece = piece as usize;
                kept.push(growth.candidate(piece, (number, growth.count(piece, densities[piece]))));
            }
        }
        kept
    }
}

/// Cell coordinates in the block; what lies beyond its border belongs to the outermost.
#[inline]
fn within(at: Vec3) -> [i32; 3] {
    let [x, y, z] = floor(at);
    [x.clamp(0, SIDE - 1), y.clamp(0, SIDE - 1), z.clamp(0, SIDE - 1)]
}
