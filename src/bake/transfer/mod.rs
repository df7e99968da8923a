//! Transfers that a job holds: what each of its lights, and each harmonic of its sky, does everywhere. With them lights are added up
//! as soon as the job is open (`docs/format.md`, transfer).
//!
//! This work is based on: Sloan, Kautz and Snyder, "Precomputed Radiance Transfer", SIGGRAPH 2002.

pub mod codec;

use std::path::Path;
use std::sync::Arc;

use rayon::prelude::*;

use super::relight::{Origin, Relighter};
use super::report::progress::{Monitor, Stage};
use super::report::summary::StageTime;
use super::store;
use crate::archive::{Archive, Disk, Encoded, PLAIN, Pause, Storage, Tag, Writer};
use crate::error::{Error, Result};
use crate::light::Rgb;
use crate::solve::relight::Transfer;

/// The kind of the archive.
pub const KIND: &str = "transfer";

/// Its name within the job.
pub const FILE: &str = "transfer.glow";

const ORIGINS: Tag = Tag::new("origins");
const MADE_OF: Tag = Tag::new("made_of");
const IRRADIANCE: Tag = Tag::new("irradian");
const RADIOSITY: Tag = Tag::new("radiosit");

/// Values of a block.
const BLOCK: usize = 1 << 14;

/// The archives that transfers are of.
const MADE_FROM: [&str; 3] = ["scene", "sites", "links"];

/// The content of the archives that a job's transfers are made of.
fn made_of(job: &Path) -> Result<Vec<[u8; 16]>> {
    let content = |kind: &str| Ok(Archive::open(job.join(format!("{kind}.glow")))?.content().0);
    MADE_FROM.iter().map(|kind| content(kind)).collect()
}

/// Solves for each light of a baked job by itself, and for the sixteen first harmonics of its sky if that is an image or the
/// bake was told to be for relighting, and keeps what they do beside it. Ones that are there and of this job stay.
///
/// Cost: a bake's solution for every five of them. Memory: the rows and, for ten lights at a time, 12 B a site and receiver.
/// Deterministic: the same bytes for any number of threads and interruptions.
///
/// # Errors
/// Those of reading the job and writing to it, and interruptions.
pub fn store(job: &Path, monitor: &dyn Monitor) -> Result<StageTime> {
    let storage: Arc<dyn Storage> = Arc::new(Disk);
    store_in((&storage, job), monitor, &|| monitor.check())
}

/// As [`store()`], on another storage and asking `pause` before every product.
///
/// # Errors
/// As [`store()`], and what `pause` says.
pub fn store_in(
    (storage, job): (&Arc<dyn Storage>, &Path),
    monitor: &dyn Monitor,
    pause: Pause<'_>,
) -> Result<StageTime> {
    let stage = Stage::start(monitor, "transfer", "lights", None);
    let digests = store::digests_of(job)?;
    let path = job.join(FILE);
    let there = Stored::open(job).ok().flatten();
    if there.is_none_or(|there| there.archive.digests() != digests) {
        let mut relighter = Relighter::read(job)?;
        let mut writer = Writer::create_in(Arc::clone(storage), &path, Tag::new(KIND), digests)?;
        writer.append(MADE_OF, 0..MADE_FROM.len() as u64, &made_of(job)?)?;
        let mut origins: Vec<[u32; 2]> = Vec::new();
        relighter.each_transfer(pause, &mut |origin, transfer| {
            append(&mut writer, IRRADIANCE, origins.len(), &transfer.irradiance)?;
            append(&mut writer, RADIOSITY, origins.len(), &transfer.radiosity)?;
            origins.push(origin.to_words());
            stage.advance(1)
        })?;
        writer.append(ORIGINS, 0..origins.len() as u64, &origins)?;
        writer.finish(&[("program", concat!("glowtree ", env!("CARGO_PKG_VERSION")))])?;
    }
    Ok(stage.finish())
}

/// Appends values of one light in blocks that count on from those of the lights before.
fn append(writer: &mut Writer, tag: Tag, light: usize, values: &[Rgb]) -> Result<()> {
    let encoded: Vec<Vec<u8>> = values.par_chunks(BLOCK).map(codec::encode).collect();
    let mut first = (light * values.len()) as u64;
    for (bytes, values) in encoded.iter().zip(values.chunks(BLOCK)) {
        let range = first..first + values.len() as u64;
        let raw_bytes = 12 * values.len() as u64;
        writer.append_bytes(
            tag,
            range.clone(),
            Encoded { codec: codec::CODEC, width_bytes: 12, raw_bytes, bytes },
        )?;
        first = range.end;
    }
    Ok(())
}

/// The transfers of a job, left in their file.
pub struct Stored {
    archive: Archive,
    /// Those that are of use.
    origins: Vec<Option<Origin>>,
}

impl Stored {
    /// Those of a job; None where it holds none, or its archives are others than they were made of.
    ///
    /// # Errors
    /// [`Error::Damaged`], and those of reading the job.
    pub fn open(job: &Path) -> Result<Option<Self>> {
        let path = job.join(FILE);
        if !path.is_file() {
            return Ok(None);
        }
        let archive = Archive::open(path)?;
        archive.expect_kind(Tag::new(KIND))?;
        let origins = archive.array::<[u32; 2]>(ORIGINS)?.iter();
        let origins: Option<Vec<_>> = origins.map(|words| Origin::from_words(*words).map(Some)).collect();
        let Some(origins) = origins else {
            return Err(damaged(&archive, ORIGINS, "expected kinds of lights from 0 to 3".to_owned()));
        };
        let own = archive.array::<[u8; 16]>(MADE_OF)? == made_of(job)?;
        Ok(own.then_some(Self { archive, origins }))
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.origins.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.origins.is_empty()
    }

    /// Bytes of the file.
    pub fn bytes(&self) -> u64 {
        self.archive.bytes()
    }

    /// Bytes that one of their values takes, of a channel, site or receiver and light.
    pub fn bytes_per_value(&self) -> f64 {
        let blocks = || self.archive.all_blocks().filter(|block| block.entry().codec == codec::CODEC);
        let [stored, raw] = [0, 1].map(|which| {
            blocks().map(|block| [block.entry().stored_bytes, block.entry().raw_bytes][which]).sum::<u64>()
        });
        4.0 * stored as f64 / raw.max(1) as f64
    }

    /// The light is another than it was: what it did is of no use any more.
    pub(super) fn forget(&mut self, origin: Origin) {
        self.origins.iter_mut().filter(|own| **own == Some(origin)).for_each(|own| *own = None);
    }

    /// Whether it is held what a light does.
    pub(super) fn holds(&self, origin: Origin) -> bool {
        self.origins.contains(&Some(origin))
    }

    /// What a light does, if it is held. Cost: some 10 ns a value.
    pub(super) fn transfer(&self, origin: Origin) -> Result<Option<Transfer>> {
        let Some(light) = self.origins.iter().position(|own| *own == Some(origin)) else { return Ok(None) };
        self.number(light).map(Some)
    }

    /// What the light of a number does.
    pub(super) fn number(&self, light: usize) -> Result<Transfer> {
        Ok(Transfer {
            irradiance: self.values(IRRADIANCE, light)?,
            radiosity: self.values(RADIOSITY, light)?,
        })
    }

    fn values(&self, tag: Tag, light: usize) -> Result<Vec<Rgb>> {
        let total: u64 = self.archive.blocks(tag).map(|block| block.entry().count).sum();
        let each = total / self.origins.len().max(1) as u64;
        let own = light as u64 * each..(light as u64 + 1) * each;
        let blocks: Vec<_> =
            self.archive.blocks(tag).filter(|block| own.contains(&block.entry().first)).collect();
        let parts: Vec<Vec<Rgb>> = blocks
            .par_iter()
            .map(|block| {
                let fits = block.entry().codec != PLAIN && block.entry().count <= BLOCK as u64;
                let problem = || format!("expected codec {}, at most {BLOCK} values", codec::CODEC);
                let values = if fits {
                    codec::decode(block.stored()?, block.entry().count as usize)
                } else {
                    Err(problem())
                };
                values.map_err(|problem| damaged(&self.archive, tag, problem))
            })
            .collect::<Result<_>>()?;
        let values = parts.concat();
        if values.len() as u64 == each {
            Ok(values)
        } else {
            Err(damaged(&self.archive, tag, format!("expected {each} values, got {}", values.len())))
        }
    }

    /// The sizes of a light's arrays: receivers and sites.
    pub(super) fn sizes(&self) -> [u64; 2] {
        [IRRADIANCE, RADIOSITY].map(|tag| {
            let total: u64 = self.archive.blocks(tag).map(|block| block.entry().count).sum();
            total / self.origins.len().max(1) as u64
        })
    }
}

fn damaged(archive: &Archive, tag: Tag, problem: String) -> Error {
    Error::Damaged { file: archive.file().to_owned(), place: tag.to_string(), problem }
}

impl Origin {
    /// For storage: the kind of light and its number.
    fn to_words(self) -> [u32; 2] {
        match self {
            Self::Mesh(k) => [0, k as u32],
            Self::Lamp(k) => [1, k as u32],
            Self::Sky => [2, 0],
            Self::Harmonic(k) => [3, k as u32],
        }
    }

    fn from_words([kind, number]: [u32; 2]) -> Option<Self> {
        let number = number as usize;
        match kind {
            0 => Some(Self::Mesh(number)),
            1 => Some(Self::Lamp(number)),
            2 => Some(Self::Sky),
            3 => Some(Self::Harmonic(number)),
            _ => None,
        }
    }
}
