//! The log: MCAP files as reference/interfaces.md names them, written so that a crash, a slow disk or a
//! full one costs as little as possible, and read so that no damaged byte goes unnoticed.
//!
//! ```text
//! Recorder (any thread) -> queue (bytes) -> writer thread -> LogWriter -> PartFile -> LogSink
//! FileRecorder (simulate, replay) ------------------------> LogWriter
//! LogReader <- records (checked, record by record) <- file
//! ```
//!
//! Stripe points carry `quality` bits: 1 saturated, 2 haze corrected, 4 second candidate, 8 near step.
//!
//! ```
//! use hydroline_log::messages::pb::ClockPair;
//! use hydroline_log::{Entry, FileRecorder, Head, LogReader, SummaryInput, WriteSettings};
//!
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("run.mcap");
//! let head = Head { rig_toml: "# a rig".to_owned(), ..Head::default() };
//! let mut log = FileRecorder::create(&path, false, head, WriteSettings::offline(None))?;
//! log.write(1_000, &Entry::clock(&ClockPair { realtime_ns: 1_000, ..ClockPair::default() }))?;
//! assert!(!log.finish(&SummaryInput::clean("done"))?.lost);
//! assert_eq!(LogReader::open(&path)?.rig_toml(), Some("# a rig"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

use std::path::PathBuf;

mod atomic_file;
mod closing;
pub mod doctor;
mod entry;
mod expansion;
pub mod export;
mod file_recorder;
pub mod foreign;
pub mod held;
mod image_topics;
mod indexed;
pub mod info;
mod loss_account;
pub mod messages;
mod output;
mod part;
pub mod policy;
pub mod queue;
mod raw;
mod reader;
mod recorder;
mod records;
pub mod recover;
mod scan;
mod seal;
mod settings;
mod space;
mod time;
mod topic;
pub mod trace;
mod writer;

pub use atomic_file::AtomicFile;
pub use closing::Closing;
pub use entry::{Company, Entry};
pub use expansion::FRAME_BYTES_KEY;
pub use file_recorder::FileRecorder;
pub use image_topics::{
    ImageTopic, ImageTopicError, holds_packed_images, image_damage, image_topic,
};
pub use indexed::{ChannelEntry, IndexedLog, Place, PlainMessage};
pub use loss_account::{Counts, FrameLedger, LogOutcome, Misplaced, SummaryInput};
pub use output::{FileOutput, LogOutput, NameLost, free_bytes};
pub use part::{Encoding, MetadataMap};
pub use policy::Limits;
pub use raw::{RawMessage, RawReader, RawSchema};
pub use reader::{LogMessage, LogReader, Record};
pub use recorder::{Recorder, WeakRecorder};
pub use records::{EXPANSION_MAX, LIMIT_BYTES};
pub use seal::{DAMAGED_KEY, SealFinding, SealState};
pub use settings::{FileParts, Head, PartOpener, WriteSettings, check_space};
pub use space::{bytes_per_frame, bytes_per_s, writable_folder};
pub use time::LogTime;
pub use topic::{SchemaText, Topic, published_schema};
pub use writer::LogWriter;

/// Error in reading or writing a log.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum LogError {
    #[error(
        "part {part} of the log exists already ({reason}): choose another --out or move the old file"
    )]
    Exists {
        /// Part number, 0 = the first.
        part: u32,
        reason: String,
    },
    #[error(
        "part {part} of the log cannot be created: {source}; check that the directory exists and is writable"
    )]
    Create { part: u32, source: std::io::Error },
    #[error("{}: the log's head cannot be written: {reason}", path.display())]
    Write { path: PathBuf, reason: String },
    #[error(
        "{}: the planned {planned_s:.0} s x {megabytes_per_s:.1} MB/s = {needed_megabytes:.0} MB, plus {min_free_megabytes:.0} MB \
         to stay free, do not fit into the {free_megabytes:.0} MB that are free; {fits_s:.0} s would fit: \
         free some space, record less, or log to another disk",
        path.display()
    )]
    WontFit {
        path: PathBuf,
        planned_s: f64,
        megabytes_per_s: f64,
        needed_megabytes: f64,
        min_free_megabytes: f64,
        free_megabytes: f64,
        fits_s: f64,
    },
    #[error("the log stopped: {reason}; what was written is readable")]
    Stopped { reason: String },
    #[error("the log's writer thread cannot be started: {source}")]
    Thread { source: std::io::Error },
    #[error(
        "a message of {bytes} bytes on {topic}: at most {most} are written, the largest frame that a log holds; take smaller images"
    )]
    TooLarge {
        topic: &'static str,
        bytes: u64,
        most: u64,
    },
    #[error("the recording is finished already")]
    Finished,
    #[error("the log's writer thread panicked; `hydroline recover` mends the file")]
    WriterPanicked,
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        path: PathBuf,
        source: std::io::Error,
    },
    #[error("{}: is empty (0 bytes): nothing was recorded, or the recording was killed before its head was on the disk", path.display())]
    Empty { path: PathBuf },
    #[error("{}: not an MCAP file: it begins with {found:02x?}, not with 89 4D 43 41 50 30 0D 0A", path.display())]
    NotMcap { path: PathBuf, found: Vec<u8> },
    #[error("{}: it is {what}, no log of hydroline; {next}", path.display())]
    Foreign {
        path: PathBuf,
        what: String,
        /// Way to a log.
        next: String,
    },
    #[error("{}: at byte {offset}: {damage}; `hydroline recover` writes what is sound into a new file", path.display())]
    Damaged {
        path: PathBuf,
        offset: u64,
        damage: records::Damage,
    },
    #[error("{}: exists already, and nothing is overwritten: choose another --out or move it away", path.display())]
    OutputExists { path: PathBuf },
    #[error("{}: is being written by another process: wait until it has ended, or choose another --out", path.display())]
    BeingWritten { path: PathBuf },
    #[error("{}: holds files already ({found}); an export goes into an empty or a new folder, so that old and new never mix: name another --out", path.display())]
    NotEmpty { path: PathBuf, found: String },
    #[error("{}: cannot be written: {reason}", path.display())]
    Output { path: PathBuf, reason: String },
    #[error("{}: the recovered file does not read back ({reason}) and was removed; the original is untouched", path.display())]
    Verify { path: PathBuf, reason: String },
    #[error("{}: at byte {offset}: a message of {topic} ({schema}) does not decode: {reason}", path.display())]
    Message {
        path: PathBuf,
        /// Offset of the record (of its chunk, when it is in one).
        offset: u64,
        topic: String,
        schema: String,
        reason: String,
    },
}

impl LogError {
    /// Maps the system's words on reading `path`.
    fn read(path: &std::path::Path) -> impl Fn(std::io::Error) -> Self {
        move |source| LogError::Read {
            path: path.to_owned(),
            source,
        }
    }

    /// Maps whatever kept `path` from being written.
    fn output<E: std::fmt::Display>(path: &std::path::Path) -> impl Fn(E) -> Self {
        move |e| LogError::Output {
            path: path.to_owned(),
            reason: e.to_string(),
        }
    }

    /// Damage in `path`, at its place.
    fn damaged(path: &std::path::Path, (offset, damage): records::Located) -> Self {
        LogError::Damaged {
            path: path.to_owned(),
            offset,
            damage,
        }
    }

    /// For a file that begins with `found` instead of the magic.
    fn no_log(path: &std::path::Path, found: Vec<u8>) -> Self {
        let path = path.to_owned();
        if found.is_empty() {
            LogError::Empty { path }
        } else {
            LogError::NotMcap { path, found }
        }
    }

    /// Everything that is in the file is sound, only its end is missing: a tool that can do with
    /// a part may go on with what it has read.
    pub fn is_missing_end(&self) -> bool {
        matches!(self, LogError::Damaged { damage, .. } if damage.is_missing_end())
    }
}

pub use records::Damage;

#[cfg(test)]
mod tests;
