//! The scene file: meshes, sky, lamps and cameras in TOML.
//!
//! | table | keys, and what holds without them |
//! |---|---|
//! | `[[mesh]]` | `file`; `albedo` (the file's own materials or colours, 0.7 grey otherwise), `radiance` (the file's own), `sides` (2, or as the file says), `name` (the file's stem), `transform` |
//! | `transform` | `scale` (one number or three), then `rotate` (axis and degrees), then `translate` |
//! | `[sky]` | `radiance` or `file`; `rotate` (degrees about up, counter-clockwise from above), `up` ("y") |
//! | `[[lamp]]` | `kind`, `name`; sun: `direction`, `irradiance`; point: `position`, `intensity`; spot: these, `direction`, `angle` (degrees from the axis to the edge of the cone; 45), `blend` (the share of that angle over which the light fades; 0.1) |
//! | `[[camera]]` | `eye`, `target`; `name`, `up` (the sky's), `fov` (40 degrees, vertical), `size` (1280 x 720) |
//!
//! Colours are three numbers, or one for grey.

mod lights;
mod values;

pub(super) use values::edit_distance;

use std::path::Path;
use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3, Vec3};
use serde::Deserialize;
use toml::{Spanned, Value};

use crate::error::{Error, Result};
use crate::light::Rgb;
use crate::scene::assemble::{Contents, Surface};
use crate::scene::materials::{check_albedo, read_texture};

/// A value with its place in the file.
type Placed = Spanned<Value>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SceneFile {
    #[serde(default)]
    mesh: Vec<MeshTable>,
    sky: Option<SkyTable>,
    #[serde(default)]
    lamp: Vec<LampTable>,
    #[serde(default)]
    camera: Vec<CameraTable>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MeshTable {
    file: Spanned<String>,
    albedo: Option<Placed>,
    radiance: Option<Placed>,
    sides: Option<Spanned<i64>>,
    name: Option<Spanned<String>>,
    transform: Option<TransformTable>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TransformTable {
    scale: Option<Placed>,
    rotate: Option<Placed>,
    translate: Option<Placed>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SkyTable {
    radiance: Option<Placed>,
    file: Option<Spanned<String>>,
    rotate: Option<Placed>,
    up: Option<Spanned<String>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LampTable {
    kind: Spanned<String>,
    name: Option<Spanned<String>>,
    direction: Option<Placed>,
    irradiance: Option<Placed>,
    position: Option<Placed>,
    intensity: Option<Placed>,
    angle: Option<Placed>,
    blend: Option<Placed>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraTable {
    name: Option<String>,
    eye: Placed,
    target: Placed,
    up: Option<Placed>,
    fov: Option<Placed>,
    size: Option<Placed>,
}

/// Reads a scene file and everything that it names, but for meshes of more triangles than are `resident`.
///
/// # Errors
/// [`Error::Input`] naming line and key for what the file itself has wrong, or from the files it names.
pub fn read(path: &Path, resident: u64) -> Result<Contents> {
    let text = std::fs::read_to_string(path).map_err(|e| match e.kind() {
        std::io::ErrorKind::InvalidData => Error::input(path, "text", "not UTF-8", "save the file as UTF-8"),
        _ => Error::io(path, "reading the scene", e),
    })?;
    if text.contains('\0') {
        let problem = "it holds zero bytes, so it is no text in UTF-8";
        return Err(Error::input(path, "text", problem, "save the file as UTF-8"));
    }
    let reader = Reader { path, text: &text, resident };
    let file: SceneFile = toml::from_str(&text).map_err(|error| reader.syntax(&error))?;
    let mut contents = Contents::default();
    for table in &file.mesh {
        reader.mesh(table, &mut contents)?;
    }
    if file.mesh.is_empty() {
        let remedy = "add one: [[mesh]] with file = \"scan.ply\"";
        return Err(Error::input(path, "mesh", "the scene names no mesh", remedy));
    }
    if let Some(table) = &file.sky {
        reader.sky(table, &mut contents)?;
    }
    for (number, table) in file.lamp.iter().enumerate() {
        let lamp = reader.lamp(table, number)?;
        reader.check_name(table.name.as_ref(), "lamp.name", &contents)?;
        contents.lamps.push(lamp);
    }
    for (number, table) in file.camera.iter().enumerate() {
        let up = contents.up.unwrap_or(Vec3::Y);
        let camera = reader.camera(table, number, up)?;
        contents.cameras.push(camera);
    }
    Ok(contents)
}

/// The file being read, for messages.
struct Reader<'a> {
    path: &'a Path,
    text: &'a str,
    /// Meshes of more triangles than this are left in their files.
    resident: u64,
}

impl Reader<'_> {
    fn mesh(&self, table: &MeshTable, contents: &mut Contents) -> Result<()> {
        let file = self.existing(&table.file, "mesh.file")?;
        let mut read = crate::scene::read_mesh(&file, self.resident)?;
        let name =
            table.name.as_ref().map_or_else(|| crate::scene::stem(&file), |name| name.get_ref().clone());
        let parts = read.parts.len();
        for part in &mut read.parts {
            part.name = if parts == 1 { name.clone() } else { format!("{name}/{}", part.name) };
            part.file.clone_from(&file);
        }
        if let Some(value) = &table.albedo {
            let surface = self.surface(value, contents)?;
            for part in &mut read.parts {
                if matches!(surface, Surface::Colours(_)) && part.colours.is_none() {
                    let problem = format!("{} has no vertex colours", table.file.get_ref());
                    return Err(self.refuse(value.span(), "mesh.albedo", problem, "give a constant albedo"));
                }
                if matches!(surface, Surface::Image(..)) && part.streamed.is_some() {
                    let problem = format!("{} is too large for a texture", table.file.get_ref());
                    let remedy = "give a constant albedo or vertex colours, or raise --resident";
                    return Err(self.refuse(value.span(), "mesh.albedo", problem, remedy));
                }
                if matches!(surface, Surface::Image(..)) && part.uv.is_none() {
                    let problem = format!("{} has no texture coordinates", table.file.get_ref());
                    return Err(self.refuse(value.span(), "mesh.albedo", problem, "give a constant albedo"));
                }
                part.surface = surface.clone();
            }
        }
        if let Some(value) = &table.radiance {
            let radiance = self.light(value, "mesh.radiance")?;
            read.parts.iter_mut().for_each(|part| part.radiance = radiance);
        }
        match table.sides.as_ref().map(|sides| (*sides.get_ref(), sides.span())) {
            None => {}
            Some((sides @ (1 | 2), _)) => read.parts.iter_mut().for_each(|part| part.one_sided = sides == 1),
            Some((sides, span)) => {
                return Err(self.refuse(span, "mesh.sides", format!("{sides} sides"), "give 1 or 2"));
            }
        }
        if let Some(transform) = &table.transform {
            read.transform(self.transform(transform)?);
        }
        self.check_name(table.name.as_ref(), "mesh.name", contents)?;
        contents.parts.append(&mut read.parts);
        contents.lamps.append(&mut read.lamps);
        contents.cameras.append(&mut read.cameras);
        contents.warnings.append(&mut read.warnings);
        Ok(())
    }

    /// A name that was given must lead to one mesh or lamp.
    fn check_name(&self, name: Option<&Spanned<String>>, key: &str, contents: &Contents) -> Result<()> {
        let Some(name) = name else { return Ok(()) };
        let meshes = contents.parts.iter().map(|part| &part.name);
        if meshes.chain(contents.lamps.iter().map(|lamp| &lamp.name)).any(|taken| taken == name.get_ref()) {
            let problem = format!("the name {:?} is taken", name.get_ref());
            return Err(self.refuse(name.span(), key, problem, "give every mesh and lamp a name of its own"));
        }
        Ok(())
    }

    fn transform(&self, table: &TransformTable) -> Result<DAffine3> {
        let scale = match &table.scale {
            None => DVec3::ONE,
            Some(value) => match value.get_ref() {
                Value::Array(_) => self.vector(value, "transform.scale")?,
                _ => DVec3::splat(self.number(value, "transform.scale")?),
            },
        };
        if scale.to_array().contains(&0.0) {
            let span = table.scale.as_ref().map_or(0..0, Spanned::span);
            return Err(self.refuse(
                span,
                "transform.scale",
                "a scale of 0",
                "leave it out, or give another",
            ));
        }
        let rotation = match &table.rotate {
            None => DQuat::IDENTITY,
            Some(value) => {
                let [x, y, z, degrees] = self.numbers(value, "transform.rotate")?;
                let axis = DVec3::new(x, y, z).try_normalize().ok_or_else(|| {
                    self.refuse(
                        value.span(),
                        "transform.rotate",
                        "the axis is zero",
                        "give [x, y, z, degrees]",
                    )
                })?;
                DQuat::from_axis_angle(axis, degrees.to_radians())
            }
        };
        let translation = match &table.translate {
            None => DVec3::ZERO,
            Some(value) => self.vector(value, "transform.translate")?,
        };
        Ok(DAffine3::from_scale_rotation_translation(scale, rotation, translation))
    }

    fn surface(&self, value: &Placed, contents: &mut Contents) -> Result<Surface> {
        let key = "mesh.albedo";
        let remedy = "give [r, g, b], \"vertex\" or { texture = \"file.png\" }";
        match value.get_ref() {
            Value::String(word) if word == "vertex" => Ok(Surface::Colours(Rgb::ONE)),
            Value::Table(table) => {
                if let Some(odd) = table.keys().find(|key| *key != "texture") {
                    let remedy = "the nearest valid key is `texture`";
                    return Err(self.refuse(value.span(), key, format!("unknown key `{odd}`"), remedy));
                }
                let Some(file) = table.get("texture").and_then(Value::as_str) else {
                    return Err(self.refuse(value.span(), key, "no texture file is named", remedy));
                };
                let file =
                    self.existing(&Spanned::new(value.span(), file.to_string()), "mesh.albedo.texture")?;
                Ok(Surface::Image(Arc::new(read_texture(&file, &mut contents.warnings)?), Rgb::ONE))
            }
            Value::String(word) => {
                Err(self.refuse(value.span(), key, format!("{word:?} is no albedo"), remedy))
            }
            _ => {
                let albedo = self.colour(value, key)?;
                let range = "give every channel a value from 0 to below 1, e.g. 0.8";
                check_albedo(albedo).map_err(|problem| self.refuse(value.span(), key, problem, range))?;
                Ok(Surface::Constant(albedo))
            }
        }
    }
}
