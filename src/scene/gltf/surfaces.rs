//! Materials of glTF as diffuse surfaces.

use std::collections::{BTreeSet, HashMap};
use std::path::Path;
use std::sync::Arc;

use glam::{Mat2, Vec2};
use gltf::image::{Data, Format};
use gltf::material::AlphaMode;
use gltf::{Image, Material};

use super::{bounds, refuse};
use crate::error::Result;
use crate::light::{Rgb, srgb_to_linear};
use crate::scene::assemble::{Part, Surface};
use crate::scene::{Texture, Warning, materials};

/// Materials as they are met, with each texture decoded once.
pub struct Surfaces<'a> {
    path: &'a Path,
    buffers: &'a [gltf::buffer::Data],
    textures: HashMap<usize, Arc<Texture>>,
    /// Materials that are more than diffuse, by what they are.
    beyond: BTreeSet<String>,
    /// Materials whose white was darkened.
    white: BTreeSet<String>,
    /// What the textures brought.
    pub warnings: Vec<Warning>,
}

impl<'a> Surfaces<'a> {
    /// For one file.
    pub fn new(path: &'a Path, buffers: &'a [gltf::buffer::Data]) -> Self {
        let (beyond, white) = (BTreeSet::new(), BTreeSet::new());
        Self { path, buffers, textures: HashMap::new(), beyond, white, warnings: Vec::new() }
    }

    /// Gives a part its albedo, radiance and sides.
    ///
    /// # Errors
    /// [`crate::Error::Input`] for values outside their range and textures that cannot be decoded.
    pub fn apply(&mut self, material: &Material<'_>, part: &mut Part, coloured: bool) -> Result<()> {
        let Some(index) = material.index() else { return Ok(()) };
        let name = material.name().map_or_else(|| format!("material {index}"), str::to_string);
        self.note_beyond(material, &name);
        let surface = material.pbr_metallic_roughness();
        let [r, g, b, _] = surface.base_color_factor();
        let place = |key: &str| format!("material {index} ({name}), {key}");
        let (factor, white) = materials::tame_albedo(Rgb::new(r, g, b))
            .map_err(|problem| refuse(self.path, place("baseColorFactor"), problem))?;
        part.surface = match surface.base_color_texture() {
            Some(info) => Surface::Image(self.texture(&info.texture().source())?, Rgb::new(r, g, b)),
            None if coloured => Surface::Colours(Rgb::new(r, g, b)),
            None => {
                if white {
                    self.white.insert(name.clone());
                }
                Surface::Constant(factor)
            }
        };
        let mut radiance =
            Rgb::from_array(material.emissive_factor()) * material.emissive_strength().unwrap_or(1.0);
        if let Some(info) = material.emissive_texture().filter(|_| radiance != Rgb::ZERO) {
            let texture = self.texture(&info.texture().source())?;
            radiance *= texture.pixels.iter().sum::<Rgb>() / texture.pixels.len().max(1) as f32;
            self.beyond.insert(format!("{name} (emission texture: its mean is taken)"));
        }
        materials::check_radiance(radiance)
            .map_err(|problem| refuse(self.path, place("emission"), problem))?;
        part.radiance = radiance;
        part.one_sided = !material.double_sided();
        Ok(())
    }

    fn note_beyond(&mut self, material: &Material<'_>, name: &str) {
        let surface = material.pbr_metallic_roughness();
        // With a texture, the factor says nothing: most textured materials are metal in places only.
        if surface.metallic_factor() > 0.0 && surface.metallic_roughness_texture().is_none() {
            self.beyond.insert(format!("{name} (metal)"));
        }
        if material.transmission().is_some_and(|t| t.transmission_factor() > 0.0) {
            self.beyond.insert(format!("{name} (transmission)"));
        }
        if material.alpha_mode() != AlphaMode::Opaque {
            self.beyond.insert(format!("{name} (transparency)"));
        }
    }

    /// What was simplified, as messages.
    pub fn messages(&self) -> Vec<String> {
        let listed = |names: &BTreeSet<String>| names.iter().cloned().collect::<Vec<_>>().join(", ");
        let mut messages = Vec::new();
        if !self.beyond.is_empty() {
            messages.push(format!("{} treated as diffuse: {}", self.beyond.len(), listed(&self.beyond)));
        }
        if !self.white.is_empty() {
            let limit = materials::LIMIT;
            messages.push(format!(
                "{} white materials darkened to {limit}: {}",
                self.white.len(),
                listed(&self.white)
            ));
        }
        messages
    }

    fn texture(&mut self, image: &Image<'_>) -> Result<Arc<Texture>> {
        if let Some(known) = self.textures.get(&image.index()) {
            return Ok(known.clone());
        }
        let place = format!("image {}", image.index());
        let source = image.source();
        match &source {
            gltf::image::Source::Uri { uri, .. } => bounds::check_uri(self.path, uri),
            gltf::image::Source::View { view, .. } => {
                let length = self.buffers.get(view.buffer().index()).map_or(0, |data| data.0.len());
                let end = view.offset().checked_add(view.length());
                let inside = end.is_some_and(|end| end <= length);
                if inside { Ok(()) } else { Err("it reaches beyond its buffer".to_string()) }
            }
        }
        .map_err(|problem| refuse(self.path, place.clone(), problem))?;
        let base = self.path.parent().unwrap_or(Path::new(""));
        let decoded = Data::from_source(source, Some(base), self.buffers)
            .map_err(|error| refuse(self.path, place.clone(), error.to_string()))?;
        let mut pixels = linear_pixels(&decoded).ok_or_else(|| {
            refuse(self.path, place.clone(), format!("{:?} pixels are not read", decoded.format))
        })?;
        let clamped = materials::clamp_reflectance(&mut pixels);
        if clamped > 0 {
            let message = format!(
                "{place}: {clamped} white pixels of {} darkened to {}",
                pixels.len(),
                materials::LIMIT
            );
            self.warnings.push(Warning { file: self.path.to_path_buf(), message });
        }
        let texture = Arc::new(Texture { width: decoded.width, height: decoded.height, pixels });
        self.textures.insert(image.index(), texture.clone());
        Ok(texture)
    }
}

/// Applies `KHR_texture_transform` to a part's coordinates.
pub fn transform_uv(material: &Material<'_>, part: &mut Part) {
    let info = material.pbr_metallic_roughness().base_color_texture();
    let Some(transform) = info.and_then(|info| info.texture_transform()) else { return };
    // The extension turns clockwise in a frame with v downwards.
    let turn =
        Mat2::from_angle(-transform.rotation()) * Mat2::from_diagonal(Vec2::from_array(transform.scale()));
    let offset = Vec2::from_array(transform.offset());
    for at in part.uv.iter_mut().flatten() {
        *at = offset + turn * *at;
    }
}

/// sRGB pixels of 8 or 16 bits as linear light; nothing for other formats.
fn linear_pixels(data: &Data) -> Option<Vec<Rgb>> {
    // Channels and bytes of each; of 16-bit values (in the machine's order) the upper byte is enough for an albedo.
    let (channels, width) = match data.format {
        Format::R8 => (1, 1),
        Format::R8G8 => (2, 1),
        Format::R8G8B8 => (3, 1),
        Format::R8G8B8A8 => (4, 1),
        Format::R16 => (1, 2),
        Format::R16G16 => (2, 2),
        Format::R16G16B16 => (3, 2),
        Format::R16G16B16A16 => (4, 2),
        _ => return None,
    };
    let linear: Vec<f32> = (0..=255).map(srgb_to_linear).collect();
    let upper = |k: usize, pixel: &[u8]| {
        if width == 1 {
            pixel[k]
        } else {
            u16::from_ne_bytes([pixel[2 * k], pixel[2 * k + 1]]).to_be_bytes()[0]
        }
    };
    let decode = |pixel: &[u8]| {
        let channel = |k: usize| linear[usize::from(upper(k, pixel))];
        if channels < 3 { Rgb::splat(channel(0)) } else { Rgb::new(channel(0), channel(1), channel(2)) }
    };
    Some(data.pixels.chunks_exact(channels * width).map(decode).collect())
}
