//! What the scene tests share: where the test data lies, and files made on the spot.
#![allow(dead_code, clippy::allow_attributes)]

pub mod pictures;

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

    /// Where it lies.
    pub fn path(&self) -> &Path {
        self.0.path()
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

/// A GLB from its JSON and its binary chunk.
pub fn glb(json: &str, binary: &[u8]) -> Vec<u8> {
    let padded = |bytes: &[u8], with: u8| {
        let mut bytes = bytes.to_vec();
        bytes.resize(bytes.len().next_multiple_of(4), with);
        bytes
    };
    let (json, binary) = (padded(json.as_bytes(), b' '), padded(binary, 0));
    let mut bytes = b"glTF".to_vec();
    for word in [2, (12 + 8 + json.len() + 8 + binary.len()) as u32, json.len() as u32, 0x4e4f_534a] {
        bytes.extend(word.to_le_bytes());
    }
    bytes.extend(&json);
    bytes.extend((binary.len() as u32).to_le_bytes());
    bytes.extend(0x004e_4942u32.to_le_bytes());
    bytes.extend(&binary);
    bytes
}

/// The parts of [`small_glb`]: its JSON, and 4 positions, 4 texture coordinates and 6 indices (u16).
pub fn small_glb_parts() -> (String, Vec<u8>) {
    let mut binary = Vec::new();
    for value in [0f32, 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0., 0., 0., 1., 0., 1., 1., 0., 1.] {
        binary.extend(value.to_le_bytes());
    }
    [0u16, 1, 2, 0, 2, 3].iter().for_each(|index| binary.extend(index.to_le_bytes()));
    let json = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],
"extensionsUsed":["KHR_lights_punctual","KHR_materials_emissive_strength"],
"extensions":{"KHR_lights_punctual":{"lights":[{"type":"point","intensity":8,"color":[1,0.5,0.25]},
{"type":"spot","intensity":4,"spot":{"innerConeAngle":0.2,"outerConeAngle":0.4}},{"type":"directional","intensity":2}]}},
"nodes":[{"name":"root","scale":[2,2,2],"children":[1,2,3,4]},{"name":"wall","mesh":0,"translation":[0,0,3]},
{"name":"bulb","translation":[1,1,1],"extensions":{"KHR_lights_punctual":{"light":0}}},
{"name":"beam","rotation":[0,1,0,0],"extensions":{"KHR_lights_punctual":{"light":1}}},
{"name":"eye","camera":0,"translation":[0,0,9]}],
"cameras":[{"type":"perspective","perspective":{"yfov":0.7,"aspectRatio":1.5,"znear":0.1}}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0,"TEXCOORD_0":1},"indices":2,"material":0}]}],
"materials":[{"name":"plaster","doubleSided":true,"pbrMetallicRoughness":{"baseColorFactor":[0.5,0.25,0.125,1],"metallicFactor":0},
"emissiveFactor":[1,0.5,0],"extensions":{"KHR_materials_emissive_strength":{"emissiveStrength":6}}}],
"accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[0,0,0],"max":[1,1,0]},
{"bufferView":1,"componentType":5126,"count":4,"type":"VEC2"},
{"bufferView":2,"componentType":5123,"count":6,"type":"SCALAR"}],
"bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":32},
{"buffer":0,"byteOffset":80,"byteLength":12}],
"buffers":[{"byteLength":92}]}"#;
    (json.to_string(), binary)
}

/// A square under a node of scale 2, with lamps, a camera and an emitting material.
pub fn small_glb() -> Vec<u8> {
    let (json, binary) = small_glb_parts();
    glb(&json, &binary)
}
