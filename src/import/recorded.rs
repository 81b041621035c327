//! Logs of other programs, as tables: ROS 2 and Foxglove in MCAP, ROS 2 in SQLite, ArduPilot, MAVLink, PX4.
//!
//! `message` (what a message is) <- `mcap` `db3` `dataflash` `telemetry` `ulog` (readers) -> `contents` (what there is)
//! and `columns`, `table` (what the map names, in the order of stamps). The table goes the way of every other. Damaged records
//! are passed over, counted and said.

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
mod stamps;
pub(crate) mod table;
mod telemetry;
mod ulog;
mod window;

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use hydroline_rigs::bounded;

use crate::check::{Finding, FindingList};
use crate::map::Map;
use crate::source::{Source, State};
pub use contents::{Contents, FieldContents, TopicContents};
pub use hydroline_log::foreign::Foreign;
use hydroline_log::foreign::{self, Content};
use message::{Account, Sink};
pub use message::{RecordedError, Unreadable};
pub(crate) use packed_file::Packing;
use packed_file::Unpacked;

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
    kind: Kind,
    contents: Contents,
    topics: Vec<String>,
}

/// Files of a bag's folder in their order: `bag_2.mcap` before `bag_10.mcap`.
fn files_of(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        let name = path.file_name().and_then(|n| n.to_str()).unwrap_or("");
        // Packed or not.
        let name = name.strip_suffix(".zstd").unwrap_or(name);
        if name.ends_with(".mcap") || name.ends_with(".db3") {
            files.push(path);
        }
    }
    // A player may have left the unpacked file beside the packed one.
    let all = files.clone();
    files.retain(|p| {
        p.extension().is_none_or(|e| e != "zstd") || !all.contains(&p.with_extension(""))
    });
    files.sort_by_key(|p| (p.as_os_str().len(), p.clone()));
    Ok(files)
}

impl Recording {
    /// Looks whether a file (or the folder of a bag) is a log that is read here; `None` = it is something else.
    ///
    /// # Errors
    /// [`RecordedError`] of a log that cannot be read.
    pub fn open(path: &Path) -> Result<Option<Recording>, RecordedError> {
        let files = if path.is_dir() {
            let files = files_of(path)?;
            for file in &files {
                let named =
                    |e: io::Error| io::Error::new(e.kind(), format!("{}: {e}", file.display()));
                bounded::check_file(file).map_err(named)?;
            }
            files
        } else {
            vec![path.to_owned()]
        };
        let files = Unpacked::of(files)?;
        let Some(first) = files.files.first() else {
            return Ok(None);
        };
        let head = head::head(first, foreign::HEAD_BYTES)?;
        let Some(kind) = Kind::of(&head)? else {
            return Ok(None);
        };
        let states: Result<Vec<State>, _> = files.files.iter().map(|f| State::of(f)).collect();
        let states = states?;
        let mut gather = contents::Gather::default();
        let account = read(kind, &files.files, &mut gather)?;
        let contents = gather.finish(kind.words(), account);
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
            kind,
            contents,
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
                let all: Vec<&str> = self
                    .contents
                    .topics
                    .iter()
                    .filter(|t| !t.fields.is_empty())
                    .map(|t| t.topic.as_str())
                    .collect();
                return Err(RecordedError::Topic {
                    topic: topic.clone(),
                    topics: all.join(" "),
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
        matches!(self.kind, Kind::Mcap | Kind::Db3)
    }

    /// The fields that a map names, as a table, and the map for it.
    ///
    /// # Errors
    /// Those of the files.
    pub fn table(&self, map: &Map) -> Result<RecordedTable, RecordedError> {
        let mut findings = Vec::new();
        // The cause comes before what follows from it.
        self.damage(&mut findings);
        if self.contents.topics.is_empty()
            && let Some(cause) = findings.first()
        {
            let damage = cause.message.split("; ").next().unwrap_or_default();
            return Err(RecordedError::Damaged {
                damage: damage.to_owned(),
                next: self.kind.mending(),
            });
        }
        let chosen = |topic: &str| self.is_chosen(topic);
        let columns = columns::Columns::of(map, &self.contents, &chosen, &mut findings);
        let own = columns.map_for_table(map);
        let mut scratch = tempfile::tempfile()?;
        let several = columns.topics().len() > 1;
        let mut writer = table::Writer::new(
            columns,
            &self.contents.topics,
            self.one_clock(),
            &mut scratch,
        )?;
        read(self.kind, &self.files.files, &mut writer)?;
        self.states.iter().try_for_each(State::unchanged)?;
        let (rows, found) = writer.finish()?;
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

    fn damage(&self, findings: &mut Vec<Finding>) {
        for u in &self.contents.unreadable {
            let words = format!(
                "{}: {} not read, the first at {}: {}",
                u.what, u.count, u.first_at, u.reason
            );
            // A loss in topics that are mapped counts as one; a loss in topics that nobody asked for does not.
            findings.push(if u.what == "damaged records" {
                let bytes = match self.contents.skipped_bytes {
                    0 => String::new(),
                    n => format!("; {n} bytes belong to no record"),
                };
                Finding::fault(
                    "damaged_records",
                    None,
                    format!("{words}{bytes}; import what is sound with --accept-faults"),
                )
            } else if u.what.starts_with("images of ") {
                let way = "nothing is imported of images; `hydroline replay` leaves these out and counts them";
                Finding::warning("damaged_images", None, format!("{words}; {way}"))
            } else if u.what.starts_with("gaps") {
                Finding::warning("dropouts", None, words)
            } else {
                Finding::info("not_decoded", words)
            });
        }
    }
}

/// Whether a topic is the one named, or an instance of it.
fn is_topic(topic: &str, named: &str) -> bool {
    topic
        .strip_prefix(named)
        .is_some_and(|rest| rest.is_empty() || rest.starts_with('['))
}

fn read(kind: Kind, files: &[PathBuf], sink: &mut dyn Sink) -> Result<Account, RecordedError> {
    let mut all = Account::default();
    for file in files {
        let account = kind.read(file, sink)?;
        all.skipped_bytes += account.skipped_bytes;
        for u in account.unreadable {
            match all.unreadable.iter_mut().find(|a| a.what == u.what) {
                Some(a) => a.count += u.count,
                None => all.unreadable.push(u),
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
