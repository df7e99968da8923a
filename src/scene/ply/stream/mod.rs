//! A PLY that is never in memory as a whole: vertices by number through a map, faces in file order, block by block.

mod convert;
mod faces;
pub mod marker;
mod rows;

use std::fs::File;
use std::io::{BufReader, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::archive::{Map, Pause};
use crate::error::{Error, Result};
use crate::light::Rgb;
use crate::scene::Warning;
use crate::scene::ply::body::binary::{self, fields_of};
use crate::scene::ply::body::window::Window;
use crate::scene::ply::body::{Layout, Part, text};
use crate::scene::ply::header::{Element, Encoding, Header};
use crate::scene::ply::scalar::Scalar;
use crate::scene::polygon::Count;
pub use faces::{BLOCK, FaceNotes};
use marker::Origin;
use rows::Rows;

/// Vertices that one thread checks at a time.
const CHECKED: usize = 1 << 16;

/// A PLY whose rows are read from the file as they are needed: vertices by number, faces in file order.
pub struct Stream {
    path: PathBuf,
    header: Header,
    layout: Layout,
    origin: Origin,
    faces: Start,
    rows: Rows,
    /// Lines of vertices with more numbers than the header declares.
    overlong: Count,
    warnings: Vec<Warning>,
}

/// Where the first table of faces begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
struct Start {
    /// The element's place in the header.
    element: usize,
    offset: u64,
    /// Lines before it, in text.
    line: u64,
}

/// What a copy of the vertices was made from, and what was found on the way.
#[derive(Debug, PartialEq, Eq, Serialize, Deserialize)]
struct CopyMarker {
    origin: Origin,
    faces: Start,
    overlong: Count,
}

/// Where the tables are.
struct Found {
    faces: Option<Start>,
    /// Offset of vertices that can stay where they are.
    vertices: Option<u64>,
    overlong: Count,
}

impl Stream {
    /// Opens a PLY and checks header and counts, with the messages of [`ply::read`](super::read).
    ///
    /// Vertices of a binary file with rows of one length are read in place, through a read-only map. Those of any other
    /// (text, lists among the vertices' properties) are first copied to `vertices.raw` in the folder `scratch`, which is
    /// made if it is not there: one sequential pass, bounded memory, 24 bytes a vertex and 12 for each of normal and
    /// colour. A whole copy that an earlier run left there is used again; whoever owns the folder removes it.
    ///
    /// Of vertices in place only the colours are looked at; [`Stream::check`] looks at positions.
    ///
    /// # Errors
    /// As [`ply::read`](super::read); [`Error::DiskFull`].
    pub fn open(path: &Path, scratch: &Path) -> Result<Self> {
        Self::open_with(path, scratch, &|| Ok(()))
    }

    /// [`Stream::open`] that asks now and then whether to go on.
    ///
    /// # Errors
    /// As [`Stream::open`], and the pause's.
    pub fn open_with(path: &Path, scratch: &Path, pause: Pause<'_>) -> Result<Self> {
        let opened = |e| Error::io(path, "opening the mesh", e);
        let mut file = File::open(path).map_err(opened)?;
        let origin = Origin::of(&file).map_err(opened)?;
        let header = super::read_header(path, &mut file)?;
        header.check_counts(path, origin.bytes())?;
        let layout = Layout::of(path, &header)?;
        let vertices = layout.at(Part::Vertices).unwrap_or(0);
        let in_place = header.encoding != Encoding::Ascii && header.elements[vertices].stride().is_some();
        let survey =
            Survey { path, file: &file, header: &header, layout: &layout, file_bytes: origin.bytes() };
        let (faces, rows, overlong) = if in_place {
            let found = survey.binary(None)?;
            (found.faces, survey.in_place(found.vertices.unwrap_or(header.body_offset))?, Count::default())
        } else {
            let (marker, rows) = survey.copied(scratch, origin, pause)?;
            (Some(marker.faces), rows, marker.overlong)
        };
        let faces =
            faces.unwrap_or(Start { element: header.elements.len(), offset: origin.bytes(), line: 0 });
        let mut warnings = super::header_warnings(path, &header);
        if layout.coloured(Part::Faces).is_some() && layout.coloured(Part::Vertices).is_none() {
            let message = "colours are per face; of a mesh that is streamed they are not read".to_string();
            warnings.push(Warning { file: path.to_path_buf(), message });
        }
        let mut stream =
            Self { path: path.to_path_buf(), header, layout, origin, faces, rows, overlong, warnings };
        stream.check_colours()?;
        Ok(stream)
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Tells the file from what it was at another time.
    pub fn origin(&self) -> Origin {
        self.origin
    }

    /// Rows of the vertex element.
    pub fn vertex_count(&self) -> u64 {
        u64::from(self.layout.vertex_count)
    }

    /// Rows of the elements that hold faces: polygons and strips.
    pub fn face_rows(&self) -> u64 {
        let holds_faces = |part: &Part| matches!(part, Part::Faces | Part::Strips);
        let elements = self.header.elements.iter().zip(&self.layout.parts);
        elements.filter(|(_, part)| holds_faces(part)).map(|(element, _)| element.count).sum()
    }

    /// What was odd about the header and the colours.
    pub fn warnings(&self) -> &[Warning] {
        &self.warnings
    }

    /// Position of a vertex in file units, as written: perhaps not finite, see [`Stream::check`].
    ///
    /// # Panics
    /// When there is no such vertex.
    #[inline]
    pub fn position(&self, vertex: u32) -> DVec3 {
        self.rows.position(vertex)
    }

    /// Whether vertices have colours.
    pub fn has_colours(&self) -> bool {
        self.rows.has_colours()
    }

    /// Linear colour of a vertex, if the file has colours of vertices.
    ///
    /// # Panics
    /// When there is no such vertex.
    pub fn colour(&self, vertex: u32) -> Option<Rgb> {
        self.rows.colour(vertex)
    }

    /// Normal of a vertex as written, if the file has normals.
    ///
    /// # Panics
    /// When there is no such vertex.
    pub fn normal(&self, vertex: u32) -> Option<Vec3> {
        self.rows.normal(vertex)
    }

    /// Checks that these vertices lie somewhere.
    ///
    /// # Errors
    /// [`Error::Input`] naming the first row whose position is not finite, or when the file has been cut meanwhile.
    pub fn check(&self, vertices: Range<u32>) -> Result<()> {
        self.check_whole()?;
        match vertices.into_iter().find(|&vertex| !self.position(vertex).is_finite()) {
            None => Ok(()),
            Some(vertex) => {
                let problem = format!("the position ({}) is not finite", self.position(vertex));
                Err(self.refuse(vertex, problem, "repair the file, e.g. by exporting it again"))
            }
        }
    }

    /// Checks that the map still holds what it did when it was opened.
    ///
    /// # Errors
    /// [`Error::Io`] when the file was cut meanwhile.
    pub fn check_whole(&self) -> Result<()> {
        self.rows.map().touch(0..0).map_err(|source| Error::io(&self.path, "reading vertices", source))
    }

    /// Float colours are linear in [0, 1]; a file that goes up to 255 means bytes.
    fn check_colours(&mut self) -> Result<()> {
        if !self.layout.coloured(Part::Vertices).is_some_and(Scalar::is_float) {
            return Ok(());
        }
        let count = self.layout.vertex_count as usize;
        let colour = |vertex: usize| self.rows.colour(vertex as u32).unwrap_or_default();
        // Per piece: the first row outside of 0..255, and the largest value.
        let pieces: Vec<(Option<usize>, f32)> = (0..count.div_ceil(CHECKED))
            .into_par_iter()
            .map(|piece| {
                let mut rows = piece * CHECKED..count.min((piece + 1) * CHECKED);
                let most = rows.clone().map(|row| colour(row).max_element()).fold(0.0, f32::max);
                let odd = |row: &usize| {
                    let c = colour(*row);
                    !c.is_finite() || c.min_element() < 0.0 || c.max_element() > 255.0
                };
                (rows.find(odd), most)
            })
            .collect();
        if let Some(row) = pieces.iter().find_map(|(odd, _)| *odd) {
            let problem = format!("the colour {} is outside 0..1", colour(row));
            let place = format!("vertex row {row}");
            return Err(Error::input(&self.path, place, problem, "write colours as uchar or as float 0..1"));
        }
        if pieces.iter().any(|&(_, most)| most > 1.0) {
            self.rows.float_bytes = true;
            let message = "float colours exceed 1: they were read as sRGB from 0 to 255".to_string();
            self.warnings.push(Warning { file: self.path.clone(), message });
        }
        Ok(())
    }

    fn refuse(&self, vertex: u32, problem: String, remedy: &str) -> Error {
        let place = format!("vertex row {vertex} at byte {}", self.rows.offset(vertex));
        Error::input(&self.path, place, problem, remedy)
    }
}

/// The first walk over the tables.
struct Survey<'a> {
    path: &'a Path,
    file: &'a File,
    header: &'a Header,
    layout: &'a Layout,
    file_bytes: u64,
}

impl Survey<'_> {
    fn tables(&self) -> impl Iterator<Item = (usize, &Element, Part)> {
        let elements = self.header.elements.iter().zip(&self.layout.parts).enumerate();
        elements.map(|(number, (element, &part))| (number, element, part))
    }

    /// Finds the tables of a binary body; vertices that cannot stay where they are go to `copy`.
    fn binary(&self, mut copy: Option<&mut convert::Copy<'_>>) -> Result<Found> {
        let (path, encoding) = (self.path, self.header.encoding);
        let mut found = Found { faces: None, vertices: None, overlong: Count::default() };
        let (mut offset, mut vertices) = (self.header.body_offset, false);
        for (number, element, part) in self.tables() {
            if found.faces.is_some() && vertices {
                break;
            }
            if matches!(part, Part::Faces | Part::Strips) && found.faces.is_none() && element.count > 0 {
                found.faces = Some(Start { element: number, offset, line: 0 });
            }
            let in_place = part == Part::Vertices && copy.is_none();
            if part == Part::Vertices {
                vertices = true;
                found.vertices = in_place.then_some(offset);
            }
            if let Some(stride) = element.stride() {
                let rows_left = self.file_bytes.saturating_sub(offset) / (stride as u64).max(1);
                if rows_left < element.count {
                    let at = offset + rows_left * stride as u64;
                    let end = std::io::ErrorKind::UnexpectedEof.into();
                    return Err(binary::broken(path, element, rows_left, at, end));
                }
                offset += element.count * stride as u64;
                continue;
            }
            if found.faces.is_some() && vertices && part != Part::Vertices {
                break;
            }
            let mut file = self.file;
            file.seek(SeekFrom::Start(offset)).map_err(|e| Error::io(path, "seeking in the body", e))?;
            let mut body =
                binary::Body { path, encoding, window: Window::new(file, offset, self.file_bytes) };
            let columns = &self.layout.columns[number];
            match &mut copy {
                Some(copy) if part == Part::Vertices => {
                    let rows = 0..element.count;
                    body.records(element, columns, rows, |row, record| copy.push(row, &record.row))?;
                }
                _ => body.skip(element, columns)?,
            }
            offset = body.window.offset;
        }
        Ok(found)
    }

    /// Finds the faces of a text and copies the vertices.
    fn text(&self, copy: &mut convert::Copy<'_>) -> Result<Found> {
        let mut file = self.file;
        let sought = file.seek(SeekFrom::Start(self.header.body_offset));
        sought.map_err(|e| Error::io(self.path, "seeking to the body", e))?;
        let mut body = text::Body {
            path: self.path,
            source: BufReader::with_capacity(1 << 18, file),
            line: self.header.lines,
            line_end: self.header.line_end,
            overlong: Count::default(),
        };
        let mut found = Found { faces: None, vertices: None, overlong: Count::default() };
        let mut vertices = false;
        for (number, element, part) in self.tables() {
            if matches!(part, Part::Faces | Part::Strips) && found.faces.is_none() && element.count > 0 {
                let offset = body.source.stream_position();
                let offset = offset.map_err(|e| Error::io(self.path, "reading the body", e))?;
                found.faces = Some(Start { element: number, offset, line: body.line });
            }
            if found.faces.is_some() && vertices {
                break;
            }
            if part == Part::Vertices {
                vertices = true;
                let columns = &self.layout.columns[number];
                body.rows(element, columns, |row, record| copy.push(row, &record.row))?;
                found.overlong = body.overlong;
            } else {
                body.skip(element)?;
            }
        }
        Ok(found)
    }

    fn in_place(&self, offset: u64) -> Result<Rows> {
        let at = self.layout.at(Part::Vertices).unwrap_or(0);
        let (element, columns) = (&self.header.elements[at], &self.layout.columns[at]);
        let (fields, stride) = fields_of(element, columns, 0..element.properties.len());
        let map = Map::open(self.path).map_err(|e| Error::io(self.path, "opening the mesh", e))?;
        Ok(Rows::new(map, offset as usize, stride, &fields, self.header.encoding == Encoding::Big))
    }

    /// Rows of a copy, made now unless it is there.
    fn copied(&self, scratch: &Path, origin: Origin, pause: Pause<'_>) -> Result<(CopyMarker, Rows)> {
        let at = self.layout.at(Part::Vertices).unwrap_or(0);
        let columns = &self.layout.columns[at];
        let (raw, mark) = (scratch.join("vertices.raw"), scratch.join("vertices.json"));
        let (fields, stride) = convert::fields(columns);
        let expected = stride as u64 * u64::from(self.layout.vertex_count);
        let is_whole = raw.metadata().is_ok_and(|metadata| metadata.len() == expected);
        let there = marker::read(&mark).filter(|marker: &CopyMarker| is_whole && marker.origin == origin);
        let marker = if let Some(marker) = there {
            marker
        } else {
            std::fs::create_dir_all(scratch).map_err(|e| Error::io(scratch, "creating", e))?;
            marker::remove(&mark)?;
            let mut copy = convert::Copy::create(&raw, columns, pause)?;
            let is_text = self.header.encoding == Encoding::Ascii;
            let walked = if is_text { self.text(&mut copy) } else { self.binary(Some(&mut copy)) };
            let (outcome, found) = match walked {
                Ok(found) => (Ok(()), Some(found)),
                Err(error) => (Err(error), None),
            };
            copy.finish(outcome)?;
            let faces = found.as_ref().and_then(|found| found.faces);
            let end = Start { element: self.header.elements.len(), offset: self.file_bytes, line: 0 };
            let overlong = found.map_or(Count::default(), |found| found.overlong);
            let marker = CopyMarker { origin, faces: faces.unwrap_or(end), overlong };
            marker::write(&mark, &marker)?;
            marker
        };
        let map = Map::open(&raw).map_err(|e| Error::io(&raw, "opening", e))?;
        if map.as_ref().len() as u64 != expected {
            let problem = format!("expected {expected} bytes, got {}", map.as_ref().len());
            return Err(Error::Damaged { file: raw, place: "vertices".into(), problem });
        }
        Ok((marker, Rows::new(map, 0, stride, &fields, false)))
    }
}
