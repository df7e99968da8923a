//! A buffered view that slides over the body of a binary PLY and knows its place in the file.

use std::io::{self, Read};

/// Bytes read at a time: large enough to hide system calls, small enough to stay in the second-level cache.
const CHUNK_BYTES: usize = 256 * 1024;

/// The unread part of a file, a chunk of it in memory.
pub struct Window<R> {
    source: R,
    buffer: Vec<u8>,
    start: usize,
    end: usize,
    /// File offset of the next unread byte.
    pub offset: u64,
    file_bytes: u64,
}

impl<R: Read> Window<R> {
    /// Over `source`, which stands at `offset` of a file of `file_bytes`.
    pub fn new(source: R, offset: u64, file_bytes: u64) -> Self {
        Self { source, buffer: vec![0; CHUNK_BYTES], start: 0, end: 0, offset, file_bytes }
    }

    /// At least `wanted` unread bytes.
    ///
    /// # Errors
    /// `UnexpectedEof` when the file has fewer left; memory is not taken for what cannot come.
    pub fn at_least(&mut self, wanted: usize) -> io::Result<&[u8]> {
        if self.end - self.start < wanted {
            self.refill(wanted)?;
        }
        Ok(&self.buffer[self.start..self.end])
    }

    /// Marks bytes as read; at most as many as [`Self::at_least`] gave.
    pub fn advance(&mut self, bytes: usize) {
        self.start += bytes;
        self.offset += bytes as u64;
        debug_assert!(self.start <= self.end);
    }

    /// Passes over bytes without keeping them.
    ///
    /// # Errors
    /// `UnexpectedEof` when the file ends first.
    pub fn skip(&mut self, mut bytes: u64) -> io::Result<()> {
        while bytes > 0 {
            let step = bytes.min(CHUNK_BYTES as u64) as usize;
            self.at_least(step)?;
            self.advance(step);
            bytes -= step as u64;
        }
        Ok(())
    }

    fn refill(&mut self, wanted: usize) -> io::Result<()> {
        if wanted as u64 > self.file_bytes.saturating_sub(self.offset) {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        self.buffer.copy_within(self.start..self.end, 0);
        self.end -= self.start;
        self.start = 0;
        if self.buffer.len() < wanted {
            self.buffer.resize(wanted, 0);
        }
        while self.end < wanted {
            match self.source.read(&mut self.buffer[self.end..]) {
                Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
                Ok(count) => self.end += count,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}

impl<R: Read> Read for Window<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if out.is_empty() || self.offset >= self.file_bytes {
            return Ok(0);
        }
        let held = self.at_least(1)?;
        let count = held.len().min(out.len());
        out[..count].copy_from_slice(&held[..count]);
        self.advance(count);
        Ok(count)
    }
}
