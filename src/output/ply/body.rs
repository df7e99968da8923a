//! The rows of any PLY as little-endian bytes, one at a time.

use std::io::{self, BufRead, Read};
use std::path::Path;

use super::columns::encode;
use crate::error::{Error, Result};
use crate::scene::ply::header::{Element, Encoding, Kind};
use crate::scene::ply::scalar::Scalar;

/// A PLY's body being read row by row.
pub struct Body<'a, R> {
    /// For messages.
    pub path: &'a Path,
    /// The unread rest.
    pub source: R,
    /// How it is written.
    pub encoding: Encoding,
    /// The byte that ends a line of text.
    pub line_end: u8,
}

impl<R: BufRead> Body<'_, R> {
    /// Replaces `row` by the next row of `element`, little-endian, and `starts` by the offset of each column.
    ///
    /// # Errors
    /// [`Error::Input`] for a row that is cut off or no number, [`Error::Io`].
    pub fn row(&mut self, element: &Element, row: &mut Vec<u8>, starts: &mut Vec<usize>) -> Result<()> {
        row.clear();
        starts.clear();
        let outcome = match self.encoding {
            Encoding::Ascii => self.text_row(element, row, starts),
            Encoding::Little => self.binary_row(element, row, starts, false),
            Encoding::Big => self.binary_row(element, row, starts, true),
        };
        outcome.map_err(|e| match e.kind() {
            io::ErrorKind::UnexpectedEof | io::ErrorKind::InvalidData => {
                let remedy = "the file changed since it was read; bake it again";
                Error::input(self.path, format!("element {}", element.name), e.to_string(), remedy)
            }
            _ => Error::io(self.path, format!("reading element {}", element.name), e),
        })
    }

    fn binary_row(
        &mut self,
        element: &Element,
        row: &mut Vec<u8>,
        starts: &mut Vec<usize>,
        big: bool,
    ) -> io::Result<()> {
        if let Some(stride) = element.stride() {
            row.resize(stride, 0);
            self.source.read_exact(row)?;
            let mut at = 0;
            for property in &element.properties {
                starts.push(at);
                if let Kind::Scalar(scalar) = property.kind {
                    to_little(&mut row[at..at + scalar.size()], scalar.size(), big);
                    at += scalar.size();
                }
            }
            return Ok(());
        }
        for property in &element.properties {
            starts.push(row.len());
            match property.kind {
                Kind::Scalar(scalar) => self.numbers(scalar, 1, row, big)?,
                Kind::List { count, item } => {
                    let at = row.len();
                    self.numbers(count, 1, row, big)?;
                    let length = u64::try_from(count.read_integer(&row[at..], false));
                    let length = length.map_err(|_| invalid("a list of negative length"))?;
                    self.numbers(item, length, row, big)?;
                }
            }
        }
        Ok(())
    }

    /// Appends `count` numbers; memory grows only with bytes that are there.
    fn numbers(&mut self, scalar: Scalar, count: u64, row: &mut Vec<u8>, big: bool) -> io::Result<()> {
        let wanted = count.saturating_mul(scalar.size() as u64);
        let at = row.len();
        let got = self.source.by_ref().take(wanted).read_to_end(row)?;
        if (got as u64) < wanted {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        to_little(&mut row[at..], scalar.size(), big);
        Ok(())
    }

    fn text_row(&mut self, element: &Element, row: &mut Vec<u8>, starts: &mut Vec<usize>) -> io::Result<()> {
        let mut line = Vec::new();
        while line.trim_ascii().is_empty() {
            line.clear();
            if self.source.read_until(self.line_end, &mut line)? == 0 {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
        }
        let text = std::str::from_utf8(&line).map_err(|_| invalid("a row that is no text"))?;
        let mut words = text.split_ascii_whitespace();
        let mut next = || words.next().ok_or_else(|| invalid("fewer numbers than declared"));
        for property in &element.properties {
            starts.push(row.len());
            match property.kind {
                Kind::Scalar(scalar) => parse(scalar, next()?, row)?,
                Kind::List { count, item } => {
                    let at = row.len();
                    parse(count, next()?, row)?;
                    for _ in 0..count.read_integer(&row[at..], false) {
                        parse(item, next()?, row)?;
                    }
                }
            }
        }
        Ok(())
    }
}

fn invalid(problem: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, problem)
}

/// Appends the number that `word` writes, in its own precision.
fn parse(scalar: Scalar, word: &str, row: &mut Vec<u8>) -> io::Result<()> {
    let problem = |_| invalid(&format!("{word:?} is no number"));
    if scalar == Scalar::F32 {
        // Not by way of f64, which would round twice.
        row.extend(word.parse::<f32>().map_err(problem)?.to_le_bytes());
    } else {
        encode(scalar, word.parse::<f64>().map_err(problem)?, row);
    }
    Ok(())
}

/// Reverses each number of `size` bytes when they come most significant first.
fn to_little(bytes: &mut [u8], size: usize, big: bool) {
    if big && size > 1 {
        bytes.chunks_exact_mut(size).for_each(<[u8]>::reverse);
    }
}
