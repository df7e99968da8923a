//! A machine that loses power: what the log's changes leave behind.
//!
//! Stricter than any file system in use: what was written since a file's last sync survives sector by sector, each or not,
//! in any order; names made since a directory's last sync survive up to some point, each directory by itself; syncing a
//! file says nothing of its name.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

use super::log::Change;

type Names = BTreeMap<String, usize>;

/// Files and directories by number; 0 is the root of the world that is watched.
#[derive(Clone, Debug)]
pub struct Machine {
    root: PathBuf,
    things: Vec<Thing>,
}

#[derive(Clone, Debug)]
enum Thing {
    File { durable: Vec<u8>, pending: Vec<Piece> },
    Directory { now: Names, durable: Names, pending: Vec<Vec<(String, Option<usize>)>> },
}

#[derive(Clone, Debug)]
enum Piece {
    Bytes(usize, Vec<u8>),
    Length(usize),
}

impl Piece {
    fn apply(&self, file: &mut Vec<u8>) {
        match self {
            Self::Length(length) => file.resize(*length, 0),
            Self::Bytes(at, bytes) => {
                file.resize(file.len().max(at + bytes.len()), 0);
                file[*at..at + bytes.len()].copy_from_slice(bytes);
            }
        }
    }
}

fn directory() -> Thing {
    Thing::Directory { now: Names::new(), durable: Names::new(), pending: Vec::new() }
}

fn apply(changes: &[(String, Option<usize>)], names: &mut Names) {
    for (name, thing) in changes {
        match thing {
            Some(thing) => drop(names.insert(name.clone(), *thing)),
            None => drop(names.remove(name)),
        }
    }
}

impl Machine {
    /// With an empty root that is there to stay; all paths of the log lie below it.
    pub fn new(root: &Path) -> Self {
        Self { root: root.into(), things: vec![directory()] }
    }

    /// The system goes on by one change.
    pub fn advance(&mut self, change: &Change) {
        match change {
            Change::Create(path) => match self.find(path) {
                Some(file) => self.piece(file, Piece::Length(0)),
                None => self.add(path, Thing::File { durable: Vec::new(), pending: Vec::new() }),
            },
            Change::Write(path, at, bytes) => self.piece(self.at(path), Piece::Bytes(*at, bytes.clone())),
            Change::Length(path, bytes) => self.piece(self.at(path), Piece::Length(*bytes)),
            Change::Sync(path) => {
                let file = self.at(path);
                if let Thing::File { durable, pending } = &mut self.things[file] {
                    pending.drain(..).for_each(|piece| piece.apply(durable));
                }
            }
            Change::Rename(from, to) => {
                let moved = self.at(from);
                self.rename(from, vec![(name(from), None), (name(to), Some(moved))]);
            }
            Change::Remove(path) => self.rename(path, vec![(name(path), None)]),
            Change::Directory(path) => self.make_directories(path),
            Change::RemoveAll(path) => self.remove_all(path),
            Change::Exchange(one, other) => {
                let (a, b) = (self.at(one), self.at(other));
                self.rename(one, vec![(name(one), Some(b)), (name(other), Some(a))]);
            }
            Change::SyncDirectory(path) => {
                let folder = self.at(path);
                if let Thing::Directory { now, durable, pending } = &mut self.things[folder] {
                    durable.clone_from(now);
                    pending.clear();
                }
            }
        }
    }

    /// Everything becomes durable, as on a machine that is left alone for a while.
    pub fn settle(&mut self) {
        for thing in &mut self.things {
            match thing {
                Thing::File { durable, pending } => pending.drain(..).for_each(|piece| piece.apply(durable)),
                Thing::Directory { now, durable, pending } => {
                    durable.clone_from(now);
                    pending.clear();
                }
            }
        }
    }

    /// The files that are there after losing power now, by their path from the root.
    pub fn files_after_loss(
        &self,
        sector: usize,
        random: &mut dyn FnMut() -> u64,
    ) -> BTreeMap<PathBuf, Vec<u8>> {
        let mut files = BTreeMap::new();
        self.surviving((0, PathBuf::new()), (sector, random), &mut files);
        files
    }

    fn surviving(
        &self,
        (thing, path): (usize, PathBuf),
        (sector, random): (usize, &mut dyn FnMut() -> u64),
        files: &mut BTreeMap<PathBuf, Vec<u8>>,
    ) {
        match &self.things[thing] {
            Thing::File { durable, pending } => {
                let mut bytes = durable.clone();
                pending.iter().for_each(|piece| survive(piece, &mut bytes, (sector, random)));
                files.insert(path, bytes);
            }
            Thing::Directory { durable, pending, .. } => {
                let mut names = durable.clone();
                let kept = random() as usize % (pending.len() + 1);
                pending[..kept].iter().for_each(|changes| apply(changes, &mut names));
                for (name, thing) in names {
                    self.surviving((thing, path.join(name)), (sector, random), files);
                }
            }
        }
    }

    fn piece(&mut self, file: usize, piece: Piece) {
        if let Thing::File { pending, .. } = &mut self.things[file] {
            pending.push(piece);
        }
    }

    fn add(&mut self, path: &Path, thing: Thing) {
        self.things.push(thing);
        self.rename(path, vec![(name(path), Some(self.things.len() - 1))]);
    }

    /// One atomic change of names in the directory that holds `path`.
    fn rename(&mut self, path: &Path, changes: Vec<(String, Option<usize>)>) {
        let folder = self.at(path.parent().unwrap());
        if let Thing::Directory { now, pending, .. } = &mut self.things[folder] {
            apply(&changes, now);
            pending.push(changes);
        }
    }

    fn make_directories(&mut self, path: &Path) {
        let missing: Vec<&Path> = path.ancestors().take_while(|above| self.find(above).is_none()).collect();
        missing.into_iter().rev().for_each(|path| self.add(path, directory()));
    }

    fn remove_all(&mut self, path: &Path) {
        if let Thing::Directory { now, .. } = &self.things[self.at(path)] {
            let names: Vec<String> = now.keys().cloned().collect();
            names.iter().for_each(|name| self.remove_all(&path.join(name)));
        }
        self.rename(path, vec![(name(path), None)]);
    }

    fn at(&self, path: &Path) -> usize {
        self.find(path).unwrap_or_else(|| panic!("{} is not there", path.display()))
    }

    fn find(&self, path: &Path) -> Option<usize> {
        let below = path.strip_prefix(&self.root).unwrap();
        below.components().try_fold(0, |thing, part| match (&self.things[thing], part) {
            (Thing::Directory { now, .. }, Component::Normal(name)) => now.get(name.to_str()?).copied(),
            _ => None,
        })
    }
}

fn name(path: &Path) -> String {
    path.file_name().unwrap().to_str().unwrap().to_owned()
}

/// What is left of a piece that was not synced: of a write, any of its sectors.
fn survive(piece: &Piece, file: &mut Vec<u8>, (sector, random): (usize, &mut dyn FnMut() -> u64)) {
    let Piece::Bytes(at, bytes) = piece else {
        if random().is_multiple_of(2) {
            piece.apply(file);
        }
        return;
    };
    let share = random() % 5; // of sectors, in quarters: none, some or all
    let mut start = 0;
    while start < bytes.len() {
        let end = bytes.len().min((at + start + 1).next_multiple_of(sector) - at);
        if random() % 4 < share {
            Piece::Bytes(at + start, bytes[start..end].to_vec()).apply(file);
        }
        start = end;
    }
}
