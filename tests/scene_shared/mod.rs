//! What the scene tests share: where the test data lies, and files made on the spot.
#![allow(dead_code, clippy::allow_attributes)]

use std::path::{Path, PathBuf};

use glowtree::Error;
use glowtree::scene::{self, Scene};

/// The folder of test data: `GLOWTREE_SHARED`, or `../shared` beside the crate; says so when there is none.
pub fn shared(below: &str) -> Option<PathBuf> {
    let root = std::env::var_os("GLOWTREE_SHARED")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let folder = root.join(below);
    if folder.exists() {
        return Some(folder);
    }
    println!("skipped: there is no {}", folder.display());
    None
}

/// A folder that vanishes with the test.
pub struct Folder(tempfile::TempDir);

impl Folder {
    /// An empty one.
    pub fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    /// Writes a file and gives its path.
    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).expect("writing a test file");
        path
    }

    /// Writes a file and reads it as a scene.
    pub fn load(&self, name: &str, bytes: impl AsRef<[u8]>) -> Result<Scene, Error> {
        scene::load(&self.write(name, bytes))
    }
}

/// Triangles of a scene and those left out for want of area, by the warnings' own count.
pub fn triangles_in_file(scene: &Scene) -> usize {
    let dropped = |message: &str| {
        let (count, _) = message.split_once(" triangles without area dropped")?;
        count.parse::<usize>().ok()
    };
    scene.triangles.len() + scene.warnings.iter().filter_map(|w| dropped(&w.message)).sum::<usize>()
}

/// A square of two triangles in the plane z = 0, ascii.
pub const SQUARE_PLY: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n";
