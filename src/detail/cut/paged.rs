//! Many lists of triangles that grow at once, in one scratch file: each list is a chain of pages.

use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// Bytes of a page: long enough to be written at once, short enough for hundreds of lists to have one each in memory.
const PAGE_BYTES: usize = 1 << 16;

/// Triangles of a page.
const PAGE: usize = PAGE_BYTES / 12;

/// Where one list is.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Pages {
    /// Its pages, all full but the last.
    pages: Vec<u32>,
    /// Triangles in all.
    pub count: u64,
}

impl Pages {
    /// Bytes of its pages.
    pub fn bytes(&self) -> u64 {
        self.pages.len() as u64 * PAGE_BYTES as u64
    }

    /// The list, page by page; `file` holds all pages.
    pub fn runs<'a>(&'a self, file: &'a [u8]) -> impl Iterator<Item = &'a [[u32; 3]]> {
        self.pages.iter().enumerate().map(move |(number, &page)| {
            let left = self.count as usize - number * PAGE;
            let start = page as usize * PAGE_BYTES;
            bytemuck::cast_slice(&file[start..start + 12 * left.min(PAGE)])
        })
    }
}

/// The file being written.
pub struct Paged {
    file: File,
    path: PathBuf,
    /// Pages written.
    written: u32,
    lists: Vec<Pages>,
    open: Vec<Vec<[u32; 3]>>,
}

impl Paged {
    /// Creates the file.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn create(path: &Path, lists: usize) -> Result<Self> {
        let file = File::create(path).map_err(|source| Error::io(path, "creating", source))?;
        let open = (0..lists).map(|_| Vec::with_capacity(PAGE)).collect();
        let lists = vec![Pages::default(); lists];
        Ok(Self { file, path: path.into(), written: 0, lists, open })
    }

    /// Appends a triangle to a list.
    ///
    /// # Errors
    /// [`Error::DiskFull`], [`Error::Io`].
    #[inline]
    pub fn push(&mut self, list: u16, triangle: [u32; 3]) -> Result<()> {
        let open = &mut self.open[usize::from(list)];
        open.push(triangle);
        if open.len() == PAGE { self.flush(usize::from(list)) } else { Ok(()) }
    }

    fn flush(&mut self, list: usize) -> Result<()> {
        let bytes: &[u8] = bytemuck::cast_slice(&self.open[list]);
        let padding = [0; PAGE_BYTES % 12];
        let written = self.file.write_all(bytes).and_then(|()| match bytes.len() {
            FULL_BYTES => self.file.write_all(&padding),
            short => self.file.write_all(&vec![0; PAGE_BYTES - short]),
        });
        written.map_err(|source: io::Error| Error::io(&self.path, "writing", source))?;
        self.lists[list].pages.push(self.written);
        self.lists[list].count += self.open[list].len() as u64;
        self.open[list].clear();
        self.written += 1;
        Ok(())
    }

    /// Completes the file.
    ///
    /// # Errors
    /// As [`Paged::push`].
    pub fn finish(mut self) -> Result<Vec<Pages>> {
        for list in 0..self.open.len() {
            if !self.open[list].is_empty() {
                self.flush(list)?;
            }
        }
        Ok(self.lists)
    }
}

const FULL_BYTES: usize = PAGE * 12;
