//! What a job was made from, and what has changed since.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::streams::Streamed;
use crate::archive::Digest;
use crate::bake::store::record;
use crate::error::Result;
use crate::scene::Scene;

/// The scene that a job was made from, in digests: of its content as it was read, so that files may move, be touched or
/// be written in another way, and textures and skies count without being listed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Inputs {
    /// The scene file and its meshes, with digests of their bytes: to name what changed.
    pub files: Vec<(PathBuf, String)>,
    /// Digest of vertices, triangles, normals and sides: what R depends on.
    pub geometry: String,
    /// Archives of chunks, for meshes that stay in their files: their names tell their content.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub streamed: Vec<String>,
    /// Digest of everything else: albedos, lights, sky, cameras.
    pub light: String,
}

/// What has changed since a job was made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Change {
    /// Nothing that matters.
    Nothing,
    /// Lights, albedos or cameras in these files: R stays.
    Light(String),
    /// The geometry: nothing stays.
    Geometry(String),
}

impl Inputs {
    /// Of a scene that was just read, and of the meshes that proxies in it stand for.
    ///
    /// # Errors
    /// [`crate::Error::Io`] when a file cannot be read again.
    pub fn of(scene_path: &Path, scene: &Scene, streamed: &Streamed) -> Result<Self> {
        let mut files = vec![scene_path.to_path_buf()];
        for mesh in &scene.meshes {
            if !files.contains(&mesh.file) {
                files.push(mesh.file.clone());
            }
        }
        let known = |file: &Path| streamed.files.iter().find(|(known, _)| known == file).map(|found| found.1);
        let digested = |file: PathBuf| {
            let digest = known(&file).map_or_else(|| Digest::of_file(&file), Ok)?;
            Ok((file, digest.to_string()))
        };
        Ok(Self {
            files: files.into_iter().map(digested).collect::<Result<_>>()?,
            geometry: geometry(scene).to_string(),
            streamed: streamed.names.clone(),
            light: record::light_digest(scene)?.to_string(),
        })
    }

    /// What has changed since these inputs were recorded.
    pub fn change(&self, now: &Self) -> Change {
        match (self.geometry == now.geometry && self.streamed == now.streamed, self.light == now.light) {
            (true, true) => Change::Nothing,
            (true, false) => Change::Light(self.changed_files(now)),
            (false, _) => Change::Geometry(self.changed_files(now)),
        }
    }

    /// The files that are not as they were, in words.
    fn changed_files(&self, now: &Self) -> String {
        let was = |file: &Path| self.files.iter().find(|(name, _)| name == file);
        let changed: Vec<String> = now
            .files
            .iter()
            .filter_map(|(file, digest)| match was(file) {
                None => Some(format!("{} is new", file.display())),
                Some((_, before)) if before != digest => Some(format!("{} has changed", file.display())),
                Some(_) => None,
            })
            .collect();
        if changed.is_empty() {
            let first = self.files.first().map(|(file, _)| file.display().to_string());
            return format!("a file that {} names has changed", first.unwrap_or_default());
        }
        changed.join(", ")
    }

    /// The digest that archives carry.
    ///
    /// # Errors
    /// None in practice: the fields are text.
    pub fn digest(&self) -> Result<Digest> {
        if self.streamed.is_empty() {
            return Digest::of_options(&(&self.geometry, &self.light));
        }
        Digest::of_options(&(&self.geometry, &self.light, &self.streamed))
    }
}

fn geometry(scene: &Scene) -> Digest {
    let array = |bytes: &[u8]| Digest::of_bytes(bytes);
    let mut digests = vec![
        array(bytemuck::cast_slice(&scene.vertices)),
        array(bytemuck::cast_slice(&scene.triangles)),
        array(bytemuck::cast_slice(&[scene.placement.origin.to_array()])),
        array(&scene.placement.scale.to_le_bytes()),
    ];
    for mesh in &scene.meshes {
        let ranges = [mesh.triangles.start, mesh.triangles.end, mesh.vertices.start, mesh.vertices.end];
        digests.push(array(bytemuck::cast_slice(&ranges)));
        digests.push(array(&[u8::from(mesh.two_sided), u8::from(mesh.normals.is_some())]));
        digests.push(array(bytemuck::cast_slice(mesh.normals.as_deref().unwrap_or_default())));
    }
    Digest::of_digests(&digests)
}
