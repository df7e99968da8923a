//! Reading the archive of a streamed mesh.

use std::path::Path;

use bytemuck::Pod;
use glam::{DVec3, Vec3};
use half::f16;
use rayon::prelude::*;

use super::write::{BLOCKS, HEAD, Head, KIND, OF_COLOUR, tags};
use crate::archive::{Access, Archive, Block, Digests, Tag};
use crate::error::{Error, Result};
use crate::light::Rgb;
use crate::scene::Placement;
use crate::scene::assemble::Part;

const NO_COLOUR: &str = "expected colours, got what is negative or not finite";

/// A streamed mesh, chunk by chunk, through a map of its archive.
#[derive(Debug)]
pub struct Detail {
    archive: Archive,
    head: Head,
    /// Blocks of each chunk.
    tags: Vec<Tag>,
    bounds: Vec<[Vec3; 2]>,
}

impl Detail {
    /// Opens a finished archive; with digests, only one made from these. Checks the order of all blocks, so that the
    /// arrays of a chunk can be asked for by its number, and that numbers of the whole mesh can be used.
    ///
    /// # Errors
    /// As [`Archive::open`]; [`Error::JobDiffers`] when it is of another kind or was made from something else;
    /// [`Error::Damaged`].
    pub fn open(path: &Path, digests: Option<Digests>) -> Result<Self> {
        let archive = Archive::open(path)?;
        archive.expect_kind(KIND)?;
        if let Some(Digests { inputs, options }) = digests {
            archive.expect(inputs, options)?;
        }
        archive.advise(Access::Normal);
        let head = match archive.array::<Head>(HEAD)? {
            [head] => *head,
            heads => return Err(damaged(&archive, "head", format!("expected one, got {}", heads.len()))),
        };
        if !head.is_usable() {
            return Err(damaged(
                &archive,
                "head",
                "expected a frame and a box that can be, got others".into(),
            ));
        }
        let tags = tags(head.coloured == 1);
        let found: Vec<Tag> = archive.all_blocks().map(|block| block.entry().tag).collect();
        let expected = head.chunks.checked_mul(tags.len() as u64).and_then(|blocks| blocks.checked_add(1));
        let in_order = found.iter().skip(1).zip(tags.iter().cycle()).all(|(found, tag)| found == tag);
        if expected != Some(found.len() as u64) || found.first() != Some(&HEAD) || !in_order {
            let problem = format!("expected the blocks of {} chunks in order, got others", head.chunks);
            return Err(damaged(&archive, "directory", problem));
        }
        let mut detail = Self { archive, head, tags, bounds: Vec::new() };
        detail.bounds =
            (0..detail.chunk_count()).map(|chunk| detail.read_bounds(chunk)).collect::<Result<_>>()?;
        Ok(detail)
    }

    /// The archive.
    pub fn archive(&self) -> &Archive {
        &self.archive
    }

    /// Chunks.
    pub fn chunk_count(&self) -> usize {
        self.head.chunks as usize
    }

    /// The box around the triangles of a chunk, local: lower and upper corner; turned inside out if it has none.
    pub fn bounds(&self, chunk: usize) -> [Vec3; 2] {
        self.bounds[chunk]
    }

    /// The box around the mesh, world: lower and upper corner.
    pub fn world_bounds(&self) -> [DVec3; 2] {
        self.head.bounds.map(DVec3::from_array)
    }

    /// Edge of a proxy cell, local units.
    pub fn cell(&self) -> f32 {
        (self.head.cell / self.head.scale) as f32
    }

    /// The frame that positions are in.
    pub fn placement(&self) -> Placement {
        Placement { origin: DVec3::from_array(self.head.origin), scale: self.head.scale }
    }

    /// Triangles with an area, of all chunks.
    pub fn triangles(&self) -> u64 {
        self.chunk_count().checked_sub(1).map_or(0, |last| self.branches(last).range().end)
    }

    /// Vertices of the file, used or not.
    pub fn vertices(&self) -> u64 {
        self.head.vertices
    }

    /// Whether vertices have colours.
    pub fn has_colours(&self) -> bool {
        self.head.coloured == 1
    }

    /// Branches of a chunk's hierarchy ([`Branch`](crate::rays::Branch)); the block's range is that of its triangles in running
    /// numbers, those of the packets count from 0 in every chunk.
    pub fn branches(&self, chunk: usize) -> Block<'_> {
        self.block(chunk, BLOCKS[0])
    }

    /// Packets of a chunk's hierarchy ([`Packet`](crate::rays::Packet)).
    pub fn packets(&self, chunk: usize) -> Block<'_> {
        self.block(chunk, BLOCKS[1])
    }

    /// Numbers in the file of a chunk's vertices, ascending, below [`Detail::vertices`]. Cost: looks at all of them.
    ///
    /// # Errors
    /// [`Error::Damaged`], [`Error::Io`].
    pub fn ids(&self, chunk: usize) -> Result<&[u32]> {
        let ids: &[u32] = self.of_vertices(chunk, BLOCKS[2])?;
        let last = ids.last().map_or(0, |&id| u64::from(id) + 1);
        if last > self.vertices() || !ids.par_windows(2).all(|pair| pair[0] < pair[1]) {
            let problem = format!("expected ascending numbers below {}, got others", self.vertices());
            return Err(damaged(&self.archive, &format!("chunk {chunk} {}", BLOCKS[2]), problem));
        }
        Ok(ids)
    }

    /// Local positions of a chunk's vertices.
    ///
    /// # Errors
    /// As [`Detail::ids`].
    pub fn points(&self, chunk: usize) -> Result<&[Vec3]> {
        self.of_vertices(chunk, BLOCKS[3])
    }

    /// Normals of a chunk's vertices in [octahedral](crate::geometry::octahedral) code.
    ///
    /// # Errors
    /// As [`Detail::ids`].
    pub fn normals(&self, chunk: usize) -> Result<&[u32]> {
        self.of_vertices(chunk, BLOCKS[4])
    }

    /// Linear colours of a chunk's vertices, if the file has any: finite, from 0 on. Cost: looks at all of them.
    ///
    /// # Errors
    /// As [`Detail::ids`].
    pub fn colours(&self, chunk: usize) -> Result<Option<&[[f16; 3]]>> {
        if !self.has_colours() {
            return Ok(None);
        }
        let tag = BLOCKS[OF_COLOUR[0]];
        let colours: &[[f16; 3]] = self.of_vertices(chunk, tag)?;
        if !colours.par_iter().flatten().all(|value| value.is_finite() && *value >= f16::ZERO) {
            return Err(damaged(&self.archive, &format!("chunk {chunk} {tag}"), NO_COLOUR.into()));
        }
        Ok(Some(colours))
    }

    /// The proxy of all chunks as a mesh in world coordinates, without a name: positions, triangles and colours.
    ///
    /// A vertex is the mean of a cell's vertices; no two triangles join the same cells in the same sense. Memory: the
    /// mesh, and 8 bytes a vertex.
    ///
    /// # Errors
    /// [`Error::Damaged`], [`Error::Io`].
    pub fn proxy(&self) -> Result<Part> {
        let placement = self.placement();
        let mut part = Part { colours: self.has_colours().then(Vec::new), ..Part::default() };
        let mut cells: Vec<u64> = Vec::new();
        for chunk in 0..self.chunk_count() {
            let own: &[u64] = self.block(chunk, BLOCKS[6]).array()?;
            cells.extend_from_slice(own);
            let means: &[Vec3] = self.array_of(chunk, BLOCKS[7], own.len())?;
            part.positions.extend(means.iter().map(|&mean| placement.to_world(mean)));
            if let Some(colours) = &mut part.colours {
                colours.extend_from_slice(self.array_of::<Rgb>(chunk, BLOCKS[OF_COLOUR[1]], own.len())?);
            }
        }
        if !cells.is_sorted_by(|a, b| a < b) || u32::try_from(cells.len()).is_err() {
            return Err(damaged(&self.archive, "cells", "expected ascending cells, got others".into()));
        }
        if !part.positions.iter().all(|at| at.is_finite()) {
            return Err(damaged(&self.archive, "means", "expected positions, got what is not finite".into()));
        }
        if !part.colours.iter().flatten().all(|colour| colour.is_finite() && colour.min_element() >= 0.0) {
            return Err(damaged(&self.archive, "tints", NO_COLOUR.into()));
        }
        let place = |cell: &u64| cells.binary_search(cell).ok().map(|at| at as u32);
        for chunk in 0..self.chunk_count() {
            let faces: &[[u64; 3]] = self.block(chunk, BLOCKS[9]).array()?;
            let joined = |[a, b, c]: &[u64; 3]| Some([place(a)?, place(b)?, place(c)?]);
            part.triangles.extend(faces.iter().filter_map(joined));
        }
        Ok(part)
    }

    fn block(&self, chunk: usize, tag: Tag) -> Block<'_> {
        let at = self.tags.iter().position(|&known| known == tag).expect("a tag of this archive");
        assert!(chunk < self.chunk_count(), "chunk {chunk} of {}", self.chunk_count());
        self.archive.block(1 + chunk * self.tags.len() + at)
    }

    fn of_vertices<T: Pod>(&self, chunk: usize, tag: Tag) -> Result<&[T]> {
        self.array_of(chunk, tag, self.block(chunk, BLOCKS[2]).entry().count as usize)
    }

    fn array_of<T: Pod>(&self, chunk: usize, tag: Tag, expected: usize) -> Result<&[T]> {
        let array: &[T] = self.block(chunk, tag).array()?;
        if array.len() != expected {
            let problem = format!("expected {expected} entries, got {}", array.len());
            return Err(damaged(&self.archive, &format!("chunk {chunk} {tag}"), problem));
        }
        Ok(array)
    }

    fn read_bounds(&self, chunk: usize) -> Result<[Vec3; 2]> {
        self.array_of::<[Vec3; 2]>(chunk, BLOCKS[10], 1).map(|boxes| boxes[0])
    }
}

fn damaged(archive: &Archive, place: &str, problem: String) -> Error {
    Error::Damaged { file: archive.file().to_owned(), place: place.into(), problem }
}
