//! OpenEXR: linear Rec.709 with everything a compositor asks for, as dotted channels of one layer.

use std::path::Path;

use exr::meta::attribute::Chromaticities;
use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, Layer, LayerAttributes,
    LineOrder, Vec2, WritableImage,
};
use glam::Vec3;
use half::f16;

use super::film::{Film, Pixel};
use crate::error::{Error, Result};
use crate::output::file;

/// ITU-R BT.709 primaries and the D65 white.
const REC709: Chromaticities = Chromaticities {
    red: Vec2(0.64, 0.33),
    green: Vec2(0.30, 0.60),
    blue: Vec2(0.15, 0.06),
    white: Vec2(0.3127, 0.3290),
};

/// Bytes of a pixel before compression: 12 half channels and five floats; three half channels for each light.
const PIXEL_BYTES: u64 = 12 * 2 + 5 * 4;
const LIGHT_BYTES: u64 = 3 * 2;

/// What one light alone brings to the camera: a layer `light.<name>`.
#[derive(Debug, Clone, PartialEq)]
pub struct LightLayer {
    /// What the scene calls the light.
    pub name: String,
    /// Radiance of each pixel, W·m⁻²·sr⁻¹.
    pub radiance: Vec<Vec3>,
}

/// Characters of a light's name: what old readers allow for a channel, 31, was too few for layers at all.
const LONGEST_NAME: usize = 200;

/// A channel's name, or its layer's, and what it holds.
type Channel<T> = (&'static str, fn(&Pixel) -> T);

/// Writes `R,G,B` (all that the camera sees), `direct.*` and `indirect.*` (which add up to it), `albedo.*` as half;
/// `normal.X/Y/Z` (scene axes), `Z` (world units along the viewing axis, 1e10 for none) and `error` (standard error of
/// the mean-channel radiance) as float; `light.<name>.*`, what each of `lights` brings, as half: they add up to `R,G,B`. Radiances in
/// W·m⁻²·sr⁻¹, not exposed. Names of lights keep letters, digits, `-` and `_`; what else they hold becomes `_`, and equal names are
/// numbered. ZIP compression, 16 lines a block.
///
/// # Panics
/// When a light has not a value for each pixel.
pub fn write(path: &Path, film: &Film, lights: &[LightLayer]) -> Result<()> {
    let mut channels = smallvec::SmallVec::new();
    for (name, light) in sound_names(lights).iter().zip(lights) {
        assert_eq!(light.radiance.len(), film.pixels.len(), "a value for each pixel of {name}");
        for (k, channel) in ["R", "G", "B"].into_iter().enumerate() {
            let samples = light.radiance.iter().map(|radiance| to_half(radiance[k])).collect();
            let channel = format!("light.{name}.{channel}");
            channels.push(AnyChannel::new(channel.as_str(), FlatSamples::F16(samples)));
        }
    }
    let colours: [Channel<Vec3>; 4] = [
        ("", Pixel::radiance),
        ("direct.", |p| p.direct),
        ("indirect.", |p| p.indirect),
        ("albedo.", |p| p.albedo),
    ];
    for (layer, pick) in colours {
        for (k, name) in ["R", "G", "B"].into_iter().enumerate() {
            let samples = film.pixels.iter().map(|p| to_half(pick(p)[k])).collect();
            channels.push(AnyChannel::new(format!("{layer}{name}").as_str(), FlatSamples::F16(samples)));
        }
    }
    let floats: [Channel<f32>; 5] = [
        ("normal.X", |p| p.normal.x),
        ("normal.Y", |p| p.normal.y),
        ("normal.Z", |p| p.normal.z),
        ("Z", |p| p.depth),
        ("error", |p| p.error),
    ];
    for (name, pick) in floats {
        channels.push(AnyChannel::new(name, FlatSamples::F32(film.pixels.iter().map(pick).collect())));
    }
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let size = Vec2(film.width as usize, film.height as usize);
    let mut image = Image::from_layer(Layer::new(
        size,
        LayerAttributes { software_name: Some("glowtree".into()), ..LayerAttributes::default() },
        encoding,
        AnyChannels::sort(channels),
    ));
    image.attributes.chromaticities = Some(REC709);
    let pixel_bytes = PIXEL_BYTES + LIGHT_BYTES * lights.len() as u64;
    file::write_whole(path, film.pixels.len() as u64 * pixel_bytes, |sink| {
        image.write().to_buffered(sink).map_err(|e| match e {
            exr::error::Error::Io(source) => Error::io(path, "writing", source),
            other => Error::io(path, "encoding", std::io::Error::other(other.to_string())),
        })
    })
}

/// Names that stand in channels' names, where dots part layers; no two are equal.
fn sound_names(lights: &[LightLayer]) -> Vec<String> {
    let sound = |c: char| if c.is_alphanumeric() && c.is_ascii() || c == '-' { c } else { '_' };
    let mut names: Vec<String> = Vec::with_capacity(lights.len());
    for light in lights {
        let name: String = light.name.chars().take(LONGEST_NAME).map(sound).collect();
        let name = if name.is_empty() { "light".to_owned() } else { name };
        let fresh = |name: &String| !names.contains(name);
        let numbered = (2..).map(|k| format!("{name}_{k}"));
        let found = std::iter::once(name.clone()).chain(numbered).find(fresh);
        names.push(found.unwrap_or(name));
    }
    names
}

/// To half precision, clamped to its largest finite value.
fn to_half(value: f32) -> f16 {
    f16::from_f32(value.clamp(-65504.0, 65504.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use exr::prelude::{ReadChannels, ReadLayers, read};

    #[test]
    fn layers_read_back_by_name_and_type() {
        let pixel = Pixel {
            direct: Vec3::new(0.5, 1.0, 1.0e6),
            indirect: Vec3::splat(0.25),
            albedo: Vec3::splat(0.75),
            normal: Vec3::Z,
            depth: 3.3,
            error: 0.01,
            coverage: 1.0,
        };
        let film = Film { width: 3, height: 2, pixels: vec![pixel; 6] };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let lights = ["lamp", "a.b/ü", "a b ü", ""].map(|name| {
            let radiance = vec![Vec3::new(0.5, 0.25, 2.0); 6];
            LightLayer { name: name.into(), radiance }
        });
        write(&path, &film, &lights).unwrap();
        let image = read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes();
        let image = image.from_file(&path).unwrap();
        assert_eq!(image.attributes.chromaticities, Some(REC709));
        let channels = &image.layer_data.channel_data.list;
        assert_eq!(channels.len(), 17 + 4 * 3);
        let value = |name: &str| {
            let channel = channels.iter().find(|c| c.name.to_string() == name).unwrap();
            let half = matches!(channel.sample_data, FlatSamples::F16(_));
            (channel.sample_data.value_by_flat_index(0).to_f32(), half)
        };
        for name in ["light.lamp", "light.a_b__", "light.a_b___2", "light.light"] {
            assert_eq!(
                (value(&format!("{name}.R")), value(&format!("{name}.B"))),
                ((0.5, true), (2.0, true))
            );
        }
        // Halves hold 0.75, 1.25 and 65504 exactly.
        assert_eq!((value("R"), value("G"), value("B")), ((0.75, true), (1.25, true), (65504.0, true)));
        assert_eq!(
            (value("direct.R"), value("indirect.R"), value("albedo.G")),
            ((0.5, true), (0.25, true), (0.75, true))
        );
        assert_eq!(
            (value("Z"), value("normal.Z"), value("error")),
            ((3.3, false), (1.0, false), (0.01, false))
        );
    }
}
