//! Messages of ROS 2 as bytes: CDR, by the definition that goes with them.

use super::definition::{Base, DEPTH_MAX, Definition, Many, Primitive};
use crate::recorded::message::{ELEMENTS_MAX, Leaves, Number};

/// Bytes of a message, from behind the four that say how it is written.
struct Cdr<'a> {
    bytes: &'a [u8],
    at: usize,
    big_endian: bool,
    /// Largest alignment: 8, or 4 in the second version.
    align_most: usize,
}

impl<'a> Cdr<'a> {
    fn new(message: &'a [u8]) -> Result<Cdr<'a>, String> {
        let Some((head, bytes)) = message.split_at_checked(4) else {
            return Err(format!("{} byte(s) are no CDR", message.len()));
        };
        let (big_endian, align_most) = match head[1] {
            0 => (true, 8),
            1 => (false, 8),
            6 => (true, 4),
            7 => (false, 4),
            other => {
                return Err(format!(
                    "CDR of kind {other:#04x}: only plain CDR (0, 1, 6, 7) is read"
                ));
            }
        };
        Ok(Cdr {
            bytes,
            at: 0,
            big_endian,
            align_most,
        })
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], String> {
        let end = self.at.checked_add(count);
        let bytes = end.and_then(|end| self.bytes.get(self.at..end));
        let bytes = bytes.ok_or_else(|| {
            format!(
                "it ends at byte {} of {}, inside a field of {count} bytes",
                self.at,
                self.bytes.len()
            )
        })?;
        self.at += count;
        Ok(bytes)
    }

    fn align(&mut self, bytes: usize) {
        let to = bytes.min(self.align_most);
        self.at = self.at.next_multiple_of(to);
    }

    fn fixed<const N: usize>(&mut self) -> Result<[u8; N], String> {
        self.align(N);
        let mut own = [0; N];
        own.copy_from_slice(self.take(N)?);
        if self.big_endian {
            own.reverse();
        }
        Ok(own)
    }

    fn number(&mut self, kind: Primitive) -> Result<Number, String> {
        Ok(match kind {
            Primitive::Bool | Primitive::U8 => Number::UInt(self.fixed::<1>()?[0].into()),
            Primitive::I8 => Number::Int(i8::from_le_bytes(self.fixed()?).into()),
            Primitive::U16 => Number::UInt(u16::from_le_bytes(self.fixed()?).into()),
            Primitive::I16 => Number::Int(i16::from_le_bytes(self.fixed()?).into()),
            Primitive::U32 => Number::UInt(u32::from_le_bytes(self.fixed()?).into()),
            Primitive::I32 => Number::Int(i32::from_le_bytes(self.fixed()?).into()),
            Primitive::U64 => Number::UInt(u64::from_le_bytes(self.fixed()?)),
            Primitive::I64 => Number::Int(i64::from_le_bytes(self.fixed()?)),
            Primitive::F32 => Number::Float(f32::from_le_bytes(self.fixed()?).into()),
            Primitive::F64 => Number::Float(f64::from_le_bytes(self.fixed()?)),
        })
    }

    fn length(&mut self) -> Result<usize, String> {
        Ok(u32::from_le_bytes(self.fixed()?) as usize)
    }

    fn text(&mut self) -> Result<&'a str, String> {
        let length = self.length()?;
        let bytes = self.take(length)?;
        let bytes = bytes.strip_suffix(&[0]).unwrap_or(bytes);
        // Text that is no UTF-8 is no name of a frame either.
        Ok(std::str::from_utf8(bytes).unwrap_or(""))
    }
}

/// Reads a message; returns the number of bytes behind its last field.
pub(crate) fn decode(
    definition: &Definition,
    message: &[u8],
    leaves: &mut Leaves,
) -> Result<usize, String> {
    let mut cdr = Cdr::new(message)?;
    structure(definition, 0, &mut cdr, leaves, 0)?;
    Ok(cdr.bytes.len().saturating_sub(cdr.at))
}

fn structure(
    definition: &Definition,
    place: usize,
    cdr: &mut Cdr<'_>,
    leaves: &mut Leaves,
    depth: usize,
) -> Result<(), String> {
    if depth > DEPTH_MAX {
        return Err(format!("it is nested beyond {DEPTH_MAX} types"));
    }
    let fields = definition.types.get(place).map_or(&[][..], Vec::as_slice);
    if fields.is_empty() {
        // IDL knows no empty structure: one byte stands for it.
        cdr.take(1)?;
        return Ok(());
    }
    for field in fields {
        let before = leaves.enter(&field.name);
        let count = match field.many {
            Many::One => {
                element(definition, &field.base, cdr, leaves, depth)?;
                leaves.leave(before);
                continue;
            }
            Many::Fixed(count) => count,
            Many::Sequence => cdr.length()?,
        };
        for index in 0..count {
            // Of long arrays of numbers the rest is passed over at once.
            if let Base::Primitive(kind) = &field.base
                && (index >= ELEMENTS_MAX || leaves.is_full())
            {
                cdr.align(kind.bytes());
                let rest = (count - index).checked_mul(kind.bytes());
                cdr.take(rest.unwrap_or(usize::MAX))?;
                break;
            }
            let outside = leaves.enter_element(index);
            let begin = cdr.at;
            element(definition, &field.base, cdr, leaves, depth)?;
            leaves.leave(outside);
            // A structure of nothing but empty arrays has no byte; a claim of any number of them costs none.
            if cdr.at == begin {
                break;
            }
        }
        leaves.leave(before);
    }
    Ok(())
}

fn element(
    definition: &Definition,
    base: &Base,
    cdr: &mut Cdr<'_>,
    leaves: &mut Leaves,
    depth: usize,
) -> Result<(), String> {
    match base {
        Base::Primitive(kind) => leaves.number(cdr.number(*kind)?),
        Base::Text => leaves.text(cdr.text()?),
        Base::WideText => {
            let length = cdr.length()?;
            cdr.take(length.saturating_mul(2))?;
        }
        Base::Struct(place) => structure(definition, *place, cdr, leaves, depth + 1)?,
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "std_msgs/Header header\nuint8 LIMIT=3\nfloat64 x 1.5\nint16[2] pair\nstring<=8 name \"a # b\"\nfloat32[] many\nPoint[] points\n\
        ================================================================================\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n\
        ================================================================================\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n\
        ================================================================================\nMSG: geometry_msgs/Point\nfloat64 x\n";

    /// Little endian, as written by hand from the standard's rules.
    fn bytes() -> Vec<u8> {
        let mut b = vec![0, 1, 0, 0];
        b.extend(7i32.to_le_bytes());
        b.extend(9u32.to_le_bytes());
        b.extend(4u32.to_le_bytes());
        b.extend(b"tow\0");
        // x is aligned to 8 from behind the head: 16 is.
        b.extend(2.25f64.to_le_bytes());
        b.extend((-3i16).to_le_bytes());
        b.extend(4i16.to_le_bytes());
        b.extend(1u32.to_le_bytes());
        b.extend(b"\0");
        b.extend([0; 3]);
        b.extend(2u32.to_le_bytes());
        b.extend(0.5f32.to_le_bytes());
        b.extend(0.1f32.to_le_bytes());
        b.extend(1u32.to_le_bytes());
        let at = b.len() - 4;
        b.extend(vec![0; at.next_multiple_of(8) - at]);
        b.extend(8.0f64.to_le_bytes());
        b
    }

    #[test]
    fn a_message_is_read_by_its_own_definition() {
        let definition = Definition::parse("pkg/msg/Own", TEXT).unwrap();
        let mut leaves = Leaves::default();
        decode(&definition, &bytes(), &mut leaves).unwrap();
        let numbers: Vec<(&str, Number)> = leaves.numbers().collect();
        assert_eq!(
            numbers,
            [
                ("header.stamp.sec", Number::Int(7)),
                ("header.stamp.nanosec", Number::UInt(9)),
                ("x", Number::Float(2.25)),
                ("pair[0]", Number::Int(-3)),
                ("pair[1]", Number::Int(4)),
                ("many[0]", Number::Float(0.5)),
                ("many[1]", Number::Float(f64::from(0.1f32))),
                ("points[0].x", Number::Float(8.0)),
            ]
        );
        assert_eq!(leaves.get_text("header.frame_id"), Some("tow"));
    }

    #[test]
    fn a_message_that_is_cut_says_where() {
        let definition = Definition::parse("pkg/msg/Own", TEXT).unwrap();
        for length in 0..bytes().len() {
            let error = decode(&definition, &bytes()[..length], &mut Leaves::default());
            assert!(error.is_err(), "{length}");
        }
        // An array that claims more than there is.
        let huge = Definition::parse("a/B", "uint8[4000000000] data").unwrap();
        assert!(decode(&huge, &[0, 1, 0, 0, 1], &mut Leaves::default()).is_err());
        // Elements without a byte, any number of them.
        let head = "=".repeat(80);
        let text = format!(
            "B[4000000000] many\n{head}\nMSG: a/B\nC[4000000000] more\n{head}\nMSG: a/C\nuint8[0] none\n"
        );
        let empty = Definition::parse("a/A", &text).unwrap();
        assert!(decode(&empty, &[0, 1, 0, 0], &mut Leaves::default()).is_ok());
        let endless = Definition::parse("a/B", "B again").unwrap();
        assert!(decode(&endless, &[0, 1, 0, 0, 1], &mut Leaves::default()).is_err());
    }
}
