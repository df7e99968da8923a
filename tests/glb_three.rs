//! The exported GLB in a viewer of others: three.js shows it as `render` shows the job.

#![allow(clippy::unwrap_used)] // a test that cannot go on panics where it stands

mod browser;

use std::fmt::Write as _;
use std::io::{BufRead, BufReader, Write};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use browser::{chromium, grid, rms, shot, visit};
use glowtree::bake::{self, Job, Options};
use glowtree::geometry::SurfacePoint;
use glowtree::output::exposure;
use glowtree::output::picture::{Quality, View, render};
use serde_json::{Value, json};

/// The release that is looked through.
const THREE: &str = "three@0.180.0";

/// The package's folder, fetched once by npm; None, with a message, where there is no npm or no registry.
fn three() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(THREE);
    if folder.join("package/build/three.module.min.js").is_file() {
        return Some(folder.join("package"));
    }
    let fresh = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let quiet = |command: &mut Command| {
        let command = command.current_dir(fresh.path()).stdout(Stdio::null()).stderr(Stdio::null());
        command.status().is_ok_and(|status| status.success())
    };
    let packed = quiet(Command::new("npm").args(["pack", THREE, "--silent", "--fetch-retries=1"]));
    if !packed || !quiet(Command::new("sh").args(["-c", "tar xzf three-*.tgz"])) {
        println!("skipped: npm cannot fetch {THREE}");
        return None;
    }
    // Another run may have been faster.
    let _ = std::fs::rename(fresh.keep(), &folder);
    Some(folder.join("package"))
}

/// A room of fine meshes with a bumpy hill and a panel below the ceiling: light lies at vertices in a GLB, so there must be many.
fn room(folder: &Path) -> PathBuf {
    let write = |name: &str, text: String| std::fs::write(folder.join(name), text).unwrap();
    let hill = |u: f64, v: f64| {
        let r2 = (u - 0.5).powi(2) + (v - 0.5).powi(2);
        [u, 0.35 * (-30.0 * r2).exp() * (1.0 + 0.1 * (40.0 * u).sin()), 1.0 - v]
    };
    write("floor.ply", grid(160, hill));
    write("ceiling.ply", grid(100, |u, v| [u, 1.0, v]));
    write("left.ply", grid(100, |u, v| [0.0, u, v]));
    write("right.ply", grid(100, |u, v| [1.0, u, 1.0 - v]));
    write("back.ply", grid(100, |u, v| [u, v, 0.0]));
    write("front.ply", grid(100, |u, v| [1.0 - u, v, 1.0]));
    write("panel.ply", grid(4, |u, v| [0.3 + 0.4 * u, 0.98, 0.3 + 0.4 * v]));
    let meshes = [
        ("floor", "[0.7, 0.7, 0.7]"),
        ("ceiling", "[0.7, 0.7, 0.7]"),
        ("left", "[0.7, 0.1, 0.1]"),
        ("right", "[0.1, 0.5, 0.1]"),
        ("back", "[0.7, 0.7, 0.7]"),
        ("front", "[0.2, 0.2, 0.6]"),
    ];
    let mut scene = String::from(
        "[[mesh]]\nfile = \"panel.ply\"\nalbedo = [0, 0, 0]\nradiance = [9, 8, 6]\n\
         [[camera]]\nname = \"in\"\neye = [0.5, 0.55, 0.97]\ntarget = [0.5, 0.4, 0]\nfov = 75\nsize = [400, 300]\n",
    );
    for (name, albedo) in meshes {
        writeln!(scene, "[[mesh]]\nfile = \"{name}.ply\"\nalbedo = {albedo}").unwrap();
    }
    std::fs::write(folder.join("scene.toml"), scene).unwrap();
    folder.join("scene.toml")
}

/// Loads the file, checks it as far as scripts see it, and draws it once.
const PAGE: &str = r##"<!DOCTYPE html>
<meta charset="utf-8">
<style>body { margin: 0 } canvas { display: block }</style>
<script type="importmap">{ "imports": { "three": "/build/three.module.min.js" } }</script>
<script type="module">
import * as THREE from "three";
import { GLTFLoader } from "/examples/jsm/loaders/GLTFLoader.js";
const { eye, target, up, fov, size } = CAMERA;
const renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
renderer.setSize(...size);
document.body.append(renderer.domElement);
const camera = new THREE.PerspectiveCamera(fov, size[0] / size[1], 0.01, 100);
camera.position.set(...eye);
camera.up.set(...up);
camera.lookAt(...target);
try {
  const { scene } = await new GLTFLoader().loadAsync("/job.glb");
  const told = { version: THREE.REVISION, exposure: scene.userData.exposure, meshes: [] };
  scene.traverse((one) => {
    if (!one.isMesh) return;
    const { color, _radiosity: radiosity, position } = one.geometry.attributes;
    let [apart, most] = [0, 0];
    for (let k = 0; radiosity && k < radiosity.count; k++)
      for (let c = 0; c < 3; c++) {
        const shown = Math.min(Math.max(radiosity.getComponent(k, c) * told.exposure, 0), 1);
        apart = Math.max(apart, Math.abs(shown - color.getComponent(k, c)));
        most = Math.max(most, shown);
      }
    told.meshes.push({ name: one.name, material: one.material.type, coloured: one.material.vertexColors,
      counts: [position.count, radiosity?.count, color?.count], apart, most });
  });
  // No lamp: what is unlit needs none, and anything else stays black.
  renderer.render(scene, camera);
  document.body.dataset.told = JSON.stringify(told);
} catch (problem) {
  document.body.dataset.told = JSON.stringify({ problem: String(problem) });
}
</script>
"##;

/// Hands out the page, the job's file and the package, on loopback, as long as the test runs; the port.
fn serve(page: String, glb: Vec<u8>, package: PathBuf) -> u16 {
    let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
    let port = listener.local_addr().unwrap().port();
    std::thread::spawn(move || {
        for mut stream in listener.incoming().flatten() {
            let mut reader = BufReader::new(stream.try_clone().unwrap());
            let mut line = String::new();
            let _ = reader.read_line(&mut line);
            let mut rest = String::new();
            while reader.read_line(&mut rest).is_ok_and(|count| count > 2) {
                rest.clear();
            }
            let path = line.split(' ').nth(1).unwrap_or_default().to_owned();
            let (kind, body) = match path.as_str() {
                "/" => ("text/html", page.clone().into_bytes()),
                "/job.glb" => ("model/gltf-binary", glb.clone()),
                other => (
                    "text/javascript",
                    std::fs::read(package.join(other.trim_start_matches('/'))).unwrap_or_default(),
                ),
            };
            let status = if body.is_empty() { "404 Not Found" } else { "200 OK" };
            let length = body.len();
            let head = format!(
                "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n"
            );
            let _ = stream.write_all(head.as_bytes()).and_then(|()| stream.write_all(&body));
        }
    });
    port
}

fn rendered(job: &Job, exposed: f32) -> Vec<[u8; 3]> {
    let view = View { camera: job.scene().cameras[0].clone(), see_through: false };
    let evaluate = |points: &[SurfacePoint]| job.evaluate(points);
    let film = render(job.scene(), job.bvh(), &evaluate, (&view, Quality::FINE), &|_| Ok(())).unwrap();
    film.pixels.iter().map(|pixel| exposure::srgb(pixel.radiance(), exposed)).collect()
}

#[test]
fn three_js_shows_the_light_that_render_shows() {
    let (Some(chromium), Some(package)) = (chromium(), three()) else { return };
    let folder = tempfile::tempdir().unwrap();
    let (scene, job) = (room(folder.path()), folder.path().join("job"));
    bake::run(&scene, &job, &Options { preview: false, ..Options::default() }, &bake::Silent).unwrap();
    let glb = folder.path().join("job.glb");
    let program =
        Command::new(env!("CARGO_BIN_EXE_glowtree")).arg("export").arg(&job).arg("-o").arg(&glb).output();
    assert!(program.unwrap().status.success());
    let camera = json!({ "eye": [0.5, 0.55, 0.97], "target": [0.5, 0.4, 0], "up": [0, 1, 0], "fov": 75,
        "size": [400, 300] });
    let page = PAGE.replacen("CAMERA", &camera.to_string(), 1);
    let port = serve(page, std::fs::read(&glb).unwrap(), package);
    let address = format!("http://127.0.0.1:{port}/");
    let dom = visit(&chromium, &folder.path().join("profile"), &address, &["--dump-dom".to_owned()]);
    let (_, told) = dom.split_once("data-told=\"").expect("the page ran to its end");
    let told: Value = serde_json::from_str(&told.split_once('"').unwrap().0.replace("&quot;", "\"")).unwrap();
    assert_eq!(told["version"], "180", "{told}");
    let meshes = told["meshes"].as_array().unwrap();
    assert_eq!(meshes.len(), 7, "{told}");
    for mesh in meshes {
        assert_eq!(
            (&mesh["material"], &mesh["coloured"]),
            (&json!("MeshBasicMaterial"), &json!(true)),
            "{mesh}"
        );
        let counts = mesh["counts"].as_array().unwrap();
        assert!(counts.iter().all(|count| *count == counts[0] && count.as_u64() > Some(20)), "{mesh}");
        // Colours of 16 bits: half a step, and what single precision rounds.
        assert!(mesh["apart"].as_f64() < Some(0.6 / 65_535.0), "{mesh}");
        assert!(mesh["most"].as_f64() > Some(0.02), "no light: {mesh}");
    }
    // The file's exposure is of radiosity, that of pictures of radiance: B = π L.
    let exposed = told["exposure"].as_f64().unwrap() as f32 * std::f32::consts::PI;
    let shown = shot(&chromium, folder.path(), &address, [400, 300]);
    let job = bake::open(&job).unwrap();
    let (rms, mean) = rms(&shown, &rendered(&job, exposed));
    println!("three.js: {rms:.3} of 255 rms, mean {mean:.0}");
    // The bound is that of our own page (tests/viewer.rs): light at vertices three pixels apart, edges of four samples a pixel in a
    // box, not of sixteen in a tent. Measured: 0.9.
    assert!(mean > 25.0 && rms <= 2.0, "{rms} of 255 rms, mean {mean}");
}
