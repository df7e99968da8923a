//! Skies by their spherical harmonics: sums of transfers are solutions, whichever the sky and however turned, and what is stored
//! or exported says the same.

#![allow(clippy::unwrap_used)] // a test that cannot go on panics where it stands

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glowtree::bake::relight::{SkyImage, SkyLight};
use glowtree::bake::{self, Lighting, Options, Relighter, Silent};
use glowtree::light::Rgb;
use glowtree::light::harmonics::{Harmonics, MOST};
use glowtree::scene::{Sky, Texture, sky};

/// A court with a roof over half of it, red on one side: light from outside is occluded and reflected.
const COURT: &str = "\
v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nv -1 1 -1\nv 1 1 -1\nv 1 1 1\nv -1 1 1\nv 0 1 -1\nv 0 1 1\n";

fn quad(name: &str, corners: [u32; 4]) -> String {
    let [a, b, c, d] = corners;
    format!("o {name}\nusemtl {name}\nf {a} {b} {c} {d}\n")
}

/// The court as an OBJ beside a scene of it; the folder it is in.
fn court(sky: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let walls = [
        quad("floor", [1, 4, 3, 2]),
        quad("back", [1, 2, 6, 5]),
        quad("left", [1, 5, 8, 4]),
        quad("right", [2, 3, 7, 6]),
        quad("roof", [5, 9, 10, 8]),
    ];
    let text = format!("mtllib court.mtl\n{COURT}{}", walls.concat());
    std::fs::write(folder.path().join("court.obj"), text).unwrap();
    let paint = |name: &str, rgb: &str| format!("newmtl {name}\nKd {rgb}\n");
    let paints = [
        paint("floor", "0.5 0.5 0.5"),
        paint("back", "0.7 0.7 0.6"),
        paint("left", "0.8 0.2 0.1"),
        paint("right", "0.3 0.6 0.3"),
        paint("roof", "0.6 0.6 0.6"),
    ];
    std::fs::write(folder.path().join("court.mtl"), paints.concat()).unwrap();
    let scene = format!("[[mesh]]\nfile = \"court.obj\"\nsides = 2\n{sky}");
    std::fs::write(folder.path().join("scene.toml"), scene).unwrap();
    folder
}

const EVEN: &str = "[sky]\nradiance = [1, 1, 1]\n";

fn bake(folder: &Path, error: f64) -> PathBuf {
    let job = folder.join("job");
    let options = Options { error, preview: false, ..Options::default() };
    bake::run(&folder.join("scene.toml"), &job, &options, &Silent).unwrap();
    job
}

/// RMS of the differences over that of the values.
fn relative(a: &[Rgb], b: &[Rgb]) -> f64 {
    let square = |v: Rgb| v.as_dvec3().length_squared();
    let difference: f64 = a.iter().zip(b).map(|(a, b)| square(*a - *b)).sum();
    (difference / b.iter().map(|b| square(*b)).sum::<f64>()).sqrt()
}

/// A sky with four bands that is nowhere dark: a warm glow low on one side over blue.
fn banded() -> Harmonics {
    let mut coefficients = Harmonics::constant(Rgb::new(0.5, 0.7, 1.0), 4).coefficients;
    coefficients[3] = Rgb::new(-0.6, -0.3, -0.1);
    coefficients[1] = Rgb::new(0.2, 0.1, 0.1);
    coefficients[2] = Rgb::new(0.1, 0.2, 0.3);
    coefficients[6] = Rgb::splat(-0.15);
    coefficients[8] = Rgb::new(0.2, 0.1, 0.0);
    coefficients[13] = Rgb::new(-0.1, 0.0, 0.1);
    Harmonics { coefficients }
}

/// A sky with a small bright sun.
fn sunny() -> Texture {
    let mut texture = sky::panorama(&banded(), 32);
    for k in [64 * 8 + 20, 64 * 8 + 21, 64 * 9 + 20] {
        texture.pixels[k] = Rgb::new(90.0, 70.0, 50.0);
    }
    texture
}

fn lit_by(
    relighter: &Relighter,
    texture: Texture,
    rotate_degrees: f32,
    harmonics: Option<usize>,
) -> Lighting {
    let mut lighting = relighter.baked().clone();
    let image = Some(SkyImage { texture: Arc::new(texture), warnings: Vec::new() });
    lighting.sky = Some(SkyLight { constant: None, image, rotate_degrees, harmonics, ..SkyLight::DARK });
    lighting
}

#[test]
fn frames_of_skies_and_harmonics_agree() {
    for up in [glam::Vec3::Y, glam::Vec3::Z, glam::Vec3::NEG_X] {
        let image = Arc::new(sky::panorama(&banded(), 256));
        let turned = Sky::Image { image, to_image: sky::to_image(up, 40.0) };
        let found = turned.harmonics(up, 4);
        let direction = glam::Vec3::new(0.48, 0.6, 0.64);
        let (by_image, by_harmonics) =
            (turned.radiance(direction), found.radiance(sky::to_harmonics(up) * direction));
        // Bilinear look-ups flatten by 10⁻⁴ of each of the 16 functions, twice.
        assert!((by_image - by_harmonics).abs().max_element() < 2.0e-3, "{by_image} {by_harmonics}");
        let own = banded().turned(40.0);
        for (a, b) in found.coefficients.iter().zip(&own.coefficients) {
            assert!((*a - *b).abs().max_element() < 5.0e-4, "{a} {b}");
        }
    }
    // The documented axes, for +y up: (z, x, y).
    let frame = sky::to_harmonics(glam::Vec3::Y);
    assert!((frame * glam::Vec3::new(1.0, 2.0, 3.0) - glam::Vec3::new(3.0, 1.0, 2.0)).length() < 1e-5);
}

#[test]
fn sums_of_transfers_are_solutions() {
    let folder = court(EVEN);
    let job = bake(folder.path(), 0.1);
    let mut summed = Relighter::open(&job).unwrap();
    let report = summed.prepare_sky(4).unwrap();
    assert!(report.converged, "{report:?}");
    let mut solved = Relighter::open(&job).unwrap();
    solved.params_mut().error = 1.0e-6;
    for (texture, degrees, order) in
        [(sunny(), 0.0, 4), (sunny(), 77.0, 4), (sky::panorama(&banded(), 64), 10.0, 2)]
    {
        let lighting = lit_by(&summed, texture, degrees, Some(order));
        let sum = summed.relight(&lighting).unwrap();
        assert!(sum.superposed && sum.iterations == 0 && sum.rays == 0, "{sum:?}");
        // Without transfers it is solved for, from the same rays.
        assert!(!solved.relight(&lighting).unwrap().superposed);
        // Transfers of one band err by 10⁻⁶ of themselves, and a sum may be a few times smaller than its parts.
        let off = relative(summed.radiosity(), solved.radiosity());
        assert!(off < 1.0e-5, "{off}");
        let off = relative(summed.irradiance(), solved.irradiance());
        assert!(off < 1.0e-5, "{off}");
    }
}

#[test]
fn a_banded_sky_is_its_harmonics() {
    let folder = court(EVEN);
    let job = bake(folder.path(), 0.1);
    let mut relighter = Relighter::open(&job).unwrap();
    relighter.prepare_sky(4).unwrap();
    for degrees in [0.0, 135.0] {
        let as_it_is = lit_by(&relighter, sky::panorama(&banded(), 256), degrees, None);
        assert!(!relighter.relight(&as_it_is).unwrap().superposed);
        let points: Vec<_> =
            (0..200).map(|s| relighter.model().sites.point(glowtree::sites::SiteId(s))).collect();
        let (exact, answers) = (relighter.radiosity().to_vec(), relighter.evaluate(&points));
        let seen = lit_by(&relighter, sky::panorama(&banded(), 256), degrees, Some(4));
        assert!(relighter.relight(&seen).unwrap().superposed);
        // The same rays see both; bilinear look-ups of the image err by 10⁻⁴ of a function.
        let off = relative(relighter.radiosity(), &exact);
        assert!(off < 1.0e-3, "{off}");
        let total = |all: &[glowtree::solve::Irradiance]| all.iter().map(|i| i.total()).collect::<Vec<Rgb>>();
        let off = relative(&total(&relighter.evaluate(&points)), &total(&answers));
        assert!(off < 1.0e-3, "{off} at points");
    }
}

#[test]
fn other_images_are_relit_as_baked() {
    let folder = court(EVEN);
    let job = bake(folder.path(), 0.05);
    let mut relighter = Relighter::open(&job).unwrap();
    relighter.params_mut().error = 1.0e-5;
    let lighting = lit_by(&relighter, sunny(), 30.0, None);
    let report = relighter.relight(&lighting).unwrap();
    assert!(report.rays > 0 && report.converged, "its sun is looked at: {report:?}");
    let relit = relighter.radiosity().to_vec();
    // Harmonics and back: the sun's links stay.
    let banded = lit_by(&relighter, sunny(), 30.0, Some(3));
    relighter.relight(&banded).unwrap();
    assert!(relative(relighter.radiosity(), &relit) > 0.01, "a sun of three bands is no sun");
    let again = relighter.relight(&lighting).unwrap();
    assert_eq!(again.rays, 0);
    let off = relative(relighter.radiosity(), &relit);
    assert!(off < 1.0e-4, "{off}");
}

#[test]
fn negative_light_is_the_difference_of_positive() {
    // T of Y_i against c (T of 1 + Y_i / c, less T of 1): the same rays, solved without signs.
    let folder = court(EVEN);
    let job = bake(folder.path(), 0.1);
    let mut signed = Relighter::open(&job).unwrap();
    signed.prepare_sky(4).unwrap();
    let mut plain = Relighter::open(&job).unwrap();
    plain.params_mut().error = 1.0e-6;
    let mut solve = |coefficients: Vec<Rgb>| {
        let texture = sky::panorama(&Harmonics { coefficients }, 128);
        let lighting = lit_by(&signed, texture, 0.0, Some(4));
        assert!(!plain.relight(&lighting).unwrap().superposed);
        plain.radiosity().to_vec()
    };
    let one = Harmonics::constant(Rgb::ONE, 4).coefficients;
    let even = solve(one.clone());
    for number in [1, 7, 11, 15] {
        let mut lifted = one.clone();
        lifted[number] += Rgb::splat(0.8);
        let lifted = solve(lifted);
        let difference: Vec<Rgb> = lifted.iter().zip(&even).map(|(a, b)| (*a - *b) / 0.8).collect();
        let off = relative(&signed.sky_transfer(number).unwrap().radiosity, &difference);
        // Two solutions' errors of 10⁻⁶ of a light some ten to thirty times as large, and an image's of 4 10⁻⁴ of a wave.
        println!("function {number}: {off:.1e} off");
        assert!(off < 2.0e-3, "{number}: {off}");
        let worst = signed.sky_transfer(number).unwrap().radiosity.iter().map(|b| b.min_element());
        assert!(worst.fold(0.0, f32::min) < 0.0 || number == 0, "a wave has negative light");
    }
    assert!(signed.sky_transfer(MOST).is_none());
}
