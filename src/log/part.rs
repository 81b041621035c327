//! One MCAP file on one sink: head, chunks, tail, and what to do when the disk refuses.
//!
//! The mcap writer works into memory and whole closed chunks go to the sink, because a failed
//! write poisons that writer. Room for the open chunk and for the closing summary is claimed
//! before a message is accepted, so a full disk is noticed while the file can still be finished.
//! Should a write fail all the same, the file is cut back to the last closed chunk and closed
//! without an index.

use hydroline_core::lock::Lock;
use std::collections::BTreeMap;
use std::io::{self, Seek, SeekFrom, Write};
use std::sync::{Arc, Mutex};

use mcap::records::MessageHeader;

use super::entry::{Company, Entry};
use super::output::{LogOutput, NameLost};
use super::policy::{Due, Limits, Policy};
use super::seal;
use super::settings::Head;
use super::topic::Topic;

/// Named string maps: MCAP metadata.
pub type MetadataMap = BTreeMap<String, String>;

/// Reason why a part cannot go on.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub(super) enum Fault {
    /// No room for the next message; the file can still be finished.
    #[error("no room on the disk: {0}")]
    Full(io::Error),
    /// A write, sync or truncate failed.
    #[error("{0} failed: {1}")]
    Io(&'static str, io::Error),
    #[error("MCAP encoder: {0}")]
    Mcap(#[from] mcap::McapError),
}

/// Memory the mcap writer writes into; the writer keeps one handle, we the other.
#[derive(Clone, Default)]
struct Staging(Arc<Mutex<Staged>>);

#[derive(Default)]
struct Staged {
    bytes: Vec<u8>,
    taken_before: u64,
}

impl Staging {
    fn with<R>(&self, f: impl FnOnce(&mut Staged) -> R) -> R {
        f(&mut self.0.held())
    }
}

impl Write for Staging {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        self.with(|s| s.bytes.extend_from_slice(buf));
        Ok(buf.len())
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for Staging {
    fn seek(&mut self, pos: SeekFrom) -> io::Result<u64> {
        match pos {
            // The writer, set not to seek, still queries its position.
            SeekFrom::Current(0) => Ok(self.with(|s| s.taken_before + s.bytes.len() as u64)),
            _ => Err(io::ErrorKind::Unsupported.into()),
        }
    }
}

/// Settings for the encoding of a part.
#[derive(Debug, Clone, PartialEq)]
pub struct Encoding {
    /// zstd level of the chunks; 0 = none (for MJPG, which does not shrink any further).
    pub zstd_level: u32,
    /// Channels written at the head; others are added when their first message comes.
    pub topics: Vec<Topic>,
}

/// Room for what the closing summary holds beside schemas, channels and chunk indexes.
const TAIL_FIXED_BYTES: u64 = 32 << 10;

/// Room for the one event that says why a log stops.
const LAST_WORDS_BYTES: u64 = 4096;

pub(super) struct PartFile {
    sink: Box<dyn LogOutput>,
    staging: Staging,
    mcap: mcap::Writer<Staging>,
    channels: BTreeMap<Topic, u16>,
    /// Digests of the head's metadata, for the first channel: it stands in a chunk, under a checksum.
    digests: MetadataMap,
    schema_bytes: u64,
    chunks: u64,
    good_bytes: u64,
    policy: Policy,
    open: BTreeMap<Topic, u64>,
    /// Company of the entries in the open chunk.
    open_company: Company,
    closed: BTreeMap<Topic, u64>,
}

impl PartFile {
    /// Writes and syncs the head before any message: header, metadata, then the known channels
    /// in a chunk of their own, so that a damaged data chunk costs no later message its schema.
    pub fn create(
        sink: Box<dyn LogOutput>,
        encoding: &Encoding,
        limits: Limits,
        head: &Head,
        number: u32,
        now_ns: u64,
    ) -> Result<Self, Fault> {
        let staging = Staging::default();
        let compression = (encoding.zstd_level > 0).then_some(mcap::Compression::Zstd);
        let mcap = mcap::WriteOptions::new()
            .profile("")
            .library(head.library())
            .compression(compression)
            .compression_level(encoding.zstd_level)
            // Worker threads made single writes of 131 ms on two cores; level 1 in line is faster.
            .compression_threads(0)
            .chunk_size(None)
            .disable_seeking(true)
            .create(staging.clone())?;
        let head: Vec<(String, MetadataMap)> = head
            .metadata(number)
            .into_iter()
            .map(|(name, map)| (name.to_owned(), seal::sealed(name, map)))
            .collect();
        let mut part = Self {
            sink,
            staging,
            mcap,
            channels: BTreeMap::new(),
            digests: seal::for_channel(&head),
            schema_bytes: 0,
            chunks: 0,
            good_bytes: 0,
            policy: Policy::new(limits),
            open: BTreeMap::new(),
            open_company: Company::Others,
            closed: BTreeMap::new(),
        };
        for (name, metadata) in head {
            part.mcap
                .write_metadata(&mcap::write::Metadata { name, metadata })?;
        }
        part.claim(part.staged_bytes()).map_err(Fault::Full)?;
        part.drain()?;
        for topic in encoding.topics.clone() {
            part.channel(topic)?;
        }
        part.claim(part.schema_bytes).map_err(Fault::Full)?;
        part.mcap.flush()?;
        part.chunks += 1;
        part.drain()?;
        part.policy.closed(now_ns);
        part.sync()?;
        Ok(part)
    }

    /// Bytes in the file up to the last closed chunk.
    pub fn bytes(&self) -> u64 {
        self.good_bytes
    }

    /// Messages that are in closed chunks, by topic.
    pub fn closed_messages(&self) -> &BTreeMap<Topic, u64> {
        &self.closed
    }

    /// Messages that are in the open chunk, by topic: lost if it cannot be written.
    pub fn open_messages(&self) -> &BTreeMap<Topic, u64> {
        &self.open
    }

    /// The policy, for its deadlines.
    pub fn policy(&self) -> &Policy {
        &self.policy
    }

    /// Reason why the file is no longer under its name, if so.
    pub fn name_lost(&self) -> Option<NameLost> {
        self.sink.name_lost()
    }

    /// Saves the file under a new name.
    pub fn save_beside(&mut self) -> io::Result<std::path::PathBuf> {
        self.sink.save_beside()
    }

    /// Room left on the device.
    pub fn free_bytes(&self) -> Option<u64> {
        self.sink.free_bytes()
    }

    /// Adds an entry; true when a chunk was closed before it. `sequence_of` numbers messages that bring no number of their own.
    ///
    /// Images and stripes lie in chunks of their own, so that a reader of motion and commands unpacks none of them; the order
    /// of the messages in the file stays what it was.
    pub fn write(
        &mut self,
        now_ns: u64,
        log_ns: u64,
        entry: &Entry,
        mut sequence_of: impl FnMut(Topic) -> u32,
    ) -> Result<bool, Fault> {
        let size = entry.size_bytes();
        let company = entry.company();
        let others = self.policy.open_bytes() > 0 && company != self.open_company;
        let closes = others || self.policy.must_close_before(size);
        if closes {
            self.close_chunk(now_ns)?;
        }
        self.claim(size).map_err(Fault::Full)?;
        for part in entry.parts() {
            let header = MessageHeader {
                channel_id: self.channel(part.topic)?,
                sequence: part.sequence.unwrap_or_else(|| sequence_of(part.topic)),
                log_time: log_ns,
                publish_time: part.publish_ns.unwrap_or(log_ns),
            };
            self.mcap.write_to_known_channel(&header, &part.data)?;
            *self.open.entry(part.topic).or_default() += 1;
        }
        self.open_company = company;
        self.policy.added(now_ns, size, entry.is_urgent());
        Ok(closes)
    }

    /// Does what is due.
    pub fn tick(&mut self, now_ns: u64) -> Result<Due, Fault> {
        let due = self.policy.due(now_ns);
        if due.close {
            self.close_chunk(now_ns)?;
        }
        if due.sync {
            self.sync()?;
        }
        Ok(due)
    }

    fn close_chunk(&mut self, now_ns: u64) -> Result<(), Fault> {
        self.mcap.flush()?;
        self.chunks += 1;
        self.drain()?;
        self.policy.closed(now_ns);
        for (topic, n) in std::mem::take(&mut self.open) {
            *self.closed.entry(topic).or_default() += n;
        }
        Ok(())
    }

    fn sync(&mut self) -> Result<(), Fault> {
        self.sink.sync().map_err(|e| Fault::Io("sync", e))?;
        self.policy.synced();
        Ok(())
    }

    /// Last chunk, `summary` metadata, indexes, footer; durable on return.
    ///
    /// On failure the caller goes on with [`PartFile::abandon`].
    pub fn finish(&mut self, now_ns: u64, summary: &MetadataMap) -> Result<u64, Fault> {
        if self.policy.open_bytes() > 0 {
            self.close_chunk(now_ns)?;
        }
        let metadata = mcap::write::Metadata {
            name: "summary".to_owned(),
            metadata: seal::sealed("summary", summary.clone()),
        };
        self.mcap.write_metadata(&metadata)?;
        self.mcap.finish()?;
        self.drain()?;
        self.sink
            .truncate(self.good_bytes)
            .map_err(|e| Fault::Io("truncate", e))?;
        self.sync()?;
        Ok(self.good_bytes)
    }

    /// After a failed write: cuts back to the last closed chunk and closes the file without an
    /// index. What is left is a valid MCAP file.
    pub fn abandon(&mut self, summary: &MetadataMap) -> io::Result<u64> {
        self.sink.truncate(self.good_bytes)?;
        let tail = plain_tail(&seal::sealed("summary", summary.clone()));
        self.sink.write_all(&tail)?;
        self.sink.flush()?;
        self.sink.sync()?;
        self.good_bytes += tail.len() as u64;
        Ok(self.good_bytes)
    }

    fn channel(&mut self, topic: Topic) -> Result<u16, Fault> {
        if let Some(id) = self.channels.get(&topic) {
            return Ok(*id);
        }
        let schema = topic.schema();
        let schema_id = self
            .mcap
            .add_schema(&schema.name, "protobuf", &schema.data)?;
        let digests = std::mem::take(&mut self.digests);
        let id = self
            .mcap
            .add_channel(schema_id, topic.name(), "protobuf", &digests)?;
        let digest_bytes: usize = digests.iter().map(|(k, v)| k.len() + v.len() + 8).sum();
        self.schema_bytes +=
            (schema.data.len() + schema.name.len() + topic.name().len() + digest_bytes) as u64
                + 128;
        self.channels.insert(topic, id);
        Ok(id)
    }

    fn staged_bytes(&self) -> u64 {
        self.staging.with(|s| s.bytes.len() as u64)
    }

    /// Claims room for the open chunk with `more` bytes in it and for the tail.
    fn claim(&mut self, more: u64) -> io::Result<()> {
        let raw = self.policy.open_bytes() + more;
        // zstd's compressBound is n + n/256 + 64; message records and their index entries are in
        // Entry::size_bytes; a channel's index header and the chunk's own take the rest.
        let channels = self.channels.len() as u64;
        let around = 4096 + 128 * channels + self.schema_bytes;
        // Twice: what is said of a full disk may need a chunk of its own behind the open one.
        let chunk = raw + raw / 128 + 2 * around + LAST_WORDS_BYTES;
        let index = (self.chunks + 3) * (96 + 10 * channels);
        let tail = TAIL_FIXED_BYTES + self.schema_bytes + 32 * channels + index;
        self.sink.reserve(self.good_bytes + chunk + tail)
    }

    fn drain(&mut self) -> Result<(), Fault> {
        let bytes = self.staging.with(|s| {
            s.taken_before += s.bytes.len() as u64;
            std::mem::take(&mut s.bytes)
        });
        self.sink
            .write_all(&bytes)
            .map_err(|e| Fault::Io("write", e))?;
        self.sink.flush().map_err(|e| Fault::Io("write", e))?;
        self.good_bytes += bytes.len() as u64;
        // Hand the allocation back for the next chunk.
        self.staging.with(|s| {
            s.bytes = bytes;
            s.bytes.clear();
        });
        Ok(())
    }
}

/// `summary` metadata, DataEnd, an empty summary section and the footer, byte by byte
/// (MCAP specification, "Records").
pub(super) fn plain_tail(summary: &MetadataMap) -> Vec<u8> {
    let mut map = Vec::new();
    for (key, value) in summary {
        string(&mut map, key);
        string(&mut map, value);
    }
    let mut body = Vec::new();
    string(&mut body, "summary");
    body.extend((map.len() as u32).to_le_bytes());
    body.extend(map);
    let mut out = Vec::new();
    record(&mut out, mcap::records::op::METADATA, &body);
    record(&mut out, mcap::records::op::DATA_END, &0u32.to_le_bytes());
    record(&mut out, mcap::records::op::FOOTER, &[0; 20]);
    out.extend(mcap::MAGIC);
    out
}

fn string(out: &mut Vec<u8>, s: &str) {
    out.extend((s.len() as u32).to_le_bytes());
    out.extend(s.as_bytes());
}

fn record(out: &mut Vec<u8>, opcode: u8, body: &[u8]) {
    out.push(opcode);
    out.extend((body.len() as u64).to_le_bytes());
    out.extend(body);
}

#[cfg(test)]
mod tests;
