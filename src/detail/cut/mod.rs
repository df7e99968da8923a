//! The first passes over a file: where its surface is, which cells make which chunk, and every chunk's triangles side by
//! side in one scratch file.
//!
//! This work is based on: Rossignac and Borrel, "Multi-resolution 3D approximations for rendering complex scenes", 1993
//! (clustering vertices by cells), and Lindstrom, "Out-of-Core Simplification of Large Polygonal Models", SIGGRAPH 2000.
//! Lindstrom makes one pass over a soup of triangles with memory for the result; here vertices have numbers, so cells are
//! grouped to chunks first, and a cell never has to be merged.

pub mod bits;
mod grid;
mod paged;
mod sweep;

use std::path::Path;
use std::sync::Mutex;

use glam::{DAffine3, DVec3};
use serde::{Deserialize, Serialize};

use crate::archive::{Map, Pause};
use crate::error::{Error, Result};
use crate::scene::ply::stream::marker::{self, Origin};
use crate::scene::ply::stream::{FaceNotes, Stream};
use bits::Bits;
use grid::{BLOCK_BITS, Grid, Histogram, Occupied};
use paged::{Paged, Pages};
use sweep::Sweep;

use super::CutParams;

/// The owner of a vertex that no face uses.
pub const NOBODY: u16 = u16::MAX;

/// Chunks at the most: owners have 16 bits.
const MOST_CHUNKS: u64 = 60_000;

/// A mesh cut up: the grid of cells, which run of cells makes which chunk, and a scratch file of every chunk's triangles.
pub struct Shards {
    transform: DAffine3,
    cut: Cut,
    grid: Grid,
    owners: Map,
    corners: Map,
}

/// What the passes found out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Cut {
    /// Corners of the box around all used vertices, world; floats as bits, which JSON keeps.
    bounds: [[u64; 3]; 2],
    cell: u64,
    /// First cell of each chunk.
    starts: Vec<u64>,
    notes: FaceNotes,
    /// Per chunk: triangles whose first corner lies in it.
    owned: Vec<u64>,
    pages: Vec<Pages>,
}

/// What a cut was made from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Asked {
    origin: Origin,
    params: [usize; 2],
    transform: [u64; 12],
}

impl Shards {
    /// Cuts a mesh, or finds the cut that an earlier run with the same parameters left in `scratch`, a folder that is made
    /// if it is not there; whoever owns it removes it when the chunks are made.
    ///
    /// Two passes over the faces and four over the vertices. Memory: one bit a vertex of the file, 64 KB a chunk, 16 MB
    /// for the fine grid, what the blocks of cells take (some 50 bytes each). Disk: 2 bytes a vertex, 12 a triangle and
    /// chunk that it touches. The same for any number of threads.
    ///
    /// # Errors
    /// [`Error::Input`] when faces or used positions are not what they should be, naming the row; the pause's;
    /// [`Error::Io`], [`Error::DiskFull`].
    pub fn make(
        stream: &Stream,
        transform: &DAffine3,
        params: &CutParams,
        scratch: &Path,
        pause: Pause<'_>,
    ) -> Result<Self> {
        let mark = scratch.join("shards.json");
        let [owners, corners] = ["owners.raw", "shards.raw"].map(|name| scratch.join(name));
        let asked = Asked {
            origin: stream.origin(),
            params: [params.chunk_triangles, params.proxy_triangles],
            transform: transform.to_cols_array().map(f64::to_bits),
        };
        let there: Option<(Asked, Cut)> = marker::read(&mark).filter(|(made, cut): &(Asked, Cut)| {
            let pages = cut.pages.iter().map(Pages::bytes).sum::<u64>();
            let whole = [(&owners, 2 * stream.vertex_count()), (&corners, pages)];
            *made == asked && whole.iter().all(|(path, bytes)| length(path) == Some(*bytes))
        });
        let cut = if let Some((_, cut)) = there {
            cut
        } else {
            std::fs::create_dir_all(scratch).map_err(|e| Error::io(scratch, "creating", e))?;
            marker::remove(&mark)?;
            let cut = Cutter { sweep: Sweep { stream, transform, pause }, params }.cut(&owners, &corners)?;
            marker::write(&mark, &(&asked, &cut))?;
            cut
        };
        let open = |path: &Path| Map::open(path).map_err(|e| Error::io(path, "opening", e));
        let (owners, corners) = (open(&owners)?, open(&corners)?);
        let [low, high] = cut.bounds.map(from_bits);
        let grid = Grid::new(low, (high - low).max_element(), f64::from_bits(cut.cell));
        Ok(Self { transform: *transform, cut, grid, owners, corners })
    }

    /// The box around all corners of triangles, world coordinates (after the transform): lower and upper corner.
    pub fn bounds(&self) -> [DVec3; 2] {
        self.cut.bounds.map(from_bits)
    }

    /// Edge of a proxy cell, world units.
    pub fn cell(&self) -> f64 {
        f64::from_bits(self.cut.cell)
    }

    /// Chunks.
    pub fn chunk_count(&self) -> usize {
        self.cut.starts.len()
    }

    /// Triangles of the file, each counted for the chunk that owns it.
    pub fn triangles(&self) -> u64 {
        self.cut.notes.triangles
    }

    /// Triangles of the file that a chunk owns.
    pub fn owned(&self, number: usize) -> u64 {
        self.cut.owned[number]
    }

    /// What was odd about the faces.
    pub fn notes(&self) -> &FaceNotes {
        &self.cut.notes
    }

    /// From file to world coordinates.
    pub fn transform(&self) -> &DAffine3 {
        &self.transform
    }

    /// The cell that holds a world point.
    #[inline]
    pub(super) fn cell_of(&self, at: DVec3) -> u64 {
        self.grid.cell(at)
    }

    /// The cells of a chunk.
    pub(super) fn cells(&self, number: usize) -> std::ops::Range<u64> {
        self.cut.starts[number]..self.cut.starts.get(number + 1).copied().unwrap_or(u64::MAX)
    }

    /// The chunk that each vertex of the file lies in, or [`NOBODY`].
    pub(super) fn owners(&self) -> &[u16] {
        bytemuck::cast_slice(self.owners.as_ref())
    }

    /// The triangles that touch a chunk, in file order, as runs.
    pub(super) fn runs(&self, number: usize) -> impl Iterator<Item = &[[u32; 3]]> {
        self.cut.pages[number].runs(self.corners.as_ref())
    }
}

fn length(path: &Path) -> Option<u64> {
    path.metadata().ok().map(|metadata| metadata.len())
}

fn from_bits(bits: [u64; 3]) -> DVec3 {
    DVec3::from_array(bits.map(f64::from_bits))
}

/// The passes.
struct Cutter<'a> {
    sweep: Sweep<'a>,
    params: &'a CutParams,
}

impl Cutter<'_> {
    fn cut(&self, owners: &Path, corners: &Path) -> Result<Cut> {
        let (used, notes) = self.used()?;
        let [low, high] = self.sweep.bounds(&used)?;
        let extent = (high - low).max_element();
        let cell = self.cell(&used, (low, extent))?;
        let grid = Grid::new(low, extent, cell);
        let starts = self.histogram(&used, &grid)?.cut(self.most_vertices(&used));
        self.sweep.write_owners(owners, &used, |at| {
            let cell = grid.cell(at);
            starts.partition_point(|&start| start <= cell) as u16 - 1
        })?;
        drop(used);
        let (pages, owned) = self.sort(owners, corners, starts.len())?;
        let bounds = [low, high].map(|at| at.to_array().map(f64::to_bits));
        Ok(Cut { bounds, cell: cell.to_bits(), starts, notes, owned, pages })
    }

    /// The vertices that faces use.
    fn used(&self) -> Result<(Bits, FaceNotes)> {
        let stream = self.sweep.stream;
        let mut used = Bits::over(0, (stream.vertex_count().max(1) - 1) as u32);
        let notes = stream.faces(|triangles| {
            triangles.iter().flatten().for_each(|&corner| used.insert(corner));
            (self.sweep.pause)()
        })?;
        Ok((used, notes))
    }

    fn cell(&self, used: &Bits, (low, extent): (DVec3, f64)) -> Result<f64> {
        let (fine, occupied) = (Grid::fine(low, extent), Occupied::none());
        self.sweep.positions(used, |at| occupied.insert(fine.cell(at)))?;
        // A closed surface has about two triangles a vertex.
        Ok(occupied.cell(extent, (self.params.proxy_triangles as f64 / 2.0).max(1.0)))
    }

    fn histogram(&self, used: &Bits, grid: &Grid) -> Result<Histogram> {
        let histogram = Mutex::new(Histogram::default());
        self.sweep.pieces(|vertices| {
            let at = |vertex| self.sweep.position(vertex);
            let vertices = vertices.filter(|&vertex| used.contains(vertex));
            let mut blocks: Vec<u64> = vertices.map(|vertex| grid.cell(at(vertex)) >> BLOCK_BITS).collect();
            blocks.sort_unstable();
            let runs = Histogram::runs(&blocks);
            // Sums of integers do not depend on their order.
            histogram.lock().unwrap_or_else(std::sync::PoisonError::into_inner).add(&runs);
        })?;
        Ok(histogram.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner))
    }

    /// Vertices of a chunk at the most: half its triangles.
    fn most_vertices(&self, used: &Bits) -> u64 {
        let least = used.count().div_ceil(MOST_CHUNKS / 2);
        (self.params.chunk_triangles as u64 / 2).max(least).max(1)
    }

    /// Writes every triangle to the chunks that its corners lie in.
    fn sort(&self, owners: &Path, corners: &Path, chunks: usize) -> Result<(Vec<Pages>, Vec<u64>)> {
        let map = Map::open(owners).map_err(|e| Error::io(owners, "opening", e))?;
        let owners: &[u16] = bytemuck::cast_slice(map.as_ref());
        let (mut paged, mut owned) = (Paged::create(corners, chunks)?, vec![0; chunks]);
        self.sweep.stream.faces(|triangles| {
            for &triangle in triangles {
                let [a, b, c] = triangle.map(|corner| owners[corner as usize]);
                paged.push(a, triangle)?;
                owned[usize::from(a)] += 1;
                if b != a {
                    paged.push(b, triangle)?;
                }
                if c != a && c != b {
                    paged.push(c, triangle)?;
                }
            }
            (self.sweep.pause)()
        })?;
        Ok((paged.finish()?, owned))
    }
}
