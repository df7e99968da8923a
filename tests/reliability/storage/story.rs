//! A recorded bake and what is true of it: which blocks there are, and which had been promised when.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use glowtree::archive::{Archive, Digests, Entry, Tag, Writer, verify};
use glowtree::bake::{Monitor, Signal, run_in};
use rkyv::util::AlignedVec;

use super::super::faults::Memory;
use super::super::job::{Ground, options};
use super::super::tally::{Bad, broken};
use super::Clumsy;
use super::log::Change;
use super::power::Machine;

const LEDGER: Tag = Tag::new("ledger");

/// A bake as it happened, with what is true at its end.
pub struct Story {
    pub ground: Ground,
    pub log: Vec<Change>,
    /// The blocks of each ledger.
    ledgers: BTreeMap<String, Vec<Entry>>,
}

/// What must be there whatever is lost: bytes of ledgers and whole archives, by path from the root.
pub type Promised = BTreeMap<PathBuf, usize>;

/// The same place in the job that is exchanged with this one.
fn other_name(path: &Path) -> PathBuf {
    let [one, other] = ["job", "job.new"];
    match (path.strip_prefix(one), path.strip_prefix(other)) {
        (Ok(rest), _) => Path::new(other).join(rest),
        (_, Ok(rest)) => Path::new(one).join(rest),
        _ => path.to_path_buf(),
    }
}

/// Asks to stop the bake at its n-th look.
struct Stopping(AtomicU64);

impl Monitor for Stopping {
    fn interrupted(&self) -> Option<Signal> {
        (self.0.fetch_sub(1, Ordering::Relaxed) == 0).then_some(Signal::Terminate)
    }
}

impl Story {
    /// Bakes with three interruptions, and once more with --restart, which puts the new job into the old one's place.
    pub fn record() -> Self {
        let ground = Ground::new(false);
        let storage = Clumsy::logging();
        let (scene, job) = (ground.scene(), ground.path("world/job"));
        std::fs::create_dir(ground.path("world")).unwrap();
        for restart in [false, true] {
            for looks in [40, 25, 60, u64::MAX] {
                let options = glowtree::bake::Options { restart, ..options(false) };
                let stopping = Stopping(AtomicU64::new(looks));
                let outcome = run_in(&storage.shared(), (&scene, &job), &options, &stopping);
                assert!(outcome.is_ok() || looks < u64::MAX, "{outcome:?}");
            }
        }
        let mut story = Self { ground, log: storage.log(), ledgers: BTreeMap::new() };
        story.ledgers = story.true_ledgers();
        story
    }

    pub fn in_words(&self) -> String {
        let syncs = self.log.iter().filter(|change| matches!(change, Change::Sync(_))).count();
        let blocks: usize = self.ledgers.values().map(Vec::len).sum();
        format!(
            "a bake with three interruptions and a restart: {} changes, {syncs} syncs, {blocks} blocks",
            self.log.len()
        )
    }

    /// The longest that each ledger was.
    fn true_ledgers(&self) -> BTreeMap<String, Vec<Entry>> {
        let mut ledgers: BTreeMap<String, Vec<Entry>> = BTreeMap::new();
        let mut machine = Machine::new(&self.ground.path("world"));
        for change in &self.log {
            if matches!(change, Change::RemoveAll(_)) {
                let mut settled = machine.clone();
                settled.settle();
                for (path, bytes) in settled.files_after_loss(512, &mut || 0) {
                    let Some(name) = ledger(&path) else { continue };
                    let entries = resumed(&bytes, self.ground.digests).unwrap();
                    let longest = ledgers.entry(name).or_default();
                    if entries.len() > longest.len() {
                        *longest = entries;
                    }
                }
            }
            machine.advance(change);
        }
        assert!(ledgers.values().map(Vec::len).sum::<usize>() > 20, "{ledgers:?}");
        ledgers
    }

    /// The machine after so many changes, and what it has promised.
    pub fn until(&self, at: usize) -> (Machine, Promised) {
        let root = self.ground.path("world");
        let (mut machine, mut promises) = (Machine::new(&root), Promises::default());
        for change in &self.log[..at] {
            machine.advance(change);
            promises.advance(change);
        }
        let below = |path: PathBuf| path.strip_prefix(&root).unwrap().to_path_buf();
        (machine, promises.made.into_iter().map(|(path, bytes)| (below(path), bytes)).collect())
    }

    /// The machine after so many changes, of which it took no sync seriously.
    pub fn lying(&self, at: usize) -> Machine {
        let mut machine = Machine::new(&self.ground.path("world"));
        let done = self.log[..at].iter();
        done.filter(|change| !matches!(change, Change::Sync(_) | Change::SyncDirectory(_)))
            .for_each(|change| machine.advance(change));
        machine
    }

    /// How many whole blocks and archives are there; wrong when one is not true, lost when a promised one is missing.
    pub fn examine(&self, files: &BTreeMap<PathBuf, Vec<u8>>, promised: &Promised) -> Result<u64, Bad> {
        // An exchange of names that is not yet durable may be undone: all is then under the other name.
        let is_there = |path: &Path| files.contains_key(path) || files.contains_key(&other_name(path));
        if let Some(path) = promised.keys().find(|path| !is_there(path)) {
            return Err(Bad::Lost(1, format!("{} was durable", path.display())));
        }
        let mut kept = 0;
        for (path, bytes) in files {
            if let Some(name) = ledger(path) {
                kept += self.examine_ledger((path, &name), bytes, promised)?;
            } else if path.extension().is_some_and(|end| end == "glow") {
                kept += u64::from(self.examine_archive(path, bytes)?);
            }
        }
        Ok(kept)
    }

    fn examine_ledger(
        &self,
        (path, name): (&Path, &str),
        bytes: &[u8],
        promised: &Promised,
    ) -> Result<u64, Bad> {
        let entries = match resumed(bytes, self.ground.digests) {
            Ok(entries) => entries,
            Err(why) => return broken(format!("{}: {why}", path.display())),
        };
        let truth = &self.ledgers[name];
        if truth.get(..entries.len()) != Some(&entries[..]) {
            return Err(Bad::Wrong(format!("{} holds other blocks", path.display())));
        }
        let durable = promised.get(path).copied().unwrap_or(0) as u64;
        // A block is its header of 64 bytes and its payload, padded.
        let end = |entry: &Entry| entry.offset + 64 + entry.stored_bytes.next_multiple_of(64);
        let expected = truth.iter().take_while(|entry| end(entry) <= durable).count();
        if entries.len() < expected {
            let why =
                format!("{} of {expected} durable blocks are left in {}", entries.len(), path.display());
            return Err(Bad::Lost((expected - entries.len()) as u64, why));
        }
        Ok(entries.len() as u64)
    }

    fn examine_archive(&self, path: &Path, bytes: &[u8]) -> Result<bool, Bad> {
        let name = path.file_name().unwrap().to_str().unwrap();
        if self.ground.files.get(name).is_some_and(|truth| truth == bytes) {
            return Ok(true);
        }
        let mut aligned = AlignedVec::<64>::new();
        aligned.extend_from_slice(bytes);
        let seen = Archive::from_bytes(&aligned, path)
            .map_or(true, |archive| verify(&archive).is_ok_and(|report| !report.damaged.is_empty()));
        if seen { Ok(false) } else { Err(Bad::Wrong(format!("{} is another", path.display()))) }
    }
}

/// Lengths of files: now, at their last sync, and when their name had been synced after that.
#[derive(Default)]
struct Promises {
    lengths: Promised,
    synced: Promised,
    made: Promised,
}

impl Promises {
    fn advance(&mut self, change: &Change) {
        match change {
            Change::Write(path, at, bytes) => drop(self.lengths.insert(path.clone(), at + bytes.len())),
            Change::Length(path, bytes) => drop(self.lengths.insert(path.clone(), *bytes)),
            Change::Sync(path) => {
                self.synced.insert(path.clone(), self.lengths.get(path).copied().unwrap_or(0));
            }
            Change::SyncDirectory(folder) => {
                let there = self.synced.iter().filter(|(path, _)| path.parent() == Some(folder));
                self.made.extend(there.map(|(path, bytes)| (path.clone(), *bytes)));
            }
            Change::Create(gone) | Change::Remove(gone) | Change::RemoveAll(gone) => {
                self.follow(|path| (!path.starts_with(gone)).then(|| path.to_path_buf()));
            }
            Change::Rename(from, to) => {
                self.follow(|path| (path != to).then(|| if path == from { to } else { path }.to_path_buf()));
            }
            Change::Exchange(one, other) => self.follow(|path| Some(exchanged(path, one, other))),
            Change::Directory(_) => {}
        }
    }

    /// Files under their new names; those without one are promised no longer.
    fn follow(&mut self, name: impl Fn(&Path) -> Option<PathBuf>) {
        for map in [&mut self.lengths, &mut self.synced, &mut self.made] {
            let named = std::mem::take(map).into_iter();
            *map = named.filter_map(|(path, bytes)| Some((name(&path)?, bytes))).collect();
        }
    }
}

fn exchanged(path: &Path, one: &Path, other: &Path) -> PathBuf {
    let moved = |from: &Path, to: &Path| path.strip_prefix(from).ok().map(|rest| to.join(rest));
    moved(one, other).or_else(|| moved(other, one)).unwrap_or_else(|| path.to_path_buf())
}

/// The name of a ledger's file.
fn ledger(path: &Path) -> Option<String> {
    let folder = path.parent()?.file_name()?;
    (folder == glowtree::bake::job::WORK_FOLDER).then(|| path.file_name()?.to_str().map(str::to_owned))?
}

/// What a writer takes over from a file, each block read back.
fn resumed(bytes: &[u8], digests: Digests) -> Result<Vec<Entry>, String> {
    let (memory, path) = (Memory::default(), Path::new("ledger"));
    memory.put(&glowtree::archive::partial_path(path), bytes);
    let (mut writer, found) =
        Writer::resume_in(Arc::new(memory), path, LEDGER, digests).map_err(|e| e.to_string())?;
    (0..found.blocks).try_for_each(|number| writer.read_back(number).map(drop)).map_err(|e| e.to_string())?;
    Ok(writer.entries().to_vec())
}
