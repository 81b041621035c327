//! The checks, fed message by message.

use std::collections::{BTreeMap, BTreeSet};

use super::obeyed::Obeyed;
use super::{Finding, Grade};
use crate::messages::{self, pb};
use crate::reader::Record;
use crate::records::{ChannelRecord, Damage};
use crate::topic::Topic;
use hydroline_core::event::Severity;
use hydroline_core::frame::{BlockAccount, ClippingWatch, Frame, FrameError, GreyRule, JpegDamage};

/// Realtime steps beyond this are reported \[ns\].
const STEP_NS: i128 = 10_000_000;
/// Clock triples should be read within this bracket \[ns\].
pub(super) const BRACKET_NS: u64 = 50_000;
/// Images kept of those whose blocks look like damage: the first may be the picture, which is known after a few.
const SUSPECTS: usize = 16;
/// At most that many findings of one check; the rest is counted.
const LISTED: usize = 5;

/// Findings and counts so far.
#[derive(Debug, Default)]
pub(super) struct Checks {
    pub(super) findings: Vec<Finding>,
    pub(super) suppressed: BTreeMap<&'static str, usize>,
    pub(super) topics: BTreeMap<String, u64>,
    pub(super) schemas_checked: BTreeSet<u16>,
    /// First message, UNIX \[ns\]; `None` = there is none.
    pub(super) first_log_ns: Option<u64>,
    pub(super) last_log_ns: u64,
    pub(super) backward_steps: u64,
    pub(super) cut: bool,
    pub(super) damaged: bool,
    pub(super) frames: Frames,
    pub(super) last_command: Option<u32>,
    /// Numbers between two commands that no command has: first and one past the last.
    pub(super) command_gaps: Vec<(u32, u32)>,
    /// Sets the daemon says were cut off on their way out: likewise.
    pub(super) commands_unsent: Vec<(u32, u32)>,
    pub(super) obeyed: Obeyed,
    pub(super) clock_offset_ns: Option<i128>,
    pub(super) clock_steps: u64,
    pub(super) wide_brackets: u64,
    pub(super) step_events: u64,
    pub(super) error_events: BTreeMap<String, u64>,
    /// Rule for the grey levels of the frames.
    pub(super) rule: GreyRule,
    pub(super) clipping: ClippingWatch,
    pub(super) warning_events: BTreeMap<String, u64>,
}

#[derive(Debug, Default)]
pub(super) struct Frames {
    pub(super) infos: u64,
    pub(super) images: u64,
    /// The last account has no image behind it: a write that was cut off ends so.
    pub(super) image_due: bool,
    pub(super) last: Option<(u32, u64)>,
    pub(super) first_index: Option<u64>,
    pub(super) index_gaps: u64,
    pub(super) unexplained: u64,
    pub(super) faulty: u64,
    pub(super) short: u64,
    /// Images that nothing marks and whose data are damaged, and the first of them in words.
    pub(super) damaged: u64,
    pub(super) first_damage: Option<String>,
    /// Blocks that look like damage, and the first images taken for damaged by them.
    pub(super) blocks: BlockAccount,
    pub(super) suspects: Vec<(u32, JpegDamage)>,
    /// Losses that the frames state, and those that events take back.
    pub(super) marked: u64,
    pub(super) retracted: u64,
    /// Losses reported in `camera.gap` events and not taken back, by the frame they were reported of.
    pub(super) reported_lost: BTreeMap<Option<u32>, u64>,
}

impl Checks {
    pub(super) fn add(
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

    pub(super) fn note(&mut self, check: &'static str, message: String, next_step: &str) {
        self.add(Grade::Note, check, None, message, next_step);
    }

    pub(super) fn warning(&mut self, check: &'static str, message: String, next_step: &str) {
        self.add(Grade::Warning, check, None, message, next_step);
    }

    pub(super) fn error(&mut self, check: &'static str, message: String, next_step: &str) {
        self.add(Grade::Error, check, None, message, next_step);
    }

    /// Every message, whatever it is.
    pub fn message(&mut self, offset: u64, channel: &ChannelRecord, schema: &str, log_ns: u64) {
        *self.topics.entry(channel.topic.clone()).or_default() += 1;
        self.first_log_ns.get_or_insert(log_ns);
        if log_ns < self.last_log_ns {
            self.backward_steps += 1;
        }
        self.last_log_ns = self.last_log_ns.max(log_ns);
        if !self.schemas_checked.insert(channel.id) {
            return;
        }
        let ours = Topic::ALL.into_iter().filter(|t| t.name() == channel.topic);
        let expected: Vec<&str> = ours.map(Topic::schema_name).collect();
        if channel.message_encoding == "protobuf" && schema.is_empty() {
            let message = format!("{} is protobuf without a schema", channel.topic);
            let next = "write the FileDescriptorSet into the schema";
            self.add(Grade::Warning, "schema", Some(offset), message, next);
        } else if !expected.is_empty() && !expected.contains(&schema) {
            let message = format!(
                "{} carries `{schema}`, hydroline reads {} there",
                channel.topic,
                expected.join(" or ")
            );
            let next = "rename the topic or the schema; the messages are passed over";
            self.add(Grade::Warning, "schema", Some(offset), message, next);
        }
    }

    /// A message that its schema does not decode.
    pub fn undecodable(&mut self, offset: u64, topic: &str, schema: &str, reason: &str) {
        let message = format!("a message of {topic} ({schema}) does not decode: {reason}");
        let next = "the writer is at fault; the message cannot be used";
        self.add(Grade::Error, "decode", Some(offset), message, next);
    }

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

    pub fn record(&mut self, offset: u64, record: &Record) {
        match record {
            Record::FrameInfo(info) => self.frame_info(offset, info),
            Record::Frame(frame) => {
                self.frames.images += 1;
                self.frames.image_due = false;
                if frame.meta.fault.is_none() {
                    self.image(frame);
                    self.clipping.see(frame, &self.rule);
                }
            }
            Record::Command(c) => {
                self.command(c);
                self.obeyed.command(c);
            }
            Record::Echo(e) => self.obeyed.echo(e),
            Record::Clock(pair) => self.clock(pair),
            Record::Event(event) => self.event(event),
            _ => {}
        }
    }

    /// Checks that an image which nothing marks as faulty can be read.
    fn image(&mut self, frame: &Frame) {
        let frames = &mut self.frames;
        match frame.inspect(&self.rule) {
            Ok(inspected) => {
                frames.blocks.see(&inspected.seams);
                if let Err(damage) = inspected.sound(&frames.blocks.picture())
                    && frames.suspects.len() < SUSPECTS
                {
                    frames.suspects.push((frame.meta.sequence, damage));
                }
            }
            Err(error @ FrameError::Damaged { .. }) => {
                frames.damaged += 1;
                frames.first_damage.get_or_insert(error.to_string());
            }
            Err(_) => frames.short += 1,
        }
    }

    /// The driver's sequence must be explained by the gaps that the frames themselves state.
    fn frame_info(&mut self, offset: u64, info: &pb::FrameInfo) {
        let f = &mut self.frames;
        f.infos += 1;
        f.image_due = true;
        f.marked += u64::from(info.sequence_gap_before) + u64::from(info.time_gap_before);
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
        let last = self.last_command.replace(c.sequence);
        if let Some(last) = last
            && c.sequence > last.saturating_add(1)
        {
            self.command_gaps.push((last + 1, c.sequence));
        }
    }

    fn event(&mut self, event: &pb::Event) {
        let whole = |name: &str| event.values.get(name).map_or(0, |v| *v as u32);
        match event.kind.as_str() {
            "clock.step" => self.step_events += 1,
            "camera.gap" => {
                // Older logs do not state of which frame: what they report is never taken back.
                let frame = event.values.get("sequence").map(|v| *v as u32);
                *self.frames.reported_lost.entry(frame).or_default() += u64::from(whole("lost"));
            }
            "camera.gap_retracted" => {
                let frames = u64::from(whole("frames"));
                self.frames.retracted += frames;
                let frame = event.values.get("sequence").map(|v| *v as u32);
                if let (Some(_), Some(reported)) =
                    (frame, self.frames.reported_lost.get_mut(&frame))
                {
                    *reported = reported.saturating_sub(frames);
                }
            }
            "thruster.unsent" => {
                let first = whole("sequence");
                let end = first.saturating_add(whole("sets"));
                self.commands_unsent.push((first, end));
            }
            _ => {}
        }
        let counted = match messages::event_severity(event) {
            Severity::Error => &mut self.error_events,
            Severity::Warning => &mut self.warning_events,
            Severity::Info => return,
        };
        *counted.entry(event.kind.clone()).or_default() += 1;
    }

    /// Command numbers that are neither logged nor named as cut off, and those that are named.
    pub(super) fn commands_missing(&self) -> (u64, u64) {
        let (mut missing, mut named) = (0, 0);
        for (from, to) in &self.command_gaps {
            let explained: u64 = self
                .commands_unsent
                .iter()
                .map(|(first, end)| u64::from(end.min(to).saturating_sub(*first.max(from))))
                .sum();
            let all = u64::from(to - from);
            named += explained.min(all);
            missing += all.saturating_sub(explained);
        }
        (missing, named)
    }

    fn clock(&mut self, pair: &pb::ClockPair) {
        self.wide_brackets += u64::from(pair.bracket_ns > BRACKET_NS);
        let offset = i128::from(pair.realtime_ns) - i128::from(pair.monotonic_ns);
        let before = self.clock_offset_ns.replace(offset);
        if before.is_some_and(|b| (offset - b).abs() > STEP_NS) {
            self.clock_steps += 1;
        }
    }
}
