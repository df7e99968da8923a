//! From what the readers found to a [`Scene`]: world to local, materials checked, hopeless triangles dropped.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DAffine3, DVec3, Vec2, Vec3};

use crate::error::{Error, Result};
use crate::geometry::normals::{self, turned};
use crate::geometry::triangle;
use crate::light::Rgb;
use crate::scene::{Albedo, Camera, Lamp, LampKind, Mesh, Placement, Scene, Sky, Texture, Warning};

/// The albedo of a mesh that comes without any.
pub const DEFAULT_ALBEDO: Rgb = Rgb::splat(0.7);

/// World lengths that a scene may have. Squares of their inverses scale the lamps and must stay within single precision.
const EXTENTS: std::ops::RangeInclusive<f64> = 1.0e-15..=1.0e15;

/// How far outside the scene lamps and cameras may stand, in its extents: beyond, coordinates differ by more than the
/// scene in single precision long before they overflow.
const FARTHEST: f32 = 1.0e15;

/// Where a part's albedo comes from.
#[derive(Debug, Clone, Default)]
pub enum Surface {
    /// Vertex colours if the part has them, otherwise [`DEFAULT_ALBEDO`].
    #[default]
    ColoursOrGrey,
    /// Vertex colours, times a factor; grey where there are none.
    Colours(Rgb),
    /// The same everywhere.
    Constant(Rgb),
    /// An image over the part's UVs, times a factor.
    Image(Arc<Texture>, Rgb),
}

/// One surface as its file has it, in that file's units.
#[derive(Debug, Clone, Default)]
pub struct Part {
    /// The handle for relighting; empty: the caller names it.
    pub name: String,
    /// The file it came from; empty: the file read.
    pub file: PathBuf,
    /// Positions in file order.
    pub positions: Vec<DVec3>,
    /// Corner indices into `positions`, in file order.
    pub triangles: Vec<[u32; 3]>,
    /// Normals as written, one per position.
    pub normals: Option<Vec<Vec3>>,
    /// Linear colours, one per position.
    pub colours: Option<Vec<Rgb>>,
    /// Texture coordinates with v downwards, one per position.
    pub uv: Option<Vec<Vec2>>,
    /// Its albedo.
    pub surface: Surface,
    /// Emitted radiance, W·m⁻²·sr⁻¹.
    pub radiance: Rgb,
    /// Whether its back is black.
    pub one_sided: bool,
    /// Says that the file is too large to hold: positions and triangles are to be filled in with those of a proxy.
    pub streamed: Option<Streamed>,
}

/// A part that is left in its file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Streamed {
    /// File to world.
    pub transform: DAffine3,
    /// The world box of the corners of its triangles; whoever goes through the file fills it in.
    pub bounds: [DVec3; 2],
    /// Vertices by the header.
    pub vertices: u64,
    /// Faces by the header.
    pub faces: u64,
    /// Bytes of the file.
    pub file_bytes: u64,
}

impl Default for Streamed {
    fn default() -> Self {
        Self {
            transform: DAffine3::IDENTITY,
            bounds: [DVec3::INFINITY, DVec3::NEG_INFINITY],
            vertices: 0,
            faces: 0,
            file_bytes: 0,
        }
    }
}

/// A lamp in world coordinates and units.
#[derive(Debug, Clone)]
pub struct WorldLamp {
    /// The handle for relighting.
    pub name: String,
    /// Position in world units; of no meaning for a sun.
    pub position: DVec3,
    /// Kind and light; its position is filled in later.
    pub kind: LampKind,
}

/// A camera in world coordinates.
#[derive(Debug, Clone)]
pub struct WorldCamera {
    /// World position.
    pub eye: DVec3,
    /// World point looked at.
    pub target: DVec3,
    /// Everything else; eye and target are filled in later.
    pub rest: Camera,
}

/// What one file or a whole scene file holds.
#[derive(Debug, Clone, Default)]
pub struct Contents {
    /// Surfaces.
    pub parts: Vec<Part>,
    /// Light from outside.
    pub sky: Option<Sky>,
    /// Punctual lights.
    pub lamps: Vec<WorldLamp>,
    /// Views.
    pub cameras: Vec<WorldCamera>,
    /// The direction taken for up, if it was said.
    pub up: Option<Vec3>,
    /// What the readers had to say.
    pub warnings: Vec<Warning>,
}

impl Contents {
    /// Whether anything gives light.
    pub fn emits(&self) -> bool {
        self.sky.as_ref().is_some_and(|sky| !matches!(sky, Sky::Constant(Rgb::ZERO)))
            || !self.lamps.is_empty()
            || self.parts.iter().any(|part| part.radiance != Rgb::ZERO)
    }

    /// Moves parts, lamps and cameras by a world transform.
    pub fn transform(&mut self, by: DAffine3) {
        let linear = by.matrix3;
        let cofactors = normals::cofactors(linear);
        let mirrored = linear.determinant() < 0.0;
        for part in &mut self.parts {
            if let Some(streamed) = &mut part.streamed {
                streamed.transform = by * streamed.transform;
            }
            part.positions.iter_mut().for_each(|p| *p = by.transform_point3(*p));
            for normal in part.normals.iter_mut().flatten() {
                *normal = turned(cofactors, *normal) * if mirrored { -1.0 } else { 1.0 };
            }
            if mirrored {
                part.triangles.iter_mut().for_each(|t| t.swap(1, 2));
            }
        }
        for lamp in &mut self.lamps {
            lamp.position = by.transform_point3(lamp.position);
            match &mut lamp.kind {
                LampKind::Sun { direction, .. } | LampKind::Spot { direction, .. } => {
                    *direction = turned(linear, *direction);
                }
                LampKind::Point { .. } => {}
            }
        }
        for camera in &mut self.cameras {
            camera.eye = by.transform_point3(camera.eye);
            camera.target = by.transform_point3(camera.target);
            camera.rest.up = turned(linear, camera.rest.up);
        }
    }

    /// The local frame: centre and largest extent of the box around all corners of triangles.
    ///
    /// # Errors
    /// [`Error::Input`] when there is no triangle, or none that can be placed.
    pub fn placement(&self, path: &Path) -> Result<Placement> {
        placement_of(path, &self.parts)
    }

    /// Makes the scene.
    ///
    /// # Errors
    /// [`Error::Input`] when there is no triangle with an area, or an index space or a material is exceeded.
    pub fn into_scene(mut self, path: &Path) -> Result<Scene> {
        let placement = self.placement(path)?;
        let mut scene = Scene {
            placement,
            vertices: Vec::new(),
            triangles: Vec::new(),
            meshes: Vec::with_capacity(self.parts.len()),
            sky: self.sky.take(),
            lamps: self.lamps.iter().map(|lamp| local_lamp(path, lamp, &placement)).collect::<Result<_>>()?,
            cameras: self.cameras.iter().map(|c| local_camera(path, c, &placement)).collect::<Result<_>>()?,
            up: self.up.unwrap_or(Vec3::Y),
            warnings: std::mem::take(&mut self.warnings),
        };
        let mut dropped_parts = 0;
        for part in self.parts {
            let file = if part.file.as_os_str().is_empty() { path.to_path_buf() } else { part.file.clone() };
            dropped_parts += usize::from(!append(&mut scene, part, file)?);
        }
        if scene.triangles.is_empty() {
            let problem = format!("none of {dropped_parts} meshes has a triangle with an area");
            return Err(Error::input(path, "faces", problem, "give a mesh with faces"));
        }
        Ok(scene)
    }
}

/// Centre and largest extent of the box around all corners of triangles.
fn placement_of(path: &Path, parts: &[Part]) -> Result<Placement> {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for part in parts {
        if let Some(Streamed { bounds: [from, to], .. }) = part.streamed {
            // A proxy lies within the box of what it stands for.
            (low, high) = (low.min(from), high.max(to));
            continue;
        }
        for &corner in part.triangles.iter().flatten() {
            let at = part.positions[corner as usize];
            if !at.is_finite() {
                let place = format!("mesh {}, vertex {corner}", part.name);
                let problem = format!("its transform moves it out of range, to {:?}", at.to_array());
                return Err(Error::input(path, place, problem, "correct the transform"));
            }
            low = low.min(at);
            high = high.max(at);
        }
    }
    if low.x > high.x {
        let problem = "there is no triangle in the scene";
        return Err(Error::input(path, "faces", problem, "give a mesh with faces"));
    }
    let scale = (high - low).max_element();
    let remedy = "check the coordinates and the transform";
    if scale == 0.0 {
        let problem = format!("all corners lie in one point, {:?}", low.to_array());
        return Err(Error::input(path, "vertices", problem, remedy));
    }
    if !EXTENTS.contains(&scale) {
        let (least, most) = (EXTENTS.start(), EXTENTS.end());
        let problem = format!("the scene's extent is {scale:e}, outside {least:e} to {most:e}");
        return Err(Error::input(path, "vertices", problem, remedy));
    }
    Ok(Placement { origin: low * 0.5 + high * 0.5, scale })
}

/// Appends a part as a mesh. Gives false when nothing of it was left.
fn append(scene: &mut Scene, part: Part, file: PathBuf) -> Result<bool> {
    let too_many = |what: &str| {
        Error::input(
            &file,
            what,
            "more than 4294967295 in the scene",
            "split the scene, or simplify the mesh",
        )
    };
    let limit = u32::MAX as usize;
    if scene.vertices.len() + part.positions.len() > limit {
        return Err(too_many("vertices"));
    }
    if scene.triangles.len() + part.triangles.len() > limit {
        return Err(too_many("triangles"));
    }
    let first_vertex = scene.vertices.len() as u32;
    let first_triangle = scene.triangles.len() as u32;
    let placement = scene.placement;
    // Corners lie within the unit box; only a vertex that no triangle uses can be far enough out to overflow.
    let far = Vec3::splat(1.0e30);
    scene.vertices.extend(part.positions.iter().map(|&p| placement.to_local(p).clamp(-far, far)));
    check_texture_coordinates(&part, &file)?;
    let mut triangles = part.triangles;
    let before = triangles.len();
    triangles.iter_mut().flatten().for_each(|corner| *corner += first_vertex);
    let vertices = &scene.vertices;
    triangles.retain(|t| triangle::normal(t.map(|corner| vertices[corner as usize])) != Vec3::ZERO);
    let dropped = before - triangles.len();
    if dropped > 0 {
        let message = format!("{dropped} triangles without area dropped (of {before}) in {}", part.name);
        scene.warnings.push(Warning { file: file.clone(), message });
    }
    if scene.triangles.is_empty() {
        scene.triangles = triangles;
    } else {
        scene.triangles.append(&mut triangles);
    }
    let end = scene.triangles.len() as u32;
    let (albedo, message) = albedo_of(part.surface, part.colours, part.uv);
    scene.warnings.extend(message.map(|message| Warning { file: file.clone(), message }));
    scene.meshes.push(Mesh {
        name: part.name,
        file,
        triangles: first_triangle..end,
        vertices: first_vertex..scene.vertices.len() as u32,
        two_sided: !part.one_sided,
        albedo,
        radiance: part.radiance,
        normals: part.normals,
    });
    Ok(end > first_triangle)
}

/// Checks that coordinates into an image are somewhere; without an image nobody reads them.
fn check_texture_coordinates(part: &Part, file: &Path) -> Result<()> {
    let (Surface::Image(..), Some(uv)) = (&part.surface, &part.uv) else { return Ok(()) };
    let Some(at) = uv.iter().position(|uv| !uv.is_finite()) else { return Ok(()) };
    let place = format!("mesh {}, vertex {at}", part.name);
    let problem = format!("the texture coordinate {} is not finite", uv[at]);
    Err(Error::input(file, place, problem, "repair the coordinates, or give a constant albedo"))
}

/// The mesh's albedo, and what was odd about it.
fn albedo_of(surface: Surface, colours: Option<Vec<Rgb>>, uv: Option<Vec<Vec2>>) -> (Albedo, Option<String>) {
    let by_vertex = |mut colours: Vec<Rgb>, factor: Rgb| {
        colours.iter_mut().for_each(|colour| *colour *= factor);
        let clamped = super::materials::clamp_reflectance(&mut colours);
        let message = format!("{clamped} white vertex colours darkened to {}", super::materials::LIMIT);
        (Albedo::Vertex(colours), (clamped > 0).then_some(message))
    };
    match (surface, colours, uv) {
        (Surface::ColoursOrGrey, Some(colours), _) => by_vertex(colours, Rgb::ONE),
        (Surface::Colours(factor), Some(colours), _) => by_vertex(colours, factor),
        (Surface::Constant(albedo), _, _) => (Albedo::Constant(albedo), None),
        (Surface::Image(texture, factor), _, Some(uv)) => (Albedo::Texture { texture, uv, factor }, None),
        (Surface::ColoursOrGrey, None, _) => (Albedo::Constant(DEFAULT_ALBEDO), None),
        _ => {
            let message = "no colours or texture coordinates for the material: 0.7 grey taken";
            (Albedo::Constant(DEFAULT_ALBEDO), Some(message.to_string()))
        }
    }
}

fn local_lamp(path: &Path, lamp: &WorldLamp, placement: &Placement) -> Result<Lamp> {
    let refuse = |problem: String, remedy: &str| {
        Err(Error::input(path, format!("lamp {}", lamp.name), problem, remedy))
    };
    // Irradiance is I / r² whatever the unit of length: intensities shrink with the square of the scale.
    let shrink = (1.0 / (placement.scale * placement.scale)) as f32;
    let shrunk = |intensity: Rgb| intensity * shrink;
    let at = placement.to_local(lamp.position);
    let (kind, direction, intensity) = match lamp.kind {
        LampKind::Point { intensity, .. } => {
            (LampKind::Point { position: at, intensity: shrunk(intensity) }, None, shrunk(intensity))
        }
        LampKind::Spot { direction, intensity, inner_cosine, outer_cosine, .. } => {
            let intensity = shrunk(intensity);
            let spot = LampKind::Spot { position: at, direction, intensity, inner_cosine, outer_cosine };
            (spot, Some(direction), intensity)
        }
        LampKind::Sun { direction, irradiance } => (lamp.kind, Some(direction), irradiance),
    };
    if !matches!(kind, LampKind::Sun { .. }) && !is_near(at) {
        return refuse(
            format!("it stands at {:?}, too far from the scene", lamp.position.to_array()),
            "correct its position",
        );
    }
    if direction.is_some_and(|direction| (direction.length() - 1.0).abs() > 1.0e-3) {
        return refuse("its transform leaves it without a direction".to_string(), "correct the transform");
    }
    if !intensity.is_finite() || intensity.max_element() > super::materials::BRIGHTEST {
        let problem = format!("it is too bright for a scene of extent {:e}", placement.scale);
        return refuse(problem, "lower its intensity, or check the unit of length");
    }
    Ok(Lamp { name: lamp.name.clone(), kind })
}

fn local_camera(path: &Path, camera: &WorldCamera, placement: &Placement) -> Result<Camera> {
    let refuse = |problem: String, remedy: &str| {
        Err(Error::input(path, format!("camera {}", camera.rest.name), problem, remedy))
    };
    let (eye, target) = (placement.to_local(camera.eye), placement.to_local(camera.target));
    if !is_near(eye) || !is_near(target) {
        let (from, to) = (camera.eye.to_array(), camera.target.to_array());
        let problem = format!("it looks from {from:?} to {to:?}, too far from the scene");
        return refuse(problem, "correct eye and target");
    }
    if (target - eye).normalize_or_zero() == Vec3::ZERO {
        let problem = format!("eye and target differ by {:e} only", (camera.target - camera.eye).length());
        return refuse(problem, "move the target away from the eye");
    }
    Ok(Camera { eye, target, ..camera.rest.clone() })
}

fn is_near(at: Vec3) -> bool {
    at.abs().max_element() <= FARTHEST
}
