//! Reading all: every block of a finished archive, or the leading whole blocks of an unfinished one.

use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;

use xxhash_rust::xxh3::Xxh3;

use super::layout::{BlockHeader, HEADER_BYTES, Superblock};
use super::{ALIGNMENT, Archive, Entry, SUPERBLOCK_BYTES, Tag};
use crate::{Error, Result};

/// Bytes read at a time; allocation does not depend on what a header claims.
const PIECE_BYTES: usize = 1 << 20;

/// What [`verify`] found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct VerifyReport {
    /// Blocks examined.
    pub blocks: usize,
    /// Bytes of payload examined.
    pub payload_bytes: u64,
    /// Blocks whose header, payload or padding is not what was written.
    pub damaged: Vec<Damage>,
}

/// One damaged block.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Damage {
    /// Position in the file.
    pub number: usize,
    /// What it held.
    pub tag: Tag,
    /// The receivers, rows, triangles … to make again.
    pub range: Range<u64>,
    /// Expected and found.
    pub problem: String,
}

/// Recomputes the checksum of every block of an open archive, whether it was touched before or not. Superblock,
/// directory and trailer were checked when it was opened.
///
/// # Errors
/// [`Error::Io`] when the file cannot be read; damage is not an error but in the report.
pub fn verify<D: AsRef<[u8]>>(archive: &Archive<D>) -> Result<VerifyReport> {
    let mut report = VerifyReport::default();
    for block in archive.all_blocks() {
        report.blocks += 1;
        report.payload_bytes += block.entry().stored_bytes;
        match block.recheck() {
            Ok(()) => {}
            Err(Error::Damaged { problem, .. }) => {
                let (number, entry) = (block.number(), block.entry());
                report.damaged.push(Damage { number, tag: entry.tag, range: entry.range(), problem });
            }
            Err(error) => return Err(error),
        }
    }
    Ok(report)
}

/// What an unfinished file holds.
pub(super) struct Scan {
    /// None when it is torn.
    pub superblock: Option<Superblock>,
    /// The leading blocks that are whole.
    pub entries: Vec<Entry>,
    /// Where the next block goes.
    pub end: u64,
    pub file_bytes: u64,
}

/// Walks block headers forward until the first that fails any check.
pub(super) fn scan(file: &mut (impl Read + Seek + ?Sized)) -> io::Result<Scan> {
    let file_bytes = file.seek(SeekFrom::End(0))?;
    file.seek(SeekFrom::Start(0))?;
    let mut scan = Scan { superblock: None, entries: Vec::new(), end: 0, file_bytes };
    let mut page = [0; SUPERBLOCK_BYTES];
    if !fill(file, &mut page)? {
        return Ok(scan);
    }
    scan.superblock = Superblock::read(&page).ok();
    let Some(superblock) = scan.superblock else { return Ok(scan) };
    scan.end = SUPERBLOCK_BYTES as u64;
    let mut piece = vec![0; PIECE_BYTES.min(usize::try_from(file_bytes).unwrap_or(PIECE_BYTES))];
    while let Some(entry) = next_entry(file, &scan, superblock.crc)? {
        let Some(end) = entry.end().filter(|&end| end <= file_bytes) else { break };
        if !payload_is_whole(file, &entry, &mut piece)? {
            break;
        }
        scan.entries.push(entry);
        scan.end = end;
    }
    Ok(scan)
}

fn next_entry(file: &mut (impl Read + ?Sized), scan: &Scan, salt: u32) -> io::Result<Option<Entry>> {
    let mut header = [0; HEADER_BYTES];
    if !fill(file, &mut header)? {
        return Ok(None);
    }
    let Ok(number) = u32::try_from(scan.entries.len()) else { return Ok(None) };
    let header: BlockHeader = bytemuck::pod_read_unaligned(&header);
    Ok(header.entry(number, salt, scan.end).filter(Entry::is_consistent))
}

/// Reads a payload and its padding; leaves the file at the next header when they are whole.
fn payload_is_whole(file: &mut (impl Read + ?Sized), entry: &Entry, piece: &mut [u8]) -> io::Result<bool> {
    let mut hash = Xxh3::new();
    let mut left = entry.stored_bytes;
    while left > 0 {
        let take = piece.len().min(usize::try_from(left).unwrap_or(piece.len()));
        if !fill(file, &mut piece[..take])? {
            return Ok(false);
        }
        hash.update(&piece[..take]);
        left -= take as u64;
    }
    let mut padding = [0; ALIGNMENT];
    let padding = &mut padding[..(entry.stored_bytes.wrapping_neg() % ALIGNMENT as u64) as usize];
    Ok(hash.digest() == entry.hash && fill(file, padding)? && padding.iter().all(|&byte| byte == 0))
}

/// Fills a buffer; false at the end of the file.
fn fill(file: &mut (impl Read + ?Sized), buffer: &mut [u8]) -> io::Result<bool> {
    match file.read_exact(buffer) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(false),
        Err(error) => Err(error),
    }
}
