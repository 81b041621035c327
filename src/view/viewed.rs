//! A finished log: where its time begins, which numbers and images it holds. Only its index and a few chunks are read.

use crate::derived::{self, Derived};
use crate::events::Events;
use crate::fields::Fields;
use crate::frames::Recent;
use crate::series::Columns;
use hydroline_core::event::kind::PLAN_START;
use hydroline_core::frame::GreyRule;
use hydroline_core::lock::Lock;
use hydroline_import::recorded::MessageDecoder;
use hydroline_log::messages::pb::{Event, ThrusterCommand};
use hydroline_log::{IndexedLog, LogError, PlainMessage, Topic};
use prost::Message;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Mutex;

/// Places of a topic that are looked through for the plan's start: half a minute of a recording at the least.
const START_WITHIN: usize = 100;
/// Words on damage that are kept.
const WORDS_MAX: usize = 5;

/// Zero of a log's time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Zero {
    /// Start of its plan.
    Plan,
    /// First of its samples, commands or frames.
    First,
}

/// A topic whose messages are not decoded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Undecoded {
    /// Name of the topic.
    pub topic: String,
    /// Schema name, "" without one.
    pub schema: String,
    /// Number of messages.
    pub messages: u64,
    /// Reason.
    pub why: String,
}

/// A topic with images.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Images {
    /// Number of its channel.
    pub channel: u16,
    /// Name of the topic.
    pub topic: String,
    /// Number of images.
    pub messages: u64,
    /// Places in the log that hold some, in the order of time.
    pub(crate) places: Vec<usize>,
}

/// A number of a log that can be plotted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ListedField {
    /// Its number in this log, for good.
    pub number: usize,
    /// Name of the topic.
    pub topic: String,
    /// Path in the topic's messages.
    pub path: String,
    /// Which of several senders on the topic; "" = there is one.
    pub key: String,
}

/// A log that is looked at.
#[derive(Debug)]
pub struct Viewed {
    log: IndexedLog,
    zero: Zero,
    zero_ns: u64,
    window_zero_ns: u64,
    end_ns: u64,
    pub(crate) is_own: bool,
    rule: GreyRule,
    pub(crate) decoders: BTreeMap<u16, MessageDecoder>,
    undecoded: Vec<Undecoded>,
    images: Vec<Images>,
    damage: Mutex<Vec<String>>,
    pub(crate) derived: Mutex<Option<Derived>>,
    pub(crate) fields: Mutex<Fields>,
    pub(crate) columns: Mutex<Columns>,
    pub(crate) events: Mutex<Events>,
    pub(crate) recent: Mutex<Recent>,
}

impl Viewed {
    /// Opens a log by its index; one without an index, cut or made elsewhere, is read once from start to end.
    ///
    /// # Errors
    /// [`LogError`]: no log, or damage without an index behind it. A missing end is none: [`Viewed::notes`].
    pub fn open(path: &Path) -> Result<Self, LogError> {
        let log = IndexedLog::open(path)?;
        let is_own = log.metadata().contains_key("rig")
            || log
                .channels()
                .any(|c| c.schema.name.starts_with("hydroline."));
        let (mut decoders, mut undecoded) = (BTreeMap::new(), Vec::new());
        let mut images = Vec::new();
        for channel in log.channels().filter(|c| c.messages > 0) {
            if channel.has_images() {
                images.push(Images {
                    channel: channel.id,
                    topic: channel.topic.to_owned(),
                    messages: channel.messages,
                    places: places_of(&log, &[channel.id]),
                });
                continue;
            }
            let decoder = MessageDecoder::of(channel.encoding, &channel.schema);
            match decoder.refusal() {
                None => {
                    decoders.insert(channel.id, decoder);
                }
                Some(why) => undecoded.push(Undecoded {
                    topic: channel.topic.to_owned(),
                    schema: channel.schema.name.to_owned(),
                    messages: channel.messages,
                    why: why.to_owned(),
                }),
            }
        }
        // Ours first.
        images.sort_by_key(|i: &Images| i.topic != Topic::RawImage.name());
        let spans = log.all_places().iter().filter(|p| !p.is_empty());
        let spans = spans.map(hydroline_log::Place::span_ns);
        let (first_ns, end_ns) = spans.fold((u64::MAX, 0), |(first, last), (from, to)| {
            (first.min(from), last.max(to))
        });
        let first_ns = first_ns.min(end_ns);
        let rule = log.grey_rule();
        let mut viewed = Self {
            log,
            zero: Zero::First,
            zero_ns: first_ns,
            window_zero_ns: first_ns,
            end_ns,
            is_own,
            rule,
            decoders,
            undecoded,
            images,
            damage: Mutex::default(),
            derived: Mutex::default(),
            fields: Mutex::default(),
            columns: Mutex::default(),
            events: Mutex::default(),
            recent: Mutex::default(),
        };
        viewed.begin();
        viewed.look_for_fields();
        Ok(viewed)
    }

    /// Finds zero: the plan's start, else the first command, motion or image.
    fn begin(&mut self) {
        let window = [Topic::Command, Topic::Motion];
        let first = |topics: &[Topic]| {
            let each = topics.iter().filter_map(|t| self.first_of(*t, 1, |_| true));
            each.min()
        };
        if self.is_own
            && let Some(first_ns) = first(&window)
        {
            (self.window_zero_ns, self.zero_ns) = (first_ns, first_ns);
        } else if self.is_own
            && let Some(first_ns) = first(&[Topic::RawImage, Topic::CompressedImage])
        {
            (self.window_zero_ns, self.zero_ns) = (first_ns, first_ns);
        }
        let is_start = |m: &PlainMessage| {
            Event::decode(m.data.clone()).is_ok_and(|e| e.kind == PLAN_START.name)
        };
        let is_of_plan = |m: &PlainMessage| commanded(m).is_some_and(|c| c.plan_step > 0);
        // When the plan wanted its first command is nearer to its start than the event, which comes before it.
        let start = (self.first_due(is_of_plan))
            .or_else(|| self.first_of(Topic::Event, START_WITHIN, is_start));
        if let Some(start_ns) = start.filter(|_| self.is_own) {
            (self.zero, self.zero_ns) = (Zero::Plan, start_ns);
        }
    }

    /// Stamp of the first message of a topic of ours for which it holds, within its first places.
    fn first_of(
        &self,
        topic: Topic,
        within: usize,
        holds: impl Fn(&PlainMessage) -> bool,
    ) -> Option<u64> {
        let channels = self.channels_of(topic);
        let places = places_of(&self.log, &channels);
        places.into_iter().take(within).find_map(|place| {
            let messages = self.messages(place, &channels);
            let found = messages.iter().filter(|m| holds(m));
            found.map(|m| self.stamp_ns(m)).min()
        })
    }

    /// When the first command for which it holds was due, else sent.
    fn first_due(&self, holds: impl Fn(&PlainMessage) -> bool) -> Option<u64> {
        let channels = self.channels_of(Topic::Command);
        let places = places_of(&self.log, &channels);
        places.into_iter().take(START_WITHIN).find_map(|place| {
            let messages = self.messages(place, &channels);
            let found = messages.iter().filter(|m| holds(m)).map(|m| {
                let due_ns = commanded(m).map_or(0, |c| c.due_ns);
                if due_ns > 0 { due_ns } else { self.stamp_ns(m) }
            });
            found.min()
        })
    }

    /// Channels of a topic of ours.
    pub(crate) fn channels_of(&self, topic: Topic) -> Vec<u16> {
        let own = (self.log.channels())
            .filter(|c| Topic::find(c.topic, c.schema.name) == Some(topic) && c.messages > 0);
        own.map(|c| c.id).collect()
    }

    /// Messages of channels at a place; of a damaged one none, which is noted.
    pub(crate) fn messages(&self, place: usize, channels: &[u16]) -> Vec<PlainMessage> {
        let Some(place) = self.log.all_places().get(place) else {
            return Vec::new();
        };
        self.log.plain(place, channels).unwrap_or_else(|error| {
            self.note(error.to_string());
            Vec::new()
        })
    }

    pub(crate) fn note(&self, words: String) {
        let mut damage = self.damage.held();
        if damage.len() < WORDS_MAX && !damage.contains(&words) {
            damage.push(words);
        }
    }

    /// Numbers that can be plotted, as far as they were met: more come when a topic is read.
    pub fn fields(&self) -> Vec<ListedField> {
        let fields = self.fields.held();
        let listed = fields.listed().map(|(number, field)| ListedField {
            number,
            topic: self.topic(field.channel).to_owned(),
            path: field.path.clone(),
            key: field.key.clone(),
        });
        listed.collect()
    }

    /// How many numbers were met so far.
    pub fn fields_met(&self) -> usize {
        self.fields.held().all().len()
    }

    /// The log by its index.
    pub fn log(&self) -> &IndexedLog {
        &self.log
    }

    /// When a message was true: by its writer in logs of ours, elsewhere when it was logged, the only clock that all topics share.
    pub(crate) fn stamp_ns(&self, message: &PlainMessage) -> u64 {
        match self.is_own && message.publish_ns > 0 {
            true => message.publish_ns,
            false => message.log_ns,
        }
    }

    /// UNIX time as time since zero \[ns\].
    pub fn since_zero(&self, unix_ns: u64) -> i64 {
        let ns = i128::from(unix_ns) - i128::from(self.zero_ns);
        ns.clamp(i64::MIN.into(), i64::MAX.into()) as i64
    }

    /// Time since zero as UNIX time \[ns\].
    pub fn unix_ns(&self, at_ns: i64) -> u64 {
        self.zero_ns.saturating_add_signed(at_ns)
    }

    /// Zero, UNIX \[ns\].
    pub fn zero_ns(&self) -> u64 {
        self.zero_ns
    }

    /// Kind of its zero.
    pub fn zero(&self) -> Zero {
        self.zero
    }

    /// Zero of windows, as `LOG@FROM..TO` has them, since this zero \[ns\]: the first command or motion.
    pub fn window_zero(&self) -> i64 {
        self.since_zero(self.window_zero_ns)
    }

    /// First and last time of logging since zero \[ns\].
    pub fn span(&self) -> (i64, i64) {
        let places = self.log.all_places().iter().filter(|p| !p.is_empty());
        let first_ns = places.map(|p| p.span_ns().0).min();
        let first_ns = first_ns.unwrap_or(self.zero_ns).min(self.window_zero_ns);
        (self.since_zero(first_ns), self.since_zero(self.end_ns))
    }

    /// Topics with images, ours first.
    pub fn images(&self) -> &[Images] {
        &self.images
    }

    /// How grey levels come out of its frames.
    pub fn rule(&self) -> &GreyRule {
        &self.rule
    }

    /// Topics of which nothing can be plotted.
    pub fn undecoded(&self) -> &[Undecoded] {
        &self.undecoded
    }

    /// Name of a channel's topic.
    pub fn topic(&self, channel: u16) -> &str {
        let mut channels = self.log.channels();
        let logged = channels.find(|c| c.id == channel).map(|c| c.topic);
        logged.or_else(|| derived::name(channel)).unwrap_or("")
    }

    /// Words on what is missing or damaged, as far as it was met.
    pub fn notes(&self) -> Vec<String> {
        let end = self
            .log
            .end_missing()
            .map(|error| format!("{error}; everything before its end is shown"));
        end.into_iter().chain(self.damage.held().clone()).collect()
    }
}

fn commanded(message: &PlainMessage) -> Option<ThrusterCommand> {
    ThrusterCommand::decode(message.data.clone()).ok()
}

/// Places that hold messages of channels, in the order of time.
pub(crate) fn places_of(log: &IndexedLog, channels: &[u16]) -> Vec<usize> {
    let places = log.all_places();
    let mut found: Vec<usize> = (0..places.len())
        .filter(|k| places[*k].holds(channels))
        .collect();
    found.sort_by_key(|k| places[*k].span_ns());
    found
}
