//! Contents of another program's log: its topics, and the fields that a map can name.

use std::collections::HashMap;
use std::fmt;
use std::io;

use super::message::{Account, Message, Sink, Unreadable};
use hydroline_core::plain::line;

/// Larger messages are images and clouds: a few are looked at for their fields, the rest counted.
const LARGE_BYTES: usize = 1 << 16;
const LARGE_LOOKED_AT: u64 = 3;
/// Topics and fields that are kept: no vehicle has more.
const TOPICS_MAX: usize = 5000;
const FIELDS_MAX: usize = 2000;
/// Fields with NaN that are printed of a topic: those of a covariance are all alike.
const NOT_FINITE_LISTED: usize = 8;

/// A number in each message of a topic.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, schemars::JsonSchema)]
pub struct FieldContents {
    /// Its path, as a map names it behind the topic and a point.
    pub path: String,
    /// As the log states it.
    pub unit: Option<String>,
    /// Number of messages in which it is NaN or infinite.
    #[serde(skip_serializing_if = "is_none")]
    pub not_finite: u64,
}

/// Whether a count is left out: most are.
#[allow(clippy::trivially_copy_pass_by_ref)] // As serde calls it.
fn is_none(count: &u64) -> bool {
    *count == 0
}

/// One topic.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, schemars::JsonSchema)]
pub struct TopicContents {
    /// Topic; several senders, sensors or bodies of one name have theirs in brackets.
    pub topic: String,
    /// The kind of message.
    pub schema: String,
    /// Number of messages.
    pub messages: u64,
    /// Of them, those that cannot be decoded; of transforms, those of all lists of the topic.
    #[serde(skip_serializing_if = "is_none")]
    pub undecoded: u64,
    /// Of them, those with a stamp of their own.
    pub stamped: u64,
    /// Messages with a stamp of 0 where no other stamp is near: it was never set.
    #[serde(skip)]
    pub(super) zero_stamps: u64,
    /// First and last time: when recorded, or by their stamps where the log has nothing else \[ns\].
    pub first_ns: Option<i64>,
    /// The last.
    pub last_ns: Option<i64>,
    /// Mean rate between them \[1/s\].
    pub rate_hz: Option<f64>,
    /// Numbers of its messages.
    pub fields: Vec<FieldContents>,
}

/// All of it.
#[derive(Debug, Clone, PartialEq, serde::Serialize, schemars::JsonSchema)]
pub struct Contents {
    /// Kind of log, such as `PX4 ULog`.
    pub kind: &'static str,
    /// Messages that were read or passed over.
    pub messages: u64,
    /// Topics, in the order of the log.
    pub topics: Vec<TopicContents>,
    /// Damaged records, and messages that could not be read.
    pub unreadable: Vec<Unreadable>,
    /// Bytes between records that belong to none.
    pub skipped_bytes: u64,
    /// Where the log is a bag, or part of one: contradictions to the bag's metadata.yaml.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub bag: Vec<String>,
}

impl Contents {
    /// Topics that hold numbers, to choose from, as words.
    pub(crate) fn nameable(&self) -> String {
        let named = self.topics.iter().filter(|t| !t.fields.is_empty());
        let named: Vec<&str> = named.map(|t| t.topic.as_str()).take(60).collect();
        match named.as_slice() {
            [] => "no topic of it holds numbers that a map could name".to_owned(),
            some => format!("name one of: {}", some.join(" ")),
        }
    }

    /// Reason why messages of a topic cannot be decoded, where there are such.
    pub(crate) fn undecoded_of(&self, topic: &str) -> Option<&Unreadable> {
        let unreadable = self.unreadable.iter();
        unreadable
            .filter(|u| u.topic.as_ref().is_some_and(|t| is_topic(topic, t)))
            .max_by_key(|u| u.count)
    }
}

/// Whether a topic is the one named, or an instance of it.
pub(super) fn is_topic(topic: &str, named: &str) -> bool {
    topic
        .strip_prefix(named)
        .is_some_and(|rest| rest.is_empty() || rest.starts_with('['))
}

/// A stamp of 0 begins a clock if the next one is no more mean intervals away.
const BEGINS_INTERVALS: f64 = 3.0;

/// Stamps of a topic other than 0: how many, the first and the last of them \[ns\].
#[derive(Default)]
struct Stamps {
    zeros: u64,
    others: u64,
    ends_ns: Option<(i128, i128)>,
}

impl Stamps {
    fn add(&mut self, stamp_ns: Option<i128>) {
        match stamp_ns {
            None => {}
            Some(0) => self.zeros += 1,
            Some(ns) => {
                self.others += 1;
                let (first, last) = self.ends_ns.unwrap_or((ns, ns));
                self.ends_ns = Some((first.min(ns), last.max(ns)));
            }
        }
    }

    /// Zeros that are no stamps: all but a single one from which the clock goes on.
    fn never_set(&self) -> u64 {
        let Some((first_ns, last_ns)) = self.ends_ns else {
            return self.zeros;
        };
        let intervals = self.others.saturating_sub(1).max(1) as f64;
        let interval_ns = (last_ns - first_ns) as f64 / intervals;
        let begins =
            self.zeros == 1 && (0.0..=BEGINS_INTERVALS * interval_ns).contains(&(first_ns as f64));
        if begins { 0 } else { self.zeros }
    }
}

#[derive(Default)]
pub(super) struct Gather {
    topics: Vec<TopicContents>,
    places: HashMap<String, usize>,
    /// Places of the paths seen, per topic, and how many numbers its messages had at most.
    seen: Vec<(HashMap<String, usize>, usize)>,
    stamps: Vec<Stamps>,
    messages: u64,
}

impl Gather {
    fn place(&mut self, topic: &str, schema: &str) -> Option<usize> {
        if let Some(place) = self.places.get(topic) {
            return Some(*place);
        }
        if self.topics.len() >= TOPICS_MAX {
            return None;
        }
        self.topics.push(TopicContents {
            topic: topic.to_owned(),
            schema: schema.to_owned(),
            ..TopicContents::default()
        });
        self.seen.push((HashMap::new(), 0));
        self.stamps.push(Stamps::default());
        self.places.insert(topic.to_owned(), self.topics.len() - 1);
        Some(self.topics.len() - 1)
    }

    fn count(&mut self, place: Option<usize>, ns: Option<i128>) {
        self.messages += 1;
        let Some(topic) = place.and_then(|p| self.topics.get_mut(p)) else {
            return;
        };
        topic.messages += 1;
        // Beyond 2262 it is damage.
        if let Some(ns) = ns.and_then(|ns| i64::try_from(ns).ok()) {
            topic.first_ns = Some(topic.first_ns.map_or(ns, |f| f.min(ns)));
            topic.last_ns = Some(topic.last_ns.map_or(ns, |l| l.max(ns)));
        }
    }

    pub fn finish(mut self, kind: &'static str, account: Account) -> Contents {
        for (t, stamps) in self.topics.iter_mut().zip(&self.stamps) {
            let own = account.unreadable.iter();
            t.undecoded = own
                .filter(|u| u.topic.as_ref() == Some(&t.topic))
                .map(|u| u.count)
                .sum();
            t.zero_stamps = stamps.never_set();
            let first_ns = stamps.ends_ns.and_then(|e| i64::try_from(e.0).ok());
            if stamps.zeros > t.zero_stamps && t.first_ns == first_ns {
                t.first_ns = Some(0);
            }
            if let (Some(first), Some(last)) = (t.first_ns, t.last_ns) {
                let span_s = last.saturating_sub(first) as f64 / 1e9;
                t.rate_hz =
                    (t.messages > 1 && span_s > 0.0).then(|| (t.messages - 1) as f64 / span_s);
            }
        }
        Contents {
            kind,
            messages: self.messages,
            topics: self.topics,
            unreadable: account.unreadable,
            skipped_bytes: account.skipped_bytes,
            bag: Vec::new(),
        }
    }
}

impl Sink for Gather {
    fn checks_images(&self) -> bool {
        true
    }

    fn wants(&mut self, topic: &str, _: &str, bytes: usize) -> bool {
        let place = self.places.get(topic);
        bytes <= LARGE_BYTES || place.is_none_or(|p| self.topics[*p].messages < LARGE_LOOKED_AT)
    }

    fn message(&mut self, message: &Message<'_>) -> io::Result<()> {
        let place = self.place(message.topic, message.schema);
        // Where the log has nothing else, its times are the stamps.
        let log_ns = message.log_ns.filter(|ns| *ns != 0);
        self.count(place, log_ns);
        let Some(place) = place else {
            return Ok(());
        };
        self.stamps[place].add(message.stamp_ns);
        let topic = &mut self.topics[place];
        topic.stamped += u64::from(message.stamp_ns.is_some());
        let (seen, most) = &mut self.seen[place];
        let (mut numbers, mut all_finite) = (0, true);
        for (_, value) in message.leaves.numbers() {
            numbers += 1;
            all_finite &= value.is_finite();
        }
        // Messages of a topic hold the same fields unless an array grew.
        if numbers > *most || topic.messages <= 10 {
            *most = numbers.max(*most);
            for (path, _) in message.leaves.numbers() {
                if !seen.contains_key(path) && topic.fields.len() < FIELDS_MAX {
                    seen.insert(path.to_owned(), topic.fields.len());
                    topic.fields.push(FieldContents {
                        path: path.to_owned(),
                        unit: (message.unit)(path),
                        not_finite: 0,
                    });
                }
            }
        }
        if !all_finite {
            for (path, _) in message.leaves.numbers().filter(|n| !n.1.is_finite()) {
                if let Some(field) = seen.get(path).and_then(|p| topic.fields.get_mut(*p)) {
                    field.not_finite += 1;
                }
            }
        }
        Ok(())
    }

    fn other(&mut self, topic: &str, schema: &str, log_ns: Option<i128>) {
        let place = self.place(topic, schema);
        self.count(place, log_ns);
    }
}

/// `covariance[0] .. [35]` in one word.
fn together(fields: &[FieldContents]) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    let mut at = 0;
    while at < fields.len() {
        let own = &fields[at];
        let element = own
            .path
            .strip_suffix(']')
            .and_then(|p| p.rsplit_once('['))
            .filter(|(_, n)| *n == "0");
        let mut count = 1;
        if let Some((lead, _)) = element {
            while fields
                .get(at + count)
                .is_some_and(|f| f.path == format!("{lead}[{count}]"))
            {
                count += 1;
            }
        }
        let unit = own
            .unit
            .as_ref()
            .map_or(String::new(), |u| format!(" [{u}]"));
        words.push(match element {
            Some((lead, _)) if count > 4 => format!("{lead}[0] .. [{}]{unit}", count - 1),
            _ => {
                count = 1;
                format!("{}{unit}", own.path)
            }
        });
        at += count;
    }
    words
}

impl fmt::Display for Contents {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        line(f, format_args!("{}: {} messages", self.kind, self.messages))?;
        // Losses first: below a hundred topics nobody sees them.
        for u in &self.unreadable {
            line(
                f,
                format_args!(
                    "  NOT READ {}: {}, the first at {}: {}",
                    u.what, u.count, u.first_at, u.reason
                ),
            )?;
        }
        if self.skipped_bytes > 0 {
            let bytes = self.skipped_bytes;
            line(f, format_args!("  {bytes} bytes belong to no record"))?;
        }
        for words in &self.bag {
            line(f, format_args!("  BAG {words}"))?;
        }
        for t in &self.topics {
            let rate = t.rate_hz.map_or(String::new(), |r| format!(", {r:.1}/s"));
            let stamps = match (t.stamped, t.messages) {
                (0, _) => ", no stamps of its own",
                (s, m) if s < m => ", some without a stamp of their own",
                _ => "",
            };
            let zeros = match t.zero_stamps {
                0 => String::new(),
                n => format!(", {n} with the stamp 0, never set"),
            };
            let undecoded = match t.undecoded {
                0 => String::new(),
                n => format!(", {n} OF THEM NOT READ"),
            };
            let (topic, schema, count) = (&t.topic, &t.schema, t.messages);
            line(
                f,
                format_args!(
                    "  {topic}  {schema}  {count} messages{undecoded}{rate}{stamps}{zeros}"
                ),
            )?;
            let fields = match t.fields.as_slice() {
                [] => "no numbers".to_owned(),
                some => together(some).join("  "),
            };
            line(f, format_args!("      {fields}"))?;
            let wild = t.fields.iter().filter(|f| f.not_finite > 0);
            let wild: Vec<String> = wild
                .map(|f| format!("{} in {}", f.path, f.not_finite))
                .take(NOT_FINITE_LISTED)
                .collect();
            if !wild.is_empty() {
                line(
                    f,
                    format_args!("      NaN or infinite: {} messages", wild.join(", ")),
                )?;
            }
        }
        Ok(())
    }
}
