//! Which columns a vertex row gains, and which of its own it gives up.

use glam::Vec3;

use crate::output::exposure;
use crate::output::vertices::VertexLight;
use crate::scene::ply::header::{Element, Kind};
use crate::scene::ply::scalar::Scalar;

/// The result columns in the order of the file format.
pub const RESULTS: [(&str, Scalar); 11] = [
    ("red", Scalar::U8),
    ("green", Scalar::U8),
    ("blue", Scalar::U8),
    ("radiosity_r", Scalar::F32),
    ("radiosity_g", Scalar::F32),
    ("radiosity_b", Scalar::F32),
    ("irradiance_r", Scalar::F32),
    ("irradiance_g", Scalar::F32),
    ("irradiance_b", Scalar::F32),
    ("ambient_occlusion", Scalar::F32),
    ("error", Scalar::F32),
];

/// How many of them are colours.
const COLOURS: usize = 3;

/// The numbers of one row of results, by column; colours as sRGB bytes.
pub fn values(light: &VertexLight, exposure: f32) -> [f32; RESULTS.len()] {
    let [r, g, b] = exposure::srgb(light.radiosity, exposure).map(f32::from);
    let (Vec3 { x: br, y: bg, z: bb }, Vec3 { x: hr, y: hg, z: hb }) = (light.radiosity, light.irradiance);
    [r, g, b, br, bg, bb, hr, hg, hb, light.ambient_occlusion, light.error]
}

/// What becomes of an input's vertex columns.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Plan {
    /// Per result column, the input column (its place and type) whose values it replaces.
    pub replaced: [Option<(usize, Scalar)>; RESULTS.len()],
    /// Input colours that are replaced and kept under another name: place and type.
    pub kept: Vec<(usize, Scalar, String)>,
}

impl Plan {
    /// For the vertex element of an input.
    pub fn of(vertex: &Element) -> Self {
        let find = |name: &str| {
            vertex.properties.iter().enumerate().find_map(|(place, property)| match property.kind {
                Kind::Scalar(scalar) if property.name == name => Some((place, scalar)),
                _ => None,
            })
        };
        let replaced = RESULTS.map(|(name, _)| find(name));
        let kept_name = |k: usize| format!("input_{}", RESULTS[k].0);
        let kept = (0..COLOURS)
            .filter(|&k| vertex.properties.iter().all(|property| property.name != kept_name(k)))
            .filter_map(|k| replaced[k].map(|(place, scalar)| (place, scalar, kept_name(k))))
            .collect();
        Self { replaced, kept }
    }

    /// Header lines of the columns that are appended.
    pub fn appended_lines(&self) -> String {
        let results = RESULTS.iter().zip(&self.replaced).filter(|(_, place)| place.is_none());
        let results =
            results.map(|((name, scalar), _)| format!("property {} {name}\n", scalar_name(*scalar)));
        let kept =
            self.kept.iter().map(|(_, scalar, name)| format!("property {} {name}\n", scalar_name(*scalar)));
        results.chain(kept).collect()
    }

    /// Turns an input row (its bytes, and where each column starts) into an output row.
    pub fn apply(&self, row: &mut Vec<u8>, starts: &[usize], values: &[f32; RESULTS.len()]) {
        let mut kept = Vec::with_capacity(3 * 8);
        for (place, scalar, _) in &self.kept {
            kept.extend_from_slice(&row[starts[*place]..][..scalar.size()]);
        }
        for (k, (_, scalar)) in RESULTS.iter().enumerate() {
            match self.replaced[k] {
                None => encode(*scalar, f64::from(values[k]), row),
                Some((place, own)) => {
                    let mut word = Vec::with_capacity(8);
                    encode(
                        own,
                        if k < COLOURS { colour_as(own, values[k]) } else { f64::from(values[k]) },
                        &mut word,
                    );
                    row[starts[place]..][..word.len()].copy_from_slice(&word);
                }
            }
        }
        row.extend_from_slice(&kept);
    }
}

/// An sRGB byte in the convention of a column's type: floats hold [0, 1], 16 bits their whole range.
fn colour_as(scalar: Scalar, byte: f32) -> f64 {
    match scalar {
        Scalar::F32 | Scalar::F64 => f64::from(byte) / 255.0,
        Scalar::U16 => f64::from(byte) * 257.0,
        _ => f64::from(byte),
    }
}

/// Appends a number in little-endian bytes; integers round and saturate.
pub fn encode(scalar: Scalar, value: f64, out: &mut Vec<u8>) {
    let whole = value.round();
    match scalar {
        Scalar::I8 => out.extend((whole as i8).to_le_bytes()),
        Scalar::U8 => out.push(whole as u8),
        Scalar::I16 => out.extend((whole as i16).to_le_bytes()),
        Scalar::U16 => out.extend((whole as u16).to_le_bytes()),
        Scalar::I32 => out.extend((whole as i32).to_le_bytes()),
        Scalar::U32 => out.extend((whole as u32).to_le_bytes()),
        Scalar::F32 => out.extend((value as f32).to_le_bytes()),
        Scalar::F64 => out.extend(value.to_le_bytes()),
    }
}

/// The name that every reader of PLY knows.
pub fn scalar_name(scalar: Scalar) -> &'static str {
    match scalar {
        Scalar::I8 => "char",
        Scalar::U8 => "uchar",
        Scalar::I16 => "short",
        Scalar::U16 => "ushort",
        Scalar::I32 => "int",
        Scalar::U32 => "uint",
        Scalar::F32 => "float",
        Scalar::F64 => "double",
    }
}
