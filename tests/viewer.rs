//! The page that `export -o view.html` writes: it needs nothing from elsewhere, and what a browser shows of it is what relit
//! jobs render to.

#![allow(clippy::unwrap_used)] // a test that cannot go on panics where it stands

mod command;

use std::path::{Path, PathBuf};
use std::process::Command;

use command::{Place, code, stderr};
use glowtree::bake::Relighter;
use glowtree::geometry::SurfacePoint;
use glowtree::light::{linear_to_srgb, srgb_to_linear};
use glowtree::output::picture::{Film, Quality, View, render};

/// Pixels of the pictures that are compared.
const SIZE: u32 = 256;

/// The browser's pixels for each along an edge: it knows a few samples a pixel, a picture a filter.
const FINER: u32 = 4;

/// The Cornell box with two more lights, baked and exported.
struct Exported {
    place: Place,
    page: String,
}

const MORE: &str = "\n[[lamp]]\nkind = \"point\"\nname = \"bulb\"\nposition = [1.0, 4.5, 1.0]\nintensity = [3, 2, 4]\n\
    \n[sky]\nradiance = [0.5, 0.6, 0.9]\n";

impl Exported {
    fn new() -> Self {
        let place = Place::new();
        let data: PathBuf = [env!("CARGO_MANIFEST_DIR"), "data", "cornell"].iter().collect();
        for entry in std::fs::read_dir(&data).unwrap() {
            let path = entry.unwrap().path();
            std::fs::copy(&path, place.path(&path.file_name().unwrap().to_string_lossy())).unwrap();
        }
        let text = std::fs::read_to_string(data.join("scene.toml")).unwrap() + MORE;
        std::fs::write(place.path("scene.toml"), text).unwrap();
        for words in [
            &["bake", "scene.toml", "-o", "job", "--error", "2%", "--no-preview"][..],
            &["export", "job", "-o", "view.html"],
        ] {
            let output = place.run(words);
            assert_eq!(code(&output), 0, "{words:?}: {}", stderr(&output));
        }
        let page = std::fs::read_to_string(place.path("view.html")).unwrap();
        Self { place, page }
    }

    /// The JSON that the page begins with.
    fn header(&self) -> serde_json::Value {
        let from = self.page.find("id=\"header\">").unwrap() + "id=\"header\">".len();
        let to = from + self.page[from..].find("</script>").unwrap();
        serde_json::from_str(&self.page[from..to].replace("<\\/", "</")).unwrap()
    }
}

#[test]
fn the_page_is_whole_by_itself() {
    let exported = Exported::new();
    for outside in ["http:", "https:", "src=", "href=", "@import", "fetch(", "XMLHttpRequest", "import("] {
        assert!(!exported.page.contains(outside), "{outside}");
    }
    for left in ["@HEADER@", "@BLOBS@", "@SCRIPT@"] {
        assert!(!exported.page.contains(left), "{left}");
    }
    let header = exported.header();
    let names: Vec<&str> =
        header["lights"].as_array().unwrap().iter().map(|light| light["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["light", "bulb", "sky"]);
    assert!(header["exposure"].as_f64().unwrap() > 0.0 && header["vertices"].as_u64().unwrap() > 50_000);
}

/// A browser that shows pages without a screen, if there is one.
fn browser() -> Option<&'static str> {
    let found = ["chromium", "chromium-browser", "google-chrome"].into_iter().find(|name| {
        Command::new(name).arg("--version").output().is_ok_and(|output| output.status.success())
    });
    if found.is_none() {
        println!("skipped: no Chromium in the path");
    }
    found
}

/// What the browser shows of the page, RGB, filtered as pictures are: by a tent of a pixel's radius, linear.
fn screenshot(browser: &str, page: &Path, hash: &str) -> Vec<[f32; 3]> {
    let picture = page.with_extension("png");
    let across = SIZE * FINER;
    let output = Command::new(browser)
        .args(["--headless=new", "--no-sandbox", "--hide-scrollbars", "--virtual-time-budget=30000"])
        .args(["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"])
        .arg(format!("--window-size={},{}", across + 300, across + 300))
        .arg(format!("--user-data-dir={}", page.with_extension("profile").display()))
        .arg(format!("--screenshot={}", picture.display()))
        .arg(format!("file://{}#size={across}x{across}&{hash}", page.display()))
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    let problem = said.lines().find(|line| line.contains("CONSOLE") && line.contains("rror"));
    assert!(problem.is_none() && picture.exists(), "{problem:?}");
    let image = image::open(&picture).unwrap().to_rgb8();
    let pixel = |k: u32| {
        let centre = [k % SIZE, k / SIZE].map(|at| (at as f32 + 0.5) * FINER as f32);
        let (mut sum, mut weight) = ([0.0; 3], 0.0);
        let from = centre.map(|at| (at as u32).saturating_sub(FINER));
        for (x, y) in
            (0..2 * FINER * 2 * FINER).map(|k| (from[0] + k % (2 * FINER), from[1] + k / (2 * FINER)))
        {
            let tent =
                |at: u32, centre: f32| (1.0 - (at as f32 + 0.5 - centre).abs() / FINER as f32).max(0.0);
            let share = if x < across && y < across { tent(x, centre[0]) * tent(y, centre[1]) } else { 0.0 };
            let shown = if share > 0.0 { image.get_pixel(x, y).0 } else { [0; 3] };
            (0..3).for_each(|c| sum[c] += share * srgb_to_linear(shown[c]));
            weight += share;
        }
        sum.map(|sum: f32| f32::from(linear_to_srgb(sum / weight)))
    };
    (0..SIZE * SIZE).map(pixel).collect()
}

/// The job relit and rendered.
fn rendered(relighter: &mut Relighter, changes: &[&str]) -> Film {
    let mut lighting = relighter.baked().clone();
    changes.iter().for_each(|change| lighting.set(relighter.scene(), change).unwrap());
    relighter.relight(&lighting).unwrap();
    let model = relighter.model();
    let mut camera = model.scene.cameras[0].clone();
    camera.size = [SIZE; 2];
    let field = model.field();
    let evaluate = |points: &[SurfacePoint]| field.evaluate(points);
    let view = View { camera, see_through: false };
    render(&model.scene, &model.bvh, &evaluate, (&view, Quality::FINE), &|_| Ok(())).unwrap()
}

#[test]
fn a_browser_shows_what_relit_jobs_render_to() {
    let Some(browser) = browser() else { return };
    let exported = Exported::new();
    let exposure = exported.header()["exposure"].as_f64().unwrap() as f32;
    let mut relighter = Relighter::open(&exported.place.path("job")).unwrap();
    relighter.prepare().unwrap();
    let page = exported.place.path("view.html");
    // Strengths of the emitter, the bulb and the sky, a colour each.
    for (hash, changes) in [
        ("w=1,1,1;1,1,1;1,1,1", &[][..]),
        ("w=0.2,0.2,0.2;3,3,3;0,0,0", &["light.scale=0.2", "bulb.scale=3", "sky.scale=0"]),
        ("w=0,0,0;0,0,0;4,2,1", &["light.scale=0", "bulb.scale=0", "sky.radiance=2,1.2,0.9"]),
    ] {
        let shown = screenshot(browser, &page, hash);
        let film = rendered(&mut relighter, changes);
        let mut square = 0.0;
        let mut brightness = 0.0;
        for (shown, pixel) in shown.iter().zip(&film.pixels) {
            let expected =
                (pixel.radiance() * std::f32::consts::PI * exposure).to_array().map(linear_to_srgb);
            for (shown, expected) in shown.iter().zip(expected) {
                square += f64::from(shown - f32::from(expected)).powi(2);
                brightness += f64::from(expected);
            }
        }
        let count = 3.0 * f64::from(SIZE * SIZE);
        let (rms, mean) = ((square / count).sqrt(), brightness / count);
        println!("{hash}: {rms:.2} of 255 rms, mean {mean:.0}");
        assert!(mean > 20.0, "too dark to tell: {mean}");
        assert!(rms <= 2.0, "{hash}: {rms:.2} of 255");
    }
}
