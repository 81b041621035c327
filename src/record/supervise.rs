//! The main thread of a recording: signals, keys, the clock record, the plan's start and the end.

use super::{Job, RecordError, Shared, Status, keys::Keys, loads};
use crate::event::Severity;
use crate::log::messages;
use crate::shutdown::StopReason;
use crate::thruster::ThrusterService;
use crate::thruster::safety::{NeutralReason, State};
use std::sync::PoisonError;
use std::time::Duration;
use tokio::signal::unix::{Signal, SignalKind, signal};

/// How often the main thread looks around.
const TICK: Duration = Duration::from_millis(100);
/// From the moment everything is ready to the plan's first command.
const LEAD: Duration = Duration::from_millis(500);

struct Signals {
    interrupt: Signal,
    terminate: Signal,
}

impl Signals {
    fn listen() -> std::io::Result<Self> {
        Ok(Self {
            interrupt: signal(SignalKind::interrupt())?,
            terminate: signal(SignalKind::terminate())?,
        })
    }
}

/// Runs until something ends the recording and says what.
pub(super) fn supervise(
    shared: &Shared,
    job: &Job,
    service: Option<&ThrusterService>,
    watch: &mut dyn FnMut(&Status),
) -> Result<StopReason, RecordError> {
    let start = |source| RecordError::Start {
        what: "signal handlers",
        source,
    };
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(start)?;
    let supervisor = Supervisor {
        shared,
        job,
        service,
        keys: Keys::on_terminal(),
        started_ns: shared.clock.monotonic_ns(),
    };
    runtime.block_on(async {
        let mut signals = Signals::listen().map_err(start)?;
        supervisor.run(&mut signals, watch).await
    })
}

struct Supervisor<'a> {
    shared: &'a Shared,
    job: &'a Job,
    service: Option<&'a ThrusterService>,
    keys: Option<Keys>,
    started_ns: u64,
}

impl Supervisor<'_> {
    async fn run(
        &self,
        signals: &mut Signals,
        watch: &mut dyn FnMut(&Status),
    ) -> Result<StopReason, RecordError> {
        let mut tick = tokio::time::interval(TICK);
        let mut second = tokio::time::interval(Duration::from_secs(1));
        let mut plan_started = false;
        loop {
            tokio::select! {
                _ = signals.interrupt.recv() => return Ok(self.stop("Ctrl-C")),
                _ = signals.terminate.recv() => return Ok(self.stop("SIGTERM")),
                _ = second.tick() => self.log_clocks(),
                _ = tick.tick() => {
                    if let Some(reason) = self.look() {
                        return Ok(reason);
                    }
                    if !plan_started && self.ready() {
                        plan_started = true;
                        self.begin()?;
                    }
                    watch(&self.status());
                }
            }
        }
    }

    fn neutral(&self, reason: NeutralReason) {
        if let Some(service) = self.service {
            service.neutral(reason);
        }
    }

    fn stop(&self, by: &'static str) -> StopReason {
        self.neutral(NeutralReason::Exit);
        StopReason::Asked(by)
    }

    /// Anything that ends the recording?
    fn look(&self) -> Option<StopReason> {
        if let Some(reason) = self.shared.shutdown.reason() {
            return Some(reason);
        }
        if let Some(reason) = self.shared.recorder.stopped() {
            self.neutral(NeutralReason::Exit);
            return Some(StopReason::LogStopped(reason));
        }
        if let Some(reason) = self.watch_keys() {
            return Some(reason);
        }
        match (self.elapsed(), self.job.length) {
            (Some(elapsed), Some(length)) if elapsed >= length => {
                return Some(StopReason::Finished);
            }
            (None, _) if self.waited() > self.job.ready_within => return Some(self.not_ready()),
            _ => {}
        }
        None
    }

    fn watch_keys(&self) -> Option<StopReason> {
        match self.keys.as_ref()?.next(Duration::ZERO)? {
            b' ' => {
                self.neutral(NeutralReason::Request);
                self.shared.say(
                    Severity::Warning,
                    "thruster.neutral",
                    "Space: thrusters to neutral, the plan is over; recording goes on, q ends it",
                );
                None
            }
            b'q' => Some(self.stop("the q key")),
            _ => None,
        }
    }

    fn waited(&self) -> Duration {
        Duration::from_nanos(
            self.shared
                .clock
                .monotonic_ns()
                .saturating_sub(self.started_ns),
        )
    }

    /// Time since the first good frame.
    fn elapsed(&self) -> Option<Duration> {
        let first_ns = self.shared.progress(|p| p.first_good_ns)?;
        Some(Duration::from_nanos(
            self.shared.clock.monotonic_ns().saturating_sub(first_ns),
        ))
    }

    fn link_up(&self) -> bool {
        self.service.is_none_or(|s| s.state() != State::Lost)
    }

    /// A good frame, and an answering controller where a plan needs one.
    fn ready(&self) -> bool {
        self.elapsed().is_some() && (self.job.plan.is_none() || self.link_up())
    }

    fn not_ready(&self) -> StopReason {
        let seconds = self.job.ready_within.as_secs_f64();
        StopReason::Failed(format!(
            "no good frame within {seconds:.0} s: is the camera plugged in and free? `hydroline check` says more"
        ))
    }

    fn begin(&self) -> Result<(), RecordError> {
        self.shared
            .say(Severity::Info, "daemon.ready", "first good frame is here");
        let (Some(plan), Some(service)) = (&self.job.plan, self.service) else {
            return Ok(());
        };
        let start_ns = self.shared.clock.monotonic_ns() + LEAD.as_nanos() as u64;
        service.run_plan(
            start_ns,
            plan.duration_s(),
            Box::new(loads(&self.job.rig, plan)?),
        )?;
        let words = format!(
            "plan '{}' starts in {} ms, {:.1} s long",
            plan.name,
            LEAD.as_millis(),
            plan.duration_s()
        );
        self.shared.say(Severity::Info, "plan.start", words);
        Ok(())
    }

    fn log_clocks(&self) {
        let controller = *self
            .shared
            .controller
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let controller = controller.map(|c| messages::pb::ControllerClock {
            offset_us: c.offset_us,
            offset_sd_us: c.offset_sd_us,
            drift_ppm: c.drift_ppm,
            drift_sd_ppm: c.drift_sd_ppm,
            round_trip_us: c.round_trip_us,
            round_trip_spread_us: c.round_trip_spread_us,
            samples: c.samples,
            host_epoch_ns: c.host_epoch_ns,
            controller_epoch_us: c.controller_epoch_us,
        });
        self.shared.recorder.clock(&messages::clock_message(
            &self.shared.clock.triple(),
            controller,
        ));
    }

    fn status(&self) -> Status {
        let progress = self.shared.progress(|p| *p);
        let log = self.shared.recorder.counts();
        Status {
            elapsed_s: self.elapsed().map(|e| e.as_secs_f64()),
            frames: progress.counts.received,
            lost: progress.counts.lost.total(),
            dropped: log.frames_dropped,
            skipped: self.shared.newest.skipped(),
            points: progress.points,
            bytes: log.bytes,
        }
    }
}
