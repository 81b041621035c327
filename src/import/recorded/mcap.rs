//! MCAP: ROS 2 bags, Foxglove's and anyone's messages whose schema is in the file.

use std::collections::HashMap;
use std::path::Path;

use hydroline_log::{RawMessage, RawReader, RawSchema, image_damage};
use prost_reflect::MessageDescriptor;

use super::message::{Account, Leaves, Message, RecordedError, Sink};
use super::ros::Layout;
use super::{DAMAGED, json, protobuf, stamps};

/// Decoder of a channel's messages.
#[derive(Debug)]
pub(super) enum Decoder {
    Ros(Layout),
    Protobuf(MessageDescriptor),
    Json,
    /// Reason why they are not decoded.
    None(String),
}

impl Decoder {
    pub fn of(encoding: &str, schema: &RawSchema<'_>) -> Decoder {
        let ready = match (encoding, schema.encoding) {
            ("cdr", "ros2msg") => {
                let text = std::str::from_utf8(schema.data)
                    .map_err(|_| "its schema is no text".to_owned());
                Ok(Decoder::Ros(Layout::of(schema.name, text)))
            }
            ("cdr", _) if schema.name.is_empty() => {
                Err("its channel names no schema: nothing says what its bytes mean".to_owned())
            }
            ("cdr", other) => Ok(Decoder::Ros(Layout::of(
                schema.name,
                Err(format!(
                    "CDR with a schema in '{other}' is read for the usual messages of ROS 2 only"
                )),
            ))),
            ("protobuf", _) => {
                protobuf::descriptor(schema.name, schema.data).map(Decoder::Protobuf)
            }
            ("json", _) => Ok(Decoder::Json),
            ("ros1", _) => Err(
                "messages of ROS 1 are not read, those of ROS 2 are: convert the bag that they come from (`pip install rosbags`, then `rosbags-convert --src FILE.bag --dst FOLDER`) and import that folder"
                    .to_owned(),
            ),
            (other, _) => Err(format!(
                "messages in '{other}' are not read: cdr, protobuf and json are"
            )),
        };
        ready.unwrap_or_else(Decoder::None)
    }

    /// Reason why none is decoded.
    pub fn refusal(&self) -> Option<&str> {
        match self {
            Decoder::None(why) => Some(why),
            _ => None,
        }
    }

    pub fn decode(&self, data: &[u8], leaves: &mut Leaves) -> Result<(), String> {
        match self {
            Decoder::Ros(layout) => layout.decode(data, leaves),
            Decoder::Protobuf(descriptor) => protobuf::decode(descriptor, data, leaves),
            Decoder::Json => json::decode(data, leaves),
            Decoder::None(why) => Err(why.clone()),
        }
    }
}

/// A channel, as far as it is known.
struct Channel {
    decoder: Decoder,
    schema: String,
}

pub(super) fn read(path: &Path, sink: &mut dyn Sink) -> Result<Account, RecordedError> {
    let mut reader = RawReader::open(path).map_err(|e| RecordedError::Container(e.to_string()))?;
    let mut account = Account::default();
    let mut channels: HashMap<(u32, u16), Channel> = HashMap::new();
    let mut leaves = Leaves::default();
    while let Some(item) = reader.next() {
        let message: RawMessage = match item {
            Ok(message) => message,
            Err(error) => {
                let at = match &error {
                    hydroline_log::LogError::Damaged { offset, .. } => *offset,
                    _ => 0,
                };
                account.note(DAMAGED, at, || error.to_string());
                continue;
            }
        };
        let channel = channels.entry(message.channel).or_insert_with(|| {
            let schema = reader.schema(&message);
            Channel {
                decoder: Decoder::of(&message.encoding, &schema),
                schema: schema.name.to_owned(),
            }
        });
        if channel.schema.starts_with("hydroline.") {
            return Err(RecordedError::Ours);
        }
        account.count(&message.topic);
        if sink.checks_images()
            && let Some(damage) = image_damage(&channel.schema, &message.encoding, &message.data)
        {
            let what = format!("images of {}", message.topic);
            account.note(&what, message.offset, || damage.to_string());
        }
        let log_ns = Some(i128::from(message.log_ns));
        if !sink.wants(&message.topic, &channel.schema, message.data.len()) {
            sink.other(&message.topic, &channel.schema, log_ns);
            continue;
        }
        leaves.clear();
        if let Err(reason) = channel.decoder.decode(&message.data, &mut leaves) {
            account.undecoded(&message.topic, message.offset, || reason);
            sink.other(&message.topic, &channel.schema, log_ns);
            continue;
        }
        let whole = Message {
            topic: &message.topic,
            schema: &channel.schema,
            log_ns,
            stamp_ns: stamps::of(&leaves, ""),
            leaves: &leaves,
            unit: &|_| None,
        };
        stamps::divided(&whole, sink)?;
    }
    account.skipped_bytes = reader.skipped_bytes();
    Ok(account)
}
