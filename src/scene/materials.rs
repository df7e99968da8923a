//! Reflectances, radiances and textures: what values light transport accepts, and what is done with the others.

use std::path::Path;

use crate::error::{Error, Result};
use crate::light::{Rgb, srgb_to_linear};
use crate::scene::{Texture, Warning};

/// The brightest reflectance that images and vertex colours may bring. White (1) would reflect for ever: energy could
/// not settle. At 0.999 the series still converges; smaller limits would darken white scans visibly.
pub const LIMIT: f32 = 0.999;

/// The brightest light that is accepted, in any unit. Sums over 10⁸ times as much still fit into single precision; the
/// sun's disk has 2·10⁷ W·m⁻²·sr⁻¹.
pub const BRIGHTEST: f32 = 1.0e30;

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
    let albedo = albedo.to_array();
    Err(format!("albedo {albedo:?} is outside [0, 1): a surface cannot reflect all light, or more"))
}

/// Checks an emitted radiance: every channel finite, not negative, and at most [`BRIGHTEST`].
///
/// # Errors
/// The problem as text.
pub fn check_radiance(radiance: Rgb) -> Result<(), String> {
    if !(radiance.is_finite() && radiance.min_element() >= 0.0) {
        return Err(format!("{:?} is negative or not finite: light cannot be", radiance.to_array()));
    }
    if radiance.max_element() > BRIGHTEST {
        let light = radiance.to_array();
        return Err(format!("{light:?} is above {BRIGHTEST:e}: its sums would leave single precision"));
    }
    Ok(())
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
    let refuse = |problem: String| Error::input(path, "picture", problem, "give a whole PNG or JPEG file");
    // A device or a pipe may never end.
    if !path.is_file() {
        let there = path.exists();
        return Err(refuse(if there { "it is no file" } else { "it does not exist" }.to_string()));
    }
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, "reading the texture", e))?;
    let picture = decoded(&bytes).map_err(refuse)?;
    Ok(texture_of(path, &picture, warnings))
}

/// Decodes a whole PNG or JPEG; memory is bounded by the bytes given.
///
/// # Errors
/// The problem as text.
pub fn decoded(bytes: &[u8]) -> Result<image::RgbImage, String> {
    let format = match image::guess_format(bytes) {
        Ok(format @ (image::ImageFormat::Png | image::ImageFormat::Jpeg)) => format,
        _ => return Err("it begins like no PNG and no JPEG".to_string()),
    };
    // JPEG readers fill what is missing with grey.
    let last = |marker: u8| bytes.windows(2).rposition(|pair| pair == [0xff, marker]);
    let (end_of_image, start_of_scan) = (last(0xd9), last(0xda));
    if format == image::ImageFormat::Jpeg && (end_of_image.is_none() || end_of_image < start_of_scan) {
        return Err("truncated: the picture has no end".to_string());
    }
    let reader = image::ImageReader::with_format(std::io::Cursor::new(bytes), format);
    let decoder = limited(reader).into_decoder().map_err(|error| complaint(&error))?;
    let (width, height) = image::ImageDecoder::dimensions(&decoder);
    check_claim(width, height, bytes.len())?;
    Ok(image::DynamicImage::from_decoder(decoder).map_err(|error| complaint(&error))?.into_rgb8())
}

/// What is wrong with a picture, in fewer words than its decoder has.
pub fn complaint(error: &image::ImageError) -> String {
    let said = error.to_string();
    let ended =
        matches!(error, image::ImageError::IoError(e) if e.kind() == std::io::ErrorKind::UnexpectedEof);
    if ended || said.contains("unexpected end of file") {
        return "truncated: the file ends within the picture".to_string();
    }
    if said.contains("CRC error") {
        return "damaged: a checksum does not hold".to_string();
    }
    format!("cannot be decoded: {said}")
}

/// Checks that a picture of so many bytes can have so many pixels.
fn check_claim(width: u32, height: u32, bytes: usize) -> Result<(), String> {
    // Deflate shrinks a thousandfold at most, and a pixel of PNG takes a bit or more. JPEG's blocks of 64 pixels take a
    // bit or more each.
    let most = MAX_PIXELS.min(8 * 1032 * bytes as u64);
    if u64::from(width) * u64::from(height) > most {
        return Err(format!("{width} x {height} pixels are promised by {bytes} bytes"));
    }
    Ok(())
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
