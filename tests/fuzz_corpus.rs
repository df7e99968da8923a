//! Replays the corpus of the fuzz targets and seeded mutations of it, each target in a process of its own with 512 MB:
//! no panic, no answer that breaks a promise, no input that takes long.
//!
//! What fuzzing finds goes into `tools/fuzz/corpus/TARGET` under a name that says what it was, and stays.
//! `GLOWTREE_RENEW=1` writes the seeds that are made here anew.

#[path = "fuzz_corpus/readers.rs"]
mod readers;
mod scene_shared;
#[path = "fuzz_corpus/seeds.rs"]
mod seeds;

use std::io::Read;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use readers::TARGETS;

/// Says to a child which target it is to run.
const TARGET: &str = "GLOWTREE_FUZZ_TARGET";

/// Time for the mutations of one target; all nine and the start of their processes take less than 20 s.
const BUDGET: Duration = Duration::from_millis(2200);

/// The longest that one input of a few kilobytes may take, on a busy machine. Most take microseconds.
const PATIENCE: Duration = Duration::from_secs(5);

/// Address space of a child in kilobytes.
const MEMORY: &str = "524288";

/// Mutations grow no longer than this.
const LONGEST: usize = 16_384;

fn corpus(target: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tools/fuzz/corpus").join(target)
}

/// The files of a target's corpus by name.
fn inputs(target: &str) -> Vec<(String, Vec<u8>)> {
    let Ok(folder) = std::fs::read_dir(corpus(target)) else { return Vec::new() };
    let paths = folder.map(|entry| entry.expect("an entry").path());
    let mut inputs: Vec<(String, Vec<u8>)> = paths
        .map(|path| {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            (name, std::fs::read(&path).expect("an input"))
        })
        .collect();
    inputs.sort();
    inputs
}

#[test]
fn the_corpus_breaks_no_promise() {
    if std::env::var_os("GLOWTREE_RENEW").is_some() {
        for (target, name, bytes) in seeds::seeds() {
            std::fs::create_dir_all(corpus(target)).expect("the corpus");
            std::fs::write(corpus(target).join(name), bytes).expect("a seed");
        }
    }
    if !corpus(TARGETS[0].0).exists() {
        println!("skipped: there is no tools/fuzz/corpus");
        return;
    }
    let start = Instant::now();
    let said: Vec<String> = TARGETS.iter().map(|(target, _)| run_child(target)).collect();
    println!("{}\nall in {:.1} s", said.join("\n"), start.elapsed().as_secs_f64());
}

/// Runs one target in a process that has little memory; gives its summary.
fn run_child(target: &str) -> String {
    let program = std::env::current_exe().expect("this program");
    let mut child = Command::new("sh")
        .args(["-c", "ulimit -v \"$0\" && exec \"$@\"", MEMORY])
        .arg(program)
        .args(["--exact", "one_target_in_little_memory", "--nocapture", "--test-threads=1"])
        .env(TARGET, target)
        .env("RUST_BACKTRACE", "0")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("a child");
    let deadline = Instant::now() + Duration::from_secs(60);
    let status = loop {
        match child.try_wait().expect("the child's state") {
            Some(status) => break Some(status),
            None if Instant::now() > deadline => break None,
            None => std::thread::sleep(Duration::from_millis(20)),
        }
    };
    if status.is_none() {
        child.kill().expect("ending the child");
    }
    let (mut said, mut complaint) = (String::new(), String::new());
    child.stdout.take().expect("its output").read_to_string(&mut said).expect("its output as text");
    child.stderr.take().expect("its errors").read_to_string(&mut complaint).expect("its errors as text");
    assert!(status.is_some_and(|status| status.success()), "{target}: {status:?}\n{said}\n{complaint}");
    let summary =
        said.lines().find_map(|line| line.split_once("summary ")).map_or("", |(_, summary)| summary);
    assert!(summary.starts_with(target), "{target} says nothing: {said}");
    summary.to_string()
}

/// The child's part; without the variable there is nothing to do.
#[test]
fn one_target_in_little_memory() {
    let Ok(target) = std::env::var(TARGET) else { return };
    let (_, reader) = TARGETS.iter().find(|(name, _)| *name == target).expect("a target of this name");
    let inputs = inputs(&target);
    assert!(!inputs.is_empty(), "{target} has no corpus");
    inputs.iter().for_each(|(name, bytes)| check(*reader, name, bytes));
    let (start, mut mutated) = (Instant::now(), 0u64);
    while start.elapsed() < BUDGET {
        let mut random = Random(mutated ^ 0x676c_6f77);
        let (name, bytes) = &inputs[random.below(inputs.len())];
        let (_, other) = &inputs[random.below(inputs.len())];
        let bytes = mutate(bytes.clone(), other, &mut random);
        check(*reader, &format!("{name}, mutation {mutated}"), &bytes);
        mutated += 1;
    }
    println!("summary {target}: {} inputs, {mutated} mutations, peak {} kB", inputs.len(), peak_kilobytes());
}

/// Reads one input; says which it was when it panics or takes long.
fn check(reader: readers::Reader, name: &str, bytes: &[u8]) {
    let start = Instant::now();
    let outcome = catch_unwind(AssertUnwindSafe(|| reader(bytes)));
    let shown = bytes[..bytes.len().min(LONGEST)].escape_ascii();
    assert!(outcome.is_ok(), "{name} breaks a promise: {shown}");
    assert!(start.elapsed() < PATIENCE, "{name} took {:?}: {shown}", start.elapsed());
}

fn peak_kilobytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    peak.and_then(|line| line.split_whitespace().next()?.parse().ok()).unwrap_or(0)
}

/// SplitMix64 (Steele, Lea and Flood 2014).
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    fn below(&mut self, count: usize) -> usize {
        (self.bits() % count.max(1) as u64) as usize
    }
}

/// Texts that stand well in the place of numbers and words.
const TEXTS: [&str; 16] = [
    "0",
    "-1",
    "1e39",
    "1e309",
    "-1e308",
    "nan",
    "inf",
    "4294967295",
    "4294967296",
    "99999999999999999999",
    "\"",
    "[",
    "\n",
    "\0",
    "\u{1b}[2J",
    ",,",
];

/// A few changes such as damage, carelessness and malice make.
fn mutate(mut bytes: Vec<u8>, other: &[u8], random: &mut Random) -> Vec<u8> {
    for _ in 0..=random.below(3) {
        let at = random.below(bytes.len());
        let end = (at + 1 + random.below(16)).min(bytes.len());
        match random.below(8) {
            _ if bytes.is_empty() => bytes.extend_from_slice(other),
            0 => bytes[at] ^= 1 << random.below(8),
            1 => bytes[at] = random.bits() as u8,
            2 => bytes.truncate(at),
            3 => drop(bytes.drain(at..end)),
            4 => {
                let piece = bytes[at..end].to_vec();
                bytes.splice(at..at, piece);
            }
            5 => {
                let words =
                    [0u32, 1, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff, 0x7fc0_0000, 0x7f80_0000, 0xffff];
                let word = words[random.below(words.len())].to_le_bytes();
                bytes.iter_mut().skip(at).zip(word).for_each(|(byte, new)| *byte = new);
            }
            6 => {
                // A word of the text, from one blank to the next.
                let is_blank = |byte: &u8| byte.is_ascii_whitespace() || *byte == b',';
                let stop = bytes[at..].iter().position(is_blank).map_or(end, |length| at + length);
                bytes.splice(at..stop, TEXTS[random.below(TEXTS.len())].bytes());
            }
            _ => {
                let from = random.below(other.len());
                bytes.truncate(at);
                bytes.extend_from_slice(&other[from.min(other.len())..]);
            }
        }
    }
    bytes.truncate(LONGEST);
    bytes
}
