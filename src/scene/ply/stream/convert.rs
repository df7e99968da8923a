//! Vertices that have no fixed place in their file, copied to rows of one length in a scratch file.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use glam::DVec3;

use crate::archive::Pause;
use crate::error::{Error, Result};
use crate::scene::ply::body::binary::Field;
use crate::scene::ply::columns::{COLOUR, Columns, NORMAL, POSITION};
use crate::scene::ply::scalar::Scalar;
use crate::scene::ply::vertices::{ColourReader, Row};

/// Rows between questions whether to go on: text comes at about a million rows a second.
const PAUSE_ROWS: u64 = 1 << 18;

/// The columns of a copy: positions in `double`, then normals and linear colours in `float` where there are any.
pub fn fields(columns: &Columns) -> (Vec<Field>, usize) {
    let (mut fields, mut offset) = (Vec::new(), 0);
    for (group, scalar) in [(POSITION, Scalar::F64), (NORMAL, Scalar::F32), (COLOUR, Scalar::F32)] {
        for role in (group..group + 3).filter(|_| columns.has(group)) {
            fields.push(Field { offset, scalar, role });
            offset += scalar.size();
        }
    }
    (fields, offset)
}

/// The file being written.
pub struct Copy<'a> {
    out: BufWriter<File>,
    path: PathBuf,
    fields: Vec<Field>,
    colour_reader: Option<ColourReader>,
    pause: Pause<'a>,
    /// What stopped the writing.
    stopped: Option<Error>,
}

impl<'a> Copy<'a> {
    /// Creates the file.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn create(path: &Path, columns: &Columns, pause: Pause<'a>) -> Result<Self> {
        let file = File::create(path).map_err(|source| Error::io(path, "creating", source))?;
        Ok(Self {
            out: BufWriter::with_capacity(1 << 18, file),
            path: path.to_path_buf(),
            fields: fields(columns).0,
            colour_reader: columns.roles[COLOUR].map(ColourReader::new),
            pause,
            stopped: None,
        })
    }

    /// Adds a row; the problem is returned as text when its position is not finite.
    pub fn push(&mut self, number: u64, row: &Row) -> Result<(), String> {
        let position = DVec3::new(row[POSITION], row[POSITION + 1], row[POSITION + 2]);
        if !position.is_finite() {
            return Err(format!("the position ({position}) is not finite"));
        }
        let asked = if number.is_multiple_of(PAUSE_ROWS) { (self.pause)() } else { Ok(()) };
        let written =
            asked.and_then(|()| self.write(row).map_err(|source| Error::io(&self.path, "writing", source)));
        // Readers of rows pass problems of the input on: this one waits for `finish`.
        written.map_err(|error| {
            self.stopped = Some(error);
            String::new()
        })
    }

    fn write(&mut self, row: &Row) -> io::Result<()> {
        let colour = self.colour_reader.as_ref().map(|reader| reader.colour(row));
        for field in &self.fields {
            match (field.scalar, colour) {
                (Scalar::F64, _) => self.out.write_all(&row[field.role].to_le_bytes())?,
                (_, Some(colour)) if field.role >= COLOUR => {
                    self.out.write_all(&colour[field.role - COLOUR].to_le_bytes())?;
                }
                _ => self.out.write_all(&(row[field.role] as f32).to_le_bytes())?,
            }
        }
        Ok(())
    }

    /// Completes the file after the rows were read with this outcome.
    ///
    /// # Errors
    /// The outcome's, or what stopped the writing.
    pub fn finish(self, outcome: Result<()>) -> Result<()> {
        if let Some(error) = self.stopped {
            return Err(error);
        }
        outcome?;
        let written = self.out.into_inner().map_err(io::IntoInnerError::into_error);
        written.map(|_| ()).map_err(|source| Error::io(&self.path, "writing", source))
    }
}
