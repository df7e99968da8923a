//! The small scene, its undisturbed job, and comparing others with it.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use glowtree::archive::{Archive, Digest, Digests, Disk, Storage};
use glowtree::bake::{Options, Silent, Summary, run_in};

use super::finished::Finished;
use super::program;
use super::storage::Clumsy;
use super::storage::log::{Kind, Mishap};
use super::tally::{Bad, Trial, broken};

/// What most rows bake.
pub const SCENE_IN_WORDS: &str =
    "scene: floor and wall of two triangles each under a point lamp, --error 50 %, picture of 24 × 16";

const SCENE: &str = "[[mesh]]\nfile = \"corner.ply\"\nalbedo = [0.6, 0.5, 0.4]\n\n[[lamp]]\nkind = \"point\"\n\
    position = [0.5, 0.8, 0.5]\nintensity = [1, 1, 1]\n\n[[camera]]\nname = \"front\"\neye = [0.5, 0.7, 2.5]\n\
    target = [0.5, 0.3, 0.0]\nsize = [24, 16]\nfov = 40\n";

const CORNER: &str = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\n\
    property float z\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n\
    0 0 0\n1 0 0\n1 0 1\n0 0 1\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 2 1\n3 0 3 2\n3 4 5 6\n3 4 6 7\n";

/// What joins that scene where a mesh is to stay in its file.
const SHEET: &str = "\n[[mesh]]\nfile = \"sheet.ply\"\nalbedo = [0.7, 0.7, 0.7]\n";

/// Quads along an edge of that mesh, a sheet over the floor.
const QUADS: u32 = 34;

/// Meshes of more triangles stay in their files, as the command line has it.
const RESIDENT: &str = "1000";

/// The error target as the command line has it.
pub const ERROR: &str = "50%";

/// The files of a job that any two bakes agree on, as they do on those of chunks; the summary tells times.
const FILES: [&str; 8] = [
    "scene.glow",
    "sites.glow",
    "links.glow",
    "light.glow",
    "mesh.ply",
    "preview.png",
    "options.json",
    "inputs.json",
];

/// A folder with the scene and room for jobs.
pub struct Ground {
    folder: tempfile::TempDir,
    /// What an undisturbed job holds, by file name.
    pub files: BTreeMap<String, Vec<u8>>,
    /// Blocks that an undisturbed bake makes: in ledgers and archives.
    pub blocks: u64,
    /// What the archives carry.
    pub digests: Digests,
    options: Options,
}

impl Ground {
    /// Writes the scene and bakes it undisturbed, with pictures or without.
    pub fn new(preview: bool) -> Self {
        Self::of(SCENE, options(preview))
    }

    /// The scene with one more mesh, which stays in its file; with pictures.
    pub fn streamed() -> Self {
        let options = Options { resident: RESIDENT.parse().ok(), ..options(true) };
        let ground = Self::of(&[SCENE, SHEET].concat(), options);
        assert!(ground.files.keys().any(|name| name.starts_with("detail-")), "nothing was streamed");
        ground
    }

    fn of(scene: &str, options: Options) -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("scene.toml"), scene).unwrap();
        fs::write(folder.path().join("corner.ply"), CORNER).unwrap();
        fs::write(folder.path().join("sheet.ply"), sheet()).unwrap();
        let digests = Digests { inputs: Digest::of_bytes(b""), options: Digest::of_bytes(b"") };
        let mut ground = Self { folder, files: BTreeMap::new(), blocks: 0, digests, options };
        let job = ground.path("undisturbed");
        ground.blocks = ground.bake(&disk(), &job).unwrap().computed_blocks;
        ground.digests = Archive::open(job.join("scene.glow")).unwrap().digests();
        ground.files = contents(&job);
        ground
    }

    /// A path within.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The scene file.
    pub fn scene(&self) -> PathBuf {
        self.path("scene.toml")
    }

    /// Bakes in this process.
    pub fn bake(&self, storage: &Arc<dyn Storage>, job: &Path) -> glowtree::Result<Summary> {
        run_in(storage, (&self.scene(), job), &self.options, &Silent)
    }

    /// The program's command that bakes.
    pub fn command(&self, job: &Path) -> Command {
        let mut command = program::bake(&self.scene(), job, self.options.preview);
        if self.options.resident.is_some() {
            command.args(["--resident", RESIDENT]);
        }
        command
    }

    /// The ways a bake begins, each with the kinds of its operations: from nothing, from what is left of one that was
    /// killed, and with --restart over a finished one.
    pub fn beginnings(&self) -> Vec<Beginning> {
        let half = self.path("half");
        let mut fresh = Beginning { name: "", left: None, restart: false, kinds: Vec::new() };
        fresh.kinds = self.kinds(&fresh);
        let _ = self.bake(&Clumsy::at(2 * fresh.kinds.len() / 3, Mishap::Killed).shared(), &half);
        let mut resumed = Beginning { name: ", resumed", left: Some(half), ..fresh.clone() };
        resumed.kinds = self.kinds(&resumed);
        let left = Some(self.path("undisturbed"));
        let mut restarted = Beginning { name: ", restarted", left, restart: true, ..fresh.clone() };
        restarted.kinds = self.kinds(&restarted);
        vec![fresh, resumed, restarted]
    }

    fn kinds(&self, beginning: &Beginning) -> Vec<Kind> {
        let (job, storage) = (self.path("counted"), Clumsy::default());
        self.begin(beginning, &storage, &job).unwrap();
        fs::remove_dir_all(&job).unwrap();
        storage.kinds()
    }

    /// Bakes from a beginning.
    pub fn begin(&self, beginning: &Beginning, storage: &Clumsy, job: &Path) -> glowtree::Result<Summary> {
        if let Some(left) = &beginning.left {
            copy(left, job);
        }
        let options = Options { restart: beginning.restart, ..self.options.clone() };
        run_in(&storage.shared(), (&self.scene(), job), &options, &Silent)
    }

    /// Goes on with a beginning that was killed, by the same command: then the job is as it should be.
    pub fn go_on(&self, beginning: &Beginning, job: &Path) -> Trial {
        if beginning.restart {
            let options = Options { restart: true, ..self.options.clone() };
            if let Err(error) = run_in(&disk(), (&self.scene(), job), &options, &Silent) {
                return broken(format!("the restart ended with {}: {error}", error.exit_code()));
            }
        }
        self.rerun(job)
    }

    /// Whether a job holds what the undisturbed one does.
    pub fn same(&self, job: &Path) -> Trial {
        same(&self.files, &contents(job)).map_err(Bad::Wrong)
    }

    /// Goes on with a job that was left as it is, on the plain disk; it must end as the undisturbed one, with all that was
    /// finished reused.
    pub fn rerun(&self, job: &Path) -> Trial {
        let before = Finished::of(job, self.digests);
        match self.bake(&disk(), job) {
            Ok(summary) => {
                self.same(job)?;
                before.is_reused(job, (summary.resumed_blocks, summary.computed_blocks))
            }
            Err(error) => broken(format!("the rerun ended with {}: {error}", error.exit_code())),
        }
    }
}

/// How a bake begins.
#[derive(Clone, Debug)]
pub struct Beginning {
    /// Words that follow a trial's name.
    pub name: &'static str,
    left: Option<PathBuf>,
    restart: bool,
    /// All its operations.
    pub kinds: Vec<Kind>,
}

/// Copies a folder with all in it.
pub fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().flatten() {
        let (path, to) = (entry.path(), to.join(entry.file_name()));
        if path.is_dir() {
            copy(&path, &to);
        } else {
            fs::copy(path, to).unwrap();
        }
    }
}

/// The options of the small bake.
pub fn options(preview: bool) -> Options {
    Options { error: 0.5, preview, ..Options::default() }
}

/// The plain disk.
pub fn disk() -> Arc<dyn Storage> {
    Arc::new(Disk)
}

/// The files of a job that bakes agree on.
pub fn contents(job: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = fs::read_dir(job).into_iter().flatten().flatten();
    let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
    let agreed = |name: &String| {
        FILES.contains(&name.as_str()) || name.starts_with("detail-") && name.ends_with(".glow")
    };
    names.filter(agreed).filter_map(|name| Some((name.clone(), fs::read(job.join(&name)).ok()?))).collect()
}

/// A sheet with waves, of some thousand triangles, ascii.
fn sheet() -> String {
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        (QUADS + 1) * (QUADS + 1),
        QUADS * QUADS
    );
    for (i, k) in (0..=QUADS).flat_map(|i| (0..=QUADS).map(move |k| (i, k))) {
        let [x, z] = [i, k].map(|at| 0.2 + 0.6 * f64::from(at) / f64::from(QUADS));
        let _ = writeln!(text, "{x} {} {z}", 0.2 + 0.03 * (9.0 * x).sin() * (7.0 * z).cos());
    }
    for (i, k) in (0..QUADS).flat_map(|i| (0..QUADS).map(move |k| (i, k))) {
        let at = i * (QUADS + 1) + k;
        let _ = writeln!(text, "4 {at} {} {} {}", at + 1, at + QUADS + 2, at + QUADS + 1);
    }
    text
}

/// Whether two jobs hold the same; which file does not, otherwise.
pub fn same(expected: &BTreeMap<String, Vec<u8>>, got: &BTreeMap<String, Vec<u8>>) -> Result<(), String> {
    let names: BTreeSet<&String> = expected.keys().chain(got.keys()).collect();
    for name in names {
        match (expected.get(name), got.get(name)) {
            (there, here) if there == here => {}
            (Some(there), Some(here)) => {
                let first = there.iter().zip(here).position(|(a, b)| a != b);
                let (there, here) = (there.len(), here.len());
                return Err(format!("{name}: {here} bytes for {there}, first difference {first:?}"));
            }
            (Some(_), None) => return Err(format!("{name} is missing")),
            _ => return Err(format!("{name} should not be there")),
        }
    }
    Ok(())
}
