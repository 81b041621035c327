//! The checks, fed message by message.

use std::collections::BTreeMap;

use super::{Finding, Grade};
use crate::event::Severity;
use crate::log::messages::{self, pb};
use crate::log::part::MetadataMap;
use crate::log::reader::Record;
use crate::log::records::{ChannelRecord, Damage};
use crate::log::scan::Learnt;
use crate::log::topic::Topic;

/// Realtime steps beyond this are reported \[ns\].
const STEP_NS: i128 = 10_000_000;
/// Clock triples should be read within this bracket \[ns\].
const BRACKET_NS: u64 = 50_000;
/// At most that many findings of one check; the rest is counted.
const LISTED: usize = 5;

/// What has been seen so far.
#[derive(Debug, Default)]
pub(super) struct Checks {
    findings: Vec<Finding>,
    suppressed: BTreeMap<&'static str, usize>,
    topics: BTreeMap<String, u64>,
    schemas_checked: BTreeMap<u16, ()>,
    last_log_ns: u64,
    backward_steps: u64,
    cut: bool,
    damaged: bool,
    frames: Frames,
    last_command: Option<(u32, String)>,
    commands_missing: u64,
    clock_offset_ns: Option<i128>,
    clock_steps: u64,
    wide_brackets: u64,
    step_events: u64,
    error_events: BTreeMap<String, u64>,
}

#[derive(Debug, Default)]
struct Frames {
    infos: u64,
    images: u64,
    last: Option<(u32, u64)>,
    first_index: Option<u64>,
    index_gaps: u64,
    unexplained: u64,
    faulty: u64,
    short: u64,
}

impl Checks {
    fn add(
        &mut self,
        grade: Grade,
        check: &'static str,
        offset: Option<u64>,
        message: String,
        next_step: &str,
    ) {
        let listed = self.findings.iter().filter(|f| f.check == check).count();
        if listed >= LISTED {
            *self.suppressed.entry(check).or_default() += 1;
            return;
        }
        let next_step = next_step.to_owned();
        self.findings.push(Finding {
            grade,
            check,
            message,
            next_step,
            offset,
        });
    }

    /// Every message, whatever it is.
    pub fn message(&mut self, offset: u64, channel: &ChannelRecord, schema: &str, log_ns: u64) {
        *self.topics.entry(channel.topic.clone()).or_default() += 1;
        if log_ns < self.last_log_ns {
            self.backward_steps += 1;
        }
        self.last_log_ns = self.last_log_ns.max(log_ns);
        if self.schemas_checked.insert(channel.id, ()).is_some() {
            return;
        }
        let ours = Topic::ALL.into_iter().filter(|t| t.name() == channel.topic);
        let expected: Vec<&str> = ours.map(Topic::schema_name).collect();
        if channel.message_encoding == "protobuf" && schema.is_empty() {
            let message = format!("{} is protobuf without a schema", channel.topic);
            self.add(
                Grade::Warning,
                "schema",
                Some(offset),
                message,
                "write the FileDescriptorSet into the schema",
            );
        } else if !expected.is_empty() && !expected.contains(&schema) {
            let message = format!(
                "{} carries `{schema}`, hydroline reads {} there",
                channel.topic,
                expected.join(" or ")
            );
            self.add(
                Grade::Warning,
                "schema",
                Some(offset),
                message,
                "rename the topic or the schema; the messages are passed over",
            );
        }
    }

    /// A message that its schema does not decode.
    pub fn undecodable(&mut self, offset: u64, topic: &str, schema: &str, reason: &str) {
        let message = format!("a message of {topic} ({schema}) does not decode: {reason}");
        self.add(
            Grade::Error,
            "decode",
            Some(offset),
            message,
            "the writer is at fault; the message cannot be used",
        );
    }

    /// Damaged bytes.
    pub fn damage(&mut self, offset: u64, damage: &Damage) {
        self.damaged = true;
        self.cut |= damage.is_missing_end();
        let check = if damage.is_missing_end() {
            "end"
        } else {
            "damage"
        };
        let next = "`hydroline recover LOG --out NEW.mcap` writes what is sound into a new file";
        self.add(Grade::Error, check, Some(offset), damage.to_string(), next);
    }

    /// A decoded message.
    pub fn record(&mut self, offset: u64, record: &Record) {
        match record {
            Record::FrameInfo(info) => self.frame_info(offset, info),
            Record::Frame(frame) => {
                self.frames.images += 1;
                if frame.meta.fault.is_none() && frame.to_grey().is_err() {
                    self.frames.short += 1;
                }
            }
            Record::Command(c) => self.command(c),
            Record::Clock(pair) => self.clock(pair),
            Record::Event(event) => {
                self.step_events += u64::from(event.kind == "clock.step");
                if messages::event_severity(event) == Severity::Error {
                    *self.error_events.entry(event.kind.clone()).or_default() += 1;
                }
            }
            _ => {}
        }
    }

    /// The driver's sequence must be explained by the gaps that the frames themselves state.
    fn frame_info(&mut self, offset: u64, info: &pb::FrameInfo) {
        let f = &mut self.frames;
        f.infos += 1;
        f.faulty += u64::from(!info.fault.is_empty());
        f.first_index.get_or_insert(info.frame_index);
        let last = f.last.replace((info.sequence, info.frame_index));
        let Some((sequence, index)) = last else {
            return;
        };
        let skipped = info.frame_index.saturating_sub(index).saturating_sub(1);
        f.index_gaps += skipped;
        // A lower sequence is a new stream (replug, EPIPE); dropped frames take their gaps along.
        let new_stream = info.sequence <= sequence;
        if skipped == 0 && !new_stream {
            let missing = info.sequence - sequence - 1;
            if missing != info.sequence_gap_before {
                f.unexplained += 1;
                let message = format!(
                    "frame {}: {missing} sequence numbers are missing before it, it states {}",
                    info.sequence, info.sequence_gap_before
                );
                let next = "frames are missing from the file that the daemon had; compare with the summary";
                self.add(Grade::Error, "frame_gap", Some(offset), message, next);
            }
        }
    }

    fn command(&mut self, c: &pb::ThrusterCommand) {
        let last = self.last_command.replace((c.sequence, c.thruster.clone()));
        if let Some((sequence, _)) = last
            && c.sequence > sequence
        {
            self.commands_missing += u64::from(c.sequence - sequence - 1);
        }
    }

    fn clock(&mut self, pair: &pb::ClockPair) {
        self.wide_brackets += u64::from(pair.bracket_ns > BRACKET_NS);
        let offset = i128::from(pair.realtime_ns) - i128::from(pair.monotonic_ns);
        let before = self.clock_offset_ns.replace(offset);
        if before.is_some_and(|b| (offset - b).abs() > STEP_NS) {
            self.clock_steps += 1;
        }
    }

    /// What only shows at the end.
    pub fn conclude(mut self, learnt: &Learnt) -> Vec<Finding> {
        let ours = learnt.library.starts_with("hydroline") || learnt.metadata.contains_key("rig");
        self.log_times(ours);
        self.frames_and_commands();
        self.clocks();
        let errors = std::mem::take(&mut self.error_events);
        for (kind, n) in errors {
            let message = format!("the daemon reported {n} x `{kind}`");
            self.add(
                Grade::Warning,
                "event",
                None,
                message,
                "`hydroline export` lists the events with their times",
            );
        }
        if ours {
            for name in ["rig", "calibration", "session"] {
                if !learnt.head_metadata.iter().any(|n| n == name) {
                    let message = format!("metadata `{name}` does not stand at the head");
                    self.add(
                        Grade::Warning,
                        "head",
                        None,
                        message,
                        "name the rig with --rig when you use this log",
                    );
                }
            }
        }
        match learnt.metadata.get("summary") {
            Some(summary) => self.ledger(summary),
            None if ours && !self.cut => {
                let message = "the file is whole but holds no `summary`: its recording was not stopped cleanly".to_owned();
                self.add(
                    Grade::Warning,
                    "summary",
                    None,
                    message,
                    "losses are not accounted for; see the frame and command gaps",
                );
            }
            None => {}
        }
        if learnt.ended && learnt.statistics.is_none() && !self.damaged {
            let message =
                "the file holds no index (its disk failed, or its writer makes none)".to_owned();
            self.add(
                Grade::Note,
                "summary",
                None,
                message,
                "`hydroline recover` writes one with an index, if a viewer wants it",
            );
        }
        if learnt.chunks_unchecked > 0 && !learnt.data_crc_stated {
            let message = format!(
                "{} of {} chunks carry no checksum: damage inside them cannot be noticed",
                learnt.chunks_unchecked, learnt.chunks
            );
            let next = "have the writer state chunk checksums, or keep a checksum of the file";
            self.add(Grade::Note, "unchecked", None, message, next);
        }
        for (check, n) in std::mem::take(&mut self.suppressed) {
            let message = format!("{n} more findings of `{check}`");
            self.findings.push(Finding {
                grade: Grade::Note,
                check,
                message,
                next_step: "mend the first ones first".to_owned(),
                offset: None,
            });
        }
        self.findings
    }

    fn log_times(&mut self, ours: bool) {
        if self.backward_steps == 0 {
            return;
        }
        let grade = if ours { Grade::Error } else { Grade::Note };
        let message = format!("log_time goes back {} times", self.backward_steps);
        let next = "readers that need order must sort by log_time; MCAP's index does";
        self.add(grade, "log_time", None, message, next);
    }

    fn frames_and_commands(&mut self) {
        let (infos, images) = (self.frames.infos, self.frames.images);
        if infos > 0 && infos != images {
            let message = format!("{images} images but {infos} frame infos");
            self.add(
                Grade::Error,
                "image",
                None,
                message,
                "frames are incomplete at the end of a cut file; elsewhere the file lost messages",
            );
        }
        if self.frames.short > 0 {
            let message = format!(
                "{} images hold fewer bytes than their size needs, unmarked",
                self.frames.short
            );
            self.add(
                Grade::Error,
                "image",
                None,
                message,
                "exclude them; the writer should have marked them",
            );
        }
        if self.frames.faulty > 0 {
            let message = format!(
                "{} of {infos} frames are marked faulty and excluded from analysis",
                self.frames.faulty
            );
            self.add(
                Grade::Note,
                "image",
                None,
                message,
                "check cable and bandwidth if there are many",
            );
        }
        if self.frames.index_gaps > 0 {
            let message = format!(
                "{} frames reached the daemon but not the file",
                self.frames.index_gaps
            );
            self.add(
                Grade::Warning,
                "frame_gap",
                None,
                message,
                "the disk was too slow or full; see events `log.frames_dropped`, `disk.low`",
            );
        }
        if self.commands_missing > 0 {
            let message = format!(
                "{} commands are missing by their sequence numbers",
                self.commands_missing
            );
            self.add(
                Grade::Error,
                "command_gap",
                None,
                message,
                "do not identify or diagnose across the gap",
            );
        }
    }

    fn clocks(&mut self) {
        let steps = self.clock_steps.max(self.step_events);
        if steps > 0 {
            let message = format!("the realtime clock was set {steps} times by more than 10 ms");
            self.add(
                Grade::Warning,
                "clock",
                None,
                message,
                "compare stamps only within the stretches between; stop NTP steps during runs",
            );
        }
        if self.wide_brackets > 0 {
            let message = format!(
                "{} clock readings took longer than {} us",
                self.wide_brackets,
                BRACKET_NS / 1000
            );
            self.add(
                Grade::Note,
                "clock",
                None,
                message,
                "those readings are that uncertain; the host was busy",
            );
        }
    }

    /// `received + lost = expected`, `logged + dropped = received`, and the file agrees.
    fn ledger(&mut self, summary: &MetadataMap) {
        let number = |key: &str| summary.get(key).and_then(|v| v.parse::<u64>().ok());
        let sum = |prefix: &str| -> u64 {
            let values = summary.iter().filter(|(k, _)| k.starts_with(prefix));
            values.filter_map(|(_, v)| v.parse::<u64>().ok()).sum()
        };
        if summary.get("stop.clean").map(String::as_str) != Some("true") {
            let why = summary
                .get("stop.reason")
                .map_or("not stated", String::as_str);
            let message = format!("the recording did not end in order: {why}");
            self.add(
                Grade::Warning,
                "summary",
                None,
                message,
                "what is in the file is sound; see the event before the end",
            );
        }
        let (received, expected) = (number("frames.received"), number("frames.expected"));
        let (Some(received), Some(expected)) = (received, expected) else {
            self.add(
                Grade::Warning,
                "ledger",
                None,
                "the summary states no frame ledger".to_owned(),
                "losses are not accounted for",
            );
            return;
        };
        let lost = sum("frames.lost.");
        if received + lost != expected {
            let message =
                format!("frames: received {received} + lost {lost} is not expected {expected}");
            self.add(
                Grade::Error,
                "ledger",
                None,
                message,
                "the capture lost count; report it as a bug",
            );
        } else if lost > 0 {
            let message =
                format!("{lost} of {expected} frames were lost before they reached the daemon");
            self.add(
                Grade::Note,
                "ledger",
                None,
                message,
                "their places are marked in the frames after them",
            );
        }
        let is_only_part = summary.get("part.number").map(String::as_str) == Some("0")
            && summary.get("part.last").map(String::as_str) == Some("true");
        if let (Some(logged), true) = (number("frames.logged"), is_only_part) {
            let dropped = sum("frames.dropped.");
            if logged + dropped != received {
                let message = format!(
                    "frames: logged {logged} + dropped {dropped} is not received {received}"
                );
                self.add(
                    Grade::Error,
                    "ledger",
                    None,
                    message,
                    "the log lost count; report it as a bug",
                );
            }
        }
        for (key, stated) in summary {
            let Some(topic) = key.strip_prefix("messages./") else {
                continue;
            };
            let topic = format!("/{topic}");
            let found = self.topics.get(&topic).copied().unwrap_or(0);
            if stated.parse() != Ok(found) {
                let message = format!(
                    "the summary counts {stated} messages of {topic}, the file holds {found}"
                );
                self.add(
                    Grade::Error,
                    "ledger",
                    None,
                    message,
                    "messages were lost from the file after it was written",
                );
            }
        }
    }
}
