//! The archive's reader and scan on bytes in memory, small enough for Miri:
//! `cargo +nightly miri test --test archive_miri`.
//!
//! Maps and the disk are left to `archive.rs`; what Miri can watch is the reading of plain old data in place.

#[path = "fuzz_corpus/readers.rs"]
mod readers;

use std::path::Path;
use std::sync::Arc;

use glowtree::archive::{Archive, Tag, Writer, partial_path, verify};
use readers::{Memory, SITES, archive_digests};
use rkyv::util::AlignedVec;

/// Bytes between two damaged places: all of them are `archive.rs`'s task, and Miri is a thousand times slower.
const STRIDE: usize = if cfg!(miri) { 701 } else { 37 };

/// A finished archive of three blocks, and what its writer left before it finished.
fn archives() -> [Vec<u8>; 2] {
    let memory = Memory::default();
    let path = Path::new("sites.glow");
    let mut writer =
        Writer::create_in(Arc::new(memory.clone()), path, SITES, archive_digests()).expect("memory");
    writer.append(Tag::new("rows"), 0..9, &[1u64, 4, 9, 16, 25, 36, 49, 64, 81, 100]).expect("memory");
    writer.append(Tag::new("weights"), 0..3, &[1.0f32, 0.5, 0.25]).expect("memory");
    writer.append(Tag::new("empty"), 7..7, &[0u8; 0]).expect("memory");
    let unfinished = memory.bytes(&partial_path(path)).expect("a file");
    writer.finish(&[("program", "test")]).expect("memory");
    [memory.bytes(path).expect("a file"), unfinished]
}

#[test]
fn arrays_are_read_in_place() {
    let [finished, _] = archives();
    let mut aligned = AlignedVec::<64>::with_capacity(finished.len());
    aligned.extend_from_slice(&finished);
    let archive = Archive::from_bytes(aligned, "sites.glow").expect("a sound archive");
    let rows: &[u64] = archive.array(Tag::new("rows")).expect("rows");
    let weights: &[f32] = archive.array(Tag::new("weights")).expect("weights");
    assert_eq!((rows[9], weights[2]), (100, 0.25));
    assert!(archive.array::<u8>(Tag::new("empty")).expect("an empty block").is_empty());
    assert!(verify(&archive).expect("memory").damaged.is_empty());
}

#[test]
fn damaged_bytes_break_no_promise() {
    for bytes in archives() {
        readers::archive(&bytes);
        for at in (0..bytes.len()).step_by(STRIDE) {
            readers::archive(&bytes[..at]);
            let mut changed = bytes.clone();
            changed[at] ^= 1 << (at % 8);
            readers::archive(&changed);
        }
    }
}
