//! Content of a file that may be no log of ours, known by its first bytes: what it is, and the way from it to a log.
//!
//! `signatures` (containers and formats that begin with fixed bytes) -> `text` (formats that are text) -> `records` (autopilots'
//! records, wherever the first of them stands) -> a log's beginning behind other bytes -> bytes that are no text. What is left is
//! text, perhaps a table. Names of files say nothing: they are given by people. `dataflash` and `mavlink` hold the parts of those
//! formats that reading them needs too.

pub mod dataflash;
pub mod mavlink;
mod records;
mod signatures;
mod text;

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::LogError;
pub use records::{dataflash_at, telemetry_at};
pub use text::CONTROL_SEPARATORS;

/// Bytes from a file's beginning in which its kind is looked for.
pub const HEAD_BYTES: u64 = 1 << 16;

/// Way to a log from what `import` reads.
const IMPORT: &str = "make a log of it: `hydroline import --guess FILE > MAP.toml`, then `hydroline import FILE --map MAP.toml --out LOG.mcap`";

/// A file of another kind.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Foreign {
    /// Kind of file with its article: `an encrypted PX4 ULog (.ulge)`.
    pub what: String,
    /// Way to a log: what to export, or how to unpack it.
    pub next: String,
}

impl Foreign {
    fn new(what: impl Into<String>, next: impl Into<String>) -> Foreign {
        Foreign {
            what: what.into(),
            next: next.into(),
        }
    }
}

/// Content of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Content {
    /// MCAP, ours or anyone's.
    Mcap,
    /// A database of SQLite, as bags of ROS 2 are.
    Sqlite,
    /// ArduPilot's binary log; other bytes may stand before its first format.
    DataFlash,
    /// MAVLink with stamps; other bytes may stand before its first packet.
    Telemetry,
    /// PX4's log.
    ULog,
    /// Something that is read nowhere here.
    Other(Foreign),
    /// Text that may be a table, or nothing at all.
    Text,
}

/// A kind of log that is read from its first byte on.
struct Magic {
    bytes: &'static [u8],
    /// The same as `printf` takes them.
    printed: &'static str,
    content: Content,
    what: &'static str,
}

static MAGICS: [Magic; 3] = [
    Magic {
        bytes: b"\x89MCAP0\r\n",
        printed: "\\211MCAP0\\r\\n",
        content: Content::Mcap,
        what: "an MCAP file",
    },
    Magic {
        bytes: b"SQLite format 3\0",
        printed: "SQLite format 3\\000",
        content: Content::Sqlite,
        what: "a database of SQLite (.db3)",
    },
    Magic {
        bytes: b"ULog\x01\x12\x35",
        printed: "ULog\\001\\0225",
        content: Content::ULog,
        what: "a PX4 ULog",
    },
];

/// First bytes that may differ before nobody would know a kind by them.
const DAMAGED_MAX: usize = 2;

impl Content {
    /// Content of a file that begins with these bytes ([`HEAD_BYTES`] of them, or all that there are).
    pub fn of(head: &[u8]) -> Content {
        if let Some(magic) = MAGICS.iter().find(|m| head.starts_with(m.bytes)) {
            return magic.content.clone();
        }
        let is_text = text::is_text(head);
        let of_bytes = || damaged_magic(head).filter(|_| !is_text);
        if let Some(other) = signatures::find(head, is_text).or_else(of_bytes) {
            return Content::Other(other);
        }
        if is_text && let Some(other) = text::find(head) {
            return Content::Other(other);
        }
        if records::dataflash_at(head).is_some() {
            return Content::DataFlash;
        }
        if records::telemetry_at(head).is_some() {
            return Content::Telemetry;
        }
        if let Some(other) = behind_other_bytes(head).or_else(|| records::incomplete(head)) {
            return Content::Other(other);
        }
        if is_text {
            return Content::Text;
        }
        Content::Other(Foreign::new(
            "a binary file of no kind that is known here",
            "export a table of text (CSV) with the program that wrote it, one row per sample, and `hydroline import` that",
        ))
    }

    /// Kind and way on, where a log of ours was expected; `None` = it may be one, or is text.
    pub fn foreign(self) -> Option<Foreign> {
        let what = match self {
            Content::Mcap | Content::Text => return None,
            Content::Other(own) => return Some(own),
            Content::Sqlite => "a database of SQLite, as bags of ROS 2 are (.db3)",
            Content::DataFlash => "an ArduPilot DataFlash log (.bin)",
            Content::Telemetry => "a MAVLink telemetry log (.tlog)",
            Content::ULog => "a PX4 ULog (.ulg)",
        };
        Some(Foreign::new(what, IMPORT))
    }

    /// Kind and way on, where a table was expected; `None` = it may be one. A log that is a file is known before, so that an MCAP file
    /// that is met here came as a stream.
    pub fn no_table(self) -> Option<Foreign> {
        match self {
            Content::Mcap => Some(Foreign::new(
                "an MCAP file that comes as a stream",
                "a log is read more than once: write it to a file and name that, packed (gzip, zstd) or not",
            )),
            other => other.foreign(),
        }
    }
}

/// A log some of whose first bytes are damaged.
fn damaged_magic(head: &[u8]) -> Option<Foreign> {
    MAGICS.iter().find_map(|magic| {
        let own = head.get(..magic.bytes.len())?;
        let damaged = own.iter().zip(magic.bytes).filter(|(a, b)| a != b).count();
        (damaged <= DAMAGED_MAX).then(|| {
            Foreign::new(
                format!(
                    "{} of whose first {} bytes {damaged} are damaged",
                    magic.what,
                    magic.bytes.len()
                ),
                format!(
                    "write them anew in a copy: `cp FILE NEW && printf '{}' | dd of=NEW conv=notrunc`, and name the copy",
                    magic.printed
                ),
            )
        })
    })
}

/// A log's first bytes that stand further in: the rest is a log, once what stands before it is gone.
fn behind_other_bytes(head: &[u8]) -> Option<Foreign> {
    let at = |magic: &[u8]| head.windows(magic.len()).position(|w| w == magic);
    let found = MAGICS.iter().filter_map(|m| Some((at(m.bytes)?, m.what)));
    let (bytes, what) = found.min()?;
    Some(Foreign::new(
        format!("{what} behind {bytes} bytes of something else"),
        format!(
            "take them away: `tail -c +{} FILE > NEW`, and name the new file",
            bytes + 1
        ),
    ))
}

/// The first bytes of a file; none of what cannot be read twice, or not at all.
fn head(path: &Path) -> Option<Vec<u8>> {
    if !path.metadata().ok()?.is_file() {
        return None;
    }
    let mut head = Vec::new();
    let file = File::open(path).ok()?;
    file.take(HEAD_BYTES).read_to_end(&mut head).ok()?;
    Some(head)
}

/// The error of a file that is no MCAP file with its kind and the way on, where they are known; other errors as they are.
pub(super) fn named(path: &Path, error: LogError) -> LogError {
    let is_other = matches!(error, LogError::NotMcap { .. });
    let kind = head(path)
        .filter(|_| is_other)
        .and_then(|head| Content::of(&head).foreign());
    match kind {
        Some(Foreign { what, next }) => LogError::Foreign {
            path: path.to_owned(),
            what,
            next,
        },
        None => error,
    }
}

#[cfg(test)]
mod tests;
