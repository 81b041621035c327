//! Account of received, lost and written frames and messages: the numbers of the closing `summary`.

use std::collections::BTreeMap;
use std::path::PathBuf;

use super::part::MetadataMap;
use super::topic::Topic;
use hydroline_core::frame::Frame;

/// Frames as the camera should have delivered them. Exact: `received + lost = expected`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct FrameLedger {
    /// Frames the camera should have delivered.
    pub expected: u64,
    /// Frames the daemon got.
    pub received: u64,
    /// Frames it did not get, by cause, e.g. `sequence_gap`, `time_gap`, `unplugged`.
    pub lost: BTreeMap<String, u64>,
}

impl FrameLedger {
    /// Counts a frame and the losses noticed before it.
    pub fn count(&mut self, frame: &Frame) {
        let before = frame.meta.lost_before;
        self.received += 1;
        self.expected += 1;
        for (cause, n) in [
            ("sequence_gap", before.sequence_gap),
            ("time_gap", before.time_gap),
        ] {
            if n > 0 {
                *self.lost.entry(cause.to_owned()).or_default() += u64::from(n);
                self.expected += u64::from(n);
            }
        }
    }

    /// Takes back losses that were counted with an earlier frame: it was late.
    pub fn retract(&mut self, frames: u64) {
        let Some(counted) = self.lost.get_mut("time_gap") else {
            return;
        };
        let back = frames.min(*counted);
        *counted -= back;
        self.expected -= back;
        if *counted == 0 {
            self.lost.remove("time_gap");
        }
    }
}

/// Live counters of a recording.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Counts {
    /// Frames as far as the log saw them arrive.
    pub frames: FrameLedger,
    /// Frames that came with a fault (kept, excluded from analysis).
    pub frames_faulty: u64,
    /// Frames dropped because the queue was full.
    pub frames_dropped: u64,
    /// Derived messages dropped because the queue was full, by topic name: `replay` computes them again.
    pub derived_dropped: BTreeMap<&'static str, u64>,
    /// Messages in the file(s) by topic name, open chunk included.
    pub messages: BTreeMap<&'static str, u64>,
    /// Messages that could not be written (disk full or failed), by topic name.
    pub unwritten: BTreeMap<&'static str, u64>,
    /// Entries that came after the recording had ended.
    pub after_end: u64,
    /// Bytes in the file(s).
    pub bytes: u64,
    /// Bytes waiting in the queue now.
    pub queue_bytes: u64,
    /// Most bytes that ever waited.
    pub queue_peak_bytes: u64,
    /// Reason why writing stopped before the end, if it did.
    pub stopped: Option<String>,
}

impl Counts {
    /// Whether anything that should be in the log is not; what can be computed again is not meant.
    pub fn lost_anything(&self) -> bool {
        self.frames_dropped > 0 || !self.unwritten.is_empty()
    }
}

/// Account of the recording that the log cannot count itself, given when it ends.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SummaryInput {
    /// Reason why the recording ended, e.g. `plan done`, `ctrl-c`, `SIGTERM`, `limit x`.
    pub stop_reason: String,
    /// Whether that was an orderly end.
    pub clean: bool,
    /// The capture's own ledger; `None` = what the log counted from the frames it was given.
    pub frames: Option<FrameLedger>,
    /// Anything else worth keeping, e.g. frames not extracted live.
    pub more: MetadataMap,
}

impl SummaryInput {
    /// An orderly end.
    pub fn clean(stop_reason: impl Into<String>) -> Self {
        Self {
            stop_reason: stop_reason.into(),
            clean: true,
            frames: None,
            more: MetadataMap::new(),
        }
    }
}

/// A file of the log that is not under its name any more: somebody renamed, removed or covered it meanwhile.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Misplaced {
    /// Sentence that says what happened to the name.
    pub what: String,
    /// Path of the data now; `None` = it could not be saved.
    pub now: Option<PathBuf>,
}

impl std::fmt::Display for Misplaced {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.now {
            Some(now) => write!(f, "{}; the data is in {}", self.what, now.display()),
            None => write!(f, "{}; the data could not be saved", self.what),
        }
    }
}

/// Outcome of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct LogOutcome {
    /// Files written, in order.
    pub files: Vec<PathBuf>,
    /// Something that should be in the log is not (exit code 3).
    pub lost: bool,
    /// Reason why writing stopped before the end, if it did.
    pub stopped: Option<String>,
    /// Files that are not where they were written (exit code 1).
    pub misplaced: Vec<Misplaced>,
    /// Final counters.
    pub counts: Counts,
}

/// Metadata `summary` of one part. `messages.*` are of this part. `frames.*` of the last part are
/// of the whole recording: `received + sum(lost.*) = expected`, `logged + sum(dropped.*) = received`.
/// In the parts before they are called `frames_so_far.*`: counted on arrival, so that some of what
/// is received there still waits in the queue and is logged in a later part.
pub(super) fn summary_map(
    counts: &Counts,
    part_messages: &BTreeMap<Topic, u64>,
    part: u32,
    last: bool,
    input: &SummaryInput,
) -> MetadataMap {
    let mut map = input.more.clone();
    let frames = input.frames.as_ref().unwrap_or(&counts.frames);
    let mut put = |key: String, value: String| map.insert(key, value);
    let ledger = if last { "frames" } else { "frames_so_far" };
    put("part.number".into(), part.to_string());
    put("part.last".into(), last.to_string());
    put("stop.reason".into(), input.stop_reason.clone());
    put("stop.clean".into(), input.clean.to_string());
    put(format!("{ledger}.expected"), frames.expected.to_string());
    put(format!("{ledger}.received"), frames.received.to_string());
    for (cause, n) in &frames.lost {
        put(format!("{ledger}.lost.{cause}"), n.to_string());
    }
    let image = Topic::RawImage.name();
    let logged = counts.messages.get(image).copied().unwrap_or(0);
    let mut on_disk_refusal = counts.unwritten.get(image).copied().unwrap_or(0);
    if counts.stopped.is_some() {
        // The file closes before the queue is empty: what waits there will not be written either.
        let accounted = counts.frames_dropped + on_disk_refusal + logged;
        on_disk_refusal += frames.received.saturating_sub(accounted);
    }
    put(
        format!("{ledger}.dropped.queue"),
        counts.frames_dropped.to_string(),
    );
    put(
        format!("{ledger}.dropped.disk"),
        on_disk_refusal.to_string(),
    );
    put(format!("{ledger}.faulty"), counts.frames_faulty.to_string());
    put(format!("{ledger}.logged"), logged.to_string());
    let mut total = 0;
    let mut by_name: BTreeMap<&str, u64> = BTreeMap::new();
    for (topic, n) in part_messages {
        *by_name.entry(topic.name()).or_default() += n;
        total += n;
    }
    for (topic, n) in by_name {
        put(format!("messages.{topic}"), n.to_string());
    }
    put("messages.total".into(), total.to_string());
    for (topic, n) in &counts.unwritten {
        put(format!("unwritten.{topic}"), n.to_string());
    }
    for (topic, n) in &counts.derived_dropped {
        put(format!("derived.dropped.queue.{topic}"), n.to_string());
    }
    put(
        "queue.peak_bytes".into(),
        counts.queue_peak_bytes.to_string(),
    );
    if let Some(why) = &counts.stopped {
        put("stop.disk".into(), why.clone());
    }
    map
}
