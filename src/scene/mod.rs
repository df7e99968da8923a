//! The scene: triangles, materials, sky, lamps and cameras in one local, unit-sized frame.
//!
//! World coordinates are read as f64, moved to a local origin and scaled to about unit size before they become f32,
//! so that every tolerance further on is relative to the scene.

pub mod assemble;
pub mod bright;
mod faces;
mod gltf;
pub mod materials;
mod obj;
pub mod ply;
pub mod polygon;
pub mod sky;
mod toml;

use std::collections::HashSet;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DVec3, Vec2, Vec3};

use crate::error::{Error, Result, one_line};
use crate::geometry::triangle;
use crate::light::Rgb;

/// The map between world and local coordinates: world = origin + local · scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// World position of the local origin.
    pub origin: DVec3,
    /// World length of one local unit.
    pub scale: f64,
}

impl Placement {
    /// World to local.
    pub fn to_local(&self, world: DVec3) -> Vec3 {
        ((world - self.origin) / self.scale).as_vec3()
    }

    /// Local to world.
    pub fn to_world(&self, local: Vec3) -> DVec3 {
        self.origin + local.as_dvec3() * self.scale
    }
}

/// The diffuse reflectance of a mesh, each channel in [0, 1).
#[derive(Debug, Clone)]
pub enum Albedo {
    /// The same everywhere.
    Constant(Rgb),
    /// One value per vertex of the mesh (indexed from the mesh's first vertex), interpolated linearly.
    Vertex(Vec<Rgb>),
    /// An image over UVs (one per vertex of the mesh), repeated, bilinear, times a factor.
    Texture {
        /// The image.
        texture: Arc<Texture>,
        /// Texture coordinates, v downwards as the image's rows run.
        uv: Vec<Vec2>,
        /// Multiplies the image.
        factor: Rgb,
    },
}

/// A linear RGB image.
#[derive(Debug, Clone)]
pub struct Texture {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Row-major from the top left, linear.
    pub pixels: Vec<Rgb>,
}

/// One mesh of the scene: a range of its triangles and vertices, and its material.
#[derive(Debug, Clone)]
pub struct Mesh {
    /// The handle for relighting.
    pub name: String,
    /// Where it was read from.
    pub file: PathBuf,
    /// Its triangles in [`Scene::triangles`].
    pub triangles: Range<u32>,
    /// Its vertices in [`Scene::vertices`].
    pub vertices: Range<u32>,
    /// Whether the back reflects and emits too; a one-sided mesh's back is black.
    pub two_sided: bool,
    /// Diffuse reflectance.
    pub albedo: Albedo,
    /// Emitted radiance, W·m⁻²·sr⁻¹; exitance is π times this.
    pub radiance: Rgb,
    /// The file's vertex normals, if it has any, one per vertex of the mesh.
    pub normals: Option<Vec<Vec3>>,
}

/// Light that arrives from outside the scene.
#[derive(Debug, Clone)]
pub enum Sky {
    /// The same radiance from everywhere.
    Constant(Rgb),
    /// A latitude–longitude image.
    Image {
        /// Radiance, row 0 at the zenith.
        image: Arc<Texture>,
        /// Rotates a scene direction into the image's frame (y up, −z at the image's centre column).
        to_image: glam::Mat3,
    },
}

/// A punctual light. Positions and intensities are in local units (intensity scaled by 1/scale²).
#[derive(Debug, Clone)]
pub struct Lamp {
    /// The handle for relighting.
    pub name: String,
    /// What kind, and its light.
    pub kind: LampKind,
}

/// The kinds of punctual light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LampKind {
    /// Parallel light travelling along `direction` (unit).
    Sun {
        /// The way the light travels.
        direction: Vec3,
        /// On a surface facing it, W·m⁻².
        irradiance: Rgb,
    },
    /// Light from one point, the same to all sides.
    Point {
        /// Local position.
        position: Vec3,
        /// W·sr⁻¹ in local units.
        intensity: Rgb,
    },
    /// Light from one point into a cone.
    Spot {
        /// Local position.
        position: Vec3,
        /// The cone's axis (unit).
        direction: Vec3,
        /// W·sr⁻¹ in local units, on the axis.
        intensity: Rgb,
        /// Cosine of the angle up to which the light is full.
        inner_cosine: f32,
        /// Cosine of the angle from which there is none.
        outer_cosine: f32,
    },
}

/// A pinhole camera in local coordinates.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// The handle for `render --camera`.
    pub name: String,
    /// Local position.
    pub eye: Vec3,
    /// Local point looked at.
    pub target: Vec3,
    /// Up direction.
    pub up: Vec3,
    /// Vertical field of view, degrees.
    pub fov_degrees: f32,
    /// Width and height in pixels.
    pub size: [u32; 2],
}

/// Something the reader changed or ignored; the scene is usable without it.
#[derive(Debug, Clone, PartialEq)]
pub struct Warning {
    /// The file concerned.
    pub file: PathBuf,
    /// What was found and what was done, with a count.
    pub message: String,
}

/// Everything that is lit and lights.
#[derive(Debug, Clone)]
pub struct Scene {
    /// World from local.
    pub placement: Placement,
    /// All vertices, local, mesh after mesh.
    pub vertices: Vec<Vec3>,
    /// Corner indices into `vertices`, mesh after mesh.
    pub triangles: Vec<[u32; 3]>,
    /// In the order of the scene file; ranges ascend and cover all triangles.
    pub meshes: Vec<Mesh>,
    /// Light from outside.
    pub sky: Option<Sky>,
    /// Punctual lights.
    pub lamps: Vec<Lamp>,
    /// Named views.
    pub cameras: Vec<Camera>,
    /// The direction taken for up when framing a picture.
    pub up: Vec3,
    /// What the readers had to say.
    pub warnings: Vec<Warning>,
}

/// Warnings that are kept one by one: a reader of more would miss the first.
const MOST_WARNINGS: usize = 50;

/// Reads a scene: a bare mesh (`.ply`, `.obj`, `.gltf`, `.glb`) or a scene file (`.toml`).
///
/// A bare mesh reflects on both sides, takes its albedo from its materials or vertex colours (0.7 grey without), and
/// stands under a white sky of radiance 1 unless the file itself has lights. Vertices keep their order and number
/// (PLY, and OBJ with one material); triangles keep their order, those without area are left out with a warning.
///
/// Single precision bounds what is accepted: extents from 10⁻¹⁵ to 10¹⁵ world units, lamps and cameras within 10¹⁵ of
/// them, light up to [`materials::BRIGHTEST`] in its unit. Memory is bounded by the sizes of the files, whatever they
/// claim, but for what is there many times over: compressed pixels and instances. Names and warnings are single lines: control characters of the files are escaped.
///
/// # Errors
/// [`Error::Input`] with file, place, problem and remedy for anything that cannot be read or that light transport has
/// no meaning for; [`Error::Io`] when the system fails.
pub fn load(path: &Path) -> Result<Scene> {
    draft(path, u64::MAX)?.into_scene(path)
}

/// As [`load`], but PLY meshes of more triangles than are `resident` are left in their files ([`assemble::Part::streamed`]):
/// whoever makes the scene puts proxies in their places first.
///
/// # Errors
/// As [`load`].
pub fn draft(path: &Path, resident: u64) -> Result<assemble::Contents> {
    let remedy = "give a .ply, .obj, .gltf, .glb or .toml file";
    if !path.exists() {
        return Err(Error::input(path, "file", "it does not exist", format!("check the path, or {remedy}")));
    }
    if path.is_dir() {
        return Err(Error::input(path, "file", "it is a folder", remedy));
    }
    let is_scene_file = extension(path) == "toml";
    let mut contents = if is_scene_file { toml::read(path, resident)? } else { read_mesh(path, resident)? };
    if !contents.emits() {
        if is_scene_file {
            let message = "nothing gives light: add a [sky], a [[lamp]] or a mesh's radiance".to_string();
            contents.warnings.push(Warning { file: path.to_path_buf(), message });
        } else {
            contents.sky = Some(Sky::Constant(Rgb::ONE));
        }
    }
    let stem = stem(path);
    for part in &mut contents.parts {
        if part.name.is_empty() {
            part.name.clone_from(&stem);
        }
    }
    contents.make_printable();
    // Meshes and lamps share one space of names: relighting addresses both.
    let meshes = contents.parts.iter_mut().map(|part| &mut part.name);
    make_unique(meshes.chain(contents.lamps.iter_mut().map(|lamp| &mut lamp.name)));
    make_unique(contents.cameras.iter_mut().map(|camera| &mut camera.rest.name));
    Ok(contents)
}

/// Reads one mesh file by its extension.
fn read_mesh(path: &Path, resident: u64) -> Result<assemble::Contents> {
    match extension(path).as_str() {
        "ply" => match ply::left(path, resident)? {
            Some(left) => Ok(left),
            None => ply::read(path),
        },
        "obj" => obj::read(path),
        "gltf" | "glb" => gltf::read(path),
        other => {
            let problem = match other {
                "" => "it has no extension that tells its kind".to_string(),
                "toml" => "a scene file is no mesh".to_string(),
                other => format!("meshes of kind {other:?} are not read"),
            };
            Err(Error::input(path, "name", problem, "give a .ply, .obj, .gltf or .glb file"))
        }
    }
}

/// The extension in lower case.
fn extension(path: &Path) -> String {
    path.extension().map_or_else(String::new, |e| e.to_string_lossy().to_ascii_lowercase())
}

/// The file's name without its extension.
fn stem(path: &Path) -> String {
    path.file_stem().map_or_else(|| "mesh".to_string(), |stem| stem.to_string_lossy().into_owned())
}

/// The known word that is nearest to one that is not, if any is near.
pub fn nearest_word<'a>(word: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let distance = |known: &&str| toml::edit_distance(word, known);
    known.into_iter().min_by_key(distance).filter(|near| distance(near) <= 1 + near.len() / 3)
}

/// "lamp", "lamp2", "lamp3", …
fn numbered(word: &str, number: usize) -> String {
    if number == 0 { word.to_string() } else { format!("{word}{}", number + 1) }
}

/// Appends -2, -3, … to names that came before.
fn make_unique<'a>(names: impl Iterator<Item = &'a mut String>) {
    let mut taken = HashSet::new();
    for name in names {
        let base = name.clone();
        let mut number = 1;
        while !taken.insert(name.clone()) {
            number += 1;
            *name = format!("{base}-{number}");
        }
    }
}

/// A spot whose light is full up to `inner` radians off its axis and gone from `outer` on.
fn spot(direction: Vec3, intensity: Rgb, inner: f64, outer: f64) -> LampKind {
    let outer_cosine = outer.cos() as f32;
    // A hard edge keeps a sliver of transition, so that nothing divides by zero.
    let inner_cosine = (inner.cos() as f32).max(outer_cosine + 1.0e-4).min(1.0);
    LampKind::Spot { position: Vec3::ZERO, direction, intensity, inner_cosine, outer_cosine }
}

impl assemble::Contents {
    /// Names and warnings become single lines that may stand in a terminal and in a table, whatever the files hold.
    fn make_printable(&mut self) {
        let lamps = self.lamps.iter_mut().map(|lamp| &mut lamp.name);
        let cameras = self.cameras.iter_mut().map(|camera| &mut camera.rest.name);
        for name in self.parts.iter_mut().map(|part| &mut part.name).chain(lamps).chain(cameras) {
            *name = one_line(name, usize::MAX);
        }
        self.warnings.iter_mut().for_each(|warning| warning.message = one_line(&warning.message, 400));
        let count = self.warnings.len();
        if let Some(last) = self.warnings.last().filter(|_| count > MOST_WARNINGS) {
            let message = format!("{} further warnings, the last: {}", count - MOST_WARNINGS, last.message);
            let rest = Warning { file: last.file.clone(), message };
            self.warnings.truncate(MOST_WARNINGS);
            self.warnings.push(rest);
        }
    }
}

impl Scene {
    /// The corners of a triangle.
    pub fn corners(&self, id: u32) -> [Vec3; 3] {
        self.triangles[id as usize].map(|v| self.vertices[v as usize])
    }

    /// The unit normal of a triangle's front, zero if it has no area.
    pub fn normal(&self, id: u32) -> Vec3 {
        triangle::normal(self.corners(id))
    }

    /// The index of the mesh that owns a triangle.
    pub fn mesh_of(&self, id: u32) -> usize {
        self.meshes.partition_point(|mesh| mesh.triangles.end <= id)
    }

    /// The albedo at barycentric (u, v) of a triangle.
    pub fn albedo(&self, id: u32, u: f32, v: f32) -> Rgb {
        let mesh = &self.meshes[self.mesh_of(id)];
        let local = || self.triangles[id as usize].map(|k| (k - mesh.vertices.start) as usize);
        let weights = [1.0 - u - v, u, v];
        match &mesh.albedo {
            Albedo::Constant(albedo) => *albedo,
            Albedo::Vertex(values) => {
                let corner = local();
                (0..3).map(|k| values[corner[k]] * weights[k]).sum()
            }
            Albedo::Texture { texture, uv, factor } => {
                let corner = local();
                let at: Vec2 = (0..3).map(|k| uv[corner[k]] * weights[k]).sum();
                texture.bilinear_repeat(at) * *factor
            }
        }
    }
}

impl Texture {
    /// Bilinear look-up at `uv` in units of the image, repeated beyond it; texel centres at half-integers.
    pub fn bilinear_repeat(&self, uv: Vec2) -> Rgb {
        let x = uv.x * self.width as f32 - 0.5;
        let y = uv.y * self.height as f32 - 0.5;
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let pixel = |dx: i64, dy: i64| {
            // Far coordinates saturate.
            let column = (x0 as i64).wrapping_add(dx).rem_euclid(i64::from(self.width)) as usize;
            let row = (y0 as i64).wrapping_add(dy).rem_euclid(i64::from(self.height)) as usize;
            self.pixels[row * self.width as usize + column]
        };
        let top = pixel(0, 0).lerp(pixel(1, 0), fx);
        top.lerp(pixel(0, 1).lerp(pixel(1, 1), fx), fy)
    }
}
