//! The thruster service: one thread that owns the port, and the guarantee that the thrusters stop.
//!
//! Neutral is sent on [`ThrusterService::shutdown`] and on drop, on a panic inside the service (whatever its sink
//! does), on a lost link (first thing when it is back; meanwhile the controller's own watchdog has acted: we set that of
//! a `stamped` controller, a Maestro's is a setting in its own memory, see [`super::link::MaestroProtocol`]), on a missed
//! deadline, on a refused set-point, and when anyone calls [`NeutralHandle::request`], which is one atomic
//! store and may be called from a panic hook or a signal handler. It is repeated until an echo confirms it.

mod core;
mod error;
mod noise;
mod trigger;

pub use self::core::{Core, Flow};
pub use error::{ServiceError, check_set};
pub use trigger::wait_for_recording;

use error::check;
use hydroline_core::lock::Lock;

use super::link::protocol_for;
use super::lowlatency::LowLatency;
use super::ports::Roots;
use super::record::LinkRecord;
use super::safety::{NeutralReason, State};
use super::scheduler::LoadAt;
use super::transport::{OpenError, SerialTransport, Transport, UdpTransport};
use hydroline_core::clock::Clock;
use hydroline_core::heartbeat::Heartbeat;
use hydroline_core::thread_class::{block_signals, real_time};
use hydroline_rigs::{LinkPort, ThrusterSet};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

/// Takes every record, on the service's thread. Must not block: it stands in the way of the next command.
pub type Sink = Box<dyn FnMut(LinkRecord) + Send>;

/// A freshly opened line.
pub struct Opened {
    /// The line.
    pub transport: Box<dyn Transport>,
    /// Name of the line, for the log.
    pub name: String,
    /// Result of asking for low-latency mode, where that means something.
    pub low_latency: Option<LowLatency>,
}

/// Opens the line, again and again: it is asked after every loss and has to look for the identity anew.
pub type Opener = Box<dyn FnMut() -> Result<Opened, OpenError> + Send>;

/// The opener for a rig's port.
pub fn serial_opener(set: &ThrusterSet, roots: Roots, clock: Arc<dyn Clock>) -> Opener {
    let (port, baud) = (set.link.port.clone(), set.link.baud);
    Box::new(move || {
        if let LinkPort::Udp(address) = port {
            let transport = UdpTransport::open(address, clock.clone())?;
            return Ok(Opened {
                name: format!("udp:{address}"),
                low_latency: None,
                transport: Box::new(transport),
            });
        }
        let path = roots.resolve(&port)?;
        let transport = SerialTransport::open(&path, baud, clock.clone())?;
        Ok(Opened {
            name: path.display().to_string(),
            low_latency: Some(transport.low_latency().clone()),
            transport: Box::new(transport),
        })
    })
}

/// Settings of the service, besides the way to open the line.
#[derive(Debug, Clone)]
pub struct ServiceConfig {
    /// The rig's thrusters and link.
    pub set: ThrusterSet,
    /// After a lost link came back and neutral was confirmed: go on with the plan (true) or stay at neutral (false).
    pub resume_after_loss: bool,
}

/// A wanted thrust for every thruster.
#[derive(Debug, Clone, PartialEq)]
pub struct SetPoint {
    /// When it was due, CLOCK_MONOTONIC \[ns\]; 0 = at once, without a deadline of its own.
    pub due_ns: u64,
    /// In the rig's order \[N\].
    pub thrust_n: Vec<f64>,
    /// Step of the plan, from 1; 0 = none.
    pub plan_step: u32,
}

/// Counters of the service.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ServiceStats {
    /// Sets sent.
    pub sets: u64,
    /// Sets answered in full: with every channel that was commanded.
    pub echoed: u64,
    /// Set-points skipped because a newer one was due too.
    pub skipped: u64,
    /// Attempts to open the line.
    pub open_attempts: u64,
    /// Times the line was lost.
    pub losses: u64,
    /// Messages of an autopilot that did not arrive, by its counter.
    pub missed: u64,
    /// Whether the controller has not confirmed neutral since something was last commanded: its outputs are not known to rest.
    pub neutral_open: bool,
    /// CPU time of the service's thread \[s\].
    pub cpu_s: f64,
}

/// State of the plan last handed to [`ThrusterService::run_plan`].
///
/// Final are `Completed`, `Aborted` and `Refused`; they stay until the next plan.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum PlanState {
    /// None was ever handed over.
    #[default]
    None,
    /// Taken or on its way; no set-point of it has been sent yet.
    Waiting,
    /// Its set-points go out. With `resume_after_loss` also while a lost link is waited for.
    Running,
    /// Its end was reached with the thrusters following it.
    Completed,
    /// Ended before its end; the thrusters went to neutral for this reason (`Range` = one of its set-points was
    /// refused, `Lost` = no link or no echoes, also at its end).
    Aborted(NeutralReason),
    /// Never started, for the reason in words.
    Refused(String),
}

/// Orders to the thread.
pub enum Order {
    /// Take set-points.
    Arm,
    /// One set-point.
    SetPoint(SetPoint),
    /// Words for the pilot, where the link has a way to them.
    Tell(String),
    /// Run a plan from `start_ns` (CLOCK_MONOTONIC) for `duration_s`.
    Plan {
        /// Start \[ns\].
        start_ns: u64,
        /// Length \[s\].
        duration_s: f64,
        /// The plan.
        load: LoadAt,
    },
}

/// State that the service's thread and its callers share.
#[derive(Debug, Default)]
pub struct Shared {
    neutral: AtomicU8,
    /// Someone wants no more motion: no plan, no set-point, whoever asks.
    barred: AtomicBool,
    stop: AtomicBool,
    state: Mutex<Option<State>>,
    stats: Mutex<ServiceStats>,
    plan: Mutex<PlanState>,
    heartbeat: Heartbeat,
}

const REASONS: [NeutralReason; 10] = [
    NeutralReason::Idle,
    NeutralReason::Request,
    NeutralReason::Limit,
    NeutralReason::Deadline,
    NeutralReason::Range,
    NeutralReason::Lost,
    NeutralReason::Exit,
    NeutralReason::Panic,
    NeutralReason::Contradicted,
    NeutralReason::Fault,
];

impl Shared {
    fn take_neutral(&self) -> Option<NeutralReason> {
        let code = self.neutral.swap(0, Ordering::AcqRel);
        REASONS.get(usize::from(code).checked_sub(1)?).copied()
    }

    fn state(&self) -> State {
        self.state.held().unwrap_or(State::Lost)
    }

    fn set_state(&self, state: State) {
        *self.state.held() = Some(state);
    }

    fn plan<R>(&self, f: impl FnOnce(&mut PlanState) -> R) -> R {
        f(&mut self.plan.held())
    }

    /// Nobody is left to run it.
    fn abandon_plan(&self, reason: NeutralReason) {
        self.plan(|p| {
            if matches!(p, PlanState::Waiting | PlanState::Running) {
                *p = PlanState::Aborted(reason);
            }
        });
    }

    fn stats<R>(&self, f: impl FnOnce(&mut ServiceStats) -> R) -> R {
        f(&mut self.stats.held())
    }
}

/// Stops the thrusters from anywhere: a panic hook, a signal handler, another thread.
#[derive(Debug, Clone)]
pub struct NeutralHandle(Arc<Shared>);

impl NeutralHandle {
    /// Neutral within a few milliseconds. Async-signal-safe: one atomic store.
    pub fn request(&self, reason: NeutralReason) {
        let code = REASONS
            .iter()
            .position(|r| *r == reason)
            .map_or(2, |i| i as u8 + 1);
        self.0.neutral.store(code, Ordering::Release);
    }

    /// Neutral, and nothing moves any more for as long as the service lives: what is ordered after this is refused.
    /// For a person's stop, which must not be undone by a plan that was just about to begin. As safe as `request`.
    pub fn bar(&self, reason: NeutralReason) {
        // First the bar: an order that is taken between the two is undone by the neutral that follows.
        self.0.barred.store(true, Ordering::Release);
        self.request(reason);
    }
}

/// The running service. Dropping it sends neutral and waits for the thread.
pub struct ThrusterService {
    orders: SyncSender<Order>,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl ThrusterService {
    /// Starts the thread that owns the line. It begins at neutral and takes nothing before [`Self::arm`].
    ///
    /// # Errors
    /// When the rig's rate does not fit its baud rate, its channels clash, or the thread does not start.
    pub fn start(
        config: ServiceConfig,
        opener: Opener,
        clock: Arc<dyn Clock>,
        sink: Sink,
    ) -> Result<Self, ServiceError> {
        let protocol = protocol_for(&config.set);
        check(&config.set, &*protocol)?;
        let (orders, inbox) = sync_channel(64);
        let shared = Arc::new(Shared::default());
        let mut core = Core::new(config, protocol, opener, clock, sink, inbox, shared.clone());
        let heartbeat = shared.heartbeat.clone();
        let run = move || {
            block_signals();
            if let Err(error) = real_time() {
                tracing::info!(
                    "the thruster thread has no real-time priority ({error}): on a busy computer set-points may come late; \
                     systemd's LimitRTPRIO=10 or CAP_SYS_NICE allows it"
                );
            }
            // A panic (in the sink, in a plan, in ourselves) must not leave the thrusters running.
            if let Err(panic) = catch_unwind(AssertUnwindSafe(|| {
                while core.step() == Flow::Continue {
                    heartbeat.beat();
                }
            })) {
                let words = panic.downcast_ref::<&str>().map(|s| (*s).to_owned());
                let words = words
                    .or_else(|| panic.downcast_ref::<String>().cloned())
                    .unwrap_or_default();
                core.panicked(&words);
            }
            // A plan still in the queue, or one that a panic kept from being closed.
            core.end_plans();
        };
        let thread = std::thread::Builder::new()
            .name("thruster".into())
            .spawn(run)
            .map_err(ServiceError::Thread)?;
        Ok(Self {
            orders,
            shared,
            thread: Some(thread),
        })
    }

    fn order(&self, order: Order) -> Result<(), ServiceError> {
        self.orders.try_send(order).map_err(|e| match e {
            TrySendError::Full(_) => ServiceError::Full,
            TrySendError::Disconnected(_) => ServiceError::Ended {
                state: self.state(),
            },
        })
    }

    /// Lets set-points through from now on (not while the link is lost).
    ///
    /// # Errors
    /// When the service has ended or its queue is full.
    pub fn arm(&self) -> Result<(), ServiceError> {
        self.order(Order::Arm)
    }

    /// One set-point, to be sent at once. While running, the next one has to follow within a period and the deadline.
    ///
    /// # Errors
    /// When the service has ended or its queue is full.
    pub fn set_point(&self, set_point: SetPoint) -> Result<(), ServiceError> {
        self.order(Order::SetPoint(set_point))
    }

    /// Runs a plan on the service's own thread: `load(t_s)` at every due time from `start_ns` (CLOCK_MONOTONIC).
    /// Arms by itself; at the plan's end the thrusters go to neutral.
    ///
    /// # Errors
    /// When the service has ended or its queue is full.
    pub fn run_plan(
        &self,
        start_ns: u64,
        duration_s: f64,
        load: LoadAt,
    ) -> Result<(), ServiceError> {
        // Before the order: whoever asks right after this call must not read the last plan's end.
        let before = self
            .shared
            .plan(|p| std::mem::replace(p, PlanState::Waiting));
        let ordered = self.order(Order::Plan {
            start_ns,
            duration_s,
            load,
        });
        if ordered.is_err() {
            self.shared.plan(|p| *p = before);
        }
        ordered
    }

    /// Words for the pilot, where the link has a way to them (STATUSTEXT of MAVLink, 50 characters).
    ///
    /// # Errors
    /// When the service has ended or its queue is full.
    pub fn tell(&self, words: String) -> Result<(), ServiceError> {
        self.order(Order::Tell(words))
    }

    /// State of the plan last handed to [`Self::run_plan`].
    pub fn plan_state(&self) -> PlanState {
        let ended = self.thread.as_ref().is_none_or(JoinHandle::is_finished);
        if ended {
            // Ordered in the very moment in which the thread ended.
            self.shared.abandon_plan(NeutralReason::Exit);
        }
        self.shared.plan(|p| p.clone())
    }

    /// Neutral now, until armed again.
    pub fn neutral(&self, reason: NeutralReason) {
        self.handle().request(reason);
    }

    /// To stop the thrusters from elsewhere.
    pub fn handle(&self) -> NeutralHandle {
        NeutralHandle(self.shared.clone())
    }

    /// State of the thrusters.
    pub fn state(&self) -> State {
        self.shared.state()
    }

    /// Counters so far.
    pub fn stats(&self) -> ServiceStats {
        self.shared.stats(|s| *s)
    }

    /// Beats with each turn of the service's loop.
    pub fn heartbeat(&self) -> Heartbeat {
        self.shared.heartbeat.clone()
    }

    /// Neutral, confirmed where the link allows it; then the thread ends and the port is closed.
    pub fn shutdown(mut self) -> ServiceStats {
        self.stop();
        self.stats()
    }

    fn stop(&mut self) {
        self.shared.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Drop for ThrusterService {
    fn drop(&mut self) {
        self.stop();
    }
}

#[cfg(test)]
mod tests;
