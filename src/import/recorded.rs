//! Logs of other programs, as tables: ROS 2 and Foxglove in MCAP, ROS 2 in SQLite, ArduPilot, MAVLink, PX4.
//!
//! `message` (what a message is) <- `mcap` `db3` `dataflash` `telemetry` `ulog` (readers) -> `contents` (what there is)
//! and `columns`, `table` (what the map names, in the order of stamps). The table goes the way of every other. Damaged records
//! are passed over, counted and said; `bag` holds the files of a bag against its own account of itself.

mod bag;
mod columns;
mod contents;
mod dataflash;
mod db3;
mod head;
mod json;
mod mcap;
mod message;
pub(crate) mod order;
mod packed;
mod packed_file;
mod protobuf;
mod ros;
mod single;
mod stamps;
pub(crate) mod table;
mod telemetry;
mod ulog;
mod window;
mod yaml;

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use hydroline_rigs::bounded;

use crate::check::{Finding, FindingList};
use crate::map::Map;
use crate::source::{Source, State};
use bag::Bag;
use contents::is_topic;
pub use contents::{Contents, FieldContents, TopicContents};
pub use hydroline_log::foreign::Foreign;
use hydroline_log::foreign::{self, Content};
use message::{Account, Sink};
pub use message::{RecordedError, Unreadable};
pub(crate) use packed_file::Packing;
use packed_file::{Unpacked, unpacked_name};
pub use single::{MessageDecoder, MessageFields};

/// Name of what is broken in the file itself, in [`Unreadable::what`].
pub(crate) const DAMAGED: &str = "damaged records";

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Mcap,
    Db3,
    DataFlash,
    Telemetry,
    ULog,
}

impl Kind {
    /// Kind of a log that is read here; `None` = it may be a table.
    fn of(head: &[u8]) -> Result<Option<Kind>, RecordedError> {
        Ok(Some(match Content::of(head) {
            Content::Mcap => Kind::Mcap,
            Content::Sqlite => Kind::Db3,
            Content::DataFlash => Kind::DataFlash,
            Content::Telemetry => Kind::Telemetry,
            Content::ULog => Kind::ULog,
            Content::Other(Foreign { what, next }) => {
                return Err(RecordedError::NotRead { what, next });
            }
            Content::Text => return Ok(None),
        }))
    }

    /// Way on with a damaged log of the kind.
    fn mending(self) -> &'static str {
        match self {
            Kind::Mcap => "`hydroline recover` writes what is sound into a new file",
            Kind::Db3 => {
                "`sqlite3 FILE .recover | sqlite3 NEW.db3` writes what is sound into a new file"
            }
            Kind::DataFlash | Kind::Telemetry | Kind::ULog => {
                "fetch it anew from the vehicle or the ground station, as it was there"
            }
        }
    }

    fn words(self) -> &'static str {
        match self {
            Kind::Mcap => "MCAP",
            Kind::Db3 => "ROS 2 bag (SQLite)",
            Kind::DataFlash => "ArduPilot DataFlash log",
            Kind::Telemetry => "MAVLink telemetry log",
            Kind::ULog => "PX4 ULog",
        }
    }

    /// Whether such files are recorded as bags, with one clock for stamps and recording.
    fn is_of_bags(self) -> bool {
        matches!(self, Kind::Mcap | Kind::Db3)
    }

    fn read(self, path: &Path, sink: &mut dyn Sink) -> Result<Account, RecordedError> {
        match self {
            Kind::Mcap => mcap::read(path, sink),
            Kind::Db3 => db3::read(path, sink),
            Kind::DataFlash => dataflash::read(path, sink),
            Kind::Telemetry => telemetry::read(path, sink),
            Kind::ULog => ulog::read(path, sink),
        }
    }
}

/// A log of another program.
#[derive(Debug)]
pub struct Recording {
    files: Unpacked,
    /// Files as they were opened.
    states: Vec<State>,
    /// The same as they lie in the folder, some of them packed.
    named: Vec<PathBuf>,
    kind: Kind,
    contents: Contents,
    bag: Bag,
    topics: Vec<String>,
}

/// A file's path without the ending of a packed file.
fn unpacked_path(path: &Path) -> PathBuf {
    let name = path.file_name().and_then(|n| n.to_str()).unwrap_or("");
    path.with_file_name(unpacked_name(name))
}

/// Files of a bag's folder, packed or not, in their order: `bag_2.mcap` before `bag_10.mcap`.
fn files_of(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        let name = path.file_name().and_then(|n| n.to_str()).unwrap_or("");
        let name = unpacked_name(name);
        if name.ends_with(".mcap") || name.ends_with(".db3") {
            files.push(path);
        }
    }
    files.sort_by_key(|p| {
        let unpacked = unpacked_path(p);
        (unpacked.as_os_str().len(), unpacked, p.as_os_str().len())
    });
    // A player may have left the unpacked file beside the packed one.
    files.dedup_by_key(|p| unpacked_path(p));
    Ok(files)
}

impl Recording {
    /// Looks whether a file (or the folder of a bag) is a log that is read here; `None` = it is something else.
    ///
    /// # Errors
    /// [`RecordedError`] of a log that cannot be read.
    pub fn open(path: &Path) -> Result<Option<Recording>, RecordedError> {
        let mut bag = Bag::beside(path)?;
        let mut named = vec![path.to_owned()];
        if path.is_dir() {
            named = files_of(path)?;
            // In the order in which they were recorded; what the bag does not name comes last, as its own name has it.
            named.sort_by_key(|p| bag.place_of(p).unwrap_or(usize::MAX));
            if let (true, Some(parts)) = (named.is_empty(), bag.named()) {
                return Err(RecordedError::NoParts { parts });
            }
            for file in &named {
                let of_file =
                    |e: io::Error| io::Error::new(e.kind(), format!("{}: {e}", file.display()));
                bounded::check_file(file).map_err(of_file)?;
            }
        }
        let files = Unpacked::of(named.clone())?;
        // The first part of a bag may be damaged at its head: the next one tells the kind.
        let mut not_read = None;
        let mut kind = None;
        for file in &files.files {
            match Kind::of(&head::head(file, foreign::HEAD_BYTES)?) {
                Ok(Some(own)) => {
                    kind = Some(own);
                    break;
                }
                Ok(None) => {}
                Err(error) => not_read = not_read.or(Some(error)),
            }
        }
        let Some(kind) = kind else {
            return not_read.map_or(Ok(None), Err);
        };
        let states: Result<Vec<State>, _> = files.files.iter().map(|f| State::of(f)).collect();
        let states = states?;
        let mut gather = contents::Gather::default();
        let mut counts = Vec::new();
        let account = read(kind, &named, &files.files, &mut gather, &mut counts)?;
        for (file, counts) in named.iter().zip(counts) {
            bag.add(file, counts);
        }
        let mut contents = gather.finish(kind.words(), account);
        if kind.is_of_bags() {
            let said = bag.findings(None).into_iter();
            contents.bag = said.map(|f| f.message).collect();
        }
        if contents.topics.iter().all(|t| t.fields.is_empty()) && contents.messages > 0 {
            let reasons: Vec<String> = contents
                .unreadable
                .iter()
                .take(3)
                .map(|u| format!("{}: {}", u.what, u.reason))
                .collect();
            if !reasons.is_empty() {
                return Err(RecordedError::Nothing {
                    messages: contents.messages,
                    reasons: reasons.join("; "),
                });
            }
        }
        Ok(Some(Recording {
            files,
            states,
            named,
            kind,
            contents,
            bag,
            topics: Vec::new(),
        }))
    }

    /// Only these topics: what a map names without its topic is looked for in them alone, and a map is guessed of them.
    ///
    /// # Errors
    /// [`RecordedError::Topic`].
    pub fn with_topics(mut self, topics: &[String]) -> Result<Recording, RecordedError> {
        for topic in topics {
            // A name without its instance stands for all of them.
            let is_there = |t: &TopicContents| is_topic(&t.topic, topic);
            if !self.contents.topics.iter().any(is_there) {
                return Err(RecordedError::Topic {
                    topic: topic.clone(),
                    others: self.contents.nameable(),
                });
            }
        }
        topics.clone_into(&mut self.topics);
        Ok(self)
    }

    /// Topics, fields and damage of the log.
    pub fn contents(&self) -> &Contents {
        &self.contents
    }

    /// Topics that were chosen, or all.
    pub(crate) fn is_chosen(&self, topic: &str) -> bool {
        self.topics.is_empty() || self.topics.iter().any(|t| is_topic(topic, t))
    }

    /// Whether recording and stamps are of one clock.
    pub(crate) fn one_clock(&self) -> bool {
        self.kind.is_of_bags()
    }

    /// The fields that a map names, as a table, and the map for it.
    ///
    /// # Errors
    /// Those of the files.
    pub fn table(&self, map: &Map) -> Result<RecordedTable, RecordedError> {
        if let (true, Some(damage)) = (self.contents.topics.is_empty(), self.damage()) {
            let damage = damage.message.split("; ").next().unwrap_or_default();
            return Err(RecordedError::Damaged {
                damage: damage.to_owned(),
                next: self.kind.mending(),
            });
        }
        let mut wrong = Vec::new();
        let chosen = |topic: &str| self.is_chosen(topic);
        let columns = columns::Columns::of(map, &self.contents, &chosen, &mut wrong);
        let own = columns.map_for_table(map);
        let mut scratch = tempfile::tempfile()?;
        let places = columns.topics();
        let several = places.len() > 1;
        let topics = &self.contents.topics;
        let mapped: Vec<String> = places.iter().map(|p| topics[*p].topic.clone()).collect();
        let mut writer = table::Writer::new(columns, topics, self.one_clock(), &mut scratch)?;
        let account = self.read(&mut writer)?;
        self.states.iter().try_for_each(State::unchanged)?;
        let (rows, found) = writer.finish()?;
        // The cause comes before what follows from it.
        let mut findings: Vec<Finding> = self.damage().into_iter().collect();
        if self.kind.is_of_bags() {
            findings.extend(self.bag.findings(Some(&mapped)));
        }
        self.unreadable(&account, &mapped, &mut findings);
        findings.extend(wrong);
        findings.extend(found);
        let of = if several { ", one for each stamp" } else { "" };
        findings.info(
            "recorded",
            format!(
                "{}: read as a table of {rows} rows{of}; line n of a finding is its row n - 1, in the order of stamps",
                self.contents.kind,
            ),
        );
        Ok(RecordedTable {
            scratch,
            map: own,
            findings,
        })
    }

    fn read(&self, sink: &mut dyn Sink) -> Result<Account, RecordedError> {
        let mut counts = Vec::new();
        read(self.kind, &self.named, &self.files.files, sink, &mut counts)
    }

    /// Damaged records of the log.
    fn damage(&self) -> Option<Finding> {
        let mut unreadable = self.contents.unreadable.iter();
        let own = unreadable.find(|u| u.what == DAMAGED)?;
        let bytes = match self.contents.skipped_bytes {
            0 => String::new(),
            n => format!("; {n} bytes belong to no record"),
        };
        Some(Finding::fault(
            "damaged_records",
            None,
            format!(
                "{}{bytes}; import what is sound with --accept-faults, or first: {}",
                not_read(own),
                self.kind.mending()
            ),
        ))
    }

    /// Messages that were not read: a loss in topics that are mapped counts as one, in topics that nobody asked for it does not.
    /// `account` = of the pass that read the mapped topics.
    fn unreadable(&self, account: &Account, mapped: &[String], findings: &mut Vec<Finding>) {
        let is_mapped = |u: &Unreadable| {
            let own = u.topic.as_ref();
            own.is_some_and(|t| mapped.iter().any(|m| is_topic(m, t)))
        };
        for u in account.unreadable.iter().filter(|u| is_mapped(u)) {
            let topic = u.topic.as_deref().unwrap_or_default();
            let all = account.messages.get(topic).copied().unwrap_or(u.count);
            findings.fault(
                "not_decoded",
                format!(
                    "{topic}: {} of {all} messages cannot be decoded and are lost, the first at {}: {}; mend what writes them, or import the rest with --accept-faults",
                    u.count, u.first_at, u.reason
                ),
            );
        }
        for u in &self.contents.unreadable {
            if u.what.starts_with("images of ") {
                let way = "nothing is imported of images; `hydroline replay` leaves these out and counts them";
                findings.warning("damaged_images", format!("{}; {way}", not_read(u)));
            } else if u.what.starts_with("gaps") {
                findings.warning("dropouts", not_read(u));
            } else if u.what != DAMAGED && !is_mapped(u) {
                findings.info("not_decoded", not_read(u));
            }
        }
    }
}

fn not_read(u: &Unreadable) -> String {
    format!(
        "{}: {} not read, the first at {}: {}",
        u.what, u.count, u.first_at, u.reason
    )
}

/// Reads files one after the other; `counts` = messages of each topic in each of them. Of several, one that is no log at all is
/// damage. `named` = the same files by the names that people know.
fn read(
    kind: Kind,
    named: &[PathBuf],
    files: &[PathBuf],
    sink: &mut dyn Sink,
    counts: &mut Vec<HashMap<String, u64>>,
) -> Result<Account, RecordedError> {
    let mut all = Account::default();
    for (file, name) in files.iter().zip(named) {
        let name = name.file_name().unwrap_or_default().to_string_lossy();
        let mut account = match kind.read(file, sink) {
            Err(RecordedError::Container(words)) if files.len() > 1 => {
                let mut none = Account::default();
                none.note(DAMAGED, 0, || format!("nothing of it can be read: {words}"));
                none
            }
            other => other?,
        };
        all.skipped_bytes += account.skipped_bytes;
        for (topic, count) in &account.messages {
            *all.messages.entry(topic.clone()).or_default() += count;
        }
        counts.push(std::mem::take(&mut account.messages));
        for mut u in account.unreadable {
            match all.unreadable.iter_mut().find(|a| a.what == u.what) {
                Some(a) => a.count += u.count,
                None => {
                    if files.len() > 1 {
                        u.reason = format!("{name}: {}", u.reason);
                    }
                    all.unreadable.push(u);
                }
            }
        }
    }
    Ok(all)
}

/// Fields of a log as a table, in a scratch file that goes with it.
#[derive(Debug)]
pub struct RecordedTable {
    scratch: File,
    /// For this table.
    pub map: Map,
    /// About the log and what the map names in it.
    pub findings: Vec<Finding>,
}

impl Source for RecordedTable {
    fn open(&self) -> io::Result<Box<dyn Read + '_>> {
        let mut copy = self.scratch.try_clone()?;
        copy.seek(SeekFrom::Start(0))?;
        Ok(Box::new(copy))
    }
}

#[cfg(test)]
mod tests;
