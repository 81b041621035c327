//! Events of a log, read as far as somebody looks.

use crate::viewed::{Viewed, places_of};
use hydroline_core::lock::Lock;
use hydroline_log::Topic;
use hydroline_log::messages::pb;
use prost::Message;
use serde::Serialize;

/// Events that are kept: of a log with more, the first ones.
const KEPT_MAX: usize = 5000;

/// Something that happened.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ShownEvent {
    /// Since the log's zero \[s\].
    pub t_s: f64,
    /// `info`, `warning`, `error`.
    pub severity: &'static str,
    /// The machine word.
    pub kind: String,
    /// One sentence.
    pub message: String,
}

/// The events so far.
#[derive(Debug, Default)]
pub(crate) struct Events {
    found: Vec<ShownEvent>,
    /// Places read.
    next: usize,
}

impl Viewed {
    /// Events in the order of time, and the share of the places with events that they were read from. Reads on while `more` says
    /// so, one place at the least.
    pub fn events(&self, more: impl Fn() -> bool) -> (f64, Vec<ShownEvent>) {
        let channels = self.channels_of(Topic::Event);
        let places = places_of(self.log(), &channels);
        let mut events = self.events.held();
        while let Some(place) = places.get(events.next).copied() {
            if events.found.len() >= KEPT_MAX {
                events.next = places.len();
                self.note(format!("only the first {KEPT_MAX} events are shown"));
                break;
            }
            let messages = self.messages(place, &channels);
            for message in &messages {
                let at_ns = self.since_zero(self.stamp_ns(message));
                match pb::Event::decode(message.data.clone()) {
                    Ok(event) => events.found.push(shown(at_ns, event)),
                    Err(why) => self.note(format!("an event is not decoded: {why}")),
                }
            }
            events.next += 1;
            if !more() {
                break;
            }
        }
        events.found.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
        let read = match places.len() {
            0 => 1.0,
            all => events.next as f64 / all as f64,
        };
        (read, events.found.clone())
    }
}

fn shown(at_ns: i64, event: pb::Event) -> ShownEvent {
    use pb::event::Severity;
    ShownEvent {
        t_s: at_ns as f64 * 1e-9,
        severity: match event.severity() {
            Severity::Info => "info",
            Severity::Warning => "warning",
            Severity::Error => "error",
        },
        kind: event.kind,
        message: event.message,
    }
}
