//! Without a line: closing, looking for it again, coming back with neutral first.

use super::{AWAY_NS, Core, Flow, REOPEN_NS};
use crate::link::ThrusterLink;
use crate::safety::{NeutralReason, State};
use hydroline_core::event::{Severity, kind};
use hydroline_rigs::{Link, LinkKind};
use std::time::Duration;

/// Said once per service: the setting is in the controller's memory and its protocol cannot read it back.
const MAESTRO_TIMEOUT: &str = "a Maestro goes to neutral on a dead link only if its own serial timeout is set, which cannot be \
    read back: in the Pololu Maestro Control Center set Serial Settings > Timeout (0 = off) and, for each channel, \
    Channel Settings > On startup or error: Go to 1500 us (the rig's neutral); then pull the cable once to see it work";

/// Sentence about the controller's own behaviour while the link is gone.
pub(super) fn watchdog_words(link: &Link) -> String {
    match link.kind {
        // Configured by us at every opening of the line.
        LinkKind::Stamped => format!(
            "the controller's own watchdog ({:.0} ms) goes to neutral",
            link.timeout_s * 1e3
        ),
        LinkKind::Maestro => "the Maestro goes to neutral only if its serial timeout is set; \
            see thruster.maestro_timeout at the start"
            .into(),
        LinkKind::Mavlink => "the autopilot drives on by itself".into(),
    }
}

impl Core {
    pub(super) fn disconnected(&mut self) -> Flow {
        self.run_plan();
        if self.farewell_ns.is_some() {
            return self.farewell();
        }
        let now_ns = self.now();
        if now_ns < self.next_open_ns {
            self.clock.sleep(Duration::from_nanos(
                AWAY_NS.min(self.next_open_ns - now_ns),
            ));
            return Flow::Continue;
        }
        self.next_open_ns = now_ns + REOPEN_NS;
        self.shared.stats(|s| s.open_attempts += 1);
        match (self.opener)() {
            Ok(opened) => {
                let Some(protocol) = self.protocol.take() else {
                    return Flow::Continue;
                };
                // A write is a few hundred bytes at most: 100 ms without progress is a stuck line.
                let mut link =
                    ThrusterLink::new(protocol, opened.transport, Duration::from_millis(100));
                if let Err(error) = link.open() {
                    self.protocol = Some(link.into_protocol());
                    self.noisy(Severity::Warning, &kind::SERIAL_OPEN, |n| {
                        (
                            format!("{} opens but takes no bytes: {error}", opened.name),
                            vec![("count", n as f64)],
                        )
                    });
                    return Flow::Continue;
                }
                self.link = Some(link);
                if let Some(low_latency) = opened.low_latency {
                    let severity = if low_latency.good() {
                        Severity::Info
                    } else {
                        Severity::Warning
                    };
                    self.event(
                        severity,
                        &kind::SERIAL_LOW_LATENCY,
                        format!("{}: {low_latency}", opened.name),
                        &[],
                    );
                }
                // Neutral is the first command on any line, new or old.
                self.send_neutral(self.reason_after_opening());
                self.back(&format!("{} is open", opened.name));
            }
            Err(error) => {
                self.noisy(Severity::Warning, &kind::SERIAL_OPEN, |n| {
                    (error.to_string(), vec![("attempts", n as f64)])
                });
            }
        }
        Flow::Continue
    }

    pub(super) fn reason_after_opening(&self) -> NeutralReason {
        if self.ever_open {
            NeutralReason::Lost
        } else {
            NeutralReason::Idle
        }
    }

    /// The link works (again): at neutral until armed, or on with the plan.
    pub(super) fn back(&mut self, how: &str) {
        self.safety.regain(self.reason_after_opening());
        if !self.ever_open {
            self.ever_open = true;
            self.event(Severity::Info, &kind::SERIAL_OPEN, how.to_owned(), &[]);
            if self.config.set.link.kind == LinkKind::Maestro {
                self.event(
                    Severity::Warning,
                    &kind::THRUSTER_MAESTRO_TIMEOUT,
                    MAESTRO_TIMEOUT.into(),
                    &[],
                );
            }
        } else if let Some(lost_ns) = self.lost_ns.take() {
            let away_s = self.now().saturating_sub(lost_ns) as f64 * 1e-9;
            let first = match self.config.set.link.follows() {
                true => "",
                false => "; neutral first",
            };
            self.event(
                Severity::Info,
                &kind::SERIAL_BACK,
                format!("{how} after {away_s:.3} s{first}"),
                &[("away_s", away_s)],
            );
        }
    }

    /// The line is gone: closes it (an open descriptor would make the replugged node another one).
    pub(super) fn lose(&mut self, why: &str) {
        if let Some(link) = self.link.take() {
            self.protocol = Some(link.into_protocol());
        }
        self.next_open_ns = self.now() + REOPEN_NS;
        self.neutral_open = None;
        self.unechoed_since_ns = None;
        self.contradicted = None;
        self.standing = None;
        self.unechoed.clear();
        self.emit_what_left();
        self.lost(why);
        self.settle_outbox();
    }

    fn emit_what_left(&mut self) {
        let now_ns = self.now();
        while self.outbox.front().is_some_and(|o| o.out_ns <= now_ns) {
            self.emit_first();
        }
    }

    /// Nothing more leaves: what the model says is out is logged as sent, the rest is named as cut off. So every
    /// number stands in the log, as a command or in a `thruster.unsent`.
    pub(super) fn settle_outbox(&mut self) {
        self.emit_what_left();
        let Some(first) = self.outbox.front().map(|o| o.sequence) else {
            return;
        };
        let unsent = self.outbox.len();
        self.outbox.clear();
        let last = self.sequence;
        self.event(
            Severity::Warning,
            &kind::THRUSTER_UNSENT,
            format!("{unsent} sets of commands, numbers {first} to {last}, were cut off on their way out"),
            &[("sequence", f64::from(first)), ("sets", unsent as f64)],
        );
    }

    pub(super) fn lost(&mut self, why: &str) {
        let was = self.safety.state();
        if self.safety.lose() {
            self.lost_ns = Some(self.now());
            self.shared.stats(|s| s.losses += 1);
            self.feed_until_ns = None;
            if !self.config.resume_after_loss {
                self.abort_plan(NeutralReason::Lost);
            }
            let alone = watchdog_words(&self.config.set.link);
            let first = match self.config.set.link.follows() {
                true => "",
                false => "; we send neutral first when it is back",
            };
            self.event(
                Severity::Error,
                &kind::SERIAL_LOST,
                format!("link to the thruster controller lost: {why}; {alone}{first}"),
                &[],
            );
            if matches!(was, State::Armed | State::Running) {
                let reason = NeutralReason::Lost;
                self.event(
                    Severity::Error,
                    &kind::THRUSTER_NEUTRAL,
                    format!("thrusters to neutral ({reason}): no command gets through; {alone}"),
                    &[],
                );
            }
        }
    }
}
