//! The record that ply-rs fills, and the element definition that makes it do so.
//!
//! ply-rs keys properties by name and so loses duplicates. The definition handed to it therefore bears names of our
//! own: the number of the role, `i` for the corner indices, `-k` for what is skipped.

use ply_rs::ply::{
    Addable, BeginList, ElementDef, Property as Value, PropertyAccess, PropertyAccessResult, PropertyDef,
    PropertyType, ScalarType,
};

use crate::scene::ply::columns::{COLOUR, Columns, ROLES, Use};
use crate::scene::ply::header::{Element, Encoding, Kind};
use crate::scene::ply::scalar::Scalar;
use crate::scene::ply::vertices::Row;

/// One row as ply-rs read it.
pub struct Record {
    /// The numbers with a role.
    pub row: Row,
    /// How many numbers of text the row took.
    pub tokens: usize,
    ints: Vec<i32>,
    uints: Vec<u32>,
    others: Vec<i64>,
}

impl Record {
    /// The corner indices, whatever their type was.
    pub fn indices(&self) -> Vec<i64> {
        let ints = self.ints.iter().map(|&i| i64::from(i));
        ints.chain(self.uints.iter().map(|&i| i64::from(i))).chain(self.others.iter().copied()).collect()
    }

    fn set(&mut self, name: &str, value: f64) -> PropertyAccessResult {
        self.tokens += 1;
        match name.parse::<usize>() {
            Ok(role) if role < ROLES => {
                self.row[role] = value;
                PropertyAccessResult::Set
            }
            _ => PropertyAccessResult::Ignored,
        }
    }

    fn set_list<T: Copy + Into<f64>>(&mut self, name: &str, values: &[T]) -> PropertyAccessResult {
        self.tokens += 1 + values.len();
        if name != "i" {
            return PropertyAccessResult::Ignored;
        }
        // Every integer of up to 32 bits is exact in an f64.
        self.others.extend(values.iter().map(|&value| value.into() as i64));
        PropertyAccessResult::Set
    }
}

impl PropertyAccess for Record {
    fn new() -> Self {
        Self { row: [0.0; ROLES], tokens: 0, ints: Vec::new(), uints: Vec::new(), others: Vec::new() }
    }

    fn set_property(&mut self, name: &str, value: Value) -> PropertyAccessResult {
        match value {
            Value::Char(v) => self.set(name, v.into()),
            Value::UChar(v) => self.set(name, v.into()),
            Value::Short(v) => self.set(name, v.into()),
            Value::UShort(v) => self.set(name, v.into()),
            Value::Int(v) => self.set(name, v.into()),
            Value::UInt(v) => self.set(name, v.into()),
            Value::Float(v) => self.set(name, v.into()),
            Value::Double(v) => self.set(name, v),
            Value::ListChar(v) => self.set_list(name, &v),
            Value::ListUChar(v) => self.set_list(name, &v),
            Value::ListShort(v) => self.set_list(name, &v),
            Value::ListUShort(v) => self.set_list(name, &v),
            Value::ListInt(v) => self.set_list(name, &v),
            Value::ListUInt(v) => self.set_list(name, &v),
            Value::ListFloat(v) => self.set_list(name, &v),
            Value::ListDouble(v) => self.set_list(name, &v),
        }
    }

    fn begin_list_int(&mut self, name: &str, length: usize) -> BeginList<'_, i32> {
        if name != "i" {
            return BeginList::UseSetter;
        }
        self.tokens += 1 + length;
        BeginList::Fill(&mut self.ints)
    }

    fn begin_list_uint(&mut self, name: &str, length: usize) -> BeginList<'_, u32> {
        if name != "i" {
            return BeginList::UseSetter;
        }
        self.tokens += 1 + length;
        BeginList::Fill(&mut self.uints)
    }
}

/// What ply-rs is to read for this element. Text is read wider than declared, so that no digits are lost and no
/// ignored column is refused for its range.
pub fn definition(element: &Element, columns: &Columns, encoding: Encoding) -> ElementDef {
    let mut definition = ElementDef::new(element.name.clone());
    definition.count = usize::try_from(element.count).unwrap_or(usize::MAX);
    let text = encoding == Encoding::Ascii;
    for (k, (property, found)) in element.properties.iter().zip(&columns.uses).enumerate() {
        let name = match found {
            Use::Role(role) => role.to_string(),
            Use::Indices => "i".to_string(),
            Use::Skipped => format!("-{k}"),
        };
        let wide = text && !matches!(found, Use::Indices | Use::Role(COLOUR..=8));
        let scalar = |scalar| if wide { ScalarType::Double } else { scalar_type(scalar) };
        let data_type = match property.kind {
            Kind::Scalar(value) => PropertyType::Scalar(scalar(value)),
            Kind::List { count, item } => PropertyType::List(scalar_type(count), scalar(item)),
        };
        definition.properties.add(PropertyDef::new(name, data_type));
    }
    definition
}

fn scalar_type(scalar: Scalar) -> ScalarType {
    match scalar {
        Scalar::I8 => ScalarType::Char,
        Scalar::U8 => ScalarType::UChar,
        Scalar::I16 => ScalarType::Short,
        Scalar::U16 => ScalarType::UShort,
        Scalar::I32 => ScalarType::Int,
        Scalar::U32 => ScalarType::UInt,
        Scalar::F32 => ScalarType::Float,
        Scalar::F64 => ScalarType::Double,
    }
}
