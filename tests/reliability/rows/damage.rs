//! R8: a bit of an archive turns over.

use std::path::Path;
use std::sync::Arc;

use glowtree::archive::{Archive, Digest, Digests, Tag, Writer, verify};
use rkyv::util::AlignedVec;

use super::super::faults::Memory;
use super::super::tally::{Tally, broken};
use crate::ask::Ask;

/// Bits that one trial flips, one after another.
const BITS: u64 = 8192;

/// Every bit of an archive of 64 KiB: opening or verifying tells. Splices, swaps and cuts are in `tests/archive`.
pub fn bits(_: &Ask, tally: &Tally) {
    let archive = archive();
    let all = 8 * archive.len() as u64;
    let count = tally.at_most(all);
    tally.remark(format!("an archive of {} bytes", archive.len()));
    tally.trials(count.div_ceil(BITS), |trial| {
        let mut bytes = AlignedVec::<64>::new();
        bytes.extend_from_slice(&archive);
        let mut silent = Vec::new();
        let range = trial * BITS..count.min((trial + 1) * BITS);
        tally.count(range.end - range.start - 1);
        for bit in range {
            let (byte, mask) = ((bit / 8) as usize, 1 << (bit % 8));
            bytes[byte] ^= mask;
            if !is_detected(&bytes) {
                silent.push(bit);
            }
            bytes[byte] ^= mask;
        }
        let outcome = if silent.is_empty() {
            Ok(())
        } else {
            Err(super::super::tally::Bad::Wrong(format!("bits {silent:?} were not seen")))
        };
        (format!("bits from {}", trial * BITS), outcome)
    });
    if is_detected(&archive) {
        tally.trial("the whole archive", || broken("is called damaged"));
    }
}

fn is_detected(bytes: &[u8]) -> bool {
    Archive::from_bytes(bytes, "flipped")
        .map_or(true, |archive| !verify(&archive).unwrap().damaged.is_empty())
}

/// 64 KiB: superblock, three blocks of words, directory, trailer.
fn archive() -> AlignedVec<64> {
    let (memory, path) = (Memory::default(), Path::new("links.glow"));
    let digests = Digests { inputs: Digest::of_bytes(b"inputs"), options: Digest::of_bytes(b"options") };
    let mut writer = Writer::create_in(Arc::new(memory.clone()), path, Tag::new("links"), digests).unwrap();
    for block in 0..3_u32 {
        let words: Vec<u32> = (0..5000).map(|word| word * 7 + block).collect();
        writer.append(Tag::new("rows"), 0..5000, &words).unwrap();
    }
    writer.finish(&[("program", "test")]).unwrap();
    let mut bytes = AlignedVec::new();
    bytes.extend_from_slice(&memory.bytes(path).unwrap());
    bytes
}
