//! What may change without new rows: lights and albedos, by the names of the scene.

use std::path::Path;
use std::sync::Arc;

use glam::{DVec3, Vec3};

use crate::error::{Error, Result};
use crate::light::Rgb;
use crate::light::harmonics::MOST_ORDER;
use crate::scene::materials::{LIMIT, check_albedo, check_radiance};
use crate::scene::{Albedo, LampKind, Scene, Sky, Texture, Warning, nearest_word, sky};

/// The lights and albedos of a scene: a plain value, to be changed and handed to
/// [`Relighter::relight`](super::Relighter::relight). Entries are in the order of the scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Lighting {
    /// Per mesh.
    pub meshes: Vec<MeshLight>,
    /// Per punctual lamp: its place, direction and light, in local units as [`Scene::lamps`] has them.
    pub lamps: Vec<LampKind>,
    /// Light from outside.
    pub sky: Option<SkyLight>,
}

/// What a mesh emits and reflects.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeshLight {
    /// Emitted radiance, W·m⁻²·sr⁻¹.
    pub radiance: Rgb,
    /// Its reflectance.
    pub paint: Paint,
}

/// The reflectance of a mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Paint {
    /// As it was baked.
    Baked,
    /// As it was baked, times this by channel; at most 0.999.
    Scaled(Rgb),
    /// The same everywhere, each channel in [0, 1).
    Plain(Rgb),
}

/// Light from outside.
#[derive(Debug, Clone, PartialEq)]
pub struct SkyLight {
    /// The same radiance from everywhere, W·m⁻²·sr⁻¹; None for an image.
    pub constant: Option<Rgb>,
    /// Another image than the one that was baked.
    pub image: Option<SkyImage>,
    /// Multiplies either, by channel.
    pub tint: Rgb,
    /// Turns the image about the scene's up, degrees counter-clockwise from above: what a scene file calls `rotate`.
    pub rotate_degrees: f32,
    /// The bands of spherical harmonics (1 to 4) that the sky is seen by, in place of itself: without a solution once
    /// [`Relighter::prepare_sky`](super::Relighter::prepare_sky) has been asked for as many. None for the sky as it is.
    pub harmonics: Option<usize>,
}

/// A latitude–longitude image.
#[derive(Debug, Clone)]
pub struct SkyImage {
    /// Its pixels, shared by all that see it.
    pub texture: Arc<Texture>,
    /// What reading it changed.
    pub warnings: Vec<Warning>,
}

impl SkyImage {
    /// Reads one (EXR or Radiance HDR).
    ///
    /// # Errors
    /// [`Error::Input`] for what is no such image.
    pub fn read(path: &Path) -> Result<Self> {
        let mut warnings = Vec::new();
        let texture = Arc::new(sky::read_image(path, &mut warnings)?);
        Ok(Self { texture, warnings })
    }
}

impl PartialEq for SkyImage {
    fn eq(&self, other: &Self) -> bool {
        let (a, b) = (&*self.texture, &*other.texture);
        Arc::ptr_eq(&self.texture, &other.texture) || (a.width == b.width && a.pixels == b.pixels)
    }
}

impl Lighting {
    /// Those of a scene.
    pub fn of(scene: &Scene) -> Self {
        let mesh = |mesh: &crate::scene::Mesh| MeshLight { radiance: mesh.radiance, paint: Paint::Baked };
        Self {
            meshes: scene.meshes.iter().map(mesh).collect(),
            lamps: scene.lamps.iter().map(|lamp| lamp.kind).collect(),
            sky: scene.sky.as_ref().map(|sky| SkyLight::of(sky, scene.up)),
        }
    }

    /// Changes one value, given as `NAME.KEY=VALUE`: for meshes `radiance`, `albedo`; for suns `irradiance` and
    /// `direction`, for points and spots `intensity` and `position`, for spots `direction`; for the sky, whose name is `sky`,
    /// `radiance`, `file` (a latitude–longitude image), `rotate` and `harmonics` (bands that it is seen by; 0 for as it is). `scale` multiplies what a mesh or the sky emits or a lamp gives by a number; 0 is off. Colours
    /// are three numbers, or one for grey. `scene` is the one that was baked.
    ///
    /// # Errors
    /// [`Error::Usage`] that names the nearest valid name or key.
    pub fn set(&mut self, scene: &Scene, text: &str) -> Result<()> {
        let refuse = |problem: String| Error::Usage(format!("--set {text}: {problem}"));
        let parted = text.split_once('=').and_then(|(place, value)| Some((place.rsplit_once('.')?, value)));
        let Some(((name, key), value)) = parted else {
            return Err(refuse("expected NAME.KEY=VALUE, as lamp.radiance=17,12,4".into()));
        };
        let (name, key) = (name.trim(), key.trim());
        if (name, key) == ("sky", "file") {
            let image = SkyImage::read(Path::new(value.trim()))?;
            let harmonics = self.sky.as_ref().and_then(|sky| sky.harmonics);
            self.sky = Some(SkyLight { constant: None, image: Some(image), harmonics, ..SkyLight::DARK });
            return Ok(());
        }
        let numbers = numbers(value).map_err(refuse)?;
        if let Some(k) = scene.meshes.iter().position(|mesh| mesh.name == name) {
            return self.meshes[k].set(key, &numbers).map_err(refuse);
        }
        if let Some(k) = scene.lamps.iter().position(|lamp| lamp.name == name) {
            return set_lamp(&mut self.lamps[k], scene, (key, &numbers)).map_err(refuse);
        }
        if name == "sky" {
            return self.set_sky(key, &numbers).map_err(refuse);
        }
        let names = || {
            let meshes = scene.meshes.iter().map(|mesh| mesh.name.as_str());
            meshes.chain(scene.lamps.iter().map(|lamp| lamp.name.as_str())).chain(["sky"])
        };
        let remedy = match nearest_word(name, names()) {
            Some(near) => format!("the nearest valid name is `{near}`"),
            None => format!("valid names are {}", names().collect::<Vec<_>>().join(", ")),
        };
        Err(refuse(format!("unknown name `{name}`; {remedy}")))
    }

    fn set_sky(&mut self, key: &str, numbers: &[f64]) -> Result<(), String> {
        let sky = self.sky.get_or_insert(SkyLight::DARK);
        match key {
            "radiance" => {
                let harmonics = sky.harmonics;
                *sky = SkyLight { constant: Some(light(numbers)?), harmonics, ..SkyLight::DARK };
            }
            "rotate" if sky.constant.is_some() => return Err("a constant sky cannot be rotated".into()),
            "rotate" => sky.rotate_degrees = number(numbers)? as f32,
            "scale" => sky.tint *= scale(numbers)?,
            "harmonics" => sky.harmonics = bands(numbers)?,
            _ => return Err(unknown_key(key, &["radiance", "file", "rotate", "scale", "harmonics"])),
        }
        Ok(())
    }

    /// Checks that the entries are those of `scene` and that light transport has a meaning for them.
    ///
    /// # Errors
    /// [`Error::Usage`] with the entry's name.
    pub fn check(&self, scene: &Scene) -> Result<()> {
        let counts = (self.meshes.len(), self.lamps.len());
        if counts != (scene.meshes.len(), scene.lamps.len()) {
            let problem = format!("{counts:?} meshes and lamps for a scene of other ones");
            return Err(Error::Usage(format!("lighting: {problem}: begin with that of the Relighter")));
        }
        let refuse = |name: &str, problem: String| Error::Usage(format!("{name}: {problem}"));
        for (light, mesh) in self.meshes.iter().zip(&scene.meshes) {
            check_radiance(light.radiance).map_err(|problem| refuse(&mesh.name, problem))?;
            light.paint.check(mesh).map_err(|problem| refuse(&mesh.name, problem))?;
        }
        for (now, lamp) in self.lamps.iter().zip(&scene.lamps) {
            check_radiance(strength(now)).map_err(|problem| refuse(&lamp.name, problem))?;
            if std::mem::discriminant(now) != std::mem::discriminant(&lamp.kind) {
                return Err(refuse(&lamp.name, "a lamp of another kind: its kind stays".into()));
            }
        }
        let Some(sky) = &self.sky else { return Ok(()) };
        check_radiance(sky.tint * sky.constant.unwrap_or(Rgb::ONE))
            .map_err(|problem| refuse("sky", problem))?;
        if sky.harmonics.is_some_and(|order| !(1..=MOST_ORDER).contains(&order)) {
            return Err(refuse("sky", format!("it can be seen by 1 to {MOST_ORDER} bands of harmonics")));
        }
        if sky.constant.is_none() && sky.image.is_none() && !matches!(scene.sky, Some(Sky::Image { .. })) {
            return Err(refuse("sky", "no image was baked: give a radiance or a file".into()));
        }
        Ok(())
    }
}

impl MeshLight {
    fn set(&mut self, key: &str, numbers: &[f64]) -> Result<(), String> {
        match key {
            "radiance" => self.radiance = light(numbers)?,
            "scale" => self.radiance *= scale(numbers)?,
            "albedo" => {
                let albedo = colour(numbers)?;
                check_albedo(albedo)?;
                self.paint = Paint::Plain(albedo);
            }
            _ => return Err(unknown_key(key, &["radiance", "albedo", "scale"])),
        }
        Ok(())
    }
}

impl Paint {
    /// The albedo in place of a baked one.
    pub fn over(&self, baked: Rgb) -> Rgb {
        match self {
            Self::Baked => baked,
            Self::Scaled(factor) => (baked * *factor).min(Rgb::splat(LIMIT)),
            Self::Plain(albedo) => *albedo,
        }
    }

    /// The albedo of a mesh in place of the one baked.
    pub fn albedo(&self, baked: &Albedo) -> Albedo {
        match (self, baked) {
            (Self::Baked, _) => baked.clone(),
            (Self::Plain(albedo), _) => Albedo::Constant(*albedo),
            (_, Albedo::Constant(albedo)) => Albedo::Constant(self.over(*albedo)),
            (_, Albedo::Vertex(values)) => Albedo::Vertex(values.iter().map(|v| self.over(*v)).collect()),
            (Self::Scaled(by), Albedo::Texture { texture, uv, factor }) => {
                Albedo::Texture { texture: texture.clone(), uv: uv.clone(), factor: *factor * *by }
            }
        }
    }

    fn check(&self, mesh: &crate::scene::Mesh) -> Result<(), String> {
        match self {
            Self::Baked => Ok(()),
            Self::Plain(albedo) => check_albedo(*albedo),
            Self::Scaled(by) if !by.is_finite() || by.min_element() < 0.0 => {
                Err(format!("albedos cannot be scaled by {:?}", by.to_array()))
            }
            Self::Scaled(by) => match &mesh.albedo {
                Albedo::Texture { factor, .. } if (*factor * *by).max_element() > 1.0 => {
                    Err("a scaled texture would reflect more light than there is".into())
                }
                _ => Ok(()),
            },
        }
    }
}

impl SkyLight {
    /// No light from outside.
    pub const DARK: Self =
        Self { constant: Some(Rgb::ZERO), image: None, tint: Rgb::ONE, rotate_degrees: 0.0, harmonics: None };

    fn of(sky: &Sky, up: Vec3) -> Self {
        let (constant, rotate_degrees) = match sky {
            Sky::Constant(radiance) => (Some(*radiance), 0.0),
            Sky::Image { to_image, .. } => (None, sky::rotation(to_image, up)),
        };
        Self { constant, rotate_degrees, ..Self::DARK }
    }

    /// Whether any light comes from it.
    pub fn is_lit(&self) -> bool {
        (self.constant.unwrap_or(Rgb::ONE) * self.tint).max_element() > 0.0
    }

    /// The sky that this is, given the one that was baked; its tint left out.
    pub(in crate::bake) fn untinted(&self, baked: &Sky, up: Vec3) -> Sky {
        if let (None, Some(own)) = (self.constant, &self.image) {
            let to_image = sky::to_image(up, self.rotate_degrees);
            return Sky::Image { image: Arc::clone(&own.texture), to_image };
        }
        match (self.constant, baked) {
            (Some(radiance), _) => Sky::Constant(radiance),
            (None, Sky::Constant(_)) => baked.clone(),
            (None, Sky::Image { image, to_image }) => {
                let was = sky::rotation(to_image, up);
                // As it is where it has not been turned: links to its bright part stay what they were.
                let turned = if was == self.rotate_degrees {
                    *to_image
                } else {
                    sky::to_image(up, self.rotate_degrees)
                };
                Sky::Image { image: image.clone(), to_image: turned }
            }
        }
    }
}

/// Irradiance or intensity of a lamp.
pub(super) fn strength(kind: &LampKind) -> Rgb {
    match kind {
        LampKind::Sun { irradiance, .. } => *irradiance,
        LampKind::Point { intensity, .. } | LampKind::Spot { intensity, .. } => *intensity,
    }
}

/// The same lamp with another strength.
pub(in crate::bake) fn with_strength(kind: &LampKind, strength: Rgb) -> LampKind {
    let mut kind = *kind;
    match &mut kind {
        LampKind::Sun { irradiance: own, .. }
        | LampKind::Point { intensity: own, .. }
        | LampKind::Spot { intensity: own, .. } => *own = strength,
    }
    kind
}

fn set_lamp(kind: &mut LampKind, scene: &Scene, (key, numbers): (&str, &[f64])) -> Result<(), String> {
    if key == "scale" {
        *kind = with_strength(kind, strength(kind) * scale(numbers)?);
        return Ok(());
    }
    // W·sr⁻¹ over squared metres is what stays.
    let local = |intensity: Rgb| (intensity.as_dvec3() / scene.placement.scale.powi(2)).as_vec3();
    match (kind, key) {
        (LampKind::Sun { irradiance, .. }, "irradiance") => *irradiance = light(numbers)?,
        (LampKind::Point { intensity, .. } | LampKind::Spot { intensity, .. }, "intensity") => {
            *intensity = local(light(numbers)?);
        }
        (LampKind::Point { position, .. } | LampKind::Spot { position, .. }, "position") => {
            *position = scene.placement.to_local(vector(numbers)?);
        }
        (LampKind::Sun { direction, .. } | LampKind::Spot { direction, .. }, "direction") => {
            let given = vector(numbers)?.try_normalize();
            *direction = given.ok_or("a direction of no length")?.as_vec3();
        }
        (LampKind::Sun { .. }, _) => return Err(unknown_key(key, &["irradiance", "direction", "scale"])),
        (LampKind::Point { .. }, _) => return Err(unknown_key(key, &["intensity", "position", "scale"])),
        (LampKind::Spot { .. }, _) => {
            return Err(unknown_key(key, &["intensity", "position", "direction", "scale"]));
        }
    }
    Ok(())
}

fn unknown_key(key: &str, known: &[&str]) -> String {
    match nearest_word(key, known.iter().copied()) {
        Some(near) => format!("unknown key `{key}`; the nearest valid key is `{near}`"),
        None => format!("unknown key `{key}`; valid keys are {}", known.join(", ")),
    }
}

fn numbers(text: &str) -> Result<Vec<f64>, String> {
    let number = |word: &str| match word.trim().parse::<f64>() {
        Ok(number) if number.is_finite() => Ok(number),
        _ => Err(format!("{:?} is no finite number", word.trim())),
    };
    text.split(',').map(number).collect()
}

fn colour(numbers: &[f64]) -> Result<Rgb, String> {
    match numbers {
        [grey] => Ok(Rgb::splat(*grey as f32)),
        [r, g, b] => Ok(DVec3::new(*r, *g, *b).as_vec3()),
        other => Err(format!("three numbers are expected, or one for grey, found {}", other.len())),
    }
}

fn light(numbers: &[f64]) -> Result<Rgb, String> {
    let light = colour(numbers)?;
    check_radiance(light)?;
    Ok(light)
}

fn scale(numbers: &[f64]) -> Result<Rgb, String> {
    light(numbers)
}

/// Bands of harmonics; none for nought.
fn bands(numbers: &[f64]) -> Result<Option<usize>, String> {
    let number = number(numbers)?;
    match (0..=MOST_ORDER).find(|&order| order as f64 == number) {
        Some(order) => Ok(Some(order).filter(|&order| order > 0)),
        None => Err(format!("expected a whole number from 0 to {MOST_ORDER}, got {number}")),
    }
}

fn vector(numbers: &[f64]) -> Result<DVec3, String> {
    match numbers {
        [x, y, z] => Ok(DVec3::new(*x, *y, *z)),
        other => Err(format!("three numbers are expected, found {}", other.len())),
    }
}

fn number(numbers: &[f64]) -> Result<f64, String> {
    match numbers {
        [one] => Ok(*one),
        other => Err(format!("one number is expected, found {}", other.len())),
    }
}
