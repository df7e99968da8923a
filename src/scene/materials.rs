//! Reflectances, radiances and textures: what values light transport accepts, and what is done with the others.

use std::path::Path;

use crate::error::{Error, Result};
use crate::light::{Rgb, srgb_to_linear};
use crate::scene::{Texture, Warning};

/// The brightest reflectance that images and vertex colours may bring. White (1) would reflect for ever: energy could
/// not settle. At 0.999 the series still converges; smaller limits would darken white scans visibly.
pub const LIMIT: f32 = 0.999;

/// Pixels beyond which a texture or sky is refused before it is decoded: 2²⁸, 3 GiB of linear floats.
pub const MAX_PIXELS: u64 = 1 << 28;

/// Lowers channels above [`LIMIT`] to it; gives how many values were changed.
pub fn clamp_reflectance(values: &mut [Rgb]) -> usize {
    let mut clamped = 0;
    for value in values {
        if value.max_element() > LIMIT {
            *value = value.min(Rgb::splat(LIMIT));
            clamped += 1;
        }
    }
    clamped
}

/// Checks an albedo that a person wrote: every channel in [0, 1).
///
/// # Errors
/// The problem as text.
pub fn check_albedo(albedo: Rgb) -> Result<(), String> {
    if albedo.is_finite() && albedo.min_element() >= 0.0 && albedo.max_element() < 1.0 {
        return Ok(());
    }
    Err(format!("albedo {albedo} is outside [0, 1): a surface cannot reflect all light, or more"))
}

/// Checks an emitted radiance: every channel finite and not negative.
///
/// # Errors
/// The problem as text.
pub fn check_radiance(radiance: Rgb) -> Result<(), String> {
    if radiance.is_finite() && radiance.min_element() >= 0.0 {
        return Ok(());
    }
    Err(format!("{radiance} is negative or not finite: light cannot be"))
}

/// Checks an albedo from a material file, where white is common: exactly 1 is lowered to [`LIMIT`].
///
/// # Errors
/// The problem as text for what lies outside [0, 1].
pub fn tame_albedo(albedo: Rgb) -> Result<(Rgb, bool), String> {
    if albedo.is_finite() && albedo.min_element() >= 0.0 && albedo.max_element() <= 1.0 {
        return Ok((albedo.min(Rgb::splat(LIMIT)), albedo.max_element() > LIMIT));
    }
    check_albedo(albedo).map(|()| (albedo, false))
}

/// Reads a picture (PNG or JPEG, sRGB) as a reflectance.
///
/// # Errors
/// [`Error::Input`] naming the picture when it is missing, broken or too large.
pub fn read_texture(path: &Path, warnings: &mut Vec<Warning>) -> Result<Texture> {
    let refuse = |problem: String| Error::input(path, "picture", problem, "give a PNG or JPEG file");
    let reader = image::ImageReader::open(path).map_err(|e| refuse(format!("cannot be opened: {e}")))?;
    let reader = reader.with_guessed_format().map_err(|e| refuse(e.to_string()))?;
    let picture = limited(reader).decode().map_err(|e| refuse(e.to_string()))?;
    Ok(texture_of(path, &picture.to_rgb8(), warnings))
}

/// A picture already decoded to 8-bit sRGB as a reflectance.
pub fn texture_of(path: &Path, picture: &image::RgbImage, warnings: &mut Vec<Warning>) -> Texture {
    let linear: Vec<f32> = (0..=255).map(srgb_to_linear).collect();
    let decode = |byte: u8| linear[usize::from(byte)];
    let mut pixels: Vec<Rgb> =
        picture.pixels().map(|p| Rgb::new(decode(p.0[0]), decode(p.0[1]), decode(p.0[2]))).collect();
    let clamped = clamp_reflectance(&mut pixels);
    if clamped > 0 {
        let message = format!("{clamped} white pixels of {} darkened to {LIMIT}", pixels.len());
        warnings.push(Warning { file: path.to_path_buf(), message });
    }
    Texture { width: picture.width(), height: picture.height(), pixels }
}

/// The reader with bounds on size and memory.
pub fn limited<R>(mut reader: image::ImageReader<R>) -> image::ImageReader<R>
where
    R: std::io::BufRead + std::io::Seek,
{
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(1 << 16);
    limits.max_image_height = Some(1 << 16);
    limits.max_alloc = Some(MAX_PIXELS * 12);
    reader.limits(limits);
    reader
}
