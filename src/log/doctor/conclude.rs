//! Checks that need the whole file: the ledger, the counts, the head.

use super::checks::{BRACKET_NS, Checks};
use super::{Finding, Grade};
use crate::info::utc;
use crate::part::MetadataMap;
use crate::scan::Learnt;
use crate::seal::{DAMAGED_KEY, SealState};
use hydroline_core::clock::clock_error;
use hydroline_core::event::kind;
use hydroline_core::frame::FrameError;

fn is_recovered(summary: &MetadataMap) -> bool {
    summary.get("recovered").is_some_and(|v| v == "true")
}

/// Frames known to be missing in a recovered log; `None` for any other.
pub(super) fn recovered_lost(summary: &MetadataMap) -> Option<u64> {
    let number = |key: &str| summary.get(key).and_then(|v| v.parse::<u64>().ok());
    if !is_recovered(summary) {
        return None;
    }
    let lost = number("frames.expected")?.saturating_sub(number("frames.received")?);
    Some(lost + number("frames.dropped.unknown").unwrap_or(0))
}

fn sum(summary: &MetadataMap, prefix: &str) -> u64 {
    let values = summary.iter().filter(|(k, _)| k.starts_with(prefix));
    values
        .filter_map(|(_, v)| v.parse::<u64>().ok())
        .fold(0, u64::saturating_add)
}

/// The summary's frame ledger: a part that is not the last states a running count (parts of older logs: under `frames`).
fn ledger_of(summary: &MetadataMap) -> &'static str {
    if summary.contains_key("frames_so_far.received") {
        "frames_so_far"
    } else {
        "frames"
    }
}

impl Checks {
    /// Frames that did not get into the file, as far as it states.
    pub(super) fn frames_lost(&self, learnt: &Learnt) -> u64 {
        let marked = self.frames.marked.saturating_sub(self.frames.retracted);
        let stated = learnt.metadata.get("summary").map_or(0, |summary| {
            let ledger = format!("{}.lost.", ledger_of(summary));
            recovered_lost(summary)
                .unwrap_or(0)
                .max(sum(summary, &ledger))
        });
        marked.max(stated)
    }

    /// All findings, with those of the checks that need the whole file; `now_ns` = the host's time, UNIX.
    pub fn conclude(mut self, learnt: &Learnt, now_ns: u64) -> Vec<Finding> {
        let ours = learnt.library.starts_with("hydroline") || learnt.metadata.contains_key("rig");
        self.log_times(ours);
        self.frames_and_commands(
            learnt
                .metadata
                .get("session")
                .and_then(|s| s.get("replay.of")),
            learnt.metadata.get("summary").is_some_and(is_recovered),
        );
        self.clocks();
        self.date(now_ns, ours);
        let mut errors = std::mem::take(&mut self.error_events);
        // A frame that was only late is reported as lost first and taken back by the next one.
        let reported = &self.frames.reported_lost;
        if !reported.is_empty() && reported.values().all(|lost| *lost == 0) {
            errors.remove(kind::CAMERA_GAP.name);
        }
        for (kind, n) in errors {
            let message = format!("the daemon reported {n} x `{kind}`");
            let next = "`hydroline export` lists the events with their times";
            self.warning("event", message, next);
        }
        self.obeyed();
        if let Some(words) = self.clipping.words() {
            let next = "a rig with the channel, or a shorter exposure; `hydroline replay --rig` reads these frames by it";
            self.note("clipping", words, next);
        }
        let warnings = std::mem::take(&mut self.warning_events);
        if !warnings.is_empty() {
            let counted: Vec<String> = warnings
                .iter()
                .map(|(k, n)| format!("{n} x `{k}`"))
                .collect();
            self.note(
                "event",
                format!("the daemon warned of {}", counted.join(", ")),
                "`hydroline export` lists the events with their times",
            );
        }
        if ours {
            for name in ["rig", "calibration", "session"] {
                if !learnt.head_metadata.iter().any(|n| n == name) {
                    let message = format!("metadata `{name}` does not stand at the head");
                    let next = "name the rig with --rig when you use this log";
                    self.warning("head", message, next);
                }
            }
        }
        for finding in learnt.seal_findings() {
            let (grade, next) = match finding.state {
                SealState::Altered | SealState::Missing => (
                    Grade::Error,
                    "do not trust it: give --rig and --calibration from their files when you use this log",
                ),
                SealState::Unverifiable => (
                    Grade::Note,
                    "a log of an older daemon: compare it with the file that the recording was made with, if it matters",
                ),
            };
            self.add(grade, "metadata", None, finding.to_string(), next);
        }
        let session = learnt.metadata.get("session").into_iter().flatten();
        for (_, words) in session.filter(|(key, _)| key.starts_with(DAMAGED_KEY)) {
            self.error(
                "metadata",
                format!("replayed from a log in which {words}"),
                "replay the original again with --rig and --calibration from their files",
            );
        }
        match learnt.metadata.get("summary") {
            Some(summary) => self.ledger(summary),
            None if ours && !self.cut => {
                let message = "the file is whole but holds no `summary`: its recording was not stopped cleanly".to_owned();
                let next = "losses are not accounted for; see the frame and command gaps";
                self.warning("summary", message, next);
            }
            None => {}
        }
        if learnt.ended && learnt.statistics.is_none() && !self.damaged {
            let message =
                "the file holds no index (its disk failed, or its writer makes none)".to_owned();
            let next = "`hydroline recover` writes one with an index, if a viewer wants it";
            self.note("summary", message, next);
        }
        if learnt.chunks_unchecked > 0 && !learnt.data_crc_stated {
            let message = format!(
                "{} of {} chunks carry no checksum: damage inside them cannot be noticed",
                learnt.chunks_unchecked, learnt.chunks
            );
            let next = "have the writer state chunk checksums, or keep a checksum of the file";
            self.note("unchecked", message, next);
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

    /// `replay_of` = the log that this one is a replay of: it need not hold the images.
    fn frames_and_commands(&mut self, replay_of: Option<&String>, recovered: bool) {
        let (infos, images) = (self.frames.infos, self.frames.images);
        if let (Some(of), true) = (replay_of, infos > 0 && images == 0) {
            let message = format!("a replay of {of} without its images ({infos} frame infos)");
            let next = "the images are in that log; `hydroline replay --keep-images` copies them";
            self.note("image", message, next);
        } else if recovered && self.frames.image_due && infos == images + 1 {
            let message = format!(
                "the last frame's image was cut off with the file: {images} images, {infos} frame infos"
            );
            self.warning(
                "image",
                message,
                "that one frame is lost; the others are whole",
            );
        } else if infos > 0 && infos != images {
            let message = format!("{images} images but {infos} frame infos");
            let next =
                "frames are incomplete at the end of a cut file; elsewhere the file lost messages";
            self.error("image", message, next);
        }
        if self.frames.short > 0 {
            let message = format!(
                "{} images hold fewer bytes than their size needs, unmarked",
                self.frames.short
            );
            let next = "exclude them; the writer should have marked them";
            self.error("image", message, next);
        }
        let picture = self.frames.blocks.picture();
        let damaged = self.frames.damaged + self.frames.blocks.damaged();
        if damaged > 0 {
            let suspects = std::mem::take(&mut self.frames.suspects);
            let of_blocks = suspects
                .into_iter()
                .find(|(_, damage)| !picture.explains(damage))
                .map(|(sequence, damage)| FrameError::Damaged { sequence, damage }.to_string());
            let one = self.frames.first_damage.take().or(of_blocks);
            let message = format!(
                "{damaged} images are damaged and not marked as faulty{}",
                one.map_or_else(String::new, |words| format!(", one of them: {words}"))
            );
            let next = "no command reads them; if there are many, check the camera's cable and what the log was copied from";
            self.error("image", message, next);
        }
        if let Some(words) = picture.words() {
            let message = format!(
                "in {} of {images} images, {words}",
                self.frames.blocks.explained()
            );
            let next = "nothing, where the camera or a recorder draws over the picture; turn that off, or look at the images";
            self.note("image", message, next);
        }
        if self.frames.faulty > 0 {
            let message = format!(
                "{} of {infos} frames are marked faulty and excluded from analysis",
                self.frames.faulty
            );
            let next = "check cable and bandwidth if there are many";
            self.note("image", message, next);
        }
        if self.frames.index_gaps > 0 {
            let message = format!(
                "{} frames reached the daemon but not the file",
                self.frames.index_gaps
            );
            let next = "the disk was too slow or full; see events `log.frames_dropped`, `disk.low`";
            self.warning("frame_gap", message, next);
        }
        let (missing, cut_off) = self.commands_missing();
        if cut_off > 0 {
            let message = format!(
                "{cut_off} command numbers were cut off with the link, as event `thruster.unsent` says"
            );
            let next = "the controller may have got part of them; its watchdog went to neutral";
            self.note("command_gap", message, next);
        }
        if missing > 0 {
            let message = format!("{missing} commands are missing by their sequence numbers");
            let next = "do not identify or diagnose across the gap";
            self.error("command_gap", message, next);
        }
    }

    fn obeyed(&mut self) {
        for found in self.obeyed.contradicted() {
            let message = format!(
                "{}: the controller contradicted the commands for {:.2} s: sent {:.2} us, it said {:.2} us",
                found.thruster, found.for_s, found.sent_us, found.echo_us
            );
            let next = "the commands are not what drove the vehicle: do not identify or diagnose from this stretch; check the controller's own limits and who else drives it";
            self.error("echo", message, next);
        }
        let (differ, compared) = (self.obeyed.differ, self.obeyed.compared);
        if differ > 0 {
            self.note(
                "echo",
                format!(
                    "{differ} of {compared} echoes say another pulse than the command they answer"
                ),
                "check the cable if there are many",
            );
        }
    }

    /// Whether the log's first or last message can have been stamped by a clock that was set.
    /// A log of another program may count from any zero.
    fn date(&mut self, now_ns: u64, ours: bool) {
        let Some(first_ns) = self.first_log_ns else {
            return;
        };
        let ends = [first_ns, self.last_log_ns];
        let wrong = ends
            .into_iter()
            .find_map(|ns| Some((ns, clock_error(ns, now_ns)?)));
        let Some((ns, reason)) = wrong else {
            return;
        };
        let message = format!("stamped {}: {reason}", utc(ns));
        let next = "times within the log hold, the date does not: `campaign` gives it no day; set the clock (NTP, a battery) before the next run";
        let grade = if ours { Grade::Warning } else { Grade::Note };
        self.add(grade, "clock", None, message, next);
    }

    fn clocks(&mut self) {
        let steps = self.clock_steps.max(self.step_events);
        if steps > 0 {
            let message = format!("the realtime clock was set {steps} times by more than 10 ms");
            let next =
                "compare stamps only within the stretches between; stop NTP steps during runs";
            self.warning("clock", message, next);
        }
        if self.wide_brackets > 0 {
            let message = format!(
                "{} clock readings took longer than {} us",
                self.wide_brackets,
                BRACKET_NS / 1000
            );
            let next = "those readings are that uncertain; the host was busy";
            self.note("clock", message, next);
        }
    }

    /// A recovered log's summary says what is left, not how the recording ended.
    fn recovered(&mut self, summary: &MetadataMap) {
        let lost = recovered_lost(summary).unwrap_or(0);
        let message = format!(
            "the recording broke off and was recovered: {lost} frames are known to be missing, and what was in memory at the end (at most 3 frames and the last command)"
        );
        let next = "what is in the file is sound; metadata `recovered` says from which file and what was damaged";
        self.note("summary", message, next);
    }

    /// `received + lost = expected`, `logged + dropped = received`, and the file agrees.
    fn ledger(&mut self, summary: &MetadataMap) {
        let number = |key: &str| summary.get(key).and_then(|v| v.parse::<u64>().ok());
        let sum = |prefix: &str| sum(summary, prefix);
        if is_recovered(summary) {
            self.recovered(summary);
        } else if summary.get("stop.clean").map(String::as_str) != Some("true") {
            let why = summary
                .get("stop.reason")
                .map_or("not stated", String::as_str);
            let message = format!("the recording did not end in order: {why}");
            let next = "what is in the file is sound; see the event before the end";
            self.warning("summary", message, next);
        }
        let ledger = ledger_of(summary);
        let (received, expected) = (
            number(&format!("{ledger}.received")),
            number(&format!("{ledger}.expected")),
        );
        let (Some(received), Some(expected)) = (received, expected) else {
            self.warning(
                "ledger",
                "the summary states no frame ledger".to_owned(),
                "losses are not accounted for",
            );
            return;
        };
        let lost = sum(&format!("{ledger}.lost."));
        if received + lost != expected {
            let message =
                format!("frames: received {received} + lost {lost} is not expected {expected}");
            let next = "the capture lost count; report it as a bug";
            self.error("ledger", message, next);
        } else if lost > 0 {
            let message =
                format!("{lost} of {expected} frames were lost before they reached the daemon");
            let next = "their places are marked in the frames after them";
            self.note("ledger", message, next);
        }
        let is_only_part = summary.get("part.number").map(String::as_str) == Some("0")
            && summary.get("part.last").map(String::as_str) == Some("true");
        if let (Some(logged), true) = (number("frames.logged"), is_only_part) {
            let dropped = sum("frames.dropped.");
            // Kept, but with no place in time: a buffer from before the start, a frame handed out twice.
            let outside =
                number("frames.leftover").unwrap_or(0) + number("frames.repeated").unwrap_or(0);
            if logged + dropped != received + outside {
                let message = format!(
                    "frames: logged {logged} + dropped {dropped} is not received {received} + leftover and repeated {outside}"
                );
                self.error("ledger", message, "the log lost count; report it as a bug");
            }
        }
        // A dropped frame takes its mark along; logs of older daemons do not state what no frame can be marked with.
        if let (Some(at_end), true) = (number("frames.lost_at_end"), is_only_part)
            && sum("frames.dropped.") == 0
        {
            let (marked, retracted) = (self.frames.marked, self.frames.retracted);
            if marked + at_end != lost + retracted {
                let message = format!(
                    "frames: {marked} marked as lost - {retracted} taken back + {at_end} after the last frame is not lost {lost}"
                );
                let next = "the marks on the frames and the account contradict each other; report it as a bug";
                self.error("ledger", message, next);
            }
        }
        let derived = sum("derived.dropped.");
        if derived > 0 {
            let message =
                format!("{derived} profiles and annotations were dropped, the queue was full");
            let next = "`hydroline replay` computes them again from the images";
            self.note("derived", message, next);
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
                let next = "messages were lost from the file after it was written";
                self.error("ledger", message, next);
            }
        }
    }
}
