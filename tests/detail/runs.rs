//! Interrupted runs end with the bytes of whole ones, for any number of threads.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use glam::DAffine3;
use glowtree::archive::{Disk, Storage, partial_path};
use glowtree::detail::{Detail, Shards, write};
use glowtree::scene::Placement;
use glowtree::scene::ply::stream::Stream;
use glowtree::{Error, Result};

use super::files::{Form, little, ply};
use super::scene_shared::Folder;
use super::{PARAMS, bumpy_sphere, digests};

/// A run that is stopped at the given question whether to go on; tells how many questions there were.
fn run(mesh: &Path, archive: &Path, stop: u64) -> (Result<()>, u64) {
    let asked = AtomicU64::new(0);
    let pause = || match asked.fetch_add(1, Ordering::Relaxed) {
        count if count == stop => Err(Error::Interrupted { terminated: true }),
        _ => Ok(()),
    };
    let scratch = archive.with_extension("scratch");
    let whole = || {
        let stream = Stream::open_with(mesh, &scratch, &pause)?;
        let shards = Shards::make(&stream, &DAffine3::IDENTITY, &PARAMS, &scratch, &pause)?;
        let [low, high] = shards.bounds();
        let placement = Placement { origin: low * 0.5 + high * 0.5, scale: (high - low).max_element() };
        let storage: Arc<dyn Storage> = Arc::new(Disk);
        write((&storage, archive), digests(), (&stream, &shards, &placement), &pause, |_| ())
    };
    (whole(), asked.into_inner())
}

fn mesh(folder: &Folder) -> PathBuf {
    folder.write("mesh.ply", ply(&bumpy_sphere(4), &Form { format: "ascii", ..little() }))
}

#[test]
fn a_run_stopped_anywhere_is_resumed_to_the_same_bytes() {
    let folder = Folder::new();
    let mesh = mesh(&folder);
    let whole = folder.path().join("whole.glow");
    let (outcome, questions) = run(&mesh, &whole, u64::MAX);
    outcome.unwrap();
    let expected = std::fs::read(&whole).unwrap();
    // One question before each chunk; those before it are in the file.
    let chunks = Detail::open(&whole, Some(digests())).unwrap().chunk_count() as u64;
    assert!(chunks > 1 && questions > chunks + 4, "{questions} questions, {chunks} chunks");
    for stop in 0..questions {
        let archive = folder.path().join(format!("stopped-{stop}.glow"));
        assert!(matches!(run(&mesh, &archive, stop).0, Err(Error::Interrupted { .. })), "stop {stop}");
        let (outcome, fewer) = run(&mesh, &archive, u64::MAX);
        outcome.unwrap();
        assert!(std::fs::read(&archive).unwrap() == expected, "stop {stop}");
        let kept = stop + chunks < questions || fewer == questions - stop;
        assert!(kept, "stop {stop} of {questions}: {fewer} questions, {chunks} chunks");
    }
}

#[test]
fn a_cut_archive_is_resumed_to_the_same_bytes() {
    let folder = Folder::new();
    let mesh = mesh(&folder);
    let archive = folder.path().join("whole.glow");
    run(&mesh, &archive, u64::MAX).0.unwrap();
    let expected = std::fs::read(&archive).unwrap();
    for part in 0..12 {
        std::fs::remove_file(&archive).unwrap();
        std::fs::write(partial_path(&archive), &expected[..expected.len() * part / 12]).unwrap();
        run(&mesh, &archive, u64::MAX).0.unwrap();
        assert!(std::fs::read(&archive).unwrap() == expected, "part {part}");
    }
}

#[test]
fn threads_do_not_matter() {
    let folder = Folder::new();
    let mesh = folder.write("mesh.ply", ply(&bumpy_sphere(5), &little()));
    let made = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let archive = folder.path().join(format!("{threads}.glow"));
        pool.install(|| run(&mesh, &archive, u64::MAX)).0.unwrap();
        std::fs::read(&archive).unwrap()
    });
    assert!(made[0] == made[1], "archives differ");
}
