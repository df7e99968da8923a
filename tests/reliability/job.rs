//! The small scene, its undisturbed job, and comparing others with it.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glowtree::archive::{Digests, Disk, Storage};
use glowtree::bake::job::streams::Streamed;
use glowtree::bake::job::{Inputs, digests};
use glowtree::bake::{Options, Silent, Summary, run_in};

use super::finished::Finished;
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

/// The error target as the command line has it.
pub const ERROR: &str = "50%";

/// The files of a job that any two bakes agree on; the summary tells times.
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
    pub files: BTreeMap<&'static str, Vec<u8>>,
    /// Blocks that an undisturbed bake makes: in ledgers and archives.
    pub blocks: u64,
    /// What the archives carry.
    pub digests: Digests,
    /// Whether the jobs have pictures.
    pub preview: bool,
}

impl Ground {
    /// Writes the scene and bakes it undisturbed.
    pub fn new(preview: bool) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let scene_path = folder.path().join("scene.toml");
        fs::write(&scene_path, SCENE).unwrap();
        fs::write(folder.path().join("corner.ply"), CORNER).unwrap();
        let scene = glowtree::scene::load(&scene_path).unwrap();
        let digests =
            digests(&Inputs::of(&scene_path, &scene, &Streamed::default()).unwrap(), &options(preview))
                .unwrap();
        let mut ground = Self { folder, files: BTreeMap::new(), blocks: 0, digests, preview };
        let job = ground.path("undisturbed");
        ground.blocks = ground.bake(&disk(), &job).unwrap().computed_blocks;
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
        run_in(storage, (&self.scene(), job), &options(self.preview), &Silent)
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
        let options = Options { restart: beginning.restart, ..options(self.preview) };
        run_in(&storage.shared(), (&self.scene(), job), &options, &Silent)
    }

    /// Goes on with a beginning that was killed, by the same command: then the job is as it should be.
    pub fn go_on(&self, beginning: &Beginning, job: &Path) -> Trial {
        if beginning.restart {
            let options = Options { restart: true, ..options(self.preview) };
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
pub fn contents(job: &Path) -> BTreeMap<&'static str, Vec<u8>> {
    FILES.iter().filter_map(|name| Some((*name, fs::read(job.join(name)).ok()?))).collect()
}

/// Whether two jobs hold the same; which file does not, otherwise.
pub fn same(expected: &BTreeMap<&str, Vec<u8>>, got: &BTreeMap<&str, Vec<u8>>) -> Result<(), String> {
    for name in FILES {
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
