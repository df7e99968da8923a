//! The input PLY again, with columns for the light of its vertices.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use super::body::Body;
use super::columns::{Plan, scalar_name, values};
use super::{Work, put};
use crate::error::{Error, Result};
use crate::output::file::{Sink, write_whole};
use crate::scene::ply::header::{Element, Encoding, Header, Kind};
use crate::scene::ply::read_header;

/// Bytes that a vertex gains: three colours and eight floats.
const GAINED_BYTES: u64 = 35;

/// Streams `source` to `path`; memory does not grow with the file.
pub fn write(path: &Path, source: &Path, work: &Work<'_>) -> Result<()> {
    let failed = |e: io::Error| Error::io(source, "reading the mesh again", e);
    let mut file = File::open(source).map_err(failed)?;
    let source_bytes = file.metadata().map_err(failed)?.len();
    let header = read_header(source, &mut file)?;
    header.check_counts(source, source_bytes)?;
    let count = work.lights.count() as u64;
    let vertex = header.elements.iter().find(|element| element.name == "vertex");
    let Some(vertex) = vertex.filter(|vertex| vertex.count == count) else {
        let problem = format!("expected {count} vertices, as when it was baked");
        return Err(Error::input(source, "element vertex", problem, "bake the changed file again"));
    };
    let own = |name: &str| vertex.properties.iter().any(|property| property.name == name);
    if !work.transfers.columns.is_empty() && own("transfer_0_r") {
        let problem = format!("{}: has transfers already: bake the mesh without them", source.display());
        return Err(Error::Usage(problem));
    }
    let plan = Plan::of(vertex);
    let remarks = remarks(&mut file, &header).map_err(failed)?;
    file.seek(SeekFrom::Start(header.body_offset)).map_err(failed)?;
    let mut body = Body {
        path: source,
        source: BufReader::with_capacity(1 << 20, file),
        encoding: header.encoding,
        line_end: header.line_end,
    };
    write_whole(path, source_bytes + count * (GAINED_BYTES + work.transfers.bytes()), |sink| {
        put(path, sink, &head(&header, &remarks, &plan, work))?;
        let mut remaining = header.elements.iter();
        for element in remaining.by_ref() {
            if std::ptr::eq(element, vertex) {
                vertices((path, sink), &mut body, (element, &plan), work)?;
                break;
            }
            copy_rows((path, &mut *sink), &mut body, element)?;
        }
        if header.encoding == Encoding::Little {
            // Nothing after the vertices changes.
            return io::copy(&mut body.source, sink).map(|_| ()).map_err(|e| Error::io(path, "writing", e));
        }
        remaining.try_for_each(|element| copy_rows((path, &mut *sink), &mut body, element))
    })
}

/// The `comment` and `obj_info` lines as they stand, but for those that an earlier export wrote.
fn remarks(file: &mut File, header: &Header) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    file.seek(SeekFrom::Start(0))?;
    file.by_ref().take(header.body_offset).read_to_end(&mut bytes)?;
    let mut kept = Vec::new();
    for line in bytes.split(|&b| b == header.line_end).map(<[u8]>::trim_ascii) {
        let remark = line.starts_with(b"comment") || line.starts_with(b"obj_info");
        if remark && !line.starts_with(b"comment glowtree: ") {
            kept.extend_from_slice(line);
            kept.push(b'\n');
        }
    }
    Ok(kept)
}

fn head(header: &Header, remarks: &[u8], plan: &Plan, work: &Work<'_>) -> Vec<u8> {
    let mut head = b"ply\nformat binary_little_endian 1.0\n".to_vec();
    head.extend_from_slice(remarks);
    head.extend_from_slice(work.comments().as_bytes());
    if !plan.kept.is_empty() {
        head.extend_from_slice(
            b"comment glowtree: input_red input_green input_blue are the colours of the input\n",
        );
    }
    let mut widened = false;
    for element in &header.elements {
        head.extend_from_slice(format!("element {} {}\n", element.name, element.count).as_bytes());
        for property in &element.properties {
            let kind = match property.kind {
                Kind::Scalar(scalar) => scalar_name(scalar).to_owned(),
                Kind::List { count, item } => format!("list {} {}", scalar_name(count), scalar_name(item)),
            };
            head.extend_from_slice(format!("property {kind} ").as_bytes());
            // Names were read as Latin-1.
            head.extend(property.name.chars().map(|c| u8::try_from(u32::from(c)).unwrap_or(b'?')));
            head.push(b'\n');
        }
        if element.name == "vertex" && !widened {
            widened = true;
            head.extend_from_slice(plan.appended_lines().as_bytes());
            head.extend_from_slice(work.transfers.lines().as_bytes());
        }
    }
    head.extend_from_slice(b"end_header\n");
    head
}

fn vertices(
    (path, sink): (&Path, &mut Sink),
    body: &mut Body<'_, impl io::BufRead>,
    (element, plan): (&Element, &Plan),
    work: &Work<'_>,
) -> Result<()> {
    let (mut row, mut starts) = (Vec::new(), Vec::new());
    work.for_each(element.count as usize, |vertex, light| {
        body.row(element, &mut row, &mut starts)?;
        plan.apply(&mut row, &starts, &values(light, work.exposure));
        work.transfers.put(vertex, &mut row);
        put(path, sink, &row)
    })
}

fn copy_rows(
    (path, sink): (&Path, &mut Sink),
    body: &mut Body<'_, impl io::BufRead>,
    element: &Element,
) -> Result<()> {
    let (mut row, mut starts) = (Vec::new(), Vec::new());
    for _ in 0..element.count {
        body.row(element, &mut row, &mut starts)?;
        put(path, sink, &row)?;
    }
    Ok(())
}
