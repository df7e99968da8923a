//! Meshes that stay in their files: cut into chunks that the job keeps, with proxies in the scene.
//!
//! An archive of chunks is named by what it was made from, so that a run that was ended goes on with it, one of the same
//! mesh under other lights finds it, and one of a changed mesh lets it lie.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::archive::{Digest, Digests, Pause, Storage};
use crate::bake::report::progress::{Monitor, Stage};
use crate::bake::report::summary::StageTime;
use crate::detail::{self, CutParams, Detail, Shards};
use crate::error::{Error, Result};
use crate::scene::Scene;
use crate::scene::assemble::{Contents, Part};
use crate::scene::ply::stream::Stream;

/// Numbers of streamed meshes in the scene, each with its chunks.
pub type Details = Vec<(usize, Arc<Detail>)>;

/// A scene in which proxies stand for what is streamed.
pub struct Streamed {
    /// The scene.
    pub scene: Scene,
    /// What the proxies stand for.
    pub details: Details,
    /// Names of the archives in the job.
    pub names: Vec<String>,
    /// What it took.
    pub stages: Vec<StageTime>,
}

/// Triangles of all proxies at a target of 3 %, about; finer targets want finer ones.
const PROXY_TRIANGLES: f64 = 600_000.0;

/// Where proxies' sizes end.
const PROXY_RANGE: (f64, f64) = (200_000.0, 2_000_000.0);

/// How a mesh is cut for an error target.
pub fn cut_params(error: f64) -> CutParams {
    let proxy = (PROXY_TRIANGLES * 0.03 / error).clamp(PROXY_RANGE.0, PROXY_RANGE.1);
    CutParams { proxy_triangles: proxy as usize, ..CutParams::default() }
}

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
}

/// A streamed mesh on its way.
struct Making {
    /// Its part of the scene.
    part: usize,
    file: PathBuf,
    content: Digest,
    source: Source,
}

/// What is there of a mesh's chunks.
enum Source {
    Finished(Box<Detail>),
    Cut(Box<(Stream, Shards)>),
}

impl Workshop<'_> {
    /// Goes through the files that are too large for memory and makes the scene.
    ///
    /// # Errors
    /// Those of reading the meshes, naming file and row; [`Error::DiskFull`], [`Error::Io`]; the pause's.
    pub fn stream(&self, mut contents: Contents, scene_path: &Path) -> Result<Streamed> {
        let mut stages = Vec::new();
        let stage = Stage::start(self.monitor, "cut", "triangles", None);
        let parts: Vec<usize> =
            (0..contents.parts.len()).filter(|&k| contents.parts[k].streamed.is_some()).collect();
        let mut makings = Vec::with_capacity(parts.len());
        for part in parts {
            let making = self.begin(&contents.parts[part], part, scene_path)?;
            if let Source::Cut(cut) = &making.source {
                stage.advance(cut.1.triangles())?;
            }
            makings.push(making);
        }
        let mut placement = None;
        // Whether the chunks that are there lie in the scene's frame is known when all bounds are.
        while placement.is_none() {
            for making in &makings {
                if let Some(streamed) = &mut contents.parts[making.part].streamed {
                    streamed.bounds = making.source.bounds();
                }
            }
            let wanted = contents.placement(scene_path)?;
            for making in &mut makings {
                if matches!(&making.source, Source::Finished(detail) if detail.placement() != wanted) {
                    making.source = self.cut(&contents.parts[making.part], &making.file)?;
                }
            }
            placement = Some(wanted);
        }
        stages.push(stage.finish());
        let placement = placement.unwrap_or(contents.placement(scene_path)?);
        let stage = Stage::start(self.monitor, "chunks", "triangles", None);
        let (mut details, mut names) = (Details::new(), Vec::new());
        for Making { part, content, source, .. } in makings {
            let name = format!("detail-{:.16}.glow", content.to_string());
            let detail = match source {
                Source::Finished(detail) => *detail,
                Source::Cut(cut) => {
                    let (stream, shards) = *cut;
                    contents.warnings.extend(stream.warnings().iter().cloned());
                    contents.warnings.extend(shards.notes().warnings(&stream));
                    let frame = [placement.origin.x, placement.origin.y, placement.origin.z, placement.scale];
                    let options = Digest::of_bytes(bytemuck::cast_slice(&frame));
                    let digests = Digests { inputs: content, options };
                    let path = self.job.join(&name);
                    let advance = |triangles| {
                        // Who asks to stop is heard by the pause.
                        let _ = stage.advance(triangles);
                    };
                    let made = (&stream, &shards, &placement);
                    detail::write(self.storage, &path, digests, made, self.pause, advance)?;
                    Detail::open(&path, Some(digests))?
                }
            };
            stand_in(&mut contents.parts[part], detail.proxy()?);
            details.push((part, Arc::new(detail)));
            names.push(name);
        }
        let scratch = self.scratch();
        if scratch.exists() {
            std::fs::remove_dir_all(&scratch).map_err(|e| Error::io(&scratch, "removing", e))?;
        }
        stages.push(stage.finish());
        let scene = contents.into_scene(scene_path)?;
        Ok(Streamed { scene, details, names, stages })
    }

    fn scratch(&self) -> PathBuf {
        self.job.join("scratch")
    }

    fn begin(&self, part: &Part, number: usize, scene_path: &Path) -> Result<Making> {
        let file =
            if part.file.as_os_str().is_empty() { scene_path.to_path_buf() } else { part.file.clone() };
        let transform = part.streamed.unwrap_or_default().transform.to_cols_array();
        let params = [self.params.chunk_triangles as u64, self.params.proxy_triangles as u64];
        let content = Digest::of_digests(&[
            Digest::of_file(&file)?,
            Digest::of_bytes(bytemuck::cast_slice(&transform)),
            Digest::of_bytes(bytemuck::cast_slice(&params)),
        ]);
        let path = self.job.join(format!("detail-{:.16}.glow", content.to_string()));
        let source = match Detail::open(&path, None) {
            Ok(detail) if detail.archive().digests().inputs == content => Source::Finished(Box::new(detail)),
            _ => self.cut(part, &file)?,
        };
        Ok(Making { part: number, file, content, source })
    }

    fn cut(&self, part: &Part, file: &Path) -> Result<Source> {
        let scratch = self.scratch().join(Digest::of_bytes(file.as_os_str().as_encoded_bytes()).to_string());
        std::fs::create_dir_all(&scratch).map_err(|e| Error::io(&scratch, "creating", e))?;
        let stream = Stream::open(file, &scratch)?;
        let transform = part.streamed.unwrap_or_default().transform;
        let shards = Shards::make(&stream, &transform, &self.params, &scratch, self.pause)?;
        Ok(Source::Cut(Box::new((stream, shards))))
    }
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
pub fn share(names: &[String], from: &Path, to: &Path) -> Result<()> {
    for name in names {
        let (there, here) = (from.join(name), to.join(name));
        if here.exists() || there == here {
            continue;
        }
        if std::fs::hard_link(&there, &here).is_err() {
            std::fs::copy(&there, &here).map_err(|e| Error::io(&here, "copying the chunks", e))?;
        }
    }
    Ok(())
}

/// Opens the chunks of a finished job.
pub fn open(job: &Path, names: &[(usize, String)]) -> Result<Details> {
    let open = |(mesh, name): &(usize, String)| Ok((*mesh, Arc::new(Detail::open(&job.join(name), None)?)));
    names.iter().map(open).collect()
}
