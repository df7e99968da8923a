//! Material libraries (MTL) of OBJ files.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::statements;
use crate::light::Rgb;
use crate::scene::assemble::DEFAULT_ALBEDO;
use crate::scene::{Texture, Warning, materials};

/// What a diffuse solver takes from a material.
pub struct Material {
    /// The library it stands in.
    pub file: PathBuf,
    /// `Kd`, or the factor of the texture.
    pub albedo: Rgb,
    /// `Ke`, W·m⁻²·sr⁻¹.
    pub radiance: Rgb,
    /// `map_Kd`.
    pub texture: Option<Arc<Texture>>,
}

/// All materials of an OBJ file's libraries.
#[derive(Default)]
pub struct Library {
    materials: HashMap<String, Material>,
    /// Libraries that were asked for.
    seen: HashSet<PathBuf>,
    /// Whether any library could be read.
    pub loaded: bool,
}

impl Library {
    /// Reads the library `name` beside `obj`. What is missing or cannot be read becomes a warning: the geometry is
    /// worth having without it.
    pub fn load(&mut self, obj: &Path, name: &str, warnings: &mut Vec<Warning>) {
        let file = obj.parent().unwrap_or(Path::new("")).join(name.replace('\\', "/"));
        if !self.seen.insert(file.clone()) {
            return;
        }
        let mut warn = |message: String| warnings.push(Warning { file: obj.to_path_buf(), message });
        // A device or a pipe may never end.
        let bytes = if file.is_file() { std::fs::read(&file).ok() } else { None };
        let Some(bytes) = bytes else {
            return warn(format!("material library {name:?} is missing: albedo 0.7 is taken"));
        };
        let text = String::from_utf8_lossy(&bytes);
        let read = match statements::read(&text) {
            Ok(read) => read,
            Err(problem) => {
                return warn(format!(
                    "material library {name:?} cannot be read ({problem}): albedo 0.7 is taken"
                ));
            }
        };
        self.loaded = true;
        let mut beyond = Vec::new();
        let mut textures = HashMap::new();
        for material in read {
            if material.beyond_diffuse {
                beyond.push(material.name.clone());
            }
            let texture = material.texture.as_deref().and_then(|picture| {
                let path = picture_path(&file, picture);
                let read = textures.entry(path.clone()).or_insert_with(|| read_texture(&path, warnings));
                read.clone()
            });
            let black = material.albedo == Some(Rgb::ZERO);
            let albedo = match material.albedo {
                // Exporters write a black Kd beside a texture and mean the texture.
                _ if texture.is_some() && black => Rgb::ONE,
                Some(albedo) => albedo,
                None if texture.is_some() => Rgb::ONE,
                None => DEFAULT_ALBEDO,
            };
            let radiance = material.radiance.unwrap_or(Rgb::ZERO);
            self.materials.insert(material.name, Material { file: file.clone(), albedo, radiance, texture });
        }
        if !beyond.is_empty() {
            let message = format!("mirrors or glass are treated as diffuse: {}", beyond.join(", "));
            warnings.push(Warning { file, message });
        }
    }

    /// The material of this name.
    pub fn material(&self, name: &str) -> Option<&Material> {
        self.materials.get(name)
    }

    /// Whether the material of this name has a texture.
    pub fn has_texture(&self, name: &str) -> bool {
        self.material(name).is_some_and(|material| material.texture.is_some())
    }
}

/// The path in a `map_Kd` line: options such as `-s 1 1 1` come before it.
fn picture_path(library: &Path, written: &str) -> PathBuf {
    let name =
        if written.starts_with('-') { written.split_whitespace().last().unwrap_or(written) } else { written };
    library.parent().unwrap_or(Path::new("")).join(name.replace('\\', "/"))
}

fn read_texture(path: &Path, warnings: &mut Vec<Warning>) -> Option<Arc<Texture>> {
    match materials::read_texture(path, warnings) {
        Ok(texture) => Some(Arc::new(texture)),
        Err(error) => {
            warnings
                .push(Warning { file: path.to_path_buf(), message: format!("texture left out: {error}") });
            None
        }
    }
}
