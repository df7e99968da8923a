//! What an archive looks like in bytes: superblock, block headers, directory, trailer (`docs/format.md`).

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

use super::Digest;

/// Bytes before the first block: one page, so that payloads keep their alignment in a map.
pub const SUPERBLOCK_BYTES: usize = 4096;
/// Alignment of every payload, in bytes: a cache line, and enough for any vector load.
pub const ALIGNMENT: usize = 64;
/// Version of the format; a reader reads this one and no other.
pub const FORMAT_VERSION: u32 = 1;
/// The codec of blocks that are flat arrays as they are in memory.
pub const PLAIN: u16 = 0;

/// As in PNG: a byte above 127, a CR LF and a control character show transfers that damage binary files.
pub(super) const MAGIC: [u8; 8] = *b"\x89GLOW\r\n\x1a";
pub(super) const END_MAGIC: [u8; 8] = *b"\x89GLEND\r\n";
const ENDIAN: u32 = 0x0102_0304;
pub(super) const HEADER_BYTES: usize = 64;
pub(super) const TRAILER_BYTES: usize = 64;

/// Eight bytes that name a kind of file or of block: ASCII, zero-padded.
#[derive(
    Clone,
    Copy,
    PartialEq,
    Eq,
    Hash,
    PartialOrd,
    Ord,
    Pod,
    Zeroable,
    rkyv::Archive,
    rkyv::Serialize,
    rkyv::Deserialize,
)]
#[repr(transparent)]
pub struct Tag(pub [u8; 8]);

impl Tag {
    /// The tag of a name of one to eight printable ASCII characters; anything else panics (at compile time for constants).
    pub const fn new(name: &str) -> Self {
        let name = name.as_bytes();
        assert!(!name.is_empty() && name.len() <= 8, "a tag has one to eight characters");
        let mut tag = [0; 8];
        let mut index = 0;
        while index < name.len() {
            assert!(name[index].is_ascii_graphic(), "a tag is printable ASCII");
            tag[index] = name[index];
            index += 1;
        }
        Self(tag)
    }
}

impl std::fmt::Display for Tag {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let end = self.0.iter().rposition(|&byte| byte != 0).map_or(0, |last| last + 1);
        write!(formatter, "`{}`", self.0[..end].escape_ascii())
    }
}

impl std::fmt::Debug for Tag {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "Tag({self})")
    }
}

/// What a file was made from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Digests {
    /// Digest of every input file or earlier stage.
    pub inputs: Digest,
    /// Digest of the options that matter to this stage.
    pub options: Digest,
}

/// The first 64 bytes of a file; the rest of its page is zero and under the same checksum.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Superblock {
    pub magic: [u8; 8],
    pub version: u32,
    pub endian: u32,
    pub kind: Tag,
    pub inputs: [u8; 16],
    pub options: [u8; 16],
    reserved: u32,
    /// crc32c of the 4,096 bytes with this field zero; also the `salt` of every block.
    pub crc: u32,
}

impl Superblock {
    pub fn new(kind: Tag, digests: Digests) -> Self {
        let mut superblock = Self {
            magic: MAGIC,
            version: FORMAT_VERSION,
            endian: ENDIAN,
            kind,
            inputs: digests.inputs.0,
            options: digests.options.0,
            reserved: 0,
            crc: 0,
        };
        superblock.crc = crc32c::crc32c(&superblock.page());
        superblock
    }

    pub fn page(&self) -> [u8; SUPERBLOCK_BYTES] {
        let mut page = [0; SUPERBLOCK_BYTES];
        page[..size_of::<Self>()].copy_from_slice(bytemuck::bytes_of(self));
        page
    }

    /// The superblock of a page, or what is wrong with it as "expected …, got …".
    pub fn read(page: &[u8]) -> Result<Self, String> {
        if page.len() < SUPERBLOCK_BYTES {
            return Err(format!("expected {SUPERBLOCK_BYTES} bytes, got {}", page.len()));
        }
        let superblock: Self = bytemuck::pod_read_unaligned(&page[..size_of::<Self>()]);
        if superblock.magic != MAGIC {
            let [expected, got] = [MAGIC.escape_ascii(), superblock.magic.escape_ascii()];
            return Err(format!("expected magic `{expected}`, got `{got}`"));
        }
        let zeroed = Self { crc: 0, ..superblock };
        let crc = crc32c::crc32c_append(
            crc32c::crc32c(bytemuck::bytes_of(&zeroed)),
            &page[size_of::<Self>()..SUPERBLOCK_BYTES],
        );
        if crc != superblock.crc {
            return Err(format!("expected checksum {crc:08x}, got {:08x}", superblock.crc));
        }
        if superblock.endian != ENDIAN {
            return Err(format!("expected endian tag {ENDIAN:08x}, got {:08x}", superblock.endian));
        }
        Ok(superblock)
    }

    pub fn digests(&self) -> Digests {
        Digests { inputs: Digest(self.inputs), options: Digest(self.options) }
    }

    /// What differs between this superblock, found in a file, and the one wanted.
    pub fn difference(&self, wanted: &Self) -> String {
        let mut differences = Vec::new();
        let mut compare = |name: &str, there: String, now: String| {
            if there != now {
                differences.push(format!("{name} {there} there, {now} now"));
            }
        };
        compare("format version", self.version.to_string(), wanted.version.to_string());
        compare("kind of file", self.kind.to_string(), wanted.kind.to_string());
        let (there, now) = (self.digests(), wanted.digests());
        compare("digest of inputs", there.inputs.to_string(), now.inputs.to_string());
        compare("digest of options", there.options.to_string(), now.options.to_string());
        differences.join("; ")
    }
}

/// The 64 bytes before each payload.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct BlockHeader {
    pub tag: Tag,
    pub first: u64,
    pub count: u64,
    pub raw_bytes: u64,
    pub stored_bytes: u64,
    pub hash: u64,
    pub codec: u16,
    pub width_bytes: u16,
    pub number: u32,
    pub salt: u32,
    /// crc32c of the 60 bytes before.
    pub crc: u32,
}

impl BlockHeader {
    /// The entry that this header describes, if it is block `number` of a file with this `salt` and starts at `offset`.
    pub fn entry(&self, number: u32, salt: u32, offset: u64) -> Option<Entry> {
        let entry = Entry {
            tag: self.tag,
            first: self.first,
            count: self.count,
            offset,
            raw_bytes: self.raw_bytes,
            stored_bytes: self.stored_bytes,
            hash: self.hash,
            codec: self.codec,
            width_bytes: self.width_bytes,
        };
        (entry.header(number, salt) == *self).then_some(entry)
    }
}

/// One block, as the directory lists it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, rkyv::Archive, rkyv::Serialize, rkyv::Deserialize)]
pub struct Entry {
    /// What the block holds.
    pub tag: Tag,
    /// First receiver, row, triangle … that it covers.
    pub first: u64,
    /// How many of them it covers.
    pub count: u64,
    /// Where its header starts in the file, in bytes.
    pub offset: u64,
    /// Length of the decoded payload in bytes.
    pub raw_bytes: u64,
    /// Length of the stored payload in bytes, without padding.
    pub stored_bytes: u64,
    /// xxh3-64 of the stored payload.
    pub hash: u64,
    /// How the payload is encoded; [`PLAIN`] is a flat array.
    pub codec: u16,
    /// Width of one value of the decoded array in bytes.
    pub width_bytes: u16,
}

impl Entry {
    /// The receivers, rows, triangles … that the block covers.
    pub fn range(&self) -> Range<u64> {
        self.first..self.first.saturating_add(self.count)
    }

    /// The header that stands before the payload.
    pub(super) fn header(&self, number: u32, salt: u32) -> BlockHeader {
        let mut header = BlockHeader {
            tag: self.tag,
            first: self.first,
            count: self.count,
            raw_bytes: self.raw_bytes,
            stored_bytes: self.stored_bytes,
            hash: self.hash,
            codec: self.codec,
            width_bytes: self.width_bytes,
            number,
            salt,
            crc: 0,
        };
        header.crc = crc32c::crc32c(&bytemuck::bytes_of(&header)[..HEADER_BYTES - size_of::<u32>()]);
        header
    }

    /// Where the payload starts.
    pub(super) fn payload(&self) -> Option<u64> {
        self.offset.checked_add(HEADER_BYTES as u64)
    }

    /// Where the next block starts: payloads are padded with zeros to the alignment.
    pub(super) fn end(&self) -> Option<u64> {
        self.payload()?.checked_add(self.stored_bytes)?.checked_next_multiple_of(ALIGNMENT as u64)
    }

    /// Whether the lengths agree with the codec and the width.
    pub(super) fn is_consistent(&self) -> bool {
        let width = u64::from(self.width_bytes);
        let whole = width > 0 && self.raw_bytes.is_multiple_of(width);
        whole
            && self.first.checked_add(self.count).is_some()
            && (self.codec != PLAIN || self.raw_bytes == self.stored_bytes)
    }
}

/// The table at the end of a file, archived by rkyv.
#[derive(rkyv::Archive, rkyv::Serialize, rkyv::Deserialize)]
pub(super) struct Directory {
    pub entries: Vec<Entry>,
    pub provenance: Vec<(String, String)>,
}

/// The last 64 bytes of a finished file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Trailer {
    pub directory_offset: u64,
    pub directory_bytes: u64,
    pub directory_hash: u64,
    pub file_bytes: u64,
    pub content: [u8; 16],
    pub salt: u32,
    /// crc32c of the 64 bytes with this field zero.
    pub crc: u32,
    pub magic: [u8; 8],
}

impl Trailer {
    pub fn new(directory_offset: u64, directory: &[u8], content: Digest, salt: u32) -> Self {
        let directory_bytes = directory.len() as u64;
        let padded = directory_bytes.next_multiple_of(ALIGNMENT as u64);
        let mut trailer = Self {
            directory_offset,
            directory_bytes,
            directory_hash: xxh3_64(directory),
            file_bytes: directory_offset + padded + TRAILER_BYTES as u64,
            content: content.0,
            salt,
            crc: 0,
            magic: END_MAGIC,
        };
        trailer.crc = trailer.checksum();
        trailer
    }

    pub fn checksum(&self) -> u32 {
        crc32c::crc32c(bytemuck::bytes_of(&Self { crc: 0, ..*self }))
    }
}

/// The digest of all blocks in order: of their headers, which hold the hashes of their payloads.
pub(super) fn content(entries: &[Entry], salt: u32) -> Digest {
    let mut hash = Xxh3::new();
    for (number, entry) in (0..).zip(entries) {
        hash.update(bytemuck::bytes_of(&entry.header(number, salt)));
    }
    Digest(hash.digest128().to_le_bytes())
}

/// The zeros after a payload of this length.
pub(super) fn padding(bytes: usize) -> &'static [u8] {
    const ZEROS: [u8; ALIGNMENT] = [0; ALIGNMENT];
    &ZEROS[..bytes.next_multiple_of(ALIGNMENT) - bytes]
}
