//! The eight number types of PLY and how to read them from bytes.

/// A number type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scalar {
    /// `char`, `int8`.
    I8,
    /// `uchar`, `uint8`.
    U8,
    /// `short`, `int16`.
    I16,
    /// `ushort`, `uint16`.
    U16,
    /// `int`, `int32`.
    I32,
    /// `uint`, `uint32`.
    U32,
    /// `float`, `float32`.
    F32,
    /// `double`, `float64`.
    F64,
}

impl Scalar {
    /// The type of this name, old style or new.
    pub fn named(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    /// Bytes in a binary file.
    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Whether it is a floating-point type.
    pub fn is_float(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }

    /// The number at the start of `bytes`, which hold at least [`Self::size`]; exact for every type.
    pub fn read(self, bytes: &[u8], big_endian: bool) -> f64 {
        match self {
            Self::F32 => f64::from(f32::from_bits(word(bytes, big_endian))),
            Self::F64 => {
                let mut eight = [0; 8];
                eight.copy_from_slice(&bytes[..8]);
                f64::from_bits(if big_endian { u64::from_be_bytes(eight) } else { u64::from_le_bytes(eight) })
            }
            _ => self.read_integer(bytes, big_endian) as f64,
        }
    }

    /// The integer at the start of `bytes`; floats are cut.
    pub fn read_integer(self, bytes: &[u8], big_endian: bool) -> i64 {
        match self {
            Self::I8 => i64::from(bytes[0] as i8),
            Self::U8 => i64::from(bytes[0]),
            Self::I16 => i64::from(half_word(bytes, big_endian) as i16),
            Self::U16 => i64::from(half_word(bytes, big_endian)),
            Self::I32 => i64::from(word(bytes, big_endian) as i32),
            Self::U32 => i64::from(word(bytes, big_endian)),
            Self::F32 | Self::F64 => self.read(bytes, big_endian) as i64,
        }
    }
}

fn word(bytes: &[u8], big_endian: bool) -> u32 {
    let four = [bytes[0], bytes[1], bytes[2], bytes[3]];
    if big_endian { u32::from_be_bytes(four) } else { u32::from_le_bytes(four) }
}

fn half_word(bytes: &[u8], big_endian: bool) -> u16 {
    let two = [bytes[0], bytes[1]];
    if big_endian { u16::from_be_bytes(two) } else { u16::from_le_bytes(two) }
}
