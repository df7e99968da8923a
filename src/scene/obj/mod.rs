//! Reads Wavefront OBJ meshes: polygons, negative indices, vertex colours, materials.
//!
//! One mesh per material. Geometry is read here, because every problem is to be named with its line; material
//! libraries are read by tobj.

mod library;

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

use glam::{DVec3, Vec2, Vec3};

use crate::error::{Error, Result};
use crate::light::Rgb;
use crate::scene::assemble::{Contents, Part, Surface};
use crate::scene::faces::Faces;
use crate::scene::ply::vertices::srgb_decoded;
use crate::scene::polygon::Count;
use crate::scene::{Warning, materials};
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

    fn finish(mut self) -> Result<Contents> {
        self.check_indices()?;
        self.warn_of_the_rest();
        let normals = self.vertex_normals();
        let colours = (self.colours.len() == self.positions.len()).then(|| std::mem::take(&mut self.colours));
        let positions = std::mem::take(&mut self.positions);
        let groups = std::mem::take(&mut self.groups);
        let single = groups.len() == 1;
        let mut contents = Contents::default();
        let mut fans = Count::default();
        let mut whole = Some((positions, colours, normals));
        for group in groups {
            let Some((positions, colours, normals)) = &whole else { break };
            let mut part = self.material_part(group.material.as_deref())?;
            part.name = if single { String::new() } else { group.material.clone().unwrap_or_default() };
            let originals: Vec<u32> = match &group.pairs {
                None if single => {
                    let cut = group.faces.finish(positions);
                    fans.times += cut.fans.times;
                    part.triangles = cut.triangles;
                    (part.positions, part.colours, part.normals) = whole.take().unwrap_or_default();
                    contents.parts.push(part);
                    continue;
                }
                None => {
                    let cut = group.faces.finish(positions);
                    fans.times += cut.fans.times;
                    part.triangles = cut.triangles;
                    renumber(&mut part.triangles, positions.len())
                }
                Some(pairs) => {
                    let own: Vec<DVec3> = pairs.list.iter().map(|&(v, _)| positions[v as usize]).collect();
                    let cut = group.faces.finish(&own);
                    fans.times += cut.fans.times;
                    part.triangles = cut.triangles;
                    part.uv = Some(pairs.list.iter().map(|&(_, t)| self.uv_at(t)).collect());
                    pairs.list.iter().map(|&(v, _)| v).collect()
                }
            };
            part.positions = originals.iter().map(|&v| positions[v as usize]).collect();
            part.colours = colours.as_ref().map(|all| originals.iter().map(|&v| all[v as usize]).collect());
            part.normals = normals.as_ref().map(|all| originals.iter().map(|&v| all[v as usize]).collect());
            contents.parts.push(part);
        }
        if fans.times > 0 {
            self.warn(format!("{} polygons cross themselves and were cut as fans", fans.times));
        }
        contents.warnings = self.warnings;
        Ok(contents)
    }

    fn check_indices(&self) -> Result<()> {
        let lists = [
            ("vertex", self.positions.len()),
            ("texture coordinate", self.uv.len()),
            ("normal", self.normals.len()),
        ];
        for ((what, count), (index, line)) in lists.into_iter().zip(self.ahead) {
            if line > 0 && index as usize >= count {
                let problem =
                    format!("{what} index {} is out of range, there are {count}", u64::from(index) + 1);
                return Err(self.refuse(line, problem));
            }
        }
        if self.groups.is_empty() {
            let (place, problem) = if self.short.times > 0 {
                let problem =
                    format!("no valid face: all {} faces have fewer than 3 corners", self.short.times);
                (format!("line {}", self.short.first), problem)
            } else {
                ("faces".to_string(), "no faces, so this is no mesh".to_string())
            };
            return Err(Error::input(self.path, place, problem, "give an OBJ with faces"));
        }
        Ok(())
    }

    fn warn(&mut self, message: String) {
        self.warnings.push(Warning { file: self.path.to_path_buf(), message });
    }

    fn warn_of_the_rest(&mut self) {
        let (short, unread) = (self.short, self.unread);
        if short.times > 0 {
            self.warn(format!(
                "{} faces with fewer than 3 corners skipped (first: line {})",
                short.times, short.first
            ));
        }
        if unread.times > 0 {
            let message =
                format!("{} lines of kinds that are not read (first: line {})", unread.times, unread.first);
            self.warn(message);
        }
        if !self.colours.is_empty() && self.colours.len() < self.positions.len() {
            let message = format!(
                "only {} of {} vertices have colours: ignored",
                self.colours.len(),
                self.positions.len()
            );
            self.warn(message);
        }
    }

    /// One normal per position, if the file gives each exactly one.
    fn vertex_normals(&self) -> Option<Vec<Vec3>> {
        let normal_of = self.normal_of.as_ref().filter(|of| of.len() == self.positions.len())?;
        let mut normals = Vec::with_capacity(normal_of.len());
        for &at in normal_of {
            normals.push(if at == NONE { Vec3::ZERO } else { self.normals[at as usize] });
        }
        (!normals.is_empty()).then_some(normals)
    }

    fn uv_at(&self, at: u32) -> Vec2 {
        if at == NONE { Vec2::ZERO } else { self.uv[at as usize] }
    }

    /// A part with the material's properties; without material or library it takes the defaults.
    fn material_part(&mut self, name: Option<&str>) -> Result<Part> {
        let Some(name) = name else { return Ok(Part::default()) };
        let Some(material) = self.library.material(name) else {
            if self.library.loaded {
                self.warn(format!("material {name:?} is in no library: the default is taken"));
            }
            return Ok(Part::default());
        };
        let refuse = |key: &str, problem: String| {
            let place = format!("material {name}, {key}");
            Error::input(&material.file, place, problem, "correct the material library")
        };
        let (albedo, clamped) = materials::tame_albedo(material.albedo).map_err(|p| refuse("Kd", p))?;
        materials::check_radiance(material.radiance).map_err(|p| refuse("Ke", p))?;
        let surface = match &material.texture {
            Some(texture) => Surface::Image(texture.clone(), albedo),
            None => Surface::Constant(albedo),
        };
        let part = Part { surface, radiance: material.radiance, ..Part::default() };
        if clamped {
            self.warn(format!("material {name:?} reflects everything: darkened to {}", materials::LIMIT));
        }
        Ok(part)
    }
}

/// Numbers the vertices that the triangles use from 0 on, in their order; gives their original numbers.
fn renumber(triangles: &mut [[u32; 3]], count: usize) -> Vec<u32> {
    let mut number_of = vec![NONE; count];
    triangles.iter().flatten().for_each(|&corner| number_of[corner as usize] = 0);
    let mut originals = Vec::new();
    for (original, number) in number_of.iter_mut().enumerate() {
        if *number == 0 {
            *number = originals.len() as u32;
            originals.push(original as u32);
        }
    }
    triangles.iter_mut().flatten().for_each(|corner| *corner = number_of[*corner as usize]);
    originals
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
