//! Messages into the new file, with a checksum over all of them to compare with afterwards.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;

use mcap::records::MessageHeader;

use crate::entry::Company;
use crate::part::MetadataMap;
use crate::records::{ChannelRecord, MessageRecord};
use crate::scan::FileScan;

/// A chunk is closed before it would hold more than this, so that a message near the limit has one of its own \[bytes\].
const CHUNK_BYTES: u64 = 768 << 10;

/// Order-dependent checksum over all messages, names and times.
#[derive(Default)]
pub(super) struct Digest(pub crc32fast::Hasher);

impl Digest {
    pub fn add(&mut self, channel: &ChannelRecord, schema: &str, m: &MessageRecord) {
        for text in [
            channel.topic.as_str(),
            schema,
            channel.message_encoding.as_str(),
        ] {
            self.0.update(text.as_bytes());
            self.0.update(&[0]);
        }
        self.0.update(&m.sequence.to_le_bytes());
        self.0.update(&m.log_ns.to_le_bytes());
        self.0.update(&m.publish_ns.to_le_bytes());
        self.0.update(&(m.data.len() as u64).to_le_bytes());
        self.0.update(&m.data);
    }
}

/// The new file.
pub(super) struct Copy {
    pub writer: mcap::Writer<BufWriter<File>>,
    /// By the log of a joined file and the identifier in it.
    pub channels: BTreeMap<(u32, u16), u16>,
    pub digest: Digest,
    pub ledger: super::ledger::Ledger,
    pub messages: BTreeMap<String, u64>,
    pub total: u64,
    /// Company of the messages in the open chunk.
    pub company: Company,
    /// Bytes of the messages in the open chunk.
    pub open_bytes: u64,
}

impl Copy {
    pub fn message(
        &mut self,
        scan: &FileScan,
        channel: &ChannelRecord,
        m: &MessageRecord,
    ) -> Result<(), mcap::McapError> {
        let key = (scan.learnt.joined, channel.id);
        let id = match self.channels.get(&key) {
            Some(id) => *id,
            None => {
                let schema = match scan.learnt.declared.schemas.get(&channel.schema_id) {
                    Some(s) => self.writer.add_schema(&s.name, &s.encoding, &s.data)?,
                    None => 0,
                };
                let (topic, encoding) = (&channel.topic, &channel.message_encoding);
                let id = self
                    .writer
                    .add_channel(schema, topic, encoding, &channel.metadata)?;
                self.channels.insert(key, id);
                id
            }
        };
        let header = MessageHeader {
            channel_id: id,
            sequence: m.sequence,
            log_time: m.log_ns,
            publish_time: m.publish_ns,
        };
        // As the recording does: bulk in chunks of its own.
        let company = Company::of(&channel.topic).unwrap_or(self.company);
        let bytes = m.data.len() as u64;
        let full = self.open_bytes > 0 && self.open_bytes + bytes > CHUNK_BYTES;
        if company != std::mem::replace(&mut self.company, company) || full {
            self.writer.flush()?;
            self.open_bytes = 0;
        }
        self.open_bytes += bytes;
        self.writer.write_to_known_channel(&header, &m.data)?;
        self.digest
            .add(channel, scan.learnt.declared.schema_name(channel), m);
        self.ledger.message(channel, m);
        *self.messages.entry(channel.topic.clone()).or_default() += 1;
        self.total += 1;
        Ok(())
    }

    pub fn metadata(&mut self, name: &str, metadata: MetadataMap) -> Result<(), mcap::McapError> {
        let name = name.to_owned();
        self.writer
            .write_metadata(&mcap::write::Metadata { name, metadata })
    }
}
