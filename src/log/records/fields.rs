//! The content of records, each field only as long as the bytes that are there.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::io::Read;

use bytes::{Buf, Bytes};
use mcap::records::op;

use super::{Damage, LIMIT_BYTES, PREFIX_BYTES, ZSTD_EXPANSION_MAX};
use crate::part::MetadataMap;

thread_local! {
    /// Of this thread: to make one takes longer than to unpack a small chunk.
    static DECOMPRESSOR: RefCell<Option<zstd::bulk::Decompressor<'static>>> = const { RefCell::new(None) };
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
    /// A map of channels to counts or offsets.
    fn by_channel(&mut self, field: &'static str) -> Result<BTreeMap<u16, u64>, Damage> {
        self.pairs(field, |inner| Ok((inner.u16(field)?, inner.u64(field)?)))
    }
    fn map(&mut self, field: &'static str) -> Result<MetadataMap, Damage> {
        self.pairs(field, |inner| {
            Ok((inner.string(field)?, inner.string(field)?))
        })
    }
    fn pairs<K: Ord, V>(
        &mut self,
        field: &'static str,
        pair: impl Fn(&mut Fields) -> Result<(K, V), Damage>,
    ) -> Result<BTreeMap<K, V>, Damage> {
        let mut inner = Fields {
            bytes: self.blob(field)?,
            opcode: self.opcode,
        };
        let mut map = BTreeMap::new();
        while inner.bytes.has_remaining() {
            let (key, value) = pair(&mut inner)?;
            map.insert(key, value);
        }
        Ok(map)
    }
}

#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct SchemaRecord {
    pub id: u16,
    pub name: String,
    pub encoding: String,
    pub data: Bytes,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ChannelRecord {
    pub id: u16,
    pub schema_id: u16,
    pub topic: String,
    pub message_encoding: String,
    pub metadata: MetadataMap,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct MessageRecord {
    pub channel_id: u16,
    pub sequence: u32,
    pub log_ns: u64,
    pub publish_ns: u64,
    pub data: Bytes,
}

/// A chunk record's header and its still compressed content.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ChunkRecord {
    pub start_ns: u64,
    pub end_ns: u64,
    pub uncompressed_bytes: u64,
    pub crc: u32,
    pub compression: String,
    pub content: Bytes,
    /// Content bytes by the header; more than `content` in a truncated chunk.
    pub content_bytes: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct StatisticsRecord {
    pub messages: u64,
    pub chunks: u32,
}

/// Messages of each channel, by a statistics record.
pub(crate) fn channel_counts(body: &Bytes) -> Result<BTreeMap<u16, u64>, Damage> {
    let (mut f, _) = statistics_fields(body)?;
    for field in ["message start time", "message end time"] {
        f.u64(field)?;
    }
    f.by_channel("channel message counts")
}

fn fields(opcode: u8, body: &Bytes) -> Fields {
    Fields {
        bytes: body.clone(),
        opcode,
    }
}

pub(crate) fn header(body: &Bytes) -> Result<(String, String), Damage> {
    let mut f = fields(op::HEADER, body);
    Ok((f.string("profile")?, f.string("library")?))
}

pub(crate) fn metadata(body: &Bytes) -> Result<(String, MetadataMap), Damage> {
    let mut f = fields(op::METADATA, body);
    let found = (f.string("name")?, f.map("metadata map")?);
    // No checksum holds this length: one that is too large swallows the records behind it.
    match f.bytes.remaining() as u64 {
        0 => Ok(found),
        surplus => Err(Damage::Surplus {
            opcode: op::METADATA,
            surplus,
        }),
    }
}

pub(crate) fn schema(body: &Bytes) -> Result<SchemaRecord, Damage> {
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

pub(crate) fn channel(body: &Bytes) -> Result<ChannelRecord, Damage> {
    let mut f = fields(op::CHANNEL, body);
    Ok(ChannelRecord {
        id: f.u16("channel id")?,
        schema_id: f.u16("schema id")?,
        topic: f.string("topic")?,
        message_encoding: f.string("message encoding")?,
        metadata: f.map("channel metadata")?,
    })
}

pub(crate) fn message(body: &Bytes) -> Result<MessageRecord, Damage> {
    let mut f = fields(op::MESSAGE, body);
    Ok(MessageRecord {
        channel_id: f.u16("channel id")?,
        sequence: f.u32("sequence")?,
        log_ns: f.u64("log time")?,
        publish_ns: f.u64("publish time")?,
        data: f.bytes,
    })
}

pub(crate) fn statistics(body: &Bytes) -> Result<StatisticsRecord, Damage> {
    statistics_fields(body).map(|(_, record)| record)
}

/// The counts of the whole file, and the fields behind them.
fn statistics_fields(body: &Bytes) -> Result<(Fields, StatisticsRecord), Damage> {
    let mut f = fields(op::STATISTICS, body);
    let messages = f.u64("message count")?;
    let _schemas = f.u16("schema count")?;
    for field in ["channel count", "attachment count", "metadata count"] {
        f.u32(field)?;
    }
    let chunks = f.u32("chunk count")?;
    Ok((f, StatisticsRecord { messages, chunks }))
}

pub(crate) fn data_end(body: &Bytes) -> Result<u32, Damage> {
    fields(op::DATA_END, body).u32("data section crc")
}

pub(crate) fn footer_crc(body: &Bytes) -> Result<u32, Damage> {
    let mut f = fields(op::FOOTER, body);
    f.u64("summary start")?;
    f.u64("summary offset start")?;
    f.u32("summary crc")
}

/// Offset of the summary, 0 = there is none.
pub(crate) fn footer_summary_start(body: &Bytes) -> Result<u64, Damage> {
    fields(op::FOOTER, body).u64("summary start")
}

/// Index of a chunk in the summary.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ChunkIndexRecord {
    /// First and last time of logging in it \[ns\].
    pub span_ns: (u64, u64),
    pub chunk_offset: u64,
    pub chunk_bytes: u64,
    /// Offset of each channel's message index in the file: behind the chunk.
    pub message_indexes: BTreeMap<u16, u64>,
    /// Of all message indexes.
    pub message_index_bytes: u64,
}

pub(crate) fn chunk_index(body: &Bytes) -> Result<ChunkIndexRecord, Damage> {
    let mut f = fields(op::CHUNK_INDEX, body);
    let span_ns = (f.u64("start time")?, f.u64("end time")?);
    let (chunk_offset, chunk_bytes) = (f.u64("chunk offset")?, f.u64("chunk length")?);
    let message_indexes = f.by_channel("message index offsets")?;
    Ok(ChunkIndexRecord {
        span_ns,
        chunk_offset,
        chunk_bytes,
        message_indexes,
        message_index_bytes: f.u64("message index length")?,
    })
}

/// Channel and number of its messages in the chunk before.
pub(crate) fn message_index(body: &Bytes) -> Result<(u16, u64), Damage> {
    /// Time and offset of each message.
    const ENTRY_BYTES: u64 = 16;
    let mut f = fields(op::MESSAGE_INDEX, body);
    let channel = f.u16("channel id")?;
    let entries = f.blob("message index entries")?;
    Ok((channel, entries.len() as u64 / ENTRY_BYTES))
}

/// Offset of the metadata record that the summary names.
pub(crate) fn metadata_index(body: &Bytes) -> Result<u64, Damage> {
    fields(op::METADATA_INDEX, body).u64("metadata offset")
}

/// Parses a chunk's header. A content shorter than the header states is an error unless `truncated`.
pub(crate) fn chunk(body: &Bytes, truncated: bool) -> Result<ChunkRecord, Damage> {
    let mut f = fields(op::CHUNK, body);
    let (start_ns, end_ns) = (f.u64("start time")?, f.u64("end time")?);
    let (uncompressed_bytes, crc) = (f.u64("uncompressed size")?, f.u32("crc")?);
    let compression = f.string("compression")?;
    let content_bytes = f.u64("compressed size")?;
    let have = f.bytes.remaining() as u64;
    if content_bytes > have && !truncated {
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
    /// Bytes of the record behind its length, as its own fields say: two times, two sizes, checksum, the compression's name
    /// behind its length, the content behind its length.
    pub fn bytes(&self) -> u64 {
        40 + self.compression.len() as u64 + self.content_bytes
    }

    /// The chunk's records, decompressed and with their CRC checked.
    pub fn open(&self) -> Result<Bytes, Damage> {
        let bytes = match self.at_once() {
            Some(bytes) => bytes,
            None => match self.decompress() {
                (bytes, None) => bytes,
                (_, Some(damage)) => return Err(damage),
            },
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

    /// The whole content of a sound chunk in one step, half as long as through a stream; `None` = the stream says why.
    fn at_once(&self) -> Option<Bytes> {
        let declared = self.uncompressed_bytes;
        let room = (self.content.len() as u64).saturating_mul(ZSTD_EXPANSION_MAX);
        if self.compression != "zstd" || declared > LIMIT_BYTES.min(room) {
            return None;
        }
        let mut out = Vec::with_capacity(declared as usize);
        // Without a window of its own: it unpacks into the buffer, which is all that it can fill.
        let got = DECOMPRESSOR.with_borrow_mut(|kept| {
            if kept.is_none() {
                *kept = zstd::bulk::Decompressor::new().ok();
            }
            let decompressor = kept.as_mut()?;
            decompressor
                .decompress_to_buffer(&self.content[..], &mut out)
                .ok()
        });
        (got? as u64 == declared).then(|| Bytes::from(out))
    }

    /// Content of a chunk whose record does not end, as far as it is certain; `goes_on` = a sound record was found behind it. All of it
    /// is there when only a length was wrong: then its checksum must hold. A cut at the end of the file leaves a true beginning of
    /// what was written; what is followed by others is none.
    pub fn certain(&self, goes_on: bool) -> Bytes {
        let is_whole = self.content.len() as u64 == self.content_bytes;
        match (is_whole, goes_on) {
            (true, _) => self.open().unwrap_or_default(),
            (false, false) => self.decompress().0,
            (false, true) => Bytes::new(),
        }
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
        // Room at once, but no more than a chunk of this size can fill.
        let room = (self.content.len() as u64).saturating_mul(ZSTD_EXPANSION_MAX);
        let mut out = Vec::with_capacity(declared.min(room) as usize);
        // One byte more than declared shows a chunk that holds too much.
        let limit = declared + 1;
        let result = match self.compression.as_str() {
            "" => return (self.content.clone(), None),
            "zstd" => {
                zstd::stream::read::Decoder::with_buffer(self.content.as_ref()).and_then(|mut d| {
                    // A forged window size must not allocate more than a chunk may hold.
                    d.window_log_max(LIMIT_BYTES.next_power_of_two().ilog2())?;
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
pub(crate) fn next_inner(content: &mut Bytes) -> Option<Result<(u8, Bytes), Damage>> {
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

/// Hands on the messages of a chunk's content where they lie: channel, time of logging, bytes.
pub(crate) fn each_message<E: From<Damage>>(
    mut content: &[u8],
    mut each: impl FnMut(u16, u64, &[u8]) -> Result<(), E>,
) -> Result<(), E> {
    /// Channel, sequence, time of logging, time of publishing.
    const HEAD_BYTES: usize = 2 + 4 + 8 + 8;
    while !content.is_empty() {
        let have = content.len() as u64;
        let Some((prefix, rest)) = content.split_at_checked(PREFIX_BYTES as usize) else {
            let need = PREFIX_BYTES;
            return Err(Damage::Cut { need, have }.into());
        };
        let (opcode, len) = (prefix[0], (&prefix[1..]).get_u64_le());
        let cut = Damage::Cut {
            need: len,
            have: rest.len() as u64,
        };
        let (body, behind) = usize::try_from(len)
            .ok()
            .and_then(|len| rest.split_at_checked(len))
            .ok_or(cut)?;
        content = behind;
        if opcode != op::MESSAGE {
            continue;
        }
        let (mut head, data) = body.split_at_checked(HEAD_BYTES).ok_or(Damage::Malformed {
            opcode,
            field: "message head",
        })?;
        let (channel, _sequence, log_ns) =
            (head.get_u16_le(), head.get_u32_le(), head.get_u64_le());
        each(channel, log_ns, data)?;
    }
    Ok(())
}

/// Schemas and channels declared so far.
#[derive(Debug, Clone, Default)]
pub(crate) struct Declared {
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
