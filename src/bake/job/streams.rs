//! Meshes that stay in their files: cut into chunks that the job keeps, with proxies in the scene.
//!
//! An archive of chunks is named by what it was made from and by the frame that it lies in, so that a run that was ended goes
//! on with it, one of the same mesh under other lights finds it, and a mesh or a frame that has changed gets another.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::archive::{Digest, Digests, Pause, Storage};
use crate::bake::report::progress::{Monitor, Stage};
use crate::bake::report::summary::StageTime;
use crate::detail::{self, CutParams, Detail, Shards};
use crate::error::{Error, Result};
use crate::output::file::TEMPORARY;
use crate::scene::assemble::{Contents, Part};
use crate::scene::ply::stream::Stream;
use crate::scene::{Placement, Scene};

/// Numbers of streamed meshes in the scene, each with its chunks.
pub type Details = Vec<(usize, Arc<Detail>)>;

/// What proxies in a scene stand for.
#[derive(Default)]
pub struct Streamed {
    /// The chunks.
    pub details: Details,
    /// Names of their archives in the job.
    pub names: Vec<String>,
    /// Digests of the files, which were read for them already.
    pub files: Vec<(PathBuf, Digest)>,
    /// What it took.
    pub stages: Vec<StageTime>,
}

/// Triangles of all proxies at a target of 3 %, about; finer targets want finer ones.
const PROXY_TRIANGLES: f64 = 600_000.0;

/// Where proxies' sizes end.
const PROXY_RANGE: (f64, f64) = (200_000.0, 2_000_000.0);

/// How a mesh is cut for an error target, or to make a proxy of so many triangles.
pub fn cut_params(error: f64, proxy: Option<u64>) -> CutParams {
    let by_error = (PROXY_TRIANGLES * 0.03 / error).clamp(PROXY_RANGE.0, PROXY_RANGE.1);
    CutParams { proxy_triangles: proxy.map_or(by_error as usize, |n| n as usize), ..CutParams::default() }
}

/// What names of archives of chunks begin with.
pub const PREFIX: &str = "detail-";

/// Where the chunks of a job are made, and who watches.
pub struct Workshop<'a> {
    /// What changes the disk.
    pub storage: &'a Arc<dyn Storage>,
    /// The job's directory.
    pub job: &'a Path,
    /// Asked between pieces of work.
    pub pause: Pause<'a>,
    /// Hears of stages.
    pub monitor: &'a dyn Monitor,
    /// How meshes are cut.
    pub params: CutParams,
    /// Archives that the job was begun with, if it was: a scene that wants others is another job's.
    pub recorded: Option<&'a [String]>,
}

/// A streamed mesh on its way.
struct Making {
    /// Its part of the scene.
    part: usize,
    /// Digest of the file, its transform and how it is cut.
    content: Digest,
    source: Source,
}

/// What is there of a mesh's chunks.
enum Source {
    /// All, though perhaps in the frame of another scene.
    Finished(Box<Detail>),
    Cut(Box<(Stream, Shards)>),
}

impl Workshop<'_> {
    /// Goes through the files that are too large for memory and makes the scene.
    ///
    /// # Errors
    /// Those of reading the meshes, naming file and row; [`Error::JobDiffers`] before anything is made when the job was begun
    /// with other meshes; [`Error::DiskFull`], [`Error::Io`]; the pause's.
    pub fn stream(&self, contents: Contents, scene_path: &Path) -> Result<(Scene, Streamed)> {
        let made = self.make(contents, scene_path);
        let scratch = self.scratch();
        // What a file that is refused was cut into is of no use to anybody.
        if matches!(made, Ok(_) | Err(Error::Input { .. })) && scratch.exists() {
            let removed = self.storage.remove_directory(&scratch);
            removed.map_err(|e| Error::io(scratch, "removing what chunks were made from", e))?;
        }
        made
    }

    fn make(&self, mut contents: Contents, scene_path: &Path) -> Result<(Scene, Streamed)> {
        let mut streamed = Streamed::default();
        let total = contents.parts.iter().filter_map(|part| part.streamed).map(|left| left.faces).sum();
        let stage = Stage::start(self.monitor, "cut", "triangles", Some(total));
        let mut makings = Vec::new();
        for (number, part) in contents.parts.iter_mut().enumerate() {
            if part.streamed.is_none() {
                continue;
            }
            let making = self.begin(part, number, scene_path, &mut streamed.files)?;
            if let Some(left) = &mut part.streamed {
                left.bounds = making.source.bounds();
            }
            makings.push(making);
        }
        // Only now is known which frame the chunks are wanted in.
        let placement = contents.placement(scene_path)?;
        for making in &mut makings {
            let name = name_in(making.content, &placement);
            if self.recorded.is_some_and(|recorded| !recorded.contains(&name)) {
                return Err(self.differs("another mesh gives the scene another extent".to_owned()));
            }
            if matches!(&making.source, Source::Finished(detail) if detail.placement() != placement) {
                making.source = match Detail::open(&self.job.join(&name), None) {
                    Ok(detail) => Source::Finished(Box::new(detail)),
                    Err(_) => self.cut(&contents.parts[making.part], scene_path, making.content)?,
                };
            }
            if let Source::Cut(cut) = &making.source {
                stage.advance(cut.1.triangles())?;
            }
            streamed.names.push(name);
        }
        streamed.stages.push(stage.finish());
        let stage = Stage::start(self.monitor, "chunks", "triangles", Some(total));
        for (making, name) in makings.into_iter().zip(&streamed.names) {
            let part = making.part;
            let detail = match making.source {
                Source::Finished(detail) => *detail,
                Source::Cut(cut) => {
                    contents.warnings.extend(cut.0.warnings().iter().cloned());
                    contents.warnings.extend(cut.1.notes().warnings(&cut.0));
                    self.build(&cut, making.content, (&self.job.join(name), &placement), &stage)?
                }
            };
            stand_in(&mut contents.parts[part], detail.proxy()?);
            streamed.details.push((part, Arc::new(detail)));
        }
        streamed.stages.push(stage.finish());
        Ok((contents.into_scene(scene_path)?, streamed))
    }

    fn scratch(&self) -> PathBuf {
        self.job.join("scratch")
    }

    fn differs(&self, difference: String) -> Error {
        Error::JobDiffers { job: self.job.into(), difference }
    }

    /// Finds what is there of a mesh's chunks, or cuts it.
    fn begin(
        &self,
        part: &Part,
        number: usize,
        scene_path: &Path,
        files: &mut Vec<(PathBuf, Digest)>,
    ) -> Result<Making> {
        let file = file_of(part, scene_path);
        let digest = match files.iter().find(|(known, _)| known == file) {
            Some((_, digest)) => *digest,
            None => Digest::of_file(file)?,
        };
        let transform = part.streamed.unwrap_or_default().transform.to_cols_array();
        let params = [self.params.chunk_triangles as u64, self.params.proxy_triangles as u64];
        let content = Digest::of_digests(&[
            digest,
            Digest::of_bytes(bytemuck::cast_slice(&transform)),
            Digest::of_bytes(bytemuck::cast_slice(&params)),
        ]);
        let stem = stem(content);
        if self.recorded.is_some_and(|recorded| !recorded.iter().any(|name| name.starts_with(&stem))) {
            return Err(self.differs(format!("{} or its transform has changed", file.display())));
        }
        files.push((file.to_owned(), digest));
        let source = match self.finished(content) {
            Some(detail) => Source::Finished(Box::new(detail)),
            None => self.cut(part, scene_path, content)?,
        };
        Ok(Making { part: number, content, source })
    }

    /// Chunks of just this mesh, in whichever frame.
    fn finished(&self, content: Digest) -> Option<Detail> {
        let stem = stem(content);
        let mut names: Vec<_> =
            std::fs::read_dir(self.job).into_iter().flatten().flatten().map(|entry| entry.path()).collect();
        names.sort();
        let named = |path: &PathBuf| {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            name.starts_with(&stem) && name.ends_with(SUFFIX)
        };
        let opened = names.iter().filter(|path| named(path)).filter_map(|path| Detail::open(path, None).ok());
        opened.into_iter().find(|detail| detail.archive().digests().inputs == content)
    }

    fn cut(&self, part: &Part, scene_path: &Path, content: Digest) -> Result<Source> {
        let scratch = self.scratch().join(content.to_string());
        std::fs::create_dir_all(&scratch).map_err(|e| Error::io(&scratch, "creating", e))?;
        let stream = Stream::open(file_of(part, scene_path), &scratch)?;
        let transform = part.streamed.unwrap_or_default().transform;
        let shards = Shards::make(&stream, &transform, &self.params, &scratch, self.pause)?;
        Ok(Source::Cut(Box::new((stream, shards))))
    }

    /// Makes the chunks of a mesh that was cut, or those that are missing.
    fn build(
        &self,
        (stream, shards): &(Stream, Shards),
        content: Digest,
        (path, placement): (&Path, &Placement),
        stage: &Stage<'_>,
    ) -> Result<Detail> {
        let digests = Digests { inputs: content, options: frame(placement) };
        let advance = |triangles| {
            // Who asks to stop is heard by the pause.
            let _ = stage.advance(triangles);
        };
        detail::write((self.storage, path), digests, (stream, shards, placement), self.pause, advance)?;
        Detail::open(path, Some(digests))
    }
}

/// What names of archives of chunks end with.
const SUFFIX: &str = ".glow";

/// How names of archives of a mesh's chunks begin.
fn stem(content: Digest) -> String {
    format!("{PREFIX}{:.16}-", content.to_string())
}

/// The name of the archive of a mesh's chunks in a frame.
fn name_in(content: Digest, placement: &Placement) -> String {
    format!("{}{:.8}{SUFFIX}", stem(content), frame(placement).to_string())
}

fn frame(placement: &Placement) -> Digest {
    let frame = [placement.origin.x, placement.origin.y, placement.origin.z, placement.scale];
    Digest::of_bytes(bytemuck::cast_slice(&frame))
}

/// The file that a part was read from.
fn file_of<'a>(part: &'a Part, scene_path: &'a Path) -> &'a Path {
    if part.file.as_os_str().is_empty() { scene_path } else { &part.file }
}

impl Source {
    fn bounds(&self) -> [glam::DVec3; 2] {
        match self {
            Self::Finished(detail) => detail.world_bounds(),
            Self::Cut(cut) => cut.1.bounds(),
        }
    }
}

/// Puts a proxy into the place of the mesh that it stands for.
fn stand_in(part: &mut Part, proxy: Part) {
    part.positions = proxy.positions;
    part.triangles = proxy.triangles;
    part.colours = proxy.colours;
}

/// Puts the archives of chunks that one job holds into another's directory: by a link where the system has them.
///
/// # Errors
/// [`Error::Io`]; the place is then as it was.
pub fn share(storage: &Arc<dyn Storage>, names: &[String], from: &Path, to: &Path) -> Result<()> {
    for name in names {
        let (there, here) = (from.join(name), to.join(name));
        if here.exists() || there == here || std::fs::hard_link(&there, &here).is_ok() {
            continue;
        }
        let whole = to.join(format!("{TEMPORARY}{name}"));
        let failed = |e| Error::io(&here, "copying the chunks", e);
        std::fs::copy(&there, &whole).map_err(failed)?;
        storage.rename(&whole, &here).map_err(failed)?;
    }
    Ok(())
}

/// Removes archives of chunks that a job has no use for, left by runs of other scenes; what cannot be removed does no harm.
pub fn sweep(job: &Path, names: &[String]) {
    for entry in std::fs::read_dir(job).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with(PREFIX) && !names.contains(&name) {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// Opens the chunks of a finished job.
pub fn open(job: &Path, names: &[(usize, String)]) -> Result<Details> {
    let open = |(mesh, name): &(usize, String)| Ok((*mesh, Arc::new(Detail::open(&job.join(name), None)?)));
    names.iter().map(open).collect()
}
