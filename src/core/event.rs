//! What happened to the daemon itself: goes to `/daemon/event`, never dropped.

use std::borrow::Cow;

/// How bad it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// Worth knowing.
    Info,
    /// Degraded, nothing lost.
    Warning,
    /// Something was lost or a part stopped working.
    Error,
}

/// One event.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// When it was true, UNIX \[ns\].
    pub timestamp_ns: u64,
    /// How bad.
    pub severity: Severity,
    /// Stable machine word, `part.what`: `camera.unplugged`, `camera.replugged`, `camera.frozen`, `camera.gap`,
    /// `camera.error_frame`, `camera.control_changed`, `serial.lost`, `serial.back`, `thruster.neutral`,
    /// `clock.step`, `log.rotated`, `log.frames_dropped`, `disk.low` ...
    pub kind: &'static str,
    /// One sentence for a person, with the numbers in it.
    pub message: String,
    /// Numbers for a machine, e.g. ("lost", 3.0), ("gap_s", 0.12).
    pub values: Vec<(Cow<'static, str>, f64)>,
}

impl Event {
    /// A new event without numbers.
    pub fn new(
        timestamp_ns: u64,
        severity: Severity,
        kind: &'static str,
        message: impl Into<String>,
    ) -> Self {
        Self {
            timestamp_ns,
            severity,
            kind,
            message: message.into(),
            values: Vec::new(),
        }
    }

    /// Adds a number.
    #[must_use]
    pub fn with(mut self, name: impl Into<Cow<'static, str>>, value: f64) -> Self {
        self.values.push((name.into(), value));
        self
    }
}
