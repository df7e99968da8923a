//! Reads glTF and GLB through the gltf crate, after checks of what the crate takes for granted.
//!
//! Base colours become albedos, emission becomes radiance, punctual lights and cameras are read. Light units of glTF
//! are photometric; their numbers are taken as W·m⁻²(·sr⁻¹) unchanged.

mod bounds;
mod surfaces;

use std::path::Path;

use glam::{DAffine3, DMat4, DVec3, Vec2, Vec3};
use gltf::mesh::Mode;
use gltf::{Document, Node, Primitive};

use crate::error::{Error, Result};
use crate::light::Rgb;
use crate::scene::assemble::{Contents, Part, Surface, WorldCamera, WorldLamp};
use crate::scene::{Camera, LampKind, Warning};
use surfaces::Surfaces;

/// Reads a glTF or GLB file with its buffers and textures.
///
/// # Errors
/// [`Error::Input`] naming buffer, accessor, mesh or material for anything invalid; [`Error::Io`].
pub fn read(path: &Path) -> Result<Contents> {
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, "reading the mesh", e))?;
    let (document, blob) = parsed(path, &bytes)?;
    drop(bytes);
    bounds::check_references(path, &document)?;
    let buffers = bounds::read_buffers(path, &document, blob)?;
    let mut reader = Reader {
        path,
        buffers: &buffers,
        surfaces: Surfaces::new(path, &document, &buffers),
        contents: Contents::default(),
        left_out: Vec::new(),
    };
    reader.scene(&document)?;
    reader.finish()
}

/// The validated document and the binary chunk.
fn parsed(path: &Path, bytes: &[u8]) -> Result<(Document, Option<Vec<u8>>)> {
    let broken = |error: gltf::Error| {
        let said = error.to_string();
        refuse(path, "glTF", said.trim().trim_end_matches(';').replace('\n', " "))
    };
    bounds::check_container(bytes).map_err(|problem| refuse(path, "GLB header", problem))?;
    let gltf = gltf::Gltf::from_slice_without_validation(bytes).map_err(broken)?;
    let json = gltf.document.into_json();
    if json.asset.version.split('.').next() != Some("2") {
        let problem = format!("version {:?} is not read, only 2", json.asset.version);
        return Err(refuse(path, "asset", problem));
    }
    // The validator looks positions up before it has validated their index.
    for (number, mesh) in json.meshes.iter().enumerate() {
        for index in mesh.primitives.iter().flat_map(|primitive| primitive.attributes.values()) {
            if index.value() >= json.accessors.len() {
                let problem =
                    format!("accessor {} does not exist, there are {}", index.value(), json.accessors.len());
                return Err(refuse(path, format!("mesh {number}"), problem));
            }
        }
    }
    Ok((Document::from_json(json).map_err(broken)?, gltf.blob))
}

fn refuse(path: &Path, place: impl Into<String>, problem: impl Into<String>) -> Error {
    Error::input(path, place, problem, "export the file again, or check it with the glTF validator")
}

struct Reader<'a> {
    path: &'a Path,
    buffers: &'a [gltf::buffer::Data],
    surfaces: Surfaces<'a>,
    contents: Contents,
    /// What was passed over.
    left_out: Vec<String>,
}

impl Reader<'_> {
    /// Walks the tree of the default scene, or of all roots when there is no scene.
    fn scene(&mut self, document: &Document) -> Result<()> {
        let roots: Vec<Node<'_>> = match document.default_scene().or_else(|| document.scenes().next()) {
            Some(scene) => scene.nodes().collect(),
            None => {
                let mut is_child = vec![false; document.nodes().len()];
                document
                    .nodes()
                    .flat_map(|node| node.children())
                    .for_each(|child| is_child[child.index()] = true);
                document.nodes().filter(|node| !is_child[node.index()]).collect()
            }
        };
        let mut visited = vec![false; document.nodes().len()];
        let mut open: Vec<(Node<'_>, DMat4)> =
            roots.into_iter().rev().map(|root| (root, DMat4::IDENTITY)).collect();
        while let Some((node, parent)) = open.pop() {
            let place = || format!("node {}", node.index());
            if std::mem::replace(&mut visited[node.index()], true) {
                return Err(refuse(self.path, place(), "it has two parents, or is its own ancestor"));
            }
            let local =
                DMat4::from_cols_array_2d(&node.transform().matrix().map(|column| column.map(f64::from)));
            let world = parent * local;
            if !world.is_finite() {
                return Err(refuse(self.path, place(), "its transform is not finite"));
            }
            self.node(&node, DAffine3::from_mat4(world))?;
            let children: Vec<Node<'_>> = node.children().collect();
            open.extend(children.into_iter().rev().map(|child| (child, world)));
        }
        Ok(())
    }

    fn node(&mut self, node: &Node<'_>, world: DAffine3) -> Result<()> {
        let mut own = Contents::default();
        if let Some(mesh) = node.mesh() {
            let name =
                node.name().or(mesh.name()).map_or_else(|| format!("mesh{}", mesh.index()), str::to_string);
            let several = mesh.primitives().len() > 1;
            for primitive in mesh.primitives() {
                let place = format!("mesh {}, primitive {}", mesh.index(), primitive.index());
                let Some(mut part) = self.part(&primitive, &place)? else { continue };
                part.name.clone_from(&name);
                if several {
                    let material = primitive.material().name().map(str::to_string);
                    part.name =
                        format!("{name}/{}", material.unwrap_or_else(|| primitive.index().to_string()));
                }
                own.parts.push(part);
            }
        }
        if let Some(light) = node.light() {
            own.lamps.push(self.lamp(node, &light)?);
        }
        if let Some(camera) = node.camera() {
            own.cameras.extend(self.camera(node, &camera));
        }
        own.transform(world);
        self.contents.parts.append(&mut own.parts);
        self.contents.lamps.append(&mut own.lamps);
        self.contents.cameras.append(&mut own.cameras);
        Ok(())
    }

    /// One primitive as a part in the coordinates of its own node, or nothing for points and lines.
    fn part(&mut self, primitive: &Primitive<'_>, place: &str) -> Result<Option<Part>> {
        let mode = primitive.mode();
        if !matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            self.left_out.push(format!("{place} (points or lines)"));
            return Ok(None);
        }
        bounds::check_primitive(primitive, self.buffers).map_err(|p| refuse(self.path, place, p))?;
        let reader = primitive.reader(|buffer| self.buffers.get(buffer.index()).map(|data| &data.0[..]));
        let Some(positions) = reader.read_positions() else {
            return Err(refuse(self.path, place, "it has no positions"));
        };
        let positions: Vec<DVec3> = positions.map(|p| Vec3::from_array(p).as_dvec3()).collect();
        if let Some(at) = positions.iter().position(|p| !p.is_finite()) {
            let problem = format!("the position of vertex {at} is not finite: {}", positions[at]);
            return Err(refuse(self.path, place, problem));
        }
        let corners: Vec<u32> = match reader.read_indices() {
            Some(indices) => indices.into_u32().collect(),
            None => (0..positions.len() as u32).collect(),
        };
        if let Some(at) = corners.iter().position(|&corner| corner as usize >= positions.len()) {
            let problem =
                format!("index {at} is vertex {}, out of range: there are {}", corners[at], positions.len());
            return Err(refuse(self.path, place, problem));
        }
        let count = positions.len();
        let per_vertex = |length: usize, what: &str| {
            let problem = format!("{length} {what} for {count} vertices");
            if length == count { Ok(()) } else { Err(refuse(self.path, place, problem)) }
        };
        let normals: Option<Vec<Vec3>> =
            reader.read_normals().map(|list| list.map(Vec3::from_array).collect());
        per_vertex(normals.as_ref().map_or(count, Vec::len), "normals")?;
        let colours: Option<Vec<Rgb>> =
            reader.read_colors(0).map(|list| list.into_rgb_f32().map(Rgb::from_array).collect());
        per_vertex(colours.as_ref().map_or(count, Vec::len), "colours")?;
        if colours.iter().flatten().any(|c| !c.is_finite() || c.min_element() < 0.0) {
            return Err(refuse(self.path, place, "a vertex colour is negative or not finite"));
        }
        let mut part =
            Part { normals, triangles: triangles_of(mode, &corners), positions, ..Part::default() };
        self.surfaces.apply(&primitive.material(), &mut part, colours.is_some())?;
        if let Surface::Image(..) = part.surface {
            let set = primitive.material().pbr_metallic_roughness().base_color_texture().map_or(0, |info| {
                info.texture_transform().and_then(|t| t.tex_coord()).unwrap_or(info.tex_coord())
            });
            let uv: Option<Vec<Vec2>> =
                reader.read_tex_coords(set).map(|list| list.into_f32().map(Vec2::from_array).collect());
            per_vertex(uv.as_ref().map_or(count, Vec::len), "texture coordinates")?;
            part.uv = uv;
            surfaces::transform_uv(&primitive.material(), &mut part);
            if part.uv.iter().flatten().any(|at| !at.is_finite()) {
                return Err(refuse(self.path, place, "a texture coordinate is not finite"));
            }
        }
        part.colours = colours;
        Ok(Some(part))
    }

    fn lamp(&mut self, node: &Node<'_>, light: &gltf::khr_lights_punctual::Light<'_>) -> Result<WorldLamp> {
        use gltf::khr_lights_punctual::Kind;
        let power = Rgb::from_array(light.color()) * light.intensity();
        let place = format!("light {}", light.index());
        crate::scene::materials::check_radiance(power).map_err(|p| refuse(self.path, place.clone(), p))?;
        let kind = match light.kind() {
            Kind::Directional => LampKind::Sun { direction: Vec3::NEG_Z, irradiance: power },
            Kind::Point => LampKind::Point { position: Vec3::ZERO, intensity: power },
            Kind::Spot { inner_cone_angle, outer_cone_angle } => {
                let (inner, outer) = (f64::from(inner_cone_angle), f64::from(outer_cone_angle));
                if !(inner >= 0.0 && inner <= outer && outer <= std::f64::consts::FRAC_PI_2 + 1e-6) {
                    let problem =
                        format!("cone angles {inner} and {outer} rad are not 0 <= inner <= outer <= pi/2");
                    return Err(refuse(self.path, place, problem));
                }
                crate::scene::spot(Vec3::NEG_Z, power, inner, outer)
            }
        };
        let name = node.name().or(light.name()).unwrap_or("lamp").to_string();
        Ok(WorldLamp { name, position: DVec3::ZERO, kind })
    }

    fn camera(&mut self, node: &Node<'_>, camera: &gltf::Camera<'_>) -> Option<WorldCamera> {
        let gltf::camera::Projection::Perspective(view) = camera.projection() else {
            self.left_out.push(format!("camera {} (orthographic)", camera.index()));
            return None;
        };
        let fov_degrees = view.yfov().to_degrees();
        let aspect = view.aspect_ratio().unwrap_or(16.0 / 9.0);
        if !(0.01..=179.0).contains(&fov_degrees) || !(0.01..=100.0).contains(&aspect) {
            self.left_out
                .push(format!("camera {} (field of view {fov_degrees}, aspect {aspect})", camera.index()));
            return None;
        }
        let name = node.name().or(camera.name()).unwrap_or("camera").to_string();
        let size = [(720.0 * aspect).round().max(1.0) as u32, 720];
        let rest = Camera { name, eye: Vec3::ZERO, target: Vec3::ZERO, up: Vec3::Y, fov_degrees, size };
        Some(WorldCamera { eye: DVec3::ZERO, target: DVec3::NEG_Z, rest })
    }

    fn finish(mut self) -> Result<Contents> {
        let mut messages = self.surfaces.messages();
        if !self.left_out.is_empty() {
            messages.push(format!("not read: {}", self.left_out.join(", ")));
        }
        if !self.contents.lamps.is_empty() {
            messages
                .push("light intensities (candela, lux) are taken as W/sr and W/m2 unchanged".to_string());
        }
        let file = self.path.to_path_buf();
        self.contents.warnings.append(&mut self.surfaces.warnings);
        let warnings = messages.into_iter().map(|message| Warning { file: file.clone(), message });
        self.contents.warnings.extend(warnings);
        if self.contents.parts.is_empty() {
            return Err(refuse(self.path, "scene", "no triangles in it"));
        }
        Ok(self.contents)
    }
}

fn triangles_of(mode: Mode, corners: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        Mode::TriangleStrip => {
            let turned = |(k, t): (usize, &[u32])| {
                if k.is_multiple_of(2) { [t[0], t[1], t[2]] } else { [t[1], t[0], t[2]] }
            };
            corners.windows(3).enumerate().map(turned).collect()
        }
        Mode::TriangleFan => corners.windows(2).skip(1).map(|t| [corners[0], t[0], t[1]]).collect(),
        _ => corners.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
    }
}
