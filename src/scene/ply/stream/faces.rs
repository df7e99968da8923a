//! Faces in file order, block by block: triangles read straight from their bytes, all else through the readers of rows.

use std::fs::File;
use std::io::{self, BufReader, Seek, SeekFrom};
use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::Stream;
use crate::error::{Error, Result};
use crate::scene::Warning;
use crate::scene::faces::{Faces, Strip};
use crate::scene::ply::body::binary::{self, FaceLayout, broken};
use crate::scene::ply::body::window::Window;
use crate::scene::ply::body::{Part, text};
use crate::scene::ply::columns::{COLOUR, Columns, UV};
use crate::scene::ply::header::{Element, Encoding};
use crate::scene::ply::scalar::Scalar;
use crate::scene::ply::{fan_warning, no_triangle, row_warnings};
use crate::scene::polygon::Count;

/// Triangles in a block at the most.
pub const BLOCK: usize = 1 << 16;

/// Rows collected at a time where they are not all triangles: polygons of them wait in memory.
const ROWS: u64 = 1 << 14;

/// Indices of a strip read at a time.
const INDICES: usize = 1 << 14;

/// Bytes of a row with a length in one byte and three indices of four.
const TRIPLE_BYTES: usize = 13;

/// What a pass over the faces found.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FaceNotes {
    /// Triangles in all.
    pub triangles: u64,
    /// Rows with fewer than three corners, left out.
    pub short: Count,
    /// Polygons that cross themselves, cut as fans.
    pub fans: Count,
    /// Lines with more numbers than the header declares.
    pub overlong: Count,
    /// Whether lines follow after the last row.
    pub has_more: bool,
}

impl FaceNotes {
    /// The notes as warnings about a stream.
    pub fn warnings(&self, stream: &Stream) -> Vec<Warning> {
        let messages = row_warnings(self.overlong, self.has_more, self.short).into_iter();
        let file = || stream.path().to_path_buf();
        messages.chain(fan_warning(self.fans)).map(|message| Warning { file: file(), message }).collect()
    }
}

/// A pass under way.
struct Pass<'a, V> {
    stream: &'a Stream,
    visit: V,
    notes: FaceNotes,
}

impl Stream {
    /// Calls `visit` with blocks of triangles, at most [`BLOCK`] each, in file order: polygons are triangulated, strips
    /// unwound, faces with fewer than three corners left out, corners checked to be vertices of the file.
    ///
    /// Memory: a few megabytes, and the longest row of a polygon, or of a strip in text.
    ///
    /// # Errors
    /// Those of `visit`; [`Error::Input`] naming the row, as [`ply::read`](crate::scene::ply::read), also when there is
    /// no triangle at all.
    pub fn faces(&self, visit: impl FnMut(&[[u32; 3]]) -> Result<()>) -> Result<FaceNotes> {
        let mut pass = Pass { stream: self, visit, notes: FaceNotes::default() };
        let opened = |e| Error::io(&self.path, "opening the mesh", e);
        let mut file = File::open(&self.path).map_err(opened)?;
        file.seek(SeekFrom::Start(self.faces.offset)).map_err(opened)?;
        match self.header.encoding {
            Encoding::Ascii => pass.text(file)?,
            Encoding::Little | Encoding::Big => pass.binary(file)?,
        }
        if pass.notes.triangles == 0 {
            return Err(no_triangle(&self.path, pass.notes.short));
        }
        Ok(pass.notes)
    }

    /// The tables from the first with faces to the last, and what is read of each: colours of faces are not.
    fn face_tables(&self) -> impl Iterator<Item = (&Element, Part, Columns)> {
        let holds_faces = |part: &Part| matches!(part, Part::Faces | Part::Strips);
        let end = self.layout.parts.iter().rposition(holds_faces).map_or(0, |last| last + 1);
        (self.faces.element..end).map(|at| {
            let mut columns = self.layout.columns[at].clone();
            columns.roles[COLOUR..UV].fill(None);
            (&self.header.elements[at], self.layout.parts[at], columns)
        })
    }
}

impl<V: FnMut(&[[u32; 3]]) -> Result<()>> Pass<'_, V> {
    fn emit(&mut self, triangles: &[[u32; 3]]) -> Result<()> {
        self.notes.triangles += triangles.len() as u64;
        triangles.chunks(BLOCK).try_for_each(&mut self.visit)
    }

    /// Hands on what a few rows held.
    fn finish(&mut self, faces: Faces) -> Result<()> {
        let short = faces.short;
        if self.notes.short.times == 0 {
            self.notes.short.first = short.first;
        }
        self.notes.short.times += short.times;
        let cut = faces.finish_at(&|vertex| self.stream.position(vertex));
        self.notes.fans.times += cut.fans.times;
        self.emit(&cut.triangles)
    }

    fn collector(&self, rows: &Range<u64>) -> Faces {
        Faces::with_capacity(self.stream.vertex_count(), (rows.end - rows.start) as usize, false)
    }

    fn binary(&mut self, file: File) -> Result<()> {
        let stream = self.stream;
        let window = Window::new(file, stream.faces.offset, stream.origin.bytes());
        let mut body = binary::Body { path: &stream.path, encoding: stream.header.encoding, window };
        for (element, part, columns) in stream.face_tables() {
            match part {
                Part::Faces => self.polygons(&mut body, element, &columns)?,
                Part::Strips => self.strips(&mut body, element, &columns)?,
                _ => body.skip(element, &columns)?,
            }
        }
        Ok(())
    }

    fn polygons(
        &mut self,
        body: &mut binary::Body<'_, File>,
        element: &Element,
        columns: &Columns,
    ) -> Result<()> {
        let layout = FaceLayout::of(element, columns);
        let item = layout.filter(FaceLayout::is_plain).map(|layout| layout.item);
        let mut triples = Vec::with_capacity(BLOCK);
        let mut first = 0;
        while first < element.count {
            if let Some(item) = item {
                let rows = BLOCK.min((element.count - first) as usize);
                if self.read_triples(body, item, rows, &mut triples) {
                    self.emit(&triples)?;
                    first += rows as u64;
                    continue;
                }
            }
            let rows = first..element.count.min(first + ROWS);
            let mut faces = self.collector(&rows);
            first = rows.end;
            body.face_rows(element, columns, rows, &mut faces)?;
            self.finish(faces)?;
        }
        Ok(())
    }

    /// Reads the next rows if all of them are triangles of vertices that are there, else nothing.
    fn read_triples(
        &self,
        body: &mut binary::Body<'_, File>,
        item: Scalar,
        rows: usize,
        triples: &mut Vec<[u32; 3]>,
    ) -> bool {
        let Ok(bytes) = body.window.at_least(rows * TRIPLE_BYTES) else { return false };
        let big = body.encoding == Encoding::Big;
        let vertices = self.stream.layout.vertex_count;
        let limit = if item == Scalar::I32 { vertices.min(1 << 31) } else { vertices };
        let word = |four: &[u8]| {
            let four = [four[0], four[1], four[2], four[3]];
            if big { u32::from_be_bytes(four) } else { u32::from_le_bytes(four) }
        };
        let mut is_sound = true;
        triples.clear();
        triples.extend(bytes[..rows * TRIPLE_BYTES].chunks_exact(TRIPLE_BYTES).map(|row| {
            let triple = [word(&row[1..5]), word(&row[5..9]), word(&row[9..13])];
            is_sound &= (row[0] == 3) & (triple[0] < limit) & (triple[1] < limit) & (triple[2] < limit);
            triple
        }));
        if is_sound {
            body.window.advance(rows * TRIPLE_BYTES);
        }
        is_sound
    }

    /// Strips are read piece by piece: scanners write a whole mesh as one row.
    fn strips(
        &mut self,
        body: &mut binary::Body<'_, File>,
        element: &Element,
        columns: &Columns,
    ) -> Result<()> {
        let Some(layout) = FaceLayout::of(element, columns) else {
            for row in 0..element.count {
                let mut faces = self.collector(&(0..0));
                let indices = |_: u64, record: &crate::scene::ply::body::record::Record| {
                    faces.push_strips(record.indices().into_iter())
                };
                body.records(element, columns, row..row + 1, indices)?;
                self.finish(faces)?;
            }
            return Ok(());
        };
        (0..element.count).try_for_each(|row| self.strip(body, element, (row, &layout)))
    }

    fn strip(
        &mut self,
        body: &mut binary::Body<'_, File>,
        element: &Element,
        (row, layout): (u64, &FaceLayout),
    ) -> Result<()> {
        let (path, big) = (body.path, body.encoding == Encoding::Big);
        let fail = |offset: u64, error: io::Error| broken(path, element, row, offset, error);
        let offset = body.window.offset;
        let head = layout.before_bytes + layout.count.size();
        let bytes = body.window.at_least(head).map_err(|e| fail(offset, e))?;
        let length = layout.count.read_integer(&bytes[layout.before_bytes..], big);
        let Ok(mut left) = usize::try_from(length) else {
            return Err(body.refuse(element, row, format!("a list of {length} corners")));
        };
        body.window.advance(head);
        let vertices = self.stream.vertex_count();
        let (mut strip, mut triangles) = (Strip::default(), Vec::with_capacity(INDICES));
        while left > 0 {
            let (take, size) = (left.min(INDICES), layout.item.size());
            let offset = body.window.offset;
            let bytes = body.window.at_least(take * size).map_err(|e| fail(offset, e))?;
            let indices = bytes[..take * size].chunks_exact(size).map(|b| layout.item.read_integer(b, big));
            triangles.clear();
            for index in indices {
                match strip.next(index, vertices) {
                    Ok(triangle) => triangles.extend(triangle),
                    Err(problem) => return Err(body.refuse(element, row, problem)),
                }
            }
            body.window.advance(take * size);
            left -= take;
            self.emit(&triangles)?;
        }
        let offset = body.window.offset;
        body.window.skip(layout.after_bytes as u64).map_err(|e| fail(offset, e))
    }

    fn text(&mut self, file: File) -> Result<()> {
        let stream = self.stream;
        let mut body = text::Body {
            path: &stream.path,
            source: BufReader::with_capacity(1 << 18, file),
            line: stream.faces.line,
            line_end: stream.header.line_end,
            overlong: stream.overlong,
        };
        for (element, part, columns) in stream.face_tables() {
            if !matches!(part, Part::Faces | Part::Strips) {
                body.skip(element)?;
                continue;
            }
            let mut first = 0;
            while first < element.count {
                // A line of a strip may be long.
                let rows = first..element.count.min(first + if part == Part::Strips { 1 } else { ROWS });
                first = rows.end;
                let mut faces = self.collector(&rows);
                body.rows_in(element, &columns, rows, |number, record| match part {
                    Part::Strips => faces.push_strips(record.indices().into_iter()),
                    _ => faces.push(number, record.indices().into_iter(), None),
                })?;
                self.finish(faces)?;
            }
        }
        self.notes.overlong = body.overlong;
        self.notes.has_more = self.is_at_last_table() && body.has_more()?;
        Ok(())
    }

    /// Whether no table follows the last with faces.
    fn is_at_last_table(&self) -> bool {
        matches!(self.stream.layout.parts.last(), Some(Part::Faces | Part::Strips))
    }
}
