//! Meshes that stay in their files: the same light as in memory, the same bytes however often the bake was stopped, and
//! damage that is told.

mod command;
mod shapes;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use command::{Place, code, stderr, stdout};
use glowtree::archive::Digest;
use glowtree::bake::{self, Monitor, Options, Signal};
use glowtree::geometry::{SurfacePoint, hash};
use glowtree::output::vertices;
use glowtree::scene;

/// A bumpy ball of some 80,000 triangles over a floor that is held, under a sky and a lamp.
struct Ball {
    folder: tempfile::TempDir,
}

const SCENE: &str = r#"
[[mesh]]
file = "ball.ply"
albedo = [0.7, 0.6, 0.5]

[[mesh]]
file = "floor.ply"
albedo = [0.5, 0.5, 0.5]

[[lamp]]
kind = "sun"
direction = [0.3, -1, 0.2]
irradiance = [1, 1, 0.9]

[sky]
radiance = [1, 1, 1]
"#;

const RINGS: u32 = 200;

impl Ball {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        std::fs::write(folder.path().join("scene.toml"), SCENE).expect("writing the scene");
        std::fs::write(folder.path().join("ball.ply"), ball()).expect("writing the ball");
        let floor = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
            element face 2\nproperty list uchar int vertex_indices\nend_header\n\
            -2 -1.2 -2\n-2 -1.2 2\n2 -1.2 2\n2 -1.2 -2\n3 0 1 2\n3 0 2 3\n";
        std::fs::write(folder.path().join("floor.ply"), floor).expect("writing the floor");
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn bake(&self, job: &str, options: &Options) -> bake::Summary {
        bake::run(&self.path("scene.toml"), &self.path(job), options, &bake::Silent).expect(job)
    }
}

/// Rings of quads, halved; waves of two lengths along the radius.
fn ball() -> String {
    let columns = RINGS;
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        (RINGS + 1) * columns,
        2 * RINGS * columns
    );
    for i in 0..=RINGS {
        for j in 0..columns {
            let (a, b) = (
                std::f64::consts::PI * f64::from(i) / f64::from(RINGS),
                std::f64::consts::TAU * f64::from(j) / f64::from(columns),
            );
            let r =
                1.0 + 0.03 * (9.0 * a).sin() * (8.0 * b).cos() + 0.004 * (40.0 * a).sin() * (44.0 * b).sin();
            let at = [a.sin() * b.cos(), a.cos(), a.sin() * b.sin()].map(|v| v * r);
            let _ = writeln!(text, "{} {} {}", at[0], at[1], at[2]);
        }
    }
    for i in 0..RINGS {
        for j in 0..columns {
            let next = (j + 1) % columns;
            let [a, b, c, d] =
                [i * columns + j, i * columns + next, (i + 1) * columns + next, (i + 1) * columns + j];
            let _ = write!(text, "3 {a} {b} {c}\n3 {a} {c} {d}\n");
        }
    }
    text
}

fn options(error: f64) -> Options {
    Options { error, resident: Some(1000), ..Options::default() }
}

/// The column of a binary PLY's vertices that is called so.
fn column(path: &Path, name: &str) -> Vec<f32> {
    let bytes = std::fs::read(path).expect("reading the mesh");
    let body = bytes.windows(11).position(|w| w == b"end_header\n").expect("a header") + 11;
    let header = String::from_utf8_lossy(&bytes[..body]).into_owned();
    let (mut stride, mut at, mut count, mut of_vertex) = (0, None, 0, false);
    for line in header.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["element", kind, rows] => {
                of_vertex = kind == "vertex";
                count = if of_vertex { rows.parse().expect("a count") } else { count };
            }
            ["property", kind, property] if of_vertex => {
                at = if property == name { Some(stride) } else { at };
                stride += if kind == "uchar" { 1 } else { 4 };
            }
            _ => {}
        }
    }
    let at = body + at.expect("a column of that name");
    let word = |row: usize| bytes[at + row * stride..][..4].try_into().expect("four bytes");
    (0..count).map(|row| f32::from_le_bytes(word(row))).collect()
}

/// Names and digests of what a job is for.
fn digests(job: &Path) -> Vec<(String, String)> {
    let mut names: Vec<String> = std::fs::read_dir(job)
        .expect("the job")
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| name.ends_with(".glow") || name.ends_with(".ply") || name.ends_with(".png"))
        .collect();
    names.sort();
    let digest = |name: String| {
        let digest = Digest::of_file(job.join(&name)).expect("a digest");
        (name, digest.to_string())
    };
    names.into_iter().map(digest).collect()
}

#[test]
fn the_light_is_that_of_the_mesh_in_memory() {
    let ball = Ball::new();
    let error = 0.02;
    let summary = ball.bake("streamed.glow", &options(error));
    // Own rows of 2,048 rays on the mesh itself: noise below 0.2 %.
    let whole = scene::load(&ball.path("scene.toml")).expect("the scene");
    let counts = (whole.triangles.len() as u64, whole.vertices.len() as u64);
    assert_eq!((summary.triangles, summary.vertices), counts, "what has no area is left out alike");
    let held = Options { error: 0.005, preview: false, ..Options::default() };
    ball.bake("held.glow", &held);
    let held = bake::open(&ball.path("held.glow")).expect("the job");
    let normals = vertices::normals(&whole);
    let channels =
        ["r", "g", "b"].map(|c| column(&ball.path("streamed.glow/mesh.ply"), &format!("irradiance_{c}")));
    assert_eq!(channels[0].len(), ((RINGS + 1) * RINGS) as usize);
    let chosen: Vec<usize> = (0..3000)
        .map(|i| (f64::from(hash::unit(5, i)) * channels[0].len() as f64) as usize)
        // The poles are fans of slivers around one point.
        .filter(|v| (2 * RINGS as usize..(RINGS as usize - 1) * RINGS as usize).contains(v))
        .collect();
    let points: Vec<SurfacePoint> =
        chosen.iter().map(|&v| SurfacePoint { position: whole.vertices[v], normal: normals[v] }).collect();
    let (mut square, mut mean) = (0.0, 0.0);
    for (&v, light) in chosen.iter().zip(held.evaluate(&points)) {
        for (k, channel) in channels.iter().enumerate() {
            square += f64::from(channel[v] - light.total()[k]).powi(2);
            mean += f64::from(light.total()[k]);
        }
    }
    let n = 3.0 * chosen.len() as f64;
    let rms = (square / n).sqrt() / (mean / n);
    // The judge of the held job errs by up to 0.5 % itself.
    assert!(rms < error.hypot(0.005), "{:.2} % from the mesh in memory at a target of 2 %", 100.0 * rms);
    assert!(rms > 1e-6, "two bakes of different kinds do not agree to the last bit");
}

/// Asks to stop at the n-th time that it is asked.
struct StopAt(AtomicU64);

impl Monitor for StopAt {
    fn interrupted(&self) -> Option<Signal> {
        let left = self.0.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1));
        left.is_err().then_some(Signal::Terminate)
    }
}

/// Stops that are one question further each.
const CUT: u64 = 16;

/// Bakes it undisturbed, and once more with stops: one question after the other at first, for a mesh that is cut has few of
/// them, then each farther than the one before, ever more. The same bytes.
fn stopped_again_and_again(ball: &Ball, options: &Options) {
    ball.bake("whole.glow", options);
    let job = ball.path("job.glow");
    let mut stops = 0u64;
    loop {
        let later = stops.saturating_sub(CUT);
        let asked = if stops < CUT { stops } else { 20 + 40 * later + 4 * later * later };
        let monitor = StopAt(AtomicU64::new(asked));
        match bake::run(&ball.path("scene.toml"), &job, options, &monitor) {
            Ok(_) => break,
            Err(error) => assert_eq!(error.exit_code(), 143, "{error}"),
        }
        stops += 1;
        assert!(stops < 300, "it does not get on");
    }
    assert!(stops > CUT + 4, "{stops} stops are too few to tell");
    assert_eq!(digests(&job), digests(&ball.path("whole.glow")), "after {stops} stops");
    assert!(!job.join("work").exists() && !job.join("scratch").exists());
    // Nothing is left to do, and nothing is done.
    let again = ball.bake("job.glow", options);
    assert_eq!(again.computed_blocks, 0);
}

#[test]
fn stopped_again_and_again_it_ends_with_the_same_bytes() {
    stopped_again_and_again(&Ball::new(), &options(0.1));
}

#[test]
fn vertices_in_memory_share_rows_and_stops_do_not_change_them() {
    let ball = Ball::new();
    let error = 0.05;
    let held = Options { error, ..Options::default() };
    stopped_again_and_again(&ball, &held);
    let job = bake::open(&ball.path("job.glow")).expect("the job");
    let normals = vertices::normals(job.scene());
    let points: Vec<SurfacePoint> = (2 * RINGS as usize..(RINGS as usize - 1) * RINGS as usize)
        .map(|v| SurfacePoint { position: job.scene().vertices[v], normal: normals[v] })
        .collect();
    let lights = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a small pool starts");
        pool.install(|| job.model().field().evaluate_crowd(&points))
    };
    let shared = lights(2);
    assert!(shared == lights(1), "the number of threads shows");
    let (mut square, mut mean, mut differ) = (0.0, 0.0, 0);
    for (shared, own) in shared.iter().zip(job.evaluate(&points)) {
        let (shared, own) = (shared.total(), own.total());
        square += f64::from((shared - own).length_squared()) / 3.0;
        mean += f64::from(own.element_sum()) / 3.0;
        differ += usize::from(shared != own);
    }
    let n = points.len() as f64;
    let rms = (square / n).sqrt() / (mean / n);
    // Both are to err by no more than the target, independently.
    assert!(rms < error * 2f64.sqrt(), "{:.2} % from points' own rows", 100.0 * rms);
    assert!(10 * differ > points.len(), "{differ} of {} vertices share rows: too few to tell", points.len());
}

#[test]
fn other_lights_keep_the_chunks_and_another_mesh_is_refused() {
    let ball = Ball::new();
    let options = options(0.1);
    ball.bake("job.glow", &options);
    let detail = |ball: &Ball| {
        let mut found = digests(&ball.path("job.glow"));
        found.retain(|(name, _)| name.starts_with("detail-"));
        found
    };
    // A link keeps the time of the writing.
    let written =
        |name: &str| ball.path("job.glow").join(name).metadata().expect("chunks").modified().expect("a time");
    let before = detail(&ball);
    assert_eq!(before.len(), 1);
    let first_written = written(&before[0].0);
    let light = |ball: &Ball| column(&ball.path("job.glow/mesh.ply"), "irradiance_r");
    let dim = light(&ball);
    std::fs::write(ball.path("scene.toml"), SCENE.replace("radiance = [1, 1, 1]", "radiance = [2, 2, 2]"))
        .expect("another sky");
    ball.bake("job.glow", &options);
    assert_eq!(detail(&ball), before);
    assert_eq!(written(&before[0].0), first_written, "the chunks were made again");
    let sum = |light: &[f32]| light.iter().map(|v| f64::from(*v)).sum::<f64>();
    // The sun stays: less than double, but much more than before.
    let ratio = sum(&light(&ball)) / sum(&dim);
    assert!((1.5..2.0).contains(&ratio), "{ratio}");
    let mesh = std::fs::read_to_string(ball.path("ball.ply")).expect("the ball");
    std::fs::write(ball.path("ball.ply"), mesh.replacen("-0", "-0.01", 3)).expect("another ball");
    let refused = || bake::run(&ball.path("scene.toml"), &ball.path("job.glow"), &options, &bake::Silent);
    let error = refused().expect_err("another mesh");
    assert_eq!(error.exit_code(), 3);
    assert!(error.to_string().contains("ball.ply"), "{error}");
    assert_eq!(detail(&ball), before, "it is refused before it is cut");
    // So is another frame: the chunks of the finished job lie in the old one.
    std::fs::write(ball.path("ball.ply"), mesh).expect("the ball as it was");
    let floor = std::fs::read_to_string(ball.path("floor.ply")).expect("the floor");
    std::fs::write(ball.path("floor.ply"), floor.replace("2 -1.2 2\n", "9 -1.2 2\n")).expect("a wider floor");
    let error = refused().expect_err("another frame");
    assert_eq!(error.exit_code(), 3);
    assert!(error.to_string().contains("extent"), "{error}");
    assert_eq!(detail(&ball), before);
    assert!(!ball.path("job.glow/scratch").exists());
    // Asked for, it is baked anew, and only chunks of the new frame stay.
    ball.bake("job.glow", &Options { restart: true, ..options.clone() });
    let after = detail(&ball);
    assert_eq!(after.len(), 1);
    assert_ne!(after, before);
}

#[test]
fn two_places_of_one_file_are_two_meshes() {
    let ball = Ball::new();
    let placed = |name: &str, x: f64| {
        format!(
            "[[mesh]]\nfile = \"ball.ply\"\nname = \"{name}\"\ntransform = {{ translate = [{x}, 0, 0] }}\n"
        )
    };
    let text = format!("{}{}[sky]\nradiance = [1, 1, 1]\n", placed("near", 0.0), placed("far", 5.0));
    std::fs::write(ball.path("scene.toml"), text).expect("two balls");
    ball.bake("job.glow", &Options { preview: false, ..options(0.1) });
    let job = bake::open(&ball.path("job.glow")).expect("the job");
    let boxes: Vec<[f64; 2]> =
        job.model().details.iter().map(|(_, detail)| detail.world_bounds().map(|at| at.x)).collect();
    assert_eq!(boxes.len(), 2);
    for side in 0..2 {
        // Exactly, but for the rounding of the sum.
        assert!((boxes[1][side] - boxes[0][side] - 5.0).abs() < 1e-12, "{boxes:?}");
    }
    let chunks = |k: usize| job.model().details[k].1.points(0).expect("the first chunk")[0];
    // The first chunk of each begins at the same vertex, five units apart.
    let apart = f64::from((chunks(1) - chunks(0)).x) * job.scene().placement.scale;
    assert!((apart - 5.0).abs() < 1e-5, "{apart}");
}

#[test]
fn a_mesh_that_is_refused_leaves_nothing() {
    let place = Place::new();
    let ball = Ball::new();
    let mesh = std::fs::read_to_string(ball.path("ball.ply")).expect("the ball");
    let last = mesh.trim_end().rfind('\n').expect("lines") + 1;
    std::fs::write(ball.path("ball.ply"), format!("{}3 0 1 999999\n", &mesh[..last])).expect("a bad face");
    let [scene, job] = ["scene.toml", "job.glow"].map(|name| ball.path(name).to_string_lossy().into_owned());
    let refused = place.run(&["bake", &scene, "-o", &job, "--resident", "1000"]);
    assert_eq!(code(&refused), 4, "{}", stderr(&refused));
    for word in ["ball.ply", "999999"] {
        assert!(stderr(&refused).contains(word), "{word} in {}", stderr(&refused));
    }
    assert!(!ball.path("job.glow").exists());
}

#[test]
fn damaged_chunks_are_named_and_nothing_wrong_is_answered() {
    let place = Place::new();
    let ball = Ball::new();
    ball.bake("job.glow", &options(0.1));
    let job = ball.path("job.glow");
    let (name, _) = digests(&job).into_iter().find(|(name, _)| name.starts_with("detail-")).expect("chunks");
    let mut bytes = std::fs::read(job.join(&name)).expect("the chunks");
    // In the middle of the first chunk's branches or packets, which take most of it.
    let at = bytes.len() / 5;
    bytes[at] ^= 0x10;
    std::fs::write(job.join(&name), &bytes).expect("damaging");
    let words = job.to_string_lossy().into_owned();
    let verified = place.run(&["verify", &words]);
    assert_eq!(code(&verified), 9);
    assert!(stderr(&verified).contains(&name) || stdout(&verified).contains(&name), "{}", stderr(&verified));
    let out = place.path("out.ply");
    let exported = place.run(&["export", &words, "-o", &out.to_string_lossy()]);
    assert_eq!((code(&exported), out.exists()), (9, false), "{}", stderr(&exported));
}

#[test]
fn damaged_and_lost_chunks_are_cut_again_to_the_same_bytes() {
    let place = Place::new();
    let ball = Ball::new();
    ball.bake("job.glow", &options(0.1));
    let job = ball.path("job.glow");
    let before = digests(&job);
    let (name, _) = before.iter().find(|(name, _)| name.starts_with("detail-")).expect("chunks");
    let file = job.join(name);
    let whole = std::fs::read(&file).expect("the chunks");
    let words = job.to_string_lossy().into_owned();
    let verified = place.run(&["verify", &words]);
    assert_eq!(code(&verified), 0, "an undisturbed job: {}{}", stdout(&verified), stderr(&verified));
    let repair = || place.run(&["verify", &words, "--repair"]);
    let flipped = |at: usize| {
        let mut bytes = whole.clone();
        bytes[at] ^= 0x10;
        bytes
    };
    let damages: [&dyn Fn(); 4] = [
        &|| std::fs::write(&file, flipped(whole.len() / 5)).expect("a flipped bit"),
        // The trailer: the file does not open.
        &|| std::fs::write(&file, flipped(whole.len() - 40)).expect("a flipped bit"),
        &|| std::fs::write(&file, &whole[..whole.len() / 2]).expect("half of it"),
        &|| std::fs::remove_file(&file).expect("nothing of it"),
    ];
    for (number, damage) in damages.iter().enumerate() {
        damage();
        assert_ne!(digests(&job), before, "damage {number}");
        let repaired = repair();
        assert_eq!(code(&repaired), 0, "damage {number}: {}", stderr(&repaired));
        assert_eq!(digests(&job), before, "damage {number}");
        assert_eq!(code(&place.run(&["verify", &words])), 0, "damage {number}");
    }
    let leftover = std::fs::read_dir(job.parent().expect("a folder")).expect("the folder");
    let temporary = |entry: std::io::Result<std::fs::DirEntry>| {
        entry.is_ok_and(|entry| entry.file_name().to_string_lossy().starts_with(".glowtree"))
    };
    assert!(!leftover.into_iter().any(temporary), "a temporary folder was left");
    // Chunks of another mesh are not taken, and the damaged ones stay as they are.
    damages[0]();
    let mesh = std::fs::read_to_string(ball.path("ball.ply")).expect("the ball");
    std::fs::write(ball.path("ball.ply"), mesh.replacen("-0", "-0.01", 3)).expect("another ball");
    let refused = repair();
    assert_eq!(code(&refused), 3, "{}", stderr(&refused));
    assert!(stderr(&refused).contains("ball.ply has changed"), "{}", stderr(&refused));
    assert_eq!(std::fs::read(&file).expect("the chunks"), flipped(whole.len() / 5));
}

#[test]
fn relit_it_answers_as_if_baked_so() {
    let ball = Ball::new();
    let place = Place::new();
    let error = 0.04;
    ball.bake("job.glow", &Options { preview: false, ..options(error) });
    let text = SCENE.replace("irradiance = [1, 1, 0.9]", "irradiance = [0.4, 0.8, 1.2]");
    let text = text.replace("radiance = [1, 1, 1]", "radiance = [0.9, 0.5, 0.2]");
    let text = text.replace("albedo = [0.7, 0.6, 0.5]", "albedo = [0.3, 0.5, 0.6]");
    std::fs::write(ball.path("scene.toml"), text).expect("other lights");
    ball.bake("fresh.glow", &options(error));
    let mut table = String::from("x,y,z,nx,ny,nz\n");
    let normals = vertices::normals(&scene::load(&ball.path("scene.toml")).expect("the scene"));
    let [x, y, z] = ["x", "y", "z"].map(|name| column(&ball.path("fresh.glow/mesh.ply"), name));
    // Vertices of the ball, whose poles are many at one place.
    for v in (2 * RINGS as usize..(RINGS as usize - 1) * RINGS as usize).step_by(197) {
        let n = normals[v];
        let _ = writeln!(table, "{},{},{},{},{},{}", x[v], y[v], z[v], n.x, n.y, n.z);
    }
    std::fs::write(place.path("ball.csv"), table).expect("the points");
    let [job, fresh] = ["job.glow", "fresh.glow"].map(|name| ball.path(name).to_string_lossy().into_owned());
    let changes = ["lamp.irradiance=0.4,0.8,1.2", "sky.radiance=0.9,0.5,0.2", "ball.albedo=0.3,0.5,0.6"];
    let sets: Vec<&str> = changes.iter().flat_map(|change| ["--set", change]).collect();
    let numbers = |words: &[&str]| -> Vec<f64> {
        let output = place.run(words);
        assert_eq!(code(&output), 0, "{words:?}: {}", stderr(&output));
        let light =
            |line: &str| line.split(',').skip(6).take(6).map(str::parse).collect::<Result<Vec<f64>, _>>();
        stdout(&output).lines().skip(1).flat_map(|line| light(line).expect("numbers")).collect()
    };
    let relit = numbers(&[&["relight", &job, "--points", "ball.csv"][..], &sets].concat());
    let baked = numbers(&["probe", &fresh, "--points", "ball.csv"]);
    let before = numbers(&["probe", &job, "--points", "ball.csv"]);
    let off = |a: &[f64], b: &[f64]| {
        assert_eq!(a.len(), b.len());
        let square: f64 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
        (square / b.iter().map(|b| b * b).sum::<f64>()).sqrt()
    };
    println!(
        "points: {:.2} % off a fresh bake, {:.0} % before",
        1e2 * off(&relit, &baked),
        1e2 * off(&before, &baked)
    );
    // Both err by the target, independently: √2 of it; the lights of before are far from it.
    assert!(off(&relit, &baked) < 1.5 * error && off(&before, &baked) > 0.2, "points");
    let out = place.path("out.ply").to_string_lossy().into_owned();
    let written = place.run(&[&["relight", &job, "-o", &out, "-q"][..], &sets].concat());
    assert_eq!(code(&written), 0, "{}", stderr(&written));
    for name in ["irradiance_r", "irradiance_b", "radiosity_g"] {
        let read = |path: &Path| column(path, name).into_iter().map(f64::from).collect::<Vec<f64>>();
        let (relit, baked) = (read(Path::new(&out)), read(&ball.path("fresh.glow/mesh.ply")));
        println!("{name} of {} vertices: {:.2} % off a fresh bake", relit.len(), 1e2 * off(&relit, &baked));
        assert!(off(&relit, &baked) < 1.5 * error, "{name}");
    }
}
