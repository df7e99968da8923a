//! What `--json` prints is what `docs/schema.json` says, for every verb.

#![allow(clippy::unwrap_used)] // a test that cannot go on panics where it stands

mod command;

use command::{Place, code, lines, stderr};
use serde_json::{Value, json};

fn schema() -> Value {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/schema.json");
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// Checks `value` against the part of JSON Schema that the file uses; the first violation, with its place.
fn check(root: &Value, rule: &Value, value: &Value, place: &str) -> Result<(), String> {
    for (word, wanted) in rule.as_object().ok_or("a rule is an object")? {
        let holds = match word.as_str() {
            "$schema" | "title" | "description" | "$defs" | "properties" => true,
            "$ref" => {
                let target = wanted
                    .as_str()
                    .and_then(|r| root.pointer(r.trim_start_matches('#')))
                    .ok_or("dangling $ref")?;
                check(root, target, value, place)?;
                true
            }
            "const" => value == wanted,
            "enum" => wanted.as_array().is_some_and(|all| all.contains(value)),
            "type" => match wanted {
                Value::Array(any) => any.iter().any(|name| is_type(value, name)),
                one => is_type(value, one),
            },
            "minimum" => value.as_f64().is_none_or(|v| v >= wanted.as_f64().unwrap_or(f64::NAN)),
            "required" => wanted
                .as_array()
                .is_some_and(|all| all.iter().all(|k| value.get(k.as_str().unwrap()).is_some())),
            "items" => {
                for (k, item) in value.as_array().into_iter().flatten().enumerate() {
                    check(root, wanted, item, &format!("{place}[{k}]"))?;
                }
                true
            }
            "additionalProperties" => {
                let known = rule.get("properties").and_then(Value::as_object);
                wanted == &json!(false)
                    && value
                        .as_object()
                        .is_some_and(|o| o.keys().all(|k| known.is_some_and(|known| known.contains_key(k))))
            }
            "oneOf" => {
                let fitting =
                    wanted.as_array().into_iter().flatten().filter(|r| check(root, r, value, place).is_ok());
                fitting.count() == 1
            }
            other => return Err(format!("the validator does not know {other}")),
        };
        if !holds {
            return Err(format!("{place}: {value} does not satisfy {word}: {wanted}"));
        }
    }
    for (name, rule) in rule.get("properties").and_then(Value::as_object).into_iter().flatten() {
        if let Some(member) = value.get(name) {
            check(root, rule, member, &format!("{place}.{name}"))?;
        }
    }
    Ok(())
}

fn is_type(value: &Value, name: &Value) -> bool {
    match name.as_str() {
        Some("object") => value.is_object(),
        Some("array") => value.is_array(),
        Some("string") => value.is_string(),
        Some("boolean") => value.is_boolean(),
        Some("null") => value.is_null(),
        Some("number") => value.is_number(),
        Some("integer") => value.is_i64() || value.is_u64(),
        _ => false,
    }
}

/// Runs a verb with `--json`, holds every line to the schema and the last one to the exit code; gives the lines.
fn held(place: &Place, words: &[&str], expected: i32) -> Vec<Value> {
    let output = place.run(&[words, &["--json"]].concat());
    assert_eq!(code(&output), expected, "{words:?}: {}", stderr(&output));
    let (schema, lines) = (schema(), lines(&output));
    for line in &lines {
        if let Err(problem) = check(&schema, &schema, line, "line") {
            let kind = line["verb"].as_str().or(line["type"].as_str()).unwrap_or_default().to_owned();
            let detail = schema["$defs"]
                .as_object()
                .unwrap()
                .iter()
                .map(|(k, r)| format!("{k}: {:?}", check(&schema, r, line, &kind).err()));
            panic!("{words:?}: {problem}\n{}", detail.collect::<Vec<_>>().join("\n"));
        }
    }
    let last = lines.last().expect("a last line");
    if expected == 0 {
        assert_eq!((&last["type"], &last["verb"]), (&json!("summary"), &json!(words[0])));
    } else {
        assert_eq!((&last["type"], &last["code"]), (&json!("error"), &json!(expected)));
    }
    lines
}

#[test]
fn every_verb_speaks_the_schema() {
    let place = Place::new();
    let lines = held(&place, &["bake", "scene.toml", "-o", "job", "--error", "20%"], 0);
    let summary = lines.last().unwrap();
    assert!(
        summary["sites"].as_u64().unwrap() > 0 && summary["vertices"] == 50 && summary["triangles"] == 64
    );
    let names: Vec<&str> =
        summary["stages"].as_array().unwrap().iter().filter_map(|s| s["name"].as_str()).collect();
    assert!(names.ends_with(&["preview", "transfer"]), "a scene of several lights: {names:?}");
    for name in names {
        for event in ["started", "finished"] {
            let told =
                |line: &&Value| line["type"] == "status" && line["stage"] == name && line["event"] == event;
            assert_eq!(lines.iter().filter(told).count(), 1, "{name} {event}");
        }
    }
    let foretold =
        held(&place, &["bake", "scene.toml", "-o", "other", "--error", "20%", "--dry-run"], 0).pop();
    assert_eq!(foretold.unwrap()["triangles"], 64);
    assert!(!place.path("other").exists());
    held(&place, &["verify", "job"], 0);
    spoil(&place.path("job/links.glow"));
    held(&place, &["verify", "job"], 9);
    let repaired = held(&place, &["verify", "job", "--repair"], 0).pop().unwrap();
    assert_eq!(repaired["repaired"]["files"].as_array().map(Vec::len), Some(1), "{repaired}");
    held(&place, &["inspect", "job"], 0);
    held(&place, &["inspect", "job", "--plot", "plots"], 0);
    held(&place, &["probe", "job", "--points", "points.csv", "-o", "out.csv"], 0);
    held(&place, &["reference", "scene.toml", "--points", "points.csv", "--spp", "16", "-o", "ref.csv"], 0);
    held(&place, &["export", "job", "-o", "out.ply"], 0);
    held(&place, &["render", "job", "-o", "out.png"], 0);
    held(&place, &["render", "job", "--camera", "front", "-o", "out.exr"], 0);
    let points = ["relight", "job", "--set", "lamp.scale=2", "--points", "points.csv", "-o", "relit.csv"];
    let relit = held(&place, &points, 0).pop().unwrap();
    assert_eq!((relit["points"].as_u64(), relit["rays"].as_u64()), (Some(2), Some(0)), "{relit}");
    held(&place, &["relight", "job", "--set", "sky.radiance=0.5", "-o", "relit.ply"], 0);
    held(&place, &["relight", "job", "--set", "corner.albedo=0.2,0.3,0.4", "-o", "relit.png"], 0);
    held(&place, &["relight", "job", "--set", "corner.albdo=0.2", "-o", "relit.ply"], 2);
    std::fs::write(place.path("keys.toml"), "[[key]]\nframe = 1\nset = [\"lamp.scale=0.5\"]\n").unwrap();
    held(&place, &["relight", "job", "--animate", "keys.toml", "-o", "frame_#.ply"], 0);
    let ladder =
        ["chart", "scene.toml", "-o", "charts", "--errors", "50%", "--spp", "16", "--reference-spp", "16"];
    held(&place, &ladder, 0);
    held(&place, &["completions", "bash"], 0);
    held(&place, &["man"], 0);
}

#[cfg(unix)]
#[test]
fn a_server_says_where_it_is_and_how_it_ended() {
    use std::io::BufRead as _;
    let place = Place::new();
    place.baked("job");
    let mut command = place.command(&["view", "job", "--vertices", "500", "--json"]);
    let mut child = command.stdout(std::process::Stdio::piped()).spawn().unwrap();
    let told = std::io::BufReader::new(child.stdout.take().unwrap());
    let (schema, mut kinds) = (schema(), Vec::new());
    for line in told.lines() {
        let line: Value = serde_json::from_str(&line.unwrap()).unwrap();
        assert_eq!(check(&schema, &schema, &line, "line"), Ok(()));
        let kind = line["type"].as_str().unwrap().to_owned();
        if kind == "serving" {
            std::process::Command::new("kill").args(["-s", "INT", &child.id().to_string()]).status().unwrap();
        }
        kinds.push(kind);
    }
    assert_eq!(kinds[kinds.len() - 2..], ["serving", "error"]);
    assert_eq!(child.wait().unwrap().code(), Some(130));
    held(&place, &["view", "nowhere"], 10);
}

/// Flips a bit in the middle of a file.
fn spoil(path: &std::path::Path) {
    let mut bytes = std::fs::read(path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn every_failure_speaks_the_schema() {
    let place = Place::new();
    held(&place, &["inspect", "nowhere"], 10);
    held(&place, &["verify", "nowhere"], 10);
    held(&place, &["bake", "missing.ply"], 4);
    held(&place, &["bake", "scene.toml", "--error", "nonsense"], 2);
    held(&place, &["frobnicate"], 2);
    held(&place, &["chart", "scene.toml"], 2);
    held(&place, &["probe", "job", "--points", "points.csv"], 2);
    std::fs::write(place.path("bad.ply"), "ply\n").unwrap();
    held(&place, &["bake", "bad.ply"], 4);
}

#[test]
fn progress_none_leaves_the_summary_alone() {
    let place = Place::new();
    let words = ["bake", "scene.toml", "-o", "job", "--error", "20%", "--no-preview", "--progress", "none"];
    assert_eq!(held(&place, &words, 0).len(), 1);
    assert!(!place.path("job/preview.png").exists() && !place.path("job/mesh.ply").exists());
}

#[test]
fn the_validator_notices() {
    let schema = schema();
    let good = json!({"type": "warning", "message": "so"});
    assert_eq!(check(&schema, &schema, &good, "line"), Ok(()));
    let number = json!({"what": "leak", "value": null, "limit": 1e-3, "unit": "percent"});
    let row = json!({"type": "row", "number": 5, "case": "thin wall", "scheme": null, "textbook": [],
        "ours": [number], "holds": false});
    assert_eq!(check(&schema, &schema, &row, "line"), Ok(()));
    for bad in [
        json!({"type": "warning"}),
        json!({"type": "warning", "message": 3}),
        json!({"type": "warning", "message": "so", "more": 1}),
        json!({"type": "error", "code": 5, "message": "so"}),
        json!({"type": "status"}),
        json!({"type": "summary", "verb": "export", "output": "a", "written_bytes": -1, "seconds": 0, "cpu_seconds": 0,
            "peak_anonymous_bytes": 0, "peak_resident_bytes": 0}),
        json!([]),
    ] {
        assert!(check(&schema, &schema, &bad, "line").is_err(), "{bad}");
    }
}
