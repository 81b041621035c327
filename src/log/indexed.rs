//! Messages of some topics out of a log, without the rest of it: by the file's own index.
//!
//! The summary at a log's end says where each chunk lies and which channels it holds. Chunks without a wanted message
//! are not read; those that are have their checksum compared as everywhere. A log without a summary (cut, or written
//! by a program that makes none) is read once from start to end to find the same.

use std::collections::BTreeMap;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use bytes::{Buf, Bytes};
use hydroline_core::frame::GreyRule;
use mcap::records::op;

use super::LogError;
use super::part::MetadataMap;
use super::reader::{self, LogMessage};
use super::records::{self, Damage, Declared, LIMIT_BYTES, Located, MessageRecord, PREFIX_BYTES};
use super::scan::{self, Step};
use super::topic::Topic;

/// Footer and magic at the end of a file.
const TAIL_BYTES: u64 = PREFIX_BYTES + 20 + 8;
/// The checksum of the summary stands at the end of the footer, and is not of itself.
const CRC_BYTES: usize = 4;

/// A record that holds messages: a chunk, or a message by itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// Offset of the record in the file.
    offset: u64,
    /// Messages in it, by channel.
    messages: BTreeMap<u16, u64>,
}

/// A log of which it is known what lies where. Reading takes no exclusive access: several threads may.
#[derive(Debug)]
pub struct IndexedLog {
    path: PathBuf,
    file: File,
    declared: Declared,
    metadata: BTreeMap<String, MetadataMap>,
    places: Vec<Place>,
    end_missing: Option<LogError>,
}

/// What a summary, or reading everything, says of a log.
#[derive(Default)]
struct Contents {
    declared: Declared,
    metadata: BTreeMap<String, MetadataMap>,
    places: Vec<Place>,
}

impl IndexedLog {
    /// Opens a log and reads its index, or the whole of it where there is none.
    ///
    /// # Errors
    /// [`LogError::Read`], [`LogError::NotMcap`], [`LogError::Empty`]; without an index also damage. A missing end
    /// is none: [`IndexedLog::end_missing`].
    pub fn open(path: &Path) -> Result<Self, LogError> {
        // Says what is wrong with a file that is no log.
        let scan = scan::open(path)?;
        let file = File::open(path).map_err(|source| LogError::Read {
            path: path.to_owned(),
            source,
        })?;
        // A summary that is damaged does not make the messages unreadable.
        let (contents, end_missing) = match summary(&file) {
            Ok(Some(contents)) => (contents, None),
            Ok(None) | Err(_) => scanned(path, scan)?,
        };
        Ok(Self {
            path: path.to_owned(),
            file,
            declared: contents.declared,
            metadata: contents.metadata,
            places: contents.places,
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
        &self.metadata
    }

    /// How grey levels come out of the log's frames, as [`super::LogReader::grey_rule`].
    pub fn grey_rule(&self) -> GreyRule {
        reader::grey_rule(&self.metadata)
    }

    /// Messages of each topic.
    pub fn counts(&self) -> BTreeMap<&str, u64> {
        let mut counts = BTreeMap::new();
        for channel in self.declared.channels.values() {
            let of = |place: &Place| place.messages.get(&channel.id).copied().unwrap_or(0);
            *counts.entry(channel.topic.as_str()).or_default() +=
                self.places.iter().map(of).sum::<u64>();
        }
        counts
    }

    fn is_wanted(&self, channel: u16, topics: &[&str]) -> bool {
        let channel = self.declared.channels.get(&channel);
        channel.is_some_and(|c| topics.contains(&c.topic.as_str()))
    }

    /// Places of messages of these topics, in the file's order.
    pub fn places(&self, topics: &[&str]) -> Vec<&Place> {
        let holds = |p: &&Place| p.messages.keys().any(|c| self.is_wanted(*c, topics));
        self.places.iter().filter(holds).collect()
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

    /// Hands on the messages of these topics at a place as they lie there, undecoded: topic, time of logging, bytes. Faster
    /// than [`IndexedLog::messages`] where there are many; a message of another type on the topic is left out.
    ///
    /// # Errors
    /// As [`IndexedLog::messages`]; words of `each` become a [`LogError::Message`].
    pub fn visit(
        &self,
        place: &Place,
        topics: &[Topic],
        mut each: impl FnMut(Topic, u64, &[u8]) -> Result<(), String>,
    ) -> Result<(), LogError> {
        let offset = place.offset;
        let damaged = |damage| LogError::Damaged {
            path: self.path.clone(),
            offset,
            damage,
        };
        let wanted = self.declared.channels.iter().filter_map(|(id, channel)| {
            let schema = self.declared.schema_name(channel);
            let topic = Topic::find(&channel.topic, schema)
                .filter(|t| channel.message_encoding == "protobuf" && topics.contains(t))?;
            Some((*id, topic))
        });
        let wanted: Vec<(u16, Topic)> = wanted.collect();
        let hand_on = |id: u16, log_ns: u64, data: &[u8]| {
            let Some((_, topic)) = wanted.iter().find(|(channel, _)| *channel == id) else {
                return Ok(());
            };
            each(*topic, log_ns, data).map_err(|reason| Stop::Message(*topic, reason))
        };
        let (opcode, body) = record_at(&self.file, offset).map_err(damaged)?;
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
    /// As [`IndexedLog::messages`].
    pub fn nth(&self, topic: &str, index: u64) -> Result<Option<LogMessage>, LogError> {
        let mut left = index;
        for place in self.places(&[topic]) {
            let here = place.messages.iter();
            let here: u64 = here
                .filter(|(c, _)| self.is_wanted(**c, &[topic]))
                .map(|(_, n)| n)
                .sum();
            if left < here {
                let message = self.raw(place, &[topic])?.into_iter().nth(left as usize);
                return message.map(|m| self.decode(place.offset, m)).transpose();
            }
            left -= here;
        }
        Ok(None)
    }

    fn raw(&self, place: &Place, topics: &[&str]) -> Result<Vec<MessageRecord>, LogError> {
        let damaged = |(offset, damage)| LogError::Damaged {
            path: self.path.clone(),
            offset,
            damage,
        };
        self.undecoded(place, topics).map_err(damaged)
    }

    fn undecoded(&self, place: &Place, topics: &[&str]) -> Result<Vec<MessageRecord>, Located> {
        let at = |damage| (place.offset, damage);
        let (opcode, body) = record_at(&self.file, place.offset).map_err(at)?;
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
        let channel = self.declared.channels.get(&id);
        let channel = channel.ok_or_else(|| LogError::Damaged {
            path: self.path.clone(),
            offset,
            damage: Damage::UnknownChannel(id),
        })?;
        let schema = self.declared.schema_name(channel);
        let (log_ns, publish_ns, sequence) = (message.log_ns, message.publish_ns, message.sequence);
        let record = reader::decode(channel, schema, message, &mut None);
        let record = record.map_err(|reason| LogError::Message {
            path: self.path.clone(),
            offset,
            topic: channel.topic.clone(),
            schema: schema.to_owned(),
            reason,
        })?;
        Ok(LogMessage {
            log_ns,
            publish_ns,
            sequence,
            offset,
            record,
        })
    }
}

/// What ends a visit.
enum Stop {
    Damage(Damage),
    Message(Topic, String),
}

impl From<Damage> for Stop {
    fn from(damage: Damage) -> Self {
        Stop::Damage(damage)
    }
}

/// So many bytes from `offset` on.
fn bytes_at(file: &File, offset: u64, len: u64) -> Result<Bytes, Damage> {
    if len > LIMIT_BYTES {
        return Err(Damage::TooLong { opcode: 0, len });
    }
    let mut bytes = vec![0; len as usize];
    file.read_exact_at(&mut bytes, offset)
        .map_err(|e| Damage::Io(e.to_string()))?;
    Ok(Bytes::from(bytes))
}

/// Opcode and body of the record at `offset`.
fn record_at(file: &File, offset: u64) -> Result<(u8, Bytes), Damage> {
    let mut prefix = bytes_at(file, offset, PREFIX_BYTES)?;
    let (opcode, len) = (prefix.get_u8(), prefix.get_u64_le());
    Ok((opcode, bytes_at(file, offset + PREFIX_BYTES, len)?))
}

/// What the summary says; `None` = there is none, or not of everything.
fn summary(file: &File) -> Result<Option<Contents>, Damage> {
    let file_bytes = file.metadata().map_or(0, |m| m.len());
    let Some(footer_at) = file_bytes.checked_sub(TAIL_BYTES) else {
        return Ok(None);
    };
    let (opcode, footer) = record_at(file, footer_at)?;
    let magic = bytes_at(file, file_bytes - mcap::MAGIC.len() as u64, 8)?;
    if opcode != op::FOOTER || magic != *mcap::MAGIC {
        return Ok(None);
    }
    let start = records::footer_summary_start(&footer)?;
    let end = footer_at + PREFIX_BYTES + footer.len() as u64;
    let Some(len) = end.checked_sub(start).filter(|_| start > 0) else {
        return Ok(None);
    };
    let mut section = bytes_at(file, start, len)?;
    let saved = records::footer_crc(&footer)?;
    let calculated = crc32fast::hash(&section[..section.len() - CRC_BYTES]);
    if saved != 0 && saved != calculated {
        return Err(Damage::SummaryCrc { saved, calculated });
    }
    let (mut contents, mut stated) = (Contents::default(), None);
    while let Some(record) = records::next_inner(&mut section) {
        let (opcode, body) = record?;
        match opcode {
            op::SCHEMA => contents.declared.add_schema(records::schema(&body)?)?,
            op::CHANNEL => contents.declared.add_channel(records::channel(&body)?)?,
            op::STATISTICS => stated = Some(records::statistics(&body)?),
            op::CHUNK_INDEX => {
                let chunk = records::chunk_index(&body)?;
                contents.places.push(place(file, &chunk)?);
            }
            op::METADATA_INDEX => {
                let (opcode, body) = record_at(file, records::metadata_index(&body)?)?;
                if opcode == op::METADATA {
                    let (name, map) = records::metadata(&body)?;
                    contents.metadata.insert(name, map);
                }
            }
            _ => {}
        }
    }
    contents.places.sort_by_key(|p| p.offset);
    // Messages outside of chunks, or chunks without an index of their messages.
    let indexed: u64 = contents
        .places
        .iter()
        .flat_map(|p| p.messages.values())
        .sum();
    Ok(stated
        .is_some_and(|s| s.messages == indexed)
        .then_some(contents))
}

/// A chunk with what the indexes behind it say.
fn place(file: &File, chunk: &records::ChunkIndexRecord) -> Result<Place, Damage> {
    let behind = chunk.chunk_offset.saturating_add(chunk.chunk_bytes);
    let mut indexes = bytes_at(file, behind, chunk.message_index_bytes)?;
    let mut messages = BTreeMap::new();
    while let Some(record) = records::next_inner(&mut indexes) {
        let (opcode, body) = record?;
        if opcode == op::MESSAGE_INDEX {
            let (channel, count) = records::message_index(&body)?;
            if count > 0 {
                messages.insert(channel, count);
            }
        }
    }
    Ok(Place {
        offset: chunk.chunk_offset,
        messages,
    })
}

/// The same by reading everything, and what is missing at the end.
fn scanned(
    path: &Path,
    mut scan: scan::FileScan,
) -> Result<(Contents, Option<LogError>), LogError> {
    let mut places: Vec<Place> = Vec::new();
    let mut end_missing = None;
    while let Some(step) = scan.next() {
        match step {
            Step::Message {
                offset, channel, ..
            } => {
                if places.last().is_none_or(|p| p.offset != offset) {
                    let messages = BTreeMap::new();
                    places.push(Place { offset, messages });
                }
                if let Some(place) = places.last_mut() {
                    *place.messages.entry(channel.id).or_default() += 1;
                }
            }
            Step::Damage { offset, damage } => {
                let error = LogError::Damaged {
                    path: path.to_owned(),
                    offset,
                    damage,
                };
                if !error.is_missing_end() {
                    return Err(error);
                }
                end_missing = Some(error);
            }
            Step::Truncated { .. } | Step::Metadata { .. } => {}
        }
    }
    let contents = Contents {
        declared: scan.learnt.declared,
        metadata: scan.learnt.metadata,
        places,
    };
    Ok((contents, end_missing))
}
