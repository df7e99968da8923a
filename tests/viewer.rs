//! The page for browsers: what it holds is what the job says, and what it shows is what `render` shows.

#![allow(clippy::unwrap_used)] // a test that cannot go on panics where it stands

mod browser;

use std::path::Path;
use std::process::Command;

use browser::{chromium, escaped, grid, rms, shot, visit};
use glam::Vec3;
use glowtree::bake::model::Model;
use glowtree::bake::{self, Job, Options, Relighter};
use glowtree::geometry::SurfacePoint;
use glowtree::light::Rgb;
use glowtree::output::exposure;
use glowtree::output::picture::{Quality, View, render};
use glowtree::output::viewer::{self, Lit, Picture, ViewLight, ViewMesh};
use glowtree::solve::Irradiance;
use serde_json::{Value, json};

/// What a page has outside its blocks of numbers, and the blocks.
struct Page {
    text: String,
    header: Value,
}

impl Page {
    fn read(path: &Path) -> Self {
        let text = std::fs::read_to_string(path).unwrap();
        let header = serde_json::from_str(Self::within(&text, "header")).unwrap();
        Self { text, header }
    }

    fn within<'a>(text: &'a str, id: &str) -> &'a str {
        let (_, rest) = text.split_once(&format!("id=\"{id}\">")).unwrap();
        rest.split_once("</script>").unwrap().0
    }

    fn block(&self, id: &str) -> Vec<u8> {
        let text = Self::within(&self.text, id);
        let digit = |c: u8| match c {
            b'A'..=b'Z' => c - b'A',
            b'a'..=b'z' => c - b'a' + 26,
            b'0'..=b'9' => c - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => panic!("{c} in block {id}"),
        };
        let bytes = text.trim_end_matches('=').as_bytes().chunks(4).flat_map(|four| {
            let word =
                four.iter().enumerate().fold(0u32, |w, (k, &c)| w | u32::from(digit(c)) << (18 - 6 * k));
            word.to_be_bytes()[1..four.len()].to_vec()
        });
        bytes.collect()
    }

    fn words(&self, id: &str) -> Vec<u32> {
        self.block(id).chunks_exact(4).map(|four| u32::from_le_bytes(four.try_into().unwrap())).collect()
    }
}

fn baked(folder: &Path) -> Job {
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/cornell/scene.toml");
    let job = folder.join("cornell.glow");
    bake::run(&scene, &job, &Options { error: 0.05, ..Options::default() }, &bake::Silent).unwrap();
    bake::open(&job).unwrap()
}

/// The job's light as two: what comes from the lamp directly, the lamp's own glow with it, and the rest.
fn picture(job: &Job, vertices: usize) -> Picture<'_> {
    let mesh = ViewMesh::new(job.scene(), vertices);
    let answers = job.evaluate(&mesh.asked);
    let light = |name: &str, glowing: Vec<u32>, part: fn(&Irradiance) -> Rgb| ViewLight {
        name: name.into(),
        irradiance: answers.iter().map(part).collect(),
        turned: vec![],
        glowing,
        is_sky: false,
    };
    let all = (0..job.scene().meshes.len() as u32).collect();
    let lights = vec![
        light("direct </script> & \"light\"", all, |a| a.direct),
        light("indirect", vec![], |a| a.indirect),
    ];
    let lit = Lit {
        lights,
        ambient: answers.iter().map(|a| a.sky_visibility).collect(),
        error: answers.iter().map(|a| a.error).collect(),
    };
    let view = View::choose(job.scene(), job.bvh(), None, [64, 64]).unwrap();
    let dots = viewer::dots(&job.model().sites);
    let title = "cornell".into();
    Picture {
        title,
        scene: job.scene(),
        mesh,
        lit,
        dots,
        view,
        exposure: 4.0,
        level: job.model().solution.level,
    }
}

#[test]
fn the_page_holds_what_the_job_says_and_asks_for_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let job = baked(folder.path());
    let picture = picture(&job, 3_000);
    let path = folder.path().join("view.html");
    viewer::write(&path, &picture).unwrap();
    let page = Page::read(&path);
    let blocks = ["vertices", "fields", "indices", "sky", "dots"];
    let plain =
        blocks.iter().fold(page.text.clone(), |text, id| text.replace(Page::within(&page.text, id), ""));
    for outside in ["http:", "https:", "src=", "href=", "url(", "import(", "fetch(", "XMLHttp", "WebSocket"] {
        assert!(!plain.contains(outside), "the page speaks of {outside}");
    }
    assert_eq!(plain.matches("</script>").count(), blocks.len() + 2, "names cannot end a block");
    assert_eq!(page.header["lights"][0]["name"], "direct </script> & \"light\"");

    let count = page.header["count"].as_u64().unwrap() as usize;
    assert_eq!(count, picture.mesh.points.len());
    let (vertices, fields, indices) = (page.words("vertices"), page.words("fields"), page.words("indices"));
    assert_eq!((vertices.len(), fields.len()), (5 * count, 3 * count));
    assert_eq!(indices.len(), 3 * picture.mesh.one_sided.len());
    let colour = |word: u32| {
        let step = f32::from_bits(((word >> 27) + 127 - 24) << 23);
        Vec3::from_array([0, 9, 18].map(|shift| (word >> shift & 511) as f32 * step))
    };
    let scale = |k: usize| page.header["lights"][k]["scale"].as_f64().unwrap() as f32;
    let answers = job.evaluate(&picture.mesh.asked);
    for (v, answer) in answers.iter().enumerate() {
        let position = Vec3::from_array([0, 1, 2].map(|k| f32::from_bits(vertices[5 * v + k])));
        assert_eq!(position, picture.mesh.points[v].position);
        for (k, part) in [answer.direct, answer.indirect].into_iter().enumerate() {
            let held = colour(fields[(1 + k) * count + v]) * scale(k);
            // Half a step of a shared exponent is 1/512 of the largest channel, and of 2^-16 of the scale below that.
            let bound = part.max_element().max(scale(k) * 2f32.powi(-16)) / 512.0 + 1e-6 * scale(k);
            assert!((held - part).abs().max_element() <= bound, "vertex {v}, light {k}: {held}, not {part}");
        }
    }
}

/// The address of a page at a size, with what it is to set.
fn address(page: &Path, set: &Value) -> String {
    format!("file://{}#width=512&height=512&set={}", page.display(), escaped(set))
}

/// The program's own picture under weights, as sRGB bytes.
fn rendered(job: &Job, view: &View, weights: [Rgb; 2], exposed: f32) -> Vec<[u8; 3]> {
    let mut scene = job.scene().clone();
    scene.meshes.iter_mut().for_each(|mesh| mesh.radiance *= weights[0]);
    let weighed = |points: &[SurfacePoint]| -> Vec<Irradiance> {
        let weigh = |a: Irradiance| Irradiance {
            direct: weights[0] * a.direct,
            indirect: weights[1] * a.indirect,
            ..a
        };
        job.evaluate(points).into_iter().map(weigh).collect()
    };
    let film = render(&scene, job.bvh(), &weighed, (view, Quality::FINE), &|_| Ok(())).unwrap();
    film.pixels.iter().map(|pixel| exposure::srgb(pixel.radiance(), exposed)).collect()
}

#[test]
fn three_settings_of_the_sliders_show_what_render_shows() {
    let Some(chromium) = chromium() else { return };
    let folder = tempfile::tempdir().unwrap();
    let job = baked(folder.path());
    let picture = picture(&job, viewer::VERTICES);
    let path = folder.path().join("view.html");
    viewer::write(&path, &picture).unwrap();
    assert_eq!(picture.view.camera.size, [512, 512]);
    let settings = [
        ([Vec3::ONE, Vec3::ONE], 4.0),
        ([Vec3::splat(0.25), Vec3::splat(2.0)], 5.0),
        ([Vec3::new(1.0, 0.3, 0.1), Vec3::new(0.2, 0.6, 1.5)], 3.0),
    ];
    for (k, (weights, exposed)) in settings.into_iter().enumerate() {
        let set = json!({ "weights": weights.map(|w| w.to_array()), "exposure": exposed });
        let shown = shot(&chromium, folder.path(), &address(&path, &set), [512, 512]);
        let (rms, _) = rms(&shown, &rendered(&job, &picture.view, weights, exposed));
        println!("setting {k}: {rms:.3} of 255 rms");
        // The bound is the one that was asked for. It covers light that is linear between vertices two pixels apart
        // (0.7 at shadows), colours of nine bits (0.3), and edges, whose sixteen samples a pixel lie elsewhere (1.2).
        assert!(rms <= 2.0, "setting {k}: {rms} of 255 rms");
    }
}

#[test]
fn moving_a_slider_sends_a_few_bytes_and_no_vertices() {
    let Some(chromium) = chromium() else { return };
    let folder = tempfile::tempdir().unwrap();
    let job = baked(folder.path());
    let path = folder.path().join("view.html");
    viewer::write(&path, &picture(&job, 20_000)).unwrap();
    // Counts what goes to the graphics card; after the first picture, three sliders' moves.
    const COUNTER: &str = r#"<script>
let sent = 0, made = 0;
for (const name of ["bufferData", "bufferSubData", "texImage2D", "texSubImage2D", "texSubImage3D"]) {
  const plain = WebGL2RenderingContext.prototype[name];
  WebGL2RenderingContext.prototype[name] = function (...given) {
    sent += given.reduce((sum, one) => sum + (ArrayBuffer.isView(one) ? one.byteLength : 0), 0);
    return plain.apply(this, given);
  };
}
// Without a screen, the browser's frames come when they like.
window.requestAnimationFrame = (then) => setTimeout(then, 16);
const frames = (left, then) => setTimeout(then, 400 * left);
addEventListener("load", () => frames(3, () => {
  const first = sent;
  const move = (left) => {
    if (left) return glowtree.set({ weights: [[left, 1, 0], [1, 1, left]] }), made++, frames(3, () => move(left - 1));
    document.body.dataset.bytes = `${first} ${sent - first} ${made}`;
  };
  move(3);
}));
</script>"#;
    let text = std::fs::read_to_string(&path).unwrap().replacen("<title>", &format!("{COUNTER}<title>"), 1);
    std::fs::write(&path, text).unwrap();
    let profile = folder.path().join("profile");
    let page = visit(&chromium, &profile, &address(&path, &json!({})), &["--dump-dom".to_owned()]);
    let (_, rest) = page.split_once("data-bytes=\"").expect("the page ran to its end");
    let counts: Vec<u64> = rest.split_once('"').unwrap().0.split(' ').map(|n| n.parse().unwrap()).collect();
    println!("{counts:?} bytes at first, bytes of moves, moves");
    // 32 bytes a vertex go at first. A move asks for one frame, which sends 16 bytes for each of two lights and one emitter.
    assert!(counts[0] > 32 * 14_000 && counts[2] == 3, "{counts:?}");
    assert_eq!(counts[1], 3 * 48, "{counts:?}");
}

/// More lights for the Cornell box.
const MORE: &str = "\n[[lamp]]\nkind = \"point\"\nname = \"bulb\"\nposition = [1.0, 4.5, 1.0]\nintensity = [3, 2, 4]\n\
    \n[sky]\nradiance = [0.5, 0.6, 0.9]\n";

#[test]
fn a_slider_for_each_light_shows_what_relit_jobs_render_to() {
    let folder = tempfile::tempdir().unwrap();
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/cornell");
    for entry in std::fs::read_dir(&data).unwrap() {
        let path = entry.unwrap().path();
        std::fs::copy(&path, folder.path().join(path.file_name().unwrap())).unwrap();
    }
    let scene = folder.path().join("scene.toml");
    std::fs::write(&scene, std::fs::read_to_string(&scene).unwrap() + MORE).unwrap();
    let (job, path) = (folder.path().join("job"), folder.path().join("view.html"));
    bake::run(&scene, &job, &Options { error: 0.02, preview: false, ..Options::default() }, &bake::Silent)
        .unwrap();
    let program =
        Command::new(env!("CARGO_BIN_EXE_glowtree")).arg("export").arg(&job).arg("-o").arg(&path).output();
    assert!(program.unwrap().status.success());
    let header = Page::read(&path).header;
    let names: Vec<&str> =
        header["lights"].as_array().unwrap().iter().filter_map(|l| l["name"].as_str()).collect();
    assert_eq!(names, ["light", "bulb", "sky"]);
    let Some(chromium) = chromium() else { return };
    let mut relighter = Relighter::open(&job).unwrap();
    relighter.prepare().unwrap();
    for (k, (weights, changes, exposed)) in [
        ([[1.0, 1.0, 1.0]; 3], &[][..], 3.0),
        ([[0.2; 3], [3.0; 3], [0.0; 3]], &["light.scale=0.2", "bulb.scale=3", "sky.scale=0"], 3.0),
        (
            [[0.0; 3], [0.0; 3], [4.0, 2.0, 1.0]],
            &["light.scale=0", "bulb.scale=0", "sky.radiance=2,1.2,0.9"],
            2.0,
        ),
    ]
    .into_iter()
    .enumerate()
    {
        let mut lighting = relighter.baked().clone();
        changes.iter().for_each(|change| lighting.set(relighter.scene(), change).unwrap());
        relighter.relight(&lighting).unwrap();
        let model = relighter.model();
        let view = View { camera: model.scene.cameras[0].clone(), see_through: false };
        let evaluate = |points: &[SurfacePoint]| model.field().evaluate(points);
        let film = render(&model.scene, &model.bvh, &evaluate, (&view, Quality::FINE), &|_| Ok(())).unwrap();
        let set = json!({ "weights": weights, "exposure": exposed });
        let shown = shot(&chromium, folder.path(), &address(&path, &set), [512, 512]);
        let expected: Vec<[u8; 3]> =
            film.pixels.iter().map(|pixel| exposure::srgb(pixel.radiance(), exposed)).collect();
        let (rms, mean) = rms(&shown, &expected);
        println!("lights {k}: {rms:.3} of 255 rms, mean {mean:.0}");
        assert!(mean > 20.0, "too dark to tell: {mean}");
        // As above, and what a vertex and a point next to it differ by within the target of 2 %.
        assert!(rms <= 2.0, "lights {k}: {rms} of 255 rms");
    }
}

/// A ball of radius one with waves on it, over a floor, and a camera.
fn ball_over_floor(folder: &Path) {
    let ball = |u: f64, v: f64| {
        let (a, b) = (std::f64::consts::PI * u, std::f64::consts::TAU * v);
        let r = 1.0 + 0.03 * (9.0 * a).sin() * (8.0 * b).cos();
        [a.sin() * b.cos(), -a.cos(), a.sin() * b.sin()].map(|x| x * r)
    };
    std::fs::write(folder.join("ball.ply"), grid(200, ball)).unwrap();
    std::fs::write(folder.join("floor.ply"), grid(2, |u, v| [4.0 * v - 2.0, -1.2, 4.0 * u - 2.0])).unwrap();
}

const BALL: &str = "[[mesh]]\nfile = \"ball.ply\"\nalbedo = [0.7, 0.5, 0.3]\n[[mesh]]\nfile = \"floor.ply\"\nalbedo = [0.5, 0.5, 0.5]\n\
    [[camera]]\neye = [1.5, 1.8, 4.5]\ntarget = [0, -0.2, 0]\nfov = 40\nsize = [512, 512]\n";

/// Bakes a scene into `job` and exports its page, `view.html`.
fn exported(folder: &Path, scene: &str, options: &Options) {
    std::fs::write(folder.join("scene.toml"), scene).unwrap();
    let (job, path) = (folder.join("job"), folder.join("view.html"));
    bake::run(&folder.join("scene.toml"), &job, options, &bake::Silent).unwrap();
    let program =
        Command::new(env!("CARGO_BIN_EXE_glowtree")).arg("export").arg(&job).arg("-o").arg(&path).output();
    assert!(program.unwrap().status.success());
}

/// Compares what `view.html` shows with the program's own picture of a model: rms of 255.
fn page_against(folder: &Path, model: &Model, set: &Value) -> Option<f64> {
    let chromium = chromium()?;
    let view = View::choose(&model.scene, &model.bvh, None, [512, 512]).unwrap();
    let evaluate = |points: &[SurfacePoint]| model.field().evaluate(points);
    let film = render(&model.scene, &model.bvh, &evaluate, (&view, Quality::FINE), &|_| Ok(())).unwrap();
    let exposed = film.exposure();
    let expected: Vec<[u8; 3]> =
        film.pixels.iter().map(|pixel| exposure::srgb(pixel.radiance(), exposed)).collect();
    let mut set = set.clone();
    set["exposure"] = json!(exposed);
    let shown = shot(&chromium, folder, &address(&folder.join("view.html"), &set), [512, 512]);
    let (rms, mean) = rms(&shown, &expected);
    println!("{set}: {rms:.3} of 255 rms, mean {mean:.0}");
    assert!(mean > 20.0, "too dark to tell: {mean}");
    Some(rms)
}

fn page_against_render(folder: &Path, scene: &str, options: &Options) -> Option<f64> {
    chromium()?;
    exported(folder, scene, options);
    page_against(folder, bake::open(&folder.join("job")).unwrap().model(), &json!({}))
}

fn quick(error: f64) -> Options {
    Options { error, preview: false, ..Options::default() }
}

#[test]
fn a_mesh_that_stays_in_its_file_is_shown_by_a_proxy_with_its_light() {
    let folder = tempfile::tempdir().unwrap();
    ball_over_floor(folder.path());
    let scene = format!(
        "{BALL}[[lamp]]\nkind = \"sun\"\ndirection = [-0.5, -1, -0.4]\nirradiance = [2, 2, 1.8]\n[sky]\nradiance = [0.5, 0.6, 0.8]\n"
    );
    let streamed = Options { resident: Some(1000), ..quick(0.02) };
    let Some(rms) = page_against_render(folder.path(), &scene, &streamed) else { return };
    assert!(rms <= 2.0, "{rms} of 255 rms");
}

#[test]
fn an_image_sky_lights_stands_behind_and_turns_as_rendered() {
    if chromium().is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    ball_over_floor(folder.path());
    // Blue above, brown below, a warm glow at one side: every turn and mirroring shows.
    let pixel = |x: usize, y: usize| {
        let (around, up) = ((x as f32 + 0.5) / 128.0, 1.0 - (y as f32 + 0.5) / 32.0);
        let glow = 6.0 * (-40.0 * ((around - 0.3).powi(2) + (up - 0.4).powi(2))).exp();
        (0.3 + glow, 0.4 + 0.2 * up + 0.5 * glow, 0.5 + 0.4 * up)
    };
    exr::prelude::write_rgb_file(folder.path().join("sky.exr"), 128, 64, pixel).unwrap();
    exported(folder.path(), &format!("{BALL}[sky]\nfile = \"sky.exr\"\nrotate = 25\n"), &quick(0.02));
    let mut relighter = Relighter::open(&folder.path().join("job")).unwrap();
    // As baked; four of nine parts, which the page holds; half way between two, where it knows least.
    for turn in [0.0, 160.0, -100.0] {
        let mut lighting = relighter.baked().clone();
        lighting.set(relighter.scene(), &format!("sky.rotate={}", 25.0 + turn)).unwrap();
        relighter.relight(&lighting).unwrap();
        let rms = page_against(folder.path(), relighter.model(), &json!({ "turn": turn })).unwrap();
        assert!(rms <= 2.0, "turned by {turn}: {rms} of 255 rms");
    }
}

#[test]
fn a_sheet_of_two_sides_is_shown_from_behind() {
    let folder = tempfile::tempdir().unwrap();
    let floor = grid(2, |u, v| [4.0 * v - 2.0, -1.2, 4.0 * u - 2.0]);
    std::fs::write(folder.path().join("floor.ply"), floor).unwrap();
    // Bent about the vertical; its front looks to -z, away from the camera.
    let sheet = grid(40, |u, v| [0.9 - 1.8 * u, 1.8 * v - 1.0, 0.5 * (3.0 * u).sin()]);
    std::fs::write(folder.path().join("sheet.ply"), sheet).unwrap();
    let scene = "[[mesh]]\nfile = \"sheet.ply\"\nalbedo = [0.2, 0.5, 0.7]\nsides = 2\n[[mesh]]\nfile = \"floor.ply\"\n\
        albedo = [0.5, 0.5, 0.5]\n[[camera]]\neye = [1.5, 1.8, 4.5]\ntarget = [0, -0.2, 0]\nfov = 40\nsize = [512, 512]\n\
        [[lamp]]\nkind = \"point\"\nposition = [0.5, 1.2, 2.5]\nintensity = [6, 5, 4]\n\
        [[lamp]]\nkind = \"point\"\nposition = [-1, 0.5, -2]\nintensity = [0, 1, 4]\n[sky]\nradiance = [0.1, 0.1, 0.1]\n";
    let Some(rms) = page_against_render(folder.path(), scene, &quick(0.02)) else { return };
    assert!(rms <= 2.0, "{rms} of 255 rms");
}
