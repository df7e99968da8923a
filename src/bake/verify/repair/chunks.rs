//! Damaged chunks of meshes that stay in their files: such meshes are cut once more, and a file takes the old one's place
//! when the blocks that are whole prove it the same.

use std::fs::{self, File};
use std::path::Path;
use std::sync::Arc;

use super::rebake::{again, compare, kept, unchanged};
use super::{Repaired, RepairedFile};
use crate::archive::{Disk, Storage};
use crate::bake::job::streams::{self, Workshop};
use crate::bake::options::Options;
use crate::bake::report::progress::Monitor;
use crate::bake::store;
use crate::bake::verify::Report;
use crate::detail::Detail;
use crate::error::{Error, Result};
use crate::scene;

/// Cuts again what the job's damaged or lost chunks were cut from; whether there were any.
pub(super) fn mend(
    job: &Path,
    report: &Report,
    repaired: &mut Repaired,
    monitor: &dyn Monitor,
) -> Result<bool> {
    // A scene that cannot say what it refers to is mended first.
    let names: Vec<String> =
        store::chunk_files(job).unwrap_or_default().into_iter().map(|(_, name)| name).collect();
    let (whole, damaged): (Vec<String>, Vec<String>) =
        names.into_iter().partition(|name| report.is_whole_file(name));
    if damaged.is_empty() {
        return Ok(false);
    }
    let (options, inputs, folder) = again(job)?;
    let scene_path = unchanged(job, &inputs)?;
    // Those that are whole are not made again.
    let storage: Arc<dyn Storage> = Arc::new(Disk);
    streams::share(&storage, &whole, job, folder.path())?;
    cut((&storage, folder.path()), (scene_path, &options), monitor)?;
    let placement = store::read_scene(job)?.0.placement;
    // All are compared before the first is changed.
    let mut files = Vec::with_capacity(damaged.len());
    for name in damaged {
        let differs = |what: &str| {
            let difference = format!("{name}: {what} when the mesh is cut now");
            Error::JobDiffers { job: job.to_path_buf(), difference }
        };
        let new = folder.path().join(&name);
        if !new.exists() {
            return Err(differs("the name is another"));
        }
        let fresh = Detail::open(&new, None)?;
        if fresh.placement() != placement {
            return Err(differs("the scene's frame is another"));
        }
        compare(job, &name, fresh.archive(), report)?;
        let blocks = fresh.archive().all_blocks().count() as u64;
        let made_blocks = kept(job, &name, report).map_or(blocks, |(_, damaged)| damaged.len() as u64);
        files.push(RepairedFile {
            file: name,
            made_blocks,
            kept_blocks: blocks - made_blocks,
            by: "cut anew",
        });
    }
    for file in files {
        let path = job.join(&file.file);
        fs::rename(folder.path().join(&file.file), &path)
            .and_then(|()| File::open(job)?.sync_all())
            .map_err(|e| Error::io(&path, "renaming the mended file", e))?;
        repaired.files.push(file);
    }
    Ok(true)
}

/// Cuts the scene's streamed meshes into a folder.
fn cut(
    (storage, folder): (&Arc<dyn Storage>, &Path),
    (scene_path, options): (&Path, &Options),
    monitor: &dyn Monitor,
) -> Result<()> {
    let pause = || monitor.check();
    let params = streams::cut_params(options.error, options.proxy);
    let workshop = Workshop { storage, job: folder, pause: &pause, monitor, params, recorded: None };
    let contents = scene::draft(scene_path, options.resident())?;
    workshop.stream(contents, scene_path).map(drop)
}
