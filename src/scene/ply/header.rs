//! The header of a PLY file: encoding, elements, properties, and where the body starts.
//!
//! Read byte-wise rather than by a grammar, so that Latin-1 comments, tabs, CR LF, indented lines, duplicate property
//! names and a forgotten `comment` keyword do not stand between a user and a scan. Everything that would make the body
//! unreadable is refused here, before anything is allocated for it.

use std::path::Path;

use crate::error::{Error, Result};
use crate::scene::ply::scalar::Scalar;

/// Headers end within this many bytes; what is longer is not a header but a file without `end_header`.
pub const MAX_HEADER_BYTES: usize = 1 << 20;

/// Lines without a keyword that are forgiven; somebody may have forgotten `comment` before a paragraph.
const MOST_IGNORED: usize = 16;

/// How the body's numbers are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// Decimal text, one row a line.
    Ascii,
    /// Binary, least significant byte first.
    Little,
    /// Binary, most significant byte first.
    Big,
}

/// What a property holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// One number.
    Scalar(Scalar),
    /// A length and as many numbers.
    List {
        /// Type of the length.
        count: Scalar,
        /// Type of the numbers.
        item: Scalar,
    },
}

/// One column of an element.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Property {
    /// Its name; not necessarily unique.
    pub name: String,
    /// Its type.
    pub kind: Kind,
}

/// One table of the body.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Element {
    /// "vertex", "face", …
    pub name: String,
    /// Rows.
    pub count: u64,
    /// Columns in file order.
    pub properties: Vec<Property>,
}

/// Everything before the body.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Header {
    /// How the body is written.
    pub encoding: Encoding,
    /// Tables in file order.
    pub elements: Vec<Element>,
    /// Texts of the `comment` lines, Latin-1 read as such.
    pub comments: Vec<String>,
    /// Offset of the body's first byte.
    pub body_offset: u64,
    /// Lines of the header, `end_header` included.
    pub lines: u64,
    /// The byte that ends a line: LF, or CR in files that know no LF.
    pub line_end: u8,
    /// Lines that were ignored: number and text.
    pub ignored: Vec<(u64, String)>,
}

impl Element {
    /// The least number of bytes that one row takes in the body.
    pub fn least_row_bytes(&self, encoding: Encoding) -> u64 {
        let least = |p: &Property| match (encoding, p.kind) {
            (Encoding::Ascii, _) => 2,
            (_, Kind::Scalar(scalar)) => scalar.size() as u64,
            (_, Kind::List { count, .. }) => count.size() as u64,
        };
        self.properties.iter().map(least).sum()
    }

    /// The bytes of one row when it holds no lists in a binary file.
    pub fn stride(&self) -> Option<usize> {
        self.properties
            .iter()
            .map(|p| match p.kind {
                Kind::Scalar(scalar) => Some(scalar.size()),
                Kind::List { .. } => None,
            })
            .sum()
    }
}

impl Header {
    /// Parses the header at the start of `bytes` (the first [`MAX_HEADER_BYTES`] of the file or all of it).
    ///
    /// # Errors
    /// [`Error::Input`] naming the line for anything that is not a PLY header.
    pub fn parse(path: &Path, bytes: &[u8]) -> Result<Self> {
        let refuse = |line: u64, problem: String| {
            Error::input(path, format!("header line {line}"), problem, "check that the file is a whole PLY")
        };
        let mut lines = Lines::new(bytes);
        match lines.next() {
            Some(first) if first.trim() == "ply" => {}
            _ if bytes.is_empty() => return Err(refuse(1, "the file is empty, not a PLY".into())),
            _ if bytes.starts_with(b"\xef\xbb\xbfply") => {
                return Err(refuse(1, "a byte-order mark stands before `ply`".into()));
            }
            _ => return Err(refuse(1, "expected `ply`, this is not a PLY file".into())),
        }
        let mut encoding = None;
        let mut header = Self {
            encoding: Encoding::Ascii,
            elements: Vec::new(),
            comments: Vec::new(),
            body_offset: 0,
            lines: 0,
            line_end: lines.line_end,
            ignored: Vec::new(),
        };
        loop {
            let Some(line) = lines.next() else {
                return Err(refuse(lines.number, "the header ends without `end_header`".into()));
            };
            let words: Vec<&str> = line.split_ascii_whitespace().collect();
            match words.first().copied() {
                None => {}
                Some("end_header") => break,
                Some("comment" | "obj_info") => header.comments.push(rest_of(&line)),
                Some("format") if encoding.is_some() => {
                    return Err(refuse(lines.number, "a second `format` line".into()));
                }
                Some("format") => encoding = Some(format(&words).map_err(|p| refuse(lines.number, p))?),
                Some("element") => {
                    header.elements.push(element(&words).map_err(|p| refuse(lines.number, p))?);
                }
                Some("property") => {
                    let property = property(&words).map_err(|p| refuse(lines.number, p))?;
                    let Some(element) = header.elements.last_mut() else {
                        return Err(refuse(lines.number, "a property before any element".into()));
                    };
                    element.properties.push(property);
                }
                Some(word) => {
                    // Before the first element a stray line cannot shift the body: likely a forgotten `comment`.
                    if !header.elements.is_empty() || line.chars().any(char::is_control) {
                        let word: String = word.chars().take(40).collect();
                        let problem = format!(
                            "{word:?} is none of comment, obj_info, format, element, property, end_header"
                        );
                        return Err(refuse(lines.number, problem));
                    }
                    if header.ignored.len() == MOST_IGNORED {
                        let problem = format!(
                            "more than {MOST_IGNORED} lines without a keyword, this is no PLY header"
                        );
                        return Err(refuse(lines.number, problem));
                    }
                    header.ignored.push((lines.number, line.trim().to_string()));
                }
            }
        }
        header.body_offset = lines.offset as u64;
        header.lines = lines.number;
        header.encoding = encoding.ok_or_else(|| refuse(lines.number, "no `format` line".into()))?;
        Ok(header)
    }

    /// Checks that the body can hold the rows that the header claims, so that allocations are bounded by the file.
    ///
    /// # Errors
    /// [`Error::Input`] naming the element.
    pub fn check_counts(&self, path: &Path, file_bytes: u64) -> Result<()> {
        // The last row of a text needs no line end.
        let slack = u64::from(self.encoding == Encoding::Ascii);
        let mut left = file_bytes.saturating_sub(self.body_offset) + slack;
        for element in &self.elements {
            let place = format!("element {}", element.name);
            if element.properties.is_empty() && element.count > 0 {
                let problem = format!("{} rows without any property", element.count);
                return Err(Error::input(path, place, problem, "remove the element from the header"));
            }
            let needed = element.count.checked_mul(element.least_row_bytes(self.encoding));
            match needed.and_then(|needed| left.checked_sub(needed)) {
                Some(rest) => left = rest,
                None => {
                    let problem = format!(
                        "truncated: {} rows are promised, the {} bytes that are left cannot hold them",
                        element.count,
                        left.saturating_sub(slack)
                    );
                    return Err(Error::input(path, place, problem, "get the whole file"));
                }
            }
        }
        Ok(())
    }
}

/// Splits a header into lines, keeping count.
struct Lines<'a> {
    bytes: &'a [u8],
    offset: usize,
    number: u64,
    line_end: u8,
}

impl<'a> Lines<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        // Only a file whose first line ends in a lone CR uses lone CRs.
        let first = bytes.iter().take(16).position(|&b| b == b'\n' || b == b'\r');
        let lone = first.is_some_and(|at| bytes[at] == b'\r' && bytes.get(at + 1) != Some(&b'\n'));
        Self { bytes, offset: 0, number: 0, line_end: if lone { b'\r' } else { b'\n' } }
    }

    /// The next line without its end, or nothing when no line end follows.
    fn next(&mut self) -> Option<String> {
        self.number += 1;
        let left = &self.bytes[self.offset..];
        let length = match left.iter().position(|&b| b == self.line_end) {
            Some(length) => length,
            // A file that ends right after the word has an empty body, not a missing header.
            None if left.trim_ascii() == b"end_header" => left.len() - 1,
            None => return None,
        };
        let line = if left[length] == self.line_end { &left[..length] } else { left };
        self.offset += length + 1;
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        Some(line.iter().map(|&b| char::from(b)).collect())
    }
}

/// The text after the first word.
fn rest_of(line: &str) -> String {
    line.trim().split_once(char::is_whitespace).map_or_else(String::new, |(_, rest)| rest.trim().to_string())
}

fn format(words: &[&str]) -> Result<Encoding, String> {
    match words.get(1).copied() {
        Some("ascii") => Ok(Encoding::Ascii),
        Some("binary_little_endian") => Ok(Encoding::Little),
        Some("binary_big_endian") => Ok(Encoding::Big),
        other => Err(format!(
            "format {:?} is none of ascii, binary_little_endian, binary_big_endian",
            other.unwrap_or("")
        )),
    }
}

fn element(words: &[&str]) -> Result<Element, String> {
    let [_, name, count] = words else {
        return Err("expected `element NAME COUNT`".into());
    };
    let count = count.parse().map_err(|_| format!("{count:?} is no count of rows"))?;
    Ok(Element { name: (*name).to_string(), count, properties: Vec::new() })
}

fn property(words: &[&str]) -> Result<Property, String> {
    let scalar = |word: &str| Scalar::named(word).ok_or_else(|| format!("{word:?} is no PLY type"));
    match words {
        [_, "list", count, item, name] => {
            let (count, item) = (scalar(count)?, scalar(item)?);
            if count.is_float() {
                return Err(format!("list {name} has a length that is no integer"));
            }
            Ok(Property { name: (*name).to_string(), kind: Kind::List { count, item } })
        }
        [_, ty, name] => Ok(Property { name: (*name).to_string(), kind: Kind::Scalar(scalar(ty)?) }),
        _ => Err("expected `property TYPE NAME` or `property list TYPE TYPE NAME`".into()),
    }
}
