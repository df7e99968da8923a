//! Damage: every bit, every length, swapped and spliced blocks, hostile claims under valid checksums.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use glowtree::archive::{Archive, Block, Digest, Digests, Tag, Writer, partial_path, verify};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use xxhash_rust::xxh3::xxh3_64;

use super::{KIND, ROWS, WEIGHTS, aligned, digests, fill, whole};

/// Whether opening or verifying says that something is wrong; what it does not see must be the same archive.
fn is_detected(bytes: &[u8]) -> bool {
    Archive::from_bytes(bytes, "damaged")
        .map_or(true, |archive| !verify(&archive).unwrap().damaged.is_empty())
}

/// Every block as a span of the file, and the directory with the trailer.
fn spans(bytes: &[u8]) -> Vec<Range<usize>> {
    let archive = Archive::from_bytes(bytes, "whole").unwrap();
    let starts: Vec<usize> = archive.all_blocks().map(|block| block.entry().offset as usize).collect();
    let ends = starts[1..].iter().copied().chain([word(bytes, bytes.len() - 64) as usize]);
    starts.iter().copied().zip(ends).map(|(start, end)| start..end).collect()
}

fn word(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

#[test]
fn every_flipped_bit_is_detected() {
    // 13,500 words of links make it 64 KiB.
    let mut bytes = aligned(&whole(digests(), 13_500));
    assert!((60_000..=65_536).contains(&bytes.len()), "{}", bytes.len());
    assert!(!is_detected(&bytes), "the undamaged file must pass, or this test proves nothing");
    let harmless: Vec<(usize, u32)> = (0..bytes.len())
        .flat_map(|byte| (0..8).map(move |bit| (byte, bit)))
        .filter(|&(byte, bit)| {
            bytes[byte] ^= 1 << bit;
            let detected = is_detected(&bytes);
            bytes[byte] ^= 1 << bit;
            !detected
        })
        .collect();
    println!("{} flips, {} not detected", bytes.len() * 8, harmless.len());
    assert_eq!(harmless, []);
}

#[test]
fn every_other_length_is_detected() {
    let bytes = aligned(&whole(digests(), 100));
    for length in 0..bytes.len() {
        assert!(Archive::from_bytes(&bytes[..length], "cut").is_err(), "cut at {length}");
    }
    for extra in [1, 63, 64, 4096] {
        let mut longer = aligned(&bytes);
        longer.resize(bytes.len() + extra, 0);
        assert!(Archive::from_bytes(&longer, "zeros").is_err(), "{extra} zeros");
    }
    let mut doubled = aligned(&bytes);
    doubled.extend_from_slice(&bytes[bytes.len() - 64..]);
    assert!(Archive::from_bytes(&doubled, "doubled").is_err(), "a second trailer");
    let mut twice = aligned(&bytes);
    twice.extend_from_slice(&bytes);
    assert!(Archive::from_bytes(&twice, "twice").is_err(), "the file after itself");
}

#[test]
fn swapped_spliced_and_zeroed_blocks_are_detected_and_named() {
    let bytes = whole(digests(), 100);
    let spans = spans(&bytes);
    let (first, second) = (spans[1].clone(), spans[2].clone());
    assert_eq!(first.len(), second.len(), "the two blocks of weights are there to be swapped");
    let mut swapped = aligned(&bytes);
    swapped[first.clone()].copy_from_slice(&bytes[second.clone()]);
    swapped[second].copy_from_slice(&bytes[first]);
    let report = verify(&Archive::from_bytes(&swapped, "swapped").unwrap()).unwrap();
    let named: Vec<_> =
        report.damaged.iter().map(|damage| (damage.number, damage.tag, &damage.range)).collect();
    assert_eq!(named, [(1, WEIGHTS, &(0..50)), (2, WEIGHTS, &(50..100))]);

    // The same blocks, made from other inputs: equal payloads, so only the salt tells them apart.
    let other = whole(Digests { inputs: Digest::of_bytes(b"other"), ..digests() }, 100);
    for (number, span) in spans.iter().enumerate() {
        let mut spliced = aligned(&bytes);
        spliced[span.clone()].copy_from_slice(&other[span.clone()]);
        let archive = Archive::from_bytes(&spliced, "spliced").unwrap();
        let numbers: Vec<_> = verify(&archive).unwrap().damaged.iter().map(|damage| damage.number).collect();
        assert_eq!(numbers, [number]);
    }
    let mut head = aligned(&bytes);
    head[..4096].copy_from_slice(&other[..4096]);
    assert!(Archive::from_bytes(&head, "other superblock").is_err());

    for sector in (0..bytes.len()).step_by(512) {
        let mut zeroed = aligned(&bytes);
        let end = bytes.len().min(sector + 512);
        zeroed[sector..end].fill(0);
        assert_eq!(is_detected(&zeroed), zeroed[..] != bytes[..], "sector at {sector}");
    }
}

#[test]
fn damage_is_reported_on_first_touch_and_not_before() {
    let mut bytes = aligned(&whole(digests(), 100));
    let rows = spans(&bytes)[0].clone();
    bytes[rows.start + 64] ^= 1;
    let archive = Archive::from_bytes(&bytes, "job/links.glow").unwrap();
    assert!(archive.blocks(WEIGHTS).all(|block| block.array::<f32>().is_ok()));
    for _ in 0..2 {
        let error = archive.array::<u64>(ROWS).unwrap_err();
        assert_eq!(error.exit_code(), 9);
        let text = error.to_string();
        assert!(text.starts_with("job/links.glow: block 0 `rows`: expected checksum "), "{text}");
        assert!(text.contains(", got "), "{text}");
    }
}

#[test]
fn a_repair_copies_what_is_whole() {
    let mut bytes = aligned(&whole(digests(), 100));
    let damaged = spans(&bytes)[2].clone();
    bytes[damaged.start + 100] ^= 4;
    let archive = Archive::from_bytes(&bytes, "damaged").unwrap();
    let memory = super::faults::Memory::default();
    let mut writer =
        Writer::create_in(Arc::new(memory.clone()), Path::new("links.glow"), KIND, digests()).unwrap();
    let weights: Vec<f32> = (500..1000).map(|index| 1.0 / (1.0 + index as f32)).collect();
    for block in archive.all_blocks() {
        if block.recheck().is_err() {
            assert!(writer.append_copy(block).is_err(), "damage must not be copied");
            writer.append(WEIGHTS, block.range(), &weights).unwrap();
        } else {
            writer.append_copy(block).unwrap();
        }
    }
    writer.finish(&[("program", "test")]).unwrap();
    assert!(memory.bytes(Path::new("links.glow")).unwrap() == whole(digests(), 100));
}

#[test]
fn a_file_that_changes_under_a_reader_is_damage_not_a_bus_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("links.glow");
    let write = || {
        let mut writer = Writer::create(&path, KIND, digests()).unwrap();
        fill(&mut writer, 100_000).unwrap();
        writer.finish(&[]).unwrap();
        Archive::open(&path).unwrap()
    };
    let cut =
        |length: u64| std::fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(length).unwrap();
    for length in [0, 1, 4096, 5000, 8192, 300_000] {
        let archive = write();
        archive.array::<u64>(ROWS).unwrap();
        cut(length);
        for block in archive.all_blocks() {
            assert_eq!(
                block.stored().unwrap_err().exit_code(),
                9,
                "cut to {length}, block {}",
                block.number()
            );
        }
    }
    // Overwritten in place, same length.
    let archive = write();
    std::fs::write(&path, vec![7_u8; archive.bytes() as usize]).unwrap();
    for block in archive.all_blocks() {
        assert_eq!(block.stored().unwrap_err().exit_code(), 9);
    }
    // Replaced by a new name, as a job does it: the old map goes on.
    let archive = write();
    write();
    assert!(verify(&archive).unwrap().damaged.is_empty());
    // Never opened at all.
    for length in [0, 100, 4096, 9000] {
        write();
        cut(length);
        assert_eq!(Archive::open(&path).unwrap_err().exit_code(), 9);
    }
    assert_eq!(Archive::open(folder.path().join("none")).unwrap_err().exit_code(), 8);
}

#[test]
fn another_version_is_refused_as_such() {
    let mut bytes = aligned(&whole(digests(), 100));
    bytes[8] += 1;
    reseal(&mut bytes);
    let error = Archive::from_bytes(&bytes, "new.glow").unwrap_err();
    assert_eq!(error.exit_code(), 4);
    assert!(error.to_string().contains("expected format version 1, got 2"), "{error}");
}

/// Makes the checksums of superblock, directory and trailer valid again, as a forger would.
fn reseal(bytes: &mut [u8]) {
    bytes[60..64].fill(0);
    let crc = crc32c::crc32c(&bytes[..4096]).to_le_bytes();
    bytes[60..64].copy_from_slice(&crc);
    let end = bytes.len();
    let (start, length) = (word(bytes, end - 64) as usize, word(bytes, end - 56) as usize);
    if let Some(directory) = start.checked_add(length).and_then(|stop| bytes.get(start..stop)) {
        let hash = xxh3_64(directory).to_le_bytes();
        bytes[end - 48..end - 40].copy_from_slice(&hash);
    }
    let trailer = end - 64;
    bytes[trailer + 48..trailer + 52].copy_from_slice(&crc);
    bytes[trailer + 52..trailer + 56].fill(0);
    let crc = crc32c::crc32c(&bytes[trailer..]).to_le_bytes();
    bytes[trailer + 52..trailer + 56].copy_from_slice(&crc);
}

#[test]
fn resealing_is_what_the_writer_does() {
    // Else the forged files below would be refused at their checksums and prove nothing.
    let bytes = whole(digests(), 10);
    let mut resealed = bytes.clone();
    reseal(&mut resealed);
    assert!(resealed == bytes);
    let start = word(&bytes, bytes.len() - 64) as usize;
    resealed[start] ^= 1; // the first character of a tag
    reseal(&mut resealed);
    let error = Archive::from_bytes(aligned(&resealed), "forged").unwrap_err().to_string();
    assert!(error.contains("trailer: expected content"), "{error}");
}

/// Opens and touches all that can be touched; returns whether it opened.
fn exercise(bytes: &[u8]) -> bool {
    let Ok(archive) = Archive::from_bytes(bytes, "hostile") else { return false };
    let _ = verify(&archive);
    let touch = |block: Block<'_, &[u8]>| {
        let _ = (block.range(), block.stored().map(<[u8]>::len), block.array::<u32>().map(<[u32]>::len));
    };
    archive.all_blocks().for_each(touch);
    for tag in [ROWS, WEIGHTS, Tag([0xff; 8])] {
        let _ = (archive.array::<u64>(tag).map(<[u64]>::len), tag.to_string());
    }
    true
}

/// The peak of the address space in bytes, where the system tells.
fn peak_address_space() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmPeak:"))?;
    Some(1024 * line.split_whitespace().nth(1)?.parse::<u64>().ok()?)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, rng_seed: RngSeed::Fixed(7), ..ProptestConfig::default() })]

    #[test]
    fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..9000)) {
        prop_assert!(!exercise(&aligned(&bytes)));
    }

    #[test]
    fn forged_files_never_panic(
        changes in prop::collection::vec((any::<prop::sample::Index>(), prop_oneof![
            any::<u8>(), Just(0), Just(0xff), Just(0x7f), Just(0x80)]), 1..8),
        trailer in any::<bool>(),
    ) {
        // Changes in the directory, or in the trailer as well, below checksums that are made valid again.
        let mut bytes = aligned(&whole(digests(), 10));
        let start = word(&bytes, bytes.len() - 64) as usize;
        let span = start..bytes.len() - if trailer { 0 } else { 64 };
        for (at, value) in changes {
            let at = span.start + at.index(span.len());
            bytes[at] = value;
        }
        reseal(&mut bytes);
        exercise(&bytes);
        prop_assert!(peak_address_space().is_none_or(|peak| peak < 8 << 30));
    }

    #[test]
    fn resuming_hostile_bytes_never_panics(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..8),
        cut in any::<prop::sample::Index>(),
    ) {
        let mut bytes = whole(digests(), 10);
        let length = bytes.len();
        for (at, value) in changes {
            bytes[4096 + at.index(length - 4096)] = value;
        }
        bytes.truncate(4096 + cut.index(length - 4096));
        let (memory, path) = (super::faults::Memory::default(), Path::new("links.glow"));
        memory.put(&partial_path(path), &bytes);
        let (mut writer, _) = Writer::resume_in(Arc::new(memory.clone()), path, KIND, digests()).unwrap();
        fill(&mut writer, 10).unwrap();
        writer.finish(&[("program", "test")]).unwrap();
        prop_assert!(memory.bytes(path).unwrap() == whole(digests(), 10));
    }
}
