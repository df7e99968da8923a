//! Skies by their spherical harmonics: sums of transfers are solutions, whichever the sky and however turned, and what is stored
//! or exported says the same.

#![allow(clippy::unwrap_used)] // a test that cannot go on panics where it stands

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use glowtree::bake::relight::{SkyImage, SkyLight};
use glowtree::bake::transfer::{self, Stored};
use glowtree::bake::{self, Lighting, Monitor, Options, Relighter, Signal, Silent, verify};
use glowtree::light::Rgb;
use glowtree::light::harmonics::{Harmonics, MOST};
use glowtree::scene::{Sky, Texture, sky};
use glowtree::solve::relight::superpose;

/// Quads across each side of a surface of the court.
const ACROSS: usize = 6;

/// A surface by its corners, around; `first` is how many vertices there are before it.
fn surface(name: &str, corners: [[f32; 3]; 4], first: usize) -> String {
    let [a, b, c, d] = corners.map(glam::Vec3::from);
    let mut text = format!("o {name}\nusemtl {name}\n");
    let side = ACROSS + 1;
    for k in 0..side * side {
        let (u, v) = ((k % side) as f32 / ACROSS as f32, (k / side) as f32 / ACROSS as f32);
        let at = a.lerp(b, u).lerp(d.lerp(c, u), v);
        text += &format!("v {} {} {}\n", at.x, at.y, at.z);
    }
    for k in 0..ACROSS * ACROSS {
        let at = first + k / ACROSS * side + k % ACROSS + 1;
        text += &format!("f {at} {} {} {}\n", at + 1, at + side + 1, at + side);
    }
    text
}

/// Floor, three walls and a roof over half of it: light from outside is occluded and reflected.
fn surfaces() -> String {
    let corners = |k: usize| {
        let x = [-1.0, 1.0, 0.0][k % 3];
        [x, [0.0, 1.0][k / 3 % 2], [-1.0, 1.0][k / 6]]
    };
    // Corners are numbered by x in −1, 1, 0; y in 0, 1; z in −1, 1.
    let walls = [
        ("floor", [0, 6, 7, 1]),
        ("back", [0, 1, 4, 3]),
        ("left", [0, 3, 9, 6]),
        ("right", [1, 7, 10, 4]),
        ("roof", [3, 5, 11, 9]),
    ];
    let each = (ACROSS + 1) * (ACROSS + 1);
    let texts = walls.iter().enumerate().map(|(k, (name, own))| surface(name, own.map(corners), k * each));
    texts.collect()
}

/// The court as an OBJ beside a scene of it; the folder it is in.
fn court(sky: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let text = format!("mtllib court.mtl\n{}", surfaces());
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

/// Scenes of several lights are baked for relighting by the sky's harmonics, too.
fn options(folder: &Path, error: f64) -> Options {
    let several = std::fs::read_to_string(folder.join("scene.toml")).unwrap().contains("[[lamp]]");
    Options { error, preview: false, relightable: several.then_some(true), ..Options::default() }
}

fn bake(folder: &Path, error: f64) -> PathBuf {
    let job = folder.join("job");
    bake::run(&folder.join("scene.toml"), &job, &options(folder, error), &Silent).unwrap();
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
    let frame = sky::to_harmonics(glam::Vec3::Z);
    assert!((frame * glam::Vec3::new(1.0, 2.0, 3.0) - glam::Vec3::new(-2.0, 1.0, 3.0)).length() < 1e-5);
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
        let total = |all: &[glowtree::solve::Irradiance]| {
            all.iter().map(glowtree::solve::Irradiance::total).collect::<Vec<Rgb>>()
        };
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
    // Σ cᵢ Tᵢ against what a sky 1 + Σ cᵢ Yᵢ does, less what an even one does: the same rays, solved without signs.
    let folder = court(EVEN);
    let job = bake(folder.path(), 0.1);
    let mut signed = Relighter::open(&job).unwrap();
    signed.prepare_sky(4).unwrap();
    let mut plain = Relighter::open(&job).unwrap();
    plain.params_mut().error = 1.0e-6;
    let one = Harmonics::constant(Rgb::ONE, 4).coefficients;
    for number in [1, 7, 11, 15] {
        let mut solve = |by: f32| {
            let mut coefficients = one.clone();
            coefficients[number] += Rgb::splat(by);
            let texture = sky::panorama(&Harmonics { coefficients }, 128);
            let lighting = lit_by(&signed, texture, 0.0, Some(4));
            assert!(!plain.relight(&lighting).unwrap().superposed);
            (plain.radiosity().to_vec(), plain.sky_harmonics(&lighting, 4).unwrap().coefficients)
        };
        let ((even, without), (lifted, with)) = (solve(0.0), solve(0.8));
        let difference: Vec<Rgb> = lifted.iter().zip(&even).map(|(a, b)| *a - *b).collect();
        let weights = with.iter().zip(&without).map(|(a, b)| *a - *b);
        let parts: Vec<_> = weights.enumerate().map(|(k, w)| (signed.sky_transfer(k).unwrap(), w)).collect();
        let (mut irradiance, mut radiosity) =
            (vec![Rgb::ZERO; parts[0].0.irradiance.len()], vec![Rgb::ZERO; difference.len()]);
        superpose(&parts, &mut irradiance, &mut radiosity);
        let off = relative(&radiosity, &difference);
        println!("function {number}: {off:.1e} off");
        // Two solutions' errors of 10⁻⁶ of a light some hundred times as large as the higher functions' at the most.
        assert!(off < 1.0e-4, "{number}: {off}");
        let least = signed.sky_transfer(number).unwrap().radiosity.iter().map(|b| b.min_element());
        assert!(least.fold(0.0, f32::min) < 0.0, "a wave has negative light");
    }
    assert!(signed.sky_transfer(MOST).is_none());
}

/// A lamp besides the sky: bakes of several lights keep transfers.
const LAMP_AND_SKY: &str = "[[lamp]]\nkind = \"point\"\nname = \"bulb\"\nposition = [0.3, 0.5, 0.2]\nintensity = [1, 0.8, 0.5]\n\
    [sky]\nradiance = [1, 1, 1]\n";

#[test]
fn stored_transfers_make_sums_without_a_solution() {
    let folder = court(LAMP_AND_SKY);
    let job = bake(folder.path(), 0.05);
    let stored = Stored::open(&job).unwrap().expect("a bake of two lights keeps transfers");
    assert_eq!(stored.len(), 2 + MOST);
    println!("{:.2} bytes a value, {} in all", stored.bytes_per_value(), stored.bytes());
    assert!(stored.bytes_per_value() < 2.6, "{}", stored.bytes_per_value());
    let mut summed = Relighter::open(&job).unwrap();
    std::fs::rename(job.join(transfer::FILE), folder.path().join("aside")).unwrap();
    let mut solved = Relighter::open(&job).unwrap();
    solved.params_mut().error = 1.0e-6;
    let mut lightings = vec![lit_by(&summed, sunny(), 200.0, Some(4)), summed.baked().clone()];
    lightings[0].set(summed.scene(), "bulb.intensity=0.1,0.4,2").unwrap();
    lightings[1].set(summed.scene(), "bulb.scale=0.25").unwrap();
    lightings[1].set(summed.scene(), "sky.radiance=0.1,0.2,3").unwrap();
    for lighting in &lightings {
        let sum = summed.relight(lighting).unwrap();
        assert!(sum.superposed && sum.iterations == 0 && sum.rays == 0, "{sum:?}");
        assert!(!solved.relight(lighting).unwrap().superposed);
        for off in [
            relative(summed.radiosity(), solved.radiosity()),
            relative(summed.irradiance(), solved.irradiance()),
        ] {
            println!("stored: {off:.1e} off");
            assert!(off < 1.0e-5, "{off}");
        }
    }
    // A lamp that moved is no more what is stored; other albedos are not either, and the baked ones are again.
    let mut moved = summed.baked().clone();
    moved.set(summed.scene(), "floor.albedo=0.9").unwrap_or_else(|_| {
        let name = summed.scene().meshes[0].name.clone();
        moved.set(summed.scene(), &format!("{name}.albedo=0.9")).unwrap();
    });
    assert!(!summed.relight(&moved).unwrap().superposed);
    assert!(summed.relight(&lightings[1]).unwrap().superposed);
    moved = summed.baked().clone();
    moved.set(summed.scene(), "bulb.position=-0.3,0.5,0").unwrap();
    assert!(!summed.relight(&moved).unwrap().superposed);
}

/// Stops when a stage has begun and was asked some times.
struct Stopping {
    stage: &'static str,
    asked: AtomicU32,
    begun: AtomicBool,
}

impl Monitor for Stopping {
    fn start(&self, stage: &str, _: &str, _: Option<u64>) {
        self.begun.fetch_or(stage == self.stage, Ordering::Relaxed);
    }

    fn interrupted(&self) -> Option<Signal> {
        let stops = self.begun.load(Ordering::Relaxed) && self.asked.fetch_add(1, Ordering::Relaxed) >= 12;
        stops.then_some(Signal::Interrupt)
    }
}

#[test]
fn transfers_are_the_same_after_interruptions_and_repairs() {
    let folder = court(LAMP_AND_SKY);
    let job = bake(folder.path(), 0.2);
    let file = job.join(transfer::FILE);
    let whole = std::fs::read(&file).unwrap();
    let found = verify::verify(&job, &Silent).unwrap();
    assert!(found.is_whole(), "{:?}", found.damages);

    let options = options(folder.path(), 0.2);
    let other = folder.path().join("other");
    let monitor = Stopping { stage: "transfer", asked: AtomicU32::new(0), begun: AtomicBool::new(false) };
    let stopped = bake::run(&folder.path().join("scene.toml"), &other, &options, &monitor);
    assert!(stopped.is_err() && !other.join(transfer::FILE).exists());
    bake::run(&folder.path().join("scene.toml"), &other, &options, &Silent).unwrap();
    assert!(
        std::fs::read(other.join(transfer::FILE)).unwrap() == whole,
        "the same bytes after an interruption"
    );

    let mut broken = whole.clone();
    let middle = broken.len() / 2;
    broken[middle] ^= 8;
    std::fs::write(&file, &broken).unwrap();
    let found = verify::verify(&job, &Silent).unwrap();
    assert!(found.damages.len() == 1 && found.damages[0].file == transfer::FILE, "{:?}", found.damages);
    let repaired = verify::repair(&job, &found, &Silent).unwrap();
    assert!(!repaired.rebaked && std::fs::read(&file).unwrap() == whole);

    std::fs::remove_file(&file).unwrap();
    let found = verify::verify(&job, &Silent).unwrap();
    assert_eq!(found.damages.len(), 1, "{:?}", found.damages);
    bake::run(&folder.path().join("scene.toml"), &job, &options, &Silent).unwrap();
    assert!(std::fs::read(&file).unwrap() == whole, "a bake makes again what was lost");

    // Those of another job are told apart and not used.
    let even = court(EVEN);
    let strange = bake(even.path(), 0.2);
    std::fs::copy(&file, strange.join(transfer::FILE)).unwrap();
    assert!(Stored::open(&strange).unwrap().is_none());
    assert!(!verify::verify(&strange, &Silent).unwrap().is_whole());
}

/// Vertices of a PLY that the program wrote: a number of a property each.
fn column(bytes: &[u8], wanted: &str) -> Vec<f32> {
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = String::from_utf8_lossy(&bytes[..end]).into_owned();
    let (mut offset, mut found, mut count) = (0, None, 0);
    for line in header.lines() {
        let words: Vec<&str> = line.split(' ').collect();
        match words[..] {
            ["element", "vertex", n] => count = n.parse().unwrap(),
            ["element", _, _] => break,
            ["property", kind, name] => {
                found = if name == wanted { Some(offset) } else { found };
                offset += if kind == "uchar" { 1 } else { 4 };
            }
            _ => {}
        }
    }
    let at = found.unwrap_or_else(|| panic!("{wanted} is not in {header}"));
    (0..count).map(|k| f32::from_le_bytes(bytes[end + k * offset + at..][..4].try_into().unwrap())).collect()
}

fn colours(bytes: &[u8], name: &str) -> Vec<Rgb> {
    let [r, g, b] = ["r", "g", "b"].map(|channel| column(bytes, &format!("{name}_{channel}")));
    (0..r.len()).map(|k| Rgb::new(r[k], g[k], b[k])).collect()
}

#[test]
fn vertices_have_their_transfers() {
    let folder = court(EVEN);
    bake(folder.path(), 0.02);
    let picture = sky::panorama(&banded(), 64);
    let pixel = |x: usize, y: usize| {
        let p = picture.pixels[y * 128 + x];
        (p.x, p.y, p.z)
    };
    exr::prelude::write_rgb_file(folder.path().join("sky.exr"), 128, 64, pixel).unwrap();
    let run = |words: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_glowtree"))
            .args(words)
            .current_dir(folder.path())
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    };
    run(&["export", "job", "-o", "out.ply", "--transfer", "4"]);
    let set = ["--set", "sky.file=sky.exr", "--set", "sky.rotate=70"];
    run(&[&["relight", "job", "-o", "lit.ply", "--harmonics", "4"][..], &set].concat());
    let [out, lit] = ["out.ply", "lit.ply"].map(|name| std::fs::read(folder.path().join(name)).unwrap());
    // The readers that there are read it.
    assert_eq!(
        glowtree::scene::load(&folder.path().join("out.ply")).unwrap().vertices.len(),
        colours(&out, "radiosity").len()
    );
    let weights = Harmonics::project(128, &picture.pixels, 4).turned(70.0).coefficients;
    let expected = colours(&lit, "radiosity");
    let mut sum = vec![Rgb::ZERO; expected.len()];
    for (k, weight) in weights.iter().enumerate() {
        let own = colours(&out, &format!("transfer_{k}"));
        sum.iter_mut().zip(own).for_each(|(sum, own)| *sum += own * *weight);
    }
    // An even sky's is what the file says of it: the same rows, weighed by the same fits. Sums of a hundred terms in f32: 1e-5.
    let even: Vec<Rgb> =
        colours(&out, "transfer_0").iter().map(|t| *t * (4.0 * std::f32::consts::PI).sqrt()).collect();
    let off = relative(&even, &colours(&out, "radiosity"));
    assert!(off < 2.0e-5, "{off} of an even sky");
    // Who gathers for himself is decided by the even sky here, by the sky itself there; vertices on an edge between walls that do so may look
    // past the edge. The worst hundredth is left out; others err by the bake's 2 % each way, √2 as much between both.
    let mut order: Vec<usize> = (0..sum.len()).collect();
    order.sort_unstable_by(|&a, &b| {
        let by = |k: usize| (sum[k] - expected[k]).length();
        by(a).total_cmp(&by(b))
    });
    order.truncate(sum.len() - sum.len().div_ceil(100));
    let usual = |all: &[Rgb]| order.iter().map(|&k| all[k]).collect::<Vec<Rgb>>();
    let (off, all) = (relative(&usual(&sum), &usual(&expected)), relative(&sum, &expected));
    println!("vertices: {off:.1e} off, {all:.1e} with the worst hundredth");
    assert!(off < 0.028, "{off}");
    let text = String::from_utf8_lossy(&out[..4000]).into_owned();
    assert!(text.contains("comment glowtree: transfer_i is the radiosity"), "{text}");

    run(&["export", "job", "-o", "out.glb", "--transfer", "2"]);
    let (document, buffers, _) = gltf::import(folder.path().join("out.glb")).unwrap();
    let primitive = document.meshes().next().unwrap().primitives().next().unwrap();
    let accessor = primitive.get(&gltf::Semantic::Extras("TRANSFER_3".into())).unwrap();
    let at = accessor.view().unwrap().offset() + accessor.offset();
    let first: Vec<f32> =
        buffers[0][at..at + 12].chunks(4).map(|word| f32::from_le_bytes(word.try_into().unwrap())).collect();
    assert_eq!(first, colours(&out, "transfer_3")[0].to_array(), "the same function, whatever the bands");
    assert!(primitive.get(&gltf::Semantic::Extras("TRANSFER_4".into())).is_none());
}
