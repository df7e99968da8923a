//! The scene's small typed tables as rkyv archives them; the large arrays lie flat beside them.

use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

use glam::{DVec3, Mat3, Vec2, Vec3};

use crate::archive::Digest;
use crate::error::{Error, Result};
use crate::scene::{Albedo, Camera, Lamp, LampKind, Mesh, Placement, Scene, Sky, Texture, Warning};

/// Everything of a scene but its vertices and triangles. Ranges index the job's flat arrays.
#[derive(rkyv::Archive, rkyv::Serialize, rkyv::Deserialize)]
pub struct SceneRecord {
    origin: [f64; 3],
    scale: f64,
    up: [f32; 3],
    meshes: Vec<MeshRecord>,
    sky: Option<SkyRecord>,
    lamps: Vec<LampRecord>,
    cameras: Vec<CameraRecord>,
    warnings: Vec<(String, String)>,
}

#[derive(rkyv::Archive, rkyv::Serialize, rkyv::Deserialize)]
struct MeshRecord {
    name: String,
    file: String,
    triangles: (u32, u32),
    vertices: (u32, u32),
    two_sided: bool,
    radiance: [f32; 3],
    albedo: AlbedoRecord,
    /// Where in the flat attributes its normals begin.
    normals: Option<u64>,
}

#[derive(rkyv::Archive, rkyv::Serialize, rkyv::Deserialize)]
enum AlbedoRecord {
    Constant([f32; 3]),
    /// Start in the flat attributes.
    Vertex(u64),
    Texture {
        image: ImageRecord,
        /// Start in the flat attributes; (u, v, 0) each.
        uv: u64,
        factor: [f32; 3],
    },
}

#[derive(rkyv::Archive, rkyv::Serialize, rkyv::Deserialize)]
struct ImageRecord {
    width: u32,
    height: u32,
    /// Start in the flat attributes.
    pixels: u64,
}

#[derive(rkyv::Archive, rkyv::Serialize, rkyv::Deserialize)]
enum SkyRecord {
    Constant([f32; 3]),
    Image { image: ImageRecord, to_image: [f32; 9] },
}

#[derive(rkyv::Archive, rkyv::Serialize, rkyv::Deserialize)]
struct LampRecord {
    name: String,
    /// 0 sun, 1 point, 2 spot.
    kind: u8,
    position: [f32; 3],
    direction: [f32; 3],
    strength: [f32; 3],
    cosines: [f32; 2],
}

#[derive(rkyv::Archive, rkyv::Serialize, rkyv::Deserialize)]
struct CameraRecord {
    name: String,
    eye: [f32; 3],
    target: [f32; 3],
    up: [f32; 3],
    fov_degrees: f32,
    size: [u32; 2],
}

/// Collects colours, normals, UVs and pixels into one flat array.
#[derive(Default)]
struct Attributes {
    flat: Vec<Vec3>,
}

impl Attributes {
    fn add(&mut self, values: impl IntoIterator<Item = Vec3>) -> u64 {
        let start = self.flat.len() as u64;
        self.flat.extend(values);
        start
    }

    fn image(&mut self, texture: &Texture) -> ImageRecord {
        let pixels = self.add(texture.pixels.iter().copied());
        ImageRecord { width: texture.width, height: texture.height, pixels }
    }
}

/// A range of the flat attributes, or what is wrong with it.
fn slice(flat: &[Vec3], start: u64, count: usize) -> Result<&[Vec3], String> {
    usize::try_from(start)
        .ok()
        .and_then(|start| flat.get(start..start.checked_add(count)?))
        .ok_or_else(|| format!("expected {count} attributes from {start}, got {} in all", flat.len()))
}

/// The tables of a scene and its flat attributes.
pub fn record(scene: &Scene) -> (SceneRecord, Vec<Vec3>) {
    let mut flat = Attributes::default();
    let record = SceneRecord {
        origin: scene.placement.origin.to_array(),
        scale: scene.placement.scale,
        up: scene.up.to_array(),
        meshes: scene.meshes.iter().map(|m| mesh_record(m, &mut flat)).collect(),
        sky: scene.sky.as_ref().map(|sky| match sky {
            Sky::Constant(radiance) => SkyRecord::Constant(radiance.to_array()),
            Sky::Image { image, to_image } => {
                SkyRecord::Image { image: flat.image(image), to_image: to_image.to_cols_array() }
            }
        }),
        lamps: scene.lamps.iter().map(lamp_record).collect(),
        cameras: scene.cameras.iter().map(camera_record).collect(),
        warnings: scene.warnings.iter().map(|w| (w.file.display().to_string(), w.message.clone())).collect(),
    };
    (record, flat.flat)
}

/// A digest of all that changes the light and the pictures of a scene without changing its geometry: albedos, emission,
/// sky, lamps, cameras, names; not where its files lie.
///
/// # Errors
/// [`Error::Usage`] when the tables cannot be archived.
pub fn light_digest(scene: &Scene) -> Result<Digest> {
    let (mut tables, flat) = record(scene);
    tables.meshes.iter_mut().for_each(|mesh| mesh.file.clear());
    tables.warnings.clear();
    let tables = to_bytes(&tables)?;
    Ok(Digest::of_digests(&[Digest::of_bytes(&tables), Digest::of_bytes(bytemuck::cast_slice(&flat))]))
}

/// The tables as rkyv archives them.
///
/// # Errors
/// [`Error::Usage`].
pub fn to_bytes(tables: &SceneRecord) -> Result<rkyv::util::AlignedVec> {
    rkyv::to_bytes::<rkyv::rancor::BoxedError>(tables)
        .map_err(|e| Error::Usage(format!("scene tables cannot be archived: {e}")))
}

fn mesh_record(mesh: &Mesh, flat: &mut Attributes) -> MeshRecord {
    let albedo = match &mesh.albedo {
        Albedo::Constant(albedo) => AlbedoRecord::Constant(albedo.to_array()),
        Albedo::Vertex(values) => AlbedoRecord::Vertex(flat.add(values.iter().copied())),
        Albedo::Texture { texture, uv, factor } => AlbedoRecord::Texture {
            image: flat.image(texture),
            uv: flat.add(uv.iter().map(|uv| uv.extend(0.0))),
            factor: factor.to_array(),
        },
    };
    MeshRecord {
        name: mesh.name.clone(),
        file: mesh.file.display().to_string(),
        triangles: (mesh.triangles.start, mesh.triangles.end),
        vertices: (mesh.vertices.start, mesh.vertices.end),
        two_sided: mesh.two_sided,
        radiance: mesh.radiance.to_array(),
        albedo,
        normals: mesh.normals.as_ref().map(|n| flat.add(n.iter().copied())),
    }
}

fn lamp_record(lamp: &Lamp) -> LampRecord {
    let empty = LampRecord {
        name: lamp.name.clone(),
        kind: 0,
        position: [0.0; 3],
        direction: [0.0; 3],
        strength: [0.0; 3],
        cosines: [0.0; 2],
    };
    match lamp.kind {
        LampKind::Sun { direction, irradiance } => {
            LampRecord { direction: direction.to_array(), strength: irradiance.to_array(), ..empty }
        }
        LampKind::Point { position, intensity } => {
            LampRecord { kind: 1, position: position.to_array(), strength: intensity.to_array(), ..empty }
        }
        LampKind::Spot { position, direction, intensity, inner_cosine, outer_cosine } => LampRecord {
            kind: 2,
            position: position.to_array(),
            direction: direction.to_array(),
            strength: intensity.to_array(),
            cosines: [inner_cosine, outer_cosine],
            ..empty
        },
    }
}

fn camera_record(camera: &Camera) -> CameraRecord {
    CameraRecord {
        name: camera.name.clone(),
        eye: camera.eye.to_array(),
        target: camera.target.to_array(),
        up: camera.up.to_array(),
        fov_degrees: camera.fov_degrees,
        size: camera.size,
    }
}

impl SceneRecord {
    /// The scene again, from its tables and arrays. Errors say what does not fit.
    pub fn restore(self, vertices: &[Vec3], triangles: &[[u32; 3]], flat: &[Vec3]) -> Result<Scene, String> {
        let meshes = self.meshes.into_iter().map(|m| m.restore(flat)).collect::<Result<Vec<_>, _>>()?;
        let covered =
            meshes.iter().try_fold(0, |end, m: &Mesh| (m.triangles.start == end).then_some(m.triangles.end));
        if covered != Some(triangles.len() as u32) {
            return Err(format!("expected meshes that cover {} triangles", triangles.len()));
        }
        if triangles.iter().flatten().any(|&v| v as usize >= vertices.len()) {
            return Err(format!("expected corners below {}", vertices.len()));
        }
        Ok(Scene {
            placement: Placement { origin: DVec3::from_array(self.origin), scale: self.scale },
            vertices: vertices.to_vec(),
            triangles: triangles.to_vec(),
            meshes,
            sky: self.sky.map(|sky| sky.restore(flat)).transpose()?,
            lamps: self.lamps.into_iter().map(LampRecord::restore).collect(),
            cameras: self.cameras.into_iter().map(CameraRecord::restore).collect(),
            up: Vec3::from_array(self.up),
            warnings: self
                .warnings
                .into_iter()
                .map(|(file, message)| Warning { file: PathBuf::from(file), message })
                .collect(),
        })
    }
}

impl MeshRecord {
    fn restore(self, flat: &[Vec3]) -> Result<Mesh, String> {
        let vertices: Range<u32> = self.vertices.0..self.vertices.1;
        let albedo = match self.albedo {
            AlbedoRecord::Constant(albedo) => Albedo::Constant(Vec3::from_array(albedo)),
            AlbedoRecord::Vertex(start) => Albedo::Vertex(slice(flat, start, vertices.len())?.to_vec()),
            AlbedoRecord::Texture { image, uv, factor } => Albedo::Texture {
                texture: image.restore(flat)?,
                uv: slice(flat, uv, vertices.len())?.iter().map(|v| Vec2::new(v.x, v.y)).collect(),
                factor: Vec3::from_array(factor),
            },
        };
        let normals =
            self.normals.map(|start| slice(flat, start, vertices.len()).map(<[_]>::to_vec)).transpose()?;
        Ok(Mesh {
            name: self.name,
            file: PathBuf::from(self.file),
            triangles: self.triangles.0..self.triangles.1,
            vertices,
            two_sided: self.two_sided,
            albedo,
            radiance: Vec3::from_array(self.radiance),
            normals,
        })
    }
}

impl ImageRecord {
    fn restore(self, flat: &[Vec3]) -> Result<Arc<Texture>, String> {
        let count = self.width as usize * self.height as usize;
        let pixels = slice(flat, self.pixels, count)?.to_vec();
        Ok(Arc::new(Texture { width: self.width, height: self.height, pixels }))
    }
}

impl SkyRecord {
    fn restore(self, flat: &[Vec3]) -> Result<Sky, String> {
        Ok(match self {
            Self::Constant(radiance) => Sky::Constant(Vec3::from_array(radiance)),
            Self::Image { image, to_image } => {
                Sky::Image { image: image.restore(flat)?, to_image: Mat3::from_cols_array(&to_image) }
            }
        })
    }
}

impl LampRecord {
    fn restore(self) -> Lamp {
        let [position, direction, strength] =
            [self.position, self.direction, self.strength].map(Vec3::from_array);
        let kind = match self.kind {
            0 => LampKind::Sun { direction, irradiance: strength },
            1 => LampKind::Point { position, intensity: strength },
            _ => LampKind::Spot {
                position,
                direction,
                intensity: strength,
                inner_cosine: self.cosines[0],
                outer_cosine: self.cosines[1],
            },
        };
        Lamp { name: self.name, kind }
    }
}

impl CameraRecord {
    fn restore(self) -> Camera {
        Camera {
            name: self.name,
            eye: Vec3::from_array(self.eye),
            target: Vec3::from_array(self.target),
            up: Vec3::from_array(self.up),
            fov_degrees: self.fov_degrees,
            size: self.size,
        }
    }
}
