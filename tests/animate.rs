//! Sequences: frames are what relighting to their values gives, a sequence that was killed ends with the same files, and layers of
//! lights add up to pictures.

#![allow(clippy::unwrap_used)] // a test that cannot go on panics where it stands

mod command;

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Stdio;

use command::{Place, code, lines, stderr};
use exr::prelude::{ReadChannels, ReadLayers, read};

/// More of the small scene: a lamp that moves, a sky with a picture, and a second camera, half way of the first one's flight.
const MORE: &str = "\n[[lamp]]\nkind = \"point\"\nname = \"bulb / 2\"\nposition = [0.2, 0.6, 0.3]\nintensity = [0.2, 0.4, 0.3]\n\
    \n[[camera]]\nname = \"half\"\neye = [0.75, 0.8, 2.25]\ntarget = [0.5, 0.3, 0.0]\nsize = [48, 32]\nfov = 40\n";

/// The scene with [`MORE`] and a sky of soft waves, baked.
fn baked() -> Place {
    let place = Place::new();
    let text = std::fs::read_to_string(place.path("scene.toml")).unwrap();
    let sky = "file = \"sky.hdr\"\nrotate = 20";
    std::fs::write(place.path("scene.toml"), text.replace("radiance = [0.2, 0.2, 0.2]", sky) + MORE).unwrap();
    std::fs::write(place.path("sky.hdr"), waves()).unwrap();
    place.baked("job");
    place
}

/// A picture of 16 × 8 pixels without bright part, in Radiance's format.
fn waves() -> Vec<u8> {
    let mut bytes = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X 16\n".to_vec();
    for pixel in 0..128u32 {
        let turn = std::f64::consts::TAU * f64::from(pixel % 16) / 16.0;
        let tall = 0.5 + f64::from(8 - pixel / 16) / 16.0;
        let value = |phase: f64| (60.0 * tall * (1.0 + 0.6 * (turn + phase).sin())) as u8;
        bytes.extend([value(0.0), value(1.0), value(2.5), 128]);
    }
    bytes
}

/// The channels of a picture by name.
fn channels(path: &Path) -> BTreeMap<String, Vec<f32>> {
    let image = read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
    let image = image.all_attributes().from_file(path).unwrap();
    let channel = |c: &exr::prelude::AnyChannel<exr::prelude::FlatSamples>| {
        (c.name.to_string(), c.sample_data.values_as_f32().collect())
    };
    image.layer_data.channel_data.list.iter().map(channel).collect()
}

/// Largest difference of two lists over the largest value.
fn apart(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    let largest = b.iter().fold(0.0f32, |m, v| m.max(v.abs()));
    a.iter().zip(b).fold(0.0f32, |m, (a, b)| m.max((a - b).abs())) / largest.max(f32::MIN_POSITIVE)
}

/// What a picture's light may differ by when the same sums are rounded to half precision, and lights were solved to 1e-6 from
/// elsewhere: 2⁻¹¹ and a little.
const HALF: f32 = 1.0 / 2048.0 + 1e-5;

fn run(place: &Place, words: &[&str]) {
    let output = place.run(words);
    assert_eq!(code(&output), 0, "{words:?}: {}", stderr(&output));
}

#[test]
fn layers_of_lights_add_up_to_the_picture() {
    let place = baked();
    run(&place, &["render", "job", "-o", "all.exr", "-q"]);
    run(&place, &["render", "job", "-o", "all.png", "-q"]);
    let all = channels(&place.path("all.exr"));
    let lights = ["lamp", "bulb___2", "sky"];
    assert_eq!(all.keys().filter(|name| name.starts_with("light.")).count(), 3 * lights.len());
    for channel in ["R", "G", "B"] {
        let layer = |light: &str| &all[&format!("light.{light}.{channel}")];
        let picture = &all[channel];
        for (k, whole) in picture.iter().enumerate() {
            let parts: f32 = lights.iter().map(|light| layer(light)[k]).sum();
            // The whole and its parts are rounded to half precision, 2⁻¹¹ of themselves; subnormal halves are 6e-8 apart.
            assert!(
                (parts - whole).abs() <= 2.0 * whole / 2048.0 + 3e-7,
                "{channel} {k}: {parts} of {whole}"
            );
        }
        // Each light does something of its own.
        for (a, b) in [(0, 1), (1, 2), (0, 2)] {
            assert!(apart(layer(lights[a]), layer(lights[b])) > 0.05, "{channel}: {a} and {b}");
        }
    }
    // A light alone is what relighting to it shows.
    let dark = ["--set", "lamp.scale=0", "--set", "sky.scale=0"];
    run(&place, &[&["relight", "job", "-o", "bulb.exr", "-q"][..], &dark].concat());
    let bulb = channels(&place.path("bulb.exr"));
    let off = apart(&all["light.bulb___2.G"], &bulb["G"]);
    assert!(off <= HALF && bulb.keys().filter(|name| name.starts_with("light.")).count() == 3, "{off}");
}

#[test]
fn frames_are_pictures_relit_to_their_values() {
    let place = baked();
    // Four frames of three lights; then the sky turns; then a lamp moves, and the camera from frame 8 on.
    let keys = "[[key]]\nframe = 0\n\n[[key]]\nframe = 4\nset = [\"lamp.intensity=0.5,2,3\", \"sky.scale=3\"]\n\
        \n[[key]]\nframe = 8\nset = [\"lamp.intensity=0.5,2,3\", \"sky.scale=3\", \"sky.rotate=100\"]\n\
        \n[[key]]\nframe = 10\nset = [\"lamp.intensity=0.5,2,3\", \"sky.scale=3\", \"sky.rotate=100\", \"lamp.position=0.7,0.6,0.5\"]\n\
        eye = [1.0, 0.9, 2.0]\n";
    std::fs::write(place.path("keys.toml"), keys).unwrap();
    run(&place, &["relight", "job", "--animate", "keys.toml", "-o", "f_##.exr", "-q"]);
    run(&place, &["relight", "job", "--animate", "keys.toml", "-o", "f_##.ply", "-q"]);
    for (frame, camera, values) in [
        (2, "front", &["lamp.intensity=0.75,1.5,2", "sky.scale=2"][..]),
        (6, "front", &["lamp.intensity=0.5,2,3", "sky.scale=3", "sky.rotate=60"]),
        (
            9,
            "half",
            &["lamp.intensity=0.5,2,3", "sky.scale=3", "sky.rotate=100", "lamp.position=0.6,0.7,0.5"],
        ),
    ] {
        let sets: Vec<&str> = values.iter().flat_map(|value| ["--set", value]).collect();
        for output in ["one.exr", "one.ply"] {
            run(&place, &[&["relight", "job", "--camera", camera, "-o", output, "-q"][..], &sets].concat());
        }
        let own = channels(&place.path(&format!("f_{frame:02}.exr")));
        let one = channels(&place.path("one.exr"));
        assert!(own.keys().eq(one.keys()), "{:?}", own.keys());
        for (name, values) in &one {
            let off = apart(&own[name], values);
            // The moved lamp's rays are as many as its share of the light asks, and solutions begin elsewhere: each errs by a
            // thirtieth of 20 %, at the most 3e-4, and may decide otherwise here and there.
            let most = if frame == 9 { 0.02 } else { HALF };
            assert!(off <= most, "frame {frame}, {name}: {off}");
        }
        let (own, one) = (light(&place.path(&format!("f_{frame:02}.ply"))), light(&place.path("one.ply")));
        let off = apart(&own, &one);
        // Solutions to 3e-4, each.
        assert!(off < if frame == 9 { 0.02 } else { 1e-3 }, "frame {frame}: vertices differ by {off}");
    }
}

/// Irradiance and what comes after it of the vertices of a binary PLY.
fn light(path: &Path) -> Vec<f32> {
    let bytes = std::fs::read(path).unwrap();
    let body = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = String::from_utf8_lossy(&bytes[..body]).into_owned();
    let (mut stride, mut columns, mut rows, mut vertex) = (0, Vec::new(), 0, false);
    for line in header.lines() {
        match line.split_whitespace().collect::<Vec<_>>()[..] {
            ["element", kind, count] => {
                vertex = kind == "vertex";
                rows = if vertex { count.parse().unwrap() } else { rows };
            }
            ["property", kind, name] if vertex => {
                if name.starts_with("irradiance") {
                    columns.push(stride);
                }
                stride += match kind {
                    "float" => 4,
                    "short" => 2,
                    "uchar" => 1,
                    other => panic!("{other}"),
                };
            }
            _ => {}
        }
    }
    assert_eq!(columns.len(), 3);
    let value = |at: usize| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    (0..rows).flat_map(|row| columns.iter().map(move |c| body + row * stride + c)).map(value).collect()
}

#[test]
fn a_sequence_that_is_killed_ends_with_the_same_frames() {
    let place = baked();
    // Sums, paint that changes, then a lamp that moves under another paint, then sums again.
    let keys = "[[key]]\nframe = 0\n\n[[key]]\nframe = 4\nset = [\"lamp.scale=2\", \"sky.scale=0.5\"]\n\
        \n[[key]]\nframe = 5\nset = [\"lamp.scale=2\", \"corner.albedo=0.7\"]\n\
        \n[[key]]\nframe = 7\nset = [\"corner.albedo=0.4\", \"bulb / 2.position=0.8,0.6,0.3\"]\n\
        \n[[key]]\nframe = 12\nset = [\"corner.albedo=0.4\", \"bulb / 2.position=0.8,0.6,0.3\", \"lamp.scale=0\"]\n";
    std::fs::write(place.path("keys.toml"), keys).unwrap();
    for ending in ["png", "exr", "ply"] {
        let files = |name: &str| -> Vec<Option<Vec<u8>>> {
            (0..13).map(|k| std::fs::read(place.path(&format!("{name}_{k:02}.{ending}"))).ok()).collect()
        };
        let words = |name: &str| {
            let pattern = format!("{name}_##.{ending}");
            ["relight", "job", "--animate", "keys.toml", "-o", &pattern, "--json"].map(str::to_owned)
        };
        let whole = words("whole");
        run(&place, &whole.each_ref().map(String::as_str));
        let expected = files("whole");
        assert!(expected.iter().all(Option::is_some));
        let cut = words("cut");
        let mut kills = 0;
        loop {
            let before = files("cut").iter().flatten().count();
            let mut child = place.command(&cut.each_ref().map(String::as_str));
            let mut child = child.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
            // Until there are three frames more, or it is done.
            while child.try_wait().unwrap().is_none() && files("cut").iter().flatten().count() < before + 3 {
                std::thread::sleep(std::time::Duration::from_millis(2));
            }
            if child.try_wait().unwrap().is_some() {
                break;
            }
            child.kill().unwrap();
            child.wait().unwrap();
            kills += 1;
            assert!(kills < 20, "it does not get on");
        }
        let again = place.run(&cut.each_ref().map(String::as_str));
        assert_eq!(lines(&again).pop().unwrap()["kept_frames"], 13, "{ending}");
        println!("{ending}: killed {kills} times");
        for (k, (cut, whole)) in files("cut").iter().zip(&expected).enumerate() {
            assert!(cut == whole, "{ending}: frame {k} differs");
        }
        // Any frame alone, too.
        for lost in [1, 6, 9] {
            std::fs::remove_file(place.path(&format!("cut_{lost:02}.{ending}"))).unwrap();
            run(&place, &cut.each_ref().map(String::as_str));
            assert!(files("cut") == expected, "{ending}: frame {lost}");
        }
    }
}

#[test]
fn what_stays_is_not_looked_at_again() {
    let place = baked();
    // Both lamps have places that no share of the way between equals but in exact numbers.
    let keys = "[[key]]\nframe = 0\neye = [0.51, 0.73, 2.37]\n\
        \n[[key]]\nframe = 11\nset = [\"lamp.scale=2\", \"bulb / 2.scale=0.3\", \"sky.scale=0.5\"]\neye = [0.51, 0.73, 2.37]\n";
    std::fs::write(place.path("keys.toml"), keys).unwrap();
    let output = place.run(&["relight", "job", "--animate", "keys.toml", "-o", "f_##.png", "--json"]);
    let summary = lines(&output).pop().unwrap();
    assert_eq!((&summary["rays"], &summary["pictures"]), (&0.into(), &3.into()), "{summary}");
    // A camera on the move takes a picture a frame.
    std::fs::write(place.path("keys.toml"), keys.replacen("0.51", "0.71", 1)).unwrap();
    let output = place.run(&["relight", "job", "--animate", "keys.toml", "-o", "g_##.png", "--json"]);
    let summary = lines(&output).pop().unwrap();
    assert_eq!((&summary["rays"], &summary["pictures"]), (&0.into(), &12.into()), "{summary}");
}
