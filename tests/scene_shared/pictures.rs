//! Pictures made in memory.

/// A grey PNG.
pub fn png(width: u32, height: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    let picture = image::RgbImage::from_pixel(width, height, image::Rgb([128; 3]));
    let into = &mut std::io::Cursor::new(&mut bytes);
    picture.write_to(into, image::ImageFormat::Png).expect("a picture in memory");
    bytes
}

/// A PNG of 2 by 2 pixels whose header (with a checksum that holds) claims another size.
pub fn png_claiming(width: u32, height: u32) -> Vec<u8> {
    let mut bytes = png(2, 2);
    bytes[16..20].copy_from_slice(&width.to_be_bytes());
    bytes[20..24].copy_from_slice(&height.to_be_bytes());
    let checksum = crc32(&bytes[12..29]);
    bytes[29..33].copy_from_slice(&checksum.to_be_bytes());
    bytes
}

/// The checksum of PNG's chunks.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| (crc >> 1) ^ (0xedb8_8320 * (crc & 1)))
    })
}

/// A JPEG of a gradient.
pub fn jpeg() -> Vec<u8> {
    let mut bytes = Vec::new();
    let picture = image::RgbImage::from_fn(64, 64, |x, y| image::Rgb([4 * x as u8, 4 * y as u8, 90]));
    let into = &mut std::io::Cursor::new(&mut bytes);
    picture.write_to(into, image::ImageFormat::Jpeg).expect("a picture in memory");
    bytes
}

/// An EXR sky whose pixel (x, y) holds what the function says.
pub fn exr(width: usize, height: usize, pixel: impl Sync + Fn(usize, usize) -> f32) -> Vec<u8> {
    use exr::prelude::*;
    let mut bytes = std::io::Cursor::new(Vec::new());
    let channels = SpecificChannels::rgb(|at: Vec2<usize>| {
        let value = pixel(at.x(), at.y());
        (value, value, value)
    });
    let image = Image::from_channels((width, height), channels);
    image.write().non_parallel().to_buffered(&mut bytes).expect("a picture in memory");
    bytes.into_inner()
}
