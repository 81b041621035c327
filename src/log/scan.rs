//! A file's messages, undecoded but checked, with everything else that a file states about itself.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::sync::Arc;

use bytes::Bytes;
use hydroline_numerics::cancel;
use hydroline_rigs::bounded;
use mcap::records::op;

use super::LogError;
use super::expansion::Expansion;
use super::foreign;
use super::part::MetadataMap;
use super::records::{
    self, ChannelRecord, ChunkRecord, Damage, Declared, Located, MessageRecord, Records,
    StatisticsRecord,
};
use super::seal::{self, SealFinding};

mod onward;
pub(crate) use onward::Spare;

/// One step through a file.
#[derive(Debug)]
pub(super) enum Step {
    /// A message, its channel, and the offset of the top-level record that holds it.
    Message {
        offset: u64,
        channel: Arc<ChannelRecord>,
        message: MessageRecord,
    },
    /// Metadata of the data section.
    Metadata { name: String },
    /// Damage. Further steps may follow: a bad chunk does not spoil the next one.
    Damage { offset: u64, damage: Damage },
    /// The record at the end of the file is truncated inside a chunk: what is there of it.
    Truncated { chunk: ChunkRecord },
}

/// Declarations, metadata and counts that a scan has met so far.
#[derive(Debug, Default)]
pub(super) struct Learnt {
    pub profile: String,
    pub library: String,
    pub declared: Declared,
    pub metadata: BTreeMap<String, MetadataMap>,
    /// Digests of metadata that channels inside chunks repeat, by the metadata's name.
    pub sealed: BTreeMap<String, String>,
    /// Names of the metadata that stand before the first message.
    pub head_metadata: Vec<String>,
    pub messages: u64,
    pub chunks: u64,
    /// Chunks whose writer stated no checksum: damage in them cannot be noticed.
    pub chunks_unchecked: u64,
    pub attachments: u64,
    /// Records of the data section of a kind that MCAP does not define: an extension's, or some whose opcode was hit.
    pub unknown: u64,
    pub statistics: Option<StatisticsRecord>,
    pub compressions: BTreeMap<String, u64>,
    /// DataEnd, footer and magic are there.
    pub ended: bool,
    /// The data section carries a checksum (it was compared, if so).
    pub data_crc_stated: bool,
    /// Logs that stood before this one in the file: identifiers of channels and schemas begin anew with each.
    pub joined: u32,
}

impl Learnt {
    /// The metadata of which the digests do not say that it is as it was written.
    pub fn seal_findings(&self) -> Vec<SealFinding> {
        seal::check(&self.metadata, &self.sealed)
    }
}

/// Steps through a file from start to end.
pub(super) struct Scan<R> {
    records: Records<R>,
    pub learnt: Learnt,
    chunk: Option<(u64, Bytes)>,
    pending: Option<Located>,
    truncated: Option<ChunkRecord>,
    past_data: bool,
    damaged: bool,
    cut: bool,
    done: bool,
    expansion: Expansion,
    /// Offset reached by looking behind the end; `None` = not looked yet.
    ended_at: Option<u64>,
    /// End of the last chunk's content, whatever its record's length says: a wrong length swallows what follows.
    behind_chunk: u64,
    /// Offset of the last message outside chunks.
    last_outside: Option<u64>,
    /// Declarations of the summary, for messages whose own are damaged.
    spare: Spare,
    /// Offset behind the data section.
    data_ended_at: u64,
    /// Offset at which reading went on behind damage: a checksum over the data section cannot be compared any more.
    jumped_to: Option<u64>,
    /// The summary's counts are under its checksum, or the data section is not as long as the footer says.
    counts_stand: bool,
}

pub(super) type FileScan = Scan<BufReader<File>>;

pub(super) fn open(path: &Path) -> Result<FileScan, LogError> {
    let file = bounded::open(path).map_err(LogError::read(path))?;
    Scan::of_file(path, BufReader::with_capacity(1 << 18, file))
        .map_err(|error| foreign::named(path, error))
}

impl<R: BufRead> Scan<R> {
    /// Over any source; the inner error holds the first bytes of something that is not MCAP.
    pub fn new(source: R) -> std::io::Result<Result<Self, Vec<u8>>> {
        Ok(Records::new(source)?.map(|records| Self {
            records,
            learnt: Learnt::default(),
            chunk: None,
            pending: None,
            truncated: None,
            past_data: false,
            damaged: false,
            cut: false,
            done: false,
            expansion: Expansion::default(),
            ended_at: None,
            behind_chunk: 0,
            last_outside: None,
            spare: Spare::default(),
            data_ended_at: 0,
            jumped_to: None,
            counts_stand: true,
        }))
    }

    /// Over a source whose name stands in errors.
    pub fn of_file(name: &Path, source: R) -> Result<Self, LogError> {
        let scan = Self::new(source).map_err(LogError::read(name))?;
        scan.map_err(|found| LogError::no_log(name, found))
    }

    /// The next step; `None` when the file is read. A computation that is cancelled ends here: whatever reads a log can be.
    pub fn next(&mut self) -> Option<Step> {
        cancel::check();
        let step = self.next_inner();
        self.damaged |= matches!(step, Some(Step::Damage { .. }));
        step
    }

    /// Bytes after the last record that was read whole, when the file has no end.
    pub fn unread_bytes(&self, file_bytes: u64) -> u64 {
        file_bytes.saturating_sub(self.records.offset())
    }

    /// Whether the file ends inside a record that holds data: indexes and summaries hold none.
    pub fn cut_in_data(&self) -> bool {
        let data = !matches!(self.records.opcode(), op::MESSAGE_INDEX | op::DATA_END);
        self.cut && data && !self.past_data
    }

    fn next_inner(&mut self) -> Option<Step> {
        loop {
            if let Some(chunk) = self.truncated.take() {
                return Some(Step::Truncated { chunk });
            }
            if let Some((offset, damage)) = self.pending.take() {
                return Some(Step::Damage { offset, damage });
            }
            if let Some((offset, content)) = &mut self.chunk {
                let offset = *offset;
                match records::next_inner(content) {
                    Some(Ok((opcode, body))) => match self.data_record(offset, opcode, &body, true)
                    {
                        Ok(Some(step)) => return Some(step),
                        Ok(None) => {}
                        Err(damage) => return Some(Step::Damage { offset, damage }),
                    },
                    Some(Err(damage)) => return Some(Step::Damage { offset, damage }),
                    None => self.chunk = None,
                }
                continue;
            }
            if self.done {
                return self.behind_the_end();
            }
            match self.records.next() {
                Some(Ok(outer)) => match self.outer(&outer) {
                    Ok(Some(step)) => return Some(step),
                    Ok(None) => {}
                    Err(damage) => {
                        return Some(Step::Damage {
                            offset: outer.offset,
                            damage,
                        });
                    }
                },
                Some(Err(located)) => {
                    self.done = true;
                    self.cut = true;
                    self.truncated = self.records.take_truncated();
                    self.pending = Some(located);
                }
                None => {
                    self.done = true;
                    self.pending = Some((self.records.offset(), Damage::NoEnd));
                }
            }
        }
    }

    /// After the last record: nothing, as it should be, or what was appended to the log.
    fn behind_the_end(&mut self) -> Option<Step> {
        if !self.learnt.ended || self.ended_at == Some(self.records.offset()) {
            return None;
        }
        let found = self.records.behind_the_end();
        self.ended_at = Some(self.records.offset());
        let (offset, damage) = found.err()?;
        if damage == Damage::JoinedLog {
            (self.done, self.past_data, self.cut) = (false, false, false);
            self.jumped_to = None;
            self.spare = Spare::default();
            let learnt = &mut self.learnt;
            (learnt.declared, learnt.statistics) = (Declared::default(), None);
            (learnt.ended, learnt.joined) = (false, learnt.joined + 1);
        }
        Some(Step::Damage { offset, damage })
    }

    fn outer(&mut self, outer: &records::Outer) -> Result<Option<Step>, Damage> {
        let body = &outer.body;
        match outer.opcode {
            op::HEADER => (self.learnt.profile, self.learnt.library) = records::header(body)?,
            op::CHUNK if !self.past_data => {
                self.learnt.chunks += 1;
                let chunk = records::chunk(body, false)?;
                self.behind_chunk = outer.offset + records::PREFIX_BYTES + chunk.bytes();
                // A head of zeros states no content and no checksum, and is no chunk.
                let surplus = (body.len() as u64).saturating_sub(chunk.bytes());
                if chunk.content_bytes == 0 && surplus > 0 {
                    let opcode = op::CHUNK;
                    return Err(Damage::Surplus { opcode, surplus });
                }
                self.learnt.chunks_unchecked +=
                    u64::from(chunk.crc == 0 && chunk.uncompressed_bytes > 0);
                *self
                    .learnt
                    .compressions
                    .entry(chunk.compression.clone())
                    .or_default() += 1;
                let (bytes, read) = (chunk.uncompressed_bytes, self.records.offset());
                self.expansion.take(bytes, read, &self.learnt)?;
                self.chunk = Some((outer.offset, chunk.open()?));
            }
            op::METADATA if !self.past_data => {
                let (name, map) = records::metadata(body)?;
                if self.learnt.messages == 0 {
                    self.learnt.head_metadata.push(name.clone());
                }
                self.learnt.metadata.insert(name.clone(), map);
                return Ok(Some(Step::Metadata { name }));
            }
            op::ATTACHMENT if !self.past_data => self.learnt.attachments += 1,
            op::DATA_END if !self.past_data => {
                self.past_data = true;
                self.data_ended_at = self.records.offset();
                let (saved, calculated) = (records::data_end(body)?, self.records.crc());
                self.records.restart_crc();
                self.learnt.data_crc_stated = saved != 0;
                if saved != 0 && saved != calculated && self.jumped_to.is_none() {
                    return Err(Damage::DataCrc { saved, calculated });
                }
            }
            op::STATISTICS if self.past_data => {
                self.learnt.statistics = Some(records::statistics(body)?)
            }
            op::FOOTER => {
                self.done = true;
                return self.footer(body);
            }
            opcode if !self.past_data => {
                self.learnt.unknown += u64::from(opcode > op::DATA_END);
                return self.data_record(outer.offset, opcode, body, false);
            }
            _ => {}
        }
        Ok(None)
    }

    /// Takes a record of the data section, from a chunk or outside.
    pub fn data_record(
        &mut self,
        offset: u64,
        opcode: u8,
        body: &Bytes,
        in_chunk: bool,
    ) -> Result<Option<Step>, Damage> {
        match opcode {
            op::SCHEMA => self.learnt.declared.add_schema(records::schema(body)?)?,
            op::CHANNEL => {
                let channel = records::channel(body)?;
                if in_chunk {
                    let stated = seal::in_channel(&channel.metadata);
                    let stated = stated.map(|(name, digest)| (name.to_owned(), digest.to_owned()));
                    self.learnt.sealed.extend(stated);
                }
                self.learnt.declared.add_channel(channel)?;
            }
            op::MESSAGE => {
                let message = records::message(body)?;
                let id = message.channel_id;
                let channel = self.learnt.declared.channels.get(&id).cloned();
                let channel = channel
                    .or_else(|| self.spared(id))
                    .ok_or(Damage::UnknownChannel(id))?;
                self.learnt.messages += 1;
                if !in_chunk {
                    self.last_outside = Some(offset);
                }
                return Ok(Some(Step::Message {
                    offset,
                    channel,
                    message,
                }));
            }
            _ => {}
        }
        Ok(None)
    }

    /// The end: summary checksum, magic, and the counts, which show a chunk that vanished
    /// because its opcode was hit.
    fn footer(&mut self, body: &Bytes) -> Result<Option<Step>, Damage> {
        let saved = records::footer_crc(body)?;
        let calculated = self.records.crc_with_footer(body);
        let contradicted = saved != 0 && saved != calculated;
        if !self.past_data {
            return Err(match contradicted {
                true => Damage::SummaryCrc { saved, calculated },
                false => Damage::NoEnd,
            });
        }
        let magic = self.records.end_magic();
        self.learnt.ended = magic.is_ok();
        // Its counts are no more certain than the rest of it.
        if contradicted {
            return Err(Damage::SummaryCrc { saved, calculated });
        }
        magic.map_err(|(_, damage)| damage)?;
        let in_place = records::footer_summary_start(body)? == self.data_ended_at;
        self.counts_stand = saved != 0 || !in_place || self.learnt.unknown > 0;
        if let (Some(stated), false) = (self.learnt.statistics, self.damaged) {
            let found = self.learnt.messages;
            if stated.messages != found {
                return Err(Damage::MessageCount {
                    stated: stated.messages,
                    found,
                });
            }
            let (stated, found) = (u64::from(stated.chunks), self.learnt.chunks);
            if stated != found {
                return Err(Damage::ChunkCount { stated, found });
            }
        }
        Ok(None)
    }
}
