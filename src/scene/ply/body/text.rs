//! ASCII bodies: rows are read by ply-rs, with a lenient second look at what its grammar refuses.

use std::io::BufRead;
use std::ops::Range;
use std::path::Path;

use ply_rs::parser::Parser;
use ply_rs::ply::{ElementDef, PropertyAccess, PropertyType, ScalarType};

use crate::error::{Error, Result};
use crate::scene::ply::body::record::{self, Record};
use crate::scene::ply::columns::Columns;
use crate::scene::ply::header::{Element, Encoding};
use crate::scene::polygon::Count;

/// An ASCII body being read line by line.
pub struct Body<'a, R> {
    /// The file's name, for messages.
    pub path: &'a Path,
    /// The unread text.
    pub source: R,
    /// Number of the last line read.
    pub line: u64,
    /// The byte that ends a line.
    pub line_end: u8,
    /// Rows with more numbers than the header declares.
    pub overlong: Count,
}

impl<R: BufRead> Body<'_, R> {
    /// Reads every row of an element.
    ///
    /// # Errors
    /// [`Error::Input`] naming row and line, also when `each` finds a problem.
    pub fn rows(
        &mut self,
        element: &Element,
        columns: &Columns,
        each: impl FnMut(u64, &Record) -> Result<(), String>,
    ) -> Result<()> {
        self.rows_in(element, columns, 0..element.count, each)
    }

    /// Reads the next rows of an element, which have these numbers.
    ///
    /// # Errors
    /// As [`Self::rows`].
    pub fn rows_in(
        &mut self,
        element: &Element,
        columns: &Columns,
        rows: Range<u64>,
        mut each: impl FnMut(u64, &Record) -> Result<(), String>,
    ) -> Result<()> {
        let definition = record::definition(element, columns, Encoding::Ascii);
        let parser = Parser::<Record>::new();
        let mut bytes = Vec::new();
        for number in rows {
            let text = self.next_line(&mut bytes, element, number)?;
            let tokens = text.split_ascii_whitespace().count();
            let read = match parser.read_ascii_element(text, &definition) {
                Ok(record) => Ok(record),
                Err(_) => lenient(text, &definition),
            };
            let record = match read {
                Ok(record) => record,
                Err(problem) => return Err(self.refuse(element, number, problem)),
            };
            if tokens > record.tokens {
                self.overlong.note(self.line);
            }
            each(number, &record).map_err(|problem| self.refuse(element, number, problem))?;
        }
        Ok(())
    }

    /// Passes over an element that nobody asked for.
    ///
    /// # Errors
    /// [`Error::Input`] when the file ends within it.
    pub fn skip(&mut self, element: &Element) -> Result<()> {
        let mut bytes = Vec::new();
        (0..element.count).try_for_each(|number| self.next_line(&mut bytes, element, number).map(|_| ()))
    }

    /// Whether anything but blanks follows.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn has_more(&mut self) -> Result<bool> {
        let mut bytes = Vec::new();
        while bytes.trim_ascii().is_empty() {
            bytes.clear();
            let read = self.source.read_until(self.line_end, &mut bytes);
            if read.map_err(|e| Error::io(self.path, format!("reading line {}", self.line), e))? == 0 {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// The next line that is not blank.
    fn next_line<'b>(&mut self, bytes: &'b mut Vec<u8>, element: &Element, number: u64) -> Result<&'b str> {
        loop {
            bytes.clear();
            let read = self.source.read_until(self.line_end, bytes);
            match read {
                Ok(0) => {
                    let problem =
                        format!("truncated: {} rows are promised, the file holds {number}", element.count);
                    let place = format!("line {}, {} row {number}", self.line, element.name);
                    let remedy = "get the whole file, or correct the counts in its header";
                    return Err(Error::input(self.path, place, problem, remedy));
                }
                Ok(_) => self.line += 1,
                Err(error) => return Err(Error::io(self.path, format!("reading line {}", self.line), error)),
            }
            if !bytes.trim_ascii().is_empty() {
                break;
            }
        }
        std::str::from_utf8(bytes.trim_ascii())
            .map_err(|_| self.refuse(element, number, "the row is no text".to_string()))
    }

    fn refuse(&self, element: &Element, number: u64, problem: impl Into<String>) -> Error {
        let place = format!("line {}, {} row {number}", self.line, element.name);
        Error::input(self.path, place, problem, "repair the row, or export the file again")
    }
}

/// Reads a row whose numbers are written in ways that ply-rs' grammar does not know (`.5`, `1.`, `1.0` for an integer),
/// or says what is wrong with it.
fn lenient(text: &str, definition: &ElementDef) -> Result<Record, String> {
    let mut words = text.split_ascii_whitespace();
    let mut number = || -> Result<f64, String> {
        let word = words.next().ok_or("fewer numbers than the header declares")?;
        word.parse::<f64>().map_err(|_| format!("{word:?} is no number"))
    };
    // Debug's digits are few whatever the size.
    let entries = |length: f64| format!("a list of {} entries", format!("{length:?}").trim_end_matches(".0"));
    let mut record = Record::new();
    for (name, property) in &definition.properties {
        match &property.data_type {
            PropertyType::Scalar(_) => {
                record.set_double(name, number()?);
            }
            PropertyType::List(_, item) => {
                let length = number()?;
                if !(length >= 0.0 && length.fract() == 0.0) {
                    return Err(entries(length));
                }
                // A line bounds its list: every entry takes two bytes of it.
                if length > text.len() as f64 {
                    return Err(format!("{} in a line of {} bytes", entries(length), text.len()));
                }
                let values = (0..length as usize).map(|_| number()).collect::<Result<Vec<f64>, _>>()?;
                let integers = !matches!(item, ScalarType::Float | ScalarType::Double);
                if let Some(odd) = values.iter().find(|value| integers && value.fract() != 0.0) {
                    return Err(format!("{odd} stands where an integer is declared"));
                }
                record.set_list_double(name, values);
            }
        }
    }
    Ok(record)
}
