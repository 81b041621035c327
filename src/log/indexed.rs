//! Messages of some topics out of a log, without the rest of it: by the file's own index.
//!
//! The summary at a log's end says where each chunk lies and which channels it holds. Chunks without a wanted message
//! are not read; those that are have their checksum compared as everywhere. A log without a summary (cut, or written
//! by a program that makes none) is read once from start to end to find the same.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use bytes::Bytes;
use hydroline_core::frame::GreyRule;
use hydroline_numerics::cancel;
use hydroline_rigs::bounded;
use mcap::records::op;

use super::LogError;
use super::part::MetadataMap;
use super::reader::{self, LogMessage};
use super::records::{self, Damage, Located, MessageRecord};
use super::scan;
use super::topic::Topic;
use contents::Contents;

mod contents;
mod plain;
pub(super) use contents::{declared_at_end, summary};
pub use plain::{ChannelEntry, PlainMessage};

/// A record that holds messages: a chunk, or a message by itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// First and last time of logging of its messages \[ns\].
    span_ns: (u64, u64),
    offset: u64,
    /// Bytes of the record with its prefix; `None` = not known.
    bytes: Option<u64>,
    /// Channels of which it holds messages.
    channels: Vec<u16>,
    /// Bytes of the message indexes behind it.
    index_bytes: u64,
    /// Messages in it, by channel: what the message indexes say, once they are read.
    messages: OnceLock<BTreeMap<u16, u64>>,
}

/// A log of which it is known what lies where. Reading takes no exclusive access: several threads may.
#[derive(Debug)]
pub struct IndexedLog {
    path: PathBuf,
    file: File,
    contents: Contents,
    end_missing: Option<LogError>,
}

impl IndexedLog {
    /// Opens a log and reads its index, or the whole of it where there is none.
    ///
    /// # Errors
    /// [`LogError::Read`], [`LogError::NotMcap`], [`LogError::Empty`]; without a sound index also damage. A missing end
    /// is none: [`IndexedLog::end_missing`].
    pub fn open(path: &Path) -> Result<Self, LogError> {
        // Says what is wrong with a file that is no log.
        let scan = scan::open(path)?;
        let file = bounded::open(path).map_err(LogError::read(path))?;
        // A summary that is damaged does not make the messages unreadable.
        let (contents, end_missing) = match contents::summary(&file) {
            Ok(Some(contents)) => (contents, None),
            Ok(None) | Err(_) => contents::scanned(path, scan)?,
        };
        Ok(Self {
            path: path.to_owned(),
            file,
            contents,
            end_missing,
        })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Why the log ends before its end, if it does: everything before that is here.
    pub fn end_missing(&self) -> Option<&LogError> {
        self.end_missing.as_ref()
    }

    /// Metadata by name: `rig`, `calibration`, `session`, `summary`, where they are there.
    pub fn metadata(&self) -> &BTreeMap<String, MetadataMap> {
        &self.contents.metadata
    }

    /// How grey levels come out of the log's frames, as [`super::LogReader::grey_rule`].
    pub fn grey_rule(&self) -> GreyRule {
        reader::grey_rule(&self.contents.metadata)
    }

    /// Messages of each topic.
    pub fn counts(&self) -> BTreeMap<&str, u64> {
        self.contents.counts()
    }

    /// Whether all messages of a topic were found that [`IndexedLog::visit`] hands on (those of its own type): the index
    /// is taken at its word until they are read.
    ///
    /// # Errors
    /// [`LogError::Damaged`] with [`Damage::MessageCount`]: the index and the messages disagree.
    pub fn all_found(&self, topic: Topic, found: u64) -> Result<(), LogError> {
        let readable = self.readable_channels(&[topic]);
        let counts = readable
            .iter()
            .map(|(id, _)| self.contents.messages_of(*id));
        let stated = counts.sum();
        if stated == found {
            return Ok(());
        }
        Err(self.miscounted(stated, found))
    }

    fn miscounted(&self, stated: u64, found: u64) -> LogError {
        let damage = Damage::MessageCount { stated, found };
        self.damaged((self.contents.stated_at, damage))
    }

    /// Channels of these topics whose messages are of the topic's own type.
    fn readable_channels(&self, topics: &[Topic]) -> Vec<(u16, Topic)> {
        let declared = &self.contents.declared;
        let channels = declared.channels.iter().filter_map(|(id, channel)| {
            let topic = Topic::find(&channel.topic, declared.schema_name(channel))
                .filter(|t| channel.message_encoding == "protobuf" && topics.contains(t))?;
            Some((*id, topic))
        });
        channels.collect()
    }

    fn is_wanted(&self, channel: u16, topics: &[&str]) -> bool {
        let channel = self.contents.declared.channels.get(&channel);
        channel.is_some_and(|c| topics.contains(&c.topic.as_str()))
    }

    /// Places of messages of these topics, in the file's order.
    pub fn places(&self, topics: &[&str]) -> Vec<&Place> {
        let holds = |p: &&Place| p.channels.iter().any(|c| self.is_wanted(*c, topics));
        self.contents.places.iter().filter(holds).collect()
    }

    /// The messages of these topics at a place. A frame comes without what its `/camera/frame` says.
    ///
    /// # Errors
    /// [`LogError::Damaged`], [`LogError::Message`], [`LogError::Read`].
    pub fn messages(&self, place: &Place, topics: &[&str]) -> Result<Vec<LogMessage>, LogError> {
        let wanted = self.raw(place, topics)?;
        let each = wanted.into_iter().map(|m| self.decode(place.offset, m));
        each.collect()
    }

    /// Hands on the messages of these topics at these places as they lie there, undecoded: topic, time of logging, bytes.
    /// Faster than [`IndexedLog::messages`] where there are many; a message of another type on the topic is left out. A
    /// computation that is cancelled ends here.
    ///
    /// # Errors
    /// As [`IndexedLog::messages`]; words of `each` become a [`LogError::Message`].
    pub fn visit(
        &self,
        places: &[&Place],
        topics: &[Topic],
        mut each: impl FnMut(Topic, u64, &[u8]) -> Result<(), String>,
    ) -> Result<(), LogError> {
        let wanted = self.readable_channels(topics);
        for place in places {
            cancel::check();
            self.visit_place(place, &wanted, &mut each)?;
        }
        Ok(())
    }

    fn visit_place(
        &self,
        place: &Place,
        wanted: &[(u16, Topic)],
        mut each: impl FnMut(Topic, u64, &[u8]) -> Result<(), String>,
    ) -> Result<(), LogError> {
        let offset = place.offset;
        let damaged = |damage| self.damaged((offset, damage));
        let hand_on = |id: u16, log_ns: u64, data: &[u8]| {
            let Some((_, topic)) = wanted.iter().find(|(channel, _)| *channel == id) else {
                return Ok(());
            };
            each(*topic, log_ns, data).map_err(|reason| Stop::Message(*topic, reason))
        };
        let (opcode, body) = place.record(&self.file).map_err(damaged)?;
        let visited = if opcode == op::MESSAGE {
            let message = records::message(&body).map_err(damaged)?;
            let mut hand_on = hand_on;
            hand_on(message.channel_id, message.log_ns, &message.data)
        } else {
            let content = records::chunk(&body, false).and_then(|chunk| chunk.open());
            records::each_message(&content.map_err(damaged)?, hand_on)
        };
        visited.map_err(|stop| match stop {
            Stop::Damage(damage) => damaged(damage),
            Stop::Message(topic, reason) => LogError::Message {
                path: self.path.clone(),
                offset,
                topic: topic.name().to_owned(),
                schema: topic.schema_name().to_owned(),
                reason,
            },
        })
    }

    /// Message `index` of a topic, from 0 in the file's order; `None` = there are not so many.
    ///
    /// # Errors
    /// As [`IndexedLog::messages`]; [`Damage::MessageCount`] where the log states that many and they are not there.
    pub fn nth(&self, topic: &str, index: u64) -> Result<Option<LogMessage>, LogError> {
        let mut left = index;
        for place in self.places(&[topic]) {
            let here = place
                .messages(&self.file)
                .map_err(|damage| self.damaged((place.offset, damage)))?;
            let here = here.iter().filter(|(c, _)| self.is_wanted(**c, &[topic]));
            let here: u64 = here.map(|(_, n)| n).sum();
            if left < here {
                let message = self.raw(place, &[topic])?.into_iter().nth(left as usize);
                return message.map(|m| self.decode(place.offset, m)).transpose();
            }
            left -= here;
        }
        let stated = self.counts().get(topic).copied().unwrap_or(0);
        if index < stated {
            return Err(self.miscounted(stated, index - left));
        }
        Ok(None)
    }

    fn raw(&self, place: &Place, topics: &[&str]) -> Result<Vec<MessageRecord>, LogError> {
        self.undecoded(place, topics).map_err(|at| self.damaged(at))
    }

    fn damaged(&self, at: Located) -> LogError {
        LogError::damaged(&self.path, at)
    }

    fn undecoded(&self, place: &Place, topics: &[&str]) -> Result<Vec<MessageRecord>, Located> {
        let at = |damage| (place.offset, damage);
        let (opcode, body) = place.record(&self.file).map_err(at)?;
        if opcode == op::MESSAGE {
            return Ok(vec![records::message(&body).map_err(at)?]);
        }
        let mut content = records::chunk(&body, false)
            .and_then(|chunk| chunk.open())
            .map_err(at)?;
        let mut found = Vec::new();
        while let Some(inner) = records::next_inner(&mut content) {
            let (opcode, body) = inner.map_err(at)?;
            if opcode == op::MESSAGE {
                let message = records::message(&body).map_err(at)?;
                if self.is_wanted(message.channel_id, topics) {
                    found.push(message);
                }
            }
        }
        Ok(found)
    }

    fn decode(&self, offset: u64, message: MessageRecord) -> Result<LogMessage, LogError> {
        let id = message.channel_id;
        let channel = self.contents.declared.channels.get(&id);
        let channel = channel.ok_or_else(|| self.damaged((offset, Damage::UnknownChannel(id))))?;
        let schema = self.contents.declared.schema_name(channel);
        LogMessage::of(&self.path, offset, channel, schema, message, |m| {
            reader::decode(channel, schema, m, &mut None)
        })
    }
}

/// Reason why a visit ends early.
enum Stop {
    Damage(Damage),
    Message(Topic, String),
}

impl From<Damage> for Stop {
    fn from(damage: Damage) -> Self {
        Stop::Damage(damage)
    }
}

impl Place {
    /// Opcode and body of the record.
    fn record(&self, file: &File) -> Result<(u8, Bytes), Damage> {
        match self.bytes {
            Some(bytes) => contents::record_of(file, self.offset, bytes),
            None => contents::record_at(file, self.offset),
        }
    }

    fn messages(&self, file: &File) -> Result<&BTreeMap<u16, u64>, Damage> {
        if let Some(messages) = self.messages.get() {
            return Ok(messages);
        }
        let messages = contents::indexed_messages(file, self)?;
        Ok(self.messages.get_or_init(|| messages))
    }
}

#[cfg(test)]
mod tests;
