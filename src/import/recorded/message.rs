//! A message of any log, as numbers with the paths of their fields.

use std::collections::HashMap;
use std::io;
use std::ops::Range;

use super::DAMAGED;

/// Numbers and texts that are kept of one message: images and clouds are no motion.
const LEAVES_MAX: usize = 4096;
/// Elements of one array that are kept.
pub(super) const ELEMENTS_MAX: usize = 256;
/// Of a text.
const TEXT_BYTES: usize = 64;

/// A number as exact as the log has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Number {
    Int(i64),
    UInt(u64),
    Float(f64),
}

impl Number {
    pub fn whole(self) -> Option<i128> {
        match self {
            Number::Int(v) => Some(v.into()),
            Number::UInt(v) => Some(v.into()),
            Number::Float(_) => None,
        }
    }

    /// The nearest double.
    pub fn as_f64(self) -> f64 {
        match self {
            Number::Int(v) => v as f64,
            Number::UInt(v) => v as f64,
            Number::Float(v) => v,
        }
    }

    pub fn is_finite(self) -> bool {
        match self {
            Number::Float(v) => v.is_finite(),
            _ => true,
        }
    }
}

/// As a table's cell: the shortest text that reads back as the same number.
impl std::fmt::Display for Number {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Number::Int(v) => write!(f, "{v}"),
            Number::UInt(v) => write!(f, "{v}"),
            Number::Float(v) => write!(f, "{v:?}"),
        }
    }
}

#[derive(Debug, Clone, PartialEq)]
enum Held {
    Number(Number),
    Text(Range<usize>),
}

/// The fields of one message; keeps its buffers between messages.
#[derive(Debug, Default)]
pub(super) struct Leaves {
    /// Paths and texts, one after the other.
    arena: String,
    items: Vec<(Range<usize>, Held)>,
    path: String,
}

impl Leaves {
    pub fn clear(&mut self) {
        self.arena.clear();
        self.items.clear();
        self.path.clear();
    }

    /// Goes into a field; what is returned leads out again.
    pub fn enter(&mut self, name: &str) -> usize {
        let before = self.path.len();
        if before > 0 {
            self.path.push('.');
        }
        self.path.push_str(name);
        before
    }

    /// Goes into an element.
    pub fn enter_element(&mut self, index: usize) -> usize {
        use std::fmt::Write;
        let before = self.path.len();
        // A String takes everything.
        let _ = write!(self.path, "[{index}]");
        before
    }

    pub fn leave(&mut self, before: usize) {
        self.path.truncate(before);
    }

    /// Whether more fields would not be kept.
    pub fn is_full(&self) -> bool {
        self.items.len() >= LEAVES_MAX
    }

    fn push(&mut self, held: Held) {
        if !self.is_full() {
            let start = self.arena.len();
            self.arena.push_str(&self.path);
            self.items.push((start..self.arena.len(), held));
        }
    }

    pub fn number(&mut self, value: Number) {
        self.push(Held::Number(value));
    }

    pub fn text(&mut self, text: &str) {
        if self.is_full() {
            return;
        }
        let start = self.arena.len();
        let mut bytes = 0;
        for c in text.chars() {
            bytes += c.len_utf8();
            if bytes > TEXT_BYTES {
                break;
            }
            self.arena.push(c);
        }
        self.push(Held::Text(start..self.arena.len()));
    }

    /// A number under a name below the present path.
    pub fn named(&mut self, name: &str, value: Number) {
        let before = self.enter(name);
        self.number(value);
        self.leave(before);
    }

    /// All numbers with their paths.
    pub fn numbers(&self) -> impl Iterator<Item = (&str, Number)> {
        self.items.iter().filter_map(|(path, held)| match held {
            Held::Number(n) => Some((&self.arena[path.clone()], *n)),
            Held::Text(_) => None,
        })
    }

    /// All texts with their paths.
    pub fn texts(&self) -> impl Iterator<Item = (&str, &str)> {
        self.items.iter().filter_map(|(path, held)| match held {
            Held::Text(t) => Some((&self.arena[path.clone()], &self.arena[t.clone()])),
            Held::Number(_) => None,
        })
    }

    pub fn get(&self, path: &str) -> Option<Number> {
        self.numbers().find(|n| n.0 == path).map(|n| n.1)
    }

    pub fn get_text(&self, path: &str) -> Option<&str> {
        self.texts().find(|t| t.0 == path).map(|t| t.1)
    }
}

pub(super) struct Message<'a> {
    /// Topic; several senders or bodies under one name are distinguished by what stands in brackets.
    pub topic: &'a str,
    /// The kind of message.
    pub schema: &'a str,
    /// When it was recorded \[ns\], where the log says so.
    pub log_ns: Option<i128>,
    /// When it was true, by its own stamp \[ns\].
    pub stamp_ns: Option<i128>,
    pub leaves: &'a Leaves,
    /// Units of its fields, where the log states them.
    pub unit: &'a dyn Fn(&str) -> Option<String>,
}

/// A receiver of messages.
pub(super) trait Sink {
    /// Whether a message of so many bytes is to be decoded.
    fn wants(&mut self, topic: &str, schema: &str, bytes: usize) -> bool;
    /// A message that was wanted.
    fn message(&mut self, message: &Message<'_>) -> io::Result<()>;
    /// Whether images are held against damage: once for a log is enough.
    fn checks_images(&self) -> bool {
        false
    }
    /// One that was not, or could not be decoded.
    fn other(&mut self, topic: &str, schema: &str, log_ns: Option<i128>);
}

/// Part of a log that could not be read: how often, the first place, and why.
#[derive(Debug, Clone, PartialEq, Eq, Default, serde::Serialize, schemars::JsonSchema)]
pub struct Unreadable {
    /// Damaged records, or messages of a topic.
    pub what: String,
    /// The topic, where they are messages of one that cannot be decoded; of transforms that of their list.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub topic: Option<String>,
    /// Number of them.
    pub count: u64,
    /// Byte of the file at which the first stands; of a database, the row.
    pub first_at: u64,
    /// Reason why the first could not be read.
    pub reason: String,
}

/// All of it.
#[derive(Debug, Default)]
pub(super) struct Account {
    pub unreadable: Vec<Unreadable>,
    /// Bytes between records that belong to none.
    pub skipped_bytes: u64,
    /// Messages of each topic, decoded or not: of bags, whose own account they are held against.
    pub messages: HashMap<String, u64>,
}

/// Kinds of messages that are distinguished; what is broken in the file itself always is.
const KINDS_MAX: usize = 200;
/// Name of all others together.
const FURTHER: &str = "messages of further kinds";

impl Account {
    pub fn note(&mut self, what: &str, at: u64, reason: impl FnOnce() -> String) {
        self.add(what, None, at, reason);
    }

    /// Counts a message that is there and cannot be decoded.
    pub fn undecoded(&mut self, topic: &str, at: u64, reason: impl FnOnce() -> String) {
        self.add(&format!("messages of {topic}"), Some(topic), at, reason);
    }

    /// Counts a message, whether it can be decoded or not.
    pub fn count(&mut self, topic: &str) {
        match self.messages.get_mut(topic) {
            Some(count) => *count += 1,
            None => {
                self.messages.insert(topic.to_owned(), 1);
            }
        }
    }

    fn add(&mut self, what: &str, topic: Option<&str>, at: u64, reason: impl FnOnce() -> String) {
        let is_known = self.unreadable.iter().any(|u| u.what == what);
        let is_distinguished = is_known || what == DAMAGED || self.unreadable.len() < KINDS_MAX;
        let (what, topic) = match is_distinguished {
            true => (what, topic),
            false => (FURTHER, None),
        };
        if let Some(u) = self.unreadable.iter_mut().find(|u| u.what == what) {
            u.count += 1;
        } else {
            self.unreadable.push(Unreadable {
                what: what.to_owned(),
                topic: topic.map(str::to_owned),
                count: 1,
                first_at: at,
                reason: reason(),
            });
        }
    }
}

/// Reason why a log cannot be used.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum RecordedError {
    #[error("{0}")]
    Io(#[from] io::Error),
    #[error("{0}")]
    Container(String),
    #[error("it is a log of hydroline already: nothing to import; use it as it is")]
    Ours,
    #[error("it is {what}, which is not read; {next}")]
    NotRead {
        what: String,
        /// Way to a log that is read.
        next: String,
    },
    #[error(
        "its incompatible flags are {flags:#x}, of which {known:#x} are known here: a later PX4 wrote it, and its records may mean something else; write it as tables with a reader that knows them (`pip install -U pyulog`, then `ulog2csv FILE`) and import those"
    )]
    Flags { flags: u64, known: u64 },
    #[error(
        "none of its {messages} message(s) can be read ({reasons}); check that it is the file meant, and whole"
    )]
    Nothing { messages: u64, reasons: String },
    #[error("no message of it can be read; {damage}; {next}")]
    Damaged {
        damage: String,
        /// Way on, by the kind of log.
        next: &'static str,
    },
    #[error("no topic '{topic}' in it; {others}")]
    Topic {
        topic: String,
        /// Names to choose from, or that there are none.
        others: String,
    },
    #[error(
        "its metadata.yaml names {parts}, and no such file is in the folder; copy the bag's files into it, or name one of them"
    )]
    NoParts { parts: String },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn damage_behind_two_hundred_kinds_of_messages_was_dropped() {
        let mut account = Account::default();
        for n in 0..KINDS_MAX + 50 {
            account.note(&format!("messages of MAVLink number {n}"), 7, String::new);
        }
        account.note(DAMAGED, 900, || "a checksum".to_owned());
        account.note(DAMAGED, 950, String::new);
        account.note("messages of MAVLink number 3", 960, String::new);
        let of = |what: &str| account.unreadable.iter().find(|u| u.what == what).unwrap();
        let damage = of(DAMAGED);
        assert_eq!((damage.count, damage.first_at), (2, 900));
        assert_eq!(damage.reason, "a checksum");
        assert_eq!(of("messages of MAVLink number 3").count, 2);
        assert_eq!(of(FURTHER).count, 50);
        assert_eq!(account.unreadable.len(), KINDS_MAX + 2);
    }
}
