//! Row R8 at the level of a job: flips spread over all four archives.

use glowtree::archive::{Archive, verify};
use glowtree::bake::verify::ARCHIVES;
use glowtree::geometry::hash;
use rkyv::util::AlignedVec;

use super::baked;

/// Flips that each push tries; a release tries more (`GLOWTREE_FLIPS`).
const FLIPS: u64 = 10_000;

#[test]
fn ten_thousand_flips_are_all_detected() {
    let read = |kind: &str| {
        let bytes = std::fs::read(baked().job().join(format!("{kind}.glow"))).unwrap();
        let mut aligned = AlignedVec::<64>::with_capacity(bytes.len());
        aligned.extend_from_slice(&bytes);
        aligned
    };
    let mut files: Vec<AlignedVec<64>> = ARCHIVES.iter().map(|kind| read(kind)).collect();
    let detected = |bytes: &[u8]| {
        Archive::from_bytes(bytes, "flipped").map_or(true, |a| !verify(&a).unwrap().damaged.is_empty())
    };
    assert!(files.iter().all(|bytes| !detected(bytes)), "whole files must pass, or this test proves nothing");
    let total: u64 = files.iter().map(|bytes| 8 * bytes.len() as u64).sum();
    let flips = std::env::var("GLOWTREE_FLIPS").ok().and_then(|n| n.parse().ok()).unwrap_or(FLIPS);
    let mut missed = Vec::new();
    for k in 0..flips {
        // Equal strides over all bits, jittered: seed 8.
        let bit = (u128::from(total) * u128::from(k) / u128::from(flips)) as u64;
        let mut bit = (bit + hash::mix2(8, k) % (total / flips).max(1)).min(total - 1);
        for (kind, bytes) in ARCHIVES.iter().zip(&mut files) {
            if bit >= 8 * bytes.len() as u64 {
                bit -= 8 * bytes.len() as u64;
                continue;
            }
            bytes[bit as usize / 8] ^= 1 << (bit % 8);
            if !detected(bytes) {
                missed.push((*kind, bit));
            }
            bytes[bit as usize / 8] ^= 1 << (bit % 8);
            break;
        }
    }
    println!("{flips} flips over {} bytes, {} not detected", total / 8, missed.len());
    assert_eq!(missed, []);
}
