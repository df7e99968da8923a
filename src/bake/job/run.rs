//! A bake from the command to the finished job: what is there is reused, what is not is made.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Serialize;

use super::journal::{self, Work};
use super::streams::{self, Details, Streamed, Workshop};
use super::{Budget, Change, INPUTS_FILE, Inputs, Lock, OPTIONS_FILE, REPLACED_FILE, relit, side};
use crate::archive::{Digest, Digests, Disk, Ledger, Storage};
use crate::bake::model::Model;
use crate::bake::options::Options;
use crate::bake::pictures;
use crate::bake::pipeline::{self, PipelineReport, Stand, Target};
use crate::bake::report::progress::{Monitor, Stage};
use crate::bake::report::summary::{SUMMARY_FILE, StageTime, Summary};
use crate::bake::report::usage::Meter;
use crate::bake::store::{self, Shelf};
use crate::bake::transfer;
use crate::error::{Error, Result};
use crate::output::file::TEMPORARY;
use crate::scene::{self, Scene};

/// Bakes a scene into a job directory, goes on where an earlier run was interrupted, or finds that nothing is left to do.
///
/// Deterministic: the job's archives and pictures are the same bytes for any number of threads and interruptions.
///
/// # Errors
/// [`Error::JobDiffers`] when the directory holds a job of other options or geometry, [`Error::JobLocked`] when another
/// process works on it, [`Error::Interrupted`] with all that is done kept; every error of reading the scene and of
/// writing the job.
pub fn run(scene_path: &Path, job: &Path, options: &Options, monitor: &dyn Monitor) -> Result<Summary> {
    let storage: Arc<dyn Storage> = Arc::new(Disk);
    run_in(&storage, (scene_path, job), options, monitor)
}

/// As [`run`], on another storage.
///
/// # Errors
/// As [`run`].
pub fn run_in(
    storage: &Arc<dyn Storage>,
    (scene_path, job): (&Path, &Path),
    options: &Options,
    monitor: &dyn Monitor,
) -> Result<Summary> {
    let meter = Meter::start();
    let budget = Budget::new(options.max_memory_bytes);
    let bake = Bake { storage, scene_path, options, monitor, meter: &meter, budget };
    let fresh = !job.exists();
    let outcome = bake.run(job);
    if fresh && outcome.is_err() {
        // A folder in which nothing was begun goes again; one that holds anything stays.
        let _ = fs::remove_dir(job);
    }
    outcome
}

/// What a job's archives carry: digests of the scene's content, and of the options and the program that made them.
///
/// # Errors
/// [`Error::Usage`] for options that cannot be recorded.
pub fn digests(inputs: &Inputs, options: &Options) -> Result<Digests> {
    Ok(Digests { inputs: inputs.digest()?, options: options_digest(options)? })
}

/// The digest of options and of the program that goes by them.
///
/// # Errors
/// [`Error::Usage`] for options that cannot be recorded.
pub fn options_digest(options: &Options) -> Result<Digest> {
    Digest::of_options(&(options, env!("CARGO_PKG_VERSION")))
}

/// What has changed since a job was begun and what a bake of the same scene would do again, in words; None when nothing has.
///
/// Cost: reads the scene if one of its files is younger than the job's record of them.
///
/// # Errors
/// Those of reading the job's side files and the scene.
pub fn standing(job: &Path) -> Result<Option<String>> {
    let record = job.join(INPUTS_FILE);
    let Some(inputs) = side::read::<Inputs>(&record)? else { return Ok(None) };
    let Some((scene_path, _)) = inputs.files.first() else { return Ok(None) };
    if let Some((gone, _)) = inputs.files.iter().find(|(file, _)| !file.exists()) {
        return Ok(Some(format!("{} is gone: the job answers, but cannot be baked again", gone.display())));
    }
    let written = |path: &Path| fs::metadata(path).and_then(|meta| meta.modified()).ok();
    let recorded = written(&record);
    if inputs.files.iter().all(|(file, _)| written(file) <= recorded) {
        return Ok(None);
    }
    if !inputs.streamed.is_empty() {
        return Ok(Some("a file is younger than the job; a bake tells whether it differs".to_owned()));
    }
    let now = Inputs::of(scene_path, &scene::load(scene_path)?, &Streamed::default())?;
    Ok(match inputs.change(&now) {
        Change::Nothing => None,
        Change::Light(what) => {
            Some(format!("{what}: lights or albedos; a bake finds the light anew and keeps R"))
        }
        Change::Geometry(what) => {
            Some(format!("{what}: geometry; a bake needs --restart and does all again"))
        }
    })
}

/// What a job that is not finished has done so far.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Unfinished {
    /// What it was asked.
    pub options: Options,
    /// The ledgers that hold what is done, by name.
    pub ledgers: Vec<String>,
    /// Bytes in them.
    pub work_bytes: u64,
}

/// How far an unfinished job came; None where there is none, or it is finished.
///
/// # Errors
/// Those of reading the job's side files.
pub fn unfinished(job: &Path) -> Result<Option<Unfinished>> {
    if job.join(SUMMARY_FILE).exists() {
        return Ok(None);
    }
    let Some(options) = side::read::<Options>(&job.join(OPTIONS_FILE))? else { return Ok(None) };
    let mut found = Unfinished { options, ledgers: Vec::new(), work_bytes: 0 };
    let folder = job.join(super::WORK_FOLDER);
    for entry in fs::read_dir(&folder).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        found.ledgers.extend(name.strip_suffix(".partial").map(str::to_owned));
        found.work_bytes += entry.metadata().map_or(0, |meta| meta.len());
    }
    found.ledgers.sort();
    Ok(Some(found))
}

/// What one command was asked, and who watches.
struct Bake<'a> {
    storage: &'a Arc<dyn Storage>,
    scene_path: &'a Path,
    options: &'a Options,
    monitor: &'a dyn Monitor,
    meter: &'a Meter,
    budget: Budget,
}

/// A scene that was read for this run.
struct Subject {
    scene: Scene,
    details: Details,
    inputs: Inputs,
    stages: Vec<StageTime>,
}

impl Bake<'_> {
    fn run(&self, job: &Path) -> Result<Summary> {
        let made = side::make_directory(self.storage, job);
        made.map_err(|e| Error::io(job, "making the job directory", e))?;
        let mut lock = Lock::take(job, self.monitor)?;
        if self.options.restart && job.join(OPTIONS_FILE).exists() {
            let subject = self.subject(job, None)?;
            let kept = self.kept_geometry(job, &subject.inputs).then_some(job);
            return self.replace(job, &mut lock, subject, kept);
        }
        let stored = side::read::<Options>(&job.join(OPTIONS_FILE))?;
        let differs = |difference| Error::JobDiffers { job: job.into(), difference };
        if let Some(difference) = stored.and_then(|stored| self.options.difference(&stored)) {
            return Err(differs(difference));
        }
        let before = side::read::<Inputs>(&job.join(INPUTS_FILE))?;
        let subject = self.subject(job, before.as_ref())?;
        // Files that were lost are made again.
        let finished = job.join(SUMMARY_FILE).exists() && store::is_complete(job);
        match before.map_or(Change::Nothing, |before| before.change(&subject.inputs)) {
            Change::Geometry(what) => Err(differs(what)),
            Change::Light(what) if finished => {
                self.monitor.note(&format!(
                    "{what}: lights or albedos; sites and rows stay, the light is found anew"
                ));
                self.replace(job, &mut lock, subject, Some(job))
            }
            Change::Nothing if finished => self.again(job, self.options.is_relightable(&subject.scene)),
            change => {
                if let Change::Light(what) = change {
                    self.monitor.note(&format!("{what}: lights or albedos; the unfinished bake begins anew"));
                }
                self.bake(job, subject, None)
            }
        }
    }

    /// Whether a new job may take R over from the finished one: the geometry is the same, and of the options only how many
    /// bounces are followed differs. Where nothing differs all is asked for anew.
    fn kept_geometry(&self, job: &Path, now: &Inputs) -> bool {
        let Ok(Some(stored)) = side::read::<Options>(&job.join(OPTIONS_FILE)) else { return false };
        let Ok(Some(before)) = side::read::<Inputs>(&job.join(INPUTS_FILE)) else { return false };
        let bounces = Options { max_bounces: self.options.max_bounces, ..stored.clone() };
        let only_bounces = stored.max_bounces != self.options.max_bounces;
        let change = before.change(now);
        job.join(SUMMARY_FILE).exists()
            && self.options.difference(&bounces).is_none()
            && (only_bounces && change == Change::Nothing || matches!(change, Change::Light(_)))
    }

    /// Reads the scene; what is too large for memory is cut into chunks that go into the job's directory, unless the job was
    /// begun with others.
    fn subject(&self, job: &Path, before: Option<&Inputs>) -> Result<Subject> {
        let stage = Stage::start(self.monitor, "scene", "files", None);
        let contents = scene::draft(self.scene_path, self.options.resident())?;
        let pause = || {
            self.monitor.check()?;
            self.budget.check(self.meter)
        };
        let (scene, streamed) = if contents.parts.iter().any(|part| part.streamed.is_some()) {
            let params = streams::cut_params(self.options.error, self.options.proxy);
            let (storage, monitor) = (self.storage, self.monitor);
            let recorded = before.map(|before| before.streamed.as_slice());
            let workshop = Workshop { storage, job, pause: &pause, monitor, params, recorded };
            workshop.stream(contents, self.scene_path)?
        } else {
            (contents.into_scene(self.scene_path)?, Streamed::default())
        };
        for warning in &scene.warnings {
            self.monitor.warn(&format!("{}: {}", warning.file.display(), warning.message));
        }
        let inputs = Inputs::of(self.scene_path, &scene, &streamed)?;
        let Streamed { details, mut stages, .. } = streamed;
        stage.advance(inputs.files.len() as u64)?;
        self.budget.check(self.meter)?;
        let read = stage.finish();
        let inner: f64 = stages.iter().map(|s| s.seconds).sum();
        let inner_cpu: f64 = stages.iter().map(|s| s.cpu_seconds).sum();
        let (seconds, cpu_seconds) =
            ((read.seconds - inner).max(0.0), (read.cpu_seconds - inner_cpu).max(0.0));
        stages.insert(0, StageTime { seconds, cpu_seconds, ..read });
        Ok(Subject { scene, details, inputs, stages })
    }

    /// Transfers of a job's lights, made of its archives.
    fn transfers(&self, job: &Path) -> Result<StageTime> {
        let pause = || {
            self.monitor.check()?;
            self.budget.check(self.meter)
        };
        transfer::store_in((self.storage, job), self.monitor, &pause)
    }

    /// A job that is finished and was asked the same: at most its pictures and transfers are missing.
    fn again(&self, job: &Path, relightable: bool) -> Result<Summary> {
        let mut summary = Summary::read(job)?;
        (summary.resumed_blocks, summary.computed_blocks) =
            (summary.computed_blocks + summary.resumed_blocks, 0);
        if self.options.preview && !pictures::present(job) {
            let model = store::read(job, store::Purpose::Answers)?;
            let pause = || self.monitor.check();
            summary.stages.extend(pictures::write(
                (self.storage, job),
                &model,
                (self.monitor, &Ledger::idle(&pause)),
            )?);
            summary.usage = self.meter.usage();
        }
        if relightable && !job.join(transfer::FILE).is_file() {
            summary.stages.push(self.transfers(job)?);
            summary.usage = self.meter.usage();
        }
        journal::clear(self.storage, job)?;
        Ok(summary)
    }

    /// Bakes into a directory beside the job, which takes the job's place when it is finished. With `old`, that job's R is
    /// taken over.
    fn replace(&self, job: &Path, lock: &mut Lock, subject: Subject, old: Option<&Path>) -> Result<Summary> {
        let beside = beside(job, old)?;
        let failed = |action: &'static str| move |e| Error::io(job, action, e);
        if beside.join(REPLACED_FILE).exists() {
            // An earlier run was ended between the exchange and the removal.
            self.storage.remove_directory(&beside).map_err(failed("removing what it replaced"))?;
        }
        side::make_directory(self.storage, &beside).map_err(failed("making a directory beside it"))?;
        streams::share(self.storage, &subject.inputs.streamed, job, &beside)?;
        let mut lock_beside = Lock::take(&beside, self.monitor)?;
        let summary = match self.answered(&beside, &subject.inputs)? {
            // An earlier run was ended just before the exchange.
            Some(summary) => summary,
            None => self.bake(&beside, subject, old)?,
        };
        side::mark(self.storage, &job.join(REPLACED_FILE)).map_err(failed("marking it as replaced"))?;
        self.storage.exchange(job, &beside).map_err(failed("putting the new job in its place"))?;
        lock.moved(&beside);
        lock_beside.moved(job);
        // Before anything of the old job goes: else a power loss may take its files and give it its name back.
        side::sync_name(self.storage, job).map_err(failed("making the new job's place durable"))?;
        self.storage.remove_directory(&beside).map_err(failed("removing what it replaces"))?;
        Ok(summary)
    }

    /// The summary of a finished job that was asked just this.
    fn answered(&self, job: &Path, now: &Inputs) -> Result<Option<Summary>> {
        let finished = job.join(SUMMARY_FILE).exists() && store::is_complete(job);
        let pictured = !self.options.preview || pictures::present(job);
        let same = finished && pictured && self.is_recorded(job, now);
        if same { Summary::read(job).map(Some) } else { Ok(None) }
    }

    /// Whether the job says that it was asked just this.
    fn is_recorded(&self, job: &Path, now: &Inputs) -> bool {
        let options = side::read::<Options>(&job.join(OPTIONS_FILE));
        let inputs = side::read::<Inputs>(&job.join(INPUTS_FILE));
        options.is_ok_and(|options| options.as_ref().is_some_and(|o| self.options.difference(o).is_none()))
            && inputs.is_ok_and(|inputs| inputs.is_some_and(|before| before.change(now) == Change::Nothing))
    }

    fn bake(&self, job: &Path, subject: Subject, old: Option<&Path>) -> Result<Summary> {
        let Subject { scene, details, inputs, mut stages } = subject;
        let digests = digests(&inputs, self.options)?;
        sweep(job);
        streams::sweep(job, &inputs.streamed);
        self.record(job, &inputs)?;
        let pause = || {
            self.monitor.check()?;
            self.budget.check(self.meter)
        };
        let work = Work::resume(self.storage, job, digests, (&pause, self.monitor))?;
        let counts = counts(&scene, &details);
        let chunks: Vec<String> =
            details.iter().zip(&inputs.streamed).map(|((mesh, _), name)| format!("{mesh}:{name}")).collect();
        let (model, report) = self.model((scene, details), old, &work, &mut stages)?;
        let stage = Stage::start(self.monitor, "store", "bytes", None);
        let ledger = work.ledger("store")?;
        let asked = serde_json::to_string(self.options).unwrap_or_default();
        let chunks = chunks.join(",");
        let mut provenance = vec![("options", asked.as_str())];
        if !chunks.is_empty() {
            provenance.push((store::DETAIL_KEY, chunks.as_str()));
        }
        let shelf = Shelf { storage: self.storage, job, digests, ledger: &ledger, provenance: &provenance };
        let stored = store::write_to(&shelf, &model)?;
        self.monitor.disk(stored.archive_bytes);
        stages.extend(report.stages.iter().cloned());
        stages.push(stage.finish());
        if self.options.preview && !pictures::present(job) {
            stages.extend(pictures::write(
                (self.storage, job),
                &model,
                (self.monitor, &work.ledger("mesh")?),
            )?);
        }
        pause()?;
        let told = figures(&model, counts, &report, &stored);
        let relightable = self.options.is_relightable(&model.scene);
        // Transfers are made of what was written, so that they are the same after any interruption.
        drop(model);
        if relightable {
            stages.push(self.transfers(job)?);
        }
        let summary = Summary {
            usage: self.meter.usage(),
            stages,
            resumed_blocks: work.counts().resumed(),
            computed_blocks: work.counts().computed() + stored.blocks,
            ..told
        };
        side::write(self.storage, &job.join(SUMMARY_FILE), &summary)?;
        drop(ledger);
        drop(work);
        journal::clear(self.storage, job)?;
        Ok(summary)
    }

    /// From the scene, or from another job's R.
    fn model(
        &self,
        (scene, details): (Scene, Details),
        old: Option<&Path>,
        work: &Work<'_>,
        stages: &mut Vec<StageTime>,
    ) -> Result<(Model, PipelineReport)> {
        if let Some(old) = old {
            return relit::solve(old, scene, self.options, (self.monitor, &work.ledger("relit")?));
        }
        let Options { error, seed, basis, operator, .. } = *self.options;
        let bounces = self.options.max_bounces.map(|n| n as usize);
        let relightable = self.options.is_relightable(&scene);
        let target = Target { error, seed, bounces, basis, operator, relightable };
        self.budget.ask("the ray engine", Stand::bytes(&scene))?;
        let (stand, built) = Stand::new(scene, self.monitor)?;
        stages.push(built);
        let stand = stand.with_details(details);
        if let Some(near) = stand.bvh.near() {
            let stage = Stage::start(self.monitor, "check", "chunks", None);
            near.touch();
            stand.bvh.sound()?;
            stages.push(stage.finish());
        }
        let (model, _, report) = pipeline::reach_kept(stand, &target, self.monitor, work)?;
        Ok((model, report))
    }

    /// Writes down what was asked, unless the job says so already. What else lies there was then made of something else:
    /// archives carry digests that tell, pictures and figures do not and go.
    fn record(&self, job: &Path, inputs: &Inputs) -> Result<()> {
        if self.is_recorded(job, inputs) {
            return Ok(());
        }
        for name in [SUMMARY_FILE, pictures::MESH_FILE, pictures::PREVIEW_FILE] {
            let path = job.join(name);
            if path.exists() {
                self.storage
                    .remove(&path)
                    .map_err(|e| Error::io(path, "removing what was made before", e))?;
            }
        }
        side::write(self.storage, &job.join(OPTIONS_FILE), self.options)?;
        side::write(self.storage, &job.join(INPUTS_FILE), inputs)
    }
}

/// Removes files under temporary names that a killed run left: half a mesh may be large. The job is locked, so nobody writes
/// them; what cannot be removed does no harm.
fn sweep(job: &Path) {
    for entry in fs::read_dir(job).into_iter().flatten().flatten() {
        if entry.file_name().to_string_lossy().starts_with(TEMPORARY) {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// Where a job is made that is to replace another: for a new light by the R that it takes over, so that none is mistaken for
/// one of another R.
fn beside(job: &Path, old: Option<&Path>) -> Result<PathBuf> {
    let mut name = job.as_os_str().to_owned();
    name.push(match old {
        None => ".new".to_owned(),
        Some(old) => format!(".relit-{:.8}", store::links_content(old)?.to_string()),
    });
    Ok(PathBuf::from(name))
}

/// Triangles and vertices of the scene as its files have it.
fn counts(scene: &Scene, details: &Details) -> (u64, u64) {
    let mut counts = (scene.triangles.len() as u64, scene.vertices.len() as u64);
    for (mesh, detail) in details {
        let proxy = &scene.meshes[*mesh];
        counts.0 += detail.triangles() - proxy.triangles.len() as u64;
        counts.1 += detail.vertices() - proxy.vertices.len() as u64;
    }
    counts
}

/// The figures of a summary that the run itself has no part in.
fn figures(
    model: &Model,
    (triangles, vertices): (u64, u64),
    report: &PipelineReport,
    stored: &store::StoreReport,
) -> Summary {
    Summary {
        triangles,
        vertices,
        sites: model.sites.len() as u64,
        levels: model.sites.level_count() as u32,
        links: stored.links,
        rays: report.rays,
        archive_bytes: stored.archive_bytes,
        bytes_per_link: stored.row_bytes as f64 / stored.links.max(1) as f64,
        estimated_error: report.estimate.error,
        lights: report.lights.clone(),
        iterations: report.iterate.iterations as u32,
        residual: report.iterate.residual,
        converged: report.iterate.converged,
        ..Summary::default()
    }
}
