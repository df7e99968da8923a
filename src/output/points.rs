//! Tables of points and results (CSV): what `probe` and `reference` read and write.

use std::fmt::{Display, LowerExp, Write as _};
use std::fs::File;
use std::io::{self, BufReader, Read, Write};
use std::path::Path;

use csv::StringRecord;
use glam::{DVec3, Vec3};

use super::file::write_whole;
use crate::error::{Error, Result};
use crate::geometry::SurfacePoint;
use crate::light::Rgb;
use crate::scene::Placement;

/// The columns that every table has.
const REQUIRED: [&str; 6] = ["x", "y", "z", "nx", "ny", "nz"];

/// Surface points read from a table, with all its columns kept as text.
#[derive(Debug, Clone)]
pub struct PointTable {
    header: StringRecord,
    rows: Vec<StringRecord>,
    positions: Vec<DVec3>,
    normals: Vec<Vec3>,
}

/// A column of results.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Its name in the header.
    pub name: String,
    /// One value per point.
    pub values: Values,
}

/// The numbers of a column; each is written with the fewest digits that read back to the same number of its kind.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// Single precision.
    F32(Vec<f32>),
    /// Double precision.
    F64(Vec<f64>),
}

impl Values {
    fn len(&self) -> usize {
        match self {
            Self::F32(values) => values.len(),
            Self::F64(values) => values.len(),
        }
    }

    /// Appends a value: plain digits for sizes that people read at a glance, an exponent beyond.
    fn append(&self, row: usize, text: &mut String) {
        match self {
            Self::F32(values) => append_number(values[row], f64::from(values[row]), text),
            Self::F64(values) => append_number(values[row], values[row], text),
        }
    }
}

/// Appends the fewest digits that read back as `number`, whose size `value` tells.
fn append_number<N: zmij::Float + Display + LowerExp>(number: N, value: f64, text: &mut String) {
    let plain = value == 0.0 || (1e-5..1e16).contains(&value.abs());
    if plain {
        // A third of the time that `write!` takes, which still knows where plain digits end.
        let mut digits = zmij::Buffer::new();
        let quick = digits.format_finite(number);
        if !quick.contains('e') {
            text.push_str(quick.strip_suffix(".0").unwrap_or(quick));
            return;
        }
    }
    // Writing to a String does not fail.
    let _ = if plain || !value.is_finite() { write!(text, "{number}") } else { write!(text, "{number:e}") };
}

impl Column {
    /// A column of single-precision numbers.
    pub fn new(name: impl Into<String>, values: impl IntoIterator<Item = f32>) -> Self {
        Self { name: name.into(), values: Values::F32(values.into_iter().collect()) }
    }

    /// Three columns `name_r`, `name_g`, `name_b`.
    pub fn rgb(name: &str, values: &[Rgb]) -> [Self; 3] {
        [("r", 0), ("g", 1), ("b", 2)]
            .map(|(suffix, channel)| Self::new(format!("{name}_{suffix}"), values.iter().map(|c| c[channel])))
    }
}

impl PointTable {
    /// Reads a table of points in world coordinates with a header that holds at least `x,y,z,nx,ny,nz`.
    ///
    /// Normals are normalised. Quoted fields, CRLF and a byte-order mark are understood; a header alone is a table of no
    /// points. Memory: the file's size plus about 100 B a point.
    ///
    /// # Errors
    /// [`Error::Io`] when the file cannot be read; [`Error::Input`] with line and column for a column that is missing or
    /// named twice, a row of another length, and a coordinate or normal that is no finite number or has no direction.
    pub fn read(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(|e| Error::io(path, "opening the points", e))?;
        Self::from_reader(BufReader::new(file), path)
    }

    /// [`PointTable::read`] from anything that reads; `file` is what errors call it.
    ///
    /// # Errors
    /// As [`PointTable::read`].
    pub fn from_reader(reader: impl Read, file: &Path) -> Result<Self> {
        let mut reader = csv::Reader::from_reader(reader);
        let header = reader.headers().map_err(|e| malformed(e, file))?.clone();
        let columns = required_columns(&header, file)?;
        let mut table = Self { header, rows: Vec::new(), positions: Vec::new(), normals: Vec::new() };
        for row in reader.records() {
            let row = row.map_err(|e| malformed(e, file))?;
            let mut numbers = [0.0; 6];
            for (k, number) in numbers.iter_mut().enumerate() {
                *number = finite(&row, columns[k], REQUIRED[k], file)?;
            }
            let [x, y, z, nx, ny, nz] = numbers;
            table.positions.push(DVec3::new(x, y, z));
            table.normals.push(unit_normal(DVec3::new(nx, ny, nz), &row, file)?);
            table.rows.push(row);
        }
        Ok(table)
    }

    /// The number of points.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// World positions.
    pub fn positions(&self) -> &[DVec3] {
        &self.positions
    }

    /// The points in a scene's local frame.
    pub fn local(&self, placement: &Placement) -> Vec<SurfacePoint> {
        let points = self.positions.iter().zip(&self.normals);
        points
            .map(|(world, normal)| SurfacePoint { position: placement.to_local(*world), normal: *normal })
            .collect()
    }

    /// The text of a further column, by name.
    pub fn column(&self, name: &str) -> Option<impl Iterator<Item = &str>> {
        let at = self.header.iter().position(|h| h.trim() == name)?;
        Some(self.rows.iter().map(move |row| &row[at]))
    }

    /// Writes the table with results appended, through a temporary file that is renamed at the end.
    ///
    /// All input columns stay as they were, in order; one that has the name of a result is an older result and is left
    /// out.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::DiskFull`].
    ///
    /// # Panics
    /// When a result has not one value per point.
    pub fn write(&self, path: &Path, results: &[Column]) -> Result<()> {
        for result in results {
            let (values, points) = (result.values.len(), self.len());
            assert!(values == points, "column {}: {values} values for {points} points", result.name);
        }
        write_whole(path, self.expected_bytes(results), |sink| {
            self.write_to(sink, results).map_err(|e| Error::io(path, "writing the results", e))
        })
    }

    /// Writes the table with results appended to anything that takes bytes; see [`PointTable::write`].
    ///
    /// # Errors
    /// What the writer says.
    pub fn write_to(&self, mut writer: impl Write, results: &[Column]) -> io::Result<()> {
        let replaced = |name: &str| results.iter().any(|result| result.name == name.trim());
        let kept: Vec<usize> = (0..self.header.len()).filter(|k| !replaced(&self.header[*k])).collect();
        let mut text = String::new();
        kept.iter().for_each(|k| append_field(&self.header[*k], &mut text));
        results.iter().for_each(|result| append_field(&result.name, &mut text));
        for (number, row) in self.rows.iter().enumerate() {
            end_row(&mut text);
            writer.write_all(text.as_bytes())?;
            text.clear();
            kept.iter().for_each(|k| append_field(&row[*k], &mut text));
            for result in results {
                result.values.append(number, &mut text);
                text.push(',');
            }
        }
        end_row(&mut text);
        writer.write_all(text.as_bytes())?;
        writer.flush()
    }

    fn expected_bytes(&self, results: &[Column]) -> u64 {
        // A shortest f32 takes about ten characters and its comma.
        let kept: usize = self.rows.iter().map(|row| row.as_slice().len() + row.len()).sum();
        (kept + self.len() * results.len() * 11) as u64
    }
}

/// Appends a field and its comma, quoted where its text needs it.
fn append_field(field: &str, text: &mut String) {
    if field.bytes().any(|byte| matches!(byte, b'"' | b',' | b'\n' | b'\r')) {
        text.push('"');
        text.push_str(&field.replace('"', "\"\""));
        text.push('"');
    } else {
        text.push_str(field);
    }
    text.push(',');
}

/// Turns the last comma into the end of the row.
fn end_row(text: &mut String) {
    text.pop();
    text.push('\n');
}

/// The positions of the required columns.
fn required_columns(header: &StringRecord, file: &Path) -> Result<[usize; 6]> {
    let remedy = "the first line must be a header with at least x,y,z,nx,ny,nz";
    if header.is_empty() {
        return Err(Error::input(file, "line 1", "the file is empty", remedy));
    }
    if header.iter().any(|name| name.contains('\0')) {
        let problem = "it holds zero bytes, so it is no text in UTF-8";
        return Err(Error::input(file, "line 1", problem, "save the table as UTF-8"));
    }
    let mut columns = [0; 6];
    for (k, name) in REQUIRED.into_iter().enumerate() {
        let mut found = (0..header.len()).filter(|at| header[*at].trim() == name);
        columns[k] = found.next().ok_or_else(|| {
            let list = header.iter().collect::<Vec<_>>().join(",");
            Error::input(file, "line 1", format!("no column {name} among {list:.150}"), remedy)
        })?;
        if found.next().is_some() {
            let problem = format!("two columns are named {name}");
            return Err(Error::input(file, "line 1", problem, "rename one of them"));
        }
    }
    Ok(columns)
}

/// The number in a field. Beyond single precision's range nothing could be lit.
fn finite(row: &StringRecord, column: usize, name: &str, file: &Path) -> Result<f64> {
    let text = row[column].trim();
    match text.parse::<f64>() {
        Ok(number) if number.abs() <= f64::from(f32::MAX) => Ok(number),
        _ => {
            let place = format!("line {}, column {name}", line(row));
            let problem = format!("expected a finite number, found \"{text:.40}\"");
            Err(Error::input(file, place, problem, "correct it or take the row out"))
        }
    }
}

fn unit_normal(normal: DVec3, row: &StringRecord, file: &Path) -> Result<Vec3> {
    // Scaled first: lengths of tiny or huge vectors would leave f64's range when squared.
    let unit = (normal / normal.abs().max_element()).normalize_or_zero().as_vec3();
    if unit == Vec3::ZERO || !unit.is_finite() {
        let place = format!("line {}, columns nx,ny,nz", line(row));
        let remedy = "give the direction from which the point receives light, or take the row out";
        return Err(Error::input(file, place, "the normal has no length", remedy));
    }
    Ok(unit)
}

fn line(row: &StringRecord) -> u64 {
    row.position().map_or(0, csv::Position::line)
}

/// What the CSV reader objects to, in this program's words.
fn malformed(error: csv::Error, file: &Path) -> Error {
    let at = |pos: &Option<csv::Position>| {
        pos.as_ref().map_or_else(|| "line 1".into(), |pos| format!("line {}", pos.line()))
    };
    let (place, problem) = match error.into_kind() {
        csv::ErrorKind::Io(source) => return Error::io(file, "reading the points", source),
        csv::ErrorKind::UnequalLengths { pos, expected_len, len } => {
            (at(&pos), format!("expected {expected_len} fields as in the header, found {len}"))
        }
        csv::ErrorKind::Utf8 { pos, .. } => (at(&pos), "not UTF-8 text".into()),
        other => ("the table".into(), format!("{other:?}")),
    };
    Error::input(file, place, problem, "give comma-separated text with one row per point")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<PointTable> {
        PointTable::from_reader(text.as_bytes(), Path::new("in.csv"))
    }

    fn written(table: &PointTable, results: &[Column]) -> String {
        let mut bytes = Vec::new();
        table.write_to(&mut bytes, results).unwrap();
        String::from_utf8(bytes).unwrap()
    }

    fn complaint(text: &str) -> String {
        let error = read(text).expect_err(text);
        assert_eq!(error.exit_code(), 4, "{error}");
        error.to_string()
    }

    #[test]
    fn further_columns_stay_as_they_were_and_results_follow() {
        let text = "\u{feff}id, nx,ny,nz,x,y,z,note\r\n007,0,0,-2,1e3,-0.5, 3 ,\"a, \"\"b\"\"\"\r\n8,3,4,0,0,0,0,\r\n";
        let table = read(text).unwrap();
        let placement = Placement { origin: DVec3::new(1000.0, 0.0, 0.0), scale: 2.0 };
        let points = table.local(&placement);
        assert_eq!(points[0], SurfacePoint { position: Vec3::new(0.0, -0.25, 1.5), normal: Vec3::NEG_Z });
        assert_eq!(points[1].normal, Vec3::new(0.6, 0.8, 0.0));
        let [r, g, b] =
            Column::rgb("irradiance", &[Rgb::new(0.1, 1e-9, 3.0), Rgb::new(2e20, 0.0, 1.0 / 3.0)]);
        let out = written(&table, &[r, g, b]);
        assert_eq!(
            out,
            "id, nx,ny,nz,x,y,z,note,irradiance_r,irradiance_g,irradiance_b\n\
             007,0,0,-2,1e3,-0.5, 3 ,\"a, \"\"b\"\"\",0.1,1e-9,3\n\
             8,3,4,0,0,0,0,,2e20,0,0.33333334\n"
        );
    }

    #[test]
    fn results_of_an_earlier_run_are_replaced() {
        let table = read("x,y,z,nx,ny,nz,error,id\n0,0,0,0,0,1,0.5,a\n").unwrap();
        let out = written(&table, &[Column::new("error", [0.25])]);
        assert_eq!(out, "x,y,z,nx,ny,nz,id,error\n0,0,0,0,0,1,a,0.25\n");
        assert_eq!(table.column("id").unwrap().collect::<Vec<_>>(), ["a"]);
        assert!(table.column("none").is_none());
    }

    #[test]
    fn numbers_read_back_exactly() {
        let mut stream = crate::geometry::hash::Stream::new(5, 0);
        let bits: Vec<u64> = (0..2000).map(|_| stream.bits()).collect();
        let mut text = String::new();
        for (row, bits) in bits.iter().enumerate() {
            let (single, double) = (f32::from_bits(*bits as u32), f64::from_bits(*bits));
            text.clear();
            Values::F32(vec![single; row + 1]).append(row, &mut text);
            assert!(text.parse::<f32>().unwrap() == single || single.is_nan(), "{text} for {single:?}");
            text.clear();
            Values::F64(vec![double; row + 1]).append(row, &mut text);
            assert!(text.parse::<f64>().unwrap() == double || double.is_nan(), "{text} for {double:?}");
        }
    }

    #[test]
    fn a_header_alone_is_no_points() {
        let table = read("x,y,z,nx,ny,nz\n").unwrap();
        assert!(table.is_empty() && table.local(&Placement { origin: DVec3::ZERO, scale: 1.0 }).is_empty());
        assert_eq!(written(&table, &[Column::new("error", [])]), "x,y,z,nx,ny,nz,error\n");
        assert_eq!(read("x,y,z,nx,ny,nz").unwrap().len(), 0);
    }

    #[test]
    fn malformed_tables_are_refused_by_line_and_column() {
        let head = "x,y,z,nx,ny,nz\n0,0,0,0,0,1\n";
        for (text, words) in [
            (String::new(), "line 1: the file is empty"),
            ("\n\n".into(), "line 1: the file is empty"),
            ("x,y,z,nx,ny\n".into(), "no column nz among x,y,z,nx,ny"),
            ("0,0,0,0,0,1\n".into(), "no column x"),
            ("x,y,z,nx,ny,nz,x\n".into(), "two columns are named x"),
            (format!("{head}0,0,oops,0,0,1\n"), "line 3, column z: expected a finite number, found \"oops\""),
            (format!("{head}0,NaN,0,0,0,1\n"), "line 3, column y"),
            (format!("{head}0,0,0,0,inf,1\n"), "line 3, column ny"),
            (format!("{head}1e300,0,0,0,0,1\n"), "line 3, column x"),
            (format!("{head}0,0,0,,0,1\n"), "line 3, column nx"),
            (format!("{head}0,0,0,0,0,-0\n"), "line 3, columns nx,ny,nz: the normal has no length"),
            (format!("{head}0,0,0,0,0\n"), "line 3: expected 6 fields as in the header, found 5"),
        ] {
            let message = complaint(&text);
            assert!(message.contains(words), "{text:?}: {message}");
        }
        let error = PointTable::from_reader(&b"x,y,z,nx,ny,nz,\xff\n"[..], Path::new("in.csv")).unwrap_err();
        assert_eq!(error.exit_code(), 4, "{error}");
        assert_eq!(PointTable::read(Path::new("no/such.csv")).unwrap_err().exit_code(), 8);
    }

    #[test]
    fn tiny_normals_have_a_direction() {
        let table = read("x,y,z,nx,ny,nz\n0,0,0,0,3e-320,0\n0,0,0,1e38,1e38,0\n").unwrap();
        assert_eq!(table.normals[0], Vec3::Y);
        assert!((table.normals[1].length() - 1.0).abs() < 1e-6);
    }

    #[test]
    fn files_are_written_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.csv");
        let table = read("x,y,z,nx,ny,nz\n0,0,0,0,0,1\n").unwrap();
        table.write(&path, &[Column { name: "e".into(), values: Values::F64(vec![0.1]) }]).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "x,y,z,nx,ny,nz,e\n0,0,0,0,0,1,0.1\n");
        assert_eq!(table.write(&folder.path().join("no/out.csv"), &[]).unwrap_err().exit_code(), 8);
    }
}
