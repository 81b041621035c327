//! Messages of any channel out of an indexed log, as their writer left them.

use bytes::Bytes;
use hydroline_core::frame::Frame;

use super::{IndexedLog, Place};
use crate::image_topics::ImageKind;
use crate::raw::RawSchema;
use crate::records::{self, MessageRecord};
use crate::{LogError, messages};
use mcap::records::op;

/// A channel of a log.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ChannelEntry<'a> {
    /// Number in the file.
    pub id: u16,
    /// Name of the topic.
    pub topic: &'a str,
    /// Message encoding.
    pub encoding: &'a str,
    /// Schema; its name is "" without one.
    pub schema: RawSchema<'a>,
    /// Number of messages.
    pub messages: u64,
}

impl ChannelEntry<'_> {
    /// Whether its messages are images of a type that is read.
    pub fn has_images(&self) -> bool {
        ImageKind::of(self.schema.name, self.encoding).is_some()
    }
}

/// A message that nobody decoded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PlainMessage {
    /// Number of its channel.
    pub channel: u16,
    /// MCAP sequence.
    pub sequence: u32,
    /// Host realtime at logging, UNIX \[ns\].
    pub log_ns: u64,
    /// When it was true, by its writer \[ns\].
    pub publish_ns: u64,
    /// The bytes.
    pub data: Bytes,
}

impl From<MessageRecord> for PlainMessage {
    fn from(record: MessageRecord) -> Self {
        Self {
            channel: record.channel_id,
            sequence: record.sequence,
            log_ns: record.log_ns,
            publish_ns: record.publish_ns,
            data: record.data,
        }
    }
}

impl Place {
    /// First and last time of logging of its messages \[ns\].
    pub fn span_ns(&self) -> (u64, u64) {
        self.span_ns
    }

    /// Offset of its record in the file.
    pub fn offset(&self) -> u64 {
        self.offset
    }

    /// Whether it holds no message: a chunk of declarations alone.
    pub fn is_empty(&self) -> bool {
        self.channels.is_empty()
    }

    /// Whether it holds messages of one of these channels.
    pub fn holds(&self, channels: &[u16]) -> bool {
        self.channels.iter().any(|c| channels.contains(c))
    }
}

impl IndexedLog {
    /// All channels, in the order of their numbers.
    pub fn channels(&self) -> impl Iterator<Item = ChannelEntry<'_>> {
        let declared = &self.contents.declared;
        declared.channels.values().map(|channel| {
            let schema = declared.schemas.get(&channel.schema_id);
            ChannelEntry {
                id: channel.id,
                topic: &channel.topic,
                encoding: &channel.message_encoding,
                schema: RawSchema {
                    name: schema.map_or("", |s| s.name.as_str()),
                    encoding: schema.map_or("", |s| s.encoding.as_str()),
                    data: schema.map_or(&[], |s| s.data.as_ref()),
                },
                messages: self.contents.messages_of(channel.id),
            }
        })
    }

    /// All places of messages, in the file's order.
    pub fn all_places(&self) -> &[Place] {
        &self.contents.places
    }

    /// The messages of these channels at a place, in the file's order.
    ///
    /// # Errors
    /// [`LogError::Damaged`].
    pub fn plain(&self, place: &Place, channels: &[u16]) -> Result<Vec<PlainMessage>, LogError> {
        let damaged = |damage| self.damaged((place.offset, damage));
        let (opcode, body) = place.record(&self.file).map_err(damaged)?;
        if opcode == op::MESSAGE {
            let message = records::message(&body).map_err(damaged)?;
            let wanted = channels.contains(&message.channel_id);
            return Ok(wanted.then(|| message.into()).into_iter().collect());
        }
        let content = records::chunk(&body, false).and_then(|chunk| chunk.open());
        let mut content = content.map_err(damaged)?;
        let mut found = Vec::new();
        while let Some(inner) = records::next_inner(&mut content) {
            let (opcode, body) = inner.map_err(damaged)?;
            if opcode == op::MESSAGE {
                let message = records::message(&body).map_err(damaged)?;
                if channels.contains(&message.channel_id) {
                    found.push(message.into());
                }
            }
        }
        Ok(found)
    }

    /// The image that a message holds, of our own topic or of another's; `None` = its channel holds no images that are read.
    /// A frame comes without what its `/camera/frame` says, and carries the message's sequence.
    pub fn image(&self, message: &PlainMessage) -> Option<Result<Frame, String>> {
        let declared = &self.contents.declared;
        let channel = declared.channels.get(&message.channel)?;
        let kind = ImageKind::of(declared.schema_name(channel), &channel.message_encoding)?;
        let image = kind.decode(message.data.clone());
        Some(image.and_then(|image| {
            messages::frame_from(image, None, message.sequence, message.publish_ns)
                .map_err(|e| e.to_string())
        }))
    }
}
