//! Collects the rows of a PLY's vertex element.

use glam::{DVec3, Vec2, Vec3};

use crate::light::{Rgb, srgb_to_linear};
use crate::scene::ply::columns::{COLOUR, Columns, NORMAL, POSITION, ROLES, UV};
use crate::scene::ply::scalar::Scalar;

/// The numbers of one row, by role.
pub type Row = [f64; ROLES];

/// Turns a column triple of colours into linear light.
pub struct ColourReader {
    linear_of_byte: [f32; 256],
    full_scale: f64,
    float: bool,
}

impl ColourReader {
    /// For the type of the red column: integers are sRGB over their range, floats are linear.
    pub fn new(scalar: Scalar) -> Self {
        let mut linear_of_byte = [0.0; 256];
        for (byte, linear) in linear_of_byte.iter_mut().enumerate() {
            *linear = srgb_to_linear(byte as u8);
        }
        let full_scale = if scalar == Scalar::U16 { 65_535.0 } else { 255.0 };
        Self { linear_of_byte, full_scale, float: scalar.is_float() }
    }

    /// The colour of a row. Floats pass unchanged, whatever their range.
    pub fn colour(&self, row: &Row) -> Rgb {
        let channel = |k: usize| {
            let value = row[COLOUR + k];
            if self.float {
                value as f32
            } else if self.full_scale == 255.0 {
                self.linear_of_byte[value.clamp(0.0, 255.0) as usize]
            } else {
                srgb_decoded(value / self.full_scale)
            }
        };
        Vec3::new(channel(0), channel(1), channel(2))
    }

    /// Whether colours pass as they are.
    pub fn is_float(&self) -> bool {
        self.float
    }
}

/// sRGB decoding of a value in [0, 1].
pub fn srgb_decoded(s: f64) -> f32 {
    let linear = if s <= 0.040_45 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) };
    linear as f32
}

/// Vertices as they come.
pub struct Vertices {
    /// Positions, in file units.
    pub positions: Vec<DVec3>,
    /// Normals as written.
    pub normals: Option<Vec<Vec3>>,
    /// Linear colours.
    pub colours: Option<Vec<Rgb>>,
    /// Texture coordinates, v upwards as files have it.
    pub uv: Option<Vec<Vec2>>,
    colour_reader: Option<ColourReader>,
}

impl Vertices {
    /// Room for `count` rows with these columns; the caller has checked the count against the file's size.
    pub fn with_capacity(columns: &Columns, count: usize) -> Self {
        let colour_reader = columns.roles[COLOUR].map(ColourReader::new);
        Self {
            positions: Vec::with_capacity(count),
            normals: columns.has(NORMAL).then(|| Vec::with_capacity(count)),
            colours: colour_reader.is_some().then(|| Vec::with_capacity(count)),
            uv: columns.has(UV).then(|| Vec::with_capacity(count)),
            colour_reader,
        }
    }

    /// Adds a row; the problem is returned as text when its position is not finite.
    pub fn push(&mut self, row: &Row) -> Result<(), String> {
        let position = DVec3::new(row[POSITION], row[POSITION + 1], row[POSITION + 2]);
        if !position.is_finite() {
            return Err(format!("the position ({position}) is not finite"));
        }
        self.positions.push(position);
        if let Some(normals) = &mut self.normals {
            normals.push(DVec3::new(row[NORMAL], row[NORMAL + 1], row[NORMAL + 2]).as_vec3());
        }
        if let (Some(colours), Some(reader)) = (&mut self.colours, &self.colour_reader) {
            colours.push(reader.colour(row));
        }
        if let Some(uv) = &mut self.uv {
            uv.push(Vec2::new(row[UV] as f32, row[UV + 1] as f32));
        }
        Ok(())
    }

    /// Whether the colours were floating-point numbers.
    pub fn has_float_colours(&self) -> bool {
        self.colour_reader.as_ref().is_some_and(ColourReader::is_float)
    }
}
