//! Messages as their writer left them, with their schemas: logs that other programs made.

use std::path::{Path, PathBuf};

use bytes::Bytes;

use super::LogError;
use super::records::SchemaRecord;
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
/// error it goes on with what is still sound.
pub struct RawReader {
    path: PathBuf,
    scan: FileScan,
}

impl RawReader {
    /// Opens a file.
    ///
    /// # Errors
    /// [`LogError::Read`], [`LogError::NotMcap`].
    pub fn open(path: &Path) -> Result<Self, LogError> {
        Ok(RawReader {
            path: path.to_owned(),
            scan: scan::open(path)?,
        })
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

impl Iterator for RawReader {
    type Item = Result<RawMessage, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            match self.scan.next()? {
                Step::Message {
                    offset,
                    channel,
                    message,
                } => {
                    return Some(Ok(RawMessage {
                        channel: (self.scan.learnt.joined, channel.id),
                        topic: channel.topic.clone(),
                        encoding: channel.message_encoding.clone(),
                        log_ns: message.log_ns,
                        offset,
                        data: message.data,
                        schema_id: channel.schema_id,
                    }));
                }
                Step::Damage { offset, damage } => {
                    return Some(Err(LogError::damaged(&self.path, (offset, damage))));
                }
                Step::Truncated { .. } | Step::Metadata { .. } => {}
            }
        }
    }
}
