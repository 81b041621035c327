//! Places of the messages of a log: by its summary, or by reading everything.
//!
//! A summary counts only if nothing that it does not name can hold messages: what lies between the chunks that it names
//! is looked at, record by record.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::Path;

use bytes::{Buf, Bytes};
use hydroline_numerics::cancel;
use mcap::records::op;

use super::Place;
use crate::LogError;
use crate::part::MetadataMap;
use crate::records::{self, Damage, Declared, LIMIT_BYTES, PREFIX_BYTES};
use crate::scan::{self, Spare, Step};

/// Footer and magic at the end of a file.
const TAIL_BYTES: u64 = PREFIX_BYTES + 20 + 8;
/// The checksum of the summary stands at the end of the footer, and is not of itself.
const CRC_BYTES: usize = 4;

/// Declarations, metadata and chunks of a log, by its summary or by reading everything.
#[derive(Debug, Default)]
pub(crate) struct Contents {
    pub declared: Declared,
    pub metadata: BTreeMap<String, MetadataMap>,
    pub places: Vec<Place>,
    messages: BTreeMap<u16, u64>,
    /// Offset of the summary that says so; 0 = they were counted.
    pub stated_at: u64,
}

impl Contents {
    pub fn messages_of(&self, channel: u16) -> u64 {
        self.messages.get(&channel).copied().unwrap_or(0)
    }

    /// Messages of each topic.
    pub fn counts(&self) -> BTreeMap<&str, u64> {
        let mut counts: BTreeMap<&str, u64> = BTreeMap::new();
        for channel in self.declared.channels.values() {
            let count = counts.entry(channel.topic.as_str()).or_default();
            *count = count.saturating_add(self.messages_of(channel.id));
        }
        counts
    }
}

fn bytes_at(file: &File, offset: u64, len: u64) -> Result<Bytes, Damage> {
    if len > LIMIT_BYTES {
        return Err(Damage::TooLong { opcode: 0, len });
    }
    let mut bytes = vec![0; len as usize];
    file.read_exact_at(&mut bytes, offset)
        .map_err(|e| Damage::Io(e.to_string()))?;
    Ok(Bytes::from(bytes))
}

/// Opcode and length of the record at `offset`.
fn prefix_at(file: &File, offset: u64) -> Result<(u8, u64), Damage> {
    let mut prefix = bytes_at(file, offset, PREFIX_BYTES)?;
    Ok((prefix.get_u8(), prefix.get_u64_le()))
}

/// Opcode and body of the record at `offset`.
pub(super) fn record_at(file: &File, offset: u64) -> Result<(u8, Bytes), Damage> {
    let (opcode, len) = prefix_at(file, offset)?;
    Ok((opcode, bytes_at(file, offset + PREFIX_BYTES, len)?))
}

/// The same where its length is known, in one read.
pub(super) fn record_of(file: &File, offset: u64, bytes: u64) -> Result<(u8, Bytes), Damage> {
    // The limit is that of a body.
    if bytes > LIMIT_BYTES {
        return record_at(file, offset);
    }
    let mut record = bytes_at(file, offset, bytes.max(PREFIX_BYTES))?;
    let (opcode, len) = (record.get_u8(), record.get_u64_le());
    match len == record.len() as u64 {
        true => Ok((opcode, record)),
        // Its own length holds: the summary's is of another record.
        false => record_at(file, offset),
    }
}

/// Number of messages of each channel, by the message indexes behind a chunk.
pub(super) fn indexed_messages(file: &File, place: &Place) -> Result<BTreeMap<u16, u64>, Damage> {
    let behind = place.offset.saturating_add(place.bytes.unwrap_or(0));
    let mut indexes = bytes_at(file, behind, place.index_bytes)?;
    let mut messages = BTreeMap::new();
    while let Some(record) = records::next_inner(&mut indexes) {
        let (opcode, body) = record?;
        if opcode == op::MESSAGE_INDEX {
            let (channel, count) = records::message_index(&body)?;
            messages.insert(channel, count);
        }
    }
    Ok(messages)
}

/// The summary's records with the footer, and where they begin; `None` = there is no summary.
fn summary_section(file: &File) -> Result<Option<(u64, Bytes)>, Damage> {
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
    let Some(len) = end
        .checked_sub(start)
        .filter(|_| start > 0 && start <= footer_at)
    else {
        return Ok(None);
    };
    let section = bytes_at(file, start, len)?;
    let saved = records::footer_crc(&footer)?;
    let calculated = crc32fast::hash(&section[..section.len() - CRC_BYTES]);
    if saved != 0 && saved != calculated {
        return Err(Damage::SummaryCrc { saved, calculated });
    }
    Ok(Some((start, section)))
}

/// Schemas and channels that a sound summary repeats, and whether it counts no chunk; none without one.
pub(crate) fn declared_at_end(file: &File) -> Spare {
    let mut spare = Spare::default();
    let Ok(Some((_, mut section))) = summary_section(file) else {
        return spare;
    };
    let declared = &mut spare.declared;
    let (mut chunks, mut indexed) = (None, false);
    while let Some(Ok((opcode, body))) = records::next_inner(&mut section) {
        let taken = match opcode {
            op::SCHEMA => records::schema(&body).and_then(|s| declared.add_schema(s)),
            op::CHANNEL => records::channel(&body).and_then(|c| declared.add_channel(c)),
            op::STATISTICS => records::statistics(&body).map(|s| chunks = Some(s.chunks)),
            op::CHUNK_INDEX => {
                indexed = true;
                Ok(())
            }
            _ => Ok(()),
        };
        if taken.is_err() {
            return Spare::default();
        }
    }
    spare.is_without_chunks = chunks == Some(0) && !indexed;
    spare
}

/// Contents by the summary; `None` = there is none, or not of everything.
pub(crate) fn summary(file: &File) -> Result<Option<Contents>, Damage> {
    let Some((start, mut section)) = summary_section(file)? else {
        return Ok(None);
    };
    let (mut contents, mut stated) = (Contents::default(), None);
    let mut chunks = Vec::new();
    while let Some(record) = records::next_inner(&mut section) {
        let (opcode, body) = record?;
        match opcode {
            op::SCHEMA => contents.declared.add_schema(records::schema(&body)?)?,
            op::CHANNEL => contents.declared.add_channel(records::channel(&body)?)?,
            op::STATISTICS => {
                stated = Some(records::statistics(&body)?);
                contents.messages = records::channel_counts(&body)?;
                contents.stated_at = start;
            }
            // The summary begins behind the data, not within it.
            op::CHUNK | op::MESSAGE | op::DATA_END => return Ok(None),
            op::CHUNK_INDEX => chunks.push(records::chunk_index(&body)?),
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
    chunks.sort_by_key(|c| c.chunk_offset);
    let mut counts = contents.messages.values();
    let counted = counts.try_fold(0u64, |sum, n| sum.checked_add(*n));
    let agrees = |s: records::StatisticsRecord| {
        Some(s.messages) == counted && u64::from(s.chunks) == chunks.len() as u64
    };
    if !stated.is_some_and(agrees) || !names_all(file, &chunks, start)? {
        return Ok(None);
    }
    let with_messages = contents.messages.iter().filter(|(_, n)| **n > 0);
    let with_messages: BTreeSet<u16> = with_messages.map(|(channel, _)| *channel).collect();
    let indexed: BTreeSet<u16> = (chunks.iter())
        .flat_map(|c| c.message_indexes.keys().copied())
        .collect();
    let declared = |id: &u16| {
        let channel = contents.declared.channels.get(id);
        let schemas = &contents.declared.schemas;
        channel.is_some_and(|c| c.schema_id == 0 || schemas.contains_key(&c.schema_id))
    };
    if !with_messages.is_subset(&indexed) || !with_messages.iter().all(declared) {
        return Ok(None);
    }
    contents.places = chunks.into_iter().map(place).collect();
    Ok(Some(contents))
}

fn place(chunk: records::ChunkIndexRecord) -> Place {
    Place {
        span_ns: chunk.span_ns,
        offset: chunk.chunk_offset,
        bytes: Some(chunk.chunk_bytes),
        channels: chunk.message_indexes.into_keys().collect(),
        index_bytes: chunk.message_index_bytes,
        messages: Default::default(),
    }
}

/// Whether the messages of the data section, which ends at `end`, are all in these chunks and their indexes name them.
fn names_all(file: &File, chunks: &[records::ChunkIndexRecord], end: u64) -> Result<bool, Damage> {
    let mut at = mcap::MAGIC.len() as u64;
    for chunk in chunks {
        cancel::check();
        let behind = chunk.chunk_offset.saturating_add(chunk.chunk_bytes);
        let end = behind.saturating_add(chunk.message_index_bytes);
        let indexes = &chunk.message_indexes;
        let named = match (indexes.values().min(), indexes.values().max()) {
            (Some(first), Some(last)) => *first == behind && *last < end,
            // No message, or no index of them.
            _ => holds_none(file, chunk)?,
        };
        if !named || !between(file, at, chunk.chunk_offset)? {
            return Ok(false);
        }
        at = end;
    }
    between(file, at, end)
}

/// Whether a chunk is without messages.
fn holds_none(file: &File, chunk: &records::ChunkIndexRecord) -> Result<bool, Damage> {
    let (opcode, body) = record_of(file, chunk.chunk_offset, chunk.chunk_bytes)?;
    if opcode != op::CHUNK || body.len() as u64 + PREFIX_BYTES != chunk.chunk_bytes {
        return Ok(false);
    }
    let (content, mut none) = (records::chunk(&body, false)?.open()?, true);
    records::each_message(&content, |_, _, _| {
        none = false;
        Ok::<(), Damage>(())
    })?;
    Ok(none)
}

/// Whether the records from `at` to `end` hold no message.
fn between(file: &File, mut at: u64, end: u64) -> Result<bool, Damage> {
    while at < end {
        cancel::check();
        let (opcode, len) = prefix_at(file, at)?;
        if matches!(opcode, op::MESSAGE | op::CHUNK) {
            return Ok(false);
        }
        at = at.saturating_add(PREFIX_BYTES).saturating_add(len);
    }
    Ok(at == end)
}

/// A place whose messages were met one by one.
struct Counted {
    offset: u64,
    span_ns: (u64, u64),
    messages: BTreeMap<u16, u64>,
}

/// The same by reading everything, and what is missing at the end.
pub(super) fn scanned(
    path: &Path,
    mut scan: scan::FileScan,
) -> Result<(Contents, Option<LogError>), LogError> {
    let mut counted: Vec<Counted> = Vec::new();
    let mut end_missing = None;
    while let Some(step) = scan.next() {
        match step {
            Step::Message {
                offset,
                channel,
                message,
            } => {
                if counted.last().is_none_or(|last| last.offset != offset) {
                    counted.push(Counted {
                        offset,
                        span_ns: (u64::MAX, 0),
                        messages: BTreeMap::new(),
                    });
                }
                if let Some(last) = counted.last_mut() {
                    *last.messages.entry(channel.id).or_default() += 1;
                    let (from, to) = last.span_ns;
                    last.span_ns = (from.min(message.log_ns), to.max(message.log_ns));
                }
            }
            Step::Damage { offset, damage } => {
                let error = LogError::damaged(path, (offset, damage));
                if !error.is_missing_end() {
                    return Err(error);
                }
                end_missing = Some(error);
            }
            Step::Truncated { .. } | Step::Metadata { .. } => {}
        }
    }
    let mut messages: BTreeMap<u16, u64> = BTreeMap::new();
    for (channel, n) in counted.iter().flat_map(|place| &place.messages) {
        *messages.entry(*channel).or_default() += n;
    }
    let places = counted.into_iter().map(|place| Place {
        span_ns: place.span_ns,
        offset: place.offset,
        bytes: None,
        channels: place.messages.keys().copied().collect(),
        index_bytes: 0,
        messages: place.messages.into(),
    });
    let contents = Contents {
        declared: scan.learnt.declared,
        metadata: scan.learnt.metadata,
        places: places.collect(),
        messages,
        stated_at: 0,
    };
    Ok((contents, end_missing))
}
