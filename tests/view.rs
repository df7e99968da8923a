//! The server of `glowtree view`: who is let in, what garbage does, and that its live solves are what `relight` says.

#![cfg(unix)]
#![allow(clippy::unwrap_used)] // a test that cannot go on panics where it stands

mod browser;
mod command;

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use browser::{chromium, escaped, rms, shot};
use command::Place;
use glowtree::bake::relight::Paint;
use glowtree::bake::{self, Lighting, Options, Relighter};
use glowtree::geometry::SurfacePoint;
use glowtree::light::Rgb;
use glowtree::output::exposure;
use glowtree::output::picture::{Quality, View, render};
use glowtree::output::viewer::{Seams, ViewMesh};
use glowtree::scene::LampKind;
use serde_json::{Value, json};

/// A running server; it ends with the test.
struct Server {
    child: Child,
    out: BufReader<std::process::ChildStdout>,
    url: String,
    port: u16,
}

impl Server {
    fn start(mut command: Command) -> Self {
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let mut out = BufReader::new(child.stdout.take().unwrap());
        let mut line = String::new();
        let serving: Value = loop {
            line.clear();
            assert!(out.read_line(&mut line).unwrap() > 0, "it ends before it serves");
            let value: Value = serde_json::from_str(&line).unwrap();
            if value["type"] == "serving" {
                break value;
            }
        };
        let url = serving["url"].as_str().unwrap().to_owned();
        let port = serving["port"].as_u64().unwrap() as u16;
        assert!(url.starts_with(&format!("http://127.0.0.1:{port}/")) && url.ends_with('/'));
        Self { child, out, url, port }
    }

    /// The corner, at `vertices` vertices.
    fn of(place: &Place, vertices: &str) -> Self {
        Self::start(place.command(&["view", "job", "--vertices", vertices, "--json"]))
    }

    /// `/TOKEN/`
    fn path(&self) -> &str {
        &self.url[format!("http://127.0.0.1:{}", self.port).len()..]
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        stream
    }

    /// Sends bytes; status and body of the answer.
    fn raw(&self, bytes: &[u8]) -> (u16, Vec<u8>) {
        let mut stream = self.connect();
        // A server that has heard enough may stop listening.
        let _ = stream.write_all(bytes);
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        let end = answer.windows(4).position(|four| four == b"\r\n\r\n").expect("a head") + 4;
        let head = String::from_utf8(answer[..end].to_vec()).unwrap();
        let length = head.lines().find_map(|line| line.strip_prefix("Content-Length: ")).unwrap();
        assert_eq!(length.parse(), Ok(answer.len() - end), "{head}");
        (head[9..12].parse().unwrap(), answer.split_off(end))
    }

    fn request(&self, method: &str, path: &str, host: &str, rest: &str) -> (u16, Vec<u8>) {
        self.raw(format!("{method} {path} HTTP/1.1\r\nHost: {host}\r\n{rest}\r\n").as_bytes())
    }

    fn get(&self, path: &str) -> (u16, Vec<u8>) {
        self.request("GET", path, &format!("127.0.0.1:{}", self.port), "")
    }

    fn post(&self, body: &str) -> (u16, Vec<u8>) {
        let (path, port) = (self.path(), self.port);
        let head = format!(
            "POST {path}edit HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nContent-Type: application/json\r\nContent-Length: {}\r\n\r\n",
            body.len()
        );
        self.raw((head + body).as_bytes())
    }

    /// The answer to an edit: its header and each layer's colours.
    fn edit(&self, edit: &Value) -> (Value, Vec<Vec<Rgb>>) {
        let (status, bytes) = self.post(&edit.to_string());
        assert_eq!(status, 200, "{}", String::from_utf8_lossy(&bytes));
        let length = u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize;
        let header: Value = serde_json::from_slice(&bytes[4..4 + length]).unwrap();
        let words: Vec<u32> =
            bytes[4 + length..].chunks_exact(4).map(|w| u32::from_le_bytes(w.try_into().unwrap())).collect();
        let told = header["layers"].as_array().unwrap();
        let colour = |word: u32, scale: f32| {
            let step = f32::from_bits(((word >> 27) + 127 - 24) << 23) * scale;
            Rgb::from_array([0, 9, 18].map(|shift| (word >> shift & 511) as f32 * step))
        };
        let layers = told.iter().zip(words.chunks((words.len() / told.len().max(1)).max(1)));
        let layers = layers.map(|(layer, words)| {
            let scale = layer["scale"].as_f64().unwrap() as f32;
            words.iter().map(|&word| colour(word, scale)).collect()
        });
        (header.clone(), layers.collect())
    }

    /// Interrupts; the exit code, within how long, and the last line said.
    fn interrupted(mut self) -> (Option<i32>, Duration, String) {
        let asked = Instant::now();
        assert!(
            Command::new("kill")
                .args(["-s", "INT", &self.child.id().to_string()])
                .status()
                .unwrap()
                .success()
        );
        let code = self.child.wait().unwrap().code();
        let took = asked.elapsed();
        let mut rest = String::new();
        self.out.read_to_string(&mut rest).unwrap();
        (code, took, rest.lines().last().unwrap_or_default().to_owned())
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn only_who_knows_the_address_is_answered_and_garbage_ends_nothing() {
    let place = Place::new();
    place.baked("job");
    let server = Server::of(&place, "500");
    let (path, host) = (server.path().to_owned(), format!("127.0.0.1:{}", server.port));
    // 128 bits in hexadecimal, and others every time.
    assert_eq!(path.len(), 2 + 32);
    assert_ne!(Server::of(&place, "500").path(), path);
    let (status, page) = server.get(&path);
    let page = String::from_utf8(page).unwrap();
    assert_eq!(status, 200);
    assert!(page.contains("id=\"header\"") && page.contains("connect-src 'self'") && page.contains("fetch("));
    for (wrong, status) in [
        (server.get("/"), 403),
        (server.get("/favicon.ico"), 403),
        (server.get(&path.replace(|c: char| c.is_ascii_hexdigit(), "0")), 403),
        (server.request("GET", &path, "evil.example", ""), 403),
        (server.request("GET", &path, &format!("evil.example:{}", server.port), ""), 403),
        (server.request("PUT", &path, &host, ""), 405),
        (server.request("OPTIONS", &format!("{path}edit"), &host, ""), 405),
        (server.get(&format!("{path}../../etc/passwd")), 404),
        (server.post("{\"albedo\": {\"nobody\": [0, 0, 0]}}"), 400),
        (server.post("{\"albedo\": {\"corner\": [2, 0, 0]}}"), 400),
        (server.post("{\"lamps\": {\"lamp\": {\"position\": [1e999, 0, 0]}}}"), 400),
        (server.post("not json"), 400),
        (server.post(&"[".repeat(100_000)), 400),
        (server.post(&" ".repeat(2 << 20)), 413),
        (server.raw(&[0xff; 5000]), 400),
        (server.raw(&[b'a'; 100_000]), 431),
        (server.raw(b"GET / HTTP/1.1\r\n\r\n"), 403),
    ] {
        assert_eq!(wrong.0, status, "{}", String::from_utf8_lossy(&wrong.1));
        assert!(wrong.1.len() < 300, "a refusal tells nothing more");
    }
    // One that says nothing is sent away in time, and keeps nobody else waiting.
    let mut silent = server.connect();
    let began = Instant::now();
    assert_eq!(server.get(&path).0, 200);
    assert!(began.elapsed() < Duration::from_secs(4), "{:?}", began.elapsed());
    let mut answer = String::new();
    silent.read_to_string(&mut answer).unwrap();
    assert!(answer.starts_with("HTTP/1.1 408 ") && began.elapsed() < Duration::from_secs(8), "{answer}");
    if let Ok(sockets) = std::fs::read_to_string("/proc/net/tcp") {
        let listening = |line: &&str| line.contains(&format!(":{:04X} 00000000:0000 0A", server.port));
        let own: Vec<&str> = sockets.lines().filter(listening).collect();
        assert!(own.len() == 1 && own[0].contains(" 0100007F:"), "not loopback alone: {own:?}");
    }
}

#[test]
fn a_signal_ends_it_within_a_second_whatever_it_does() {
    let place = Place::new();
    place.baked("job");
    let idle = Server::of(&place, "500");
    let open = idle.connect();
    let (code, took, last) = idle.interrupted();
    assert_eq!(code, Some(130));
    assert!(took < Duration::from_secs(1), "{took:?}");
    assert!(last.contains("\"code\":130") && last.contains("SIGINT"), "{last}");
    drop(open);
    let busy = Server::of(&place, "1M");
    let (path, port) = (busy.path().to_owned(), busy.port);
    let body = r#"{"albedo": {"corner": [0.1, 0.2, 0.3]}}"#;
    let mut asking = busy.connect();
    write!(
        asking,
        "POST {path}edit HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nContent-Type: application/json\r\n\
         Content-Length: {}\r\n\r\n{body}",
        body.len()
    )
    .unwrap();
    std::thread::sleep(Duration::from_millis(300));
    let (code, took, _) = busy.interrupted();
    assert!(code == Some(130) && took < Duration::from_secs(1), "{code:?} after {took:?}");
    let mut answer = Vec::new();
    let _ = asking.read_to_end(&mut answer);
    assert!(answer.is_empty(), "the solve was done before the signal: nothing was tested");
}

/// What `relight` says at the page's vertices, for each light.
fn relit(relighter: &mut Relighter, lighting: &Lighting, mesh: &ViewMesh) -> Vec<Vec<Rgb>> {
    let mut lights: Vec<Vec<Rgb>> = Vec::new();
    for light in lighting.apart(relighter.scene()) {
        relighter.relight(&light.lighting).unwrap();
        let answers = relighter.model().field().evaluate_crowd(&mesh.asked);
        lights.push(answers.iter().map(|answer| answer.total().max(Rgb::ZERO)).collect());
    }
    let level = bake_level(relighter);
    let shown: Vec<&[Rgb]> = lights.iter().map(Vec::as_slice).collect();
    let seams = Seams::new(mesh, &shown, level);
    lights.iter_mut().for_each(|light| seams.lighten(light));
    lights
}

/// Mean irradiance in the light that was baked.
fn bake_level(relighter: &mut Relighter) -> f32 {
    let baked = relighter.baked().clone();
    relighter.relight(&baked).unwrap();
    relighter.model().solution.level
}

/// Asserts that colours are those expected, within the encoding and twice what a solve may err by.
fn alike(held: &[Rgb], expected: &[Rgb], solve: f32) {
    assert_eq!(held.len(), expected.len());
    let scale = expected.iter().map(|c| c.max_element()).fold(0.0, f32::max);
    for (v, (held, expected)) in held.iter().zip(expected).enumerate() {
        // Half a step of a shared exponent is 1/512 of the largest channel, and of 2^-16 of the scale below that.
        let bound = expected.max_element().max(scale * 2f32.powi(-16)) / 512.0 + 2.0 * solve * scale;
        assert!(
            (*held - *expected).abs().max_element() <= bound,
            "vertex {v}: {held}, not {expected} ± {bound}"
        );
    }
}

#[test]
fn edits_are_answered_as_relight_does_and_only_what_changed_is_sent() {
    let place = Place::new();
    place.baked("job");
    let server = Server::of(&place, "2000");
    let mut relighter = Relighter::open(&place.path("job")).unwrap();
    let solve = relighter.params_mut().error as f32;
    let mesh = ViewMesh::new(&relighter.model().scene, 2000);
    let mut lighting = relighter.baked().clone();
    // Lights of the page: the lamp, then the sky.
    lighting.meshes[0].paint = Paint::Plain(Rgb::new(0.9, 0.5, 0.1));
    let edit = json!({ "albedo": { "corner": [0.9, 0.5, 0.1] }, "have": [0, 0, 0] });
    let (header, layers) = server.edit(&edit);
    let told = |header: &Value| {
        let layers = header["layers"].as_array().unwrap();
        layers.iter().map(|l| l["layer"].as_u64().unwrap()).collect::<Vec<_>>()
    };
    assert_eq!((told(&header), header["lights"].as_u64()), (vec![0, 1, 2], Some(2)), "{header}");
    assert!(layers[0].iter().all(|c| (*c - Rgb::new(0.9, 0.5, 0.1)).abs().max_element() <= 0.9 / 512.0));
    let expected = relit(&mut relighter, &lighting, &mesh);
    let unchanged = relighter.baked().clone();
    let baked = relit(&mut relighter, &unchanged, &mesh);
    // Enough to tell: the light that the wall sends to the floor is another.
    let change =
        layers[1].iter().zip(&baked[0]).map(|(a, b)| (*a - *b).abs().max_element()).fold(0.0, f32::max);
    assert!(change > 10.0 * solve * expected[0][0].max_element(), "{change}");
    alike(&layers[1], &expected[0], solve);
    alike(&layers[2], &expected[1], solve);

    // The lamp elsewhere, the albedo as it is: its own light alone is solved for and sent.
    let versions = [1, 1, 1];
    let place = json!({ "lamp": { "position": [0.2, 0.4, 0.9] } });
    let edit = json!({ "albedo": { "corner": [0.9, 0.5, 0.1] }, "lamps": place, "have": versions });
    let (header, layers) = server.edit(&edit);
    assert_eq!((told(&header), header["lights"].as_u64()), (vec![1], Some(1)), "{header}");
    assert!(header["rays"].as_u64() > Some(0), "{header}");
    let to = relighter.scene().placement.to_local(glam::DVec3::new(0.2, 0.4, 0.9));
    let LampKind::Point { position, .. } = &mut lighting.lamps[0] else { panic!("a point lamp") };
    *position = to;
    alike(&layers[0], &relit(&mut relighter, &lighting, &mesh)[0], solve);

    // Back as baked, to a page that holds nothing of this.
    let (header, layers) = server.edit(&json!({ "have": [0, 0, 0] }));
    assert_eq!(told(&header), [0, 1, 2], "{header}");
    alike(&layers[1], &baked[0], solve);
    alike(&layers[2], &baked[1], solve);
    // The same again is known.
    let versions: Vec<u64> =
        header["layers"].as_array().unwrap().iter().map(|l| l["version"].as_u64().unwrap()).collect();
    let (header, _) = server.edit(&json!({ "have": versions }));
    assert_eq!((told(&header), header["lights"].as_u64()), (vec![], Some(0)), "{header}");
}

#[test]
fn the_newest_edit_wins() {
    let place = Place::new();
    place.baked("job");
    let server = Server::of(&place, "30k");
    let albedo = |k: usize| json!({ "albedo": { "corner": [0.1 * k as f64, 0.5, 0.5] } }).to_string();
    let statuses: Vec<u16> = std::thread::scope(|scope| {
        let ask = |k| {
            std::thread::sleep(Duration::from_millis(30));
            let body = albedo(k);
            let server = &server;
            scope.spawn(move || server.post(&body).0)
        };
        let asked: Vec<_> = (1..6).map(ask).collect();
        asked.into_iter().map(|thread| thread.join().unwrap()).collect()
    });
    assert_eq!(statuses.last(), Some(&200), "{statuses:?}");
    assert!(statuses.contains(&409) && statuses.iter().all(|s| [200, 409].contains(s)), "{statuses:?}");
    // What was dropped half way does no harm to what comes after.
    let (_, layers) = server.edit(&json!({ "albedo": { "corner": [0.5, 0.5, 0.5] } }));
    let mut relighter = Relighter::open(&place.path("job")).unwrap();
    let solve = relighter.params_mut().error as f32;
    // Vertices are answered for 32,768 together, and so they are here.
    let mesh = ViewMesh::new(&relighter.model().scene, 30_000);
    let mut lighting = relighter.baked().clone();
    lighting.meshes[0].paint = Paint::Plain(Rgb::splat(0.5));
    for (held, expected) in layers[1..].iter().zip(&relit(&mut relighter, &lighting, &mesh)) {
        alike(held, expected, solve);
    }
}

#[test]
fn the_page_shows_what_edited_jobs_render_to() {
    let Some(chromium) = chromium() else { return };
    let folder = tempfile::tempdir().unwrap();
    let scene = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("data/cornell/scene.toml");
    let job = folder.path().join("job");
    bake::run(&scene, &job, &Options { preview: false, ..Options::default() }, &bake::Silent).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_glowtree"));
    command.arg("view").arg(&job).arg("--json");
    let server = Server::start(command);
    let edit = json!({ "albedo": { "white": [0.1, 0.3, 0.6] } });
    let set = json!({ "exposure": 5.0 });
    let address =
        format!("{}#width=512&height=512&set={}&edit={}", server.url, escaped(&set), escaped(&edit));
    let shown = shot(&chromium, folder.path(), &address, [512, 512]);
    let mut relighter = Relighter::open(&job).unwrap();
    let mut lighting = relighter.baked().clone();
    lighting.set(relighter.scene(), "white.albedo=0.1,0.3,0.6").unwrap();
    relighter.relight(&lighting).unwrap();
    let model = relighter.model();
    let view = View { camera: model.scene.cameras[0].clone(), see_through: false };
    let evaluate = |points: &[SurfacePoint]| model.field().evaluate(points);
    let film = render(&model.scene, &model.bvh, &evaluate, (&view, Quality::FINE), &|_| Ok(())).unwrap();
    let expected: Vec<[u8; 3]> = film.pixels.iter().map(|p| exposure::srgb(p.radiance(), 5.0)).collect();
    let (rms, mean) = rms(&shown, &expected);
    println!("edited: {rms:.3} of 255 rms, mean {mean:.0}");
    // As for pages without edits (tests/viewer.rs).
    assert!(mean > 20.0 && rms <= 2.0, "{rms} of 255 rms, mean {mean}");
}
