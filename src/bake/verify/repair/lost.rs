//! What was asked and of which inputs, found again when the job's own notes are damaged: the archives carry digests that
//! prove a guess.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::{Repaired, RepairedFile, readable};
use crate::archive::{Archive, Digest, Disk, Storage};
use crate::bake::job::streams::Streamed;
use crate::bake::job::{INPUTS_FILE, Inputs, OPTIONS_FILE, options_digest, read_side, write_side};
use crate::bake::options::Options;
use crate::bake::store;
use crate::error::{Error, Result};
use crate::scene;

/// Writes options and inputs anew where they are damaged.
pub(super) fn find(job: &Path, repaired: &mut Repaired) -> Result<()> {
    let archives = readable(job);
    let told = archives.first().map(Archive::digests);
    let is = |digest: Result<Digest>, told: Option<Digest>| told.is_some() && digest.ok() == told;
    let options = told.map(|told| told.options);
    if !is(read(job, OPTIONS_FILE).and_then(|o: Options| options_digest(&o)), options) {
        let found = recorded::<Options>(&archives, OPTIONS_FILE).filter(|o| is(options_digest(o), options));
        write(job, OPTIONS_FILE, found, repaired)?;
    }
    let inputs = told.map(|told| told.inputs);
    if !is(read(job, INPUTS_FILE).and_then(|i: Inputs| i.digest()), inputs) {
        let found = guesses(job).find(|i| is(i.digest(), inputs));
        write(job, INPUTS_FILE, found, repaired)?;
    }
    Ok(())
}

fn read<T: DeserializeOwned>(job: &Path, name: &str) -> Result<T> {
    read_side(&job.join(name))?.ok_or_else(|| Error::NoJob { job: job.to_path_buf() })
}

/// What the archives' provenance says, if it does.
fn recorded<T: DeserializeOwned>(archives: &[Archive], name: &str) -> Option<T> {
    let stem = name.trim_end_matches(".json");
    let texts = archives.iter().flat_map(Archive::provenance).filter(|(key, _)| key == stem);
    texts.filter_map(|(_, text)| serde_json::from_str(text).ok()).next()
}

/// Lists of inputs that a scene of these meshes may have been read from: a bare mesh, or a TOML beside or above one.
fn guesses(job: &Path) -> impl Iterator<Item = Inputs> {
    let meshes = store::read_scene(job).map_or(Vec::new(), |(scene, _)| scene.meshes);
    let mut files: Vec<PathBuf> = Vec::new();
    for mesh in meshes {
        if !files.contains(&mesh.file) {
            files.push(mesh.file);
        }
    }
    let folders = files.iter().flat_map(|mesh| mesh.ancestors().skip(1).take(3));
    let mut scenes: Vec<PathBuf> = files.first().cloned().into_iter().collect();
    for folder in folders {
        let here = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        let entries = std::fs::read_dir(here).into_iter().flatten().flatten();
        let tomls = entries.map(|entry| folder.join(entry.file_name()));
        scenes.extend(tomls.filter(|path| path.extension().is_some_and(|ending| ending == "toml")));
    }
    scenes.sort();
    scenes.dedup();
    scenes
        .into_iter()
        .filter_map(|path| Inputs::of(&path, &scene::load(&path).ok()?, &Streamed::default()).ok())
}

fn write<T: Serialize>(job: &Path, name: &str, found: Option<T>, repaired: &mut Repaired) -> Result<()> {
    let Some(found) = found else {
        let problem =
            format!("{name} is lost and nothing else tells what it said; bake again with --restart");
        return Err(Error::DamagedJob { job: job.to_path_buf(), problem });
    };
    let storage: Arc<dyn Storage> = Arc::new(Disk);
    write_side(&storage, &job.join(name), &found)?;
    let file = name.to_owned();
    repaired.files.push(RepairedFile { file, made_blocks: 0, kept_blocks: 0, by: "proven by digest" });
    Ok(())
}
