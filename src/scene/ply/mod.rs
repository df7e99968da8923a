//! Reads PLY meshes: any property order and type, ascii and binary, polygons and triangle strips.
//!
//! The common binary layouts are scanned directly (see [`body::binary`]); unusual ones and text go through ply-rs.
//! Nothing is allocated before the header's counts are checked against the file's size.

pub mod body;
pub mod columns;
pub mod header;
pub mod scalar;
pub mod stream;
pub mod vertices;

use std::fs::File;
use std::io::Read;
use std::path::Path;

use glam::{Vec2, Vec3};

use crate::error::{Error, Result};
use crate::light::{Rgb, srgb_to_linear};
use crate::scene::Warning;
use crate::scene::assemble::{Contents, Part, Streamed};
use crate::scene::polygon::Count;

/// Reads a PLY file as one part without a material of its own: colours are kept, their use is the caller's choice.
///
/// # Errors
/// [`Error::Io`] when the file cannot be read, [`Error::Input`] when it is no mesh or broken, naming the place.
pub fn read(path: &Path) -> Result<Contents> {
    let opened = |e| Error::io(path, "opening the mesh", e);
    let mut file = File::open(path).map_err(opened)?;
    let file_bytes = file.metadata().map_err(opened)?.len();
    let header = read_header(path, &mut file)?;
    header.check_counts(path, file_bytes)?;
    let tables = body::read(path, file, file_bytes, &header)?;
    let mut warnings = header_warnings(path, &header);
    let mut warn = |message: String| warnings.push(Warning { file: path.to_path_buf(), message });
    let short = tables.faces.short;
    if tables.faces.is_empty() {
        return Err(no_triangle(path, short));
    }
    row_warnings(tables.overlong, tables.has_more, short).into_iter().for_each(&mut warn);
    let float_colours = tables.vertices.has_float_colours();
    let vertices = tables.vertices;
    let cut = tables.faces.finish(&vertices.positions);
    fan_warning(cut.fans).into_iter().for_each(&mut warn);
    let mut colours = vertices.colours;
    let mut from_float = float_colours;
    if let (None, Some(of_faces)) = (&colours, &cut.colours) {
        from_float = tables.float_face_colours;
        let (spread, uniform) = spread_over_vertices(vertices.positions.len(), &cut.triangles, of_faces);
        if !uniform {
            warn("colours are per face; every vertex takes the mean of its faces".to_string());
        }
        colours = Some(spread);
    }
    if let Some(colours) = colours.as_mut().filter(|_| from_float) {
        check_float_colours(path, colours)?.into_iter().for_each(&mut warn);
    }
    let part = Part {
        positions: vertices.positions,
        triangles: cut.triangles,
        normals: vertices.normals,
        colours,
        // Files count v upwards from the image's last row.
        uv: vertices.uv.map(|uv| uv.into_iter().map(|at| Vec2::new(at.x, 1.0 - at.y)).collect()),
        ..Part::default()
    };
    Ok(Contents { parts: vec![part], warnings, ..Contents::default() })
}

/// A part that stands for a file of more faces than are `resident`; None for others, and for those that cannot be opened.
///
/// # Errors
/// As [`read`], as far as the header tells.
pub fn left(path: &Path, resident: u64) -> Result<Option<Contents>> {
    let Ok(mut file) = File::open(path) else { return Ok(None) };
    let Ok(file_bytes) = file.metadata().map(|meta| meta.len()) else { return Ok(None) };
    let header = read_header(path, &mut file)?;
    let faces = |e: &&header::Element| matches!(e.name.as_str(), "face" | "faces") && e.count > resident;
    let Some(faces) = header.elements.iter().find(faces).map(|element| element.count) else {
        return Ok(None);
    };
    header.check_counts(path, file_bytes)?;
    let vertex = header.elements.iter().find(|e| e.name == "vertex");
    let coloured = vertex.map(columns::Columns::of).is_some_and(|columns| columns.has(columns::COLOUR));
    let vertices = vertex.map_or(0, |element| element.count);
    let streamed = Some(Streamed { vertices, faces, file_bytes, ..Streamed::default() });
    let part = Part { streamed, colours: coloured.then(Vec::new), ..Part::default() };
    let warnings = header_warnings(path, &header);
    Ok(Some(Contents { parts: vec![part], warnings, ..Contents::default() }))
}

/// What was odd about the rows: lines with too many numbers, lines too many, faces too short.
fn row_warnings(overlong: Count, has_more: bool, short: Count) -> Vec<String> {
    let mut warnings = Vec::new();
    if overlong.times > 0 {
        warnings.push(format!(
            "{} lines hold more numbers than the header declares (first: line {}); the rest of each was ignored",
            overlong.times, overlong.first
        ));
    }
    if has_more {
        warnings.push("lines follow after the last row that the header promises; they were ignored".into());
    }
    if short.times > 0 {
        let (times, first) = (short.times, short.first);
        warnings.push(format!("{times} faces with fewer than 3 corners skipped (first: row {first})"));
    }
    warnings
}

fn fan_warning(fans: Count) -> Option<String> {
    (fans.times > 0).then(|| format!("{} polygons cross themselves and were cut as fans", fans.times))
}

/// The error for a mesh whose faces are all too short.
fn no_triangle(path: &Path, short: Count) -> Error {
    let (place, what) = match short.times {
        0 => ("element tristrips".to_string(), "strips".to_string()),
        times => (format!("face row {}", short.first), format!("{times} faces")),
    };
    let problem = format!("no triangle: all {what} have fewer than 3 corners");
    Error::input(path, place, problem, "give a mesh with faces, or correct the header's counts")
}

/// Reads and parses the header of an open PLY.
///
/// # Errors
/// As [`header::Header::parse`], and [`Error::Io`].
pub fn read_header(path: &Path, file: &mut File) -> Result<header::Header> {
    let mut head = Vec::new();
    let read = file.by_ref().take(header::MAX_HEADER_BYTES as u64).read_to_end(&mut head);
    read.map_err(|e| Error::io(path, "reading the header", e))?;
    header::Header::parse(path, &head)
}

fn header_warnings(path: &Path, header: &header::Header) -> Vec<Warning> {
    let ignored = header.ignored.iter().map(|(line, text)| {
        let text: String = text.chars().take(60).collect();
        Warning {
            file: path.to_path_buf(),
            message: format!("header line {line} lacks a keyword and was taken for a comment: {text:?}"),
        }
    });
    ignored.collect()
}

/// The mean colour of each vertex's faces, and whether all faces are alike.
fn spread_over_vertices(count: usize, triangles: &[[u32; 3]], of_faces: &[Rgb]) -> (Vec<Rgb>, bool) {
    let mut sums = vec![(Vec3::ZERO, 0.0f32); count];
    for (triangle, &colour) in triangles.iter().zip(of_faces) {
        for &corner in triangle {
            let (sum, faces) = &mut sums[corner as usize];
            *sum += colour;
            *faces += 1.0;
        }
    }
    let uniform = of_faces.windows(2).all(|pair| pair[0] == pair[1]);
    let first = of_faces.first().copied().unwrap_or_default();
    let mean = |(sum, faces): (Vec3, f32)| if uniform || faces == 0.0 { first } else { sum / faces };
    (sums.into_iter().map(mean).collect(), uniform)
}

/// Float colours are linear in [0, 1]; a file that goes up to 255 means bytes.
fn check_float_colours(path: &Path, colours: &mut [Rgb]) -> Result<Option<String>> {
    let odd = colours.iter().position(|c| !c.is_finite() || c.min_element() < 0.0 || c.max_element() > 255.0);
    if let Some(row) = odd {
        let problem = format!("the colour {} is outside 0..1", colours[row]);
        return Err(Error::input(
            path,
            format!("vertex row {row}"),
            problem,
            "write colours as uchar or as float 0..1",
        ));
    }
    if colours.iter().all(|c| c.max_element() <= 1.0) {
        return Ok(None);
    }
    for colour in colours.iter_mut() {
        *colour = Vec3::from_array(colour.to_array().map(|value| srgb_to_linear(value.round() as u8)));
    }
    Ok(Some("float colours exceed 1: they were read as sRGB from 0 to 255".to_string()))
}
