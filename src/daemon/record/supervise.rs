//! The main thread of a recording: signals, keys, the clock record, the plan's start and the end.

use super::launch::{Launcher, Look, Next};
use super::mailbox::Mailbox;
use super::unusable::no_good_frame;
use super::{Job, RecordError, Shared, Status, keys::Keys, loads, manager};
use crate::signals::Signals;
use hydroline_core::event::{Severity, kind};
use hydroline_core::heartbeat::Liveness;
use hydroline_core::lock::Lock;
use hydroline_core::shutdown::StopReason;
use hydroline_log::{Entry, messages};
use hydroline_thruster::ThrusterService;
use hydroline_thruster::safety::{NeutralReason, State};
use hydroline_thruster::service::PlanState;
use std::time::Duration;

/// Period at which the main thread looks around.
const TICK: Duration = Duration::from_millis(100);
/// From the moment everything is ready to the plan's first command.
pub const LEAD: Duration = Duration::from_millis(500);
/// Part of [`LEAD`] that the thruster service needs to take a plan; while the place is measured the rest may pass.
const SOON: Duration = Duration::from_millis(200);

/// Runs until something ends the recording and says what.
pub(super) fn supervise(
    shared: &Shared,
    job: &Job,
    service: Option<&ThrusterService>,
    status: &Mailbox<Status>,
) -> Result<StopReason, RecordError> {
    let start = |source| RecordError::Start {
        what: "signal handlers",
        source,
    };
    let signals = crate::signals::listen().map_err(start)?;
    if let Some(service) = service {
        signals.attach(service.handle());
    }
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(start)?;
    let mut watched = vec![
        ("capture", shared.capture.clone()),
        ("log writer", shared.recorder.heartbeat()),
    ];
    watched.extend(service.map(|s| ("thruster service", s.heartbeat())));
    let launcher = job
        .plan
        .as_ref()
        .filter(|_| service.is_some())
        .map(|plan| Launcher::new(job, plan, shared.map.clone()));
    let mut supervisor = Supervisor {
        liveness: Liveness::of(watched),
        standing: Vec::new(),
        shared,
        job,
        service,
        signals,
        keys: Keys::watch(service.map(ThrusterService::handle)),
        started_ns: shared.clock.monotonic_ns(),
        launcher,
        ready_ns: None,
        refused: None,
        began_ns: None,
        spaced: false,
        paged: false,
        pilot: super::pilot::Pilot::default(),
    };
    runtime.block_on(supervisor.run(status))
}

struct Supervisor<'a> {
    liveness: Liveness,
    /// Threads that stood still at the last look.
    standing: Vec<&'static str>,
    shared: &'a Shared,
    job: &'a Job,
    service: Option<&'a ThrusterService>,
    signals: &'static Signals,
    keys: Option<Keys>,
    started_ns: u64,
    /// The plan before it begins; `None` = no plan runs.
    launcher: Option<Launcher>,
    /// When there were the first good frame and, with a plan, an answering controller.
    ready_ns: Option<u64>,
    /// The plan does not begin from where the vehicle is.
    refused: Option<StopReason>,
    /// When the recording proper began: all was ready and, with a plan, known of the vehicle's place.
    began_ns: Option<u64>,
    /// Space was pressed: the plan is over because someone wanted it.
    spaced: bool,
    /// STOP was pressed on the live page.
    paged: bool,
    /// Words for the autopilot's pilot.
    pilot: super::pilot::Pilot,
}

/// Answer to a stop where an autopilot drives.
const AUTOPILOT_DRIVES: &str = "the autopilot drives, and hydroline sends it no command: stop the vehicle at its ground station; recording goes on, q ends it";

impl Supervisor<'_> {
    async fn run(&mut self, status: &Mailbox<Status>) -> Result<StopReason, RecordError> {
        let mut tick = tokio::time::interval(TICK);
        let mut second = tokio::time::interval(Duration::from_secs(1));
        loop {
            tokio::select! {
                _ = second.tick() => {
                    self.log_clocks();
                    self.tell_pilot();
                    self.feed_watchdog();
                }
                _ = tick.tick() => {
                    if let Some(reason) = self.look() {
                        let late = self.keys.take().is_some_and(Keys::finish);
                        return Ok(match reason {
                            // Pressed while the run ended: no other run follows it.
                            StopReason::Finished | StopReason::PlanCut(_) if late => {
                                StopReason::Asked("a key at the run's end")
                            }
                            reason => reason,
                        });
                    }
                    if self.began_ns.is_none()
                        && self.ready()
                        && let Some(pose) = self.placed()
                    {
                        manager::ready();
                        self.begin(pose)?;
                    }
                    let now = self.status();
                    if let Some(desk) = &self.shared.desk {
                        desk.status.put(now.clone());
                    }
                    status.put(now);
                }
            }
        }
    }

    /// The pilot at the ground station hears how the recording goes.
    fn tell_pilot(&mut self) {
        let Some(service) = self
            .service
            .filter(|_| self.job.rig.thrusters.link.follows())
        else {
            return;
        };
        let progress = self.shared.progress(|p| *p);
        let now_ns = self.shared.clock.monotonic_ns();
        let seen = *self.shared.pose.held();
        let news = super::pilot::News {
            now_ns,
            frames: progress.counts.received,
            lost: progress.counts.lost.total() + self.shared.recorder.counts().frames_dropped,
            in_sight: self
                .shared
                .map
                .as_ref()
                .map(|_| seen.is_some_and(|p| p.is_fresh(now_ns))),
        };
        if let Some(words) = self.pilot.words(&news)
            && let Err(error) = service.tell(words)
        {
            tracing::debug!("no words for the pilot: {error}");
        }
    }

    /// The service manager hears that all is well only while capture, writer and thruster service all go on.
    fn feed_watchdog(&mut self) {
        let standing = self.liveness.standing();
        if standing.is_empty() {
            manager::alive();
        } else if standing != self.standing {
            let words = format!(
                "no sign of life for a second from: {}; the service manager's watchdog is not fed meanwhile",
                standing.join(", ")
            );
            self.shared
                .say(Severity::Warning, &kind::DAEMON_STANDING, words);
        }
        self.standing = standing;
    }

    fn neutral(&self, reason: NeutralReason) {
        if let Some(service) = self.service {
            service.neutral(reason);
        }
    }

    fn stop(&self, by: &'static str) -> StopReason {
        if let Some(service) = self.service {
            service.handle().bar(NeutralReason::Exit);
        }
        StopReason::Asked(by)
    }

    /// Anything that ends the recording?
    fn look(&mut self) -> Option<StopReason> {
        if let Some(reason) = self.shared.shutdown.reason() {
            return Some(reason);
        }
        if let Some(signal) = self.signals.heard() {
            return Some(self.stop(signal));
        }
        if let Some(reason) = self.shared.recorder.stopped() {
            self.neutral(NeutralReason::Exit);
            return Some(StopReason::LogStopped(reason));
        }
        if let Some(reason) = self.watch_keys() {
            return Some(reason);
        }
        self.watch_page();
        if let Some(reason) = self.refused.take() {
            return Some(reason);
        }
        match (self.elapsed(), self.job.length) {
            (Some(elapsed), Some(length)) if elapsed >= length => Some(self.finished()),
            // Once it is ready, what is missing is the vehicle's place: `placed` ends that wait.
            (None, _) if self.waited() > self.job.ready_within && !self.ready() => {
                Some(self.not_ready())
            }
            _ => None,
        }
    }

    /// The time is over: well, unless the plan did not come to its end.
    fn finished(&self) -> StopReason {
        if (self.paged || self.spaced) && self.job.rig.thrusters.link.follows() {
            return StopReason::Finished;
        }
        if self.paged {
            return StopReason::Asked("STOP on the live page (thrusters to neutral)");
        }
        if self.spaced {
            return StopReason::Asked("Space (thrusters to neutral)");
        }
        let plan = self.service.map(ThrusterService::plan_state);
        match (plan, &self.job.plan) {
            (Some(PlanState::Aborted(why)), Some(plan)) => StopReason::PlanAborted(format!(
                "plan '{}' was aborted to neutral: {why}",
                plan.name
            )),
            (Some(PlanState::Refused(why)), Some(plan)) => {
                StopReason::PlanAborted(format!("plan '{}' did not start: {why}", plan.name))
            }
            (Some(PlanState::None | PlanState::Waiting), Some(plan)) => {
                StopReason::PlanAborted(format!("plan '{}' never started", plan.name))
            }
            (Some(PlanState::Running), Some(plan)) => {
                let run_s = self.elapsed().unwrap_or_default().saturating_sub(LEAD);
                StopReason::PlanCut(format!(
                    "plan '{}' was cut at {:.1} of {:.1} s, as the recording's length asked",
                    plan.name,
                    run_s.as_secs_f64(),
                    plan.duration_s()
                ))
            }
            _ => StopReason::Finished,
        }
    }

    fn watch_keys(&mut self) -> Option<StopReason> {
        let keys = self.keys.as_ref()?;
        if keys.quit() {
            return Some(self.stop("the q key"));
        }
        if keys.space() {
            self.spaced = true;
            let words = if self.job.rig.thrusters.link.follows() {
                AUTOPILOT_DRIVES
            } else if self.began_ns.is_some() {
                "Space: thrusters to neutral, the plan is over; recording goes on, q ends it"
            } else {
                "Space before the start: no plan starts any more; recording goes on, q ends it"
            };
            self.shared
                .say(Severity::Warning, &kind::THRUSTER_NEUTRAL, words);
        }
        None
    }

    /// STOP on the live page has already brought the thrusters to neutral, for good: as Space does.
    fn watch_page(&mut self) {
        let pressed = self
            .shared
            .desk
            .as_ref()
            .is_some_and(|d| d.live().feed.pressed());
        if pressed && !self.paged {
            self.paged = true;
            self.spaced = true;
            let words = if self.job.rig.thrusters.link.follows() {
                AUTOPILOT_DRIVES
            } else {
                "STOP on the live page: thrusters to neutral, no plan runs any more; recording goes on, q ends it"
            };
            self.shared
                .say(Severity::Warning, &kind::THRUSTER_NEUTRAL, words);
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

    /// Time since the recording proper began.
    fn elapsed(&self) -> Option<Duration> {
        let now_ns = self.shared.clock.monotonic_ns();
        Some(Duration::from_nanos(now_ns.saturating_sub(self.began_ns?)))
    }

    fn good_frame(&self) -> bool {
        self.shared.progress(|p| p.first_good_ns.is_some())
    }

    /// An open line alone proves nothing: the controller has to have echoed a command.
    fn link_up(&self) -> bool {
        let answers = |s: &ThrusterService| s.state() != State::Lost && s.stats().echoed > 0;
        self.service.is_none_or(answers)
    }

    /// A good frame, and an answering controller where a plan needs one.
    fn ready(&self) -> bool {
        self.good_frame() && (self.job.plan.is_none() || self.link_up())
    }

    fn not_ready(&self) -> StopReason {
        let seconds = self.job.ready_within.as_secs_f64();
        let answers = self.service.is_some_and(|s| s.state() != State::Lost);
        let missing = if self.good_frame() && answers {
            "the thruster controller answers, but says of no command that it put it out: is thrusters.link.kind right, and are \
             the rig's channels those of the controller?"
                .to_owned()
        } else if self.good_frame() {
            "the thruster controller does not answer: is it powered, and is thrusters.link right?"
                .to_owned()
        } else {
            let progress = self.shared.progress(|p| *p);
            let why = self.shared.unusable.held().clone();
            no_good_frame(
                progress.counts.received,
                &progress.unusable(),
                why.as_deref(),
            )
        };
        StopReason::Failed(format!(
            "after {seconds:.0} s {missing} `hydroline check` says more"
        ))
    }

    /// The vehicle's pose where a plan begins, once that is known well enough; without a plan the rig's start. `None` = not
    /// yet, or never: then [`Self::refused`] says why.
    fn placed(&mut self) -> Option<[f64; 6]> {
        let start = self.job.rig.tank.start_pose;
        let now_ns = self.shared.clock.monotonic_ns();
        let ready_ns = *self.ready_ns.get_or_insert(now_ns);
        let look = Look {
            now_ns,
            ready_for: Duration::from_nanos(now_ns.saturating_sub(ready_ns)),
            is_late: self.waited() > self.job.ready_within,
            pose: *self.shared.pose.held(),
        };
        let Some(launcher) = self.launcher.as_mut() else {
            return Some(start);
        };
        if self.spaced {
            return Some(start);
        }
        match launcher.look(&look) {
            Next::Wait | Next::Simulate(_) => None,
            Next::Begin {
                pose,
                severity,
                words,
            } => {
                self.shared.say(severity, &kind::PLAN_PLACE, words);
                Some(pose)
            }
            Next::Refuse(words) => {
                self.shared
                    .say(Severity::Error, &kind::PLAN_PLACE, words.clone());
                self.refused = Some(StopReason::PlanAborted(words));
                None
            }
        }
    }

    /// Begins the recording proper, and the plan with the vehicle at this pose.
    fn begin(&mut self, pose: [f64; 6]) -> Result<(), RecordError> {
        let nanos = |d: Duration| d.as_nanos() as u64;
        let now_ns = self.shared.clock.monotonic_ns();
        // The plan starts a lead after it: as far as it goes, the time in which the place was measured counts.
        let latest_ns = (now_ns + nanos(SOON)).saturating_sub(nanos(LEAD));
        let began_ns = match &self.launcher {
            Some(_) => self.ready_ns.unwrap_or(now_ns).max(latest_ns),
            // From the arrival of the first good frame: a slow computer sees only later that it is one.
            None => self.shared.progress(|p| p.first_good_ns).unwrap_or(now_ns),
        };
        self.began_ns = Some(began_ns);
        self.shared.say(
            Severity::Info,
            &kind::DAEMON_READY,
            "first good frame is here",
        );
        let (Some(plan), Some(service)) = (&self.job.plan, self.service) else {
            return Ok(());
        };
        if self.spaced {
            return Ok(());
        }
        self.shared.tracker.place(&self.job.rig, pose);
        let start_ns = began_ns + nanos(LEAD);
        service.run_plan(
            start_ns,
            plan.duration_s(),
            Box::new(loads(&self.job.rig, plan)?),
        )?;
        let words = format!(
            "plan '{}' starts in {} ms, {:.1} s long",
            plan.name,
            start_ns.saturating_sub(now_ns) / 1_000_000,
            plan.duration_s()
        );
        self.shared.say(Severity::Info, &kind::PLAN_START, words);
        Ok(())
    }

    fn log_clocks(&self) {
        let controller = *self.shared.controller.held();
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
        self.shared
            .recorder
            .push(Entry::clock(&messages::clock_message(
                &self.shared.clock.triple(),
                controller,
            )));
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
            calibration: self
                .shared
                .calibrating
                .held()
                .as_ref()
                .map(|c| c.line.clone()),
        }
    }
}
