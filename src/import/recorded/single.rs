//! Messages of an MCAP log one by one: which numbers stand in this one.

use hydroline_log::RawSchema;

use super::mcap::Decoder;
use super::message::Leaves;

/// Decoder of a channel's messages, by the schema that stands in the log or, of the usual ones of ROS 2 and Foxglove, by the
/// published one.
#[derive(Debug)]
pub struct MessageDecoder(Decoder);

impl MessageDecoder {
    /// For messages of an encoding and a schema.
    pub fn of(encoding: &str, schema: &RawSchema<'_>) -> Self {
        Self(Decoder::of(encoding, schema))
    }

    /// Reason why no message of the channel can be decoded; `None` = they are tried.
    pub fn refusal(&self) -> Option<&str> {
        self.0.refusal()
    }
}

/// Fields of one message; keeps its buffers between messages.
#[derive(Debug, Default)]
pub struct MessageFields(Leaves);

impl MessageFields {
    /// Reads a message in place of the one before.
    ///
    /// # Errors
    /// The reason why it cannot be decoded.
    pub fn read(&mut self, decoder: &MessageDecoder, data: &[u8]) -> Result<(), String> {
        self.0.clear();
        decoder.0.decode(data, &mut self.0)
    }

    /// Its numbers with the paths of their fields; whole numbers as the nearest double.
    pub fn numbers(&self) -> impl Iterator<Item = (&str, f64)> {
        self.0.numbers().map(|(path, n)| (path, n.as_f64()))
    }

    /// Its texts with the paths of their fields, each cut at 64 bytes.
    pub fn texts(&self) -> impl Iterator<Item = (&str, &str)> {
        self.0.texts()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn schema(name: &'static str, encoding: &'static str) -> RawSchema<'static> {
        RawSchema {
            name,
            encoding,
            data: b"",
        }
    }

    #[test]
    fn a_message_gives_its_numbers_and_its_texts() {
        let decoder = MessageDecoder::of("json", &schema("", ""));
        assert_eq!(decoder.refusal(), None);
        let mut fields = MessageFields::default();
        let text = br#"{"pose": {"x": 1.5, "n": 3}, "name": "bow"}"#;
        fields.read(&decoder, text).unwrap();
        let numbers: Vec<(&str, f64)> = fields.numbers().collect();
        assert!(numbers.contains(&("pose.x", 1.5)) && numbers.contains(&("pose.n", 3.0)));
        assert_eq!(fields.texts().collect::<Vec<_>>(), [("name", "bow")]);
        fields.read(&decoder, b"{}").unwrap();
        assert_eq!(fields.numbers().count(), 0, "of the message before");
        assert!(fields.read(&decoder, b"{").is_err());
    }

    #[test]
    fn what_is_not_read_says_why() {
        let decoder = MessageDecoder::of("ros1", &schema("std_msgs/Float64", "ros1msg"));
        assert!(decoder.refusal().unwrap().contains("ROS 1"));
        assert!(
            MessageDecoder::of("cbor", &schema("x", ""))
                .refusal()
                .unwrap()
                .contains("'cbor'")
        );
    }
}
