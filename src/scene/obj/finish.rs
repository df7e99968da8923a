//! From the statements of an OBJ file to parts, one per material.

use glam::{DVec3, Vec2, Vec3};

use super::{NONE, Reader};
use crate::error::{Error, Result};
use crate::scene::assemble::{Contents, Part, Surface};
use crate::scene::polygon::Count;
use crate::scene::{Warning, materials};

impl Reader<'_> {
    /// Checks what could not be checked before, and makes the parts.
    ///
    /// # Errors
    /// [`Error::Input`] naming the line or the material.
    pub(super) fn finish(mut self) -> Result<Contents> {
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
