//! The body of a PLY: one table after the other, text or binary.

pub mod binary;
pub mod record;
pub mod text;
pub mod window;

use std::fs::File;
use std::io::{BufReader, Seek, SeekFrom};
use std::path::Path;

use crate::error::{Error, Result};
use crate::scene::faces::Faces;
use crate::scene::ply::columns::{COLOUR, Columns, POSITION};
use crate::scene::ply::header::{Element, Encoding, Header};
use crate::scene::ply::scalar::Scalar;
use crate::scene::ply::vertices::{ColourReader, Vertices};
use crate::scene::polygon::Count;

/// What a body holds of a mesh.
pub struct Tables {
    /// The vertex element.
    pub vertices: Vertices,
    /// The face or tristrips element.
    pub faces: Faces,
    /// Lines with more numbers than the header declares.
    pub overlong: Count,
    /// Whether lines follow after the last row.
    pub has_more: bool,
    /// Whether the faces' colours were floats.
    pub float_face_colours: bool,
}

/// What an element is to the reader.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// Vertices.
    Vertices,
    /// Polygons.
    Faces,
    /// Triangle strips.
    Strips,
    /// Nothing.
    Skipped,
}

/// Which table is what.
#[derive(Debug)]
pub struct Layout {
    /// One per element.
    pub parts: Vec<Part>,
    /// One per element.
    pub columns: Vec<Columns>,
    /// Rows of the vertex element.
    pub vertex_count: u32,
}

impl Layout {
    /// Finds the tables of a mesh and checks that it is one.
    ///
    /// # Errors
    /// [`Error::Input`] naming what the header lacks.
    pub fn of(path: &Path, header: &Header) -> Result<Self> {
        let parts = parts(path, header)?;
        let columns: Vec<Columns> = header.elements.iter().map(Columns::of).collect();
        // `parts` has found a vertex element.
        let at = parts.iter().position(|&part| part == Part::Vertices).unwrap_or(0);
        if !columns[at].has(POSITION) {
            let names = property_names(&header.elements[at]);
            let problem = format!("no numbers called x, y and z (properties: {names})");
            return Err(Error::input(path, "element vertex", problem, "give every vertex a position"));
        }
        // Counts are below the file's size by now, and indices are 32 bits wide.
        let vertex_count = u32::try_from(header.elements[at].count).map_err(|_| {
            let problem = "more than 4294967295 vertices";
            Error::input(path, "element vertex", problem, "split the mesh into several files")
        })?;
        Ok(Self { parts, columns, vertex_count })
    }

    /// The place of the element that is this part.
    pub fn at(&self, wanted: Part) -> Option<usize> {
        self.parts.iter().position(|&part| part == wanted)
    }

    /// The type of the colours that a part's element has.
    pub fn coloured(&self, wanted: Part) -> Option<Scalar> {
        self.at(wanted).and_then(|at| self.columns[at].roles[COLOUR])
    }
}

/// Reads all tables.
///
/// # Errors
/// [`Error::Input`] naming element, row and line or byte.
pub fn read(path: &Path, mut file: File, file_bytes: u64, header: &Header) -> Result<Tables> {
    let layout = Layout::of(path, header)?;
    let Layout { parts, columns, vertex_count } = &layout;
    let vertex_columns = &columns[layout.at(Part::Vertices).unwrap_or(0)];
    let faces = layout.at(Part::Faces).map_or(0, |at| header.elements[at].count);
    let mut tables = Tables {
        vertices: Vertices::with_capacity(vertex_columns, *vertex_count as usize),
        faces: Faces::with_capacity(
            u64::from(*vertex_count),
            usize::try_from(faces).unwrap_or(0),
            layout.coloured(Part::Faces).is_some() && layout.coloured(Part::Vertices).is_none(),
        ),
        overlong: Count::default(),
        has_more: false,
        float_face_colours: layout.coloured(Part::Faces).is_some_and(Scalar::is_float),
    };
    file.seek(SeekFrom::Start(header.body_offset)).map_err(|e| Error::io(path, "seeking to the body", e))?;
    let work = header.elements.iter().zip(parts.iter().zip(columns));
    if header.encoding == Encoding::Ascii {
        read_text(path, file, header, work, &mut tables)?;
    } else {
        let window = window::Window::new(file, header.body_offset, file_bytes);
        let mut body = binary::Body { path, encoding: header.encoding, window };
        for (element, (part, columns)) in work {
            match part {
                Part::Vertices => body.vertices(element, columns, &mut tables.vertices)?,
                Part::Faces => body.faces(element, columns, &mut tables.faces)?,
                Part::Strips => body.strips(element, columns, &mut tables.faces)?,
                Part::Skipped => body.skip(element, columns)?,
            }
        }
    }
    Ok(tables)
}

fn read_text<'a>(
    path: &Path,
    file: File,
    header: &Header,
    work: impl Iterator<Item = (&'a Element, (&'a Part, &'a Columns))>,
    tables: &mut Tables,
) -> Result<()> {
    let mut body = text::Body {
        path,
        source: BufReader::with_capacity(1 << 18, file),
        line: header.lines,
        line_end: header.line_end,
        overlong: Count::default(),
    };
    for (element, (part, columns)) in work {
        let colour_reader = columns.roles[COLOUR].map(ColourReader::new);
        match part {
            Part::Vertices => body.rows(element, columns, |_, record| tables.vertices.push(&record.row))?,
            Part::Faces => body.rows(element, columns, |number, record| {
                let colour = colour_reader.as_ref().map(|reader| reader.colour(&record.row));
                tables.faces.push(number, record.indices().into_iter(), colour)
            })?,
            Part::Strips => {
                body.rows(element, columns, |_, record| {
                    tables.faces.push_strips(record.indices().into_iter())
                })?;
            }
            Part::Skipped => body.skip(element)?,
        }
    }
    tables.overlong = body.overlong;
    tables.has_more = body.has_more()?;
    Ok(())
}

/// Finds the tables of a mesh, one of a kind.
fn parts(path: &Path, header: &Header) -> Result<Vec<Part>> {
    let mut parts: Vec<Part> = Vec::new();
    for element in &header.elements {
        let part = match element.name.as_str() {
            "vertex" | "vertices" => Part::Vertices,
            "face" | "faces" if Columns::of(element).has_indices() => Part::Faces,
            "tristrips" if Columns::of(element).has_indices() => Part::Strips,
            _ => Part::Skipped,
        };
        if part != Part::Skipped && parts.contains(&part) {
            let problem = format!("a second element of the kind {}", element.name);
            return Err(Error::input(path, "header", problem, "merge both into one"));
        }
        parts.push(part);
    }
    let names: Vec<&str> = header.elements.iter().map(|element| element.name.as_str()).collect();
    if !parts.contains(&Part::Vertices) {
        let problem = format!("no vertex element, so this is no mesh (elements: {})", listed(&names));
        return Err(Error::input(path, "header", problem, "give a PLY with vertex and face elements"));
    }
    let has = |part, element: &Element| part == Part::Faces || (part == Part::Strips && element.count > 0);
    let full =
        parts.iter().zip(&header.elements).any(|(&part, element)| has(part, element) && element.count > 0);
    let nameless = |element: &&Element| {
        matches!(element.name.as_str(), "face" | "faces" | "tristrips") && element.count > 0
    };
    if let Some(element) = header.elements.iter().find(nameless).filter(|_| !full) {
        let names = property_names(element);
        let problem =
            format!("no list of integers called vertex_indices or vertex_index (properties: {names})");
        let place = format!("element {}", element.name);
        return Err(Error::input(
            path,
            place,
            problem,
            "name the list of corners so, or export the file again",
        ));
    }
    if !full {
        let problem =
            format!("no faces, so this is a point cloud, not a mesh (elements: {})", listed(&names));
        let remedy = "reconstruct a surface first, e.g. with MeshLab's screened Poisson filter";
        return Err(Error::input(path, "header", problem, remedy));
    }
    Ok(parts)
}

fn property_names(element: &Element) -> String {
    listed(&element.properties.iter().map(|property| property.name.as_str()).collect::<Vec<_>>())
}

fn listed(names: &[&str]) -> String {
    if names.is_empty() { "none".to_string() } else { names.join(", ") }
}
