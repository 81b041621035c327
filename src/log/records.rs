//! An MCAP file, record by record, with every length and checksum verified before use.
//!
//! The mcap crate's readers hide the offset of a record, stop at the first damage and trust some
//! lengths; `doctor`, `recover` and errors that name the place need the opposite. Lengths are held
//! against what is really there and against [`LIMIT_BYTES`] before anything is allocated, chunks
//! are decompressed into a bounded buffer and their CRC is checked before a record is used. Tests
//! hold this reader against `mcap::io::MessageReader`.

use std::collections::BTreeMap;
use std::io::{self, BufRead, Read};

use bytes::{Buf, Bytes};
use mcap::records::op;

use super::part::MetadataMap;

/// Longest record that is read into memory, and longest decompressed chunk.
pub const LIMIT_BYTES: u64 = 64 << 20;

/// Opcode and length.
pub(super) const PREFIX_BYTES: u64 = 9;

/// What can be wrong with the bytes.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs)]
pub enum Damage {
    #[error("the file ends inside a record: {need} bytes needed, {have} there")]
    Cut { need: u64, have: u64 },
    #[error("the file ends without a footer: the recording was not stopped cleanly")]
    NoEnd,
    #[error("a record (opcode {opcode:#04x}) of {len} bytes is beyond the {LIMIT_BYTES} allowed")]
    TooLong { opcode: u8, len: u64 },
    #[error("a record (opcode {opcode:#04x}) does not hold a whole {field}")]
    Malformed { opcode: u8, field: &'static str },
    #[error("a chunk's checksum is {saved:08x}, its content's {calculated:08x}")]
    ChunkCrc { saved: u32, calculated: u32 },
    #[error("compression `{0}` is not known; MCAP has none, lz4 and zstd")]
    Compression(String),
    #[error("a chunk does not decompress: {0}")]
    Decompress(String),
    #[error("a chunk should hold {declared} bytes, it holds {got}")]
    ChunkSize { declared: u64, got: u64 },
    #[error("a message names channel {0}, which is not declared before it")]
    UnknownChannel(u16),
    #[error("channel {topic} names schema {schema}, which is not declared before it")]
    UnknownSchema { topic: String, schema: u16 },
    #[error("{what} {id} is declared twice, differently")]
    Redeclared { what: &'static str, id: u16 },
    #[error("the data section's checksum is {saved:08x}, its content's {calculated:08x}")]
    DataCrc { saved: u32, calculated: u32 },
    #[error("the summary's checksum is {saved:08x}, its content's {calculated:08x}")]
    SummaryCrc { saved: u32, calculated: u32 },
    #[error("the summary counts {stated} messages, the file holds {found}")]
    MessageCount { stated: u64, found: u64 },
    #[error("the summary counts {stated} chunks, the file holds {found}")]
    ChunkCount { stated: u64, found: u64 },
    #[error("the file does not end with the MCAP magic")]
    EndMagic,
    #[error("{0}")]
    Io(String),
}

impl Damage {
    /// The bytes that are there are sound, only the end is missing.
    pub fn is_missing_end(&self) -> bool {
        matches!(self, Damage::Cut { .. } | Damage::NoEnd)
    }
}

impl Damage {
    /// Where the next record begins is no longer certain.
    pub(super) fn loses_the_thread(&self) -> bool {
        matches!(
            self,
            Damage::Cut { .. } | Damage::TooLong { .. } | Damage::ChunkSize { .. }
        )
    }
}

/// Where the next chunk begins whose checksum holds, at or after `from`.
pub(super) fn find_chunk(file: &[u8], from: u64) -> Option<u64> {
    let from = usize::try_from(from).ok()?;
    let prefix = PREFIX_BYTES as usize;
    (from..file.len().saturating_sub(prefix)).find_map(|at| {
        if file[at] != op::CHUNK {
            return None;
        }
        let mut length = file.get(at + 1..at + prefix)?;
        let len = length.get_u64_le();
        if len > LIMIT_BYTES {
            return None;
        }
        let body = file.get(at + prefix..at + prefix + len as usize)?;
        // A plausible header first: copying and hashing every candidate would take for ever.
        let compression = u32::from_le_bytes(body.get(28..32)?.try_into().ok()?);
        if compression > 4 {
            return None;
        }
        let chunk = chunk(&Bytes::copy_from_slice(body), false).ok()?;
        (chunk.crc != 0 && chunk.open().is_ok()).then_some(at as u64)
    })
}

/// A record at the file's top level.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Outer {
    pub offset: u64,
    pub opcode: u8,
    /// Bytes after the length; empty for attachments, which are hashed and skipped.
    pub body: Bytes,
}

/// Walks the top level. After an error about a length there is no next record.
pub(super) struct Records<R> {
    source: R,
    offset: u64,
    hasher: crc32fast::Hasher,
    torn: Option<ChunkRecord>,
    opcode: u8,
    done: bool,
}

/// What went wrong, where.
pub(super) type Located = (u64, Damage);

impl<R: BufRead> Records<R> {
    /// Reads the magic.
    ///
    /// # Errors
    /// The first bytes, when they are not MCAP's.
    pub fn new(mut source: R) -> io::Result<Result<Self, Vec<u8>>> {
        let mut magic = Vec::new();
        source
            .by_ref()
            .take(mcap::MAGIC.len() as u64)
            .read_to_end(&mut magic)?;
        if magic != mcap::MAGIC {
            return Ok(Err(magic));
        }
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(&magic);
        Ok(Ok(Self {
            source,
            offset: magic.len() as u64,
            hasher,
            torn: None,
            opcode: op::HEADER,
            done: false,
        }))
    }

    /// Offset of the next record.
    pub fn offset(&self) -> u64 {
        self.offset
    }

    /// CRC of everything since the start or since [`Records::restart_crc`].
    pub fn crc(&self) -> u32 {
        self.hasher.clone().finalize()
    }

    /// Starts the summary's CRC.
    pub fn restart_crc(&mut self) {
        self.hasher = crc32fast::Hasher::new();
    }

    /// The next record; `None` at the end of the bytes, which is only right after a footer.
    /// DataEnd and Footer are not hashed here: their CRC covers what is before them.
    pub fn next(&mut self) -> Option<Result<Outer, Located>> {
        if self.done {
            return None;
        }
        let result = self.read_one();
        match &result {
            Ok(None) | Err(_) => self.done = true,
            Ok(Some(_)) => {}
        }
        result.map_err(|damage| (self.offset, damage)).transpose()
    }

    fn read_one(&mut self) -> Result<Option<Outer>, Damage> {
        let mut prefix = [0; PREFIX_BYTES as usize];
        let have = self.fill(&mut prefix)?;
        if have == 0 {
            return Ok(None);
        }
        let opcode = prefix[0];
        self.opcode = opcode;
        if have < PREFIX_BYTES {
            return Err(Damage::Cut {
                need: PREFIX_BYTES,
                have,
            });
        }
        let len = (&prefix[1..]).get_u64_le();
        let hashed = opcode != op::DATA_END && opcode != op::FOOTER;
        if hashed {
            self.hasher.update(&prefix);
        }
        let body = if opcode == op::ATTACHMENT {
            self.skip(len)?;
            Bytes::new()
        } else {
            if len > LIMIT_BYTES {
                return Err(Damage::TooLong { opcode, len });
            }
            let mut body = Vec::new();
            // `take` grows with what is really there, not with what the length claims.
            self.source
                .by_ref()
                .take(len)
                .read_to_end(&mut body)
                .map_err(io_damage)?;
            let have = body.len() as u64;
            if have < len {
                if opcode == op::CHUNK {
                    self.torn = chunk(&Bytes::from(std::mem::take(&mut body)), true).ok();
                }
                return Err(Damage::Cut { need: len, have });
            }
            if hashed {
                self.hasher.update(&body);
            }
            Bytes::from(body)
        };
        let offset = self.offset;
        self.offset = offset.saturating_add(PREFIX_BYTES).saturating_add(len);
        Ok(Some(Outer {
            offset,
            opcode,
            body,
        }))
    }

    /// Opcode of the record read last, or of the one in which the file ends.
    pub fn opcode(&self) -> u8 {
        self.opcode
    }

    /// What there is of the chunk in which the file ends.
    pub fn take_torn(&mut self) -> Option<ChunkRecord> {
        self.torn.take()
    }

    /// The summary's CRC: it covers the footer up to the CRC itself.
    pub fn crc_with_footer(&self, body: &Bytes) -> u32 {
        let mut hasher = self.hasher.clone();
        hasher.update(&[op::FOOTER]);
        hasher.update(&(body.len() as u64).to_le_bytes());
        hasher.update(body.get(..16).unwrap_or_default());
        hasher.finalize()
    }

    /// The magic after the footer.
    pub fn end_magic(&mut self) -> Result<(), Located> {
        let mut magic = [0; 8];
        match self.fill(&mut magic) {
            Ok(8) if magic == mcap::MAGIC => Ok(()),
            Ok(_) => Err((self.offset, Damage::EndMagic)),
            Err(damage) => Err((self.offset, damage)),
        }
    }

    fn fill(&mut self, buffer: &mut [u8]) -> Result<u64, Damage> {
        let mut have = 0;
        while have < buffer.len() {
            match self.source.read(&mut buffer[have..]) {
                Ok(0) => break,
                Ok(n) => have += n,
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) => return Err(io_damage(e)),
            }
        }
        Ok(have as u64)
    }

    fn skip(&mut self, len: u64) -> Result<(), Damage> {
        let mut left = len;
        while left > 0 {
            let buffer = self.source.fill_buf().map_err(io_damage)?;
            if buffer.is_empty() {
                return Err(Damage::Cut {
                    need: len,
                    have: len - left,
                });
            }
            let n = (buffer.len() as u64).min(left) as usize;
            self.hasher.update(&buffer[..n]);
            self.source.consume(n);
            left -= n as u64;
        }
        Ok(())
    }
}

impl<R: BufRead + io::Seek> Records<R> {
    /// Goes on reading at `offset`.
    pub fn jump(&mut self, offset: u64) -> io::Result<()> {
        self.source.seek(io::SeekFrom::Start(offset))?;
        self.offset = offset;
        self.torn = None;
        self.done = false;
        Ok(())
    }
}

fn io_damage(e: io::Error) -> Damage {
    Damage::Io(e.to_string())
}

/// Fields of a record, each only as long as the bytes that are there.
struct Fields {
    bytes: Bytes,
    opcode: u8,
}

impl Fields {
    fn need(&self, n: usize, field: &'static str) -> Result<(), Damage> {
        if self.bytes.remaining() < n {
            return Err(Damage::Malformed {
                opcode: self.opcode,
                field,
            });
        }
        Ok(())
    }
    fn u16(&mut self, field: &'static str) -> Result<u16, Damage> {
        self.need(2, field)?;
        Ok(self.bytes.get_u16_le())
    }
    fn u32(&mut self, field: &'static str) -> Result<u32, Damage> {
        self.need(4, field)?;
        Ok(self.bytes.get_u32_le())
    }
    fn u64(&mut self, field: &'static str) -> Result<u64, Damage> {
        self.need(8, field)?;
        Ok(self.bytes.get_u64_le())
    }
    fn blob(&mut self, field: &'static str) -> Result<Bytes, Damage> {
        let n = self.u32(field)? as usize;
        self.need(n, field)?;
        Ok(self.bytes.split_to(n))
    }
    fn string(&mut self, field: &'static str) -> Result<String, Damage> {
        let bytes = self.blob(field)?;
        String::from_utf8(bytes.to_vec()).map_err(|_| Damage::Malformed {
            opcode: self.opcode,
            field,
        })
    }
    fn map(&mut self, field: &'static str) -> Result<MetadataMap, Damage> {
        let mut inner = Fields {
            bytes: self.blob(field)?,
            opcode: self.opcode,
        };
        let mut map = MetadataMap::new();
        while inner.bytes.has_remaining() {
            let key = inner.string(field)?;
            map.insert(key, inner.string(field)?);
        }
        Ok(map)
    }
}

/// A schema record.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct SchemaRecord {
    pub id: u16,
    pub name: String,
    pub encoding: String,
    pub data: Bytes,
}

/// A channel record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ChannelRecord {
    pub id: u16,
    pub schema_id: u16,
    pub topic: String,
    pub message_encoding: String,
    pub metadata: MetadataMap,
}

/// A message record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct MessageRecord {
    pub channel_id: u16,
    pub sequence: u32,
    pub log_ns: u64,
    pub publish_ns: u64,
    pub data: Bytes,
}

/// A chunk record's header and its still compressed content.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ChunkRecord {
    pub start_ns: u64,
    pub end_ns: u64,
    pub uncompressed_bytes: u64,
    pub crc: u32,
    pub compression: String,
    pub content: Bytes,
    /// Content bytes that the header promises; more than `content` in a torn chunk.
    pub content_bytes: u64,
}

/// Counts of a statistics record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct StatisticsRecord {
    pub messages: u64,
    pub chunks: u32,
}

fn fields(opcode: u8, body: &Bytes) -> Fields {
    Fields {
        bytes: body.clone(),
        opcode,
    }
}

pub(super) fn header(body: &Bytes) -> Result<(String, String), Damage> {
    let mut f = fields(op::HEADER, body);
    Ok((f.string("profile")?, f.string("library")?))
}

pub(super) fn metadata(body: &Bytes) -> Result<(String, MetadataMap), Damage> {
    let mut f = fields(op::METADATA, body);
    Ok((f.string("name")?, f.map("metadata map")?))
}

pub(super) fn schema(body: &Bytes) -> Result<SchemaRecord, Damage> {
    let mut f = fields(op::SCHEMA, body);
    let id = f.u16("schema id")?;
    if id == 0 {
        return Err(Damage::Malformed {
            opcode: op::SCHEMA,
            field: "schema id (0 is not allowed)",
        });
    }
    let (name, encoding) = (f.string("schema name")?, f.string("schema encoding")?);
    Ok(SchemaRecord {
        id,
        name,
        encoding,
        data: f.blob("schema data")?,
    })
}

pub(super) fn channel(body: &Bytes) -> Result<ChannelRecord, Damage> {
    let mut f = fields(op::CHANNEL, body);
    Ok(ChannelRecord {
        id: f.u16("channel id")?,
        schema_id: f.u16("schema id")?,
        topic: f.string("topic")?,
        message_encoding: f.string("message encoding")?,
        metadata: f.map("channel metadata")?,
    })
}

pub(super) fn message(body: &Bytes) -> Result<MessageRecord, Damage> {
    let mut f = fields(op::MESSAGE, body);
    Ok(MessageRecord {
        channel_id: f.u16("channel id")?,
        sequence: f.u32("sequence")?,
        log_ns: f.u64("log time")?,
        publish_ns: f.u64("publish time")?,
        data: f.bytes,
    })
}

pub(super) fn statistics(body: &Bytes) -> Result<StatisticsRecord, Damage> {
    let mut f = fields(op::STATISTICS, body);
    let messages = f.u64("message count")?;
    let _schemas = f.u16("schema count")?;
    for field in ["channel count", "attachment count", "metadata count"] {
        f.u32(field)?;
    }
    Ok(StatisticsRecord {
        messages,
        chunks: f.u32("chunk count")?,
    })
}

pub(super) fn data_end(body: &Bytes) -> Result<u32, Damage> {
    fields(op::DATA_END, body).u32("data section crc")
}

pub(super) fn footer_crc(body: &Bytes) -> Result<u32, Damage> {
    let mut f = fields(op::FOOTER, body);
    f.u64("summary start")?;
    f.u64("summary offset start")?;
    f.u32("summary crc")
}

/// Parses a chunk's header. A content shorter than promised is an error unless `torn`.
pub(super) fn chunk(body: &Bytes, torn: bool) -> Result<ChunkRecord, Damage> {
    let mut f = fields(op::CHUNK, body);
    let (start_ns, end_ns) = (f.u64("start time")?, f.u64("end time")?);
    let (uncompressed_bytes, crc) = (f.u64("uncompressed size")?, f.u32("crc")?);
    let compression = f.string("compression")?;
    let content_bytes = f.u64("compressed size")?;
    let have = f.bytes.remaining() as u64;
    if content_bytes > have && !torn {
        return Err(Damage::ChunkSize {
            declared: content_bytes,
            got: have,
        });
    }
    let content = f.bytes.split_to(content_bytes.min(have) as usize);
    Ok(ChunkRecord {
        start_ns,
        end_ns,
        uncompressed_bytes,
        crc,
        compression,
        content,
        content_bytes,
    })
}

impl ChunkRecord {
    /// The chunk's records, decompressed and with their CRC checked.
    pub fn open(&self) -> Result<Bytes, Damage> {
        let bytes = match self.decompress() {
            (bytes, None) => bytes,
            (_, Some(damage)) => return Err(damage),
        };
        let got = bytes.len() as u64;
        if got != self.uncompressed_bytes {
            return Err(Damage::ChunkSize {
                declared: self.uncompressed_bytes,
                got,
            });
        }
        if self.crc != 0 {
            let calculated = crc32fast::hash(&bytes);
            if calculated != self.crc {
                return Err(Damage::ChunkCrc {
                    saved: self.crc,
                    calculated,
                });
            }
        }
        Ok(bytes)
    }

    /// As much of the content as can be had, unchecked, and what stopped it.
    pub fn decompress(&self) -> (Bytes, Option<Damage>) {
        let declared = self.uncompressed_bytes;
        if declared > LIMIT_BYTES {
            return (
                Bytes::new(),
                Some(Damage::TooLong {
                    opcode: op::CHUNK,
                    len: declared,
                }),
            );
        }
        let mut out = Vec::new();
        // One byte more than declared shows a chunk that holds too much.
        let limit = declared + 1;
        let result = match self.compression.as_str() {
            "" => return (self.content.clone(), None),
            "zstd" => {
                zstd::stream::read::Decoder::with_buffer(self.content.as_ref()).and_then(|mut d| {
                    // A forged window size must not allocate more than a chunk may hold.
                    d.window_log_max(LIMIT_BYTES.ilog2())?;
                    d.take(limit).read_to_end(&mut out)
                })
            }
            "lz4" => lz4::Decoder::new(self.content.as_ref())
                .and_then(|d| d.take(limit).read_to_end(&mut out)),
            other => return (Bytes::new(), Some(Damage::Compression(other.to_owned()))),
        };
        (
            Bytes::from(out),
            result.err().map(|e| Damage::Decompress(e.to_string())),
        )
    }
}

/// Takes the next record off a chunk's content.
pub(super) fn next_inner(content: &mut Bytes) -> Option<Result<(u8, Bytes), Damage>> {
    if !content.has_remaining() {
        return None;
    }
    let have = content.remaining() as u64;
    if have < PREFIX_BYTES {
        content.clear();
        return Some(Err(Damage::Cut {
            need: PREFIX_BYTES,
            have,
        }));
    }
    let opcode = content.get_u8();
    let len = content.get_u64_le();
    let have = content.remaining() as u64;
    if len > have {
        content.clear();
        return Some(Err(Damage::Cut { need: len, have }));
    }
    Some(Ok((opcode, content.split_to(len as usize))))
}

/// Schemas and channels declared so far.
#[derive(Debug, Clone, Default)]
pub(super) struct Declared {
    pub schemas: BTreeMap<u16, SchemaRecord>,
    pub channels: BTreeMap<u16, std::sync::Arc<ChannelRecord>>,
}

impl Declared {
    /// Takes a schema; the same one again is fine.
    pub fn add_schema(&mut self, record: SchemaRecord) -> Result<(), Damage> {
        let id = record.id;
        match self.schemas.get(&id) {
            Some(known) if *known != record => Err(Damage::Redeclared { what: "schema", id }),
            Some(_) => Ok(()),
            None => {
                self.schemas.insert(id, record);
                Ok(())
            }
        }
    }

    /// Takes a channel; its schema must be known.
    pub fn add_channel(&mut self, record: ChannelRecord) -> Result<(), Damage> {
        let (id, schema) = (record.id, record.schema_id);
        if schema != 0 && !self.schemas.contains_key(&schema) {
            return Err(Damage::UnknownSchema {
                topic: record.topic,
                schema,
            });
        }
        match self.channels.get(&id) {
            Some(known) if **known != record => Err(Damage::Redeclared {
                what: "channel",
                id,
            }),
            Some(_) => Ok(()),
            None => {
                self.channels.insert(id, record.into());
                Ok(())
            }
        }
    }

    /// Name of a channel's schema, "" without one.
    pub fn schema_name(&self, channel: &ChannelRecord) -> &str {
        self.schemas
            .get(&channel.schema_id)
            .map_or("", |s| s.name.as_str())
    }
}
