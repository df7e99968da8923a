//! Broken skies and textures.

use crate::scene_shared::SQUARE_PLY;
use crate::scene_shared::pictures::{exr, jpeg, png, png_claiming};
use crate::{Case, scene};

/// A Radiance sky of `size` ("-Y 1 +X 2") with this data.
fn hdr(size: &str, data: &[u8]) -> Vec<u8> {
    let mut bytes = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n{size}\n").into_bytes();
    bytes.extend(data);
    bytes
}

fn skies() -> Vec<(&'static str, &'static str, Vec<u8>)> {
    let good = exr(8, 4, |_, _| 0.5);
    let set = |at: usize, value: u8| {
        let mut bytes = good.clone();
        bytes[at] = value;
        bytes
    };
    let window = good.windows(10).position(|text| text == b"dataWindow").expect("a window") + 10 + 1 + 6 + 4;
    let mut huge = good.clone();
    huge[window + 8..window + 12].copy_from_slice(&16_777_215i32.to_le_bytes());
    huge[window + 12..window + 16].copy_from_slice(&8_388_607i32.to_le_bytes());
    let mut inverted = good.clone();
    inverted[window + 8..window + 12].copy_from_slice(&(-5i32).to_le_bytes());
    let grey = |pixels: usize| [128u8, 128, 128, 129].repeat(pixels);
    vec![
        ("exr-empty", "sky.exr", Vec::new()),
        ("exr-magic-alone", "sky.exr", good[..4].to_vec()),
        ("exr-cut-in-the-header", "sky.exr", good[..100].to_vec()),
        ("exr-cut-in-the-pixels", "sky.exr", good[..good.len() - 9].to_vec()),
        ("exr-of-version-9", "sky.exr", set(4, 9)),
        ("exr-of-unknown-compression", "sky.exr", {
            let at = good.windows(12).position(|text| text == b"compression\0").expect("a key") + 12 + 16;
            set(at, 99)
        }),
        ("exr-claims-16-million-by-8-million", "sky.exr", huge),
        ("exr-of-negative-width", "sky.exr", inverted),
        ("exr-nan", "sky.exr", exr(8, 4, |x, y| if (x, y) == (3, 2) { f32::NAN } else { 0.5 })),
        ("exr-infinite", "sky.exr", exr(8, 4, |x, y| if (x, y) == (7, 0) { f32::INFINITY } else { 0.5 })),
        ("exr-negative", "sky.exr", exr(8, 4, |x, _| x as f32 - 4.0)),
        ("exr-of-1e38", "sky.exr", exr(8, 4, |_, _| 1e38)),
        ("exr-square", "sky.exr", exr(8, 8, |_, _| 0.5)),
        ("exr-of-one-pixel", "sky.exr", exr(1, 1, |_, _| 0.5)),
        ("exr-black", "sky.exr", exr(8, 4, |_, _| 0.0)),
        ("exr-a-png", "sky.exr", png(8, 4)),
        ("hdr-empty", "sky.hdr", Vec::new()),
        ("hdr-magic-alone", "sky.hdr", b"#?RADIANCE\n".to_vec()),
        ("hdr-of-no-size", "sky.hdr", hdr("", &grey(32))),
        ("hdr-of-negative-size", "sky.hdr", hdr("-Y -4 +X 8", &grey(32))),
        ("hdr-of-zero-size", "sky.hdr", hdr("-Y 0 +X 0", &[])),
        ("hdr-claims-65536-by-32768", "sky.hdr", hdr("-Y 32768 +X 65536", &grey(32))),
        ("hdr-claims-2e32", "sky.hdr", hdr("-Y 4294967295 +X 4294967295", &grey(32))),
        ("hdr-of-a-word", "sky.hdr", hdr("-Y four +X 8", &grey(32))),
        ("hdr-on-its-side", "sky.hdr", hdr("+X 8 -Y 4", &grey(32))),
        ("hdr-cut", "sky.hdr", hdr("-Y 4 +X 8", &grey(20))),
        ("hdr-run-too-long", "sky.hdr", hdr("-Y 1 +X 8", &[2, 2, 0, 8, 255, 1, 255, 1])),
        (
            "hdr-in-xyz",
            "sky.hdr",
            b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 2\n\x80\x80\x80\x81\x80\x80\x80\x81".to_vec(),
        ),
        ("hdr-an-exr", "sky.hdr", good),
        ("png", "sky.png", png(8, 4)),
    ]
}

fn textures() -> Vec<(&'static str, Vec<u8>)> {
    let good = png(8, 8);
    let flip = |at: usize| {
        let mut bytes = good.clone();
        bytes[at] ^= 0x10;
        bytes
    };
    let jpeg = jpeg();
    vec![
        ("empty", Vec::new()),
        ("not-a-picture", b"hello, world\n".to_vec()),
        ("png-cut-in-the-header", good[..20].to_vec()),
        ("png-cut-in-the-pixels", good[..good.len() - 20].to_vec()),
        ("png-of-damaged-pixels", flip(good.len() - 24)),
        ("png-of-damaged-header", flip(18)),
        ("png-of-zero-width", png_claiming(0, 8)),
        ("png-claims-65535-squared", png_claiming(65_535, 65_535)),
        ("png-claims-16384-squared", png_claiming(16_384, 16_384)),
        ("png-claims-2e31", png_claiming(0x7fff_ffff, 0x7fff_ffff)),
        ("png-white", {
            let mut bytes = Vec::new();
            let picture = image::RgbImage::from_pixel(4, 4, image::Rgb([255; 3]));
            let into = &mut std::io::Cursor::new(&mut bytes);
            picture.write_to(into, image::ImageFormat::Png).expect("a picture in memory");
            bytes
        }),
        ("jpeg-cut-in-the-header", jpeg[..40].to_vec()),
        ("jpeg-cut-in-the-pixels", jpeg[..jpeg.len() - 60].to_vec()),
        ("jpeg-without-its-end", jpeg[..jpeg.len() - 2].to_vec()),
        ("a-gif", b"GIF89a\x01\x00\x01\x00\x00\x00\x00;".to_vec()),
        ("a-tiff", b"II*\x00\x08\x00\x00\x00".to_vec()),
    ]
}

/// All of them.
pub fn cases() -> Vec<Case> {
    let skies = skies().into_iter().map(|(name, file, bytes)| {
        let text = format!("[[mesh]]\nfile = \"square.ply\"\n[sky]\nfile = \"{file}\"\n");
        scene(&format!("sky/{name}"), "scene.toml", text).with("square.ply", SQUARE_PLY).with(file, bytes)
    });
    let square = SQUARE_PLY
        .replace("property float z\n", "property float z\nproperty float u\nproperty float v\n")
        .replace("0 0 0\n1 0 0\n1 1 0\n0 1 0\n", "0 0 0 0 0\n1 0 0 1 0\n1 1 0 1 1\n0 1 0 0 1\n");
    let textured = |name: &str, square: &str, bytes: Vec<u8>| {
        let text =
            "[[mesh]]\nfile = \"square.ply\"\nalbedo = { texture = \"wall.png\" }\n[sky]\nradiance = 1\n";
        scene(&format!("texture/{name}"), "scene.toml", text)
            .with("square.ply", square)
            .with("wall.png", bytes)
    };
    let of_square = [
        ("without-texture-coordinates", SQUARE_PLY.to_string()),
        ("with-texture-coordinates-nan", square.replace("1 1 0 1 1", "1 1 0 nan 1")),
        ("with-texture-coordinates-beyond-single", square.replace("1 1 0 1 1", "1 1 0 1e300 1")),
        ("with-texture-coordinates-of-1e30", square.replace("1 1 0 1 1", "1 1 0 1e30 1")),
    ];
    let mut cases: Vec<Case> = skies.collect();
    cases.extend(textures().into_iter().map(|(name, bytes)| textured(name, &square, bytes)));
    cases.extend(of_square.iter().map(|(name, square)| textured(name, square, png(2, 2))));
    cases
}
