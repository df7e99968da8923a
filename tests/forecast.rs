//! `bake --dry-run`: what it says beforehand holds afterwards, and nothing is written meanwhile.

mod command;

use std::path::Path;

use command::{Place, code, stderr, stdout};
use glowtree::bake::{self, Forecast, Options, Silent};

fn bytes_in(job: &Path) -> u64 {
    let files = std::fs::read_dir(job).expect("the job").flatten();
    files.filter_map(|entry| entry.metadata().ok()).map(|meta| meta.len()).sum()
}

/// Within the 30 % that a forecast promises.
fn assert_near(what: &str, foretold: u64, found: u64) {
    let ratio = foretold as f64 / found as f64;
    assert!((0.7..=1.3).contains(&ratio), "{what}: {foretold} foretold, {found} found");
}

#[test]
fn sites_and_disk_come_out_as_foretold() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/cornell/scene.toml");
    let job = folder.path().join("job.glow");
    let options = Options { error: 0.02, ..Options::default() };
    let foretold = bake::forecast(&scene, &job, &options, &Silent).expect("a forecast");
    assert!(!job.exists() && foretold.free_bytes > 0);
    let made = bake::run(&scene, &job, &options, &Silent).expect("a bake");
    assert_eq!((foretold.triangles, foretold.vertices), (made.triangles, made.vertices));
    assert_near("sites", foretold.sites, made.sites);
    assert_near("bytes on disk", foretold.disk_bytes, bytes_in(&job));
    let names = |stages: Vec<String>| {
        let mut names: Vec<String> = stages.into_iter().filter(|name| name != "scene").collect();
        names.sort();
        names
    };
    let foretold_names = names(foretold.stages.iter().map(|stage| stage.name.clone()).collect());
    assert_eq!(foretold_names, names(made.stages.iter().map(|stage| stage.name.clone()).collect()));
    // Times depend on who else is busy; a forecast that is off by ten says nothing at all.
    let ratio = foretold.cpu_seconds / made.usage.cpu_seconds;
    assert!(
        (0.1..10.0).contains(&ratio),
        "{} s foretold, {} s found",
        foretold.cpu_seconds,
        made.usage.cpu_seconds
    );
}

#[test]
fn what_does_not_fit_is_refused_early() {
    let place = Place::new();
    let small = place.run(&["bake", "scene.toml", "-o", "job", "--dry-run", "--max-memory", "1MB"]);
    assert_eq!(code(&small), 6, "{}", stderr(&small));
    assert!(stderr(&small).contains("max-memory") && stdout(&small).is_empty(), "{}", stderr(&small));
    let fits = place.run(&["bake", "scene.toml", "-o", "job", "--dry-run", "--max-memory", "1GiB"]);
    assert_eq!(code(&fits), 0, "{}", stderr(&fits));
    assert!(stdout(&fits).contains("preview") && !place.path("job").exists(), "{}", stdout(&fits));

    let full = Forecast { disk_bytes: 700, passing_bytes: 400, free_bytes: 1000, ..Forecast::default() };
    let refused = full.check(Path::new("job"), None).expect_err("a full disk");
    assert_eq!(refused.exit_code(), 7);
    assert!(refused.to_string().contains("100"), "{refused}");
    assert!(Forecast { free_bytes: 1100, ..full }.check(Path::new("job"), None).is_ok());
}

#[test]
fn a_mesh_left_in_its_file_is_foretold_by_its_header() {
    let place = Place::new();
    // 10 million triangles that are not there: whoever goes through them fails.
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 5000000\nproperty float x\nproperty float y\n\
         property float z\nelement face 10000000\nproperty list uchar int vertex_indices\nend_header\n";
    let path = place.path("large.ply");
    std::fs::write(&path, header).expect("writing the header");
    let body = 5_000_000 * 12 + 10_000_000 * 13;
    let file = std::fs::OpenOptions::new().write(true).open(&path).expect("the file");
    file.set_len(header.len() as u64 + body).expect("a hole of that size");
    let options = Options { error: 0.03, ..Options::default() };
    let foretold = bake::forecast(&path, &place.path("job"), &options, &Silent).expect("a forecast");
    assert_eq!((foretold.triangles, foretold.vertices, foretold.sites), (10_000_000, 5_000_000, 0));
    // docs/scaling.md, Lucy of 10 million: 79.5 CPU seconds, 0.23 GB, a job of 1.16 GB.
    assert_near("CPU seconds", foretold.cpu_seconds as u64, 79);
    assert_near("bytes of memory", foretold.peak_anonymous_bytes, 230_000_000);
    assert_near("bytes on disk", foretold.disk_bytes, 1_160_000_000);
}
