//! Keyframes: lightings and views at numbered frames, and what lies between them.

use std::path::Path;

use glam::{DVec3, Vec3};
use serde::Deserialize;

use super::lighting::{Lighting, MeshLight, Paint, SkyLight, strength, with_strength};
use crate::error::{Error, Result, one_line};
use crate::light::Rgb;
use crate::scene::{Camera, LampKind, Scene, nearest_word};

/// Frames at the most: what four digits number.
const MOST_FRAMES: u32 = 1 << 20;

/// A file of keys, as it is written.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct KeyFile {
    #[serde(default)]
    key: Vec<KeyTable>,
}

/// One key: `frame`, `set` as on the command line, each from the lighting that was baked, and where the camera is.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct KeyTable {
    frame: u32,
    #[serde(default)]
    set: Vec<String>,
    eye: Option<[f64; 3]>,
    target: Option<[f64; 3]>,
    fov: Option<f32>,
}

/// Lightings and views over time.
#[derive(Debug, Clone)]
pub struct Keys {
    /// By frame, ascending.
    keys: Vec<Key>,
}

#[derive(Debug, Clone)]
struct Key {
    frame: u32,
    lighting: Lighting,
    eye: Option<Vec3>,
    target: Option<Vec3>,
    fov: Option<f32>,
}

impl Keys {
    /// Reads a file of keys for a scene as it was baked ([`super::Relighter::scene`]).
    ///
    /// # Errors
    /// [`Error::Input`] with the key and a remedy, [`Error::Io`].
    pub fn read(path: &Path, scene: &Scene) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|e| Error::io(path, "reading the keys", e))?;
        let file: KeyFile = toml::from_str(&text).map_err(|error| {
            let before = error.span().map_or("", |span| text.get(..span.start).unwrap_or_default());
            let line = 1 + before.bytes().filter(|b| *b == b'\n').count();
            let said = error.message();
            let mut quoted = said.split('`').skip(1).step_by(2);
            let unknown = quoted.next().filter(|_| said.starts_with("unknown field")).unwrap_or_default();
            let remedy = match nearest_word(unknown, quoted) {
                Some(near) if !unknown.is_empty() => format!("the nearest valid key is `{near}`"),
                _ => "keys are [[key]] tables of frame, set, eye, target and fov".to_owned(),
            };
            Error::input(path, format!("line {line}"), one_line(said, 200), remedy)
        })?;
        let mut keys: Vec<Key> = Vec::new();
        for (number, table) in file.key.iter().enumerate() {
            let refuse = |problem: String, remedy: &str| {
                Error::input(path, format!("key {}", number + 1), problem, remedy.to_owned())
            };
            if keys.last().is_some_and(|last| last.frame >= table.frame) || table.frame >= MOST_FRAMES {
                let problem = format!("frame {} does not come after those before", table.frame);
                return Err(refuse(problem, "number frames from 0 in ascending order"));
            }
            let mut lighting = Lighting::of(scene);
            for text in &table.set {
                lighting.set(scene, text).map_err(|error| refuse(error.to_string(), "correct the keys"))?;
            }
            let local = |at: Option<[f64; 3]>| at.map(|at| scene.placement.to_local(DVec3::from_array(at)));
            let (eye, target) = (local(table.eye), local(table.target));
            let fov = table.fov;
            if fov.is_some_and(|fov| !(fov > 0.0 && fov < 180.0)) {
                return Err(refuse("fov is not between 0 and 180".to_owned(), "give degrees"));
            }
            keys.push(Key { frame: table.frame, lighting, eye, target, fov });
        }
        if keys.is_empty() {
            return Err(Error::input(
                path,
                "file",
                "it has no keys",
                "add [[key]] tables with frame and set",
            ));
        }
        Ok(Self { keys })
    }

    /// How many frames there are: one more than the last key's number.
    pub fn frames(&self) -> u32 {
        self.keys.last().map_or(0, |key| key.frame + 1)
    }

    /// The same keys, their skies seen by `order` bands of harmonics ([`SkyLight::harmonics`]).
    #[must_use]
    pub fn with_harmonics(mut self, order: usize) -> Self {
        let skies = self.keys.iter_mut().filter_map(|key| key.lighting.sky.as_mut());
        skies.for_each(|sky| sky.harmonics = Some(order));
        self
    }

    /// The two keys around a frame and how far it lies between them.
    fn around(&self, frame: u32) -> (&Key, &Key, f32) {
        let after = self.keys.partition_point(|key| key.frame <= frame).min(self.keys.len() - 1);
        let (a, b) = (&self.keys[after.saturating_sub(1)], &self.keys[after]);
        let share = frame.saturating_sub(a.frame) as f32 / b.frame.saturating_sub(a.frame).max(1) as f32;
        (a, b, share.min(1.0))
    }

    /// The lighting of a frame: between keys all values change linearly, albedos that are given as colours too; others change
    /// at the later key.
    pub fn lighting(&self, frame: u32) -> Lighting {
        let (a, b, share) = self.around(frame);
        a.lighting.toward(&b.lighting, share)
    }

    /// The camera of a frame, given the one that holds where keys say nothing.
    pub fn camera(&self, frame: u32, base: &Camera) -> Camera {
        let (a, b, share) = self.around(frame);
        let between = |of: &dyn Fn(&Key) -> Vec3| between(of(a), of(b), share);
        let fov = |key: &Key| key.fov.unwrap_or(base.fov_degrees);
        Camera {
            eye: between(&|key| key.eye.unwrap_or(base.eye)),
            target: between(&|key| key.target.unwrap_or(base.target)),
            fov_degrees: fov(a) + (fov(b) - fov(a)) * share,
            ..base.clone()
        }
    }
}

impl Lighting {
    /// The lighting a share of the way toward another of the same scene.
    #[must_use]
    pub fn toward(&self, other: &Self, share: f32) -> Self {
        if share <= 0.0 {
            return self.clone();
        }
        if share >= 1.0 {
            return other.clone();
        }
        let mesh = |(a, b): (&MeshLight, &MeshLight)| MeshLight {
            radiance: between(a.radiance, b.radiance, share),
            paint: match (a.paint, b.paint) {
                (Paint::Plain(a), Paint::Plain(b)) => Paint::Plain(between(a, b, share)),
                (Paint::Scaled(a), Paint::Scaled(b)) => Paint::Scaled(between(a, b, share)),
                (a, _) => a,
            },
        };
        Self {
            meshes: self.meshes.iter().zip(&other.meshes).map(mesh).collect(),
            lamps: self.lamps.iter().zip(&other.lamps).map(|(a, b)| lamp_toward(a, b, share)).collect(),
            sky: match (&self.sky, &other.sky) {
                (Some(a), Some(b)) => Some(a.toward(b, share)),
                (None, Some(b)) => Some(SkyLight { tint: b.tint * share, ..b.clone() }),
                (Some(a), None) => Some(SkyLight { tint: a.tint * (1.0 - share), ..a.clone() }),
                (None, None) => None,
            },
        }
    }
}

impl SkyLight {
    fn toward(&self, other: &Self, share: f32) -> Self {
        let constant = match (self.constant, other.constant) {
            (Some(a), Some(b)) => Some(a.lerp(b, share)),
            (a, _) => a,
        };
        let turn = other.rotate_degrees - self.rotate_degrees;
        let rotate_degrees = self.rotate_degrees + turn * share;
        Self { constant, tint: self.tint.lerp(other.tint, share), rotate_degrees, ..self.clone() }
    }
}

/// A share of the way from `a` to `b`. What does not change stays to the last bit: neither lamps nor the camera have moved then.
fn between(a: Vec3, b: Vec3, share: f32) -> Vec3 {
    if a == b { a } else { a.lerp(b, share) }
}

fn lamp_toward(a: &LampKind, b: &LampKind, share: f32) -> LampKind {
    let light: Rgb = between(strength(a), strength(b), share);
    let turned = |a: Vec3, b: Vec3| a.lerp(b, share).try_normalize().unwrap_or(a);
    let mut lamp = with_strength(a, light);
    match (&mut lamp, b) {
        (LampKind::Sun { direction, .. }, LampKind::Sun { direction: to, .. }) if direction != to => {
            *direction = turned(*direction, *to);
        }
        (LampKind::Point { position, .. }, LampKind::Point { position: to, .. }) => {
            *position = between(*position, *to, share);
        }
        (
            LampKind::Spot { position, direction, .. },
            LampKind::Spot { position: to, direction: toward, .. },
        ) => {
            *position = between(*position, *to, share);
            if direction != toward {
                *direction = turned(*direction, *toward);
            }
        }
        _ => {}
    }
    lamp
}
