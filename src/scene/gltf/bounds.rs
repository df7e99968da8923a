//! What must hold before the gltf crate's readers may touch a file: they index, add and unwrap without asking.

use std::path::Path;

use gltf::accessor::{DataType, Dimensions};
use gltf::{Accessor, Document, Primitive, Semantic};

use crate::error::{Error, Result};

/// Checks the lengths in a GLB's header and first chunk; other files pass.
///
/// # Errors
/// The problem as text.
pub fn check_container(bytes: &[u8]) -> Result<(), String> {
    if !bytes.starts_with(b"glTF") {
        return Ok(());
    }
    let word = |at: usize| {
        let four = bytes.get(at..at + 4).map(|b| u64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])));
        four.ok_or_else(|| format!("truncated: {} bytes are no GLB", bytes.len()))
    };
    let (length, chunk) = (word(8)?, word(12)?);
    if length < 20 || length > bytes.len() as u64 || chunk > length - 20 {
        let found = bytes.len();
        return Err(format!(
            "lengths disagree: {length} bytes, {chunk} of them JSON, are promised, the file has {found}"
        ));
    }
    Ok(())
}

/// Checks that every buffer can be found: files exist, no network, no odd escapes.
///
/// # Errors
/// [`Error::Input`] naming the buffer and the missing file.
pub fn check_references(path: &Path, document: &Document) -> Result<()> {
    for buffer in document.buffers() {
        let gltf::buffer::Source::Uri(uri) = buffer.source() else { continue };
        let remedy = "put the file beside the .gltf, or export a .glb that holds everything";
        let place = format!("buffer {}", buffer.index());
        check_uri(path, uri).map_err(|problem| Error::input(path, place, problem, remedy))?;
    }
    Ok(())
}

/// Reads all buffers, each at least as long as the document says.
///
/// # Errors
/// [`Error::Input`] naming the buffer.
pub fn read_buffers(
    path: &Path,
    document: &Document,
    mut blob: Option<Vec<u8>>,
) -> Result<Vec<gltf::buffer::Data>> {
    let base = path.parent().unwrap_or(Path::new(""));
    let mut buffers = Vec::new();
    for buffer in document.buffers() {
        let refuse = |problem: String| super::refuse(path, format!("buffer {}", buffer.index()), problem);
        let held = blob.as_ref().map(Vec::len);
        let data = gltf::buffer::Data::from_source_and_blob(buffer.source(), Some(base), &mut blob);
        let data = data.map_err(|error| refuse(unread(&error)))?;
        if data.0.len() < buffer.length() {
            // The crate fills up to a multiple of four.
            let found = match buffer.source() {
                gltf::buffer::Source::Bin => format!("{}", held.unwrap_or(0)),
                gltf::buffer::Source::Uri(_) => format!("at most {}", data.0.len()),
            };
            return Err(refuse(format!("{} bytes are promised, {found} are there", buffer.length())));
        }
        buffers.push(data);
    }
    Ok(buffers)
}

/// Why embedded data or a file could not be read.
pub fn unread(error: &gltf::Error) -> String {
    match error {
        gltf::Error::MissingBlob => "it names no file, and the file holds no binary chunk".to_string(),
        gltf::Error::Base64(error) => format!("the embedded data are no base64: {error}"),
        other => other.to_string(),
    }
}

/// Checks that a URI is embedded data or a file that exists.
///
/// # Errors
/// The problem as text.
pub fn check_uri(path: &Path, uri: &str) -> Result<(), String> {
    if uri.starts_with("data:") {
        return Ok(());
    }
    let shown: String = uri.chars().take(80).collect();
    if uri.contains(':') {
        return Err(format!("{shown:?} is neither a relative file nor embedded data"));
    }
    let decoded = percent_decoded(uri).ok_or_else(|| format!("{shown:?} is not UTF-8 when decoded"))?;
    let file = path.parent().unwrap_or(Path::new("")).join(decoded);
    if file.is_file() {
        return Ok(());
    }
    Err(format!("{} {}", file.display(), if file.exists() { "is no file" } else { "does not exist" }))
}

fn percent_decoded(uri: &str) -> Option<String> {
    let bytes = uri.as_bytes();
    let digit = |at: usize| bytes.get(at).and_then(|&b| char::from(b).to_digit(16));
    let mut decoded = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while at < bytes.len() {
        if let (b'%', Some(high), Some(low)) = (bytes[at], digit(at + 1), digit(at + 2)) {
            decoded.push((16 * high + low) as u8);
            at += 3;
        } else {
            decoded.push(bytes[at]);
            at += 1;
        }
    }
    String::from_utf8(decoded).ok()
}

/// Checks the types and bounds of all accessors of a primitive that will be read.
///
/// # Errors
/// The problem as text.
pub fn check_primitive(primitive: &Primitive<'_>, buffers: &[gltf::buffer::Data]) -> Result<(), String> {
    use DataType::{F32, U8, U16, U32};
    if let Some(indices) = primitive.indices() {
        check_accessor(&indices, &[U8, U16, U32], &[Dimensions::Scalar], buffers)?;
    }
    for (semantic, accessor) in primitive.attributes() {
        let (types, dimensions): (&[DataType], &[Dimensions]) = match semantic {
            Semantic::Positions | Semantic::Normals => (&[F32], &[Dimensions::Vec3]),
            Semantic::Colors(_) => (&[U8, U16, F32], &[Dimensions::Vec3, Dimensions::Vec4]),
            Semantic::TexCoords(_) => (&[U8, U16, F32], &[Dimensions::Vec2]),
            _ => continue,
        };
        check_accessor(&accessor, types, dimensions, buffers).map_err(|p| format!("{semantic:?}: {p}"))?;
    }
    Ok(())
}

fn check_accessor(
    accessor: &Accessor<'_>,
    types: &[DataType],
    dimensions: &[Dimensions],
    buffers: &[gltf::buffer::Data],
) -> Result<(), String> {
    let number = accessor.index();
    if !types.contains(&accessor.data_type()) || !dimensions.contains(&accessor.dimensions()) {
        let (data_type, shape) = (accessor.data_type(), accessor.dimensions());
        return Err(format!("accessor {number} holds {shape:?} of {data_type:?}, which is not allowed here"));
    }
    let bytes: usize = buffers.iter().map(|data| data.0.len()).sum();
    if accessor.count() == 0 || accessor.count() > bytes.max(1) {
        return Err(format!(
            "accessor {number} claims {} entries, the file has {bytes} bytes",
            accessor.count()
        ));
    }
    let size = accessor.size();
    let within = |view: gltf::buffer::View<'_>, offset: usize, count: usize, size: usize| {
        let stride = view.stride().unwrap_or(size);
        let end = (count - 1)
            .checked_mul(stride)
            .and_then(|n| n.checked_add(size))
            .and_then(|n| n.checked_add(offset));
        let view_end = view.offset().checked_add(view.length());
        let length = buffers.get(view.buffer().index()).map_or(0, |data| data.0.len());
        stride >= size
            && end.is_some_and(|end| end <= view.length())
            && view_end.is_some_and(|end| end <= length)
    };
    let outside = || format!("accessor {number} reaches beyond its buffer");
    match accessor.view() {
        Some(view) if !within(view.clone(), accessor.offset(), accessor.count(), size) => {
            return Err(outside());
        }
        None if accessor.sparse().is_none() => return Err(format!("accessor {number} has no data")),
        _ => {}
    }
    if let Some(sparse) = accessor.sparse() {
        let (count, indices, values) = (sparse.count(), sparse.indices(), sparse.values());
        let index_size = indices.index_type().size();
        let sound = count > 0
            && count <= accessor.count()
            && within(indices.view(), indices.offset(), count, index_size)
            && within(values.view(), values.offset(), count, size);
        if !sound {
            return Err(outside());
        }
        check_sparse_indices(accessor, &indices, count, buffers)?;
    }
    Ok(())
}

/// Checks that the entries which a sparse accessor replaces exist and ascend: the crate drops what does not.
fn check_sparse_indices(
    accessor: &Accessor<'_>,
    indices: &gltf::accessor::sparse::Indices<'_>,
    count: usize,
    buffers: &[gltf::buffer::Data],
) -> Result<(), String> {
    let view = indices.view();
    let size = indices.index_type().size();
    let stride = view.stride().unwrap_or(size);
    let bytes = buffers.get(view.buffer().index()).map_or(&[][..], |data| &data.0[..]);
    let first = view.offset() + indices.offset();
    let mut before = None;
    for entry in 0..count {
        let at = first + entry * stride;
        let value = bytes.get(at..at + size).unwrap_or_default();
        let index = value.iter().rev().fold(0usize, |index, &byte| 256 * index + usize::from(byte));
        if index >= accessor.count() || before.is_some_and(|before| index <= before) {
            let (number, most) = (accessor.index(), accessor.count());
            return Err(format!(
                "accessor {number}: sparse index {index} does not ascend or is out of range, there are {most} entries"
            ));
        }
        before = Some(index);
    }
    Ok(())
}
