//! A page that shows a scene in the light of its lamps and relights it while one looks: one file, nothing from elsewhere.

mod mesh;

use std::io::Write;
use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
use glam::Vec3;
use serde_json::json;

pub use mesh::{Back, DenseMesh, Vertex};

use super::exposure;
use super::file::write_whole;
use super::picture::View;
use crate::error::{Error, Result};
use crate::light::{Rgb, linear_to_srgb};
use crate::scene::{Scene, Sky};

const PAGE: &str = include_str!("page.html");
const SCRIPT: &str = include_str!("page.js");

/// Lights of a page at the most: the shader holds a colour for each.
pub const MOST_LIGHTS: usize = 64;

/// What one light does by itself.
#[derive(Debug, Clone)]
pub struct ViewLight {
    /// What the slider is called.
    pub name: String,
    /// Irradiance at the vertices of the mesh, W·m⁻².
    pub irradiance: Vec<Rgb>,
    /// The mesh of the scene that it is, and its exitance, W·m⁻².
    pub surface: Option<(usize, Rgb)>,
    /// Whether it is the sky.
    pub is_sky: bool,
}

/// What a page shows.
pub struct Page<'a> {
    /// Its title.
    pub title: &'a str,
    /// The scene.
    pub scene: &'a Scene,
    /// The mesh that stands for its surfaces.
    pub mesh: &'a DenseMesh,
    /// Lights, each by itself; together they are the scene's light.
    pub lights: &'a [ViewLight],
    /// Share of the sky that each vertex sees.
    pub ambient_occlusion: &'a [f32],
    /// Estimated error of the whole light at each vertex, W·m⁻².
    pub error: &'a [f32],
    /// Sites: local positions and radiosities.
    pub sites: (&'a [Vec3], &'a [Rgb]),
    /// The first view.
    pub view: &'a View,
    /// A remark on what is shown.
    pub note: &'a str,
}

impl Page<'_> {
    /// Radiosity of a vertex in the light of all, W·m⁻².
    pub fn radiosity(&self, vertex: usize) -> Rgb {
        let at = &self.mesh.vertices[vertex];
        let glow = |light: &ViewLight| match light.surface {
            Some((mesh, exitance)) if mesh == at.mesh as usize => exitance,
            _ => Rgb::ZERO,
        };
        self.lights.iter().map(|light| glow(light) + at.albedo * light.irradiance[vertex]).sum()
    }

    /// The factor that shows the light well.
    pub fn exposure(&self) -> f32 {
        let shown = |k| (exposure::luminance(self.radiosity(k)), 1.0);
        exposure::automatic((0..self.mesh.vertices.len()).map(shown))
    }

    /// Writes the page.
    ///
    /// # Errors
    /// [`Error::Usage`] for more than [`MOST_LIGHTS`] lights; input/output errors.
    pub fn write(&self, path: &Path) -> Result<()> {
        if self.lights.len() > MOST_LIGHTS {
            let problem = format!("{} lights, and a page has at most {MOST_LIGHTS}", self.lights.len());
            return Err(Error::Usage(format!("{}: {problem}", path.display())));
        }
        let exposure = self.exposure();
        let mut blocks = String::new();
        for (name, bytes) in self.blocks(exposure) {
            blocks += &format!(
                "<script type=\"application/octet-stream\" id=\"{name}\">{}</script>\n",
                BASE64.encode(bytes)
            );
        }
        // Within a script element only this could end it.
        let header = self.header(exposure).to_string().replace("</", "<\\/");
        let page = PAGE.replace("@HEADER@", &header).replace("@SCRIPT@", SCRIPT).replace("@BLOBS@", &blocks);
        write_whole(path, page.len() as u64, |sink| {
            sink.write_all(page.as_bytes()).map_err(|e| Error::io(path, "writing", e))
        })
    }

    fn header(&self, exposure: f32) -> serde_json::Value {
        let lights: Vec<_> = self
            .lights
            .iter()
            .map(|light| {
                let exitance = light.surface.map_or(Rgb::ZERO, |(_, exitance)| exitance);
                json!({ "name": light.name, "scale": largest(light), "exitance": exitance.to_array() })
            })
            .collect();
        let sky = self.lights.iter().position(|light| light.is_sky);
        let sky = match (&self.scene.sky, sky) {
            (Some(Sky::Constant(radiance)), Some(k)) => {
                json!({ "light": k, "radiance": radiance.to_array() })
            }
            _ => json!(null),
        };
        let camera = &self.view.camera;
        json!({
            "title": self.title, "note": self.note, "exposure": exposure, "lights": lights, "sky": sky,
            "vertices": self.mesh.vertices.len(), "triangles": self.mesh.triangles.len(), "sites": self.sites.0.len(),
            "up": self.scene.up.to_array(), "seeThrough": self.view.see_through,
            "camera": { "eye": camera.eye.to_array(), "target": camera.target.to_array(), "up": camera.up.to_array(),
                "fov": camera.fov_degrees },
        })
    }

    /// Arrays for the graphics processor, little-endian, by name.
    fn blocks(&self, exposure: f32) -> Vec<(String, Vec<u8>)> {
        let vertices = &self.mesh.vertices;
        let byte = |share: f32| (share.clamp(0.0, 1.0) * 255.0).round() as u8;
        let most = self.error.iter().copied().fold(f32::MIN_POSITIVE, f32::max);
        let paint = |v: &Vertex| {
            let [r, g, b] = v.albedo.to_array().map(linear_to_srgb);
            [r, g, b, v.back as u8]
        };
        let emitter = |v: &Vertex| {
            let own = |light: &ViewLight| light.surface.is_some_and(|(mesh, _)| mesh == v.mesh as usize);
            self.lights.iter().position(own).map_or(0, |k| k as u8 + 1)
        };
        let extras = self.ambient_occlusion.iter().zip(self.error);
        let shown = |b: &Rgb| exposure::srgb(*b, exposure);
        let mut blocks = vec![
            ("positions".to_owned(), floats(vertices.iter().map(|v| v.position))),
            ("paints".to_owned(), vertices.iter().flat_map(paint).collect()),
            ("extras".to_owned(), extras.flat_map(|(ao, error)| [byte(*ao), byte(error / most)]).collect()),
            ("emitters".to_owned(), vertices.iter().map(emitter).collect()),
            (
                "corners".to_owned(),
                self.mesh.triangles.iter().flatten().flat_map(|k| k.to_le_bytes()).collect(),
            ),
            ("sites".to_owned(), floats(self.sites.0.iter().copied())),
            ("site-paints".to_owned(), self.sites.1.iter().flat_map(shown).collect()),
        ];
        for (k, light) in self.lights.iter().enumerate() {
            let scale = largest(light);
            let texels = light.irradiance.iter().flat_map(|h| rgb9e5(*h / scale).to_le_bytes());
            blocks.push((format!("light{k}"), texels.collect()));
        }
        blocks
    }
}

/// The largest channel of a light's irradiance: texels are shares of it.
fn largest(light: &ViewLight) -> f32 {
    light.irradiance.iter().map(|h| h.max_element()).fold(f32::MIN_POSITIVE, f32::max)
}

fn floats(vectors: impl Iterator<Item = Vec3>) -> Vec<u8> {
    vectors.flat_map(|v| v.to_array()).flat_map(f32::to_le_bytes).collect()
}

/// Three channels with nine bits each and one exponent, as OpenGL's EXT_texture_shared_exponent has them; values below 65,408.
///
/// Error: half of 2⁻⁹ of the largest channel.
fn rgb9e5(colour: Rgb) -> u32 {
    let colour = colour.clamp(Rgb::ZERO, Rgb::splat(65_408.0));
    let most = colour.max_element();
    if !(most > 2.0f32.powi(-24)) {
        return 0;
    }
    let mut exponent = (most.log2().floor() as i32).max(-16) + 1;
    if (most / 2.0f32.powi(exponent - 9)).round() >= 512.0 {
        exponent += 1;
    }
    let [r, g, b] = (colour / 2.0f32.powi(exponent - 9)).to_array().map(|value| value.round() as u32);
    ((exponent + 15) as u32) << 27 | b << 18 | g << 9 | r
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decoded(texel: u32) -> Vec3 {
        let scale = 2.0f32.powi((texel >> 27) as i32 - 15 - 9);
        Vec3::new((texel & 511) as f32, (texel >> 9 & 511) as f32, (texel >> 18 & 511) as f32) * scale
    }

    #[test]
    fn shared_exponents_err_by_a_thousandth_of_the_largest_channel() {
        let values = [1.0, 0.999, 0.5, 0.123, 3.0e-4, 1.0e-6, 7.0, 65_000.0];
        for r in values {
            for g in values {
                let colour = Vec3::new(r, g, 0.3 * r);
                let most = colour.max_element();
                let off = (decoded(rgb9e5(colour)) - colour).abs().max_element();
                assert!(off <= most / 1022.0 + 2.0f32.powi(-25), "{colour}: {off}");
            }
        }
        assert_eq!(rgb9e5(Vec3::new(-1.0, 0.0, f32::MIN_POSITIVE)), 0);
    }
}
