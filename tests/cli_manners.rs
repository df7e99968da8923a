//! Exit codes, messages, streams and signals of the program.

#![allow(clippy::unwrap_used)] // a test that cannot go on panics where it stands

mod command;

use std::io::{BufRead, BufReader, Read};
use std::process::Stdio;
use std::time::{Duration, Instant};

use command::{Place, code, exists, stderr, stdout};

#[test]
fn usage_errors_exit_with_2_and_say_so_on_stderr() {
    let place = Place::new();
    for words in [
        &["bake"][..],
        &[],
        &["bake", "scene.toml", "--error", "0"],
        &["bake", "scene.toml", "--error", "300%"],
        &["bake", "scene.toml", "--max-memory", "lots"],
        &["bake", "scene.toml", "-j", "0"],
        &["bake", "scene.toml", "-q", "-v"],
        &["bake", "scene.toml", "--progress", "loud"],
        &["export", "job", "-o", "out.xyz"],
        &["render", "job", "-o", "out"],
        &["completions", "nosuchshell"],
        &["no-such-verb"],
    ] {
        let output = place.run(words);
        assert_eq!(code(&output), 2, "{words:?}");
        assert!(output.stdout.is_empty() && !output.stderr.is_empty(), "{words:?}: {}", stdout(&output));
    }
}

#[test]
fn help_and_version_are_results() {
    let place = Place::new();
    for words in [&["--help"][..], &["--version"], &["bake", "--help"], &["bake", "-V"]] {
        let output = place.run(words);
        assert_eq!(code(&output), 0, "{words:?}");
        assert!(!output.stdout.is_empty() && output.stderr.is_empty(), "{words:?}");
    }
    assert!(stdout(&place.run(&["bake", "--help"])).contains("130/143 interrupted"));
}

#[test]
fn errors_name_the_file_and_what_to_do() {
    let place = Place::new();
    std::fs::write(place.path("bad.toml"), "[[mesh]]\nfile = \"corner.ply\"\nalbdo = [1, 1, 1]\n").unwrap();
    for (words, expected, parts) in [
        (&["bake", "missing.ply"][..], 4, &["missing.ply"][..]),
        (&["bake", "bad.toml"], 4, &["bad.toml", "albdo", "albedo"]),
        (&["probe", "nowhere", "--points", "points.csv"], 10, &["nowhere", "glowtree bake"]),
        (&["export", "nowhere", "-o", "a.ply"], 10, &["nowhere"]),
        (&["export", "nowhere", "-o", "no/such/a.ply"], 8, &["no/such"]),
        (&["inspect", "scene.toml"], 10, &["scene.toml"]),
        (&["probe", "nowhere", "--points", "nothing.csv"], 8, &["nothing.csv"]),
        (&["reference", "scene.toml", "--points", "scene.toml"], 4, &["scene.toml"]),
    ] {
        let output = place.run(words);
        let message = stderr(&output);
        assert_eq!(code(&output), expected, "{words:?}: {message}");
        assert!(message.contains("error: ") && output.stdout.is_empty(), "{words:?}: {message}");
        for part in parts {
            assert!(message.contains(part), "{words:?} should name {part}: {message}");
        }
    }
}

#[test]
fn a_job_answers_and_says_when_nothing_is_left() {
    let place = Place::new();
    let words = ["bake", "scene.toml", "--error", "20%"];
    let first = place.run(&words);
    assert_eq!(code(&first), 0, "{}", stderr(&first));
    assert!(stdout(&first).contains("scene.glow: baked in"), "{}", stdout(&first));
    assert!(exists(&place.path("scene.glow/preview.png")) && exists(&place.path("scene.glow/mesh.ply")));
    let again = place.run(&words);
    assert_eq!((code(&again), stdout(&again)), (0, "scene.glow: nothing left to do\n".to_owned()));
    // A lost picture is made again without baking.
    std::fs::remove_file(place.path("scene.glow/preview.png")).unwrap();
    assert_eq!(code(&place.run(&words)), 0);
    assert!(exists(&place.path("scene.glow/preview.png")));
    let other = place.run(&["bake", "scene.toml", "--error", "10%"]);
    assert_eq!(code(&other), 3);
    assert!(stderr(&other).contains("--error was 0.2, now 0.1"), "{}", stderr(&other));
    assert!(stdout(&place.run(&["inspect", "scene.glow"])).contains("triangles        64\n"));
    let unknown = place.run(&["render", "scene.glow", "--camera", "bakc", "-o", "a.png"]);
    assert_eq!(code(&unknown), 2);
    assert!(stderr(&unknown).contains("front"), "{}", stderr(&unknown));
}

#[test]
fn a_finished_job_that_lost_a_file_gets_it_back() {
    let place = Place::new();
    place.baked("job");
    for name in ["scene.glow", "sites.glow", "links.glow", "light.glow"] {
        let path = place.path("job").join(name);
        let bytes = std::fs::read(&path).unwrap();
        std::fs::remove_file(&path).unwrap();
        place.baked("job");
        assert!(std::fs::read(&path).unwrap() == bytes, "{name} is another");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn an_allocation_that_fails_is_code_6_and_no_crash() {
    let place = Place::new();
    let program = env!("CARGO_BIN_EXE_glowtree");
    // 60 MB of addresses: the program starts, a table of a hundred million pixels does not fit.
    let mut scene = std::fs::read_to_string(place.path("scene.toml")).unwrap();
    scene = scene.replace("size = [48, 32]", "size = [10000, 10000]");
    std::fs::write(place.path("scene.toml"), scene).unwrap();
    let script = format!("ulimit -v 60000; exec {program} bake scene.toml -o job --error 20% -q -j 1");
    let mut shell = std::process::Command::new("sh");
    let output = shell.args(["-c", &script]).current_dir(place.path("")).output().unwrap();
    assert_eq!(code(&output), 6, "{}", stderr(&output));
    // What was done is kept.
    assert!(exists(&place.path("job/light.glow")));
}

#[test]
fn probe_keeps_columns_and_reference_agrees() {
    let place = Place::new();
    place.baked("job");
    let table = stdout(&place.run(&["probe", "job", "--points", "points.csv", "-q"]));
    let mut rows = table.lines();
    let head = "x,y,z,nx,ny,nz,name,irradiance_r,irradiance_g,irradiance_b,radiosity_r,radiosity_g,radiosity_b,error";
    assert_eq!(rows.next(), Some(head));
    let floor: Vec<f64> = rows.next().unwrap().split(',').skip(7).map(|v| v.parse().unwrap()).collect();
    assert!(rows.next().unwrap().contains("\"a, wall\""), "{table}");
    // Radiosity is albedo times irradiance: red sRGB 100 + 20·1.2 = 124 interpolated linearly between the albedos of 120
    // and 140 (0.188 and 0.262), green 180 (0.456).
    assert!(floor[3] / floor[0] > 0.188 && floor[3] / floor[0] < 0.262, "{floor:?}");
    assert!((floor[4] / floor[1] - 0.456).abs() < 1e-3, "{floor:?}");
    let output = place.run(&[
        "reference",
        "scene.toml",
        "--points",
        "points.csv",
        "--spp",
        "256",
        "-o",
        "r.csv",
        "-q",
    ]);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    let judged = std::fs::read_to_string(place.path("r.csv")).unwrap();
    let judged: Vec<f64> =
        judged.lines().nth(1).unwrap().split(',').skip(7).map(|v| v.parse().unwrap()).collect();
    // The bake aims at 20 % root mean square; the lamp's direct light, most of it, is exact in both.
    assert!((floor[0] / judged[0] - 1.0).abs() < 0.3, "{floor:?} {judged:?}");
}

#[test]
fn export_keeps_the_input_and_results_go_where_they_are_told() {
    let place = Place::new();
    place.baked("job");
    let output = place.run(&["export", "job", "-o", "out.ply"]);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    assert!(stdout(&output).starts_with("out.ply: "), "{}", stdout(&output));
    let bytes = std::fs::read(place.path("out.ply")).unwrap();
    let header =
        String::from_utf8_lossy(&bytes[..bytes.windows(10).position(|w| w == b"end_header").unwrap()])
            .into_owned();
    for line in [
        "comment a corner",
        "property short quality\nproperty float radiosity_r",
        "property float error",
        "exposure",
    ] {
        assert!(header.contains(line), "{line}: {header}");
    }
    let overwriting = place.run(&["export", "job", "-o", "corner.ply"]);
    assert_eq!(code(&overwriting), 2, "{}", stderr(&overwriting));
}

#[test]
fn off_a_terminal_stages_are_plain_lines_on_stderr() {
    let place = Place::new();
    let output = place.run(&["bake", "scene.toml", "--error", "20%", "--no-preview"]);
    let (told, result) = (stderr(&output), stdout(&output));
    assert_eq!(result.lines().count(), 1, "{result}");
    assert!(told.lines().any(|line| line.starts_with("sites")), "{told}");
    assert!(!told.contains('\x1b') && !told.contains('\r'), "no control codes off a terminal: {told:?}");
    let coloured = place.run(&["inspect", "nowhere", "--color", "always"]);
    assert!(stderr(&coloured).starts_with("\x1b[1;31merror:"), "{}", stderr(&coloured));
}

#[test]
fn a_reader_that_leaves_is_no_error() {
    let place = Place::new();
    for words in [&["man"][..], &["completions", "zsh"], &["man", "--json"], &["--help"]] {
        let mut child = place.command(words).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        drop(child.stdout.take());
        let mut complaint = String::new();
        child.stderr.take().unwrap().read_to_string(&mut complaint).unwrap();
        assert_eq!((child.wait().unwrap().code(), complaint.as_str()), (Some(0), ""), "{words:?}");
    }
}

/// Starts path tracing that would take hours, and waits until it is under way.
#[cfg(unix)]
fn endless(place: &Place, points: &str) -> std::process::Child {
    let words = ["reference", "scene.toml", "--points", points, "--spp", "400000000", "-o", "never.csv"];
    let mut child = place.command(&words).stderr(Stdio::piped()).spawn().unwrap();
    let mut told = BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    while !line.starts_with("reference") {
        line.clear();
        assert!(told.read_line(&mut line).unwrap() > 0, "the program never began to trace");
    }
    // Someone must read on, or the program's own messages would fill the pipe.
    std::thread::spawn(move || std::io::copy(&mut told, &mut std::io::sink()));
    child
}

#[cfg(unix)]
fn send(child: &std::process::Child, signal: &str) {
    let sent = std::process::Command::new("kill").args(["-s", signal, &child.id().to_string()]).status();
    assert!(sent.unwrap().success());
}

#[cfg(unix)]
#[test]
fn a_signal_ends_path_tracing_of_hours_at_once() {
    let place = Place::new();
    for (signal, expected) in [("INT", 130), ("TERM", 143)] {
        let mut child = endless(&place, "points.csv");
        let asked = Instant::now();
        send(&child, signal);
        assert_eq!(child.wait().unwrap().code(), Some(expected), "SIG{signal}");
        assert!(asked.elapsed() < Duration::from_secs(5), "{:?}", asked.elapsed());
        assert!(!exists(&place.path("never.csv")));
    }
}

#[cfg(unix)]
#[test]
fn a_second_signal_ends_any_work_at_once_with_its_code() {
    let place = Place::new();
    place.baked("job");
    let head = "x,y,z,nx,ny,nz\n";
    std::fs::write(place.path("many.csv"), head.to_owned() + &"0.3,0,0.4,0,1,0\n".repeat(20_000)).unwrap();
    for (signal, expected) in [("INT", 130), ("TERM", 143)] {
        let words = ["probe", "job", "--points", "many.csv", "-q"];
        let mut child = place.command(&words).stdout(Stdio::piped()).spawn().unwrap();
        // Once something came, the program writes a megabyte into a pipe of 64 KiB that nobody empties.
        child.stdout.as_mut().unwrap().read_exact(&mut [0]).unwrap();
        send(&child, signal);
        std::thread::sleep(Duration::from_millis(300));
        assert!(child.try_wait().unwrap().is_none(), "the first signal waits for the work under way");
        let asked = Instant::now();
        send(&child, signal);
        assert_eq!(child.wait().unwrap().code(), Some(expected), "SIG{signal}");
        assert!(asked.elapsed() < Duration::from_secs(5), "{:?}", asked.elapsed());
    }
}

#[cfg(unix)]
#[test]
fn the_first_signal_ends_work_after_its_block_and_says_so() {
    let place = Place::new();
    let head = "x,y,z,nx,ny,nz\n";
    std::fs::write(place.path("many.csv"), head.to_owned() + &"0.3,0,0.4,0,1,0\n".repeat(100_000)).unwrap();
    for (signal, expected, name) in [("INT", 130, "SIGINT"), ("TERM", 143, "SIGTERM")] {
        let words = [
            "reference",
            "scene.toml",
            "--points",
            "many.csv",
            "--spp",
            "65536",
            "-o",
            "never.csv",
            "--json",
        ];
        let mut child = place.command(&words).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let mut told = BufReader::new(child.stdout.take().unwrap());
        let mut line = String::new();
        told.read_line(&mut line).unwrap();
        send(&child, signal);
        let last = told.lines().map_while(Result::ok).last().unwrap();
        assert!(last.contains(&format!("\"code\":{expected}")) && last.contains(name), "{last}");
        assert_eq!(child.wait().unwrap().code(), Some(expected), "{name}");
        assert!(!exists(&place.path("never.csv")));
    }
}
