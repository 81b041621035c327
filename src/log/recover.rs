//! Mends a cut or damaged log into a new file and proves that it did.
//!
//! The original is opened for reading only. What is sound is copied: closed chunks whose checksum
//! holds, records outside chunks, and, from a chunk in which the file ends, every message whose
//! last byte was still decompressed. The new file is then read again and compared. A recording that never wrote its
//! closing summary gets one of what was kept, marked `recovered`.

mod copy;
mod ledger;

use hydroline_core::plain::Lines;
use std::collections::BTreeMap;
use std::fmt;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use bytes::Bytes;
use hydroline_core::build_info::BuildInfo;
use hydroline_rigs::bounded;
use serde::Serialize;

use super::LogError;
use super::atomic_file::AtomicFile;
use super::entry::Company;
use super::indexed::declared_at_end;
use super::part::MetadataMap;
use super::reader::decode;
use super::records::{ChunkRecord, RecordFinder};
use super::scan::{self, FileScan, Step};
use super::seal::{SealFinding, SealState, sealed};
use copy::{Copy, Digest};
use ledger::Ledger;

/// Outcome of a recovery: counts, damage, and the data that is missing in the new file.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Recovery {
    /// The original, untouched.
    pub input: PathBuf,
    /// The new file.
    pub output: PathBuf,
    /// Size of the original.
    pub input_bytes: u64,
    /// Size of the new file.
    pub output_bytes: u64,
    /// Messages in the new file by topic.
    pub messages: BTreeMap<String, u64>,
    /// Their sum.
    pub messages_total: u64,
    /// Number of them that come from the truncated last chunk.
    #[serde(rename = "from_torn_chunk")]
    pub from_truncated_chunk: u64,
    /// Places of damage in the original: (offset \[bytes\], description).
    pub damage: Vec<(u64, String)>,
    /// Messages that do not decode, by topic; copied as they are.
    pub undecodable: BTreeMap<String, u64>,
    /// Metadata of which the digests do not say that it is as it was written; copied as it is, digest and all, so that
    /// the new file says the same.
    pub metadata: Vec<SealFinding>,
    /// Bytes at the end that gave nothing.
    pub unread_bytes: u64,
    /// Attachments, which are not copied.
    pub attachments_left: u64,
    /// Whether the original had its end and nothing was damaged.
    pub was_whole: bool,
    /// Whether data that was in the original is not in the new file (exit code 3).
    pub lossy: bool,
}

/// Recovers `input` into the new file `output`, as a library without a build of its own.
///
/// # Errors
/// As [`recover_as`].
pub fn recover(input: &Path, output: &Path) -> Result<Recovery, LogError> {
    recover_as(input, output, BuildInfo::default())
}

/// Recovers `input` into the new file `output`, whose header names `build`.
///
/// # Errors
/// [`LogError::OutputExists`]; [`LogError::Read`] and [`LogError::NotMcap`] for the input;
/// [`LogError::Output`]; [`LogError::Verify`] when the result does not read back (it is removed).
pub fn recover_as(input: &Path, output: &Path, build: BuildInfo) -> Result<Recovery, LogError> {
    let scan = scan::open(input)?;
    let input_bytes = input.metadata().map_err(LogError::read(input))?.len();
    // Half a recovery is worse than none: it gets its name when it has been read back.
    let unfinished = AtomicFile::begin(output)?;
    let file = unfinished.file()?;
    let (recovery, digest) = copy_all(scan, input, output, file, input_bytes, build)?;
    verify(unfinished.path(), recovery.messages_total, digest)?;
    unfinished.finish()?;
    Ok(recovery)
}

fn copy_all(
    scan: FileScan,
    input: &Path,
    output: &Path,
    file: File,
    input_bytes: u64,
    build: BuildInfo,
) -> Result<(Recovery, u32), LogError> {
    let out = |e: mcap::McapError| LogError::Output {
        path: output.to_owned(),
        reason: std::error::Error::source(&e).map_or_else(|| e.to_string(), |s| s.to_string()),
    };
    let read = LogError::read(input);
    let source = bounded::open(input).map_err(&read)?;
    let mut scan = scan.with_spare(declared_at_end(&source));
    let mut finder = RecordFinder::new(source).map_err(&read)?;
    // Head metadata first, and far enough to see whether chunks are compressed (MJPG's are not).
    let mut head = Vec::new();
    let first = loop {
        match scan.next() {
            Some(Step::Metadata { name }) if scan.learnt.chunks == 0 => head.push(name),
            step => break step,
        }
    };
    let compressed = scan.learnt.compressions.keys().any(|c| !c.is_empty());
    let writer = mcap::WriteOptions::new()
        .profile(scan.learnt.profile.clone())
        .library(format!("hydroline {build} recover"))
        .compression(compressed.then_some(mcap::Compression::Zstd))
        .compression_level(1)
        .compression_threads(0)
        .chunk_size(None)
        .create(BufWriter::with_capacity(1 << 20, file))
        .map_err(out)?;
    let (channels, messages) = (BTreeMap::new(), BTreeMap::new());
    let mut copy = Copy {
        writer,
        channels,
        digest: Digest::default(),
        ledger: Ledger::default(),
        messages,
        total: 0,
        company: Company::Others,
        open_bytes: 0,
    };
    for name in head {
        let map = scan.learnt.metadata.get(&name).cloned().unwrap_or_default();
        copy.metadata(&name, map).map_err(out)?;
    }
    let (mut damage, mut undecodable) = (Vec::new(), BTreeMap::<String, u64>::new());
    let (mut from_truncated, mut spoilt, mut info) = (0, false, None);
    // Chunk that the file, or a wrong length, ends in: what it is shows with the damage that follows.
    let mut truncated: Option<ChunkRecord> = None;
    let mut step = first;
    while let Some(now) = step {
        match now {
            Step::Message {
                channel, message, ..
            } => {
                copy.message(&scan, &channel, &message).map_err(out)?;
                let schema = scan.learnt.declared.schema_name(&channel).to_owned();
                if decode(&channel, &schema, message, &mut info).is_err() {
                    *undecodable.entry(channel.topic.clone()).or_default() += 1;
                }
            }
            Step::Metadata { name } => {
                let map = scan.learnt.metadata.get(&name).cloned().unwrap_or_default();
                copy.metadata(&name, map).map_err(out)?;
            }
            Step::Truncated { chunk } => truncated = Some(chunk),
            Step::Damage { offset, damage: d } => {
                spoilt |= scan.costs_data(&d);
                damage.push((offset, d.to_string()));
                let next = scan.go_on(&mut finder, offset, &d).map_err(&read)?;
                spoilt |= next.is_some();
                if let Some(chunk) = truncated.take() {
                    let content = chunk.certain(next.is_some());
                    from_truncated +=
                        salvage(content, offset, &mut scan, &mut copy).map_err(out)?;
                }
            }
        }
        step = scan.next();
    }
    spoilt |= !undecodable.is_empty();
    // Of a damaged file a record of unknown kind may be one whose opcode was hit.
    spoilt |= !damage.is_empty() && scan.learnt.unknown > 0;
    let metadata = scan.learnt.seal_findings();
    spoilt |= metadata.iter().any(|f| f.state != SealState::Unverifiable);
    let was_whole = scan.learnt.ended && damage.is_empty() && !spoilt;
    let unread_bytes = if was_whole {
        0
    } else {
        scan.unread_bytes(input_bytes)
    };
    let mut note = MetadataMap::from([
        ("from".to_owned(), input.display().to_string()),
        ("input_bytes".to_owned(), input_bytes.to_string()),
        ("messages".to_owned(), copy.total.to_string()),
        (
            "messages_from_torn_chunk".to_owned(),
            from_truncated.to_string(),
        ),
        ("unread_bytes".to_owned(), unread_bytes.to_string()),
    ]);
    for (n, (offset, text)) in damage.iter().take(100).enumerate() {
        note.insert(format!("damage.{n:03}"), format!("byte {offset}: {text}"));
    }
    for (topic, n) in &undecodable {
        note.insert(format!("undecodable.{topic}"), n.to_string());
    }
    for (n, finding) in metadata.iter().enumerate() {
        note.insert(format!("metadata.{n:03}"), finding.to_string());
    }
    copy.metadata("recovered", sealed("recovered", note))
        .map_err(out)?;
    let ours = scan.learnt.metadata.contains_key("rig");
    if ours && !scan.learnt.metadata.contains_key("summary") {
        let summary = copy.ledger.summary(&copy.messages);
        copy.metadata("summary", sealed("summary", summary))
            .map_err(out)?;
    }
    copy.writer.finish().map_err(out)?;
    let written = || -> std::io::Result<u64> {
        let mut buffered = copy.writer.into_inner();
        buffered.flush()?;
        buffered.get_ref().sync_all()?;
        Ok(buffered.get_ref().metadata()?.len())
    };
    let output_bytes = written().map_err(LogError::output(output))?;
    let recovery = Recovery {
        input: input.to_owned(),
        output: output.to_owned(),
        input_bytes,
        output_bytes,
        messages: copy.messages,
        messages_total: copy.total,
        from_truncated_chunk: from_truncated,
        damage,
        undecodable,
        metadata,
        unread_bytes,
        attachments_left: scan.learnt.attachments,
        was_whole,
        lossy: spoilt || scan.cut_in_data() || scan.learnt.attachments > 0,
    };
    Ok((recovery, copy.digest.0.finalize()))
}

/// Copies the whole messages of a truncated chunk's content, and counts them: a record whose last byte is there is as it was;
/// ours must decode, too.
fn salvage(
    mut content: Bytes,
    offset: u64,
    scan: &mut FileScan,
    copy: &mut Copy,
) -> Result<u64, mcap::McapError> {
    let (mut info, mut salvaged) = (None, 0);
    while let Some((channel, message)) = scan.next_salvaged(offset, &mut content) {
        let schema = scan.learnt.declared.schema_name(&channel).to_owned();
        if decode(&channel, &schema, message.clone(), &mut info).is_ok() {
            copy.message(scan, &channel, &message)?;
            salvaged += 1;
        }
    }
    Ok(salvaged)
}

fn verify(output: &Path, messages: u64, digest: u32) -> Result<(), LogError> {
    let failed = |reason: String| LogError::Verify {
        path: output.to_owned(),
        reason,
    };
    let mut scan = scan::open(output)?;
    let mut again = Digest::default();
    while let Some(step) = scan.next() {
        match step {
            Step::Message {
                channel, message, ..
            } => {
                again.add(
                    &channel,
                    scan.learnt.declared.schema_name(&channel),
                    &message,
                );
            }
            Step::Damage { offset, damage } => {
                return Err(failed(format!("at byte {offset}: {damage}")));
            }
            Step::Truncated { .. } | Step::Metadata { .. } => {}
        }
    }
    if scan.learnt.messages != messages {
        return Err(failed(format!(
            "{messages} messages written, {} read",
            scan.learnt.messages
        )));
    }
    if again.0.finalize() != digest {
        return Err(failed(
            "the messages read differ from those written".to_owned(),
        ));
    }
    Ok(())
}

impl fmt::Display for Recovery {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut f = Lines(f);
        writeln!(f, "{} -> {}", self.input.display(), self.output.display())?;
        writeln!(
            f,
            "  {} messages recovered and verified, {} of them from the truncated last chunk",
            self.messages_total, self.from_truncated_chunk
        )?;
        for (topic, n) in &self.messages {
            writeln!(f, "  {topic}  {n}")?;
        }
        for (offset, damage) in &self.damage {
            writeln!(f, "  at byte {offset}: {damage}")?;
        }
        for (topic, n) in &self.undecodable {
            writeln!(
                f,
                "  {n} messages of {topic} do not decode; copied as they are"
            )?;
        }
        for finding in &self.metadata {
            writeln!(f, "  {finding}")?;
        }
        if self.unread_bytes > 0 {
            writeln!(
                f,
                "  {} bytes from the damage on gave no message",
                self.unread_bytes
            )?;
        }
        if self.attachments_left > 0 {
            writeln!(f, "  {} attachments were not copied", self.attachments_left)?;
        }
        let verdict = match (self.was_whole, self.lossy) {
            (true, _) => "the original was whole",
            (_, false) => {
                "nothing that was in the file is lost, and its summary is made anew; what was still in memory when a writer died was never in it"
            }
            (_, true) => "something that was in the file is lost or cannot be used",
        };
        writeln!(f, "  {verdict}; the original is untouched")
    }
}
