//! Reading: opening checks superblock, trailer and directory; each block is checked when it is first touched.

use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU8, Ordering};

use bytemuck::Pod;
use rkyv::util::AlignedVec;
use xxhash_rust::xxh3::xxh3_64;

use super::layout::{ArchivedDirectory, Directory, END_MAGIC, Superblock, TRAILER_BYTES, Trailer, content};
use super::{ALIGNMENT, Access, Digest, Digests, Entry, FORMAT_VERSION, Map, PLAIN, SUPERBLOCK_BYTES, Tag};
use crate::{Error, Result};

/// An open archive over any bytes: a [`Map`] in production, a vector in tests. Opening costs the superblock and the
/// directory, whatever the blocks hold; threads may share it.
#[derive(Debug)]
pub struct Archive<D: AsRef<[u8]> = Map> {
    bytes: D,
    touch: fn(&D, Range<usize>) -> io::Result<()>,
    file: PathBuf,
    superblock: Superblock,
    entries: Vec<Entry>,
    provenance: Vec<(String, String)>,
    content: Digest,
    /// Per block: [`UNTOUCHED`], or [`WHOLE`]. Damaged ones stay untouched and are checked again.
    checked: Vec<AtomicU8>,
}

const UNTOUCHED: u8 = 0;
const WHOLE: u8 = 1;

/// One block of an open archive.
#[derive(Debug)]
pub struct Block<'a, D: AsRef<[u8]> = Map> {
    archive: &'a Archive<D>,
    number: usize,
}

impl<D: AsRef<[u8]>> Clone for Block<'_, D> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<D: AsRef<[u8]>> Copy for Block<'_, D> {}

impl Archive {
    /// Opens a finished file through a read-only map.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Damaged`] when superblock, trailer or directory are not what was written, or the file
    /// is not finished; [`Error::Input`] when another version of the format wrote it.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let map = Map::open(path).map_err(|source| Error::io(path, "opening", source))?;
        Self::over(map, path, Map::touch)
    }

    /// Announces how the blocks are going to be read; advice only, so failures do not matter.
    pub fn advise(&self, access: Access) {
        let _ = self.bytes.advise(access);
    }
}

impl Block<'_> {
    /// Asks for the block to be read in the background; advice only, so failures do not matter.
    pub fn prefetch(&self) {
        let _ = self.archive.bytes.prefetch(self.span());
    }
}

impl<D: AsRef<[u8]>> Archive<D> {
    /// Opens bytes; errors call them `name`. Arrays can be borrowed only if the bytes are aligned to 64.
    ///
    /// # Errors
    /// As [`Archive::open`].
    pub fn from_bytes(bytes: D, name: impl AsRef<Path>) -> Result<Self> {
        Self::over(bytes, name.as_ref(), |_, _| Ok(()))
    }

    fn over(bytes: D, file: &Path, touch: fn(&D, Range<usize>) -> io::Result<()>) -> Result<Self> {
        let damaged =
            |place: &str, problem| Error::Damaged { file: file.into(), place: place.into(), problem };
        let reached = |range| touch(&bytes, range).map_err(|source| unreadable(file, "the file", source));
        let all = bytes.as_ref();
        reached(0..all.len().min(SUPERBLOCK_BYTES))?;
        let superblock = Superblock::read(all).map_err(|problem| damaged("superblock", problem))?;
        if superblock.version != FORMAT_VERSION {
            let problem = format!("expected format version {FORMAT_VERSION}, got {}", superblock.version);
            return Err(Error::input(
                file,
                "superblock",
                problem,
                "use the glowtree that wrote it, or bake again",
            ));
        }
        reached(all.len().saturating_sub(TRAILER_BYTES)..all.len())?;
        let trailer = read_trailer(all, superblock.crc).map_err(|problem| damaged("trailer", problem))?;
        let start = trailer.directory_offset as usize;
        reached(start..all.len())?;
        let directory = read_directory(all, &trailer).map_err(|problem| damaged("directory", problem))?;
        let Directory { entries, provenance } = directory;
        check_chain(&entries, trailer.directory_offset).map_err(|problem| damaged("directory", problem))?;
        let content = content(&entries, superblock.crc);
        if content.0 != trailer.content {
            let problem = format!("expected content {}, got {content}", Digest(trailer.content));
            return Err(damaged("trailer", problem));
        }
        let checked = entries.iter().map(|_| AtomicU8::new(UNTOUCHED)).collect();
        Ok(Self { bytes, touch, file: file.into(), superblock, entries, provenance, content, checked })
    }

    /// The path or name it was opened by.
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// What kind of file it is.
    pub fn kind(&self) -> Tag {
        self.superblock.kind
    }

    /// What it was made from.
    pub fn digests(&self) -> Digests {
        self.superblock.digests()
    }

    /// Digest of all blocks with their tags, ranges and order, and of the superblock; not of the provenance. A later
    /// stage takes it as the digest of its input.
    pub fn content(&self) -> Digest {
        self.content
    }

    /// Pairs of name and text that say how it was made.
    pub fn provenance(&self) -> &[(String, String)] {
        &self.provenance
    }

    /// The length of the file in bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes.as_ref().len() as u64
    }

    /// Refuses a file of another kind.
    ///
    /// # Errors
    /// [`Error::JobDiffers`] with both kinds.
    pub fn expect_kind(&self, kind: Tag) -> Result<()> {
        self.expect_superblock(Superblock::new(kind, self.digests()))
    }

    /// Refuses a stale file: one made from other inputs or options.
    ///
    /// # Errors
    /// [`Error::JobDiffers`] naming which of them differs, with both digests.
    pub fn expect(&self, inputs: Digest, options: Digest) -> Result<()> {
        self.expect_superblock(Superblock::new(self.kind(), Digests { inputs, options }))
    }

    fn expect_superblock(&self, wanted: Superblock) -> Result<()> {
        if wanted == self.superblock {
            return Ok(());
        }
        Err(Error::JobDiffers { job: self.file.clone(), difference: self.superblock.difference(&wanted) })
    }

    /// Checks once more the touched blocks of those tags that were copied. What was copied out of them since their first
    /// touch is what was written, if this holds: a file that another program overwrites or cuts meanwhile is noticed.
    ///
    /// # Errors
    /// As [`Block::stored`].
    pub fn confirm(&self, copied: impl Fn(Tag) -> bool) -> Result<()> {
        let touched = |block: &Block<'_, D>| {
            copied(block.entry().tag) && self.checked[block.number].load(Ordering::Relaxed) == WHOLE
        };
        self.all_blocks().filter(touched).try_for_each(|block| block.recheck())
    }

    /// All blocks in file order.
    pub fn all_blocks(&self) -> impl Iterator<Item = Block<'_, D>> {
        (0..self.entries.len()).map(|number| Block { archive: self, number })
    }

    /// The block at this position in the file.
    ///
    /// # Panics
    /// When there are not so many.
    pub fn block(&self, number: usize) -> Block<'_, D> {
        assert!(number < self.entries.len(), "block {number} of {}", self.entries.len());
        Block { archive: self, number }
    }

    /// The blocks with a tag, in file order.
    pub fn blocks(&self, tag: Tag) -> impl Iterator<Item = Block<'_, D>> {
        self.all_blocks().filter(move |block| block.entry().tag == tag)
    }

    /// The array of the only block with a tag.
    ///
    /// # Errors
    /// [`Error::Damaged`] when there is none or there are several, when its values have another width, or when its
    /// checksum fails; [`Error::Io`] when it cannot be read.
    pub fn array<T: Pod>(&self, tag: Tag) -> Result<&[T]> {
        let mut blocks = self.blocks(tag);
        match (blocks.next(), blocks.count()) {
            (Some(block), 0) => block.array(),
            (first, more) => {
                let problem = format!("expected one block, got {}", usize::from(first.is_some()) + more);
                Err(Error::Damaged { file: self.file.clone(), place: tag.to_string(), problem })
            }
        }
    }
}

impl<'a, D: AsRef<[u8]>> Block<'a, D> {
    /// Its position in the file.
    pub fn number(&self) -> usize {
        self.number
    }

    /// Its line of the directory.
    pub fn entry(&self) -> &'a Entry {
        &self.archive.entries[self.number]
    }

    /// The receivers, rows, triangles … that it covers.
    pub fn range(&self) -> Range<u64> {
        self.entry().range()
    }

    /// The array, borrowed from the file.
    ///
    /// # Errors
    /// As [`Archive::array`]; also when the block is encoded.
    pub fn array<T: Pod>(&self) -> Result<&'a [T]> {
        let entry = self.entry();
        if entry.codec != PLAIN {
            return Err(self.damaged(format!("expected codec {PLAIN}, got {}", entry.codec)));
        }
        if usize::from(entry.width_bytes) != size_of::<T>() {
            let [expected, got] = [size_of::<T>(), usize::from(entry.width_bytes)];
            return Err(self.damaged(format!("expected values of {expected} bytes, got {got}")));
        }
        bytemuck::try_cast_slice(self.stored()?)
            .map_err(|error| self.damaged(format!("expected {ALIGNMENT}-byte alignment: {error}")))
    }

    /// The array of a plain block that was found whole before; None for any other. Neither the system nor the checksum is
    /// asked again, so that a ray may ask: should the file be cut meanwhile, the process leaves as
    /// [`leave_when_cut`](super::leave_when_cut) has it.
    pub fn known<T: Pod>(&self) -> Option<&'a [T]> {
        let entry = self.entry();
        let whole = self.archive.checked[self.number].load(Ordering::Relaxed) == WHOLE;
        let fits = entry.codec == PLAIN && usize::from(entry.width_bytes) == size_of::<T>();
        if whole && fits { bytemuck::try_cast_slice(self.payload()).ok() } else { None }
    }

    /// The stored bytes, encoded as [`Entry::codec`] says. [`Entry::raw_bytes`] is a claim: bound what it makes you
    /// allocate. Each call asks the system whether the file is still whole, so keep the slice rather than ask per row.
    ///
    /// # Errors
    /// [`Error::Damaged`] when the checksum fails; [`Error::Io`] when it cannot be read.
    pub fn stored(&self) -> Result<&'a [u8]> {
        // Relaxed: the flag guards no other memory; at worst two threads check the same block.
        let checked = &self.archive.checked[self.number];
        if checked.load(Ordering::Relaxed) == WHOLE {
            self.reach(0..0)?;
        } else {
            self.recheck()?;
            checked.store(WHOLE, Ordering::Relaxed);
        }
        Ok(self.payload())
    }

    /// Checks header, payload and padding against the directory, now.
    ///
    /// # Errors
    /// As [`Block::stored`].
    pub fn recheck(&self) -> Result<()> {
        let archive = self.archive;
        self.reach(self.span())?;
        let span = &archive.bytes.as_ref()[self.span()];
        let header = self.entry().header(self.number as u32, archive.superblock.crc);
        let (stored_header, rest) = span.split_at(size_of_val(&header));
        if stored_header != bytemuck::bytes_of(&header) {
            return Err(self.damaged("expected the header that the directory lists, got another".into()));
        }
        let (payload, padding) = rest.split_at(self.entry().stored_bytes as usize);
        let hash = xxh3_64(payload);
        if hash != self.entry().hash {
            return Err(
                self.damaged(format!("expected checksum {:016x}, got {hash:016x}", self.entry().hash))
            );
        }
        if padding.iter().any(|&byte| byte != 0) {
            return Err(self.damaged("expected zeros after the payload, got other bytes".into()));
        }
        Ok(())
    }

    /// Header, payload and padding; within the file, as opening has checked.
    fn span(&self) -> Range<usize> {
        let next = self.archive.entries.get(self.number + 1);
        let end = next.map_or_else(|| self.entry().end().unwrap_or(0), |next| next.offset);
        self.entry().offset as usize..end as usize
    }

    fn reach(&self, range: Range<usize>) -> Result<()> {
        let archive = self.archive;
        (archive.touch)(&archive.bytes, range)
            .map_err(|source| unreadable(&archive.file, &self.place(), source))
    }

    fn payload(&self) -> &'a [u8] {
        let start = self.entry().payload().unwrap_or(0) as usize;
        &self.archive.bytes.as_ref()[start..start + self.entry().stored_bytes as usize]
    }

    fn place(&self) -> String {
        format!("block {} {}", self.number, self.entry().tag)
    }

    fn damaged(&self, problem: String) -> Error {
        Error::Damaged { file: self.archive.file.clone(), place: self.place(), problem }
    }
}

/// A file cut short under the reader is damage; anything else is the system's.
fn unreadable(file: &Path, place: &str, source: io::Error) -> Error {
    if source.kind() == io::ErrorKind::UnexpectedEof {
        return Error::Damaged { file: file.into(), place: place.into(), problem: source.to_string() };
    }
    Error::io(file, format!("reading {place}"), source)
}

/// The trailer, if the file has one that agrees with its length.
fn read_trailer(all: &[u8], salt: u32) -> Result<Trailer, String> {
    let start = all.len().saturating_sub(TRAILER_BYTES).max(SUPERBLOCK_BYTES);
    let bytes = &all[start..];
    if bytes.len() != TRAILER_BYTES {
        return Err(format!("expected {TRAILER_BYTES} bytes, got {}: unfinished or cut short", bytes.len()));
    }
    let trailer: Trailer = bytemuck::pod_read_unaligned(bytes);
    if trailer.magic != END_MAGIC {
        return Err("expected the end mark, got none: unfinished or cut short".into());
    }
    if trailer.checksum() != trailer.crc {
        return Err(format!("expected checksum {:08x}, got {:08x}", trailer.checksum(), trailer.crc));
    }
    if trailer.salt != salt {
        return Err(format!("expected superblock {salt:08x}, got {:08x}", trailer.salt));
    }
    let padded = trailer.directory_bytes.checked_next_multiple_of(ALIGNMENT as u64);
    let end = padded
        .and_then(|padded| trailer.directory_offset.checked_add(padded))
        .and_then(|end| end.checked_add(TRAILER_BYTES as u64));
    if trailer.directory_offset < SUPERBLOCK_BYTES as u64 || end != Some(trailer.file_bytes) {
        return Err("expected a directory between the superblock and the trailer, got one elsewhere".into());
    }
    if trailer.file_bytes != all.len() as u64 {
        return Err(format!("expected a file of {} bytes, got {}", trailer.file_bytes, all.len()));
    }
    Ok(trailer)
}

/// The directory, once its hash and then its structure have been checked.
fn read_directory(all: &[u8], trailer: &Trailer) -> Result<Directory, String> {
    let padded = &all[trailer.directory_offset as usize..all.len() - TRAILER_BYTES];
    let (bytes, padding) = padded.split_at(trailer.directory_bytes as usize);
    let hash = xxh3_64(bytes);
    if hash != trailer.directory_hash {
        return Err(format!("expected checksum {:016x}, got {hash:016x}", trailer.directory_hash));
    }
    if padding.iter().any(|&byte| byte != 0) {
        return Err("expected zeros after the directory, got other bytes".into());
    }
    if bytes.as_ptr().align_offset(align_of::<ArchivedDirectory>()) == 0 {
        return deserialize(bytes);
    }
    let mut aligned = AlignedVec::<ALIGNMENT>::with_capacity(bytes.len());
    aligned.extend_from_slice(bytes);
    deserialize(&aligned)
}

/// The directory's owned form takes about as many bytes as the archived one that was validated.
fn deserialize(bytes: &[u8]) -> Result<Directory, String> {
    use rkyv::rancor::BoxedError;
    let archived = rkyv::access::<ArchivedDirectory, BoxedError>(bytes).map_err(|error| error.to_string())?;
    rkyv::deserialize::<Directory, BoxedError>(archived).map_err(|error| error.to_string())
}

/// Whether the blocks follow each other without a gap from the superblock to the directory, so that every byte of
/// the file is under some checksum and every later offset is within it.
fn check_chain(entries: &[Entry], directory_offset: u64) -> Result<(), String> {
    let mut expected = SUPERBLOCK_BYTES as u64;
    for (number, entry) in entries.iter().enumerate() {
        if entry.offset != expected || !entry.is_consistent() {
            return Err(format!(
                "expected block {number} at byte {expected} with consistent lengths, got {entry:?}"
            ));
        }
        expected = entry.end().filter(|&end| end <= directory_offset).ok_or_else(|| {
            format!("expected block {number} to end before byte {directory_offset}, got {entry:?}")
        })?;
    }
    if expected != directory_offset {
        return Err(format!("expected blocks up to byte {directory_offset}, got {expected}"));
    }
    Ok(())
}
