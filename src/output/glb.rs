//! Binary glTF with the light of each vertex, for viewers: a picture of the light that needs no lamps.
//!
//! The format is Khronos' glTF 2.0 (ISO/IEC 12113:2022), chapter 4 for the container; KHR_materials_unlit shows colours as
//! they are.

use std::io::Write;
use std::path::Path;

use glam::{DQuat, DVec3, Vec3};
use serde_json::{Value, json};

use super::file::{Sink, write_whole};
use super::transfers::VertexTransfers;
use super::vertices::{VertexField, VertexLight};
use super::{Advance, Evaluate};
use crate::error::{Error, Result};
use crate::scene::{Mesh, Scene};

/// Codes of the format.
const FLOAT: u32 = 5126;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34_962;
const INDEX_BUFFER: u32 = 34_963;

/// All that is known of a vertex.
struct Vertex<'a> {
    position: Vec3,
    normal: Vec3,
    light: &'a VertexLight,
    exposure: f32,
}

/// An array of vertices: what it is called, its type, the bytes of one.
struct Attribute {
    name: &'static str,
    kind: &'static str,
    component: u32,
    bytes: usize,
    put: fn(&Vertex<'_>, &mut Vec<u8>),
}

const ATTRIBUTES: [Attribute; 7] = [
    vector("POSITION", |vertex, out| put(vertex.position, out)),
    vector("NORMAL", |vertex, out| put(vertex.normal, out)),
    Attribute { name: "COLOR_0", kind: "VEC4", component: UNSIGNED_SHORT, bytes: 8, put: put_colour },
    vector("_RADIOSITY", |vertex, out| put(vertex.light.radiosity, out)),
    vector("_IRRADIANCE", |vertex, out| put(vertex.light.irradiance, out)),
    scalar("_AMBIENT_OCCLUSION", |vertex, out| out.extend(vertex.light.ambient_occlusion.to_le_bytes())),
    scalar("_ERROR", |vertex, out| out.extend(vertex.light.error.to_le_bytes())),
];

const fn vector(name: &'static str, put: fn(&Vertex<'_>, &mut Vec<u8>)) -> Attribute {
    Attribute { name, kind: "VEC3", component: FLOAT, bytes: 12, put }
}

const fn scalar(name: &'static str, put: fn(&Vertex<'_>, &mut Vec<u8>)) -> Attribute {
    Attribute { name, kind: "SCALAR", component: FLOAT, bytes: 4, put }
}

fn put(vector: Vec3, out: &mut Vec<u8>) {
    vector.to_array().into_iter().for_each(|value| out.extend(value.to_le_bytes()));
}

/// Linear, as the format has it, and opaque.
fn put_colour(vertex: &Vertex<'_>, out: &mut Vec<u8>) {
    let shown = (vertex.light.radiosity * vertex.exposure).clamp(Vec3::ZERO, Vec3::ONE);
    let channels = shown.to_array().map(|value| (value * 65_535.0).round() as u16);
    channels.into_iter().chain([u16::MAX]).for_each(|value| out.extend(value.to_le_bytes()));
}

/// Writes the light of every vertex to `path` as binary glTF: a mesh for each of the scene's, with the vertices' order kept.
///
/// `COLOR_0` is exposed radiosity, linear, in [0, 1]; `_RADIOSITY`, `_IRRADIANCE` and `_ERROR` are floats in W·m⁻²,
/// `_AMBIENT_OCCLUSION` a share; the exposure is in the scene's `extras`. Positions are local and a root takes them to the
/// world, turned so that the scene's up is +y; doubles there keep georeferenced scenes in their place. `advance` counts
/// vertices. Memory: 76 bytes a vertex.
///
/// # Errors
/// [`Error::Usage`] for more than the 4 GiB that the format holds, input/output errors, and what `advance` says.
pub fn export(path: &Path, scene: &Scene, evaluate: &Evaluate<'_>, advance: &Advance<'_>) -> Result<()> {
    export_with((path, scene), evaluate, advance, &VertexTransfers::default())
}

/// As [`export`], with attributes `_TRANSFER_0` and on: what skies of harmonics do at each vertex.
///
/// # Errors
/// As [`export`].
pub fn export_with(
    (path, scene): (&Path, &Scene),
    evaluate: &Evaluate<'_>,
    advance: &Advance<'_>,
    transfers: &VertexTransfers,
) -> Result<()> {
    let field = VertexField::new(scene, evaluate, advance)?;
    let (exposure, count) = (field.exposure(), scene.vertices.len());
    let lights = field.light(0..count);
    let mut text = document(scene, exposure, transfers.columns.len()).to_string();
    // Chunks are whole words; text is filled up with spaces.
    text.extend(std::iter::repeat_n(' ', text.len().next_multiple_of(4) - text.len()));
    let bytes_each = ATTRIBUTES.iter().map(|a| a.bytes).sum::<usize>() + transfers.bytes() as usize;
    let body = count * bytes_each + 12 * scene.triangles.len();
    let whole = 12 + 8 + text.len() + 8 + body;
    let [Ok(words), Ok(text_words), Ok(body_words)] = [whole, text.len(), body].map(u32::try_from) else {
        let problem = format!("{}: {whole} bytes are more than a .glb holds", path.display());
        return Err(Error::Usage(format!("{problem}: write a .ply")));
    };
    write_whole(path, whole as u64, |sink| {
        let failed = |e| Error::io(path, "writing", e);
        let put = |sink: &mut Sink, bytes: &[u8]| sink.write_all(bytes).map_err(failed);
        let head = [*b"glTF", 2u32.to_le_bytes(), words.to_le_bytes(), text_words.to_le_bytes(), *b"JSON"];
        put(sink, head.as_flattened())?;
        put(sink, text.as_bytes())?;
        put(sink, [body_words.to_le_bytes(), *b"BIN\0"].as_flattened())?;
        let mut bytes = Vec::new();
        for attribute in &ATTRIBUTES {
            for (k, light) in lights.iter().enumerate() {
                // Vertices that no face uses may lie anywhere and have no normal; the format wants both.
                let normal = field.normals()[k];
                let used = normal != Vec3::ZERO;
                let (position, normal) =
                    if used { (scene.vertices[k], normal) } else { (Vec3::ZERO, Vec3::Y) };
                (attribute.put)(&Vertex { position, normal, light, exposure }, &mut bytes);
                if bytes.len() > 1 << 16 {
                    put(sink, &bytes)?;
                    bytes.clear();
                }
            }
        }
        put(sink, &bytes)?;
        for column in &transfers.columns {
            for values in column.chunks(1 << 12) {
                put(sink, bytemuck::cast_slice(values))?;
            }
        }
        for mesh in &scene.meshes {
            for triangle in &scene.triangles[mesh.triangles.start as usize..mesh.triangles.end as usize] {
                let own = triangle.map(|corner| (corner - mesh.vertices.start).to_le_bytes());
                put(sink, own.as_flattened())?;
            }
        }
        Ok(())
    })
}

/// An array of vertices in the file.
struct Array {
    name: String,
    kind: &'static str,
    component: u32,
    bytes: usize,
}

/// All arrays, in the order of the file.
fn arrays(transfers: usize) -> Vec<Array> {
    let own = ATTRIBUTES.iter().map(|a| Array {
        name: a.name.to_owned(),
        kind: a.kind,
        component: a.component,
        bytes: a.bytes,
    });
    let transfer = |k| Array { name: format!("_TRANSFER_{k}"), kind: "VEC3", component: FLOAT, bytes: 12 };
    own.chain((0..transfers).map(transfer)).collect()
}

/// The JSON of the file.
fn document(scene: &Scene, exposure: f32, transfers: usize) -> Value {
    let count = scene.vertices.len();
    let mut views = Vec::new();
    let mut offset = 0;
    let arrays = arrays(transfers);
    for array in &arrays {
        let bytes = array.bytes * count;
        views
            .push(json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes, "byteStride": array.bytes,
            "target": ARRAY_BUFFER }));
        offset += bytes;
    }
    let bytes = 12 * scene.triangles.len();
    views.push(json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes, "target": INDEX_BUFFER }));
    // A mesh without a triangle is none in this format.
    let drawn: Vec<&Mesh> = scene.meshes.iter().filter(|mesh| !mesh.triangles.is_empty()).collect();
    let mut accessors = Vec::new();
    let mut meshes = Vec::new();
    for mesh in &drawn {
        let first = accessors.len();
        accessors.extend(accessors_of(scene, mesh, &arrays));
        let attributes: serde_json::Map<String, Value> =
            arrays.iter().enumerate().map(|(k, a)| (a.name.clone(), json!(first + k))).collect();
        let material = usize::from(mesh.two_sided);
        let primitive =
            json!({ "attributes": attributes, "indices": first + arrays.len(), "material": material });
        meshes.push(json!({ "name": mesh.name, "primitives": [primitive] }));
    }
    let children: Vec<usize> = (1..=drawn.len()).collect();
    let mut nodes = vec![root(scene, &children)];
    nodes.extend(drawn.iter().enumerate().map(|(k, mesh)| json!({ "name": mesh.name, "mesh": k })));
    let materials = [false, true].map(|both| {
        json!({ "doubleSided": both, "extensions": { "KHR_materials_unlit": {} },
            "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 1.0 } })
    });
    let mut extras =
        json!({ "exposure": exposure, "units": "radiosity and irradiance in W/m^2, linear Rec.709" });
    if transfers > 0 {
        extras["transfer"] = json!(
            "_TRANSFER_i: radiosity in W/m^2 under a sky of radiance Y_i, all bounces, i = l(l+1)+m; real, orthonormal, signs of \
             Sloan 2008, third axis the scene's up: docs/transfer.md"
        );
    }
    json!({
        "asset": { "version": "2.0", "generator": concat!("glowtree ", env!("CARGO_PKG_VERSION")) },
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{ "nodes": [0], "extras": extras }],
        "nodes": nodes,
        "meshes": meshes,
        "materials": materials,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{ "byteLength": offset + bytes }],
    })
}

/// The arrays of one mesh: its vertices' attributes, then its corners.
fn accessors_of(scene: &Scene, mesh: &Mesh, arrays: &[Array]) -> Vec<Value> {
    let vertices = mesh.vertices.start as usize..mesh.vertices.end as usize;
    let triangles = mesh.triangles.start as usize..mesh.triangles.end as usize;
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let mut used = vec![false; vertices.len()];
    for &corner in scene.triangles[triangles.clone()].iter().flatten() {
        let at = scene.vertices[corner as usize];
        (low, high) = (low.min(at), high.max(at));
        used[corner as usize - vertices.start] = true;
    }
    if used.contains(&false) {
        // The others are written at the origin.
        (low, high) = (low.min(Vec3::ZERO), high.max(Vec3::ZERO));
    }
    let mut accessors: Vec<Value> = arrays
        .iter()
        .enumerate()
        .map(|(view, attribute)| {
            json!({ "bufferView": view, "byteOffset": attribute.bytes * vertices.start, "count": vertices.len(),
                "componentType": attribute.component, "type": attribute.kind })
        })
        .collect();
    accessors[0]["min"] = json!(low.to_array());
    accessors[0]["max"] = json!(high.to_array());
    accessors[2]["normalized"] = json!(true);
    accessors.push(json!({ "bufferView": arrays.len(), "byteOffset": 12 * triangles.start,
        "count": 3 * triangles.len(), "componentType": UNSIGNED_INT, "type": "SCALAR" }));
    accessors
}

/// From local coordinates to the world, up turned to +y.
fn root(scene: &Scene, children: &[usize]) -> Value {
    let turn = DQuat::from_rotation_arc(scene.up.as_dvec3().normalize_or(DVec3::Y), DVec3::Y);
    let (origin, scale) = (turn * scene.placement.origin, [scene.placement.scale; 3]);
    json!({ "name": "scene", "children": children, "translation": origin.to_array(),
        "rotation": turn.to_array(), "scale": scale })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::synthetic;

    fn exported(scene: &Scene) -> (gltf::Document, Vec<gltf::buffer::Data>) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.glb");
        export(&path, scene, &synthetic::light, &|_| Ok(())).unwrap();
        let (document, buffers, _) = gltf::import(&path).unwrap();
        (document, buffers)
    }

    #[test]
    fn the_light_reads_back_from_its_attributes() {
        let mut scene = synthetic::room();
        scene.vertices.push(Vec3::splat(9.0e20));
        scene.meshes[0].vertices.end += 1;
        scene.placement.origin = DVec3::new(5.0e6, 0.125, -3.0);
        scene.placement.scale = 4.0;
        let (document, buffers) = exported(&scene);
        let primitive = document.meshes().next().unwrap().primitives().next().unwrap();
        let reader = primitive.reader(|buffer| Some(&buffers[buffer.index()]));
        let positions: Vec<[f32; 3]> = reader.read_positions().unwrap().collect();
        assert_eq!(positions[..8], scene.vertices[..8].iter().map(Vec3::to_array).collect::<Vec<_>>()[..]);
        assert_eq!(positions[8], [0.0; 3], "a vertex that no face uses");
        let corners: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
        assert_eq!(corners, scene.triangles.as_flattened());
        let nothing = |points: &[crate::geometry::SurfacePoint]| synthetic::light(points);
        let field = VertexField::new(&scene, &nothing, &|_| Ok(())).unwrap();
        let (lights, exposure) = (field.light(0..9), field.exposure());
        let extras: Value =
            serde_json::from_str(document.default_scene().unwrap().extras().as_ref().unwrap().get()).unwrap();
        assert!(
            (extras["exposure"].as_f64().unwrap() - f64::from(exposure)).abs() < 1e-6 * f64::from(exposure)
        );
        let colours: Vec<[u16; 4]> = reader.read_colors(0).unwrap().into_rgba_u16().collect();
        for (colour, light) in colours.iter().zip(&lights) {
            for (k, channel) in colour[..3].iter().enumerate() {
                // Half a step of 65,535, and the float's rounding.
                let expected = (light.radiosity[k] * exposure).clamp(0.0, 1.0);
                assert!((f32::from(*channel) / 65_535.0 - expected).abs() <= 0.51 / 65_535.0);
            }
            assert_eq!(colour[3], u16::MAX);
        }
        let view = primitive.get(&gltf::Semantic::Extras("RADIOSITY".into())).unwrap();
        let (at, stride) = (view.view().unwrap().offset() + view.offset(), 12);
        for (k, light) in lights.iter().enumerate() {
            let word = |c: usize| buffers[0][at + k * stride + 4 * c..][..4].try_into().unwrap();
            assert_eq!([0, 1, 2].map(|c| f32::from_le_bytes(word(c))), light.radiosity.to_array());
        }
        let (translation, _, scale) = document.nodes().next().unwrap().transform().decomposed();
        assert_eq!((translation, scale), ([5.0e6, 0.125, -3.0], [4.0; 3]));
    }

    #[test]
    fn up_becomes_y() {
        let mut scene = synthetic::square();
        scene.up = Vec3::Z;
        let (document, _) = exported(&scene);
        let (_, rotation, _) = document.nodes().next().unwrap().transform().decomposed();
        let turned = glam::Quat::from_array(rotation) * Vec3::Z;
        assert!((turned - Vec3::Y).length() < 1e-6, "{turned}");
    }

    #[test]
    fn every_mesh_has_its_own_arrays() {
        let mut scene = synthetic::square();
        let other = synthetic::square();
        scene.vertices.extend(other.vertices.iter().map(|v| *v + Vec3::Z));
        scene.triangles.extend(other.triangles.iter().map(|t| t.map(|k| k + 4)));
        let mut mesh = scene.meshes[0].clone();
        (mesh.triangles, mesh.vertices, mesh.name, mesh.two_sided) = (2..4, 4..8, "lid".into(), true);
        scene.meshes.push(mesh);
        let (document, buffers) = exported(&scene);
        let lid = document.meshes().find(|mesh| mesh.name() == Some("lid")).unwrap();
        let primitive = lid.primitives().next().unwrap();
        assert!(primitive.material().double_sided());
        assert!(document.extensions_used().any(|name| name == "KHR_materials_unlit"));
        let reader = primitive.reader(|buffer| Some(&buffers[buffer.index()]));
        assert!(reader.read_positions().unwrap().all(|at| at[2] == 1.0));
        assert_eq!(reader.read_indices().unwrap().into_u32().max(), Some(3));
        assert_eq!(primitive.bounding_box().min[2], 1.0);
    }
}
