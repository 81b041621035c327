//! Records whose fields stand at fixed places: DataFlash, MAVLink, ULog.

use half::f16;

use super::message::{Leaves, Number};

/// Type of a value in a record, little endian.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Kind {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F16,
    F32,
    F64,
    /// Characters, so many bytes.
    Text(usize),
    /// So many bytes of nothing.
    Padding(usize),
}

impl Kind {
    /// A number by its usual name: `u8`, `i16`, `f32` ..
    pub fn number(name: &str) -> Option<Kind> {
        Some(match name {
            "u8" => Kind::U8,
            "i8" => Kind::I8,
            "u16" => Kind::U16,
            "i16" => Kind::I16,
            "u32" => Kind::U32,
            "i32" => Kind::I32,
            "u64" => Kind::U64,
            "i64" => Kind::I64,
            "f16" => Kind::F16,
            "f32" => Kind::F32,
            "f64" => Kind::F64,
            _ => return None,
        })
    }

    pub fn bytes(self) -> usize {
        match self {
            Kind::U8 | Kind::I8 => 1,
            Kind::U16 | Kind::I16 | Kind::F16 => 2,
            Kind::U32 | Kind::I32 | Kind::F32 => 4,
            Kind::U64 | Kind::I64 | Kind::F64 => 8,
            Kind::Text(n) | Kind::Padding(n) => n,
        }
    }
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Field {
    pub name: String,
    pub kind: Kind,
    /// `None` = one value; else an array.
    pub elements: Option<usize>,
    /// Value of one count: 1 (whole numbers stay whole), 0.01, 1e-7.
    pub scale: f64,
    /// As the log states it; empty = not at all.
    pub unit: String,
}

impl Field {
    pub fn bytes(&self) -> usize {
        self.kind.bytes().saturating_mul(self.elements.unwrap_or(1))
    }
}

pub(super) fn bytes(fields: &[Field]) -> usize {
    fields
        .iter()
        .fold(0, |sum, f| sum.saturating_add(f.bytes()))
}

fn fixed<const N: usize>(bytes: &[u8], at: usize) -> Option<[u8; N]> {
    bytes.get(at..at.checked_add(N)?)?.try_into().ok()
}

/// The number at a place; `None` = the record ends before it, or it is no number.
pub(super) fn number(bytes: &[u8], at: usize, kind: Kind) -> Option<Number> {
    Some(match kind {
        Kind::U8 => Number::UInt((*bytes.get(at)?).into()),
        Kind::I8 => Number::Int(i8::from_le_bytes(fixed(bytes, at)?).into()),
        Kind::U16 => Number::UInt(u16::from_le_bytes(fixed(bytes, at)?).into()),
        Kind::I16 => Number::Int(i16::from_le_bytes(fixed(bytes, at)?).into()),
        Kind::U32 => Number::UInt(u32::from_le_bytes(fixed(bytes, at)?).into()),
        Kind::I32 => Number::Int(i32::from_le_bytes(fixed(bytes, at)?).into()),
        Kind::U64 => Number::UInt(u64::from_le_bytes(fixed(bytes, at)?)),
        Kind::I64 => Number::Int(i64::from_le_bytes(fixed(bytes, at)?)),
        Kind::F16 => Number::Float(f16::from_le_bytes(fixed(bytes, at)?).to_f64()),
        Kind::F32 => Number::Float(f32::from_le_bytes(fixed(bytes, at)?).into()),
        Kind::F64 => Number::Float(f64::from_le_bytes(fixed(bytes, at)?)),
        Kind::Text(_) | Kind::Padding(_) => return None,
    })
}

/// Text at a place, up to its first 0.
pub(super) fn text(bytes: &[u8], at: usize, length: usize) -> &str {
    let own = bytes.get(at..at.saturating_add(length)).unwrap_or(&[]);
    let end = own.iter().position(|b| *b == 0).unwrap_or(own.len());
    std::str::from_utf8(&own[..end]).unwrap_or("")
}

fn scaled(value: Number, scale: f64) -> Number {
    if scale == 1.0 {
        return value;
    }
    // Hundredths and ten-millionths: the quotient by a whole number is the nearest double, the product is not.
    let parts = (1.0 / scale).round();
    Number::Float(match value {
        Number::Int(v) => v as f64 / parts,
        Number::UInt(v) => v as f64 / parts,
        Number::Float(v) => v / parts,
    })
}

/// Unit of the field that a path of leaves begins with, where the log states one.
pub(super) fn unit_of(fields: &[Field], path: &str) -> Option<String> {
    let name = path.split('[').next().unwrap_or(path);
    let field = fields.iter().find(|f| f.name == name)?;
    Some(field.unit.clone()).filter(|u| !u.is_empty())
}

pub(super) fn decode(fields: &[Field], record: &[u8], leaves: &mut Leaves) {
    let mut at = 0;
    for field in fields {
        let before = leaves.enter(&field.name);
        match (field.kind, field.elements) {
            (Kind::Text(length), None) => leaves.text(text(record, at, length)),
            (_, None) => {
                if let Some(v) = number(record, at, field.kind) {
                    leaves.number(scaled(v, field.scale));
                }
            }
            (_, Some(elements)) => {
                for index in 0..elements.min(super::message::ELEMENTS_MAX) {
                    if let Some(v) = number(record, at + index * field.kind.bytes(), field.kind) {
                        let outside = leaves.enter_element(index);
                        leaves.number(scaled(v, field.scale));
                        leaves.leave(outside);
                    }
                }
            }
        }
        leaves.leave(before);
        at += field.bytes();
    }
}
