//! Messages as their writer left them, with their schemas: logs that other programs made.

use std::fs::File;
use std::path::{Path, PathBuf};

use bytes::Bytes;

use super::LogError;
use super::indexed::declared_at_end;
use super::records::{
    ChannelRecord, ChunkRecord, Damage, MessageRecord, RecordFinder, SchemaRecord,
};
use super::scan::{self, FileScan, Step};

/// Schema of a channel's messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RawSchema<'a> {
    /// Such as `nav_msgs/msg/Odometry`; "" without one.
    pub name: &'a str,
    /// Of the schema: `ros2msg`, `protobuf`, `jsonschema`, ...
    pub encoding: &'a str,
    /// The schema itself.
    pub data: &'a [u8],
}

/// A message that nobody decoded.
#[derive(Debug, Clone, PartialEq)]
pub struct RawMessage {
    /// Its channel in this log; channels of one file joined to another begin anew.
    pub channel: (u32, u16),
    /// Name of the topic.
    pub topic: String,
    /// Of the message: `cdr`, `protobuf`, `json`, ...
    pub encoding: String,
    /// Host realtime at logging, UNIX \[ns\].
    pub log_ns: u64,
    /// Offset in the file of the record (of its chunk, when it is in one).
    pub offset: u64,
    /// The bytes.
    pub data: Bytes,
    schema_id: u16,
}

/// Reads messages from start to end. Lengths and checksums are verified before a message is handed out; after an
/// error it goes on with the next sound record, wherever that is.
pub struct RawReader {
    path: PathBuf,
    scan: FileScan,
    finder: RecordFinder<File>,
    /// Chunk that the file, or a wrong length, ends in: what it is shows with the damage that follows.
    truncated: Option<ChunkRecord>,
    /// Offset of that chunk's record and what is left of its content.
    salvaged: Option<(u64, Bytes)>,
    skipped_bytes: u64,
}

impl RawReader {
    /// Opens a file.
    ///
    /// # Errors
    /// [`LogError::Read`], [`LogError::NotMcap`].
    pub fn open(path: &Path) -> Result<Self, LogError> {
        let scan = scan::open(path)?;
        let source = File::open(path).map_err(LogError::read(path))?;
        let scan = scan.with_spare(declared_at_end(&source));
        Ok(RawReader {
            path: path.to_owned(),
            scan,
            finder: RecordFinder::new(source).map_err(LogError::read(path))?,
            truncated: None,
            salvaged: None,
            skipped_bytes: 0,
        })
    }

    /// Bytes so far from damage to the next sound record.
    pub fn skipped_bytes(&self) -> u64 {
        self.skipped_bytes
    }

    /// Schema of a message's channel; its fields are empty without one.
    pub fn schema(&self, message: &RawMessage) -> RawSchema<'_> {
        let none = RawSchema {
            name: "",
            encoding: "",
            data: &[],
        };
        let schemas = &self.scan.learnt.declared.schemas;
        schemas.get(&message.schema_id).map_or(
            none,
            |SchemaRecord {
                 name,
                 encoding,
                 data,
                 ..
             }| RawSchema {
                name,
                encoding,
                data,
            },
        )
    }
}

impl RawReader {
    fn message(&self, offset: u64, channel: &ChannelRecord, message: MessageRecord) -> RawMessage {
        RawMessage {
            channel: (self.scan.learnt.joined, channel.id),
            topic: channel.topic.clone(),
            encoding: channel.message_encoding.clone(),
            log_ns: message.log_ns,
            offset,
            data: message.data,
            schema_id: channel.schema_id,
        }
    }

    /// The error of a damaged place; reading goes on behind it.
    fn damaged(&mut self, offset: u64, damage: Damage) -> LogError {
        let next = match self.scan.go_on(&mut self.finder, offset, &damage) {
            Ok(next) => next,
            Err(error) => return LogError::read(&self.path)(error),
        };
        self.skipped_bytes += next.map_or(0, |next| next.saturating_sub(offset));
        if let Some(chunk) = self.truncated.take() {
            self.salvaged = Some((offset, chunk.certain(next.is_some())));
        }
        LogError::damaged(&self.path, (offset, damage))
    }

    /// The next message of a truncated chunk.
    fn next_salvaged(&mut self) -> Option<RawMessage> {
        let (offset, content) = self.salvaged.as_mut()?;
        let offset = *offset;
        let Some((channel, message)) = self.scan.next_salvaged(offset, content) else {
            self.salvaged = None;
            return None;
        };
        Some(self.message(offset, &channel, message))
    }
}

impl Iterator for RawReader {
    type Item = Result<RawMessage, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        if let Some(message) = self.next_salvaged() {
            return Some(Ok(message));
        }
        loop {
            match self.scan.next()? {
                Step::Message {
                    offset,
                    channel,
                    message,
                } => return Some(Ok(self.message(offset, &channel, message))),
                Step::Damage { offset, damage } => return Some(Err(self.damaged(offset, damage))),
                Step::Truncated { chunk } => self.truncated = Some(chunk),
                Step::Metadata { .. } => {}
            }
        }
    }
}
