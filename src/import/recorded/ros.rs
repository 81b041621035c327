//! ROS 2: definitions of messages, their bytes, and what is known of the usual ones.

pub(super) mod cdr;
pub(super) mod definition;

use super::message::Leaves;
use definition::Definition;

/// Definitions of the usual messages: bags in db3 of before 2023 hold none. From common_interfaces of ROS 2, fields only.
const KNOWN: &str = include_str!("ros/known.msg");

/// The definition of a message that the log does not define.
pub(super) fn known(name: &str) -> Option<Definition> {
    // One text of sections `MSG: package/Type`, so that each finds the others.
    let short = name.replace("/msg/", "/");
    KNOWN
        .lines()
        .any(|l| l.strip_prefix("MSG: ") == Some(short.as_str()))
        .then(|| Definition::parse(&short, KNOWN).ok())?
}

/// Bytes that may stand behind a message's last field: writers round its length up, to 8 at most.
const PADDING_BYTES: usize = 7;

/// Whether a message of that definition has fields.
fn has_fields(definition: &Definition) -> bool {
    definition.types.first().is_some_and(|own| !own.is_empty())
}

/// Layout of a topic's messages: as the log defines it, and as the usual messages of ROS 2 have it where its type is one of them.
#[derive(Debug)]
pub(super) struct Layout {
    own: Result<Definition, String>,
    known: Option<Definition>,
}

impl Layout {
    /// The layout of a type by the text that the log defines it with; `Err` = why there is none.
    pub fn of(name: &str, text: Result<&str, String>) -> Layout {
        let own = text.and_then(|text| {
            Definition::parse(name, text)
                // Types of others that were left out.
                .or_else(|why| Definition::parse_with(name, text, KNOWN).map_err(|_| why))
        });
        let known = known(name);
        // A small message would fit an empty definition: its bytes go for padding.
        let is_left_out =
            |own: &Definition| !has_fields(own) && known.as_ref().is_some_and(has_fields);
        let own = own.and_then(|own| match is_left_out(&own) {
            true => Err("its definition in the log is empty".to_owned()),
            false => Ok(own),
        });
        Layout { own, known }
    }

    /// Decodes a message by the log's own definition, or, where that does not fit its bytes, by the usual one if that does.
    pub fn decode(&self, data: &[u8], leaves: &mut Leaves) -> Result<(), String> {
        let by_own = self.by_own(data, leaves);
        let (Some(known), true) = (&self.known, by_own.as_ref() != Ok(&true)) else {
            return by_own.map(|_| ());
        };
        leaves.clear();
        let by_known = cdr::decode(known, data, leaves);
        match by_known {
            Ok(behind) if behind <= PADDING_BYTES => Ok(()),
            _ => {
                leaves.clear();
                self.by_own(data, leaves).map(|_| ())
            }
        }
    }

    /// Whether the log's own definition fits a message to its last byte; an empty one fits only messages without any.
    fn by_own(&self, data: &[u8], leaves: &mut Leaves) -> Result<bool, String> {
        let definition = self.own.as_ref().map_err(Clone::clone)?;
        let behind = cdr::decode(definition, data, leaves)?;
        if behind > PADDING_BYTES && !has_fields(definition) {
            return Err(
                "its definition in the log is empty, and its type is none of the usual messages of ROS 2: record it with its definition, or convert the bag where its package is installed (`ros2 bag convert`)"
                    .to_owned(),
            );
        }
        Ok(behind <= PADDING_BYTES)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_known_message_compiles() {
        let mut count = 0;
        for line in KNOWN.lines() {
            if let Some(name) = line.strip_prefix("MSG: ") {
                let definition = known(&name.replace('/', "/msg/"));
                assert!(definition.is_some_and(|d| !d.types[0].is_empty()), "{name}");
                count += 1;
            }
        }
        assert!(count > 40);
        assert!(known("sensor_msgs/msg/Banana").is_none());
    }

    /// A point with its stamp: header, x, y, z.
    fn point(x: f64) -> Vec<u8> {
        let mut b = vec![0, 1, 0, 0];
        b.extend(7i32.to_le_bytes());
        b.extend(9u32.to_le_bytes());
        b.extend(4u32.to_le_bytes());
        b.extend(b"tow\0");
        for v in [x, 2.0, 3.0] {
            b.extend(f64::to_le_bytes(v));
        }
        b
    }

    fn x_of(name: &str, text: Result<&str, String>) -> Result<Option<f64>, String> {
        let mut leaves = Leaves::default();
        Layout::of(name, text).decode(&point(1.5), &mut leaves)?;
        let x = leaves.numbers().find(|n| n.0.ends_with(".x") || n.0 == "x");
        Ok(x.map(|n| n.1.to_string().parse().unwrap()))
    }

    #[test]
    fn an_empty_or_flawed_definition_of_a_known_type_fell_back_in_db3_alone() {
        let name = "geometry_msgs/msg/PointStamped";
        let line = "=".repeat(80);
        for flawed in [
            // Nothing, a blank, what it contains left out, only its beginning, another type's text, no text at all.
            Ok(""),
            Ok(" \n\n"),
            Ok("std_msgs/Header header\nPoint point\n"),
            Ok("std_msgs/Header header\n"),
            Ok("float64[9] data\n"),
            Ok("std_msgs/Header header\nBanana point\n"),
            Ok("<xml>"),
            Err("its schema is no text".to_owned()),
        ] {
            assert_eq!(x_of(name, flawed.clone()), Ok(Some(1.5)), "{flawed:?}");
        }
        // The log's own definition goes first where it fits.
        let own = format!(
            "std_msgs/Header stamp\nfloat64[2] first\nfloat64 x\n{line}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
        );
        assert_eq!(x_of(name, Ok(&own)), Ok(Some(3.0)));
        // Of a type of one's own the usual ones that it contains are known.
        let own = "std_msgs/Header header\ngeometry_msgs/Point place\n";
        assert_eq!(x_of("my_msgs/msg/Place", Ok(own)), Ok(Some(1.5)));
    }

    #[test]
    fn the_bytes_of_a_small_message_went_for_padding_where_its_definition_is_empty() {
        for (name, value) in [
            ("std_msgs/msg/Float64", &1.5_f64.to_le_bytes()[..]),
            ("std_msgs/msg/Float32", &1.5_f32.to_le_bytes()),
        ] {
            let mut leaves = Leaves::default();
            let message = [&[0, 1, 0, 0][..], value].concat();
            let layout = Layout::of(name, Ok(""));
            assert_eq!(layout.decode(&message, &mut leaves), Ok(()), "{name}");
            let data = leaves.get("data").map(|n| n.to_string());
            assert_eq!(data.as_deref(), Some("1.5"), "{name}");
            // What does not fit is said.
            let error = layout.decode(&message[..5], &mut leaves).unwrap_err();
            assert!(error.contains("definition in the log is empty"), "{error}");
        }
    }

    #[test]
    fn an_empty_definition_of_a_type_that_is_not_known_is_said() {
        let error = x_of("my_msgs/msg/Place", Ok("")).unwrap_err();
        assert!(error.contains("definition in the log is empty"), "{error}");
        // A message without fields is one byte, or none.
        let layout = Layout::of("std_msgs/msg/Empty", Ok(""));
        for bytes in [&[0, 1, 0, 0, 0][..], &[0, 1, 0, 0, 0, 0, 0, 0]] {
            assert_eq!(layout.decode(bytes, &mut Leaves::default()), Ok(()));
        }
    }
}
