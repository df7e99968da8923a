//! Skies: orientation, means, and what is refused.

mod scene_shared;

use std::f32::consts::TAU;
use std::sync::Arc;

use exr::prelude::write_rgb_file;
use glam::{Mat3, Vec3};
use glowtree::light::mean_channel;
use glowtree::scene::{Sky, Texture, sky};
use scene_shared::{Folder, SQUARE_PLY, shared};

fn image_sky(image: Texture, up: Vec3, degrees: f32) -> Sky {
    Sky::Image { image: Arc::new(image), to_image: sky::to_image(up, degrees) }
}

/// The chart marks +X and +Z by dark arrows at the zenith and the nadir; −X and −Z have none.
#[test]
fn the_orientation_chart_lies_right() {
    let Some(folder) = shared("data/env") else { return };
    let image = sky::read_image(&folder.join("openexr-OrientationLatLong.exr"), &mut Vec::new()).unwrap();
    assert_eq!((image.width, image.height), (1024, 512), "the finest level");
    let sky = image_sky(image, Vec3::Y, 0.0);
    for up in [5.0, -5.0] {
        let seen = |toward: Vec3| mean_channel(sky.radiance((toward + up * Vec3::Y).normalize()));
        for (dark, light) in [(Vec3::X, Vec3::NEG_X), (Vec3::Z, Vec3::NEG_Z)] {
            assert!(
                seen(dark) < 0.3 && seen(light) > 0.7,
                "up {up}, {dark}: {} and {}",
                seen(dark),
                seen(light)
            );
        }
    }
}

/// A smooth image whose value tells the direction it stands for, in the OpenEXR layout.
fn compass() -> Texture {
    let (width, height) = (256u32, 128u32);
    let mut pixels = Vec::new();
    for k in 0..width * height {
        let longitude = TAU * (0.5 - ((k % width) as f32 + 0.5) / width as f32);
        let latitude = 0.5 * TAU * (0.5 - ((k / width) as f32 + 0.5) / height as f32);
        let direction =
            Vec3::new(latitude.cos() * longitude.sin(), latitude.sin(), latitude.cos() * longitude.cos());
        pixels.push(direction + Vec3::ONE);
    }
    Texture { width, height, pixels }
}

#[test]
fn directions_find_their_pixels_all_around() {
    let sky = image_sky(compass(), Vec3::Y, 0.0);
    for k in 0..500 {
        let direction =
            glowtree::geometry::hemisphere::uniform_sphere(glowtree::geometry::hash::unit_pair(3, k));
        let found = sky.radiance(direction) - Vec3::ONE;
        // Bilinear between pixels 2 pi / 256 apart errs by h^2 / 8 = 8e-5 in each of two axes; the pole rows are
        // clamped, which costs up to half a pixel, 0.0123.
        assert!((found - direction).length() < 0.015, "{direction}: {found}");
    }
}

#[test]
fn skies_turn_about_up_and_tilt() {
    // A quarter turn counter-clockwise seen from above brings what stood at +z to +x.
    let turned = image_sky(compass(), Vec3::Y, 90.0);
    assert!((turned.radiance(Vec3::X) - (Vec3::Z + Vec3::ONE)).length() < 0.015);
    for (up, name) in [(Vec3::X, "x"), (Vec3::NEG_Z, "-z"), (Vec3::Z, "z"), (Vec3::NEG_Y, "-y")] {
        assert_eq!(sky::axis(name), Some(up));
        let tilted = image_sky(compass(), up, 77.0);
        assert!((tilted.radiance(up) - (Vec3::Y + Vec3::ONE)).length() < 0.015, "the zenith is {name}");
        let to_image = sky::to_image(up, 77.0);
        assert!((to_image * to_image.transpose() - Mat3::IDENTITY).x_axis.length() < 1e-6);
        assert!((to_image.determinant() - 1.0).abs() < 1e-5, "no mirroring with {name} up");
    }
    let upright = image_sky(compass(), Vec3::Z, 0.0);
    assert!(
        (upright.radiance(Vec3::NEG_Y) - (Vec3::Z + Vec3::ONE)).length() < 0.015,
        "z up: -y in the middle"
    );
}

#[test]
fn means_weigh_by_solid_angle() {
    let mean = image_sky(compass(), Vec3::Y, 0.0).mean_radiance();
    // Directions cancel: the columns exactly, the rows by symmetry.
    assert!((mean - Vec3::ONE).length() < 1e-5, "{mean}");
    let mut half = compass();
    let middle = half.pixels.len() / 2;
    half.pixels
        .iter_mut()
        .enumerate()
        .for_each(|(k, p)| *p = Vec3::splat(if k < middle { 2.0 } else { 0.0 }));
    assert!((image_sky(half, Vec3::Y, 0.0).mean_radiance() - Vec3::ONE).length() < 1e-6);
    assert_eq!(Sky::Constant(Vec3::new(1., 2., 3.)).mean_radiance(), Vec3::new(1., 2., 3.));
}

#[test]
fn collected_skies_are_read() {
    let Some(folder) = shared("data/env") else { return };
    let mut read = 0;
    for entry in std::fs::read_dir(&folder).unwrap() {
        let path = entry.unwrap().path();
        let mut warnings = Vec::new();
        match path.extension().and_then(|e| e.to_str()) {
            Some("exr") => {
                let image = sky::read_image(&path, &mut warnings).unwrap_or_else(|error| panic!("{error}"));
                assert!(image.pixels.iter().all(|p| p.is_finite() && p.min_element() >= 0.0));
                let mean = image_sky(image, Vec3::Y, 0.0).mean_radiance();
                assert!(mean.min_element() > 1e-3 && mean.max_element() < 1e3, "{}: {mean}", path.display());
                read += 1;
            }
            Some("hdr") => {
                let image = sky::read_picture(&path, &mut warnings).unwrap_or_else(|error| panic!("{error}"));
                assert_eq!((image.width, image.height), (1024, 1024));
                let error = sky::read_image(&path, &mut warnings).unwrap_err();
                assert!(
                    error.to_string().contains("not twice as wide as high") && error.exit_code() == 4,
                    "{error}"
                );
            }
            _ => {}
        }
    }
    assert_eq!(read, 10, "the README lists ten EXR files");
}

#[test]
fn odd_pixels_are_mended_or_refused() {
    let folder = Folder::new();
    let write = |name: &str, odd: f32| {
        let path = folder.write(name, "");
        write_rgb_file(&path, 8, 4, |x, y| (if (x, y) == (3, 2) { odd } else { 1.0 }, 0.5f32, 0.25f32))
            .unwrap();
        path
    };
    let mut warnings = Vec::new();
    let sound = sky::read_image(&write("sound.exr", 2.0), &mut warnings).unwrap();
    assert_eq!((sound.pixels[19], warnings.len()), (Vec3::new(2.0, 0.5, 0.25), 0));
    let mended = sky::read_image(&write("negative.exr", -2.0), &mut warnings).unwrap();
    assert_eq!(mended.pixels[19], Vec3::new(0.0, 0.5, 0.25));
    assert!(warnings[0].message.starts_with("1 of 32 pixels"), "{warnings:?}");
    for odd in [f32::NAN, f32::INFINITY] {
        let error = sky::read_image(&write("odd.exr", odd), &mut warnings).unwrap_err();
        assert!(error.to_string().contains("pixel 3, 2") && error.exit_code() == 4, "{error}");
    }
    folder.write("square.ply", SQUARE_PLY);
    let scene = "[[mesh]]\nfile = \"square.ply\"\n[sky]\nfile = \"sound.exr\"\nrotate = 30\n";
    assert!(matches!(folder.load("scene.toml", scene).unwrap().sky, Some(Sky::Image { .. })));
}

#[test]
fn hostile_pictures_are_refused_at_once() {
    let folder = Folder::new();
    let whole = folder.write("whole.exr", "");
    write_rgb_file(&whole, 64, 32, |x, y| (x as f32, y as f32, 1.0f32)).unwrap();
    let bytes = std::fs::read(&whole).unwrap();
    let start = std::time::Instant::now();
    let mut warnings = Vec::new();
    for cut in (0..bytes.len()).step_by(1 + bytes.len() / 60) {
        let error = sky::read_image(&folder.write("cut.exr", &bytes[..cut]), &mut warnings).unwrap_err();
        assert_eq!(error.exit_code(), 4, "cut at {cut}: {error}");
        for value in [0u8, 0xff, 0x7f] {
            let mut changed = bytes.clone();
            changed[cut] = value;
            let _ = sky::read_image(&folder.write("changed.exr", &changed), &mut warnings);
        }
    }
    for (name, text) in [
        ("empty.hdr", ""),
        ("noise.hdr", "no picture at all"),
        ("cut.hdr", "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\nab"),
        ("huge.hdr", "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 60000 +X 60000\nab"),
        ("more.hdr", "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4000000000 +X 4000000000\nab"),
        ("zero.hdr", "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 0 +X 0\n"),
    ] {
        let answer = sky::read_image(&folder.write(name, text), &mut warnings);
        assert_eq!(answer.map(|image| image.width).unwrap_err().exit_code(), 4, "{name}");
    }
    assert!(start.elapsed().as_secs() < 20, "all in {:?}", start.elapsed());
}
