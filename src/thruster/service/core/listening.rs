//! While there is a line: due set-points, answers, the log of what has left.

use super::{Core, Flow, Outgoing, STEP_NS};
use crate::link::{Echo, LinkEvent};
use crate::record::{CommandRecord, EchoRecord, LinkRecord};
use crate::safety::{NeutralReason, State};
use crate::scheduler::Tick;
use crate::service::PlanState;
use hydroline_core::event::{Severity, kind};
use std::time::Duration;

impl Core {
    pub(super) fn connected(&mut self) -> Flow {
        self.run_plan();
        let now_ns = self.now();
        if let Some(until_ns) = self.feed_until_ns.filter(|until_ns| now_ns > *until_ns) {
            // The set-point was due one period after the last: later than that by the deadline and this.
            let deadline_ns = (self.config.set.link.deadline_s * 1e9) as u64;
            self.missed(now_ns - until_ns + deadline_ns);
        }
        if let Some((_, again_ns)) = self.neutral_open
            && now_ns >= again_ns
        {
            let reason = match self.safety.state() {
                State::Neutral(reason) => reason,
                State::Lost => NeutralReason::Lost,
                // Running again: an old neutral is no longer wanted.
                State::Armed | State::Running => {
                    self.neutral_open = None;
                    NeutralReason::Idle
                }
            };
            if self.neutral_open.is_some() {
                self.send_neutral(reason);
            }
        }
        let wait_ns = self.wait_ns(now_ns);
        let Some(link) = self.link.as_mut() else {
            return Flow::Continue;
        };
        match link.poll(Duration::from_nanos(wait_ns)) {
            Ok(events) => events.into_iter().for_each(|event| self.heard(event)),
            Err(error) => self.lose(&error.to_string()),
        }
        self.flush_outbox();
        self.check_silence();
        self.check_echoes();
        self.check_contradiction();
        self.check_faults();
        self.farewell()
    }

    pub(super) fn wait_ns(&mut self, now_ns: u64) -> u64 {
        let mut until_ns = now_ns + STEP_NS;
        if let Some(plan) = &mut self.plan
            && let Tick::Wait { until_ns: due_ns } = plan.scheduler.peek(now_ns)
        {
            until_ns = until_ns.min(due_ns);
        }
        if let Some(first) = self.outbox.front() {
            until_ns = until_ns.min(first.out_ns.max(now_ns + 200_000));
        }
        until_ns.saturating_sub(now_ns)
    }

    pub(super) fn run_plan(&mut self) {
        let running = matches!(self.safety.state(), State::Armed | State::Running);
        let now_ns = self.now();
        let Some(plan) = &mut self.plan else { return };
        match plan.scheduler.poll(now_ns) {
            Tick::Wait { .. } => {}
            // While the link is away (and the plan is to go on) the grid runs on without anything being sent.
            Tick::Due { .. } | Tick::Missed { .. } if !running => {}
            Tick::Due {
                due_ns,
                t_s,
                skipped,
            } => {
                let load = (plan.load)(t_s);
                self.shared.stats(|s| s.skipped += skipped);
                self.run_thrust(
                    &load.thrust_n,
                    load.pulses_us,
                    due_ns,
                    load.plan_step,
                    "plan",
                );
                if self.plan.is_some() && self.safety.state() == State::Running {
                    self.set_plan(PlanState::Running);
                }
            }
            Tick::Missed { late_ns, .. } => self.missed(late_ns),
            Tick::Finished => {
                self.plan = None;
                // Its end passed while the link was away: nobody followed it there.
                self.set_plan(if running {
                    PlanState::Completed
                } else {
                    PlanState::Aborted(NeutralReason::Lost)
                });
                self.go_neutral(NeutralReason::Idle, "the plan is over");
            }
        }
    }

    pub(super) fn heard(&mut self, event: LinkEvent) {
        if event.is_sound() && self.safety.state() == State::Lost {
            self.back("the controller answers again");
        }
        match event {
            LinkEvent::Heard(heard) => self.follow(heard),
            LinkEvent::Missed { messages } => self.missed_messages(messages),
            LinkEvent::Recording { on } => (self.sink)(LinkRecord::Recording { on }),
            LinkEvent::Echo(echo) => self.echo(echo),
            LinkEvent::Alive => {}
            LinkEvent::Clock(estimate) => {
                let now_ns = self.now();
                // Once a second, as /clock.
                if now_ns >= self.last_clock_ns + 900_000_000 {
                    self.last_clock_ns = now_ns;
                    (self.sink)(LinkRecord::Clock(estimate.record()));
                }
                self.judge_clock(&estimate);
            }
            LinkEvent::Errors { bits, names } => {
                self.reported(bits, &names);
                self.noisy(Severity::Warning, &kind::THRUSTER_ERROR_BITS, |n| {
                    (
                        format!("the controller reports {}", names.join(", ")),
                        vec![("bits", f64::from(bits)), ("count", n as f64)],
                    )
                })
            }
            LinkEvent::Garbage { reason } => {
                self.noisy(Severity::Warning, &kind::THRUSTER_GARBAGE, |n| {
                    (
                        format!("bytes from the controller dropped, {n} times: {reason}"),
                        vec![("count", n as f64)],
                    )
                })
            }
            LinkEvent::Unanswered { sequence, sets } => {
                self.noisy(Severity::Warning, &kind::THRUSTER_UNANSWERED, |n| {
                    (
                        format!("{sets} commands from sequence {sequence} on were not answered"),
                        vec![
                            ("sequence", f64::from(sequence)),
                            ("sets", sets as f64),
                            ("count", n as f64),
                        ],
                    )
                })
            }
            LinkEvent::Reset { reason } => {
                self.event(
                    Severity::Error,
                    &kind::THRUSTER_RESET,
                    format!("the controller was reset: {reason}"),
                    &[],
                );
                if self.safety.state() == State::Running {
                    self.go_neutral(NeutralReason::Lost, "the controller was reset");
                }
            }
        }
    }

    pub(super) fn echo(&mut self, echo: Echo) {
        self.unechoed_since_ns = None;
        if echo.errors == 0 {
            self.standing = None;
        }
        self.compare(&echo);
        // An echo proves that the command's bytes have left, whatever the model of the line says.
        while let Some(first) = self.outbox.front_mut()
            && first.sequence.wrapping_sub(echo.sequence) as i32 <= 0
        {
            first.out_ns = first.out_ns.min(echo.received_ns);
            self.emit_first();
        }
        if let Some((sequence, _)) = self.neutral_open
            && echo.sequence.wrapping_sub(sequence) as i32 >= 0
            && self.confirms_neutral(&echo)
        {
            self.neutral_open = None;
            if self.safety.state() != State::Running {
                self.at_rest = Some(true);
            }
            if self.plan.is_some() && self.config.resume_after_loss {
                self.safety.arm();
            }
        }
        if self.is_in_full(&echo) {
            self.shared.stats(|s| s.echoed += 1);
        }
        let timestamp_ns = self.clock.triple().monotonic_to_unix_ns(echo.received_ns);
        for (thruster, name) in self.config.set.thrusters.iter().zip(&self.names) {
            let Some(pulse) = echo.pulses.iter().find(|p| p.channel == thruster.channel) else {
                continue;
            };
            (self.sink)(LinkRecord::Echo(EchoRecord {
                timestamp_ns,
                sequence: echo.sequence,
                thruster: name.clone(),
                pulse_us: pulse.pulse_us(),
                controller_time_us: echo.controller_time_us,
                round_trip_s: echo.round_trip_ns as f64 * 1e-9,
                errors: echo.errors,
            }));
        }
    }

    /// Logs the commands whose last byte is out.
    pub(super) fn flush_outbox(&mut self) {
        let now_ns = self.now();
        while let Some(first) = self.outbox.front_mut()
            && first.out_ns <= now_ns
        {
            // The model says out; does the kernel agree? (USB adapters and flow control can hold bytes back.)
            let held = self.outbox_held();
            let Some(first) = self.outbox.front_mut() else {
                return;
            };
            let bound_ns = (self.config.set.link.timeout_s * 1e9) as u64;
            if held && now_ns < first.out_ns + bound_ns {
                // Not out yet: the stamp moves along until the queue is empty; silence ends it.
                first.out_ns = now_ns.max(first.out_ns);
                return;
            }
            self.emit_first();
        }
    }

    pub(super) fn outbox_held(&mut self) -> bool {
        // With several sets in the queue the kernel's count is ambiguous: only the last one is checked.
        self.outbox.len() == 1
            && self
                .link
                .as_mut()
                .and_then(|l| l.unsent_bytes())
                .is_some_and(|n| n > 0)
    }

    pub(super) fn emit_first(&mut self) {
        if let Some(Outgoing {
            out_ns, records, ..
        }) = self.outbox.pop_front()
        {
            let timestamp_ns = self.clock.triple().monotonic_to_unix_ns(out_ns);
            for record in records {
                (self.sink)(LinkRecord::Command(CommandRecord {
                    timestamp_ns,
                    sent_monotonic_ns: out_ns,
                    ..record
                }));
            }
        }
    }

    pub(super) fn check_silence(&mut self) {
        let now_ns = self.now();
        let Some(link) = &self.link else { return };
        let Some(since_ns) = link.silent_since_ns() else {
            return;
        };
        let silent_s = now_ns.saturating_sub(since_ns) as f64 * 1e-9;
        if silent_s > self.config.set.link.timeout_s && self.safety.state() != State::Lost {
            self.lost(&format!("no answer for {silent_s:.3} s"));
            // The line may still carry bytes outwards: neutral is tried, and repeated until it is confirmed.
            self.send_neutral(NeutralReason::Lost);
        }
    }

    pub(super) fn farewell(&mut self) -> Flow {
        let Some(until_ns) = self.farewell_ns else {
            return Flow::Continue;
        };
        let confirmed = !self.is_neutral_open() && self.outbox.is_empty();
        if !confirmed && self.link.is_some() && self.now() < until_ns {
            return Flow::Continue;
        }
        while !self.outbox.is_empty() {
            self.emit_first();
        }
        if !confirmed {
            self.event(
                Severity::Error,
                &kind::THRUSTER_NEUTRAL,
                "ended without the controller's confirmation of neutral: its watchdog has to act; look whether the \
                 thrusters stand, and switch them off if they do not"
                    .into(),
                &[],
            );
        }
        // Dropping the link closes the port.
        self.link = None;
        Flow::End
    }
}
