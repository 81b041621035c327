//! Contents of a log in numbers.

use hydroline_core::plain::Lines;
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::LogError;
use super::part::MetadataMap;
use super::scan::{self, Step};

/// Ending of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// Whole, and its summary says the recording was stopped in order.
    Clean,
    /// Whole, but its summary says that something ended the recording.
    Stopped,
    /// Whole; made elsewhere, without a hydroline summary.
    Whole,
    /// Cut or without footer: the writer did not get to the end.
    Cut,
}

/// One topic.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct TopicInfo {
    /// Name of the topic.
    pub topic: String,
    /// Schema name, "" without one.
    pub schema: String,
    /// Message encoding.
    pub encoding: String,
    /// Number of messages.
    pub messages: u64,
    /// First log time, UNIX \[ns\].
    pub first_ns: u64,
    /// Last log time, UNIX \[ns\].
    pub last_ns: u64,
    /// Mean rate between first and last \[1/s\]; `None` with fewer than two times.
    pub rate_hz: Option<f64>,
    /// Bytes of the messages themselves.
    pub bytes: u64,
}

/// A log in numbers.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Info {
    /// Path of the file.
    pub path: PathBuf,
    /// Its size.
    pub bytes: u64,
    /// Library that wrote it.
    pub library: String,
    /// MCAP profile.
    pub profile: String,
    /// Ending of the file.
    pub ending: Ending,
    /// Messages read.
    pub messages: u64,
    /// Number of chunks.
    pub chunks: u64,
    /// Number of attachments.
    pub attachments: u64,
    /// Chunks by compression ("" = none).
    pub compression: BTreeMap<String, u64>,
    /// First log time, UNIX \[ns\]; 0 without messages.
    pub start_ns: u64,
    /// The same as RFC 3339 in UTC.
    pub start_utc: String,
    /// Last log time, UNIX \[ns\]; 0 without messages.
    pub end_ns: u64,
    /// Their difference \[s\].
    pub duration_s: f64,
    /// Topics with messages, by name.
    pub topics: Vec<TopicInfo>,
    /// All metadata.
    pub metadata: BTreeMap<String, MetadataMap>,
    /// Places of damage: (offset \[bytes\], description).
    pub damage: Vec<(u64, String)>,
}

/// Reads the whole file and counts. Damage is reported in the result, not as an error.
///
/// # Errors
/// [`LogError::Read`], [`LogError::NotMcap`].
pub fn info(path: &Path) -> Result<Info, LogError> {
    let mut scan = scan::open(path)?;
    let bytes = path.metadata().map_err(LogError::read(path))?.len();
    let mut topics: BTreeMap<(String, u16), TopicInfo> = BTreeMap::new();
    let (mut damage, mut cut) = (Vec::new(), false);
    while let Some(step) = scan.next() {
        match step {
            Step::Message {
                channel, message, ..
            } => {
                let schema = scan.learnt.declared.schema_name(&channel);
                let key = (channel.topic.clone(), channel.schema_id);
                let t = topics.entry(key).or_insert_with(|| TopicInfo {
                    topic: channel.topic.clone(),
                    schema: schema.to_owned(),
                    encoding: channel.message_encoding.clone(),
                    messages: 0,
                    first_ns: message.log_ns,
                    last_ns: message.log_ns,
                    rate_hz: None,
                    bytes: 0,
                });
                t.messages += 1;
                t.bytes += message.data.len() as u64;
                t.first_ns = t.first_ns.min(message.log_ns);
                t.last_ns = t.last_ns.max(message.log_ns);
            }
            Step::Damage { offset, damage: d } => {
                cut |= d.is_missing_end();
                damage.push((offset, d.to_string()));
            }
            Step::Truncated { .. } | Step::Metadata { .. } => {}
        }
    }
    let mut topics: Vec<TopicInfo> = topics.into_values().collect();
    for t in &mut topics {
        let span_s = (t.last_ns - t.first_ns) as f64 / 1e9;
        t.rate_hz = (t.messages > 1 && span_s > 0.0).then(|| (t.messages - 1) as f64 / span_s);
    }
    let start_ns = topics.iter().map(|t| t.first_ns).min().unwrap_or(0);
    let end_ns = topics.iter().map(|t| t.last_ns).max().unwrap_or(0);
    let learnt = scan.learnt;
    let stop_clean = learnt
        .metadata
        .get("summary")
        .and_then(|m| m.get("stop.clean"));
    let ending = match stop_clean.map(String::as_str) {
        _ if cut || !learnt.ended => Ending::Cut,
        Some("true") => Ending::Clean,
        Some(_) => Ending::Stopped,
        None => Ending::Whole,
    };
    Ok(Info {
        path: path.to_owned(),
        bytes,
        library: learnt.library,
        profile: learnt.profile,
        ending,
        messages: learnt.messages,
        chunks: learnt.chunks,
        attachments: learnt.attachments,
        compression: learnt.compressions,
        start_ns,
        start_utc: utc(start_ns),
        end_ns,
        duration_s: (end_ns - start_ns) as f64 / 1e9,
        topics,
        metadata: learnt.metadata,
        damage,
    })
}

/// RFC 3339 with milliseconds, UTC. 64 bits of nanoseconds end in 2554, inside what it can say.
pub(crate) fn utc(unix_ns: u64) -> String {
    let time = std::time::UNIX_EPOCH + std::time::Duration::from_nanos(unix_ns);
    humantime::format_rfc3339_millis(time).to_string()
}

/// Lines of a log's short form: a screen.
const BRIEF_LINES: usize = 40;
/// Metadata that the short form leaves out: what identifies a file, a machine or a build, what other lines say already, and matrices
/// that nobody reads.
const ONLY_LONG: [&str; 16] = [
    "boot_id",
    "camera.response.",
    "commit",
    "dirty",
    "kernel",
    "frames.analysed",
    "frames.period_s",
    "messages.",
    "module.",
    "part",
    "planned_s",
    "queue.",
    "sha256",
    "source",
    "start_pose",
    "version",
];

/// A log on one screen, see [`Info::brief`].
#[derive(Debug, Clone, Copy)]
pub struct Brief<'a>(&'a Info);

impl Info {
    /// The same on at most forty lines: topics, damage, what is known of run and conditions, counts other than zero. What is left
    /// out is counted.
    pub fn brief(&self) -> Brief<'_> {
        Brief(self)
    }

    fn head(&self) -> Vec<String> {
        let mut lines = vec![
            self.path.display().to_string(),
            format!("  written by   {}", self.library),
        ];
        if !self.profile.is_empty() {
            lines.push(format!("  profile      {}", self.profile));
        }
        lines.push(format!(
            "  size         {:.3} MB in {} chunks",
            self.bytes as f64 / 1e6,
            self.chunks
        ));
        lines.push(format!(
            "  duration     {:.3} s from {} ns (UNIX) = {}",
            self.duration_s, self.start_ns, self.start_utc
        ));
        let damage = match self.damage.len() {
            0 => String::new(),
            n => format!(
                ", and {n} place(s) of damage, listed below: messages there are not counted"
            ),
        };
        lines.push(format!("  messages     {}{damage}", self.messages));
        let ending = match self.ending {
            Ending::Clean => "clean",
            Ending::Stopped => "whole, but the recording was stopped (see summary)",
            Ending::Whole => "whole",
            Ending::Cut => "CUT: the writer did not get to the end; see `hydroline doctor`",
        };
        lines.push(format!("  end          {ending}"));
        lines
    }

    fn topic_lines(&self) -> Vec<String> {
        let wide = self.topics.iter().map(|t| t.topic.len()).max().unwrap_or(0);
        let line = |t: &TopicInfo| {
            let rate = t
                .rate_hz
                .map_or_else(|| "-".to_owned(), |r| format!("{r:.2}/s"));
            format!(
                "  {:wide$}  {:>8}  {rate:>10}  {} [{}]",
                t.topic, t.messages, t.schema, t.encoding
            )
        };
        self.topics.iter().map(line).collect()
    }

    fn damage_lines(&self) -> Vec<String> {
        let line =
            |(offset, damage): &(u64, String)| format!("  DAMAGE at byte {offset}: {damage}");
        self.damage.iter().map(line).collect()
    }

    /// Metadata by name; `all` = with what only the long form has.
    fn metadata_lines(&self, all: bool) -> Vec<String> {
        let mut lines = Vec::new();
        for (name, map) in &self.metadata {
            let kept: Vec<String> = (map.iter())
                .filter(|(key, value)| all || is_brief(key, value))
                .map(|(key, value)| match value.lines().count() {
                    0 | 1 => format!("    {key} = {}", shown(value)),
                    lines => format!("    {key}: {lines} lines"),
                })
                .collect();
            if all || !kept.is_empty() {
                lines.push(format!("  metadata `{name}`"));
                lines.extend(kept);
            }
        }
        lines
    }
}

/// Whether a key of metadata is on the short form: none of [`ONLY_LONG`], and no count of nothing.
fn is_brief(key: &str, value: &str) -> bool {
    let left_out = |own: &&str| {
        let is_group = own.ends_with('.');
        key == *own
            || key
                .strip_prefix(*own)
                .is_some_and(|rest| is_group || rest.starts_with('.'))
    };
    let is_line = value.lines().count() == 1;
    value != "0" && is_line && !ONLY_LONG.iter().any(left_out)
}

/// A value; a number that begins with zeros alone by its exponent.
fn shown(value: &str) -> String {
    let number = value.parse::<f64>().ok();
    let small = number.filter(|v| *v != 0.0 && v.abs() < 1e-4 && value.starts_with(['0', '-']));
    small.map_or_else(|| value.to_owned(), |v| format!("{v:e}"))
}

impl fmt::Display for Info {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut f = Lines(f);
        let lines = [
            self.head(),
            self.topic_lines(),
            self.metadata_lines(true),
            self.damage_lines(),
        ];
        for line in lines.concat() {
            writeln!(f, "{line}")?;
        }
        Ok(())
    }
}

impl fmt::Display for Brief<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut f = Lines(f);
        let info = self.0;
        let names: Vec<&str> = info.metadata.keys().map(String::as_str).collect();
        let carries = (!names.is_empty()).then(|| format!("  carries      {}", names.join(", ")));
        // What is damaged is said before what fills the screen.
        let lines = [
            info.head(),
            carries.into_iter().collect(),
            info.damage_lines(),
            info.topic_lines(),
            info.metadata_lines(false),
        ];
        let lines = lines.concat();
        let fits = lines.len() < BRIEF_LINES;
        let shown = if fits { lines.len() } else { BRIEF_LINES - 1 };
        for line in &lines[..shown] {
            writeln!(f, "{line}")?;
        }
        let all = info.head().len()
            + info.damage.len()
            + info.topics.len()
            + info.metadata_lines(true).len();
        // The line of names stands in for none of them.
        match all.saturating_sub(shown - usize::from(!names.is_empty())) {
            0 => Ok(()),
            more => writeln!(f, "  {more} more lines: --long"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(metadata: &[(&str, &str, &str)], topics: usize) -> Info {
        let mut maps: BTreeMap<String, MetadataMap> = BTreeMap::new();
        for (name, key, value) in metadata {
            let map = maps.entry((*name).to_owned()).or_default();
            map.insert((*key).to_owned(), (*value).to_owned());
        }
        Info {
            path: PathBuf::from("a.mcap"),
            bytes: 1,
            library: "x".to_owned(),
            profile: String::new(),
            ending: Ending::Whole,
            messages: 0,
            chunks: 0,
            attachments: 0,
            compression: BTreeMap::new(),
            start_ns: 0,
            start_utc: utc(0),
            end_ns: 0,
            duration_s: 0.0,
            topics: (0..topics)
                .map(|k| TopicInfo {
                    topic: format!("/t{k}"),
                    schema: String::new(),
                    encoding: "json".to_owned(),
                    messages: 1,
                    first_ns: 0,
                    last_ns: 0,
                    rate_hz: None,
                    bytes: 0,
                })
                .collect(),
            metadata: maps,
            damage: vec![(7, "bad".to_owned())],
        }
    }

    #[test]
    fn the_short_form_is_a_screen_and_says_what_it_leaves_out() {
        let metadata = [
            ("session", "operator", "Ada"),
            ("session", "sha256", "12ab"),
            ("session", "source.driver", "uvc"),
            ("summary", "frames.lost", "0"),
            ("summary", "frames.received", "192"),
            (
                "summary",
                "camera.response.line_variance",
                "0.0000000000012",
            ),
            ("summary", "noise", "-0.0000000000012"),
        ];
        let info = with(&metadata, 3);
        let brief = info.brief().to_string();
        for (words, is_there) in [
            ("operator = Ada", true),
            ("frames.received = 192", true),
            ("noise = -1.2e-12", true),
            ("DAMAGE at byte 7", true),
            ("sha256", false),
            ("source.driver", false),
            ("frames.lost", false),
            ("camera.response", false),
            ("  4 more lines: --long", true),
        ] {
            assert_eq!(brief.contains(words), is_there, "{words}: {brief}");
        }
        let long = info.to_string();
        assert!(
            long.contains("camera.response.line_variance = 1.2e-12"),
            "{long}"
        );
        // Whatever is in it, it is no longer than a screen, and nothing is lost unsaid.
        let many = with(&metadata, 200);
        let brief = many.brief().to_string();
        assert_eq!(brief.lines().count(), BRIEF_LINES);
        let left = many.to_string().lines().count() - (BRIEF_LINES - 2);
        assert!(
            brief.ends_with(&format!("  {left} more lines: --long\n")),
            "{brief}"
        );
    }

    #[test]
    fn times_are_printed_in_utc() {
        assert_eq!(utc(1_760_000_000_123_456_789), "2025-10-09T08:53:20.123Z");
        assert_eq!(utc(u64::MAX), "2554-07-21T23:34:33.709Z");
    }
}
