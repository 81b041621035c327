//! Events of the daemon itself: go to `/daemon/event`, never dropped.

pub mod kind;

pub use kind::{EventKind, EventValue};

use std::borrow::Cow;

/// Severity of an event.
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
    /// Severity of the event.
    pub severity: Severity,
    /// Kind, from the list of [`kind`].
    pub kind: &'static EventKind,
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
        kind: &'static EventKind,
        message: impl Into<String>,
    ) -> Self {
        debug_assert!(
            kind.severities.contains(&severity),
            "{} is never {severity:?} by its entry in event/kind",
            kind.name
        );
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
        let name = name.into();
        debug_assert!(
            self.kind.carries(&name),
            "{} does not carry {name} by its entry in event/kind",
            self.kind.name
        );
        self.values.push((name, value));
        self
    }
}
