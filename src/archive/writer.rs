//! Writing: blocks go to a temporary name, the directory and the trailer complete it, a rename publishes it.
//! A writer that was killed is resumed from the blocks that are whole.

use std::io::{self, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bytemuck::Pod;
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

use super::layout::{Directory, HEADER_BYTES, Superblock, TRAILER_BYTES, Trailer, content, padding};
use super::verify::scan;
use super::{
    ALIGNMENT, Block, Digest, Digests, Disk, Entry, PLAIN, SUPERBLOCK_BYTES, Storage, StoredFile, Tag,
};
use crate::{Error, Result};

/// Bytes after which the writer makes its blocks durable by itself: what a power loss costs at most. A smaller
/// value stalls the disk's queue more often, a larger one loses more work.
const CHECKPOINT_BYTES: u64 = 1 << 30;
/// Blocks up to this length are copied together with their header and padding to save two system calls.
const GATHERED_BYTES: usize = 1 << 16;

/// Writes an archive; see the module's example. Dropping it unfinished leaves the temporary file for [`Writer::resume`].
#[derive(Debug)]
pub struct Writer {
    storage: Arc<dyn Storage>,
    file: Box<dyn StoredFile>,
    path: PathBuf,
    partial: PathBuf,
    salt: u32,
    entries: Vec<Entry>,
    /// End of the last whole block.
    end: u64,
    /// End of what is known to be durable.
    synced: u64,
    reserved: u64,
    state: State,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Sound,
    /// A write failed half-way: cut the file back to `end` before the next one.
    Torn,
    /// A sync failed: what the file holds is unknown, and blocks were given up.
    Lost,
}

/// A payload that a codec made.
#[derive(Clone, Copy, Debug)]
pub struct Encoded<'a> {
    /// Number of the codec; its meaning is the caller's.
    pub codec: u16,
    /// Width of one decoded value in bytes, at least one.
    pub width_bytes: u16,
    /// Length of the decoded array in bytes.
    pub raw_bytes: u64,
    /// The encoded bytes.
    pub bytes: &'a [u8],
}

/// What [`Writer::finish`] wrote.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finished {
    /// The finished file.
    pub path: PathBuf,
    /// Its length.
    pub bytes: u64,
    /// Its number of blocks.
    pub blocks: usize,
    /// Digest of all blocks with their tags, ranges and order, and of the superblock; not of the provenance.
    pub content: Digest,
}

/// What [`Writer::resume`] found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Resumed {
    /// Blocks that were whole and are kept; [`Writer::entries`] lists them.
    pub blocks: usize,
    /// Bytes of a torn or damaged tail that were dropped.
    pub dropped_bytes: u64,
}

/// The temporary name of an archive while it is written: in the same directory, so that the rename is atomic, and
/// always the same, so that a resume finds it.
pub fn partial_path(path: impl AsRef<Path>) -> PathBuf {
    let mut name = path.as_ref().as_os_str().to_owned();
    name.push(".partial");
    name.into()
}

impl Writer {
    /// Starts an archive that will be called `path`; an unfinished one of that name is discarded.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::DiskFull`].
    pub fn create(path: impl AsRef<Path>, kind: Tag, digests: Digests) -> Result<Self> {
        Self::create_in(Arc::new(Disk), path.as_ref(), kind, digests)
    }

    /// Continues the unfinished archive that would be called `path`, keeping the leading blocks whose checksums hold
    /// and dropping the rest; starts a new one where there is none or its superblock is torn.
    ///
    /// # Errors
    /// [`Error::JobDiffers`] when the unfinished file was made from something else; [`Error::Io`], [`Error::DiskFull`].
    pub fn resume(path: impl AsRef<Path>, kind: Tag, digests: Digests) -> Result<(Self, Resumed)> {
        Self::resume_in(Arc::new(Disk), path.as_ref(), kind, digests)
    }

    /// [`Writer::create`] on another storage.
    ///
    /// # Errors
    /// As [`Writer::create`].
    pub fn create_in(storage: Arc<dyn Storage>, path: &Path, kind: Tag, digests: Digests) -> Result<Self> {
        let partial = partial_path(path);
        let file = storage
            .create(&partial)
            .map_err(|source| refused(&partial, "creating", source, SUPERBLOCK_BYTES as u64))?;
        Self::begin(storage, file, path, &Superblock::new(kind, digests))
    }

    /// [`Writer::resume`] on another storage.
    ///
    /// # Errors
    /// As [`Writer::resume`].
    pub fn resume_in(
        storage: Arc<dyn Storage>,
        path: &Path,
        kind: Tag,
        digests: Digests,
    ) -> Result<(Self, Resumed)> {
        let partial = partial_path(path);
        let mut file = match storage.open(&partial) {
            Ok(file) => file,
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                return Ok((Self::create_in(storage, path, kind, digests)?, Resumed::default()));
            }
            Err(source) => return Err(refused(&partial, "opening", source, 0)),
        };
        let superblock = Superblock::new(kind, digests);
        let found = scan(&mut *file).map_err(|source| refused(&partial, "reading", source, 0))?;
        let Some(present) = found.superblock else {
            let writer = Self::begin(storage, file, path, &superblock)?;
            return Ok((writer, Resumed { blocks: 0, dropped_bytes: found.file_bytes }));
        };
        if present != superblock {
            return Err(Error::JobDiffers { difference: present.difference(&superblock), job: partial });
        }
        let mut writer = Self::unwritten(storage, file, path, superblock.crc);
        (writer.entries, writer.end) = (found.entries, found.end);
        writer.state = State::Torn;
        writer.mend()?;
        // The run before may have died without a sync; from here on a failed one costs only what comes after.
        writer.file.sync().map_err(|source| writer.failed("making blocks durable", source, 0))?;
        writer.synced = writer.end;
        let resumed = Resumed { blocks: writer.entries.len(), dropped_bytes: found.file_bytes - found.end };
        Ok((writer, resumed))
    }

    fn unwritten(storage: Arc<dyn Storage>, file: Box<dyn StoredFile>, path: &Path, salt: u32) -> Self {
        let partial = partial_path(path);
        let (entries, state) = (Vec::new(), State::Sound);
        Self {
            storage,
            file,
            path: path.into(),
            partial,
            salt,
            entries,
            end: 0,
            synced: 0,
            reserved: 0,
            state,
        }
    }

    fn begin(
        storage: Arc<dyn Storage>,
        file: Box<dyn StoredFile>,
        path: &Path,
        superblock: &Superblock,
    ) -> Result<Self> {
        let mut writer = Self::unwritten(storage, file, path, superblock.crc);
        writer.state = State::Torn;
        writer.write(&[&superblock.page()])?;
        Ok(writer)
    }

    /// The temporary file.
    pub fn partial(&self) -> &Path {
        &self.partial
    }

    /// The blocks written so far, resumed ones included.
    pub fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// Bytes written so far, without directory and trailer.
    pub fn bytes(&self) -> u64 {
        self.end
    }

    /// Reserves disk space for a file of about `bytes`, so that a full disk shows now rather than hours later.
    ///
    /// # Errors
    /// [`Error::DiskFull`], [`Error::Io`].
    pub fn reserve(&mut self, bytes: u64) -> Result<()> {
        self.reserved = self.reserved.max(bytes);
        self.file
            .reserve(bytes)
            .map_err(|source| self.failed("reserving space", source, bytes - self.end.min(bytes)))
    }

    /// Appends a block: a flat array that covers `range` of the receivers, rows, triangles … of this stage. The array
    /// need not have one value per member of the range (offsets have one more, links many).
    ///
    /// # Errors
    /// [`Error::DiskFull`], [`Error::Io`]; the block is then not part of the file, and may be appended again, unless it
    /// was a sync that failed (see [`Writer::checkpoint`]).
    pub fn append<T: Pod>(&mut self, tag: Tag, range: Range<u64>, values: &[T]) -> Result<()> {
        assert!(align_of::<T>() <= ALIGNMENT, "payloads are aligned to {ALIGNMENT} bytes");
        let bytes: &[u8] = bytemuck::cast_slice(values);
        let width_bytes = u16::try_from(size_of::<T>()).unwrap_or(0);
        self.append_bytes(
            tag,
            range,
            Encoded { codec: PLAIN, width_bytes, raw_bytes: bytes.len() as u64, bytes },
        )
    }

    /// Appends a block of bytes that lie in several places, one after another.
    ///
    /// # Errors
    /// As [`Writer::append`].
    pub fn append_parts(&mut self, tag: Tag, range: Range<u64>, parts: &[&[u8]]) -> Result<()> {
        let mut hash = Xxh3::new();
        parts.iter().for_each(|part| hash.update(part));
        let bytes = parts.iter().map(|part| part.len() as u64).sum();
        self.append_hashed(tag, range, (PLAIN, 1, bytes, bytes), (hash.digest(), parts))
    }

    /// Appends a block that a codec has made.
    ///
    /// # Errors
    /// As [`Writer::append`].
    pub fn append_bytes(&mut self, tag: Tag, range: Range<u64>, payload: Encoded<'_>) -> Result<()> {
        let Encoded { codec, width_bytes, raw_bytes, bytes } = payload;
        let form = (codec, width_bytes, raw_bytes, bytes.len() as u64);
        self.append_hashed(tag, range, form, (xxh3_64(bytes), &[bytes]))
    }

    /// Appends a payload in parts whose hash is known: codec, width, raw and stored length.
    fn append_hashed(
        &mut self,
        tag: Tag,
        range: Range<u64>,
        (codec, width_bytes, raw_bytes, stored_bytes): (u16, u16, u64, u64),
        (hash, parts): (u64, &[&[u8]]),
    ) -> Result<()> {
        let entry = Entry {
            tag,
            first: range.start,
            count: range.end.checked_sub(range.start).expect("a range that does not run backwards"),
            offset: self.end,
            raw_bytes,
            stored_bytes,
            hash,
            codec,
            width_bytes,
        };
        assert!(entry.is_consistent(), "lengths that do not agree with the codec and the width: {entry:?}");
        let number = u32::try_from(self.entries.len()).expect("fewer than 2^32 blocks");
        let header = entry.header(number, self.salt);
        let mut pieces = vec![bytemuck::bytes_of(&header)];
        pieces.extend_from_slice(parts);
        pieces.push(padding(stored_bytes as usize));
        self.write(&pieces)?;
        self.entries.push(entry);
        if self.end - self.synced >= CHECKPOINT_BYTES { self.checkpoint() } else { Ok(()) }
    }

    /// Appends a copy of another archive's block, encoded as it is, once its checksum holds: repairs are made of copies
    /// of the whole blocks and of new ones.
    ///
    /// # Errors
    /// As [`Writer::append`]; [`Error::Damaged`] when the block is damaged.
    pub fn append_copy<D: AsRef<[u8]>>(&mut self, block: Block<'_, D>) -> Result<()> {
        let &Entry { tag, codec, width_bytes, raw_bytes, .. } = block.entry();
        let payload = Encoded { codec, width_bytes, raw_bytes, bytes: block.stored()? };
        self.append_bytes(tag, block.range(), payload)
    }

    /// Makes every block so far durable: what a power loss cannot take back.
    ///
    /// # Errors
    /// [`Error::DiskFull`], [`Error::Io`]. After a failed sync the system may have thrown the data away while still
    /// showing it, so the file is cut back to the last success and this writer refuses to go on; resume from there.
    pub fn checkpoint(&mut self) -> Result<()> {
        self.mend()?;
        if let Err(source) = self.file.sync() {
            return Err(self.give_up(source));
        }
        self.synced = self.end;
        if let Err(source) = self.storage.sync_directory(directory_of(&self.path)) {
            return Err(self.give_up(source));
        }
        Ok(())
    }

    /// Completes the file: directory, trailer, sync, rename, sync of the directory. `provenance` is pairs of name and
    /// text that say how it was made; for equal bytes from equal runs, keep times and hosts out of it.
    ///
    /// # Errors
    /// [`Error::DiskFull`], [`Error::Io`]; the temporary file is kept and resumable.
    pub fn finish(mut self, provenance: &[(&str, &str)]) -> Result<Finished> {
        let content = content(&self.entries, self.salt);
        let (directory, blocks) = self.directory(provenance)?;
        let trailer = Trailer::new(self.end, &directory, content, self.salt);
        self.write(&[&directory, padding(directory.len()), bytemuck::bytes_of(&trailer)])?;
        if self.reserved > self.end {
            let freed = self.file.truncate(self.end);
            freed.map_err(|source| self.failed("giving unused space back", source, 0))?;
        }
        if let Err(source) = self.file.sync() {
            return Err(self.give_up(source));
        }
        self.storage
            .rename(&self.partial, &self.path)
            .and_then(|()| self.storage.sync_directory(directory_of(&self.path)))
            .map_err(|source| refused(&self.path, "renaming the finished file", source, 0))?;
        Ok(Finished { path: self.path, bytes: trailer.file_bytes, blocks, content })
    }

    /// Reads a block of the unfinished file back, once its checksum holds: what a resumed run found, or this one wrote.
    ///
    /// # Errors
    /// [`Error::Damaged`] when the payload is not what was written; [`Error::Io`].
    pub fn read_back(&mut self, number: usize) -> Result<Vec<u8>> {
        let entry = self.entries[number];
        let start = entry.payload().unwrap_or(0);
        let mut payload = vec![0; entry.stored_bytes as usize];
        self.file
            .seek(SeekFrom::Start(start))
            .and_then(|_| self.file.read_exact(&mut payload))
            .and_then(|()| self.file.seek(SeekFrom::Start(self.end)))
            .map_err(|source| Error::io(&self.partial, "reading a block back", source))?;
        let hash = xxh3_64(&payload);
        if hash != entry.hash {
            let problem = format!("expected checksum {:016x}, got {hash:016x}", entry.hash);
            let place = format!("block {number} {}", entry.tag);
            return Err(Error::Damaged { file: self.partial.clone(), place, problem });
        }
        Ok(payload)
    }

    /// Removes the temporary file.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn abandon(self) -> Result<()> {
        self.storage.remove(&self.partial).map_err(|source| Error::io(&self.partial, "removing", source))
    }

    fn directory(&mut self, provenance: &[(&str, &str)]) -> Result<(Vec<u8>, usize)> {
        let entries = std::mem::take(&mut self.entries);
        let provenance = provenance.iter().map(|&(name, text)| (name.into(), text.into())).collect();
        let directory = Directory { entries, provenance };
        let bytes = rkyv::to_bytes::<rkyv::rancor::BoxedError>(&directory)
            .map_err(|error| Error::io(&self.partial, "archiving the directory", io::Error::other(error)))?;
        Ok((bytes.to_vec(), directory.entries.len()))
    }

    /// Writes pieces at `end` and moves it there, or leaves it where it was.
    fn write(&mut self, pieces: &[&[u8]]) -> Result<()> {
        self.mend()?;
        let total: usize = pieces.iter().map(|piece| piece.len()).sum();
        self.state = State::Torn;
        let mut written = 0;
        let outcome = if total <= GATHERED_BYTES {
            write_counted(&mut *self.file, &pieces.concat(), &mut written)
        } else {
            pieces.iter().try_for_each(|piece| write_counted(&mut *self.file, piece, &mut written))
        };
        outcome.map_err(|source| self.failed("writing", source, (total - written) as u64))?;
        self.state = State::Sound;
        self.end += total as u64;
        Ok(())
    }

    /// Cuts a torn tail off.
    fn mend(&mut self) -> Result<()> {
        match self.state {
            State::Sound => return Ok(()),
            State::Lost => {
                let source = io::Error::other("an earlier sync failed");
                return Err(Error::io(&self.partial, "continuing", source));
            }
            State::Torn => {}
        }
        self.file
            .truncate(self.end)
            .and_then(|()| self.file.seek(SeekFrom::Start(self.end)))
            .map_err(|source| self.failed("dropping an unfinished block", source, 0))?;
        self.state = State::Sound;
        Ok(())
    }

    fn give_up(&mut self, source: io::Error) -> Error {
        let error = self.failed("making blocks durable", source, self.end - self.synced);
        self.state = State::Lost;
        self.end = self.synced;
        self.entries.retain(|entry| entry.end().is_some_and(|end| end <= self.synced));
        // The error that counts is the sync's; a file that cannot even be cut is caught by the checksums.
        let _ = self.file.truncate(self.end);
        error
    }

    fn failed(&self, action: &str, source: io::Error, needed_bytes: u64) -> Error {
        refused(&self.partial, action, source, needed_bytes.max(self.reserved.saturating_sub(self.end)))
    }
}

/// The storage's refusal as an error; where it is full, with the bytes that were still to come as far as is known.
fn refused(file: &Path, action: &str, source: io::Error, needed_bytes: u64) -> Error {
    if matches!(source.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded) {
        return Error::DiskFull { file: file.into(), needed_bytes: needed_bytes.max(TRAILER_BYTES as u64) };
    }
    Error::io(file, action, source)
}

/// `write_all` that also says how far it came.
fn write_counted(file: &mut (impl Write + ?Sized), mut bytes: &[u8], written: &mut usize) -> io::Result<()> {
    while !bytes.is_empty() {
        match file.write(bytes) {
            Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
            Ok(count) => {
                bytes = &bytes[count..];
                *written += count;
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

fn directory_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

const _: () = assert!(HEADER_BYTES.is_multiple_of(ALIGNMENT) && SUPERBLOCK_BYTES.is_multiple_of(ALIGNMENT));
