//! The page's file: a template, a header in JSON and blocks of numbers in base64.

use std::io::{self, Write};
use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use glam::Vec3;
use half::f16;
use serde_json::{Value, json};

use super::Picture;
use super::encode::{Layer, shared_exponent};
use crate::error::{Error, Result};
use crate::light::Rgb;
use crate::output::file::write_whole;
use crate::scene::Sky;

const PAGE: &str = include_str!("page.html");
const SCRIPTS: [&str; 3] = [include_str!("shaders.js"), include_str!("page.js"), include_str!("controls.js")];

/// What a page that is served has besides.
const LIVE_SCRIPT: &str = include_str!("live.js");

/// Where the template takes the data and the scripts.
const DATA_MARK: &str = "<!-- data -->\n";
const SCRIPT_MARK: &str = "/* script */\n";

/// What the page may connect to: nothing, or who served it.
const CONNECT: [&str; 2] = ["connect-src 'none'", "connect-src 'self'"];

/// Bytes that are encoded at a time: a multiple of three, so that the texts join.
const PIECE: usize = 3 << 16;

/// WebGL 2 promises 256 layers; the albedo takes one.
const MOST_LAYERS: usize = 255;

/// Pixels of an image sky behind the scene, across and down: half a degree.
const SKY_SIZE: [u32; 2] = [720, 360];

/// Writes the page to `path`.
///
/// Blocks are little-endian: `vertices` (position f32×3, ambient and relative error f16, emitter u32), `fields` (RGB9_E5,
/// layer by layer: the albedo, then each light's irradiance over its maximum, then that of the sky turned by the k-th part of
/// a full turn, k = 1, 2, …), `indices` (u32,
/// one-sided triangles first), `sky` (RGB9_E5 over its maximum, row 0 up), `dots` (position, level, spacing f32).
/// Directions and positions are local.
///
/// # Errors
/// [`Error::Usage`] for more than 255 lights, input/output errors.
pub fn write(path: &Path, picture: &Picture<'_>) -> Result<()> {
    let page = Page::new(picture, None)?;
    write_whole(path, page.size() as u64, |sink| page.put(sink).map_err(|e| Error::io(path, "writing", e)))
}

/// The page for a program that stays and answers edits; `live` is what its controls begin with (see `live.js`).
///
/// # Errors
/// [`Error::Usage`] for more than 255 lights.
pub fn served(picture: &Picture<'_>, live: &Value) -> Result<Vec<u8>> {
    let page = Page::new(picture, Some(live))?;
    let mut bytes = Vec::with_capacity(page.size());
    page.put(&mut bytes).map_err(|e| Error::io("the page", "keeping it in memory", e))?;
    Ok(bytes)
}

/// A page before it is written.
struct Page {
    header: String,
    blocks: [(&'static str, Vec<u8>); 5],
    live: bool,
}

impl Page {
    fn new(picture: &Picture<'_>, live: Option<&Value>) -> Result<Self> {
        let count: usize = picture.lit.lights.iter().map(|light| 1 + light.turned.len()).sum();
        if count > MOST_LAYERS {
            return Err(Error::Usage(format!("{count} lights are more than a page holds ({MOST_LAYERS})")));
        }
        let layers: Vec<Layer> = layers(picture).collect();
        let (sky, sky_scale, sky_size) = sky(picture);
        let mut header = header(picture, &layers);
        let light = picture.lit.lights.iter().position(|light| light.is_sky);
        header["sky"] = json!({ "size": sky_size, "scale": sky_scale.to_array(), "light": light,
            "up": picture.scene.up.to_array(), "turned": turned(picture, light, &layers) });
        if let Some(live) = live {
            header["live"] = live.clone();
        }
        let blocks = [
            ("vertices", vertices(picture)),
            ("fields", layers.into_iter().flat_map(|layer| layer.words).collect()),
            ("indices", indices(picture)),
            ("sky", sky),
            ("dots", dots(picture)),
        ];
        // Names come from files: no letter of theirs may end the block.
        let header = header.to_string().replace('<', "\\u003c");
        Ok(Self { header, blocks, live: live.is_some() })
    }

    fn scripts(&self) -> impl Iterator<Item = &'static str> {
        SCRIPTS.into_iter().chain(self.live.then_some(LIVE_SCRIPT))
    }

    /// Bytes, or a few more.
    fn size(&self) -> usize {
        let blocks: usize = self.blocks.iter().map(|(_, block)| block.len().div_ceil(3) * 4 + 100).sum();
        PAGE.len() + self.scripts().map(str::len).sum::<usize>() + self.header.len() + 100 + blocks
    }

    fn put(&self, sink: &mut impl Write) -> io::Result<()> {
        let page = if self.live { PAGE.replacen(CONNECT[0], CONNECT[1], 1) } else { PAGE.to_owned() };
        let (start, rest) = page.split_once(DATA_MARK).unwrap_or((&page, ""));
        let (middle, end) = rest.split_once(SCRIPT_MARK).unwrap_or((rest, ""));
        sink.write_all(start.as_bytes())?;
        writeln!(sink, "<script type=\"application/json\" id=\"header\">{}</script>", self.header)?;
        for (name, block) in &self.blocks {
            write!(sink, "<script type=\"text/plain\" id=\"{name}\">")?;
            block.chunks(PIECE).try_for_each(|piece| sink.write_all(BASE64.encode(piece).as_bytes()))?;
            sink.write_all(b"</script>\n")?;
        }
        sink.write_all(middle.as_bytes())?;
        self.scripts().try_for_each(|script| sink.write_all(script.as_bytes()))?;
        sink.write_all(end.as_bytes())
    }
}

/// The scales of the layers of the sky turned. No other light has any.
fn turned(picture: &Picture<'_>, sky: Option<usize>, layers: &[Layer]) -> Vec<f32> {
    let count = sky.map_or(0, |k| picture.lit.lights[k].turned.len());
    layers[layers.len() - count..].iter().map(|layer| layer.scale).collect()
}

/// The albedo, the lights' irradiance, and that of skies turned.
fn layers(picture: &Picture<'_>) -> impl Iterator<Item = Layer> {
    let lights = picture.lit.lights.iter().map(|light| &light.irradiance);
    let turned = picture.lit.lights.iter().flat_map(|light| &light.turned);
    let layers = lights.chain(turned).map(|light| Layer::scaled(light));
    [Layer::plain(&picture.mesh.albedo)].into_iter().chain(layers)
}

/// What is said in words and single numbers.
fn header(picture: &Picture<'_>, layers: &[Layer]) -> Value {
    let Picture { mesh, lit, view, .. } = picture;
    let camera = &view.camera;
    let named = lit.lights.iter().zip(&layers[1..]);
    let lights: Vec<Value> =
        named.map(|(light, layer)| json!({ "name": light.name, "scale": layer.scale })).collect();
    let emitters: Vec<Value> = emitters(picture)
        .into_iter()
        .map(|(mesh, light)| {
            json!({ "light": light, "radiance": picture.scene.meshes[mesh as usize].radiance.to_array() })
        })
        .collect();
    let (low, high) = mesh.points.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| {
        (low.min(p.position), high.max(p.position))
    });
    let (centre, radius) = if mesh.points.is_empty() {
        (Vec3::ZERO, 1.0)
    } else {
        (0.5 * (low + high), 0.5 * (high - low).length())
    };
    json!({
        "title": picture.title,
        "count": mesh.points.len(),
        "one_sided": 3 * mesh.one_sided.len(),
        "two_sided": 3 * mesh.two_sided.len(),
        "lights": lights,
        "emitters": emitters,
        "camera": { "eye": camera.eye.to_array(), "target": camera.target.to_array(),
            "up": camera.up.to_array(), "fov": camera.fov_degrees },
        "size": camera.size,
        "see_through": view.see_through,
        "exposure": picture.exposure,
        "error_top": error_top(picture),
        "levels": picture.dots.iter().map(|dot| dot.level).fold(0.0, f32::max) + 1.0,
        "centre": centre.to_array(),
        "radius": radius,
    })
}

/// Glowing meshes with the light that they belong to.
fn emitters(picture: &Picture<'_>) -> Vec<(u32, usize)> {
    let glows = |mesh: &u32| picture.scene.meshes[*mesh as usize].radiance != Rgb::ZERO;
    let lights = picture.lit.lights.iter().enumerate();
    lights
        .flat_map(|(k, light)| light.glowing.iter().copied().filter(glows).map(move |mesh| (mesh, k)))
        .collect()
}

/// Where the error's scale ends: above 98 of 100 vertices, rounded up to one digit.
fn error_top(picture: &Picture<'_>) -> f32 {
    let mut errors: Vec<f32> = (0..picture.lit.error.len()).map(|v| relative_error(picture, v)).collect();
    errors.sort_by(f32::total_cmp);
    let high = errors.get(errors.len() * 98 / 100).copied().unwrap_or(0.0).max(1e-4);
    let unit = 10f32.powf(high.log10().floor());
    (high / unit).ceil() * unit
}

/// Error over the mean irradiance.
fn relative_error(picture: &Picture<'_>, vertex: usize) -> f32 {
    let error = picture.lit.error[vertex] / picture.level;
    if error.is_finite() { error.max(0.0) } else { 0.0 }
}

fn vertices(picture: &Picture<'_>) -> Vec<u8> {
    let mut emitter = vec![0u32; picture.scene.meshes.len()];
    for (k, (mesh, _)) in emitters(picture).into_iter().enumerate() {
        emitter[mesh as usize] = k as u32 + 1;
    }
    let mut bytes = Vec::with_capacity(20 * picture.mesh.points.len());
    for (v, point) in picture.mesh.points.iter().enumerate() {
        point.position.to_array().into_iter().for_each(|x| bytes.extend(x.to_le_bytes()));
        for value in [picture.lit.ambient[v], relative_error(picture, v)] {
            bytes.extend(f16::from_f32(value.min(60_000.0)).to_le_bytes());
        }
        bytes.extend(emitter[picture.mesh.meshes[v] as usize].to_le_bytes());
    }
    bytes
}

fn indices(picture: &Picture<'_>) -> Vec<u8> {
    let triangles = picture.mesh.one_sided.iter().chain(&picture.mesh.two_sided);
    triangles.flatten().flat_map(|corner| corner.to_le_bytes()).collect()
}

/// The sky over directions, its scale and its size in pixels.
fn sky(picture: &Picture<'_>) -> (Vec<u8>, Rgb, [u32; 2]) {
    let [width, height] = match &picture.scene.sky {
        Some(Sky::Image { .. }) => SKY_SIZE,
        _ => [1, 1],
    };
    let direction = |k: u32| {
        let around = ((k % width) as f32 + 0.5) / width as f32 * std::f32::consts::TAU;
        let down = ((k / width) as f32 + 0.5) / height as f32 * std::f32::consts::PI;
        Vec3::new(down.sin() * around.cos(), down.cos(), down.sin() * around.sin())
    };
    let radiance = |k: u32| picture.scene.sky.as_ref().map_or(Rgb::ZERO, |sky| sky.radiance(direction(k)));
    let pixels: Vec<Rgb> = (0..width * height).map(radiance).collect();
    let most = pixels.iter().map(|p| p.max_element()).fold(0.0, f32::max);
    let scale = if most > 0.0 && most.is_finite() { most } else { 1.0 };
    let words = pixels.iter().flat_map(|&p| shared_exponent(p / scale).to_le_bytes());
    (words.collect(), Rgb::splat(scale), [width, height])
}

fn dots(picture: &Picture<'_>) -> Vec<u8> {
    let values = |dot: &super::Dot| {
        let [x, y, z] = dot.position;
        [x, y, z, dot.level, dot.spacing]
    };
    picture.dots.iter().flat_map(values).flat_map(f32::to_le_bytes).collect()
}
