//! Passes over the vertices, in pieces, by all threads.

use std::fs::File;
use std::io::Write;
use std::ops::Range;
use std::path::Path;

use glam::{DAffine3, DVec3};
use rayon::prelude::*;

use super::NOBODY;
use super::bits::Bits;
use crate::archive::Pause;
use crate::error::{Error, Result};
use crate::scene::ply::stream::Stream;

/// Vertices that one thread takes at a time.
const PIECE: u32 = 1 << 16;

/// Pieces between questions whether to go on: 4 M vertices are a tenth of a second's work.
const PIECES: u32 = 64;

/// Who passes over what.
pub struct Sweep<'a> {
    /// The vertices.
    pub stream: &'a Stream,
    /// From file to world coordinates.
    pub transform: &'a DAffine3,
    /// Asked between batches.
    pub pause: Pause<'a>,
}

impl Sweep<'_> {
    /// World position of a vertex.
    #[inline]
    pub fn position(&self, vertex: u32) -> DVec3 {
        self.transform.transform_point3(self.stream.position(vertex))
    }

    /// Hands every piece to `each`, and what it gives to `take`, in order.
    fn in_order<T: Send>(
        &self,
        each: impl Fn(Range<u32>) -> T + Sync,
        mut take: impl FnMut(T) -> Result<()>,
    ) -> Result<()> {
        let count = self.stream.vertex_count();
        let pieces = count.div_ceil(u64::from(PIECE)) as u32;
        let piece = |number: u32| {
            let start = u64::from(number) * u64::from(PIECE);
            start as u32..count.min(start + u64::from(PIECE)) as u32
        };
        for first in (0..pieces).step_by(PIECES as usize) {
            (self.pause)()?;
            self.stream.check_whole()?;
            let batch = first..pieces.min(first + PIECES);
            let made: Vec<T> = batch.into_par_iter().map(|number| each(piece(number))).collect();
            made.into_iter().try_for_each(&mut take)?;
        }
        Ok(())
    }

    /// Hands every piece of the vertices to `each`.
    ///
    /// # Errors
    /// The pause's; [`Error::Io`] when the file was cut.
    pub fn pieces(&self, each: impl Fn(Range<u32>) + Sync) -> Result<()> {
        self.in_order(each, |()| Ok(()))
    }

    /// Hands the world position of every used vertex to `each`.
    ///
    /// # Errors
    /// As [`Sweep::pieces`].
    pub fn positions(&self, used: &Bits, each: impl Fn(DVec3) + Sync) -> Result<()> {
        self.pieces(|vertices| {
            vertices.filter(|&vertex| used.contains(vertex)).for_each(|vertex| each(self.position(vertex)));
        })
    }

    /// The box around the used vertices; all vertices are checked to lie somewhere.
    ///
    /// # Errors
    /// As [`Sweep::pieces`]; [`Error::Input`] naming a row whose position is not finite, or when the box has no extent.
    pub fn bounds(&self, used: &Bits) -> Result<[DVec3; 2]> {
        let nothing = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (mut low, mut high) = nothing;
        let each = |vertices: Range<u32>| {
            self.stream.check(vertices.clone())?;
            vertices.filter(|&vertex| used.contains(vertex)).try_fold(nothing, |(low, high), vertex| {
                let at = self.position(vertex);
                if at.is_finite() { Ok((low.min(at), high.max(at))) } else { Err(self.out_of_range(vertex)) }
            })
        };
        self.in_order(each, |piece| {
            let (from, to) = piece?;
            (low, high) = (low.min(from), high.max(to));
            Ok(())
        })?;
        let extent = (high - low).max_element();
        let path = self.stream.path();
        let remedy = "check the coordinates and the transform";
        if !extent.is_finite() {
            let problem = format!("the mesh reaches from {low} to {high}, too far for double precision");
            return Err(Error::input(path, "vertices", problem, remedy));
        }
        if extent <= 0.0 {
            let problem = format!("all corners lie in one point, {:?}", low.to_array());
            return Err(Error::input(path, "vertices", problem, remedy));
        }
        Ok([low, high])
    }

    fn out_of_range(&self, vertex: u32) -> Error {
        let at = self.position(vertex).to_array();
        let problem = format!("its transform moves it out of range, to {at:?}");
        let place = format!("vertex row {vertex}");
        Error::input(self.stream.path(), place, problem, "correct the transform")
    }

    /// Writes two bytes a vertex: what `owner` says of its world position, or [`NOBODY`].
    ///
    /// # Errors
    /// As [`Sweep::pieces`]; [`Error::DiskFull`].
    pub fn write_owners(&self, path: &Path, used: &Bits, owner: impl Fn(DVec3) -> u16 + Sync) -> Result<()> {
        let mut file = File::create(path).map_err(|source| Error::io(path, "creating", source))?;
        let of = |vertex| if used.contains(vertex) { owner(self.position(vertex)) } else { NOBODY };
        let each = |vertices: Range<u32>| vertices.map(of).collect::<Vec<u16>>();
        self.in_order(each, |owners| {
            let bytes = bytemuck::cast_slice(&owners);
            file.write_all(bytes).map_err(|source| Error::io(path, "writing", source))
        })
    }
}
