//! PNG: eight-bit sRGB under an exposure.

use std::path::Path;

use image::ImageEncoder;

use super::film::Film;
use crate::error::{Error, Result};
use crate::output::{exposure, file};

/// Writes the film to `path` under `exposure` (see [`Film::exposure`]), clamped to the display's range.
pub fn write(path: &Path, film: &Film, exposure: f32) -> Result<()> {
    let bytes: Vec<u8> = film.pixels.iter().flat_map(|p| exposure::srgb(p.radiance(), exposure)).collect();
    file::write_whole(path, bytes.len() as u64, |sink| {
        let encoder = image::codecs::png::PngEncoder::new(sink);
        let outcome = encoder.write_image(&bytes, film.width, film.height, image::ExtendedColorType::Rgb8);
        outcome.map_err(|e| match e {
            image::ImageError::IoError(source) => Error::io(path, "writing", source),
            other => Error::io(path, "encoding", std::io::Error::other(other)),
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::picture::film::Pixel;
    use glam::Vec3;

    #[test]
    fn pixels_come_back_as_exposed_srgb() {
        let lit = Pixel { direct: Vec3::new(0.25, 0.0, 4.0), ..Pixel::default() };
        let film = Film { width: 2, height: 1, pixels: vec![lit, Pixel::default()] };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        write(&path, &film, 2.0).unwrap();
        let read = image::open(&path).unwrap().to_rgb8();
        // sRGB of 0.5 is 188 (IEC 61966-2-1).
        assert_eq!((read.get_pixel(0, 0).0, read.get_pixel(1, 0).0), ([188, 0, 255], [0, 0, 0]));
    }
}
