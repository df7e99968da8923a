//! Reads Wavefront OBJ meshes: polygons, negative indices, vertex colours, materials.
//!
//! One mesh per material. Every problem is named with its line.

mod finish;
mod library;
mod statements;

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

use glam::{DVec3, Vec2, Vec3};

use crate::error::{Error, Result};
use crate::light::Rgb;
use crate::scene::Warning;
use crate::scene::assemble::Contents;
use crate::scene::faces::Faces;
use crate::scene::ply::vertices::srgb_decoded;
use crate::scene::polygon::Count;
use library::Library;

/// Reads an OBJ file and its material libraries.
///
/// # Errors
/// [`Error::Io`] when the file cannot be read, [`Error::Input`] naming the line when it is broken.
pub fn read(path: &Path) -> Result<Contents> {
    let file = File::open(path).map_err(|e| Error::io(path, "opening the mesh", e))?;
    let mut source = BufReader::with_capacity(1 << 18, file);
    let mut reader = Reader::new(path);
    let mut bytes = Vec::new();
    while reader.next_line(&mut source, &mut bytes)? {
        let line = String::from_utf8_lossy(bytes.trim_ascii());
        reader.statement(&line).map_err(|problem| reader.refuse(reader.line, problem))?;
    }
    reader.finish()
}

/// Faces of one material.
struct Group {
    material: Option<String>,
    faces: Faces,
    /// Position and texture coordinate of each corner number, if the material has a texture.
    pairs: Option<Pairs>,
}

/// Vertices of a textured group: one for each pair of position and texture coordinate.
#[derive(Default)]
struct Pairs {
    numbers: HashMap<(u32, u32), u32>,
    list: Vec<(u32, u32)>,
}

/// No texture coordinate or normal.
const NONE: u32 = u32::MAX;

/// The file as far as it has been read.
struct Reader<'a> {
    path: &'a Path,
    line: u64,
    positions: Vec<DVec3>,
    colours: Vec<Rgb>,
    uv: Vec<Vec2>,
    normals: Vec<Vec3>,
    /// The normal of each position, as long as no position has two.
    normal_of: Option<Vec<u32>>,
    groups: Vec<Group>,
    group_of: HashMap<Option<String>, usize>,
    current: Option<String>,
    library: Library,
    /// The greatest index of each list so far that pointed ahead, and its line.
    ahead: [(u32, u64); 3],
    short: Count,
    unread: Count,
    warnings: Vec<Warning>,
}

impl<'a> Reader<'a> {
    fn new(path: &'a Path) -> Self {
        Self {
            path,
            line: 0,
            positions: Vec::new(),
            colours: Vec::new(),
            uv: Vec::new(),
            normals: Vec::new(),
            normal_of: Some(Vec::new()),
            groups: Vec::new(),
            group_of: HashMap::new(),
            current: None,
            library: Library::default(),
            ahead: [(0, 0); 3],
            short: Count::default(),
            unread: Count::default(),
            warnings: Vec::new(),
        }
    }

    fn refuse(&self, line: u64, problem: impl Into<String>) -> Error {
        Error::input(self.path, format!("line {line}"), problem, "repair the line, or export the file again")
    }

    /// Reads a line into `bytes`, joining lines that end in a backslash; false at the end.
    fn next_line(&mut self, source: &mut impl BufRead, bytes: &mut Vec<u8>) -> Result<bool> {
        bytes.clear();
        loop {
            let read = source.read_until(b'\n', bytes);
            let count =
                read.map_err(|e| Error::io(self.path, format!("reading line {}", self.line + 1), e))?;
            if count == 0 {
                return Ok(!bytes.is_empty());
            }
            self.line += 1;
            let length = bytes.trim_ascii_end().len();
            if length == 0 || bytes[length - 1] != b'\\' {
                return Ok(true);
            }
            bytes.truncate(length - 1);
            bytes.push(b' ');
        }
    }

    fn statement(&mut self, line: &str) -> Result<(), String> {
        let (keyword, rest) = line.split_once([' ', '\t']).unwrap_or((line, ""));
        match keyword {
            "v" => self.vertex(rest),
            "f" | "fo" => self.face(rest),
            "vt" => {
                let mut numbers = rest.split_ascii_whitespace().map(number);
                let u = numbers.next().ok_or("a texture coordinate without numbers")??;
                // Files count v upwards from the image's last row.
                let v = numbers.next().unwrap_or(Ok(0.0))?;
                self.uv.push(Vec2::new(u as f32, (1.0 - v) as f32));
                Ok(())
            }
            "vn" => {
                let [x, y, z] = three(rest, "a normal")?;
                self.normals.push(DVec3::new(x, y, z).as_vec3());
                Ok(())
            }
            "usemtl" => {
                self.current = Some(rest.trim().to_string());
                Ok(())
            }
            "mtllib" => {
                self.library.load(self.path, rest.trim(), &mut self.warnings);
                Ok(())
            }
            "" | "o" | "g" | "s" => Ok(()),
            _ if keyword.starts_with('#') => Ok(()),
            _ => {
                self.unread.note(self.line);
                Ok(())
            }
        }
    }

    fn vertex(&mut self, rest: &str) -> Result<(), String> {
        let [x, y, z] = three(rest, "a vertex")?;
        let extra =
            rest.split_ascii_whitespace().skip(3).map(number).collect::<Result<Vec<f64>, String>>()?;
        // Four more or fewer are a weight, three (after it, perhaps) are a colour.
        if let [.., r, g, b] = extra[..] {
            let channel = |value: f64| srgb_decoded(value.clamp(0.0, 1.0));
            self.colours.push(Rgb::new(channel(r), channel(g), channel(b)));
        }
        self.positions.push(DVec3::new(x, y, z));
        if self.positions.len() >= NONE as usize {
            return Err("more than 4294967294 vertices".to_string());
        }
        Ok(())
    }

    fn face(&mut self, rest: &str) -> Result<(), String> {
        let mut corners: Vec<[u32; 3]> = Vec::with_capacity(4);
        for word in rest.split_ascii_whitespace() {
            let mut fields = word.split('/');
            let counts = [self.positions.len(), self.uv.len(), self.normals.len()];
            let mut corner = [NONE; 3];
            for (list, count) in counts.into_iter().enumerate() {
                match fields.next() {
                    Some("") | None if list > 0 => {}
                    field => corner[list] = self.index(field.unwrap_or(""), count, list)?,
                }
            }
            corners.push(corner);
        }
        if corners.len() < 3 {
            self.short.note(self.line);
            return Ok(());
        }
        self.note_normals(&corners);
        let line = self.line;
        let group = self.group();
        if let Some(pairs) = &mut group.pairs {
            for corner in &mut corners {
                let key = (corner[0], corner[1]);
                let next = pairs.list.len() as u32;
                corner[0] = *pairs.numbers.entry(key).or_insert(next);
                if corner[0] == next {
                    pairs.list.push(key);
                }
            }
        }
        group.faces.push(line, corners.iter().map(|corner| i64::from(corner[0])), None)
    }

    /// The zero-based index that a field means; indices may point ahead, which is checked at the end.
    fn index(&mut self, field: &str, count: usize, list: usize) -> Result<u32, String> {
        const LISTS: [&str; 3] = ["vertex", "texture coordinate", "normal"];
        let what = LISTS[list];
        let written: i64 = field.parse().map_err(|_| format!("{field:?} is no {what} index"))?;
        let index = match written {
            0 => return Err(format!("{what} index 0: indices count from 1")),
            1.. => written - 1,
            _ => count as i64 + written,
        };
        let index = u32::try_from(index).ok().filter(|&index| index != NONE);
        let index =
            index.ok_or_else(|| format!("{what} index {written} is out of range, there are {count}"))?;
        if index as usize >= count && index >= self.ahead[list].0 {
            self.ahead[list] = (index, self.line);
        }
        Ok(index)
    }

    fn note_normals(&mut self, corners: &[[u32; 3]]) {
        let Some(normal_of) = &mut self.normal_of else { return };
        for &[position, _, normal] in corners {
            if normal == NONE && normal_of.is_empty() {
                continue;
            }
            if position as usize >= normal_of.len() {
                if position as usize >= self.positions.len() {
                    self.normal_of = None;
                    return;
                }
                normal_of.resize(self.positions.len(), NONE);
            }
            let known = &mut normal_of[position as usize];
            if *known == NONE {
                *known = normal;
            } else if *known != normal {
                self.normal_of = None;
                return;
            }
        }
    }

    fn group(&mut self) -> &mut Group {
        let next = self.groups.len();
        let at = *self.group_of.entry(self.current.clone()).or_insert(next);
        if at == next {
            let textured = self.current.as_ref().is_some_and(|name| self.library.has_texture(name));
            self.groups.push(Group {
                material: self.current.clone(),
                // The range of indices is checked at the end of the file.
                faces: Faces::with_capacity(u64::from(NONE), 0, false),
                pairs: textured.then(Pairs::default),
            });
        }
        &mut self.groups[at]
    }
}

fn three(rest: &str, what: &str) -> Result<[f64; 3], String> {
    let mut numbers = rest.split_ascii_whitespace().map(number);
    let mut next = || numbers.next().unwrap_or_else(|| Err(format!("{what} needs three numbers")));
    Ok([next()?, next()?, next()?])
}

fn number(word: &str) -> Result<f64, String> {
    match word.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        Ok(_) => Err(format!("{word:?} is not finite")),
        Err(_) => Err(format!("{word:?} is no number")),
    }
}
