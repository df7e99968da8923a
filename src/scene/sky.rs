//! Skies: latitude–longitude images and what light comes from a direction.
//!
//! The layout is that of the OpenEXR attribute `envmap` ("latitude-longitude"), which Mitsuba shares: the zenith along
//! the top row; for y up, +z in the middle, +x a quarter to its left, −x a quarter to its right. For another axis up
//! the image is tilted by the shortest rotation from y: with z up, −y is in the middle.

use std::f32::consts::{FRAC_1_PI, PI, TAU};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use exr::prelude::{MetaData, ReadChannels, ReadLayers};
use glam::{DVec3, Mat3, Quat, Vec3};

use crate::error::{Error, Result};
use crate::light::Rgb;
use crate::light::harmonics::Harmonics;
use crate::scene::materials::{BRIGHTEST, MAX_PIXELS, complaint, limited};
use crate::scene::{Sky, Texture, Warning};

/// The unit vector of "x", "y", "z", or of one with a minus.
pub fn axis(word: &str) -> Option<Vec3> {
    let (sign, letter) = word.strip_prefix('-').map_or((1.0, word), |letter| (-1.0, letter));
    let axis = match letter {
        "x" => Vec3::X,
        "y" => Vec3::Y,
        "z" => Vec3::Z,
        _ => return None,
    };
    Some(axis * sign)
}

/// The rotation from scene directions into the image's frame, for an image turned by `degrees` about `up`
/// (counter-clockwise seen from above).
pub fn to_image(up: Vec3, degrees: f32) -> Mat3 {
    let turn_back = Quat::from_axis_angle(up, -degrees.to_radians());
    let upright = Quat::from_rotation_arc(up, Vec3::Y);
    // The image's frame has −z in its middle, the convention has +z there.
    let half_turn = Quat::from_rotation_y(PI);
    Mat3::from_quat(half_turn * upright * turn_back)
}

/// By how many degrees about `up` an image with this rotation into its frame is turned, from 0 to 360.
pub fn rotation(to_image_now: &Mat3, up: Vec3) -> f32 {
    let turn_back = Quat::from_mat3(&(to_image(up, 0.0).transpose() * *to_image_now));
    let degrees = (-2.0 * turn_back.xyz().dot(up).atan2(turn_back.w)).to_degrees();
    degrees.rem_euclid(360.0)
}

/// The rotation from scene directions into the frame of [`crate::light::harmonics`].
pub fn to_harmonics(up: Vec3) -> Mat3 {
    // Its axes are −z, −x and y of an image that is not turned.
    Mat3::from_cols(Vec3::NEG_Y, Vec3::Z, Vec3::NEG_X) * to_image(up, 0.0)
}

/// A sky of harmonics as an image of `height` rows: its values at pixels' middles, some of which may be negative.
pub fn panorama(sky: &Harmonics, height: u32) -> Texture {
    let width = 2 * height;
    let pixel = |k: u32| {
        let (sine, cosine) = (PI * ((k / width) as f32 + 0.5) / height as f32).sin_cos();
        let (y, x) = (PI - TAU * ((k % width) as f32 + 0.5) / width as f32).sin_cos();
        sky.radiance(Vec3::new(sine * x, sine * y, cosine))
    };
    Texture { width, height, pixels: (0..width * height).map(pixel).collect() }
}

/// Reads a latitude–longitude image (EXR or Radiance HDR).
///
/// # Errors
/// [`Error::Input`] for what cannot be decoded, holds values that are not finite, or is not twice as wide as high.
pub fn read_image(path: &Path, warnings: &mut Vec<Warning>) -> Result<Texture> {
    let image = read_picture(path, warnings)?;
    if image.width.abs_diff(2 * image.height) > 2 {
        let problem = format!(
            "{} x {} pixels are not twice as wide as high, so this is no latitude-longitude image",
            image.width, image.height
        );
        return Err(Error::input(path, "picture", problem, "convert it to latitude-longitude"));
    }
    Ok(image)
}

/// Reads an EXR or HDR picture of any shape; negative values become 0, with a counted warning.
///
/// # Errors
/// [`Error::Input`] for what cannot be decoded or holds values that are not finite.
pub fn read_picture(path: &Path, warnings: &mut Vec<Warning>) -> Result<Texture> {
    let mut image = match super::extension(path).as_str() {
        "exr" => read_exr(path)?,
        "hdr" | "pic" | "rgbe" => read_hdr(path)?,
        other => {
            let problem = format!("skies of kind {other:?} are not read");
            return Err(Error::input(path, "name", problem, "give a .exr or .hdr file"));
        }
    };
    if image.pixels.is_empty() {
        return Err(Error::input(path, "picture", "it has no pixels", "give another picture"));
    }
    let is_odd = |pixel: &Rgb| !pixel.is_finite() || pixel.max_element() > BRIGHTEST;
    if let Some(at) = image.pixels.iter().position(is_odd) {
        let (x, y) = (at % image.width as usize, at / image.width as usize);
        let pixel = image.pixels[at];
        let what = if pixel.is_finite() { format!("above {BRIGHTEST:e}") } else { "not finite".to_string() };
        let problem = format!("the value {:?} is {what}", pixel.to_array());
        return Err(Error::input(path, format!("pixel {x}, {y}"), problem, "repair the picture"));
    }
    let mut negative = 0usize;
    for pixel in &mut image.pixels {
        if pixel.min_element() < 0.0 {
            *pixel = pixel.max(Rgb::ZERO);
            negative += 1;
        }
    }
    if negative > 0 {
        let message = format!("{negative} of {} pixels were negative and became 0", image.pixels.len());
        warnings.push(Warning { file: path.to_path_buf(), message });
    }
    Ok(image)
}

/// The first layer with red, green and blue, at its finest level.
fn read_exr(path: &Path) -> Result<Texture> {
    let refuse = |error: exr::error::Error| {
        let remedy = match error {
            exr::error::Error::NotSupported(_) => {
                "write it anew with ZIP compression (oiiotool in.exr --compression zip -o out.exr)"
            }
            _ => "get the whole, undamaged picture",
        };
        let said = error.to_string().replace("reference to missing bytes", "truncated, or a length is wrong");
        Error::input(path, "EXR", format!("cannot be read: {said}"), remedy)
    };
    let bytes = std::fs::metadata(path).map_err(|e| Error::io(path, "opening the sky", e))?.len();
    let meta = MetaData::read_from_file(path, false).map_err(refuse)?;
    for header in &meta.headers {
        let pixels = (header.layer_size.width() as u64).saturating_mul(header.layer_size.height() as u64);
        // Deflate shrinks a thousandfold at most and a pixel has six bytes or more: the rest is a lie that takes memory.
        if pixels > MAX_PIXELS.min(bytes.saturating_mul(512)) {
            let size = header.layer_size;
            let problem =
                format!("{} x {} pixels are promised by {bytes} bytes", size.width(), size.height());
            return Err(Error::input(path, "EXR header", problem, "get the whole file, or a smaller one"));
        }
        if header.own_attributes.environment_map == Some(exr::meta::attribute::EnvironmentMap::Cube) {
            let problem = "the environment is a cube map";
            return Err(Error::input(path, "EXR header", problem, "convert it to latitude-longitude"));
        }
    }
    let read = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .rgb_channels(
            |size, _| Texture {
                width: size.width() as u32,
                height: size.height() as u32,
                pixels: vec![Rgb::ZERO; size.width() * size.height()],
            },
            |image: &mut Texture, at, (r, g, b): (f32, f32, f32)| {
                image.pixels[at.y() * image.width as usize + at.x()] = Rgb::new(r, g, b);
            },
        )
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_file(path)
        .map_err(refuse)?;
    Ok(read.layer_data.channel_data.pixels)
}

fn read_hdr(path: &Path) -> Result<Texture> {
    let refuse = |problem: String| Error::input(path, "HDR", problem, "give a whole Radiance RGBE picture");
    let file = File::open(path).map_err(|e| Error::io(path, "opening the sky", e))?;
    let bytes = file.metadata().map_err(|e| Error::io(path, "opening the sky", e))?.len();
    let reader = image::ImageReader::with_format(BufReader::new(file), image::ImageFormat::Hdr);
    let decoder = limited(reader).into_decoder().map_err(|e| refuse(complaint(&e)))?;
    let (width, height) = image::ImageDecoder::dimensions(&decoder);
    // Run lengths shrink a scan line of one colour 127 / 2 times at most.
    if u64::from(width) * u64::from(height) > MAX_PIXELS.min(bytes.saturating_mul(64)) {
        return Err(refuse(format!("{width} x {height} pixels are promised by {bytes} bytes")));
    }
    let picture =
        image::DynamicImage::from_decoder(decoder).map_err(|e| refuse(complaint(&e)))?.into_rgb32f();
    let pixels = picture.pixels().map(|p| Rgb::from_array(p.0)).collect();
    Ok(Texture { width, height, pixels })
}

impl Sky {
    /// The radiance that arrives from a unit direction (pointing away from the scene), W·m⁻²·sr⁻¹; bilinear.
    pub fn radiance(&self, direction: Vec3) -> Rgb {
        match self {
            Self::Constant(radiance) => *radiance,
            Self::Image { image, to_image } => {
                let d = *to_image * direction;
                let x = (0.5 + d.x.atan2(-d.z) / TAU) * image.width as f32 - 0.5;
                let y = d.y.clamp(-1.0, 1.0).acos() * FRAC_1_PI * image.height as f32 - 0.5;
                image.bilinear_panorama(x, y)
            }
        }
    }

    /// Its projection onto spherical harmonics, as it stands in a scene with this up. Costs a pass over the image.
    ///
    /// # Panics
    /// When not 1 to 4 bands are asked for.
    pub fn harmonics(&self, up: Vec3, order: usize) -> Harmonics {
        match self {
            Self::Constant(radiance) => Harmonics::constant(*radiance, order),
            Self::Image { image, to_image } => {
                let own = Harmonics::project(image.width as usize, &image.pixels, order);
                own.turned(rotation(to_image, up))
            }
        }
    }

    /// The mean radiance over all directions.
    pub fn mean_radiance(&self) -> Rgb {
        match self {
            Self::Constant(radiance) => *radiance,
            Self::Image { image, .. } => {
                let rows = f64::from(image.height);
                let mut sum = DVec3::ZERO;
                for (row, pixels) in image.pixels.chunks_exact(image.width as usize).enumerate() {
                    let edge = |k: usize| (std::f64::consts::PI * k as f64 / rows).cos();
                    let row_sum: DVec3 = pixels.iter().map(|p| p.as_dvec3()).sum();
                    sum += row_sum * (edge(row) - edge(row + 1));
                }
                (sum / (2.0 * f64::from(image.width))).as_vec3()
            }
        }
    }
}

impl Texture {
    /// Bilinear look-up in pixels (centres at integers): columns go round, rows end at the poles.
    fn bilinear_panorama(&self, x: f32, y: f32) -> Rgb {
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let pixel = |dx: i64, dy: i64| {
            let column = (x0 as i64 + dx).rem_euclid(i64::from(self.width)) as usize;
            let row = (y0 as i64 + dy).clamp(0, i64::from(self.height) - 1) as usize;
            self.pixels[row * self.width as usize + column]
        };
        let top = pixel(0, 0).lerp(pixel(1, 0), fx);
        top.lerp(pixel(0, 1).lerp(pixel(1, 1), fx), fy)
    }
}
