//! What was asked and of which inputs, found again when the job's own notes are damaged: the archives carry digests that
//! prove a guess.

use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::{Repaired, RepairedFile, readable};
use crate::archive::{Archive, Digest};
use crate::bake::job::{INPUTS_FILE, OPTIONS_FILE, read_json, write_json};
use crate::bake::options::Options;
use crate::bake::store;
use crate::bake::verify::sides::Inputs;
use crate::error::{Error, Result};

/// Writes options and inputs anew where they are damaged.
pub(super) fn find(job: &Path, repaired: &mut Repaired) -> Result<()> {
    let archives = readable(job);
    let told = archives.first().map(Archive::digests);
    let is = |digest: Result<Digest>, told: Option<Digest>| told.is_some() && digest.ok() == told;
    let options = told.map(|told| told.options);
    if !is(read(job, OPTIONS_FILE).and_then(|o: Options| Digest::of_options(&o)), options) {
        let found =
            recorded::<Options>(&archives, OPTIONS_FILE).filter(|o| is(Digest::of_options(o), options));
        write(job, OPTIONS_FILE, found, repaired)?;
    }
    let inputs = told.map(|told| told.inputs);
    if !is(read(job, INPUTS_FILE).and_then(|i: Inputs| Digest::of_options(&i)), inputs) {
        let known = recorded::<Inputs>(&archives, INPUTS_FILE).into_iter();
        let found = known.chain(guesses(job)).find(|i| is(Digest::of_options(i), inputs));
        write(job, INPUTS_FILE, found, repaired)?;
    }
    Ok(())
}

fn read<T: DeserializeOwned>(job: &Path, name: &str) -> Result<T> {
    read_json(job, name)?.ok_or_else(|| Error::NoJob { job: job.to_path_buf() })
}

/// What the archives' provenance says, if it does.
fn recorded<T: DeserializeOwned>(archives: &[Archive], name: &str) -> Option<T> {
    let stem = name.trim_end_matches(".json");
    let texts = archives.iter().flat_map(Archive::provenance).filter(|(key, _)| key == stem);
    texts.filter_map(|(_, text)| serde_json::from_str(text).ok()).next()
}

/// Lists of inputs that a scene of these meshes may have been read from: a bare mesh, or a TOML beside or above one.
fn guesses(job: &Path) -> Vec<Inputs> {
    let Ok((scene, _)) = store::read_scene(job) else { return Vec::new() };
    let mut meshes: Vec<PathBuf> = Vec::new();
    for mesh in &scene.meshes {
        if !meshes.contains(&mesh.file) {
            meshes.push(mesh.file.clone());
        }
    }
    let folders = meshes.iter().flat_map(|mesh| mesh.ancestors().skip(1).take(3));
    let mut scenes: Vec<PathBuf> = meshes.first().cloned().into_iter().collect();
    for folder in folders {
        let here = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        let entries = std::fs::read_dir(here).into_iter().flatten().flatten();
        let tomls = entries.map(|entry| folder.join(entry.file_name()));
        scenes.extend(tomls.filter(|path| path.extension().is_some_and(|ending| ending == "toml")));
    }
    scenes.sort();
    scenes.dedup();
    scenes.iter().filter_map(|scene| digested(scene, &meshes)).collect()
}

fn digested(scene: &Path, meshes: &[PathBuf]) -> Option<Inputs> {
    let others = meshes.iter().filter(|mesh| *mesh != scene).cloned();
    let files: Vec<PathBuf> = std::iter::once(scene.to_path_buf()).chain(others).collect();
    files.into_iter().map(|file| Some((file.clone(), Digest::of_file(&file).ok()?.to_string()))).collect()
}

fn write<T: Serialize>(job: &Path, name: &str, found: Option<T>, repaired: &mut Repaired) -> Result<()> {
    let Some(found) = found else {
        let problem =
            format!("{name} is lost and nothing else tells what it said; bake again with --restart");
        return Err(Error::DamagedJob { job: job.to_path_buf(), problem });
    };
    write_json(job, name, &found)?;
    let file = name.to_owned();
    repaired.files.push(RepairedFile { file, made_blocks: 0, kept_blocks: 0, by: "proven by digest" });
    Ok(())
}
