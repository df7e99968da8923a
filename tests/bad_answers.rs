//! Bad inputs by name, each with its exact exit code and message in `bad_input/answers.txt`.
//!
//! A message is part of the program: it names the file, the place, what is wrong and what to do, in one line. Whoever
//! changes one reads it in the difference of that file. `GLOWTREE_RENEW=1 cargo test --release --test bad_answers`
//! writes the file anew.

mod command;
#[path = "bad_input/gltf.rs"]
mod gltf;
#[path = "bad_input/obj.rs"]
mod obj;
#[path = "bad_input/pictures.rs"]
mod pictures;
#[path = "bad_input/ply.rs"]
mod ply;
#[path = "bad_input/points.rs"]
mod points;
mod scene_shared;
#[path = "bad_input/scenes.rs"]
mod scenes;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use glowtree::Error;
use glowtree::output::points::PointTable;
use scene_shared::{Folder, SQUARE_PLY, shared};

/// What is asked of an input.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Ask {
    /// To be read as a scene: a mesh or a scene file.
    Scene,
    /// To be read as a table of points.
    Points,
}

/// A bad input.
pub struct Case {
    name: String,
    /// The file that is asked for.
    file: String,
    /// All files of its folder.
    files: Vec<(String, Vec<u8>)>,
    ask: Ask,
}

impl Case {
    /// An input of one file.
    pub fn new(name: &str, file: &str, bytes: impl AsRef<[u8]>, ask: Ask) -> Self {
        let files = vec![(file.to_string(), bytes.as_ref().to_vec())];
        Self { name: name.to_string(), file: file.to_string(), files, ask }
    }

    /// An input whose file is not there.
    pub fn missing(name: &str, file: &str, ask: Ask) -> Self {
        Self { name: name.to_string(), file: file.to_string(), files: Vec::new(), ask }
    }

    /// With another file beside it.
    pub fn with(mut self, file: &str, bytes: impl AsRef<[u8]>) -> Self {
        self.files.push((file.to_string(), bytes.as_ref().to_vec()));
        self
    }

    fn write(&self, folder: &Path) {
        for (name, bytes) in &self.files {
            std::fs::write(folder.join(name), bytes).expect("writing a bad input");
        }
    }
}

/// An input that is read as a scene.
pub fn scene(name: &str, file: &str, bytes: impl AsRef<[u8]>) -> Case {
    Case::new(name, file, bytes, Ask::Scene)
}

/// No input may take longer, on a busy machine.
const PATIENCE: Duration = Duration::from_secs(10);

/// Exit code and message; for what loads nevertheless, 0 and the warnings.
fn answer(path: &Path, ask: Ask) -> (u8, String) {
    let start = Instant::now();
    let read = match ask {
        Ask::Scene => glowtree::scene::load(path).map(|scene| {
            let warnings: Vec<&str> = scene.warnings.iter().map(|warning| &warning.message[..]).collect();
            if warnings.is_empty() { "loads".to_string() } else { format!("loads; {}", warnings.join("; ")) }
        }),
        Ask::Points => PointTable::read(path).map(|table| format!("{} points", table.len())),
    };
    assert!(start.elapsed() < PATIENCE, "{} took {:?}", path.display(), start.elapsed());
    match read {
        Ok(said) => (0, said),
        Err(error) => {
            if let Error::Input { place, problem, remedy, .. } = &error {
                assert!(!place.is_empty() && !problem.is_empty() && !remedy.is_empty(), "{error}");
            }
            (error.exit_code(), error.to_string())
        }
    }
}

/// One line of the record: the name, the exit code, and the message without the folder. A message of several lines, with
/// control characters or without end is marked, which no record may hold.
fn line(name: &str, (code, said): (u8, String), folder: &Path) -> String {
    let mut said =
        said.replace(&format!("{}/", folder.display()), "").replace(&folder.display().to_string(), ".");
    if said.chars().any(char::is_control) || said.chars().count() > 700 {
        said = format!(
            "UNFIT: {} characters: {}",
            said.chars().count(),
            said.chars().take(300).collect::<String>().escape_debug()
        );
    }
    format!("{name} | {code} | {said}")
}

fn cases() -> Vec<Case> {
    let mut all = ply::cases();
    all.extend(obj::cases());
    all.extend(gltf::cases());
    all.extend(scenes::cases());
    all.extend(pictures::cases());
    all.extend(points::cases());
    all
}

/// The record's lines by name.
fn by_name(lines: &str) -> BTreeMap<&str, &str> {
    let lines = lines.lines().filter(|line| !line.is_empty() && !line.starts_with('#'));
    lines.map(|line| (line.split(" | ").next().unwrap_or_default(), line)).collect()
}

/// Compares answers with a record, or renews it.
fn compare(record_name: &str, given: &[String]) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/bad_input").join(record_name);
    let text = given.iter().fold(String::new(), |text, line| text + line + "\n");
    let now = by_name(&text);
    assert_eq!(now.len(), given.len(), "every input has a name of its own");
    println!("{record_name}: {} bad inputs", given.len());
    if std::env::var_os("GLOWTREE_RENEW").is_some() {
        let head = "# name | exit code | message. Written by GLOWTREE_RENEW=1 cargo test --release --test bad_answers; read what changes.\n";
        std::fs::write(&file, format!("{head}{text}")).expect("writing the record");
    }
    let unfit: Vec<&&str> = now.values().filter(|line| line.contains(" | UNFIT: ")).collect();
    assert!(unfit.is_empty(), "one short line is wanted: {unfit:#?}");
    let record = std::fs::read_to_string(&file).unwrap_or_default();
    let before = by_name(&record);
    let mut differences = String::new();
    for name in before.keys().chain(now.keys()).collect::<std::collections::BTreeSet<_>>() {
        match (before.get(name), now.get(name)) {
            (Some(was), Some(is)) if was == is => {}
            (Some(was), Some(is)) => differences += &format!("- {was}\n+ {is}\n"),
            (Some(was), None) => differences += &format!("- {was}\n  was not asked\n"),
            (None, Some(is)) => differences += &format!("+ {is}\n  is not in the record\n"),
            (None, None) => {}
        }
    }
    assert!(
        differences.is_empty(),
        "{record_name} differs:\n{differences}If the new answers are better, write them down with\n  \
         GLOWTREE_RENEW=1 cargo test --release --test bad_answers"
    );
}

#[test]
fn our_own_bad_inputs_get_their_answers() {
    let lines: Vec<String> = cases()
        .iter()
        .map(|case| {
            let folder = Folder::new();
            case.write(folder.path());
            line(&case.name, answer(&folder.path().join(&case.file), case.ask), folder.path())
        })
        .collect();
    assert!(lines.len() >= 150, "{}", lines.len());
    compare("answers.txt", &lines);
}

#[test]
fn the_collected_bad_inputs_get_their_answers() {
    let Some(data) = shared("data/bad-input") else { return };
    let mut files = Vec::new();
    list(&data, &mut files);
    files.sort();
    let mut lines = Vec::new();
    for path in files {
        let name = path.strip_prefix(&data).expect("a file of the folder").to_string_lossy().into_owned();
        let said = if path.extension().is_some_and(|e| e == "exr") {
            let folder = Folder::new();
            folder.write("square.ply", SQUARE_PLY);
            let text =
                format!("[[mesh]]\nfile = \"square.ply\"\n[sky]\nfile = {:?}\n", path.to_string_lossy());
            answer(&folder.write("scene.toml", text), Ask::Scene)
        } else {
            answer(&path, Ask::Scene)
        };
        lines.push(line(&name, said, path.parent().unwrap_or(&data)));
    }
    compare("collected.txt", &lines);
}

fn list(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("the folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            list(&path, found);
        } else if path.extension().is_some_and(|e| e != "md" && e != "bin") {
            found.push(path);
        }
    }
}

/// Every tenth refused input through the program: the same code, and the same line on standard error.
#[test]
fn the_program_gives_the_same_answers() {
    let place = command::Place::new();
    place.baked("job");
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/bad_input/answers.txt");
    let record = std::fs::read_to_string(file).expect("the record");
    let record = by_name(&record);
    let refused = |case: &Case| record.get(&case.name[..]).is_some_and(|line| !line.contains(" | 0 | "));
    let mut asked = 0;
    for case in cases().iter().filter(|case| refused(case)).step_by(10) {
        let folder = Folder::new();
        case.write(folder.path());
        let path = folder.path().join(&case.file);
        let path = path.to_string_lossy();
        let output = match case.ask {
            Ask::Scene => place.run(&["bake", &path, "-o", "refused", "--error", "20%"]),
            Ask::Points => place.run(&["probe", "job", "--points", &path, "-o", "refused.csv"]),
        };
        let said = command::stderr(&output);
        let said = said.trim_end().rsplit('\n').next().unwrap_or_default();
        let said = said.strip_prefix("error: ").unwrap_or(said).to_string();
        let code = u8::try_from(command::code(&output)).expect("an exit code");
        assert_eq!(line(&case.name, (code, said), folder.path()), record[&case.name[..]]);
        assert!(command::stdout(&output).is_empty(), "{}: {}", case.name, command::stdout(&output));
        assert!(!place.path("refused.csv").exists(), "{} left a table", case.name);
        asked += 1;
    }
    println!("{asked} of them through the program");
    assert!(asked >= 24, "{asked}");
}
