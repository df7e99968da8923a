//! Binary bodies: fixed-stride vertices and faces with one list are scanned directly, every other layout row by row
//! through ply-rs.

use std::io::{self, Read};
use std::ops::Range;
use std::path::Path;

use ply_rs::parser::Parser;

use crate::error::{Error, Result};
use crate::scene::faces::Faces;
use crate::scene::ply::body::record::{self, Record};
use crate::scene::ply::body::window::Window;
use crate::scene::ply::columns::{COLOUR, Columns, ROLES, Use};
use crate::scene::ply::header::{Element, Encoding, Kind};
use crate::scene::ply::scalar::Scalar;
use crate::scene::ply::vertices::{ColourReader, Row, Vertices};

/// A binary body being read from front to back.
pub struct Body<'a, R> {
    /// The file's name, for messages.
    pub path: &'a Path,
    /// Byte order.
    pub encoding: Encoding,
    /// The unread bytes.
    pub window: Window<R>,
}

/// A number at a fixed place of a row.
#[derive(Debug, Clone, Copy)]
pub struct Field {
    /// Bytes before it.
    pub offset: usize,
    /// Its type.
    pub scalar: Scalar,
    /// What it means: [`POSITION`](crate::scene::ply::columns::POSITION) and so on.
    pub role: usize,
}

/// The layout of a face row with one list.
pub struct FaceLayout {
    before: Vec<Field>,
    /// Bytes before the list.
    pub before_bytes: usize,
    /// Type of the list's length.
    pub count: Scalar,
    /// Type of its numbers.
    pub item: Scalar,
    after: Vec<Field>,
    /// Bytes after the list.
    pub after_bytes: usize,
}

impl<R: Read> Body<'_, R> {
    /// Reads the vertex element.
    ///
    /// # Errors
    /// [`Error::Input`] naming row and byte for a short file or a position that is not finite.
    pub fn vertices(&mut self, element: &Element, columns: &Columns, into: &mut Vertices) -> Result<()> {
        let Some(stride) = element.stride() else {
            return self.records(element, columns, 0..element.count, |_, record| into.push(&record.row));
        };
        let (fields, _) = fields_of(element, columns, 0..element.properties.len());
        let big = self.encoding == Encoding::Big;
        let mut row: Row = [0.0; ROLES];
        for number in 0..element.count {
            let offset = self.window.offset;
            let bytes = self.window.at_least(stride);
            let bytes = bytes.map_err(|e| broken(self.path, element, number, offset, e))?;
            read_fields(&fields, bytes, big, &mut row);
            into.push(&row).map_err(|problem| self.refuse(element, number, problem))?;
            self.window.advance(stride);
        }
        Ok(())
    }

    /// Reads the face element.
    ///
    /// # Errors
    /// [`Error::Input`] naming row and byte for a short file or an index out of range.
    pub fn faces(&mut self, element: &Element, columns: &Columns, into: &mut Faces) -> Result<()> {
        self.face_rows(element, columns, 0..element.count, into)
    }

    /// Reads the next rows of the face element, which have these numbers.
    ///
    /// # Errors
    /// As [`Self::faces`].
    pub fn face_rows(
        &mut self,
        element: &Element,
        columns: &Columns,
        rows: Range<u64>,
        into: &mut Faces,
    ) -> Result<()> {
        let colour_reader = columns.roles[COLOUR].map(ColourReader::new);
        let Some(layout) = FaceLayout::of(element, columns) else {
            return self.records(element, columns, rows, |number, record| {
                let colour = colour_reader.as_ref().map(|reader| reader.colour(&record.row));
                into.push(number, record.indices().into_iter(), colour)
            });
        };
        let big = self.encoding == Encoding::Big;
        let head = layout.before_bytes + layout.count.size();
        let item_bytes = layout.item.size();
        let mut row: Row = [0.0; ROLES];
        for number in rows {
            let mut step = || -> io::Result<Result<usize, String>> {
                let bytes = self.window.at_least(head)?;
                let length = layout.count.read_integer(&bytes[layout.before_bytes..], big);
                let Ok(length) = usize::try_from(length) else {
                    return Ok(Err(format!("a list of {length} corners")));
                };
                let tail = head + length * item_bytes;
                let bytes = self.window.at_least(tail + layout.after_bytes)?;
                let colour = colour_reader.as_ref().map(|reader| {
                    read_fields(&layout.before, bytes, big, &mut row);
                    read_fields(&layout.after, &bytes[tail..], big, &mut row);
                    reader.colour(&row)
                });
                let index = |k: usize| layout.item.read_integer(&bytes[head + k * item_bytes..], big);
                let pushed = if length == 3 {
                    let corner = |k| into.corner(index(k));
                    corner(0)
                        .and_then(|a| Ok([a, corner(1)?, corner(2)?]))
                        .map(|t| into.push_triangle(t, colour))
                } else {
                    into.push(number, (0..length).map(index), colour)
                };
                Ok(pushed.map(|()| tail + layout.after_bytes))
            };
            match step() {
                Ok(Ok(bytes)) => self.window.advance(bytes),
                Ok(Err(problem)) => return Err(self.refuse(element, number, problem)),
                Err(error) => return Err(broken(self.path, element, number, self.window.offset, error)),
            }
        }
        Ok(())
    }

    /// Reads a tristrips element.
    ///
    /// # Errors
    /// As [`Self::faces`].
    pub fn strips(&mut self, element: &Element, columns: &Columns, into: &mut Faces) -> Result<()> {
        let rows = 0..element.count;
        self.records(element, columns, rows, |_, record| into.push_strips(record.indices().into_iter()))
    }

    /// Passes over an element that nobody asked for.
    ///
    /// # Errors
    /// [`Error::Input`] when the file ends within it.
    pub fn skip(&mut self, element: &Element, columns: &Columns) -> Result<()> {
        let Some(stride) = element.stride() else {
            return self.records(element, columns, 0..element.count, |_, _| Ok(()));
        };
        let skipped = self.window.skip(element.count.saturating_mul(stride as u64));
        skipped.map_err(|e| broken(self.path, element, element.count, self.window.offset, e))
    }

    /// The next rows of any layout, through ply-rs.
    ///
    /// # Errors
    /// [`Error::Input`] naming row and byte, also when `each` finds a problem.
    pub fn records(
        &mut self,
        element: &Element,
        columns: &Columns,
        rows: Range<u64>,
        mut each: impl FnMut(u64, &Record) -> Result<(), String>,
    ) -> Result<()> {
        let definition = record::definition(element, columns, self.encoding);
        let parser = Parser::<Record>::new();
        for number in rows {
            let before = self.window.offset;
            let read = match self.encoding {
                Encoding::Big => parser.read_big_endian_element(&mut self.window, &definition),
                _ => parser.read_little_endian_element(&mut self.window, &definition),
            };
            let record = read.map_err(|e| broken(self.path, element, number, before, e.into()))?;
            each(number, &record).map_err(|problem| self.refuse(element, number, problem))?;
        }
        Ok(())
    }

    /// The error for a row that holds what makes no sense.
    pub fn refuse(&self, element: &Element, number: u64, problem: String) -> Error {
        let place = format!("{} row {number} at byte {}", element.name, self.window.offset);
        Error::input(self.path, place, problem, "repair the file, e.g. by exporting it again")
    }
}

/// The error for a row that could not be read.
pub fn broken(path: &Path, element: &Element, number: u64, offset: u64, error: io::Error) -> Error {
    let place = format!("{} row {number} of {} at byte {offset}", element.name, element.count);
    match error.kind() {
        io::ErrorKind::UnexpectedEof => Error::input(
            path,
            place,
            "truncated: the file ends within this row or its list",
            "get the whole file",
        ),
        io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput => {
            Error::input(path, place, error.to_string(), "repair the file, e.g. by exporting it again")
        }
        _ => Error::io(path, format!("reading {place}"), error),
    }
}

impl FaceLayout {
    /// The layout if the element holds the list of indices and otherwise single numbers only.
    pub fn of(element: &Element, columns: &Columns) -> Option<Self> {
        let at = columns.uses.iter().position(|&found| found == Use::Indices)?;
        let Kind::List { count, item } = element.properties[at].kind else { return None };
        let lists = element.properties.iter().filter(|p| matches!(p.kind, Kind::List { .. })).count();
        if lists != 1 {
            return None;
        }
        let (before, before_bytes) = fields_of(element, columns, 0..at);
        let (after, after_bytes) = fields_of(element, columns, at + 1..element.properties.len());
        Some(Self { before, before_bytes, count, item, after, after_bytes })
    }

    /// Whether a row is a length in one byte and indices of 32 bits, and nothing else.
    pub fn is_plain(&self) -> bool {
        let alone = self.before_bytes == 0 && self.after_bytes == 0 && self.count.size() == 1;
        alone && matches!(self.item, Scalar::I32 | Scalar::U32)
    }
}

/// The fields with a role among a run of scalar columns, and the run's bytes.
pub fn fields_of(element: &Element, columns: &Columns, range: Range<usize>) -> (Vec<Field>, usize) {
    let mut offset = 0;
    let mut fields = Vec::new();
    for (property, found) in element.properties[range.clone()].iter().zip(&columns.uses[range]) {
        let Kind::Scalar(scalar) = property.kind else { continue };
        if let Use::Role(role) = *found {
            fields.push(Field { offset, scalar, role });
        }
        offset += scalar.size();
    }
    (fields, offset)
}

/// Reads the numbers with a role out of a row.
pub fn read_fields(fields: &[Field], bytes: &[u8], big: bool, row: &mut Row) {
    for field in fields {
        row[field.role] = field.scalar.read(&bytes[field.offset..], big);
    }
}
