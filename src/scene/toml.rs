//! The scene file: meshes, sky, lamps and cameras in TOML. Its keys are described in the manual's section "The scene".

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3, Vec3};
use serde::Deserialize;
use toml::{Spanned, Value};

use crate::error::{Error, Result};
use crate::light::Rgb;
use crate::scene::assemble::{Contents, Surface, WorldCamera, WorldLamp};
use crate::scene::materials::{check_albedo, check_radiance, read_texture};
use crate::scene::{Camera, LampKind, Sky, sky};

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
    name: Option<String>,
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
    size: Option<Spanned<[u32; 2]>>,
}

/// Reads a scene file and everything that it names.
///
/// # Errors
/// [`Error::Input`] naming line and key for what the file itself has wrong, or from the files it names.
pub fn read(path: &Path) -> Result<Contents> {
    let text = std::fs::read_to_string(path).map_err(|e| match e.kind() {
        std::io::ErrorKind::InvalidData => Error::input(path, "text", "not UTF-8", "save the file as UTF-8"),
        _ => Error::io(path, "reading the scene", e),
    })?;
    let reader = Reader { path, text: &text };
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
}

impl Reader<'_> {
    fn line(&self, at: usize) -> usize {
        1 + self.text.as_bytes()[..at.min(self.text.len())].iter().filter(|&&b| b == b'\n').count()
    }

    fn refuse(&self, span: Range<usize>, key: &str, problem: impl Into<String>, remedy: &str) -> Error {
        Error::input(self.path, format!("line {}, key {key}", self.line(span.start)), problem, remedy)
    }

    /// Turns the TOML reader's complaint into ours; an unknown key is answered with the nearest known one.
    fn syntax(&self, error: &toml::de::Error) -> Error {
        let message = error.message();
        let place = error.span().map_or("text".to_string(), |span| format!("line {}", self.line(span.start)));
        if message.starts_with("unknown field") {
            let mut quoted = message.split('`').skip(1).step_by(2);
            let unknown = quoted.next().unwrap_or_default();
            let nearest = quoted.min_by_key(|known| edit_distance(unknown, known)).unwrap_or_default();
            let place = format!("{place}, key {unknown}");
            let remedy = format!("the nearest valid key is `{nearest}`");
            return Error::input(self.path, place, format!("unknown key `{unknown}`"), remedy);
        }
        Error::input(self.path, place, message.trim().replace('\n', " "), "correct the scene file")
    }

    fn mesh(&self, table: &MeshTable, contents: &mut Contents) -> Result<()> {
        let file = self.existing(&table.file, "mesh.file")?;
        let mut read = super::read_mesh(&file)?;
        let name = table.name.as_ref().map_or_else(|| super::stem(&file), |name| name.get_ref().clone());
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
        if let Some(name) =
            table.name.as_ref().filter(|name| contents.parts.iter().any(|part| part.name == *name.get_ref()))
        {
            let problem = format!("the name {:?} is taken", name.get_ref());
            return Err(self.refuse(name.span(), "mesh.name", problem, "give every mesh a name of its own"));
        }
        contents.parts.append(&mut read.parts);
        contents.lamps.append(&mut read.lamps);
        contents.cameras.append(&mut read.cameras);
        contents.warnings.append(&mut read.warnings);
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

    fn sky(&self, table: &SkyTable, contents: &mut Contents) -> Result<()> {
        let up = match &table.up {
            None => Vec3::Y,
            Some(word) => sky::axis(word.get_ref()).ok_or_else(|| {
                let problem = format!("{:?} is no axis", word.get_ref());
                self.refuse(word.span(), "sky.up", problem, "give \"x\", \"y\" or \"z\", or one with a minus")
            })?,
        };
        contents.up = Some(up);
        let read = match (&table.radiance, &table.file) {
            (Some(value), None) => Sky::Constant(self.light(value, "sky.radiance")?),
            (None, Some(file)) => {
                let degrees =
                    table.rotate.as_ref().map_or(Ok(0.0), |value| self.number(value, "sky.rotate"))?;
                let file = self.existing(file, "sky.file")?;
                let image = Arc::new(sky::read_image(&file, &mut contents.warnings)?);
                Sky::Image { image, to_image: sky::to_image(up, degrees as f32) }
            }
            (Some(value), Some(_)) => {
                let problem = "both radiance and file are given";
                return Err(self.refuse(value.span(), "sky.radiance", problem, "keep one of them"));
            }
            (None, None) => {
                let remedy = "add radiance = [1, 1, 1] or file = \"sky.exr\", or remove [sky]";
                return Err(Error::input(self.path, "sky", "neither radiance nor file is given", remedy));
            }
        };
        if let (Some(value), Sky::Constant(_)) = (&table.rotate, &read) {
            let problem = "a constant sky cannot be rotated";
            return Err(self.refuse(value.span(), "sky.rotate", problem, "remove the key"));
        }
        contents.sky = Some(read);
        Ok(())
    }

    fn lamp(&self, table: &LampTable, number: usize) -> Result<WorldLamp> {
        let kind = table.kind.get_ref().as_str();
        let given = [
            ("direction", &table.direction, ["sun", "spot"].as_slice()),
            ("irradiance", &table.irradiance, &["sun"]),
            ("position", &table.position, &["point", "spot"]),
            ("intensity", &table.intensity, &["point", "spot"]),
            ("angle", &table.angle, &["spot"]),
            ("blend", &table.blend, &["spot"]),
        ];
        if !["sun", "point", "spot"].contains(&kind) {
            let problem = format!("{kind:?} is no kind of lamp");
            return Err(self.refuse(table.kind.span(), "lamp.kind", problem, "give sun, point or spot"));
        }
        for (key, value, kinds) in given {
            let needed = kinds.contains(&kind) && key != "angle" && key != "blend";
            let problem = match value {
                Some(value) if !kinds.contains(&kind) => {
                    let remedy = format!("remove it; it belongs to {}", kinds.join(" and "));
                    let problem = format!("a {kind} has no {key}");
                    return Err(self.refuse(value.span(), &format!("lamp.{key}"), problem, &remedy));
                }
                None if needed => format!("a {kind} needs {key}"),
                _ => continue,
            };
            let remedy = format!("add {key} = [x, y, z]");
            return Err(self.refuse(table.kind.span(), &format!("lamp.{key}"), problem, &remedy));
        }
        let direction = match &table.direction {
            None => Vec3::NEG_Y,
            Some(value) => self.direction(value, "lamp.direction")?,
        };
        let light =
            |value: &Option<Placed>, key| value.as_ref().map_or(Ok(Rgb::ZERO), |v| self.light(v, key));
        let place = |value: &Option<Placed>| match value {
            None => Ok(DVec3::ZERO),
            Some(value) => self.vector(value, "lamp.position"),
        };
        let intensity = light(&table.intensity, "lamp.intensity")?;
        let kind = match kind {
            "sun" => LampKind::Sun { direction, irradiance: light(&table.irradiance, "lamp.irradiance")? },
            "point" => LampKind::Point { position: Vec3::ZERO, intensity },
            _ => {
                let angle = self.within(&table.angle, "lamp.angle", 45.0, 0.1..=90.0)?;
                let blend = self.within(&table.blend, "lamp.blend", 0.1, 0.0..=1.0)?;
                super::spot(direction, intensity, (angle * (1.0 - blend)).to_radians(), angle.to_radians())
            }
        };
        let name = table.name.clone().unwrap_or_else(|| super::numbered("lamp", number));
        Ok(WorldLamp { name, position: place(&table.position)?, kind })
    }

    fn camera(&self, table: &CameraTable, number: usize, up: Vec3) -> Result<WorldCamera> {
        let eye = self.vector(&table.eye, "camera.eye")?;
        let target = self.vector(&table.target, "camera.target")?;
        if eye == target {
            let problem = "eye and target are the same point";
            return Err(self.refuse(table.target.span(), "camera.target", problem, "give another target"));
        }
        let up = table.up.as_ref().map_or(Ok(up), |value| self.direction(value, "camera.up"))?;
        let fov_degrees = self.within(&table.fov, "camera.fov", 40.0, 0.01..=179.0)? as f32;
        let size = table.size.as_ref().map_or([1280, 720], |size| *size.get_ref());
        if let Some(at) = table.size.as_ref().filter(|_| size.iter().any(|&n| n == 0 || n > 1 << 16)) {
            let problem = format!("a picture of {} x {} pixels", size[0], size[1]);
            return Err(self.refuse(at.span(), "camera.size", problem, "give 1 to 65536 pixels each way"));
        }
        let name = table.name.clone().unwrap_or_else(|| super::numbered("camera", number));
        let rest = Camera { name, eye: Vec3::ZERO, target: Vec3::ZERO, up, fov_degrees, size };
        Ok(WorldCamera { eye, target, rest })
    }

    /// The path that a file key means; it must exist.
    fn existing(&self, file: &Spanned<String>, key: &str) -> Result<PathBuf> {
        let path = self.path.parent().unwrap_or(Path::new("")).join(file.get_ref());
        if path.is_file() {
            return Ok(path);
        }
        let problem = format!("{} does not exist", path.display());
        Err(self.refuse(file.span(), key, problem, "paths are relative to the scene file: correct it"))
    }

    fn number(&self, value: &Placed, key: &str) -> Result<f64> {
        let number = match value.get_ref() {
            Value::Float(number) => *number,
            Value::Integer(number) => *number as f64,
            other => {
                let problem = format!("a number is expected, found {}", other.type_str());
                return Err(self.refuse(value.span(), key, problem, "give a number"));
            }
        };
        if number.is_finite() {
            return Ok(number);
        }
        Err(self.refuse(value.span(), key, format!("{number} is not finite"), "give a finite number"))
    }

    fn numbers<const N: usize>(&self, value: &Placed, key: &str) -> Result<[f64; N]> {
        let expected = || format!("{N} numbers are expected");
        let remedy = format!("give an array of {N} numbers");
        let Value::Array(array) = value.get_ref() else {
            return Err(self.refuse(value.span(), key, expected(), &remedy));
        };
        if array.len() != N {
            let problem = format!("{}, found {}", expected(), array.len());
            return Err(self.refuse(value.span(), key, problem, &remedy));
        }
        let mut numbers = [0.0; N];
        for (number, entry) in numbers.iter_mut().zip(array) {
            *number = self.number(&Spanned::new(value.span(), entry.clone()), key)?;
        }
        Ok(numbers)
    }

    fn vector(&self, value: &Placed, key: &str) -> Result<DVec3> {
        self.numbers(value, key).map(DVec3::from_array)
    }

    fn direction(&self, value: &Placed, key: &str) -> Result<Vec3> {
        let vector = self.vector(value, key)?.try_normalize();
        vector.map(DVec3::as_vec3).ok_or_else(|| {
            self.refuse(value.span(), key, "a direction of no length", "give a vector other than zero")
        })
    }

    /// Three channels, or one number for all of them.
    fn colour(&self, value: &Placed, key: &str) -> Result<Rgb> {
        match value.get_ref() {
            Value::Float(_) | Value::Integer(_) => {
                self.number(value, key).map(|grey| Rgb::splat(grey as f32))
            }
            _ => self.vector(value, key).map(DVec3::as_vec3),
        }
    }

    fn light(&self, value: &Placed, key: &str) -> Result<Rgb> {
        let light = self.colour(value, key)?;
        let remedy = "give finite values of 0 or more";
        check_radiance(light).map_err(|problem| self.refuse(value.span(), key, problem, remedy))?;
        Ok(light)
    }

    fn within(
        &self,
        value: &Option<Placed>,
        key: &str,
        default: f64,
        range: std::ops::RangeInclusive<f64>,
    ) -> Result<f64> {
        let Some(value) = value else { return Ok(default) };
        let number = self.number(value, key)?;
        if range.contains(&number) {
            return Ok(number);
        }
        let remedy = format!("give a value from {} to {}", range.start(), range.end());
        Err(self.refuse(value.span(), key, format!("{number} is out of range"), &remedy))
    }
}

/// Levenshtein distance between two short words.
fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, &y) in b.iter().enumerate() {
            let change = diagonal + usize::from(x != y);
            diagonal = row[j + 1];
            row[j + 1] = change.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}
