//! A model as files of a job, and back.

pub mod record;
pub(super) mod rows;

use std::path::Path;
use std::sync::{Arc, OnceLock};

use glam::{Mat3, Vec3};

use crate::archive::{Archive, Digest, Digests, Disk, Ledger, Storage, Tag, Writer};
use crate::bake::job::streams::{self, Details};
use crate::bake::model::Model;
use crate::bake::pipeline::{Stand, leaf_order};
use crate::basis::Basis;
use crate::error::{Error, Result};
use crate::links::direct::{Direct, DirectParams, LampLink};
use crate::links::lamps::{self, Lamp, LampTree};
use crate::links::receivers::Receivers;
use crate::links::spread::Spread;
use crate::rays::Bvh;
use crate::scatter::surface::Surface;
use crate::scene::Scene;
use crate::sites::{Cells, Neighbours, Plot, SiteArrays, Sites};
use crate::solve::Solution;
use crate::solve::field::FieldParams;
use record::SceneRecord;
use rows::Packed;

const PROGRAM: &str = concat!("glowtree ", env!("CARGO_PKG_VERSION"));

const fn tag(name: &str) -> Tag {
    Tag::new(name)
}

/// Sizes of what was written.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct StoreReport {
    /// All archives together.
    pub archive_bytes: u64,
    /// The rows' payload: links and the order of their rays.
    pub row_bytes: u64,
    /// Of it the links: all that the product needs.
    pub link_bytes: u64,
    /// Links: pairs of a receiver and a site that some of its rays met.
    pub links: u64,
    /// Blocks written.
    pub blocks: u64,
}

/// Where a model's files go, and what they carry.
#[derive(Clone, Copy)]
pub struct Shelf<'a> {
    /// What changes the disk.
    pub storage: &'a Arc<dyn Storage>,
    /// The job directory.
    pub job: &'a Path,
    /// What the files are made from.
    pub digests: Digests,
    /// Keeps rows that are encoded, which takes long.
    pub ledger: &'a Ledger<'a>,
    /// What they say of how they were made, besides the program.
    pub provenance: &'a [(&'a str, &'a str)],
}

/// One of a job's files.
type Write = fn(&mut Writer, &Model, &Packed) -> Result<()>;

/// A job's files, in the order they are written.
const FILES: [(&str, Write); 4] =
    [("scene", write_scene), ("sites", write_sites), ("links", write_links), ("light", write_light)];

/// Writes the model into a directory on the disk, one file a stage, in one go.
///
/// # Errors
/// [`Error::DiskFull`], [`Error::Io`].
pub fn write(model: &Model, job: &Path, digests: Digests) -> Result<StoreReport> {
    let storage: Arc<dyn Storage> = Arc::new(Disk);
    let ledger = &Ledger::idle(&|| Ok(()));
    write_to(&Shelf { storage: &storage, job, digests, ledger, provenance: &[] }, model)
}

/// Writes the model into the job directory, one file a stage; a file that is there already, made from the same, stays.
///
/// # Errors
/// [`Error::DiskFull`], [`Error::Io`], and the ledger's.
pub fn write_to(shelf: &Shelf<'_>, model: &Model) -> Result<StoreReport> {
    let packed = rows::pack(model, shelf.ledger)?;
    let mut report = StoreReport { links: packed.links, ..StoreReport::default() };
    for (kind, write) in FILES {
        let path = shelf.job.join(format!("{kind}.glow"));
        if !is_there(&path, shelf.digests) {
            let storage = Arc::clone(shelf.storage);
            let mut writer = Writer::create_in(storage, &path, Tag::new(kind), shelf.digests)?;
            write(&mut writer, model, &packed)?;
            report.blocks += writer.entries().len() as u64;
            writer.finish(&[&[("program", PROGRAM)], shelf.provenance].concat())?;
        }
        let archive = Archive::open(&path)?;
        report.archive_bytes += archive.bytes();
        for block in archive.all_blocks() {
            let entry = block.entry();
            report.link_bytes += if entry.tag == tag("rows") { entry.stored_bytes } else { 0 };
            let both = entry.tag == tag("rows") || entry.tag == tag("order");
            report.row_bytes += if both { entry.stored_bytes } else { 0 };
        }
    }
    Ok(report)
}

/// What tells the R of a job from every other: the content of its links.
///
/// # Errors
/// Those of opening the file.
pub fn links_content(job: &Path) -> Result<Digest> {
    Ok(open(job, "links")?.content())
}

/// What a job's files were made from.
///
/// # Errors
/// Those of opening the last of them.
pub fn digests_of(job: &Path) -> Result<Digests> {
    Ok(open(job, "light")?.digests())
}

/// Whether all of a job's files are there, damaged or not.
pub fn is_complete(job: &Path) -> bool {
    let chunks =
        || chunk_files(job).is_ok_and(|files| files.iter().all(|(_, name)| job.join(name).is_file()));
    FILES.iter().all(|(kind, _)| job.join(format!("{kind}.glow")).is_file()) && chunks()
}

/// Whether a finished file made from the same is there.
fn is_there(path: &Path, digests: Digests) -> bool {
    Archive::open(path).is_ok_and(|archive| archive.expect(digests.inputs, digests.options).is_ok())
}

/// What a reader wants to do with a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// Answer for points under the light that is stored: rows stay in the file, there are none in memory.
    Answers,
    /// Solve for other light: rows are decoded.
    Light,
}

/// Reads a model back.
pub fn read(job: &Path, purpose: Purpose) -> Result<Model> {
    let (scene, bvh) = read_scene(job)?;
    let details = streams::open(job, &chunk_files(job)?)?;
    let (sites, graph, plots) = read_sites(job)?;
    let cells = Cells::new(&Surface::new(&scene, leaf_order(&bvh)), &plots);
    let (lamps, _) = lamps::split(&scene);
    let (albedo, exitance) = read_materials(job, &sites)?;
    let (direct, receivers, spread) = read_links(job, (&sites, purpose), (&scene, &lamps))?;
    let (solution, field) = read_light(job, &receivers, &sites)?;
    let Stand { scene, bvh, details } = Stand { scene, bvh, details: Details::new() }.with_details(details);
    Ok(Model {
        scene,
        bvh,
        details,
        sites,
        graph,
        cells,
        plots,
        lamps,
        albedo,
        exitance,
        direct,
        receivers,
        spread,
        solution,
        field,
        smooth: OnceLock::new(),
    })
}

/// The archives of chunks that a job's scene refers to, each with the number of the mesh whose proxy is in the scene.
///
/// # Errors
/// Those of opening the scene's archive; [`Error::Damaged`] when it names what is no such file.
pub fn chunk_files(job: &Path) -> Result<Vec<(usize, String)>> {
    let archive = open(job, "scene")?;
    let Some((_, text)) = archive.provenance().iter().find(|(key, _)| key == DETAIL_KEY) else {
        return Ok(Vec::new());
    };
    let plain = |name: &str| name.bytes().all(|b| b.is_ascii_alphanumeric() || matches!(b, b'-' | b'.'));
    let parse = |entry: &str| {
        let (mesh, name) = entry.split_once(':')?;
        plain(name).then_some((mesh.parse().ok()?, name.to_owned()))
    };
    let files: Option<Vec<(usize, String)>> = text.split(',').map(parse).collect();
    files.ok_or_else(|| damaged(&archive, DETAIL_KEY, format!("expected mesh:file, got {text:.80}")))
}

/// What the provenance calls the archives of chunks.
pub const DETAIL_KEY: &str = "detail";

fn damaged(archive: &Archive, place: &str, problem: impl Into<String>) -> Error {
    Error::Damaged { file: archive.file().to_owned(), place: place.into(), problem: problem.into() }
}

/// Errors unless an array has as many entries as its fellows.
fn same_length<T>(archive: &Archive, name: &str, array: &[T], expected: usize) -> Result<()> {
    if array.len() == expected {
        return Ok(());
    }
    Err(damaged(archive, name, format!("expected {expected} entries, got {}", array.len())))
}

fn open(job: &Path, kind: &str) -> Result<Archive> {
    let archive = Archive::open(job.join(format!("{kind}.glow")))?;
    archive.expect_kind(Tag::new(kind))?;
    Ok(archive)
}

fn write_scene(w: &mut Writer, model: &Model, _: &Packed) -> Result<()> {
    let scene = &model.scene;
    let (tables, attributes) = record::record(scene);
    let tables = record::to_bytes(&tables)?;
    let triangles = 0..scene.triangles.len() as u64;
    w.append(tag("tables"), 0..1, &tables)?;
    w.append(tag("vertices"), 0..scene.vertices.len() as u64, &scene.vertices)?;
    w.append(tag("corners"), triangles.clone(), &scene.triangles)?;
    w.append(tag("attribs"), 0..attributes.len() as u64, &attributes)?;
    w.append(tag("branches"), triangles.clone(), model.bvh.view().branches())?;
    w.append(tag("packets"), triangles, model.bvh.view().packets())?;
    Ok(())
}

pub(super) fn read_scene(job: &Path) -> Result<(Scene, Bvh)> {
    let archive = open(job, "scene")?;
    let mut aligned = rkyv::util::AlignedVec::<16>::new();
    aligned.extend_from_slice(archive.array::<u8>(tag("tables"))?);
    let tables: SceneRecord = rkyv::from_bytes::<SceneRecord, rkyv::rancor::BoxedError>(&aligned)
        .map_err(|e| damaged(&archive, "tables", e.to_string()))?;
    let scene = tables
        .restore(
            archive.array(tag("vertices"))?,
            archive.array(tag("corners"))?,
            archive.array(tag("attribs"))?,
        )
        .map_err(|problem| damaged(&archive, "tables", problem))?;
    let bvh = Bvh::from_slices(archive.array(tag("branches"))?, archive.array(tag("packets"))?)
        .map_err(|problem| damaged(&archive, "branches", problem.to_string()))?;
    archive.confirm(|_| true)?;
    Ok((scene, bvh))
}

fn write_sites(w: &mut Writer, model: &Model, _: &Packed) -> Result<()> {
    let a = &model.sites.to_arrays();
    let all = 0..a.positions.len() as u64;
    w.append(tag("position"), all.clone(), &a.positions)?;
    w.append(tag("normal"), all.clone(), &a.normals)?;
    w.append(tag("area"), all.clone(), &a.areas)?;
    w.append(tag("triangle"), all.clone(), &a.triangles)?;
    w.append(tag("barycent"), all.clone(), &a.barycentrics)?;
    w.append(tag("level"), all.clone(), &a.levels)?;
    w.append(tag("spacing"), all.clone(), &a.spacings)?;
    let plots: Vec<[u32; 7]> = model.plots.iter().map(Plot::to_words).collect();
    w.append(tag("plot"), 0..plots.len() as u64, &plots)?;
    let (offsets, neighbours, unclean) = model.graph.to_arrays();
    w.append(tag("graph_at"), all.clone(), offsets)?;
    w.append(tag("graph_to"), all.clone(), neighbours)?;
    w.append(tag("unclean"), all.clone(), &unclean)?;
    w.append(tag("albedo"), all.clone(), &model.albedo)?;
    w.append(tag("exitance"), all, &model.exitance)?;
    Ok(())
}

pub(super) fn read_sites(job: &Path) -> Result<(Sites, Neighbours, Vec<Plot>)> {
    let archive = open(job, "sites")?;
    let positions: &[Vec3] = archive.array(tag("position"))?;
    let n = positions.len();
    let arrays = SiteArrays {
        positions: positions.to_vec(),
        normals: archive.array(tag("normal"))?.to_vec(),
        areas: archive.array(tag("area"))?.to_vec(),
        triangles: archive.array(tag("triangle"))?.to_vec(),
        barycentrics: archive.array(tag("barycent"))?.to_vec(),
        levels: archive.array(tag("level"))?.to_vec(),
        spacings: archive.array(tag("spacing"))?.to_vec(),
    };
    same_length(&archive, "normal", &arrays.normals, n)?;
    same_length(&archive, "area", &arrays.areas, n)?;
    same_length(&archive, "triangle", &arrays.triangles, n)?;
    same_length(&archive, "barycent", &arrays.barycentrics, n)?;
    same_length(&archive, "level", &arrays.levels, n)?;
    let graph = Neighbours::from_arrays(
        archive.array(tag("graph_at"))?.to_vec(),
        archive.array(tag("graph_to"))?.to_vec(),
        archive.array::<u8>(tag("unclean"))?,
    );
    let plots = archive.array::<[u32; 7]>(tag("plot"))?.iter().map(Plot::from_words).collect();
    archive.confirm(|_| true)?;
    Ok((Sites::from_arrays(arrays), graph, plots))
}

fn read_materials(job: &Path, sites: &Sites) -> Result<(Vec<Vec3>, Vec<Vec3>)> {
    let archive = open(job, "sites")?;
    let (albedo, exitance) = (archive.array::<Vec3>(tag("albedo"))?, archive.array::<Vec3>(tag("exitance"))?);
    same_length(&archive, "albedo", albedo, sites.len())?;
    same_length(&archive, "exitance", exitance, sites.len())?;
    let materials = (albedo.to_vec(), exitance.to_vec());
    archive.confirm(|_| true)?;
    Ok(materials)
}

fn write_links(w: &mut Writer, model: &Model, packed: &Packed) -> Result<()> {
    let sites = 0..model.sites.len() as u64;
    write_lamp_links(w, &model.direct)?;
    rows::write(w, model, packed)?;
    w.append(tag("fit_at"), sites.clone(), &model.spread.offsets)?;
    w.append(tag("fit_to"), sites.clone(), &model.spread.receivers)?;
    w.append(tag("fit_by"), sites, &model.spread.weights)?;
    write_basis(w, model.basis())
}

/// The basis by its place in [`Basis::ALL`]; nothing for the default, as before there was a choice.
fn write_basis(w: &mut Writer, basis: Basis) -> Result<()> {
    let number = Basis::ALL.iter().position(|b| *b == basis).unwrap_or_default() as u32;
    if number > 0 { w.append(tag("basis"), 0..1, &[number]) } else { Ok(()) }
}

fn read_basis(archive: &Archive) -> Result<Basis> {
    if archive.blocks(tag("basis")).next().is_none() {
        return Ok(Basis::default());
    }
    let number: &[u32] = archive.array(tag("basis"))?;
    let known = number.first().and_then(|&n| Basis::ALL.get(n as usize));
    known.copied().ok_or_else(|| damaged(archive, "basis", format!("expected a known basis, got {number:?}")))
}

fn write_lamp_links(w: &mut Writer, direct: &Direct) -> Result<()> {
    let (sites, links) = (0..direct.offsets.len() as u64, 0..direct.links.len() as u64);
    let (clusters, factors): (Vec<u32>, Vec<[f32; 2]>) = direct.links.iter().map(LampLink::to_words).unzip();
    w.append(tag("lamp_at"), sites, &direct.offsets)?;
    w.append(tag("lamp_to"), links.clone(), &clusters)?;
    w.append(tag("lamp_by"), links, &factors)?;
    Ok(())
}

fn read_lamp_links(archive: &Archive, sites: &Sites, (scene, lamps): (&Scene, &[Lamp])) -> Result<Direct> {
    let tree = LampTree::new(lamps);
    let offsets = archive.array::<u32>(tag("lamp_at"))?.to_vec();
    let clusters: &[u32] = archive.array(tag("lamp_to"))?;
    let factors: &[[f32; 2]] = archive.array(tag("lamp_by"))?;
    same_length(archive, "lamp_at", &offsets, sites.len() + 1)?;
    same_length(archive, "lamp_by", factors, clusters.len())?;
    if !offsets.is_sorted() || offsets.last() != Some(&(clusters.len() as u32)) {
        return Err(damaged(archive, "lamp_at", "offsets out of range"));
    }
    let links: Vec<LampLink> = clusters.iter().zip(factors).map(LampLink::from_words).collect();
    if links.iter().any(|link| link.cluster as usize >= tree.clusters.len()) {
        let problem = format!("expected clusters below {}", tree.clusters.len());
        return Err(damaged(archive, "lamp_to", problem));
    }
    Ok(Direct::from_links(scene, lamps, (offsets, links)))
}

fn read_links(
    job: &Path,
    (sites, purpose): (&Sites, Purpose),
    lit: (&Scene, &[Lamp]),
) -> Result<(Direct, Receivers, Spread)> {
    let archive = open(job, "links")?;
    let direct = read_lamp_links(&archive, sites, lit)?;
    let spread = Spread {
        offsets: archive.array(tag("fit_at"))?.to_vec(),
        receivers: archive.array(tag("fit_to"))?.to_vec(),
        weights: archive.array(tag("fit_by"))?.to_vec(),
        rays: 0,
        basis: read_basis(&archive)?,
    };
    same_length(&archive, "fit_at", &spread.offsets, sites.len() + 1)?;
    same_length(&archive, "fit_by", &spread.weights, spread.receivers.len())?;
    let receivers = rows::read(&archive, sites, purpose)?;
    let ascends =
        spread.offsets.is_sorted() && spread.offsets.last() == Some(&(spread.receivers.len() as u32));
    if !ascends || spread.receivers.iter().any(|&r| r as usize >= receivers.len()) {
        return Err(damaged(&archive, "fit_at", "offsets or receivers out of range"));
    }
    // Rows that stay in the file are not copied: reading them twice would double the cost of a large job's answers.
    archive.confirm(|block| purpose == Purpose::Light || (block != tag("rows") && block != tag("order")))?;
    Ok((direct, receivers, spread))
}

fn write_light(w: &mut Writer, model: &Model, _: &Packed) -> Result<()> {
    let s = &model.solution;
    let receivers = 0..model.receivers.len() as u64;
    let gradient: Vec<[f32; 9]> = s.gradient.iter().map(Mat3::to_cols_array).collect();
    w.append(tag("irradian"), receivers.clone(), &s.irradiance)?;
    w.append(tag("gradient"), receivers.clone(), &gradient)?;
    w.append(tag("sky_seen"), receivers.clone(), &s.sky_visibility)?;
    w.append(tag("surplus"), receivers.clone(), &s.surplus)?;
    w.append(tag("noise"), receivers, &s.noise)?;
    let FieldParams { direct, rays, most_rays, noise, doubt } = model.field;
    let seed = [direct.seed as u32, (direct.seed >> 32) as u32];
    w.append(tag("level"), 0..1, &[s.level, doubt, noise])?;
    let field = [direct.first, direct.penumbra, seed[0], seed[1], rays, most_rays];
    w.append(tag("field"), 0..1, &field)?;
    w.append(tag("radiosit"), 0..s.radiosity.len() as u64, &s.radiosity)?;
    Ok(())
}

fn read_light(job: &Path, receivers: &Receivers, sites: &Sites) -> Result<(Solution, FieldParams)> {
    let archive = open(job, "light")?;
    let gradient: &[[f32; 9]] = archive.array(tag("gradient"))?;
    let &[level, doubt, noise] = archive.array::<f32>(tag("level"))? else {
        return Err(damaged(&archive, "level", "expected three entries"));
    };
    let &[first, penumbra, low, high, rays, most_rays] = archive.array::<u32>(tag("field"))? else {
        return Err(damaged(&archive, "field", "expected six entries"));
    };
    let seed = u64::from(high) << 32 | u64::from(low);
    let direct = DirectParams { first, penumbra, seed };
    let field = FieldParams { direct, rays, most_rays, noise, doubt };
    let solution = Solution {
        irradiance: archive.array(tag("irradian"))?.to_vec(),
        gradient: gradient.iter().map(Mat3::from_cols_array).collect(),
        sky_visibility: archive.array(tag("sky_seen"))?.to_vec(),
        surplus: archive.array(tag("surplus"))?.to_vec(),
        noise: archive.array(tag("noise"))?.to_vec(),
        radiosity: archive.array(tag("radiosit"))?.to_vec(),
        level,
    };
    same_length(&archive, "irradian", &solution.irradiance, receivers.len())?;
    same_length(&archive, "gradient", &solution.gradient, receivers.len())?;
    same_length(&archive, "sky_seen", &solution.sky_visibility, receivers.len())?;
    same_length(&archive, "surplus", &solution.surplus, receivers.len())?;
    same_length(&archive, "noise", &solution.noise, receivers.len())?;
    same_length(&archive, "radiosit", &solution.radiosity, sites.len())?;
    archive.confirm(|_| true)?;
    Ok((solution, field))
}
