//! The archive: what is written is read; what is damaged, torn, stale or unfinished is refused by name.
#![allow(clippy::unwrap_used)]

use glowtree::Error;
use glowtree::archive::{
    Archive, Digest, Digests, Encoded, SUPERBLOCK_BYTES, Tag, Writer, partial_path, verify,
};
use rkyv::util::AlignedVec;

const KIND: Tag = Tag::new("links");
const ROWS: Tag = Tag::new("rows");
const WEIGHTS: Tag = Tag::new("weights");
const PACKED: Tag = Tag::new("packed");

fn digests() -> Digests {
    Digests { inputs: Digest::of_bytes(b"inputs"), options: Digest::of_bytes(b"options") }
}

/// A small file with blocks of several widths, an empty one, an encoded one and ragged lengths.
fn fill(writer: &mut Writer) {
    let rows: Vec<u64> = (0..101).map(|row| row * row).collect();
    let weights: Vec<f32> = (0..999).map(|index| 1.0 / (1.0 + index as f32)).collect();
    let halves: Vec<u16> = (0..37).collect();
    writer.append(ROWS, 0..100, &rows).unwrap();
    writer.append(WEIGHTS, 0..50, &weights[..501]).unwrap();
    writer.append(WEIGHTS, 50..100, &weights[501..]).unwrap();
    writer.append(Tag::new("empty"), 7..7, &[0_u8; 0]).unwrap();
    writer.append(Tag::new("halves"), 0..37, &halves).unwrap();
    let packed = Encoded { codec: 3, element_bytes: 4, raw_bytes: 400, bytes: b"delta" };
    writer.append_bytes(PACKED, 0..100, packed).unwrap();
}

fn aligned(bytes: &[u8]) -> AlignedVec<64> {
    let mut copy = AlignedVec::with_capacity(bytes.len());
    copy.extend_from_slice(bytes);
    copy
}

#[test]
fn what_is_written_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("links.glow");
    let mut writer = Writer::create(&path, KIND, digests()).unwrap();
    fill(&mut writer);
    assert!(!path.exists(), "an unfinished archive must not carry its name");
    let finished = writer.finish(&[("program", "test")]).unwrap();
    assert!(!partial_path(&path).exists());
    assert_eq!(finished.bytes, std::fs::metadata(&path).unwrap().len());

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
    assert_eq!((weights.len(), weights[998]), (999, 1.0 / 999.0));
    assert_eq!(archive.blocks(WEIGHTS).nth(1).unwrap().range(), 50..100);
    assert!(archive.array::<u8>(Tag::new("empty")).unwrap().is_empty());
    let packed = archive.blocks(PACKED).next().unwrap();
    assert_eq!((packed.entry().codec, packed.stored().unwrap()), (3, &b"delta"[..]));
    assert!(verify(&archive).unwrap().damaged.is_empty());

    let bytes = std::fs::read(&path).unwrap();
    assert_eq!(Archive::from_bytes(aligned(&bytes), "memory").unwrap().array::<u64>(ROWS).unwrap(), rows);
}

#[test]
fn what_is_asked_wrongly_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("links.glow");
    let mut writer = Writer::create(&path, KIND, digests()).unwrap();
    fill(&mut writer);
    writer.finish(&[]).unwrap();
    let archive = Archive::open(&path).unwrap();
    let said = |outcome: glowtree::Result<()>| outcome.unwrap_err().to_string();
    let missing = said(archive.array::<u8>(Tag::new("nothing")).map(|_| ()));
    assert!(missing.contains("`nothing`") && missing.contains("expected one block, got 0"), "{missing}");
    let several = said(archive.array::<f32>(WEIGHTS).map(|_| ()));
    assert!(several.contains("expected one block, got 2"), "{several}");
    let width = said(archive.array::<u32>(ROWS).map(|_| ()));
    assert!(width.contains("block 0 `rows`: expected elements of 4 bytes, got 8"), "{width}");
    let codec = said(archive.array::<u32>(PACKED).map(|_| ()));
    assert!(codec.contains("expected codec 0, got 3"), "{codec}");

    let stale = archive.expect(digests().inputs, Digest::of_bytes(b"other")).unwrap_err();
    assert_eq!(stale.exit_code(), 3);
    let text = stale.to_string();
    assert!(text.contains("digest of options") && !text.contains("digest of inputs"), "{text}");
    assert!(said(archive.expect_kind(ROWS)).contains("kind of file `links` there, `rows` now"));
}

#[test]
fn a_killed_writer_is_resumed_from_its_whole_blocks() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, path) = (folder.path().join("whole.glow"), folder.path().join("links.glow"));
    let mut writer = Writer::create(&whole, KIND, digests()).unwrap();
    fill(&mut writer);
    writer.finish(&[]).unwrap();
    let expected = std::fs::read(&whole).unwrap();

    // Cut at every length, the finished length included (killed between the trailer and the rename).
    for length in 0..=expected.len() {
        std::fs::write(partial_path(&path), &expected[..length]).unwrap();
        let (mut writer, resumed) = Writer::resume(&path, KIND, digests()).unwrap();
        assert_eq!(resumed.blocks, writer.entries().len());
        let kept = writer.bytes();
        let superblock = if length < SUPERBLOCK_BYTES { kept } else { 0 }; // written anew when it was torn
        assert_eq!(kept - superblock + resumed.dropped_bytes, length as u64);
        append_missing(&whole, &mut writer);
        writer.finish(&[]).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), expected, "cut at {length}");
    }

    std::fs::write(partial_path(&path), &expected).unwrap();
    let other = Digests { inputs: Digest::of_bytes(b"other"), ..digests() };
    let stale = Writer::resume(&path, KIND, other).unwrap_err();
    assert!(
        matches!(&stale, Error::JobDiffers { difference, .. } if difference.contains("digest of inputs"))
    );
}

/// Appends the blocks of a finished file that the writer does not have yet.
fn append_missing(whole: &std::path::Path, writer: &mut Writer) {
    let archive = Archive::open(whole).unwrap();
    for block in archive.all_blocks().skip(writer.entries().len()) {
        let entry = block.entry();
        let payload = Encoded {
            codec: entry.codec,
            element_bytes: entry.element_bytes,
            raw_bytes: entry.raw_bytes,
            bytes: block.stored().unwrap(),
        };
        writer.append_bytes(entry.tag, block.range(), payload).unwrap();
    }
}
