//! The operator as it is stored and multiplied by: nothing is lost, it is small, and streaming it gives the same light.

mod shapes;

use std::path::{Path, PathBuf};

use glowtree::archive::{Archive, Digest, Digests, Tag};
use glowtree::bake::Silent;
use glowtree::bake::laws::Plan;
use glowtree::bake::model::Model;
use glowtree::bake::pipeline::build;
use glowtree::bake::store::{self, Purpose};
use glowtree::light::Rgb;
use glowtree::links::compress::merged::{Block, Merged};
use glowtree::links::receivers::Receivers;
use glowtree::links::rows::{FIRST_MARK, LOST, Rows, SKY};
use glowtree::scene;
use glowtree::solve::transport::{Transport, gather_stored};

/// A scene of the tree or of the shared data, baked as `--error 1%` begins: by a plan that aims at three quarters of it.
fn bake(file: &Path) -> Option<Model> {
    if !file.exists() {
        println!("skipped: no {}; set GLOWTREE_SHARED", file.display());
        return None;
    }
    let scene = scene::load(file).expect("the scene");
    Some(build(scene, &Plan::new(0.0075, 0), None, &Silent).expect("nothing interrupts").0)
}

fn own(name: &str) -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "data", name, "scene.toml"].iter().collect()
}

fn shared(name: &str) -> PathBuf {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared");
    let shared = std::env::var_os("GLOWTREE_SHARED").map_or_else(|| PathBuf::from(beside), PathBuf::from);
    shared.join("reference").join(name).join("scene.toml")
}

/// What is stored of a model in a directory, and what its rows would take as 32-bit CSR.
struct Stored {
    folder: tempfile::TempDir,
    /// Links: pairs of a receiver and a site that some of its rays met.
    links: u64,
    link_bytes: u64,
    row_bytes: u64,
    csr_bytes: u64,
}

fn store(model: &Model) -> Stored {
    let folder = tempfile::tempdir().expect("a folder");
    let digests = Digests { inputs: Digest::of_bytes(b"in"), options: Digest::of_bytes(b"out") };
    let report = store::write(model, folder.path(), digests).expect("room on the disk");
    let links = model.receivers.tables().iter().map(|(_, rows)| distinct(rows)).sum();
    assert_eq!(report.links, links);
    Stored {
        folder,
        links,
        link_bytes: report.link_bytes,
        row_bytes: report.row_bytes,
        // A column (u32) and a weight (f32) a link, a pointer (u32) a row and one for the end.
        csr_bytes: 8 * links + 4 * (model.receivers.len() as u64 + 1),
    }
}

fn distinct(rows: &Rows) -> u64 {
    let (mut merged, mut hits) = (Merged::default(), Vec::new());
    let count = |r| {
        merged.set(rows.row(r), &mut hits);
        merged.sites.len() as u64
    };
    (0..rows.len()).map(count).sum()
}

/// Bytes a link and sizes against CSR: what the project asks of the links alone, and of links with the order of the rays.
fn small_and_whole(name: &str, model: &Model, least_with_order: f64) {
    let stored = store(model);
    let receivers = &model.receivers;
    let rays = receivers.ray_count() as f64;
    let ratio = |bytes: u64| stored.csr_bytes as f64 / bytes as f64;
    let a_link = stored.link_bytes as f64 / stored.links as f64;
    println!(
        "{name}: {} rows of {} rays, {} of {}, {} links, {:.3} a ray; {a_link:.3} bytes a link, {:.3} a ray; \
         CSR {} bytes is {:.2} times the links, {:.2} times links and order",
        receivers.rows.len(),
        receivers.rows.rays,
        receivers.own.len(),
        receivers.own.rays,
        stored.links,
        stored.links as f64 / rays,
        stored.link_bytes as f64 / rays,
        stored.csr_bytes,
        ratio(stored.link_bytes),
        ratio(stored.row_bytes)
    );
    assert!(a_link <= 1.5, "{name}: {a_link} bytes a link");
    assert!(ratio(stored.link_bytes) >= 6.0, "{name}: links only {} times smaller", ratio(stored.link_bytes));
    assert!(ratio(stored.row_bytes) >= least_with_order, "{name}: rows only {}", ratio(stored.row_bytes));
    // No budget is spent: every ray of every row comes back.
    let back = store::read(stored.folder.path(), Purpose::Light).expect("what was written").receivers;
    for ((_, rows), (_, back)) in receivers.tables().into_iter().zip(back.tables()) {
        assert!(back.rays == rows.rays && back.met == rows.met, "{name}: rows differ");
        assert!(
            back.keys == rows.keys && back.summaries == rows.summaries,
            "{name}: keys or summaries differ"
        );
    }
}

#[test]
fn cornell_is_stored_small_and_whole() {
    let Some(model) = bake(&own("cornell")) else { panic!("the tree's own scene") };
    small_and_whole("cornell", &model, 6.0);
    product("cornell", &model);
}

#[test]
fn rooms_are_stored_small_and_whole() {
    let Some(model) = bake(&own("rooms")) else { panic!("the tree's own scene") };
    small_and_whole("rooms", &model, 6.0);
    product("rooms", &model);
}

#[test]
fn the_scan_is_stored_small_and_whole() {
    let Some(model) = bake(&shared("scan")) else { return };
    // The scan's surface is rough: where its own folds are met from close by, directions tell less.
    small_and_whole("scan", &model, 5.8);
}

/// G·B by definition, in f64.
fn by_definition(receivers: &Receivers, radiosity: &[Rgb]) -> Vec<[f64; 3]> {
    let row = |r: usize| {
        let (rows, r) = receivers.row(r);
        let row = rows.row(r);
        let count = |mark: u32| row.iter().filter(|&&met| met == mark).count();
        let surfaces = row.len() - count(SKY);
        // Lost rays are as the mean of the others that met surfaces.
        let weight = surfaces as f64 / ((surfaces - count(LOST)).max(1) * row.len()) as f64;
        let light = |k: usize| {
            row.iter().filter(|&&m| m < FIRST_MARK).map(|&m| f64::from(radiosity[m as usize][k])).sum::<f64>()
        };
        std::array::from_fn(|k| light(k) * weight)
    };
    (0..receivers.len()).map(row).collect()
}

/// The product from memory and as a stream against its definition, with one thread and with three.
fn product(name: &str, model: &Model) {
    let stored = store(model);
    let archive = Archive::open(stored.folder.path().join("links.glow")).expect("what was written");
    let receivers = &model.receivers;
    let blocks: Vec<Block<'_>> = archive
        .blocks(Tag::new("rows"))
        .map(|block| {
            let (range, (rows, _)) = (block.range(), receivers.row(block.range().start as usize));
            Block::new(block.stored().expect("whole"), (range.end - range.start) as usize, rows.rays)
                .expect("links")
        })
        .collect();
    let radiosity = &model.solution.radiosity;
    let transport = Transport { receivers, spread: &model.spread, albedo: &model.albedo };
    let both = || (transport.gather(radiosity), gather_stored(&blocks, receivers, radiosity).expect("links"));
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(both)
    };
    let (memory, stream) = with(1);
    assert!((memory.clone(), stream.clone()) == with(3), "{name}: threads matter");
    for (r, want) in by_definition(receivers, radiosity).into_iter().enumerate() {
        for (k, want) in want.into_iter().enumerate() {
            // Sixteen additions in f32 each err by ε/2 of what they have, the rest is f64, and one rounding to f32 ends it.
            let allowed = 9.0 * f64::from(f32::EPSILON) * want;
            for (from, got) in [("memory", memory[r][k]), ("stream", stream[r][k])] {
                let error = (f64::from(got) - want).abs();
                assert!(error <= allowed, "{name}: row {r} from {from}: got {got}, want {want}");
            }
        }
    }
}

#[test]
fn damage_in_a_stream_is_named() {
    let scene =
        shapes::scene(&[shapes::part("cube", shapes::icosphere(1.0, 2).flipped(), 0.5).exitance(1.0)]);
    let model = build(scene, &Plan::new(0.05, 1), None, &Silent).expect("nothing interrupts").0;
    let receivers = Receivers { own: Rows::default(), ..model.receivers };
    let rows = &receivers.rows;
    let (bytes, _) = glowtree::links::compress::merged::encode(rows, (0, rows.len()));
    let block = Block::new(&bytes, rows.len(), rows.rays).expect("what was written");
    let radiosity = &model.solution.radiosity;
    assert!(gather_stored(&[block], &receivers, radiosity).is_ok());
    // The last site that any row names is not there any more.
    let most =
        rows.met.iter().filter(|&&met| met < FIRST_MARK).max().copied().expect("rays that hit") as usize;
    let Err(problem) = gather_stored(&[block], &receivers, &radiosity[..most]) else {
        panic!("site {most} is missing")
    };
    assert!(problem.contains(&format!("names site {most}")), "{problem}");
}
