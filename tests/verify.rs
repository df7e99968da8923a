//! `verify` and `--repair`: whatever is damaged is named, and comes back byte by byte.
#![allow(clippy::unwrap_used)] // a test that cannot go on panics where it stands

mod command;
#[path = "verify/damage.rs"]
mod damage;
#[path = "verify/flips.rs"]
mod flips;
#[path = "verify/invariants.rs"]
mod invariants;
#[path = "verify/program.rs"]
mod program;
#[cfg(unix)]
#[path = "verify/readers.rs"]
mod readers;

use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use glowtree::archive::Archive;
use glowtree::bake::verify::{ARCHIVES, Report, repair, verify};
use glowtree::bake::{self, Options, Silent};

/// A baked job, its scene and room for copies; made once.
pub struct Baked {
    folder: tempfile::TempDir,
}

/// The Cornell box, coarse: half a megabyte in 41 blocks.
pub fn baked() -> &'static Baked {
    static BAKED: OnceLock<Baked> = OnceLock::new();
    BAKED.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let baked = Baked { folder };
        copy(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/data/cornell")), &baked.path("cornell"));
        baked.bake("cornell", "job");
        baked
    })
}

impl Baked {
    /// A path in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The whole job, not to be touched.
    pub fn job(&self) -> PathBuf {
        self.path("job")
    }

    /// Bakes one of the scenes here.
    pub fn bake(&self, scene: &str, job: &str) {
        let options = Options { error: 0.2, preview: false, ..Options::default() };
        bake::run(&self.path(scene).join("scene.toml"), &self.path(job), &options, &Silent).unwrap();
    }

    /// A copy of the job to be damaged, in a folder of its own.
    pub fn copy(&self) -> Copy {
        let folder = tempfile::tempdir_in(self.folder.path()).unwrap();
        copy(&self.job(), &folder.path().join("job"));
        Copy { folder }
    }
}

/// A job that may be damaged.
pub struct Copy {
    folder: tempfile::TempDir,
}

impl Copy {
    /// The copy.
    pub fn job(&self) -> PathBuf {
        self.folder.path().join("job")
    }

    /// One of its files.
    pub fn file(&self, name: &str) -> PathBuf {
        self.job().join(name)
    }

    /// What verifying finds.
    pub fn verify(&self) -> Report {
        verify(&self.job(), &Silent).unwrap()
    }

    /// Changes the bytes of a file.
    pub fn edit(&self, name: &str, change: impl FnOnce(&mut Vec<u8>)) {
        let mut bytes = fs::read(self.file(name)).unwrap();
        change(&mut bytes);
        fs::write(self.file(name), bytes).unwrap();
    }

    /// Repairs the job, insists that it is as it was, and says how many blocks were made, how many files, and whether by a
    /// new bake.
    pub fn repaired(&self, what: &str) -> (u64, usize, bool) {
        let repaired = repair(&self.job(), &self.verify(), &Silent).unwrap_or_else(|e| panic!("{what}: {e}"));
        assert!(self.verify().is_whole(), "{what}");
        self.is_as_it_was(what);
        (repaired.made_blocks(), repaired.files.len(), repaired.rebaked)
    }

    /// Insists that all files are there, byte by byte; the summary tells times.
    pub fn is_as_it_was(&self, what: &str) {
        let names: Vec<String> = files(&self.job());
        assert_eq!(names, files(&baked().job()), "{what}: no litter, nothing missing");
        for name in names.iter().filter(|name| *name != "summary.json") {
            let same = fs::read(self.file(name)).unwrap() == fs::read(baked().job().join(name)).unwrap();
            assert!(same, "{what}: {name} is not what it was");
        }
        assert_eq!(files(self.folder.path()), ["job"], "{what}: no litter beside the job");
    }
}

fn files(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Copies a folder of files.
pub fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for name in files(from) {
        fs::copy(from.join(&name), to.join(&name)).unwrap();
    }
}

/// A block's number, tag and bytes in its file: header, payload, padding.
pub struct Span {
    /// Number in the file.
    pub number: u64,
    /// What it holds.
    pub tag: String,
    /// All of it.
    pub bytes: Range<usize>,
    /// Without header and padding.
    pub payload: Range<usize>,
}

/// The blocks of an archive of the baked job, and the place of its directory.
pub fn spans(kind: &str) -> (Vec<Span>, usize) {
    let archive = Archive::open(baked().job().join(format!("{kind}.glow"))).unwrap();
    let span = |block: glowtree::archive::Block<'_>| {
        let entry = block.entry();
        let (start, stored) = (entry.offset as usize, entry.stored_bytes as usize);
        let payload = start + 64..start + 64 + stored;
        let bytes = start..payload.end.next_multiple_of(64);
        Span { number: block.number() as u64, tag: entry.tag.to_string().replace('`', ""), bytes, payload }
    };
    let spans: Vec<Span> = archive.all_blocks().map(span).collect();
    let end = spans.last().unwrap().bytes.end;
    (spans, end)
}

#[test]
fn a_fresh_job_is_whole() {
    let copy = baked().copy();
    let report = copy.verify();
    assert_eq!(report.damages, []);
    let blocks: usize = ARCHIVES.iter().map(|kind| spans(kind).0.len()).sum();
    let bytes: u64 = files(&copy.job()).iter().map(|f| fs::metadata(copy.file(f)).unwrap().len()).sum();
    assert_eq!((report.files, report.blocks, report.examined_bytes), (7, blocks as u64, bytes));
    assert_eq!(report.notes, ["preview.png: absent", "mesh.ply: absent"]);
    println!("{} files, {blocks} blocks, {bytes} bytes examined", report.files);
}

#[test]
fn no_job_is_no_damage() {
    let place = tempfile::tempdir().unwrap();
    assert_eq!(verify(place.path(), &Silent).unwrap_err().exit_code(), 10);
    assert_eq!(verify(&place.path().join("nowhere"), &Silent).unwrap_err().exit_code(), 10);
    // Neither a summary nor all archives: a bake that did not come to its end.
    let copy = baked().copy();
    fs::remove_file(copy.file("summary.json")).unwrap();
    fs::remove_file(copy.file("light.glow")).unwrap();
    assert_eq!(verify(&copy.job(), &Silent).unwrap_err().exit_code(), 10);
}

/// A side file's text under the checksum that belongs to it: docs/format.md.
pub fn sealed(text: &str) -> Vec<u8> {
    let mut value: serde_json::Value = serde_json::from_str(text).unwrap();
    value.as_object_mut().unwrap().remove("checksum");
    let body = serde_json::to_string_pretty(&value).unwrap();
    let with = |digits: &str| format!("{{\n  \"checksum\": \"{digits}\",\n{}\n", &body[2..]);
    let digest = glowtree::archive::Digest::of_bytes(with(&"0".repeat(32)).as_bytes());
    with(&digest.to_string()).into_bytes()
}
