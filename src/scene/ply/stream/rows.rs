//! Vertices by number: rows of one length in a map, of the file itself or of a copy.

use glam::{DVec3, Vec3};

use crate::archive::Map;
use crate::light::{Rgb, srgb_to_linear};
use crate::scene::ply::body::binary::{Field, read_fields};
use crate::scene::ply::columns::{COLOUR, NORMAL, POSITION, ROLES, UV};
use crate::scene::ply::scalar::Scalar;
use crate::scene::ply::vertices::{ColourReader, Row};

/// Rows of one length.
pub struct Rows {
    map: Map,
    /// Offset of the first row.
    pub start: usize,
    stride: usize,
    big: bool,
    /// Offset of three little-endian `float`s side by side: what nearly all files have.
    singles: Option<usize>,
    position: Vec<Field>,
    normal: Vec<Field>,
    colour: Vec<Field>,
    colour_reader: Option<ColourReader>,
    /// Float colours that are meant as bytes.
    pub float_bytes: bool,
}

impl Rows {
    /// Rows from `start` on, whose numbers with a role are `fields`; the caller has checked that the map holds them all.
    pub fn new(map: Map, start: usize, stride: usize, fields: &[Field], big: bool) -> Self {
        let group = |range: std::ops::Range<usize>| -> Vec<Field> {
            let mut group: Vec<Field> =
                fields.iter().filter(|field| range.contains(&field.role)).copied().collect();
            group.sort_by_key(|field| field.role);
            group
        };
        let (position, colour) = (group(POSITION..NORMAL), group(COLOUR..UV));
        let first = position[0].offset;
        let beside =
            |(k, field): (usize, &Field)| field.scalar == Scalar::F32 && field.offset == first + 4 * k;
        let singles = (!big && position.iter().enumerate().all(beside)).then_some(first);
        let colour_reader = colour.first().map(|field| ColourReader::new(field.scalar));
        let normal = group(NORMAL..COLOUR);
        Self { map, start, stride, big, singles, position, normal, colour, colour_reader, float_bytes: false }
    }

    /// The map that holds them.
    pub fn map(&self) -> &Map {
        &self.map
    }

    /// The offset of a row.
    pub fn offset(&self, vertex: u32) -> usize {
        self.start + vertex as usize * self.stride
    }

    #[inline]
    fn bytes(&self, vertex: u32) -> &[u8] {
        &self.map.as_ref()[self.offset(vertex)..][..self.stride]
    }

    /// Position as written.
    #[inline]
    pub fn position(&self, vertex: u32) -> DVec3 {
        let bytes = self.bytes(vertex);
        if let Some(at) = self.singles {
            let twelve: [[u8; 4]; 3] = bytemuck::pod_read_unaligned(&bytes[at..at + 12]);
            let [x, y, z] = twelve.map(|four| f64::from(f32::from_le_bytes(four)));
            return DVec3::new(x, y, z);
        }
        self.triple(bytes, &self.position)
    }

    /// Normal as written.
    pub fn normal(&self, vertex: u32) -> Option<Vec3> {
        (!self.normal.is_empty()).then(|| self.triple(self.bytes(vertex), &self.normal).as_vec3())
    }

    /// Whether there are colours.
    pub fn has_colours(&self) -> bool {
        self.colour_reader.is_some()
    }

    /// Linear colour.
    pub fn colour(&self, vertex: u32) -> Option<Rgb> {
        let reader = self.colour_reader.as_ref()?;
        let mut row: Row = [0.0; ROLES];
        read_fields(&self.colour, self.bytes(vertex), self.big, &mut row);
        let colour = reader.colour(&row);
        if !self.float_bytes {
            return Some(colour);
        }
        Some(Vec3::from_array(colour.to_array().map(|value| srgb_to_linear(value.round() as u8))))
    }

    fn triple(&self, bytes: &[u8], fields: &[Field]) -> DVec3 {
        let value = |k: usize| fields[k].scalar.read(&bytes[fields[k].offset..], self.big);
        DVec3::new(value(0), value(1), value(2))
    }
}
