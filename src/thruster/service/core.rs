//! The service's loop, one step at a time, on injected clock, line and sink.

mod away;
mod following;
mod listening;
mod obeying;
mod sending;

use super::noise::Noise;
use super::{Opener, Order, PlanState, ServiceConfig, SetPoint, Shared, Sink};
use crate::ChannelPulse;
use crate::link::{Protocol, ThrusterLink};
use crate::record::{CommandRecord, LinkRecord};
use crate::safety::{NeutralReason, PulseLimits, Safety, State};
use crate::scheduler::{LoadAt, Scheduler};
use hydroline_core::clock::Clock;
use hydroline_core::event::{Event, EventKind, Severity, kind};
use hydroline_core::lock::Lock;
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::Receiver;

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
/// How long a shutdown waits for the neutral's echo at most: on a busy computer the answer may lie there for some time.
const FAREWELL_NS: u64 = 1_000_000_000;

/// Sets remembered for their echo: more than the slowest link leaves open before they are given up.
const UNECHOED_SETS: usize = 64;

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

/// A set on its way, for comparison with its echo.
struct Unechoed {
    sequence: u32,
    pulses: Vec<ChannelPulse>,
    before: Vec<ChannelPulse>,
    /// All channels to neutral: answered with those that the controller has.
    neutral: bool,
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
    pub(super) sink: Sink,
    pub(super) opener: Opener,
    inbox: Receiver<Order>,
    shared: Arc<Shared>,
    safety: Safety,
    protocol: Option<Box<dyn Protocol>>,
    link: Option<ThrusterLink>,
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
    /// Since when set-points go out without any echo coming back \[ns\].
    unechoed_since_ns: Option<u64>,
    /// The echoes contradict the set-points without a break: since when, and the last of them.
    contradicted: Option<obeying::Contradiction>,
    /// The controller's answers report errors without a break.
    standing: Option<obeying::Standing>,
    /// Generation of the controller's clock whose rate was said.
    rate_said: Option<u32>,
    /// Whether neutral is confirmed and nothing was commanded since; `None` before the first command.
    at_rest: Option<bool>,
    /// Sets sent and not echoed yet, with the pulses of the set before: what an echo is held against.
    unechoed: VecDeque<Unechoed>,
    last_pulses: Vec<ChannelPulse>,
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
            unechoed_since_ns: None,
            contradicted: None,
            standing: None,
            rate_said: None,
            at_rest: None,
            unechoed: VecDeque::with_capacity(UNECHOED_SETS),
            last_pulses: Vec::new(),
            config,
        }
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
        let neutral_open = self.is_neutral_open();
        self.shared.stats(|s| {
            s.cpu_s = cpu_s;
            s.neutral_open = neutral_open;
        });
        flow
    }

    /// Whether the controller's outputs are not known to rest.
    fn is_neutral_open(&self) -> bool {
        self.at_rest == Some(false) || self.neutral_open.is_some()
    }

    fn set_plan(&self, state: PlanState) {
        self.shared.plan(|p| *p = state);
    }

    /// Drops the plan, if there is one, before its end.
    fn abort_plan(&mut self, reason: NeutralReason) {
        if self.plan.take().is_some() {
            self.set_plan(PlanState::Aborted(reason));
        }
    }

    /// The thread ends: no plan is left waiting or running.
    pub(super) fn end_plans(&mut self) {
        while self.inbox.try_recv().is_ok() {}
        self.abort_plan(NeutralReason::Exit);
        self.shared.abandon_plan(NeutralReason::Exit);
    }

    fn now(&self) -> u64 {
        self.clock.monotonic_ns()
    }

    fn orders(&mut self) {
        if let Some(reason) = self.shared.take_neutral() {
            self.go_neutral(reason, "asked for");
        }
        if self.shared.stop.load(Ordering::Acquire) && self.farewell_ns.is_none() {
            self.go_neutral(NeutralReason::Exit, "the daemon ends");
            self.farewell_ns = Some(self.now() + FAREWELL_NS);
        }
        while let Ok(order) = self.inbox.try_recv() {
            if let Order::Tell(words) = &order {
                if let Some(link) = self.link.as_mut() {
                    link.tell(words);
                }
                continue;
            }
            if self.config.set.link.follows() {
                if matches!(order, Order::Plan { .. }) {
                    self.refuse_to_drive();
                }
                continue;
            }
            if self.farewell_ns.is_some() {
                if matches!(order, Order::Plan { .. }) {
                    self.set_plan(PlanState::Refused("the thruster service is ending".into()));
                }
                continue;
            }
            if self.shared.barred.load(Ordering::Acquire) {
                if matches!(order, Order::Plan { .. }) {
                    let why = "the plan is not started: someone stopped the thrusters";
                    self.set_plan(PlanState::Refused(why.into()));
                    self.event(Severity::Warning, &kind::THRUSTER_REFUSED, why.into(), &[]);
                }
                continue;
            }
            if matches!(order, Order::Arm | Order::Plan { .. }) {
                // Judged by what is reported from now on: at rest nothing asks the controller for more.
                self.standing = None;
            }
            match order {
                Order::Arm => {
                    self.safety.arm();
                }
                Order::SetPoint(set_point) => self.set_point(set_point),
                Order::Tell(_) => {}
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
                    self.set_plan(PlanState::Waiting);
                    if !self.safety.arm() && !self.config.resume_after_loss {
                        self.plan = None;
                        let why =
                            "the plan is not started: there is no link to the thruster controller";
                        self.set_plan(PlanState::Refused(why.into()));
                        self.event(Severity::Error, &kind::THRUSTER_REFUSED, why.into(), &[]);
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
            self.noisy(Severity::Warning, &kind::THRUSTER_REFUSED, |n| {
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
            None,
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
            &kind::THRUSTER_DEADLINE,
            format!("a set-point was {late_s:.3} s late, {allowed_s:.3} s are allowed: neutral"),
            &[("late_s", late_s), ("allowed_s", allowed_s)],
        );
        self.go_neutral(NeutralReason::Deadline, "missed deadline");
    }

    fn event(
        &mut self,
        severity: Severity,
        kind: &'static EventKind,
        message: String,
        values: &[(&'static str, f64)],
    ) {
        let mut event = Event::new(self.clock.triple().realtime_ns, severity, kind, message);
        for (name, value) in values {
            event = event.with(*name, *value);
        }
        (self.sink)(LinkRecord::Event(event));
    }

    fn noisy(
        &mut self,
        severity: Severity,
        kind: &'static EventKind,
        words: impl FnOnce(u64) -> (String, Vec<(&'static str, f64)>),
    ) {
        if let Some(count) = self.noise.count(kind.name, self.now()) {
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
            let mut sink = sink.held();
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
        self.settle_outbox();
        self.abort_plan(NeutralReason::Panic);
        self.shared.set_state(State::Neutral(NeutralReason::Panic));
        let neutral_open = self.is_neutral_open();
        self.shared.stats(|s| s.neutral_open = neutral_open);
    }
}

impl Drop for Core {
    fn drop(&mut self) {
        // Reached without farewell only when nobody stepped us to the end: neutral, unconfirmed, is better than nothing.
        if self.link.is_some() {
            self.safety
                .neutral(NeutralReason::Exit, self.clock.monotonic_ns());
            self.send_neutral(NeutralReason::Exit);
            // With the kernel, if not out; a sink that panics must not do so while another panic unwinds.
            let _ = catch_unwind(AssertUnwindSafe(|| {
                while !self.outbox.is_empty() {
                    self.emit_first();
                }
            }));
        }
    }
}

fn thread_cpu_s() -> f64 {
    let mut t = libc::timespec {
        tv_sec: 0,
        tv_nsec: 0,
    };
    // SAFETY: a valid timespec; the clock exists on Linux.
    unsafe { libc::clock_gettime(libc::CLOCK_THREAD_CPUTIME_ID, &mut t) };
    t.tv_sec as f64 + t.tv_nsec as f64 * 1e-9
}
