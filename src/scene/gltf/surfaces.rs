//! Materials of glTF as diffuse surfaces.

use std::borrow::Cow;
use std::collections::{BTreeSet, HashMap};
use std::path::Path;
use std::sync::Arc;

use glam::{Mat2, Vec2};
use gltf::material::AlphaMode;
use gltf::{Document, Image, Material};

use super::{bounds, refuse};
use crate::error::Result;
use crate::light::Rgb;
use crate::scene::assemble::{Part, Surface};
use crate::scene::{Texture, Warning, materials};

/// Materials as they are met, with each texture decoded once.
pub struct Surfaces<'a> {
    path: &'a Path,
    document: &'a Document,
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
    pub fn new(path: &'a Path, document: &'a Document, buffers: &'a [gltf::buffer::Data]) -> Self {
        let (beyond, white) = (BTreeSet::new(), BTreeSet::new());
        Self { path, document, buffers, textures: HashMap::new(), beyond, white, warnings: Vec::new() }
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
        let bytes = self.picture(image.index()).map_err(|problem| refuse(self.path, &*place, problem))?;
        let picture = materials::decoded(&bytes).map_err(|problem| refuse(self.path, &*place, problem))?;
        let mut warnings = Vec::new();
        let texture = Arc::new(materials::texture_of(self.path, &picture, &mut warnings));
        self.warnings.extend(
            warnings.into_iter().map(|w| Warning { message: format!("{place}: {}", w.message), ..w }),
        );
        self.textures.insert(image.index(), texture.clone());
        Ok(texture)
    }

    /// The encoded bytes of an image. Its JSON is asked, because the crate's own access takes its keys for granted.
    fn picture(&self, number: usize) -> Result<Cow<'a, [u8]>, String> {
        let image = &self.document.as_json().images[number];
        if let Some(view) = &image.buffer_view {
            let view = self.document.views().nth(view.value()).ok_or("it is in no buffer view")?;
            let bytes = self.buffers.get(view.buffer().index()).map_or(&[][..], |data| &data.0[..]);
            let inside =
                view.offset().checked_add(view.length()).and_then(|end| bytes.get(view.offset()..end));
            return inside.map(Cow::Borrowed).ok_or_else(|| "it reaches beyond its buffer".to_string());
        }
        let uri = image.uri.as_deref().ok_or("it names neither a file nor a buffer view")?;
        bounds::check_uri(self.path, uri)?;
        let base = self.path.parent().unwrap_or(Path::new(""));
        let data = gltf::buffer::Data::from_source(gltf::buffer::Source::Uri(uri), Some(base));
        data.map(|data| Cow::Owned(data.0)).map_err(|error| bounds::unread(&error))
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
