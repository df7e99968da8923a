//! The archive: what is written is read; what is damaged, torn, stale or unfinished is refused by name; what fails
//! half-way is continued to the same bytes.
#![allow(clippy::unwrap_used)]

#[path = "archive/damage.rs"]
mod damage;
#[path = "archive/faults.rs"]
mod faults;
#[path = "archive/interruption.rs"]
mod interruption;

use std::path::Path;
use std::sync::Arc;

use glowtree::Result;
use glowtree::archive::{Archive, Digest, Digests, Encoded, Tag, Writer, partial_path, verify};
use rkyv::util::AlignedVec;

const KIND: Tag = Tag::new("links");
const ROWS: Tag = Tag::new("rows");
const WEIGHTS: Tag = Tag::new("weights");
const PACKED: Tag = Tag::new("packed");

fn digests() -> Digests {
    Digests { inputs: Digest::of_bytes(b"inputs"), options: Digest::of_bytes(b"options") }
}

/// Appends the blocks of a small file that the writer does not have yet: several widths, an empty one, an encoded one,
/// ragged lengths, two that are swappable (same tag and length), one longer than what the writer gathers.
fn fill(writer: &mut Writer, long: usize) -> Result<()> {
    let rows: Vec<u64> = (0..101).map(|row| row * row).collect();
    let weights: Vec<f32> = (0..1000).map(|index| 1.0 / (1.0 + index as f32)).collect();
    let halves: Vec<u16> = (0..37).collect();
    let links: Vec<u32> = (0..long as u32).collect();
    let packed = Encoded { codec: 3, width_bytes: 4, raw_bytes: 400, bytes: b"delta" };
    for block in writer.entries().len()..7 {
        match block {
            0 => writer.append(ROWS, 0..100, &rows)?,
            1 => writer.append(WEIGHTS, 0..50, &weights[..500])?,
            2 => writer.append(WEIGHTS, 50..100, &weights[500..])?,
            3 => writer.append(Tag::new("empty"), 7..7, &[0_u8; 0])?,
            4 => {
                writer.append(Tag::new("halves"), 0..37, &halves)?;
                writer.checkpoint()?;
            }
            5 => writer.append(Tag::new("links"), 0..100, &links)?,
            _ => writer.append_bytes(PACKED, 0..100, packed)?,
        }
    }
    Ok(())
}

fn aligned(bytes: &[u8]) -> AlignedVec<64> {
    let mut copy = AlignedVec::with_capacity(bytes.len());
    copy.extend_from_slice(bytes);
    copy
}

/// The bytes of an undisturbed run.
fn whole(digests: Digests, long: usize) -> Vec<u8> {
    let memory = faults::Memory::default();
    let path = Path::new("links.glow");
    let mut writer = Writer::create_in(Arc::new(memory.clone()), path, KIND, digests).unwrap();
    fill(&mut writer, long).unwrap();
    writer.finish(&[("program", "test")]).unwrap();
    memory.bytes(path).unwrap()
}

#[test]
fn what_is_written_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("links.glow");
    let mut writer = Writer::create(&path, KIND, digests()).unwrap();
    writer.reserve(1 << 20).unwrap();
    fill(&mut writer, 100).unwrap();
    assert!(!path.exists(), "an unfinished archive must not carry its name");
    let finished = writer.finish(&[("program", "test")]).unwrap();
    assert!(!partial_path(&path).exists());
    let bytes = std::fs::read(&path).unwrap();
    assert_eq!(finished.bytes, bytes.len() as u64);
    assert!(bytes == whole(digests(), 100), "the disk and the memory storage differ");

    let archive = Archive::open(&path).unwrap();
    archive.expect_kind(KIND).unwrap();
    archive.expect(digests().inputs, digests().options).unwrap();
    assert_eq!(archive.content(), finished.content);
    assert_eq!(archive.provenance(), [("program".to_owned(), "test".to_owned())]);
    let rows: &[u64] = archive.array(ROWS).unwrap();
    assert_eq!((rows.len(), rows[10]), (101, 100));
    assert_eq!(rows.as_ptr().align_offset(64), 0);
    let weights: Vec<f32> =
        archive.blocks(WEIGHTS).flat_map(|block| block.array::<f32>().unwrap().to_vec()).collect();
    assert_eq!((weights.len(), weights[999]), (1000, 1.0 / 1000.0));
    assert_eq!(archive.blocks(WEIGHTS).nth(1).unwrap().range(), 50..100);
    assert!(archive.array::<u8>(Tag::new("empty")).unwrap().is_empty());
    let packed = archive.blocks(PACKED).next().unwrap();
    assert_eq!((packed.entry().codec, packed.stored().unwrap()), (3, &b"delta"[..]));
    let report = verify(&archive).unwrap();
    assert_eq!((report.blocks, report.damaged), (7, vec![]));

    assert_eq!(Archive::from_bytes(aligned(&bytes), "memory").unwrap().array::<u64>(ROWS).unwrap(), rows);
}

#[test]
fn what_is_asked_wrongly_is_refused_by_name() {
    let archive = Archive::from_bytes(aligned(&whole(digests(), 100)), "links.glow").unwrap();
    let said = |outcome: Result<()>| outcome.unwrap_err().to_string();
    let missing = said(archive.array::<u8>(Tag::new("nothing")).map(|_| ()));
    assert!(missing.contains("`nothing`") && missing.contains("expected one block, got 0"), "{missing}");
    let several = said(archive.array::<f32>(WEIGHTS).map(|_| ()));
    assert!(several.contains("expected one block, got 2"), "{several}");
    let width = said(archive.array::<u32>(ROWS).map(|_| ()));
    assert!(width.contains("block 0 `rows`: expected values of 4 bytes, got 8"), "{width}");
    let codec = said(archive.array::<u32>(PACKED).map(|_| ()));
    assert!(codec.contains("expected codec 0, got 3"), "{codec}");

    let stale = archive.expect(digests().inputs, Digest::of_bytes(b"other")).unwrap_err();
    assert_eq!(stale.exit_code(), 3);
    let text = stale.to_string();
    assert!(text.contains("digest of options") && !text.contains("digest of inputs"), "{text}");
    assert!(said(archive.expect_kind(ROWS)).contains("kind of file `links` there, `rows` now"));
}

#[test]
fn bytes_that_are_not_aligned_open_but_lend_no_arrays() {
    let bytes = whole(digests(), 100);
    let mut shifted = aligned(&[0]);
    shifted.extend_from_slice(&bytes);
    let archive = Archive::from_bytes(&shifted[1..], "shifted").unwrap();
    assert!(verify(&archive).unwrap().damaged.is_empty());
    assert!(archive.array::<u64>(ROWS).unwrap_err().to_string().contains("expected 64-byte alignment"));
}

#[test]
fn digests_tell_options_and_files_apart() {
    #[derive(serde::Serialize)]
    struct Options {
        error: f64,
        rays: u32,
    }
    #[derive(serde::Serialize)]
    struct Reordered {
        rays: u32,
        error: f64,
    }
    let digest = Digest::of_options(&Options { error: 0.01, rays: 64 }).unwrap();
    assert_eq!(digest, Digest::of_options(&Reordered { rays: 64, error: 0.01 }).unwrap());
    assert_ne!(digest, Digest::of_options(&Options { error: 0.01, rays: 65 }).unwrap());
    // Known answer: XXH3-128 of nothing is 99aa06d3014798d86001c324468d497f (xxHash's own test vectors).
    assert_eq!(Digest::of_bytes(b"").to_string(), "99aa06d3014798d86001c324468d497f");

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.ply");
    let bytes: Vec<u8> = (0..3_000_000_u32).map(|index| (index * 7 % 251) as u8).collect();
    std::fs::write(&path, &bytes).unwrap();
    assert_eq!(Digest::of_file(&path).unwrap(), Digest::of_bytes(&bytes), "streamed in pieces or at once");
    assert_eq!(Digest::of_file(folder.path().join("none")).unwrap_err().exit_code(), 8);
}
