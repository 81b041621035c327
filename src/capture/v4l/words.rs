//! Events of a camera, in words and numbers.

use std::path::Path;

use super::device::{BufferInfo, Errno};
use super::stamp::{Placed, Trouble};
use crate::ControlReading;
use crate::gaps::{Note, Pause};
use crate::queue::Notice;
use hydroline_core::clock::ClockTriple;
use hydroline_core::event::{Event, Severity, kind};
use hydroline_core::frame::{FrameFault, JpegDamage, LossBefore};

/// 0 = the moment it is said.
const NOW: u64 = 0;

/// Stamp troubles that have been said; each is said once, or every frame would say it again.
#[derive(Debug, Clone, Default)]
pub(super) struct Said {
    undeclared: bool,
    future: bool,
    implausible: bool,
}

impl Said {
    pub(super) fn stamp_trouble(
        &mut self,
        placed: &Placed,
        info: &BufferInfo,
        triple: &ClockTriple,
        received_ns: u64,
    ) -> Option<Event> {
        let (said, kind, what) = match placed.trouble? {
            Trouble::Undeclared => (
                &mut self.undeclared,
                &kind::CAMERA_STAMP_CLOCK_UNKNOWN,
                "the driver does not say which clock it stamps with; near CLOCK_MONOTONIC, so taken for it",
            ),
            Trouble::Future => (
                &mut self.future,
                &kind::CAMERA_STAMP_IN_FUTURE,
                "the driver stamps frames later than they arrive; kept, but all times of this camera are off by at least that",
            ),
            Trouble::Implausible => (
                &mut self.implausible,
                &kind::CAMERA_STAMP_IMPLAUSIBLE,
                "the driver's stamp is not near CLOCK_MONOTONIC; the time of arrival is used instead",
            ),
        };
        if std::mem::replace(said, true) {
            return None;
        }
        let severity = if placed.trouble == Some(Trouble::Undeclared) {
            Severity::Info
        } else {
            Severity::Warning
        };
        let at_ns = triple.monotonic_to_unix_ns(received_ns);
        Some(
            Event::new(
                at_ns,
                severity,
                kind,
                format!(
                    "{what} (arrival - stamp = {:.4} s, frame {})",
                    placed.age_s, info.sequence
                ),
            )
            .with("age_s", placed.age_s),
        )
    }
}

pub(super) fn interlaced(field: &str) -> Event {
    Event::new(
        NOW,
        Severity::Warning,
        &kind::CAMERA_INTERLACED,
        format!(
            "the camera delivers {field} frames: odd and even rows are half a period apart, a moving stripe is split between them"
        ),
    )
}

pub(super) fn damaged(
    at_ns: u64,
    fault: FrameFault,
    damage: Option<&JpegDamage>,
    info: &BufferInfo,
    full_bytes: u32,
) -> Event {
    let what = match fault {
        FrameFault::DriverError => "is flagged as damaged by the driver",
        FrameFault::Truncated => "is cut short",
        FrameFault::BrokenJpeg => "is no whole JPEG",
        FrameFault::Stale => "may be stale",
    };
    let why = damage.map_or_else(String::new, |damage| format!(": {damage}"));
    let what = format!("{what}{why}");
    let message = format!(
        "frame {} {what} ({} of at most {full_bytes} bytes); kept, excluded from analysis",
        info.sequence, info.bytes_used
    );
    Event::new(at_ns, Severity::Warning, &kind::CAMERA_ERROR_FRAME, message)
        .with("sequence", f64::from(info.sequence))
        .with("bytes_used", f64::from(info.bytes_used))
}

pub(super) fn gap(at_ns: u64, sequence: u32, lost: LossBefore, period_s: f64) -> Event {
    let total = lost.sequence_gap + lost.time_gap;
    let message = format!(
        "{total} frame(s) lost before frame {sequence}: {} missing in the driver's sequence, {} dropped by the device without one",
        lost.sequence_gap, lost.time_gap
    );
    Event::new(at_ns, Severity::Error, &kind::CAMERA_GAP, message)
        .with("sequence", f64::from(sequence))
        .with("lost", f64::from(total))
        .with("sequence_gap", f64::from(lost.sequence_gap))
        .with("time_gap", f64::from(lost.time_gap))
        .with("gap_s", (f64::from(total) + 1.0) * period_s)
}

pub(super) fn note(at_ns: u64, note: &Note) -> Option<Event> {
    Some(match note {
        Note::RateChanged { from_period_s, to_period_s } => Event::new(
            at_ns,
            Severity::Warning,
            &kind::CAMERA_RATE_CHANGED,
            format!("the frame rate went from {:.3} to {:.3} frames/s (automatic exposure?)", 1.0 / from_period_s, 1.0 / to_period_s),
        )
        .with("from_fps", 1.0 / from_period_s)
        .with("to_fps", 1.0 / to_period_s),
        Note::Renumbered { from, to } => Event::new(
            at_ns,
            Severity::Warning,
            &kind::CAMERA_RENUMBERED,
            format!("the driver's sequence went from {from} to {to}, which the time does not explain; losses here are counted by time"),
        )
        .with("from", f64::from(*from))
        .with("to", f64::from(*to)),
        Note::Retracted { sequence, frames } => Event::new(
            at_ns,
            Severity::Info,
            &kind::CAMERA_GAP_RETRACTED,
            format!("{frames} of the frame(s) marked lost before frame {sequence} were not lost there: it was late, or the rate had changed; the account is corrected"),
        )
        .with("sequence", f64::from(*sequence))
        .with("frames", *frames as f64),
        Note::Repeated { sequence } => Event::new(
            at_ns,
            Severity::Warning,
            &kind::CAMERA_REPEATED,
            format!("frame {sequence} came twice in one period: the second is kept, marked stale, and not counted"),
        )
        .with("sequence", f64::from(*sequence)),
        Note::Leftover { sequence } => Event::new(
            at_ns,
            Severity::Info,
            &kind::CAMERA_LEFTOVER,
            format!("the first frame ({sequence}) was left over from before the start: kept, but neither received nor lost"),
        ),
        Note::Resumed { pause, gap_s, lost } => {
            let why = match pause {
                Pause::Frozen => "having stood still",
                Pause::Restarted => "a restart of the stream",
                Pause::Unplugged => "having been unplugged",
            };
            Event::new(
                at_ns,
                Severity::Info,
                &kind::CAMERA_RESUMED,
                format!("frames again after {why}: {gap_s:.3} s without one, {lost} periods lost"),
            )
            .with("gap_s", *gap_s)
            .with("lost", *lost as f64)
        }
        Note::Second(s) => {
            let balanced = s.received + s.lost == s.expected;
            let (severity, kind, message) = if balanced {
                (Severity::Info, &kind::CAMERA_COUNTS, format!("{} received + {} lost = {} expected", s.received, s.lost, s.expected))
            } else {
                let off = (s.received + s.lost) as i64 - s.expected as i64;
                (
                    Severity::Error,
                    &kind::CAMERA_COUNT_DISAGREES,
                    format!(
                        "{} received + {} lost, but time says {} ({off:+}): the driver's sequence and stamps contradict each other",
                        s.received, s.lost, s.expected
                    ),
                )
            };
            Event::new(at_ns, severity, kind, message)
                .with("from_s", s.from_s)
                .with("span_s", s.span_s)
                .with("received", s.received as f64)
                .with("lost", s.lost as f64)
                .with("expected", s.expected as f64)
        }
    })
}

pub(super) fn notice(notice: &Notice, node: &Path) -> Option<Event> {
    let node = node.display();
    Some(match notice {
        Notice::Started | Notice::Gone { .. } => return None,
        Notice::Frozen {
            silence_ns,
            attempt,
        } => Event::new(
            NOW,
            Severity::Error,
            &kind::CAMERA_FROZEN,
            format!(
                "{node}: no frame for {:.3} s; restarting the stream (attempt {attempt})",
                *silence_ns as f64 / 1e9
            ),
        )
        .with("silence_s", *silence_ns as f64 / 1e9)
        .with("attempt", f64::from(*attempt)),
        Notice::Failed {
            call,
            errno,
            attempt,
            back_off_ns,
        } => Event::new(
            NOW,
            Severity::Error,
            &kind::CAMERA_STREAM_ERROR,
            format!(
                "{node}: {call}: {}; restarting the stream in {} ms (attempt {attempt})",
                Errno(*errno),
                back_off_ns / 1_000_000
            ),
        )
        .with("errno", f64::from(*errno))
        .with("attempt", f64::from(*attempt))
        .with("back_off_s", *back_off_ns as f64 / 1e9),
        Notice::Voided => Event::new(
            NOW,
            Severity::Error,
            &kind::CAMERA_VOID_BUFFERS,
            format!(
                "{node}: the driver gave buffers back without a frame in them and has given up on the stream; restarting it"
            ),
        ),
        Notice::Refused { index, errno } => Event::new(
            NOW,
            Severity::Warning,
            &kind::CAMERA_BUFFER_REFUSED,
            format!(
                "{node}: VIDIOC_QBUF of buffer {index}: {}; it is tried again",
                Errno(*errno)
            ),
        )
        .with("errno", f64::from(*errno)),
        Notice::Nonsense { index } => Event::new(
            NOW,
            Severity::Error,
            &kind::CAMERA_DRIVER_NONSENSE,
            format!(
                "{node}: the driver handed out buffer {index}, which it did not have; restarting the stream"
            ),
        ),
    })
}

pub(super) fn unplugged(node: &Path, errno: i32) -> Event {
    Event::new(
        NOW,
        Severity::Error,
        &kind::CAMERA_UNPLUGGED,
        format!(
            "{} is gone ({}); looking for it every 200 ms, the recording goes on",
            node.display(),
            Errno(errno)
        ),
    )
    .with("errno", f64::from(errno))
}

pub(super) fn replugged(node: &Path, gone_s: f64) -> Event {
    Event::new(
        NOW,
        Severity::Warning,
        &kind::CAMERA_REPLUGGED,
        format!(
            "the camera is back as {} after {gone_s:.3} s, with the rig's format and controls",
            node.display()
        ),
    )
    .with("gap_s", gone_s)
}

pub(super) fn reopen_failed(reason: &str) -> Event {
    Event::new(
        NOW,
        Severity::Error,
        &kind::CAMERA_REOPEN_FAILED,
        format!("the camera is back but cannot be used yet: {reason}"),
    )
}

pub(super) fn control_changed(control: &ControlReading, before: i64, now: i64) -> Event {
    let asked = control.asked.unwrap_or(before);
    Event::new(
        NOW,
        Severity::Warning,
        &kind::CAMERA_CONTROL_CHANGED,
        format!("control `{}` changed from {before} to {now} behind our back (the rig asks for {asked})", control.name),
    )
    .with("from", before as f64)
    .with("to", now as f64)
    .with("asked", asked as f64)
}
