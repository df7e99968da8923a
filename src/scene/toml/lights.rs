//! Sky, lamps and cameras of a scene file.

use std::sync::Arc;

use glam::{DVec3, Vec3};

use super::{CameraTable, LampTable, Placed, Reader, SkyTable};
use crate::error::{Error, Result};
use crate::light::Rgb;
use crate::scene::assemble::{Contents, WorldCamera, WorldLamp};
use crate::scene::{Camera, LampKind, Sky, numbered, sky, spot};

impl Reader<'_> {
    pub(super) fn sky(&self, table: &SkyTable, contents: &mut Contents) -> Result<()> {
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

    pub(super) fn lamp(&self, table: &LampTable, number: usize) -> Result<WorldLamp> {
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
            let is_light = ["irradiance", "intensity"].contains(&key);
            let remedy = format!("add {key} = {}", if is_light { "[r, g, b]" } else { "[x, y, z]" });
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
                spot(direction, intensity, (angle * (1.0 - blend)).to_radians(), angle.to_radians())
            }
        };
        let name =
            table.name.as_ref().map_or_else(|| numbered("lamp", number), |name| name.get_ref().clone());
        Ok(WorldLamp { name, position: place(&table.position)?, kind })
    }

    pub(super) fn camera(&self, table: &CameraTable, number: usize, up: Vec3) -> Result<WorldCamera> {
        let eye = self.vector(&table.eye, "camera.eye")?;
        let target = self.vector(&table.target, "camera.target")?;
        if eye == target {
            let problem = "eye and target are the same point";
            return Err(self.refuse(table.target.span(), "camera.target", problem, "give another target"));
        }
        let up = table.up.as_ref().map_or(Ok(up), |value| self.direction(value, "camera.up"))?;
        let fov_degrees = self.within(&table.fov, "camera.fov", 40.0, 0.01..=179.0)? as f32;
        let size = match &table.size {
            None => [1280.0, 720.0],
            Some(size) => self.numbers(size, "camera.size")?,
        };
        let is_whole = |n: f64| (1.0..=65536.0).contains(&n) && n.fract() == 0.0;
        if let Some(at) = table.size.as_ref().filter(|_| !size.into_iter().all(is_whole)) {
            let problem = format!("a picture of {} x {} pixels", size[0], size[1]);
            return Err(self.refuse(at.span(), "camera.size", problem, "give 1 to 65536 pixels each way"));
        }
        let size = size.map(|n| n as u32);
        let name = table.name.clone().unwrap_or_else(|| numbered("camera", number));
        let rest = Camera { name, eye: Vec3::ZERO, target: Vec3::ZERO, up, fov_degrees, size };
        Ok(WorldCamera { eye, target, rest })
    }
}
