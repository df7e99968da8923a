//! What each fuzz target does with its bytes: reads them as a user's file and holds the answer to the promise. The
//! targets of `tools/fuzz` and the replay of their corpus share this file.
#![allow(dead_code, clippy::allow_attributes)] // every target uses a part of it

pub mod chunks;

use std::collections::HashMap;
use std::io::{self, Cursor, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use glowtree::Error;
use glowtree::archive::{Archive, Digest, Digests, Storage, StoredFile, Tag, Writer, partial_path, verify};
use glowtree::bake::transfer::codec;
use glowtree::light::Rgb;
use glowtree::output::points::PointTable;
use glowtree::scene::{self, LampKind, Scene, Sky, materials, sky};

/// A target: reads bytes, and panics when the answer breaks a promise.
pub type Reader = fn(&[u8]);

/// All targets by name; each has a folder of seeds.
pub const TARGETS: [(&str, Reader); 9] = [
    ("ply", ply),
    ("obj", obj),
    ("gltf", gltf),
    ("scene", scene),
    ("points", points),
    ("picture", picture),
    ("archive", archive),
    ("detail", chunks::detail),
    ("transfer", transfer),
];

/// A square that scene files may name as `square.ply`; it has texture coordinates and colours.
const SQUARE: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
property float u\nproperty float v\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n\
property list uchar int vertex_indices\nend_header\n0 0 0 0 0 9 9 9\n1 0 0 1 0 9 9 9\n1 1 0 1 1 9 9 9\n0 1 0 0 1 9 9 9\n\
4 0 1 2 3\n";

/// A sky of two grey pixels.
const SKY: &[u8] = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n\x80\x80\x80\x81\x80\x80\x80\x81";

thread_local! {
    static DESK: tempfile::TempDir = desk();
}

/// A folder with what scene files may refer to.
fn desk() -> tempfile::TempDir {
    let memory = Path::new("/dev/shm");
    let folder = if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() };
    let folder = folder.expect("a temporary folder");
    std::fs::write(folder.path().join("square.ply"), SQUARE).expect("writing the square");
    std::fs::write(folder.path().join("sky.hdr"), SKY).expect("writing the sky");
    folder
}

/// Puts bytes into a file of the desk.
fn put(name: &str, bytes: &[u8]) -> PathBuf {
    DESK.with(|desk| {
        let path = desk.path().join(name);
        std::fs::write(&path, bytes).expect("writing the input");
        path
    })
}

fn load(name: &str, bytes: &[u8]) {
    match scene::load(&put(name, bytes)) {
        Ok(scene) => check_scene(&scene),
        Err(error) => check_refusal(&error),
    }
}

/// Reads bytes as a PLY mesh.
pub fn ply(bytes: &[u8]) {
    load("mesh.ply", bytes);
}

/// Reads bytes as an OBJ mesh; what follows a line `#mtl` is its material library `m.mtl`.
pub fn obj(bytes: &[u8]) {
    const SEAM: &[u8] = b"\n#mtl\n";
    let seam = bytes.windows(SEAM.len()).position(|window| window == SEAM);
    let (mesh, library) = seam.map_or((bytes, &[][..]), |at| (&bytes[..at], &bytes[at + SEAM.len()..]));
    put("m.mtl", library);
    load("mesh.obj", mesh);
}

/// Reads bytes as a GLB, or as a glTF when they do not begin like one.
pub fn gltf(bytes: &[u8]) {
    load(if bytes.starts_with(b"glTF") { "mesh.glb" } else { "mesh.gltf" }, bytes);
}

/// Reads bytes as a scene file.
pub fn scene(bytes: &[u8]) {
    load("scene.toml", bytes);
}

/// Reads bytes as a block of a light's transfer: how many values there are to be, and the values encoded.
pub fn transfer(bytes: &[u8]) {
    let Some((count, encoded)) = bytes.split_first_chunk::<2>() else { return };
    let count = usize::from(u16::from_le_bytes(*count));
    match codec::decode(encoded, count) {
        Ok(values) => assert!(values.len() == count && values.iter().all(|v| v.is_finite())),
        Err(problem) => assert!(!problem.is_empty() && !problem.contains('\n')),
    }
}

/// Reads bytes as a table of points, and the table as it is written once more.
pub fn points(bytes: &[u8]) {
    let name = Path::new("points.csv");
    let table = match PointTable::from_reader(bytes, name) {
        Ok(table) => table,
        Err(error) => return check_refusal(&error),
    };
    let placement = scene::Placement { origin: glam::DVec3::ZERO, scale: 1.0 };
    for point in table.local(&placement) {
        assert!(point.position.is_finite() && (point.normal.length() - 1.0).abs() < 1e-5, "{point:?}");
    }
    let mut written = Vec::new();
    table.write_to(&mut written, &[]).expect("writing to memory");
    let again = PointTable::from_reader(&written[..], name).expect("what was written can be read");
    assert_eq!(again.positions(), table.positions());
}

/// Reads bytes as a picture: EXR and Radiance HDR as skies, everything else as a texture.
pub fn picture(bytes: &[u8]) {
    let mut warnings = Vec::new();
    let image = if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
        sky::read_picture(&put("sky.exr", bytes), &mut warnings)
    } else if bytes.starts_with(b"#?") {
        sky::read_picture(&put("picture.hdr", bytes), &mut warnings)
    } else {
        materials::read_texture(&put("texture.png", bytes), &mut warnings)
    };
    match image {
        Err(error) => check_refusal(&error),
        Ok(image) => {
            assert_eq!(image.pixels.len() as u64, u64::from(image.width) * u64::from(image.height));
            assert!(image.pixels.iter().all(|p| p.is_finite() && p.min_element() >= 0.0));
        }
    }
}

/// Reads bytes as a finished archive, and as an unfinished one that a writer continues.
pub fn archive(bytes: &[u8]) {
    let mut aligned = rkyv::util::AlignedVec::<64>::with_capacity(bytes.len());
    aligned.extend_from_slice(bytes);
    match Archive::from_bytes(aligned, "sites.glow") {
        Err(error) => check_refusal(&error),
        Ok(archive) => {
            let report = verify(&archive).expect("memory can be read");
            assert_eq!(report.blocks, archive.all_blocks().count());
            for block in archive.all_blocks() {
                let _ = (block.array::<u8>(), block.array::<f32>(), block.array::<u64>(), block.stored());
            }
        }
    }
    let memory = Memory::default();
    let path = Path::new("sites.glow");
    memory.0.lock().expect("one thread").insert(partial_path(path), Arc::new(Mutex::new(bytes.to_vec())));
    match Writer::resume_in(Arc::new(memory), path, SITES, archive_digests()) {
        Err(error) => check_refusal(&error),
        Ok((writer, resumed)) => {
            assert_eq!(writer.entries().len(), resumed.blocks);
            assert!(resumed.dropped_bytes <= bytes.len() as u64);
            writer.finish(&[]).expect("memory can be written");
        }
    }
}

/// The kind of file that seeds of `archive` are.
pub const SITES: Tag = Tag::new("sites");

/// What seeds of `archive` were made from.
pub fn archive_digests() -> Digests {
    Digests { inputs: Digest::of_bytes(b"inputs"), options: Digest::of_bytes(b"options") }
}

/// A refusal names file, place and remedy in one line, in bounded length, whatever the file says.
pub fn check_refusal(error: &Error) {
    let said = error.to_string();
    assert!(said.chars().count() < 700, "too long: {said}");
    assert!(!said.chars().any(char::is_control), "control characters: {said:?}");
    match error {
        Error::Input { place, problem, remedy, .. } => {
            assert!(!place.is_empty() && !problem.is_empty() && !remedy.is_empty(), "{said}");
        }
        Error::Damaged { .. } | Error::JobDiffers { .. } => {}
        other => panic!("a file's contents gave {other:?}"),
    }
}

/// What every later stage takes for granted.
pub fn check_scene(scene: &Scene) {
    assert!(!scene.triangles.is_empty());
    assert!(scene.placement.origin.is_finite() && scene.placement.scale > 0.0);
    assert!(scene.placement.scale.is_finite());
    assert!(scene.vertices.iter().all(|v| v.is_finite()));
    let count = scene.vertices.len() as u32;
    assert!(scene.triangles.iter().flatten().all(|&corner| corner < count));
    let mut next = 0;
    for mesh in &scene.meshes {
        assert_eq!(mesh.triangles.start, next);
        next = mesh.triangles.end;
        assert!(is_light(mesh.radiance), "{}", mesh.radiance);
        let vertices = mesh.vertices.len();
        assert!(mesh.normals.as_ref().is_none_or(|n| n.len() == vertices));
        for id in mesh.triangles.clone().take(100) {
            assert!(scene.triangles[id as usize].iter().all(|corner| mesh.vertices.contains(corner)));
            for [u, v] in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.25, 0.5]] {
                let albedo = scene.albedo(id, u, v);
                assert!(is_light(albedo) && albedo.max_element() < 1.0, "albedo {albedo} of {id}");
            }
        }
    }
    assert_eq!(next as usize, scene.triangles.len());
    check_lights(scene);
    for camera in &scene.cameras {
        assert!(camera.eye.is_finite() && camera.target.is_finite() && camera.up.is_finite(), "{camera:?}");
        assert!((camera.target - camera.eye).normalize_or_zero().length() > 0.5, "{camera:?}");
    }
    let bounded = |text: &str| text.chars().count() < 2000 && !text.chars().any(char::is_control);
    for warning in &scene.warnings {
        assert!(bounded(&warning.message), "{:?}", warning.message);
    }
    assert!(scene.warnings.len() < 200, "{} warnings", scene.warnings.len());
}

fn check_lights(scene: &Scene) {
    match &scene.sky {
        Some(Sky::Constant(radiance)) => assert!(is_light(*radiance)),
        Some(sky @ Sky::Image { image, .. }) => {
            assert!(image.pixels.iter().all(|p| is_light(*p)));
            assert!(is_light(sky.mean_radiance()));
        }
        None => {}
    }
    for lamp in &scene.lamps {
        let (light, place) = match lamp.kind {
            LampKind::Sun { direction, irradiance } => (irradiance, direction),
            LampKind::Point { position, intensity } => (intensity, position),
            LampKind::Spot { position, direction, intensity, inner_cosine, outer_cosine } => {
                assert!(inner_cosine > outer_cosine, "{lamp:?}");
                assert!((direction.length() - 1.0).abs() < 1e-4, "{lamp:?}");
                (intensity, position)
            }
        };
        assert!(is_light(light) && place.is_finite(), "{lamp:?}");
    }
}

fn is_light(light: Rgb) -> bool {
    light.is_finite() && light.min_element() >= 0.0
}

/// The bytes of a file, shared by those who have it open.
type Shared = Arc<Mutex<Vec<u8>>>;

/// Files in memory, without faults.
#[derive(Clone, Debug, Default)]
pub struct Memory(Arc<Mutex<HashMap<PathBuf, Shared>>>);

/// One of them, open.
#[derive(Debug)]
pub struct InMemory(Shared, u64);

impl Memory {
    /// The bytes of a file.
    pub fn bytes(&self, path: &Path) -> Option<Vec<u8>> {
        self.0.lock().expect("one thread").get(path).map(|file| file.lock().expect("one thread").clone())
    }
}

impl Storage for Memory {
    fn create(&self, path: &Path) -> io::Result<Box<dyn StoredFile>> {
        let file = Arc::new(Mutex::new(Vec::new()));
        self.0.lock().expect("one thread").insert(path.to_path_buf(), file.clone());
        Ok(Box::new(InMemory(file, 0)))
    }

    fn open(&self, path: &Path) -> io::Result<Box<dyn StoredFile>> {
        let file = self.0.lock().expect("one thread").get(path).cloned().ok_or(io::ErrorKind::NotFound)?;
        Ok(Box::new(InMemory(file, 0)))
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        let file = self.0.lock().expect("one thread").remove(from).ok_or(io::ErrorKind::NotFound)?;
        self.0.lock().expect("one thread").insert(to.to_path_buf(), file);
        Ok(())
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        self.0
            .lock()
            .expect("one thread")
            .remove(path)
            .map(|_| ())
            .ok_or_else(|| io::ErrorKind::NotFound.into())
    }

    fn create_directory(&self, _: &Path) -> io::Result<()> {
        Err(io::ErrorKind::Unsupported.into())
    }

    fn remove_directory(&self, _: &Path) -> io::Result<()> {
        Err(io::ErrorKind::Unsupported.into())
    }

    fn exchange(&self, _: &Path, _: &Path) -> io::Result<()> {
        Err(io::ErrorKind::Unsupported.into())
    }

    fn sync_directory(&self, _: &Path) -> io::Result<()> {
        Ok(())
    }
}

impl Read for InMemory {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let bytes = self.0.lock().expect("one thread");
        let count = Cursor::new(&bytes[(self.1 as usize).min(bytes.len())..]).read(into)?;
        self.1 += count as u64;
        Ok(count)
    }
}

impl Write for InMemory {
    fn write(&mut self, from: &[u8]) -> io::Result<usize> {
        let mut bytes = self.0.lock().expect("one thread");
        let (start, end) = (self.1 as usize, self.1 as usize + from.len());
        let length = bytes.len().max(end);
        bytes.resize(length, 0);
        bytes[start..end].copy_from_slice(from);
        self.1 = end as u64;
        Ok(from.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for InMemory {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let length = self.0.lock().expect("one thread").len() as i64;
        let at = match to {
            SeekFrom::Start(at) => at as i64,
            SeekFrom::End(by) => length + by,
            SeekFrom::Current(by) => self.1 as i64 + by,
        };
        self.1 = u64::try_from(at).map_err(|_| io::ErrorKind::InvalidInput)?;
        Ok(self.1)
    }
}

impl StoredFile for InMemory {
    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }

    fn truncate(&mut self, bytes: u64) -> io::Result<()> {
        self.0.lock().expect("one thread").resize(bytes as usize, 0);
        Ok(())
    }

    fn reserve(&mut self, _: u64) -> io::Result<()> {
        Ok(())
    }
}
