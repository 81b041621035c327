//! The service's loop, one step at a time, on injected clock, line and sink.

use super::noise::Noise;
use super::{Opener, Order, ServiceConfig, SetPoint, Shared, Sink};
use crate::clock::Clock;
use crate::event::{Event, Severity};
use crate::thruster::ChannelPulse;
use crate::thruster::curve::{pulse_for_thrust, thrust_for_pulse};
use crate::thruster::link::{Echo, LinkEvent, Protocol, ThrusterLink, WireLink};
use crate::thruster::record::{CommandRecord, EchoRecord, LinkRecord};
use crate::thruster::safety::{NeutralReason, PulseLimits, Refused, Safety, State};
use crate::thruster::scheduler::{LoadAt, Scheduler, Tick};
use crate::thruster::transport::Transport;
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::Receiver;
use std::time::Duration;

/// Longest wait in one step: a neutral request is served within it.
const STEP_NS: u64 = 5_000_000;
/// Between two attempts to open a lost line: far below the second that is allowed, far above a busy loop.
const REOPEN_NS: u64 = 200_000_000;
/// Sleep while there is no line.
const AWAY_NS: u64 = 20_000_000;
/// An unconfirmed neutral is repeated this often ...
const REPEAT_NEUTRAL_NS: u64 = 50_000_000;
/// ... and this often while nobody answers at all: a dead line must not fill the log.
const REPEAT_LOST_NS: u64 = 250_000_000;
/// How long a shutdown waits for the neutral's echo at most.
const FAREWELL_NS: u64 = 300_000_000;

type Link = WireLink<Box<dyn Protocol>, Box<dyn Transport>>;

/// Whether to go on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flow {
    /// Call [`Core::step`] again.
    Continue,
    /// Neutral has been sent, the port is closed.
    End,
}

/// A set handed to the kernel whose last byte has to leave before it is logged.
struct Outgoing {
    sequence: u32,
    out_ns: u64,
    records: Vec<CommandRecord>,
}

struct PlanRun {
    scheduler: Scheduler,
    load: LoadAt,
}

/// The service without its thread.
pub struct Core {
    config: ServiceConfig,
    names: Vec<Arc<str>>,
    clock: Arc<dyn Clock>,
    sink: Sink,
    opener: Opener,
    inbox: Receiver<Order>,
    shared: Arc<Shared>,
    safety: Safety,
    protocol: Option<Box<dyn Protocol>>,
    link: Option<Link>,
    plan: Option<PlanRun>,
    /// The next set-point of a producer has to be here by then \[ns\].
    feed_until_ns: Option<u64>,
    outbox: VecDeque<Outgoing>,
    sequence: u32,
    /// Sequence of the neutral that has no echo yet, and when to repeat it \[ns\].
    neutral_open: Option<(u32, u64)>,
    next_open_ns: u64,
    lost_ns: Option<u64>,
    ever_open: bool,
    noise: Noise,
    farewell_ns: Option<u64>,
    last_clock_ns: u64,
}

impl Core {
    /// Nothing opened yet.
    #[allow(clippy::too_many_arguments)]
    pub fn new(
        config: ServiceConfig,
        protocol: Box<dyn Protocol>,
        opener: Opener,
        clock: Arc<dyn Clock>,
        sink: Sink,
        inbox: Receiver<Order>,
        shared: Arc<Shared>,
    ) -> Self {
        let set = &config.set;
        let limits = PulseLimits {
            neutral_us: set.neutral_us,
            min_us: set.min_us,
            max_us: set.max_us,
            max_slew_us_per_s: set.max_slew_us_per_s,
            max_step_s: 2.0 / set.link.rate_hz,
        };
        let mut safety = Safety::new(limits, set.thrusters.len());
        safety.lose();
        Self {
            names: set
                .thrusters
                .iter()
                .map(|t| Arc::from(t.name.as_str()))
                .collect(),
            safety,
            clock,
            sink,
            opener,
            inbox,
            shared,
            protocol: Some(protocol),
            link: None,
            plan: None,
            feed_until_ns: None,
            outbox: VecDeque::new(),
            sequence: 0,
            neutral_open: None,
            next_open_ns: 0,
            lost_ns: None,
            ever_open: false,
            noise: Noise::default(),
            farewell_ns: None,
            last_clock_ns: 0,
            config,
        }
    }

    #[cfg(test)]
    pub(super) fn replace_opener(&mut self, opener: Opener) {
        self.opener = opener;
    }

    #[cfg(test)]
    pub(super) fn replace_sink(&mut self, sink: Sink) {
        self.sink = sink;
    }

    /// State of the thrusters.
    pub fn state(&self) -> State {
        self.safety.state()
    }

    /// One turn: orders, due set-points, bytes, records. Waits at most a few milliseconds.
    pub fn step(&mut self) -> Flow {
        self.orders();
        let flow = if self.link.is_some() {
            self.connected()
        } else {
            self.disconnected()
        };
        self.shared.set_state(self.safety.state());
        let cpu_s = thread_cpu_s();
        self.shared.stats(|s| s.cpu_s = cpu_s);
        flow
    }

    fn now(&self) -> u64 {
        self.clock.monotonic_ns()
    }

    // ---- orders -------------------------------------------------------------------------------------------------

    fn orders(&mut self) {
        if let Some(reason) = self.shared.take_neutral() {
            self.go_neutral(reason, "asked for");
        }
        if self.shared.stop.load(Ordering::Acquire) && self.farewell_ns.is_none() {
            self.go_neutral(NeutralReason::Exit, "the daemon ends");
            self.farewell_ns = Some(self.now() + FAREWELL_NS);
        }
        while let Ok(order) = self.inbox.try_recv() {
            if self.farewell_ns.is_some() {
                continue;
            }
            match order {
                Order::Arm => {
                    self.safety.arm();
                }
                Order::SetPoint(set_point) => self.set_point(set_point),
                Order::Plan {
                    start_ns,
                    duration_s,
                    load,
                } => {
                    let link = &self.config.set.link;
                    let scheduler =
                        Scheduler::new(start_ns, link.rate_hz, duration_s, link.deadline_s);
                    self.feed_until_ns = None;
                    self.plan = Some(PlanRun { scheduler, load });
                    if !self.safety.arm() && !self.config.resume_after_loss {
                        self.plan = None;
                        self.event(
                            Severity::Error,
                            "thruster.refused",
                            "the plan is not started: there is no link to the thruster controller"
                                .into(),
                            &[],
                        );
                    }
                }
            }
        }
    }

    fn set_point(&mut self, set_point: SetPoint) {
        let now_ns = self.now();
        let link = &self.config.set.link;
        let deadline_ns = (link.deadline_s * 1e9) as u64;
        let period_ns = (1e9 / link.rate_hz) as u64;
        if !matches!(self.safety.state(), State::Armed | State::Running) {
            let state = self.safety.state();
            self.noisy(Severity::Warning, "thruster.refused", |n| {
                (
                    format!("{n} set-points not taken: thrusters are {state:?}"),
                    vec![("count", n as f64)],
                )
            });
            return;
        }
        if set_point.due_ns != 0 && now_ns > set_point.due_ns.saturating_add(deadline_ns) {
            self.missed(now_ns - set_point.due_ns);
            return;
        }
        self.feed_until_ns = Some(now_ns + period_ns + deadline_ns);
        self.run_thrust(
            &set_point.thrust_n,
            set_point.due_ns,
            set_point.plan_step,
            "setpoint",
        );
    }

    fn missed(&mut self, late_ns: u64) {
        let late_s = late_ns as f64 * 1e-9;
        let allowed_s = self.config.set.link.deadline_s;
        self.event(
            Severity::Error,
            "thruster.deadline",
            format!("a set-point was {late_s:.3} s late, {allowed_s:.3} s are allowed: neutral"),
            &[("late_s", late_s), ("allowed_s", allowed_s)],
        );
        self.go_neutral(NeutralReason::Deadline, "missed deadline");
    }

    // ---- sending ------------------------------------------------------------------------------------------------

    fn run_thrust(&mut self, thrust_n: &[f64], due_ns: u64, plan_step: u32, cause: &'static str) {
        let set = &self.config.set;
        let wanted: Result<Vec<f64>, String> = set
            .thrusters
            .iter()
            .zip(thrust_n)
            .map(|(t, thrust)| {
                pulse_for_thrust(&t.curve, set.neutral_us, *thrust)
                    .map_err(|e| format!("thruster {}: {e}", t.name))
            })
            .collect();
        let admitted = wanted.and_then(|mut wanted_us| {
            // A wrong number of values is the gate's to refuse, in its words.
            wanted_us.extend(thrust_n.iter().skip(wanted_us.len()).map(|_| f64::NAN));
            self.safety
                .admit(self.clock.monotonic_ns(), &wanted_us)
                .map_err(|e| match e {
                    Refused::Range { index, .. } => {
                        format!("{}: {e}", self.names.get(index).map_or("?", |n| n))
                    }
                    _ => e.to_string(),
                })
        });
        let admitted = match admitted {
            Ok(admitted) => admitted,
            Err(why) => {
                self.event(Severity::Error, "thruster.refused", why, &[]);
                self.go_neutral(NeutralReason::Range, "a set-point was refused");
                return;
            }
        };
        if let Some((index, wanted_us)) = admitted.limited.filter(|_| admitted.ramp_begins) {
            let name = self.names[index].clone();
            let sent_us = admitted.pulses_us[index];
            let limit = self.config.set.max_slew_us_per_s;
            self.event(
                Severity::Warning,
                "thruster.slew_limited",
                format!("{name}: {wanted_us:.2} us wanted, {sent_us:.2} us sent: ramping at {limit} us/s"),
                &[("wanted_us", wanted_us), ("sent_us", sent_us), ("limit_us_per_s", limit)],
            );
        }
        let thrust_n: Vec<f64> = self
            .config
            .set
            .thrusters
            .iter()
            .zip(&admitted.pulses_us)
            .zip(thrust_n)
            .map(|((t, sent), want)| {
                if admitted.limited.is_some() {
                    thrust_for_pulse(&t.curve, *sent)
                } else {
                    *want
                }
            })
            .collect();
        if let Some(out_ns) = self.send(
            &admitted.pulses_us,
            &thrust_n,
            due_ns,
            plan_step,
            cause,
            false,
        ) {
            let late_ns = if due_ns == 0 {
                0
            } else {
                out_ns.saturating_sub(due_ns)
            };
            if late_ns > (self.config.set.link.deadline_s * 1e9) as u64 {
                self.missed(late_ns);
            }
        }
    }

    /// Writes one set; when its last byte is out \[ns\].
    fn send(
        &mut self,
        pulses_us: &[f64],
        thrust_n: &[f64],
        due_ns: u64,
        plan_step: u32,
        cause: &'static str,
        neutral: bool,
    ) -> Option<u64> {
        let link = self.link.as_mut()?;
        let pulses: Vec<ChannelPulse> = self
            .config
            .set
            .thrusters
            .iter()
            .zip(pulses_us)
            .map(|(t, us)| ChannelPulse::from_us(t.channel, *us))
            .collect();
        self.sequence = self.sequence.wrapping_add(1);
        let sequence = self.sequence;
        let sent = match link.send(sequence, &pulses, neutral) {
            Ok(sent) => sent,
            Err(error) => {
                self.lose(&error.to_string());
                return None;
            }
        };
        let triple = self.clock.triple();
        let records = self
            .names
            .iter()
            .zip(&pulses)
            .zip(thrust_n)
            .map(|((name, pulse), thrust_n)| CommandRecord {
                timestamp_ns: 0,
                sequence,
                thruster: name.clone(),
                thrust_n: *thrust_n,
                pulse_us: pulse.pulse_us(),
                due_ns: if due_ns == 0 {
                    0
                } else {
                    triple.monotonic_to_unix_ns(due_ns)
                },
                plan_step,
                cause,
            })
            .collect();
        self.outbox.push_back(Outgoing {
            sequence,
            out_ns: sent.last_byte_out_ns,
            records,
        });
        self.shared.stats(|s| s.sets += 1);
        Some(sent.last_byte_out_ns)
    }

    fn send_neutral(&mut self, reason: NeutralReason) {
        let set = &self.config.set;
        let pulses_us = vec![set.neutral_us; set.thrusters.len()];
        let thrust_n: Vec<f64> = set
            .thrusters
            .iter()
            .map(|t| thrust_for_pulse(&t.curve, set.neutral_us))
            .collect();
        if self
            .send(&pulses_us, &thrust_n, 0, 0, reason.word(), true)
            .is_some()
        {
            let lost = self.safety.state() == State::Lost;
            let wait_ns = if lost {
                REPEAT_LOST_NS
            } else {
                REPEAT_NEUTRAL_NS
            };
            self.neutral_open = Some((self.sequence, self.now() + wait_ns));
        }
    }

    fn go_neutral(&mut self, reason: NeutralReason, why: &str) {
        self.plan = None;
        self.feed_until_ns = None;
        let was = self.safety.state();
        let (_, changed) = self.safety.neutral(reason, self.now());
        // First the bytes, then the words.
        self.send_neutral(reason);
        if changed {
            let severity = match reason {
                NeutralReason::Idle | NeutralReason::Request | NeutralReason::Exit => {
                    Severity::Info
                }
                _ if was == State::Running => Severity::Error,
                _ => Severity::Warning,
            };
            self.event(
                severity,
                "thruster.neutral",
                format!("thrusters to neutral ({reason}): {why}"),
                &[],
            );
        }
    }

    // ---- with a line --------------------------------------------------------------------------------------------

    fn connected(&mut self) -> Flow {
        self.run_plan();
        let now_ns = self.now();
        if self.feed_until_ns.is_some_and(|until| now_ns > until) {
            let period_ns = (1e9 / self.config.set.link.rate_hz) as u64;
            let deadline_ns = (self.config.set.link.deadline_s * 1e9) as u64;
            let since_ns = now_ns - self.feed_until_ns.unwrap_or(now_ns) + deadline_ns;
            debug_assert!(period_ns > 0);
            self.missed(since_ns);
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
        self.farewell()
    }

    fn wait_ns(&mut self, now_ns: u64) -> u64 {
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

    fn run_plan(&mut self) {
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
                self.run_thrust(&load.thrust_n, due_ns, load.plan_step, "plan");
            }
            Tick::Missed { late_ns, .. } => self.missed(late_ns),
            Tick::Finished => self.go_neutral(NeutralReason::Idle, "the plan is over"),
        }
    }

    fn heard(&mut self, event: LinkEvent) {
        if event.is_sound() && self.safety.state() == State::Lost {
            self.back("the controller answers again");
        }
        match event {
            LinkEvent::Echo(echo) => self.echo(echo),
            LinkEvent::Alive => {}
            LinkEvent::Clock(estimate) => {
                let now_ns = self.now();
                // Once a second, as /clock.
                if now_ns >= self.last_clock_ns + 900_000_000 {
                    self.last_clock_ns = now_ns;
                    (self.sink)(LinkRecord::Clock(estimate.record()));
                }
            }
            LinkEvent::Errors { bits, names } => {
                self.noisy(Severity::Warning, "thruster.error_bits", |n| {
                    (
                        format!("the controller reports {}", names.join(", ")),
                        vec![("bits", f64::from(bits)), ("count", n as f64)],
                    )
                })
            }
            LinkEvent::Garbage { reason } => {
                self.noisy(Severity::Warning, "thruster.garbage", |n| {
                    (
                        format!("bytes from the controller dropped, {n} times: {reason}"),
                        vec![("count", n as f64)],
                    )
                })
            }
            LinkEvent::Unanswered { sequence, sets } => {
                self.noisy(Severity::Warning, "thruster.unanswered", |n| {
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
                    "thruster.reset",
                    format!("the controller was reset: {reason}"),
                    &[],
                );
                if self.safety.state() == State::Running {
                    self.go_neutral(NeutralReason::Lost, "the controller was reset");
                }
            }
        }
    }

    fn echo(&mut self, echo: Echo) {
        // An echo proves that the command's bytes have left, whatever the model of the line says.
        while let Some(first) = self.outbox.front_mut()
            && first.sequence.wrapping_sub(echo.sequence) as i32 <= 0
        {
            first.out_ns = first.out_ns.min(echo.received_ns);
            self.emit_first();
        }
        let neutral = ChannelPulse::from_us(0, self.config.set.neutral_us).quarter_us;
        if let Some((sequence, _)) = self.neutral_open
            && echo.sequence.wrapping_sub(sequence) as i32 >= 0
            && echo
                .pulses
                .iter()
                .all(|p| p.quarter_us == neutral || !self.is_ours(p.channel))
        {
            self.neutral_open = None;
            if self.plan.is_some() && self.config.resume_after_loss {
                self.safety.arm();
            }
        }
        self.shared.stats(|s| s.echoed += 1);
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

    fn is_ours(&self, channel: u8) -> bool {
        self.config
            .set
            .thrusters
            .iter()
            .any(|t| t.channel == channel)
    }

    /// Logs the commands whose last byte is out.
    fn flush_outbox(&mut self) {
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

    fn outbox_held(&mut self) -> bool {
        // With several sets in the queue the kernel's count cannot be told apart: only the last one is checked.
        self.outbox.len() == 1
            && self
                .link
                .as_mut()
                .and_then(|l| l.unsent_bytes())
                .is_some_and(|n| n > 0)
    }

    fn emit_first(&mut self) {
        if let Some(Outgoing {
            out_ns, records, ..
        }) = self.outbox.pop_front()
        {
            let timestamp_ns = self.clock.triple().monotonic_to_unix_ns(out_ns);
            for record in records {
                (self.sink)(LinkRecord::Command(CommandRecord {
                    timestamp_ns,
                    ..record
                }));
            }
        }
    }

    fn check_silence(&mut self) {
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

    fn farewell(&mut self) -> Flow {
        let Some(until_ns) = self.farewell_ns else {
            return Flow::Continue;
        };
        let confirmed = self.neutral_open.is_none() && self.outbox.is_empty();
        if !confirmed && self.link.is_some() && self.now() < until_ns {
            return Flow::Continue;
        }
        while !self.outbox.is_empty() {
            self.emit_first();
        }
        if !confirmed {
            self.event(
                Severity::Error,
                "thruster.neutral",
                "ended without the controller's confirmation of neutral: its watchdog has to act"
                    .into(),
                &[],
            );
        }
        // Dropping the link closes the port.
        self.link = None;
        Flow::End
    }

    // ---- without a line -----------------------------------------------------------------------------------------

    fn disconnected(&mut self) -> Flow {
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
                    WireLink::new(protocol, opened.transport, Duration::from_millis(100));
                if let Err(error) = link.open() {
                    self.protocol = Some(link.into_parts().0);
                    self.noisy(Severity::Warning, "serial.open", |n| {
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
                        "serial.low_latency",
                        format!("{}: {low_latency}", opened.name),
                        &[],
                    );
                }
                // Neutral is the first command on any line, new or old.
                self.send_neutral(self.reason_after_opening());
                self.back(&format!("{} is open", opened.name));
            }
            Err(error) => {
                self.noisy(Severity::Warning, "serial.open", |n| {
                    (error.to_string(), vec![("attempts", n as f64)])
                });
            }
        }
        Flow::Continue
    }

    fn reason_after_opening(&self) -> NeutralReason {
        if self.ever_open {
            NeutralReason::Lost
        } else {
            NeutralReason::Idle
        }
    }

    /// The link works (again): at neutral until armed, or on with the plan.
    fn back(&mut self, how: &str) {
        self.safety.regain(self.reason_after_opening());
        if !self.ever_open {
            self.ever_open = true;
            self.event(Severity::Info, "serial.open", how.to_owned(), &[]);
        } else if let Some(lost_ns) = self.lost_ns.take() {
            let away_s = self.now().saturating_sub(lost_ns) as f64 * 1e-9;
            self.event(
                Severity::Info,
                "serial.back",
                format!("{how} after {away_s:.3} s; neutral first"),
                &[("away_s", away_s)],
            );
        }
    }

    /// The line is gone: closes it (an open descriptor would make the replugged node another one).
    fn lose(&mut self, why: &str) {
        if let Some(link) = self.link.take() {
            let (protocol, transport) = link.into_parts();
            drop(transport);
            self.protocol = Some(protocol);
        }
        self.next_open_ns = self.now() + REOPEN_NS;
        self.neutral_open = None;
        let now_ns = self.now();
        // What the model says is out is logged as sent; the rest never left.
        while self.outbox.front().is_some_and(|o| o.out_ns <= now_ns) {
            self.emit_first();
        }
        let unsent = self.outbox.len();
        self.outbox.clear();
        self.lost(why);
        if unsent > 0 {
            self.event(
                Severity::Warning,
                "thruster.unsent",
                format!("{unsent} sets of commands were cut off on their way out"),
                &[("sets", unsent as f64)],
            );
        }
    }

    fn lost(&mut self, why: &str) {
        if self.safety.lose() {
            self.lost_ns = Some(self.now());
            self.shared.stats(|s| s.losses += 1);
            self.feed_until_ns = None;
            if !self.config.resume_after_loss {
                self.plan = None;
            }
            self.event(
                Severity::Error,
                "serial.lost",
                format!("link to the thruster controller lost: {why}; its watchdog goes to neutral, so do we when it is back"),
                &[],
            );
        }
    }

    // ---- words --------------------------------------------------------------------------------------------------

    fn event(
        &mut self,
        severity: Severity,
        kind: &'static str,
        message: String,
        values: &[(&'static str, f64)],
    ) {
        let mut event = Event::new(self.clock.triple().realtime_ns, severity, kind, message);
        event.values.extend_from_slice(values);
        (self.sink)(LinkRecord::Event(event));
    }

    fn noisy(
        &mut self,
        severity: Severity,
        kind: &'static str,
        words: impl FnOnce(u64) -> (String, Vec<(&'static str, f64)>),
    ) {
        if let Some(count) = self.noise.count(kind, self.now()) {
            let (message, values) = words(count);
            self.event(severity, kind, message, &values);
        }
    }

    /// After a panic in [`Self::step`]: neutral first, then what can be said about it.
    ///
    /// The sink may be what panicked, so every further call of it is guarded.
    pub fn panicked(&mut self, words: &str) {
        let sink = std::mem::replace(&mut self.sink, Box::new(|_| {}));
        let sink = std::sync::Mutex::new(sink);
        self.sink = Box::new(move |record| {
            let mut sink = sink
                .lock()
                .unwrap_or_else(std::sync::PoisonError::into_inner);
            let _ = catch_unwind(AssertUnwindSafe(|| sink(record)));
        });
        let words = format!("the thruster service panicked: {words}");
        let _ = catch_unwind(AssertUnwindSafe(|| {
            self.go_neutral(NeutralReason::Panic, &words)
        }));
        self.farewell_ns = Some(self.now() + FAREWELL_NS);
        let mut failures = 0;
        while failures < 3 && self.link.is_some() {
            // Only the line is served: no orders, no plan.
            match catch_unwind(AssertUnwindSafe(|| self.connected())) {
                Ok(Flow::End) => break,
                Ok(Flow::Continue) => {}
                Err(_) => failures += 1,
            }
        }
        self.link = None;
        self.shared.set_state(State::Neutral(NeutralReason::Panic));
    }
}

impl Drop for Core {
    fn drop(&mut self) {
        // Reached without farewell only when nobody stepped us to the end: neutral, unconfirmed, is better than nothing.
        if self.link.is_some() {
            self.safety
                .neutral(NeutralReason::Exit, self.clock.monotonic_ns());
            self.send_neutral(NeutralReason::Exit);
        }
    }
}

/// CPU time of the calling thread \[s\].
fn thread_cpu_s() -> f64 {
    let mut t = libc::timespec {
        tv_sec: 0,
        tv_nsec: 0,
    };
    // SAFETY: a valid timespec; the clock exists on Linux.
    unsafe { libc::clock_gettime(libc::CLOCK_THREAD_CPUTIME_ID, &mut t) };
    t.tv_sec as f64 + t.tv_nsec as f64 * 1e-9
}
