//! Speed against accuracy: a ladder of targets for every basis, and of paths for the path tracer, against a reference.
//!
//! Each finished measurement is a line of `measured.jsonl`; the same request again measures what is missing alone.

mod figures;
mod journal;
mod measure;
mod table;
mod truth;

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::archive::Digest;
use crate::bake::Monitor;
use crate::basis::Basis;
use crate::error::{Error, Result};
use crate::scene;

pub use figures::slope;
pub use journal::{JOURNAL_FILE, Journal};
pub use table::{Rise, Slope, TABLE_FILE};
pub use truth::Truth;

/// What light is found by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// A bake in this basis; the target is its relative RMS error.
    Bake(Basis),
    /// The path tracer at the points alone; the target is its paths a point.
    Paths,
}

impl Method {
    /// For people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bake(basis) => basis.name(),
            Self::Paths => "path tracing",
        }
    }
}

/// What is asked of a chart.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// Scenes, each a mesh or a scene file.
    pub scenes: Vec<PathBuf>,
    /// Where everything is written.
    pub folder: PathBuf,
    /// Relative RMS errors.
    pub errors: Vec<f64>,
    /// Bases.
    pub bases: Vec<Basis>,
    /// Paths a point of the path tracer; none for no path tracing.
    pub paths: Vec<u32>,
    /// Paths a point of references that are made.
    pub reference_paths: u32,
    /// Keys every random number of what is measured.
    pub seed: u64,
}

/// What a measurement is known by.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Key {
    /// Version of the program.
    pub program: String,
    /// Digest of the scene's files and of its reference.
    pub digest: String,
    /// By what.
    pub method: Method,
    /// Relative RMS error asked for, or paths a point.
    pub target: f64,
    /// Of the random numbers.
    pub seed: u64,
    /// Worker threads.
    pub threads: usize,
}

/// One measurement.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Measurement {
    /// What it is known by.
    pub key: Key,
    /// The scene's name.
    pub scene: String,
    /// Wall-clock time, scene in memory to solution in memory; of path tracing the points' alone.
    pub seconds: f64,
    /// CPU time of the same.
    pub cpu_seconds: f64,
    /// Time to answer for the points, wall-clock.
    pub answer_seconds: f64,
    /// Points judged.
    pub points: usize,
    /// Rays of a bake; path tracing does not count its own.
    pub rays: Option<u64>,
    /// Sites of a bake.
    pub sites: Option<u64>,
    /// Links of a bake.
    pub links: Option<u64>,
    /// Bytes of the archive of a bake.
    pub bytes: Option<u64>,
    /// Relative RMS error against the reference, its noise taken out.
    pub true_error: f64,
    /// Relative RMS noise of the reference.
    pub noise: f64,
    /// The method's own estimate of its relative RMS error.
    pub estimated_error: f64,
    /// The solver's relative residual after each product.
    pub residuals: Vec<f64>,
}

/// What a chart came to.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Report {
    /// Measurements in the tables.
    pub measurements: usize,
    /// Of them those made by this run.
    pub measured: usize,
    /// Files written.
    pub files: Vec<PathBuf>,
    /// Fitted exponents of error against CPU time.
    pub slopes: Vec<Slope>,
    /// Steps to a tighter target that have a larger error.
    pub risen: Vec<Rise>,
}

/// A scene to be measured, loaded.
struct Subject {
    name: String,
    scene: scene::Scene,
    truth: Truth,
    digest: String,
}

/// Threads of the scaling figure.
const SCALING: [usize; 2] = [1, 2];

/// Measures what is missing, then writes `chart.csv` and the figures.
///
/// # Errors
/// Those of reading scenes and references, of writing, and [`Error::Interrupted`]: what is measured is kept.
pub fn run(request: &Request, monitor: &dyn Monitor) -> Result<Report> {
    let folder = &request.folder;
    std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, "making the folder", e))?;
    let mut journal = Journal::open(&folder.join(JOURNAL_FILE), monitor)?;
    let (mut all, mut measured) = (Vec::new(), 0);
    for (path, name) in request.scenes.iter().zip(names(&request.scenes)) {
        let subject = subject(path, name, request, monitor)?;
        for key in keys(&subject.digest, request) {
            let known = journal.find(&key).cloned();
            all.push(match known {
                Some(known) => Measurement { scene: subject.name.clone(), ..known },
                None => {
                    let made = measure::measure(&subject, &key, folder, monitor)?;
                    measured += 1;
                    journal.append(&made)?
                }
            });
            monitor.check()?;
        }
    }
    let mut files = vec![table::write(&all, folder)?];
    files.extend(figures::write(&all, folder)?);
    let (slopes, risen) = (table::slopes(&all), table::risen(&all));
    Ok(Report { measurements: all.len(), measured, files, slopes, risen })
}

/// The folder's name for `scene.toml`, else the file's; numbered where two are the same.
fn names(scenes: &[PathBuf]) -> Vec<String> {
    let own = |path: &PathBuf| {
        let stem = path.file_stem().unwrap_or_default();
        let whole = std::path::absolute(path).unwrap_or_else(|_| path.clone());
        let parent = whole.parent().and_then(Path::file_name).filter(|_| stem == "scene");
        parent.unwrap_or(stem).to_string_lossy().into_owned()
    };
    let mut names: Vec<String> = Vec::new();
    for name in scenes.iter().map(own) {
        let same = names.iter().filter(|n| **n == name || n.starts_with(&format!("{name}-"))).count();
        names.push(if same == 0 { name } else { format!("{name}-{}", same + 1) });
    }
    names
}

fn subject(path: &Path, name: String, request: &Request, monitor: &dyn Monitor) -> Result<Subject> {
    let scene = scene::load(path)?;
    scene.warnings.iter().for_each(|w| monitor.warn(&format!("{}: {}", w.file.display(), w.message)));
    let mut files = vec![path.to_path_buf()];
    for mesh in &scene.meshes {
        if !files.contains(&mesh.file) {
            files.push(mesh.file.clone());
        }
    }
    let digests = files.iter().map(Digest::of_file).collect::<Result<Vec<_>>>()?;
    let own = Digest::of_digests(&digests);
    let truth = truth::of(path, (&name, own), &scene, request, monitor)?;
    let digest = Digest::of_digests(&[own, truth.digest]).to_string();
    Ok(Subject { name, scene, truth, digest })
}

/// Everything asked of a scene, the cheapest first.
fn keys(digest: &str, request: &Request) -> Vec<Key> {
    let threads = rayon::current_num_threads();
    let key = |method, target, threads| Key {
        program: env!("CARGO_PKG_VERSION").into(),
        digest: digest.into(),
        method,
        target,
        seed: request.seed,
        threads,
    };
    let mut errors = request.errors.clone();
    errors.sort_by(|a, b| b.total_cmp(a));
    let bakes = request
        .bases
        .iter()
        .flat_map(|&basis| errors.iter().map(move |&target| (Method::Bake(basis), target)));
    let paths = request.paths.iter().map(|&spp| (Method::Paths, f64::from(spp)));
    let mut keys: Vec<Key> =
        bakes.chain(paths).map(|(method, target)| key(method, target, threads)).collect();
    // The middle of the ladder: long enough to be measured, short enough for one thread.
    let scaled = errors.get(errors.len() / 2);
    for (&basis, &target) in request.bases.iter().flat_map(|b| scaled.map(|t| (b, t))) {
        for threads in SCALING.into_iter().filter(|&n| n <= available()) {
            let key = key(Method::Bake(basis), target, threads);
            if !keys.contains(&key) {
                keys.push(key);
            }
        }
    }
    keys
}

/// Processors.
fn available() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_have_names_of_their_own() {
        let paths = ["data/cornell/scene.toml", "other/cornell/scene.toml", "a/bunny.ply"].map(PathBuf::from);
        assert_eq!(names(&paths), ["cornell", "cornell-2", "bunny"]);
    }
}
