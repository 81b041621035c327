//! Contents of a log in numbers.

use hydroline_core::plain::Lines;
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::LogError;
use super::part::MetadataMap;
use super::scan::{self, Step};
use brief::is_brief;

mod brief;
pub use brief::Brief;

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

impl Info {
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

#[cfg(test)]
mod tests {
    use super::utc;

    #[test]
    fn times_are_printed_in_utc() {
        assert_eq!(utc(1_760_000_000_123_456_789), "2025-10-09T08:53:20.123Z");
        assert_eq!(utc(u64::MAX), "2554-07-21T23:34:33.709Z");
    }
}
