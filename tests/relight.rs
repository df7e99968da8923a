//! Relighting: sums of lights are solutions, relit jobs are what bakes with these lights are, and what has no meaning is refused.

#![allow(clippy::unwrap_used)] // a test that cannot go on panics where it stands

mod command;

use std::path::{Path, PathBuf};

use command::{Place, code, stderr, stdout};
use glowtree::bake::{self, Lighting, Options, Relighter, Silent};
use glowtree::geometry::SurfacePoint;
use glowtree::light::Rgb;
use glowtree::sites::SiteId;

/// A scene of the tree in a folder where its text may be edited.
struct Stage {
    folder: tempfile::TempDir,
    text: String,
}

impl Stage {
    fn new(name: &str, more: &str) -> Self {
        let data: PathBuf = [env!("CARGO_MANIFEST_DIR"), "data", name].iter().collect();
        let folder = tempfile::tempdir().unwrap();
        for entry in std::fs::read_dir(&data).unwrap() {
            let path = entry.unwrap().path();
            std::fs::copy(&path, folder.path().join(path.file_name().unwrap())).unwrap();
        }
        std::fs::write(folder.path().join("sky.hdr"), waves()).unwrap();
        let text = std::fs::read_to_string(data.join("scene.toml")).unwrap() + more;
        Self { folder, text }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Bakes the scene, with its text edited, into a job; in one that is there the operator stays.
    fn bake(&self, job: &str, error: f64, edits: &[(&str, &str)]) {
        let options = Options { error, preview: false, ..Options::default() };
        self.bake_by(job, &options, edits);
    }

    fn bake_by(&self, job: &str, options: &Options, edits: &[(&str, &str)]) {
        let edited = edits.iter().fold(self.text.clone(), |text, (from, to)| {
            assert!(text.contains(from), "{from} is not in {text}");
            text.replace(from, to)
        });
        std::fs::write(self.path("scene.toml"), edited).unwrap();
        bake::run(&self.path("scene.toml"), &self.path(job), options, &Silent).unwrap();
    }
}

/// A sky of soft waves, 32 × 16 pixels in Radiance's format: no part of it is bright enough to be a lamp.
fn waves() -> Vec<u8> {
    let mut bytes = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16 +X 32\n".to_vec();
    for pixel in 0..512u32 {
        let turn = std::f64::consts::TAU * f64::from(pixel % 32) / 32.0;
        let tall = 0.5 + f64::from(16 - pixel / 32) / 32.0;
        let value = |phase: f64| (60.0 * tall * (1.0 + 0.6 * (turn + phase).sin())) as u8;
        bytes.extend([value(0.0), value(1.0), value(2.5), 128]);
    }
    bytes
}

fn open(job: &Path) -> Relighter {
    Relighter::open(job).unwrap()
}

fn set(relighter: &Relighter, changes: &[&str]) -> Lighting {
    let mut lighting = relighter.baked().clone();
    changes.iter().for_each(|change| lighting.set(relighter.scene(), change).unwrap());
    lighting
}

/// RMS of the differences over that of the values.
fn relative(a: &[Rgb], b: &[Rgb]) -> f64 {
    let square = |v: Rgb| v.as_dvec3().length_squared();
    let difference: f64 = a.iter().zip(b).map(|(a, b)| square(*a - *b)).sum();
    (difference / b.iter().map(|b| square(*b)).sum::<f64>()).sqrt()
}

/// Lights of three more kinds for the Cornell box.
const MORE: &str = "\n[[lamp]]\nkind = \"point\"\nname = \"bulb\"\nposition = [1.0, 4.5, 1.0]\nintensity = [3, 2, 4]\n\
    \n[[lamp]]\nkind = \"sun\"\nname = \"sun\"\ndirection = [0.2, -0.3, 1.0]\nirradiance = [2, 2, 1]\n\
    \n[sky]\nradiance = [0.5, 0.6, 0.9]\n";

/// Lights for the crater, which is open and has a sun.
const OPEN: &str = "\n[[lamp]]\nkind = \"point\"\nname = \"bulb\"\nposition = [0.2, -0.3, 0.1]\nintensity = [0.3, 0.2, 0.1]\n\
    \n[sky]\nfile = \"sky.hdr\"\nrotate = 20\n";

#[test]
fn sums_of_lights_are_solutions() {
    let stage = Stage::new("cornell", MORE);
    stage.bake("job", 0.1, &[]);
    // Solved for here, not read: tests/transfer.rs looks at what the job holds.
    std::fs::remove_file(stage.path("job").join(bake::transfer::FILE)).unwrap();
    let mut summed = open(&stage.path("job"));
    let points: Vec<SurfacePoint> = (0..50).map(|s| summed.model().sites.point(SiteId(s))).collect();
    let before = summed.evaluate(&points);
    let report = summed.prepare().unwrap();
    assert!(report.converged && report.iterations > 0, "{report:?}");
    assert!(summed.evaluate(&points) == before, "preparing changes no light");
    let mut solved = open(&stage.path("job"));
    solved.params_mut().error = 1e-6;
    for changes in [
        &["light.radiance=1,20,3"][..],
        &["bulb.intensity=0.5,9,0", "sky.radiance=2,0.1,0"],
        &["light.scale=0", "sun.scale=3"],
    ] {
        let lighting = set(&summed, changes);
        let (sum, solution) = (summed.relight(&lighting).unwrap(), solved.relight(&lighting).unwrap());
        assert!(sum.superposed && !solution.superposed && solution.converged, "{sum:?} {solution:?}");
        // Columns and solution are asked for 1e-6 of themselves; f32 stops residuals at 1e-6, 1e-6 / (1 − 0.76) as an error.
        let off = relative(summed.radiosity(), solved.radiosity());
        let off_receivers = relative(summed.irradiance(), solved.irradiance());
        println!("{changes:?}: radiosity off by {off:.1e}, irradiance by {off_receivers:.1e}");
        assert!(off < 1e-5 && off_receivers < 1e-5, "{changes:?}: {off:e}, {off_receivers:e}");
    }
}

/// Relights a job, and compares with jobs baked with these lights: with its operator, and afresh.
fn as_baked(scene: (&str, &str), error: f64, changes: &[&str], edits: &[(&str, &str)]) -> (f64, f64) {
    let stage = Stage::new(scene.0, scene.1);
    stage.bake("job", error, &[]);
    let mut relighter = open(&stage.path("job"));
    let report = relighter.relight(&set(&relighter, changes)).unwrap();
    assert!(report.converged, "{report:?}");
    stage.bake("job", error, edits);
    stage.bake("fresh", error, edits);
    let (kept, fresh) = (bake::open(&stage.path("job")).unwrap(), bake::open(&stage.path("fresh")).unwrap());
    let sites = &fresh.model().sites;
    let points: Vec<SurfacePoint> =
        (0..sites.len()).step_by(sites.len().div_ceil(2000)).map(|s| sites.point(SiteId(s as u32))).collect();
    let light = |all: &[glowtree::solve::Irradiance]| {
        all.iter().map(glowtree::solve::Irradiance::total).collect::<Vec<Rgb>>()
    };
    let relit = light(&relighter.evaluate(&points));
    let offs =
        [kept.evaluate(&points), fresh.evaluate(&points)].map(|truth| relative(&relit, &light(&truth)));
    println!(
        "{scene:?}, {changes:?}: {:.4} % off the same operator, {:.3} % off a fresh bake",
        1e2 * offs[0],
        1e2 * offs[1]
    );
    println!("   {report:?}");
    (offs[0], offs[1])
}

#[test]
fn relit_jobs_are_bakes_with_these_lights() {
    let error = 0.02;
    // Same points, same rays, or sites and rays that lie elsewhere for other lights: a tenth of the target is left for both.
    let tenth = 0.1 * error;
    let grey = "albedo = [0.725, 0.71, 0.68]";
    for (scene, changes, edits) in [
        (
            ("cornell", ""),
            &[
                "light.radiance=5,20,9",
                "red.albedo=0.1,0.2,0.6",
                "white.albedo=0.5",
                "short_block.albedo=0.5",
                "tall_block.albedo=0.5",
            ][..],
            &[
                ("[18.387, 13.9873, 6.75357]", "[5, 20, 9]"),
                ("[0.63, 0.065, 0.05]", "[0.1, 0.2, 0.6]"),
                (grey, "albedo = [0.5, 0.5, 0.5]"),
            ][..],
        ),
        (
            ("rooms", ""),
            &[
                "light.radiance=4,18,30",
                "walls.albedo=0.4,0.5,0.6",
                "table.albedo=0.4,0.5,0.6",
                "door.albedo=0.4,0.5,0.6",
            ],
            &[
                ("[20, 18, 15]", "[4, 18, 30]"),
                ("albedo = [0.75, 0.72, 0.66]\nsides", "albedo = [0.4, 0.5, 0.6]\nsides"),
            ],
        ),
        (
            ("crater", OPEN),
            &[
                "sky.rotate=130",
                "bulb.intensity=0.2,0.5,0.3",
                "sun.irradiance=0.5,0.4,0.2",
                "cap.albedo=0.7,0.3,0.5",
            ],
            &[
                ("rotate = 20", "rotate = 130"),
                ("[0.3, 0.2, 0.1]", "[0.2, 0.5, 0.3]"),
                ("irradiance = [1, 1, 1]", "irradiance = [0.5, 0.4, 0.2]"),
                ("albedo = [0.5, 0.5, 0.5]", "albedo = [0.7, 0.3, 0.5]"),
            ],
        ),
    ] {
        let (kept, fresh) = as_baked(scene, error, changes, edits);
        assert!(kept < tenth && fresh < tenth, "{scene:?}: {kept}, {fresh}");
    }
}

#[test]
fn new_and_moved_lamps_are_looked_at() {
    let stage = Stage::new("cornell", &MORE.replace("[3, 2, 4]", "[0, 0, 0]"));
    let options = Options { error: 0.05, preview: false, relightable: Some(false), ..Options::default() };
    stage.bake_by("job", &options, &[]);
    let mut relighter = open(&stage.path("job"));
    let dark = relighter.relight(&set(&relighter, &["sky.scale=2"])).unwrap();
    let lighting = set(&relighter, &["bulb.intensity=3", "sun.direction=-0.2,-0.3,1"]);
    let report = relighter.relight(&lighting).unwrap();
    assert!(dark.rays == 0 && report.rays > 0 && report.warnings.len() == 1, "{dark:?} {report:?}");
    let points: Vec<SurfacePoint> = (0..1000).map(|s| relighter.model().sites.point(SiteId(s))).collect();
    let relit: Vec<Rgb> =
        relighter.evaluate(&points).iter().map(glowtree::solve::Irradiance::total).collect();
    stage.bake_by("job", &options, &[("[0, 0, 0]", "[3, 3, 3]"), ("[0.2, -0.3, 1.0]", "[-0.2, -0.3, 1.0]")]);
    let baked = bake::open(&stage.path("job")).unwrap();
    let truth: Vec<Rgb> = baked.evaluate(&points).iter().map(glowtree::solve::Irradiance::total).collect();
    // The rays of new links are the same but for their number, which goes by shares of the light: a tenth of the target.
    let off = relative(&relit, &truth);
    println!("new and moved lamps: {:.4} %, {} rays", 1e2 * off, report.rays);
    assert!(off < 0.005, "{off}");
    // Back again, nothing is looked at but what has moved.
    let back = relighter.relight(&relighter.baked().clone()).unwrap();
    assert!(back.rays > 0 && back.rays < report.rays, "{back:?}");
}

#[test]
fn darkness_is_dark_and_light_comes_back() {
    let stage = Stage::new("cornell", MORE);
    stage.bake("job", 0.1, &[]);
    let mut relighter = open(&stage.path("job"));
    let baked = relighter.radiosity().to_vec();
    let off = ["light", "bulb", "sun", "sky"].map(|name| format!("{name}.scale=0"));
    let dark = set(&relighter, &off.each_ref().map(String::as_str));
    relighter.relight(&dark).unwrap();
    assert!(relighter.radiosity().iter().all(|b| *b == Rgb::ZERO));
    let points: Vec<SurfacePoint> = (0..50).map(|s| relighter.model().sites.point(SiteId(s))).collect();
    assert!(relighter.evaluate(&points).iter().all(|light| light.total() == Rgb::ZERO));
    let back = relighter.baked().clone();
    relighter.relight(&back).unwrap();
    // Both are solved to a thirtieth of 10 %, or 3e-4, of themselves.
    let difference = relative(relighter.radiosity(), &baked);
    assert!(difference < 6e-4, "{difference:e}");
}

#[test]
fn threads_do_not_matter() {
    let stage = Stage::new("cornell", MORE);
    stage.bake("job", 0.1, &[]);
    let answers = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut relighter = open(&stage.path("job"));
            let painted = set(&relighter, &["white.albedo=0.3", "light.scale=2"]);
            relighter.relight(&painted).unwrap();
            let solved = relighter.radiosity().to_vec();
            relighter.prepare().unwrap();
            relighter.relight(&painted).unwrap();
            (solved, relighter.radiosity().to_vec())
        })
    };
    assert!(answers(1) == answers(3));
}

#[test]
fn nonsense_is_refused_and_names_what_is_meant() {
    let place = Place::new();
    place.baked("job");
    for (change, expected) in [
        ("lmap.intensity=1", "nearest valid name is `lamp`"),
        ("nothing-like-it.intensity=1", "valid names are corner, lamp, sky"),
        ("lamp.intensty=1", "nearest valid key is `intensity`"),
        ("lamp.radiance=1", "valid keys are intensity, position, scale"),
        ("corner.albedo=1,1,1", "outside [0, 1)"),
        ("corner.albedo=0.1,0.2", "found 2"),
        ("corner.radiance=-1", "negative"),
        ("corner.radiance=two", "no finite number"),
        ("corner.radiance=nan", "no finite number"),
        ("sky.rotate=20", "cannot be rotated"),
        ("corner.radiance", "expected NAME.KEY=VALUE"),
        ("corner=3", "expected NAME.KEY=VALUE"),
    ] {
        let output = place.run(&["relight", "job", "--set", change, "-o", "out.ply"]);
        assert_eq!(code(&output), 2, "{change}: {}", stderr(&output));
        assert!(stderr(&output).contains(expected), "{change}: {}", stderr(&output));
        assert!(!place.path("out.ply").exists(), "{change}");
    }
    for words in
        [&["relight", "job", "-o", "out.csv"][..], &["relight", "job", "-o", "out.obj"], &["relight", "job"]]
    {
        assert_eq!(code(&place.run(words)), 2, "{words:?}");
    }
    assert_eq!(code(&place.run(&["relight", "nowhere", "-o", "out.ply"])), 10);
}

#[test]
fn the_job_stays_and_unchanged_lights_answer_as_it_does() {
    let place = Place::new();
    place.baked("job");
    let files = || -> Vec<Vec<u8>> {
        ["scene", "sites", "links", "light"]
            .iter()
            .map(|n| std::fs::read(place.path(&format!("job/{n}.glow"))).unwrap())
            .collect()
    };
    let before = files();
    let probed = stdout(&place.run(&["probe", "job", "--points", "points.csv"]));
    let relit = place.run(&["relight", "job", "--points", "points.csv"]);
    assert_eq!(code(&relit), 0, "{}", stderr(&relit));
    let numbers = |table: &str| -> Vec<f64> {
        table
            .lines()
            .skip(1)
            .flat_map(|l| l.rsplit(',').take(6).map(|f| f.parse::<f64>().unwrap()).collect::<Vec<_>>())
            .collect()
    };
    for (a, b) in numbers(&probed).iter().zip(numbers(&stdout(&relit))) {
        // Solved to 3e-4 before, and once more.
        assert!((a - b).abs() <= 6e-4 * a.abs(), "{a} and {b}");
    }
    assert_eq!(code(&place.run(&["relight", "job", "--set", "lamp.scale=0", "-o", "dim.ply", "-q"])), 0);
    assert!(place.path("dim.ply").is_file() && files() == before);
}

#[test]
fn loose_solutions_are_as_good_as_they_are_asked_to_be() {
    let stage = Stage::new("cornell", MORE);
    stage.bake("job", 0.1, &[]);
    for paint in ["0.3,0.6,0.1", "0.95", "0", "0.7,0.5,0.9", "0.72,0.7,0.6"] {
        let [mut loose, mut tight] = [1e-2, 1e-6].map(|error| {
            let mut relighter = open(&stage.path("job"));
            relighter.params_mut().error = error;
            relighter
        });
        let change = format!("white.albedo={paint}");
        let lighting = set(&loose, &[&change, "light.scale=3"]);
        let (report, exact) = (loose.relight(&lighting).unwrap(), tight.relight(&lighting).unwrap());
        let off = relative(loose.irradiance(), tight.irradiance());
        println!("{change}: {} and {} products, {:.3} % off", report.iterations, exact.iterations, 1e2 * off);
        assert!(
            report.converged && exact.converged && report.iterations < exact.iterations,
            "{report:?} {exact:?}"
        );
        assert!(off < 1e-2, "{change}: {off}");
    }
}

#[test]
fn limited_bounces_stay_limited() {
    let stage = Stage::new("cornell", "");
    std::fs::write(stage.path("scene.toml"), &stage.text).unwrap();
    let options = Options { error: 0.1, max_bounces: Some(2), preview: false, ..Options::default() };
    bake::run(&stage.path("scene.toml"), &stage.path("job"), &options, &Silent).unwrap();
    let mut relighter = open(&stage.path("job"));
    let baked = relighter.radiosity().to_vec();
    relighter.relight(&set(&relighter, &["light.scale=2"])).unwrap();
    let doubled: Vec<Rgb> = baked.iter().map(|b| *b * 2.0).collect();
    // The same sums of a few hundred terms, in f32.
    assert!(relative(relighter.radiosity(), &doubled) < 1e-5);
}

/// Two keys: the lamp goes dark while the sky and the camera change.
const KEYS: &str = "[[key]]\nframe = 0\nset = [\"sky.radiance=0\"]\n\
    [[key]]\nframe = 3\nset = [\"lamp.scale=0\", \"sky.radiance=1\"]\neye = [0.6, 0.6, 2.0]\n";

#[test]
fn sequences_resume_and_end_with_the_same_frames() {
    let place = Place::new();
    place.baked("job");
    std::fs::write(place.path("keys.toml"), KEYS).unwrap();
    let words = ["relight", "job", "--animate", "keys.toml", "-o", "frame_##.png", "--json"];
    let frames = || {
        (0..4).map(|k| std::fs::read(place.path(&format!("frame_{k:02}.png"))).unwrap()).collect::<Vec<_>>()
    };
    let first = place.run(&words);
    assert_eq!(code(&first), 0, "{}", stderr(&first));
    let whole = frames();
    assert!(whole.windows(2).all(|pair| pair[0] != pair[1]), "each frame differs");
    std::fs::remove_file(place.path("frame_02.png")).unwrap();
    let again = place.run(&words);
    let summary = command::lines(&again).pop().unwrap();
    assert_eq!(
        (summary["frames"].as_u64(), summary["kept_frames"].as_u64()),
        (Some(4), Some(3)),
        "{summary}"
    );
    assert!(frames() == whole);
    for (text, expected) in [
        ("[[key]]\nframe = 0\nsett = []\n", "nearest valid key is `set`"),
        ("[[key]]\nframe = 1\n[[key]]\nframe = 1\n", "key 2"),
        ("[[key]]\nframe = 0\nset = [\"lmap.scale=1\"]\n", "nearest valid name is `lamp`"),
        ("", "no keys"),
    ] {
        std::fs::write(place.path("bad.toml"), text).unwrap();
        let output = place.run(&["relight", "job", "--animate", "bad.toml", "-o", "bad_#.ply"]);
        assert_eq!(code(&output), 4, "{text}: {}", stderr(&output));
        assert!(stderr(&output).contains(expected), "{text}: {}", stderr(&output));
    }
    let output = place.run(&["relight", "job", "--animate", "keys.toml", "-o", "frame.png"]);
    assert_eq!(code(&output), 2, "{}", stderr(&output));
}
