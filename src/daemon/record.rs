//! The daemon: camera and thrusters into one log, with the stripe extracted on the way.
//!
//! [`run`] gets everything injected (frame source, thruster line, recorder, clock, shutdown) and owns
//! five threads: capture (never waits for anything but the camera), analysis (newest frame only), poses
//! (newest stripe only), the thruster service and the log's writer. Whatever ends the run, the thrusters go to neutral first.

pub mod aim;
mod aim_words;
mod calibrating;
pub mod floor;
pub mod keys;
mod launch;
mod limit_monitor;
pub mod limits;
pub mod mailbox;
mod manager;
mod measured_pose;
mod pilot;
mod pose_commands;
mod progress;
mod publisher;
mod session;
mod supervise;
mod tracker;
mod unusable;
mod worker;

pub use aim_words::TERMINAL_COLUMNS;
pub use calibrating::Calibrating;
pub use session::{SessionInput, head};
pub use supervise::LEAD;
pub use unusable::Unusable;

use crate::calibrate::{self, message};
use crate::live::Live;
use crate::response::Found;
use hydroline_calib::plane::PlaneMap;
use hydroline_capture::{CaptureCounts, FrameSource};
use hydroline_core::clock::Clock;
use hydroline_core::event::{Event, EventKind, Severity, kind};
use hydroline_core::heartbeat::Heartbeat;
use hydroline_core::lock::Lock;
use hydroline_core::shutdown::{Shutdown, StopReason};
use hydroline_log::messages::{self, pb, timestamp};
use hydroline_log::{Entry, FrameLedger, LogError, LogOutcome, Recorder, SummaryInput};
use hydroline_plan::setpoint::setpoint;
use hydroline_rigs::{Plan, Rig};
use hydroline_sim::{Allocation, ThrustError};
use hydroline_stripe::ExtractorConfig;
use hydroline_thruster::safety::NeutralReason;
use hydroline_thruster::scheduler::PlannedLoad;
use hydroline_thruster::service::{Opener, ServiceError, ServiceStats, Sink};
use hydroline_thruster::{ControllerClock, LinkRecord, ServiceConfig, ThrusterService};
use mailbox::Mailbox;
use measured_pose::MeasuredPose;
use progress::Progress;
use publisher::{Desk, Note};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

/// Everything a recording touches, injected.
pub struct Parts {
    /// The camera, or what stands for it.
    pub source: Box<dyn FrameSource>,
    /// Opens the line to the thruster controller; `None` = record without thrusters.
    pub line: Option<Opener>,
    /// The open log.
    pub recorder: Recorder,
    /// The clocks.
    pub clock: Arc<dyn Clock>,
    /// From image to laser plane; `None` = profiles without plane coordinates.
    pub map: Option<Arc<dyn PlaneMap>>,
    /// Where the run shows itself; `None` = nowhere.
    pub live: Option<Live>,
}

/// Task of a recording.
#[derive(Debug, Clone)]
pub struct Job {
    /// The rig.
    pub rig: Rig,
    /// The plan to run; `None` = thrusters stay at neutral.
    pub plan: Option<Plan>,
    /// Length of the recording from the moment camera (and, with a plan, controller) are ready; `None` = until stopped.
    pub length: Option<Duration>,
    /// Longest wait for the first good frame (and for the controller, when there is a plan).
    pub ready_within: Duration,
    /// The extractor's settings.
    pub extractor: ExtractorConfig,
    /// The board to look for in every analysed frame; without length and plan the recording ends with an
    /// accepted calibration.
    pub calibrate: Option<calibrate::Setup>,
    /// Whether nobody watches, as in a service: no plan begins at a place that is not measured.
    pub unattended: bool,
}

/// The state of a recording, for whoever watches.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Status {
    /// Time since camera and controller were ready \[s\]; `None` = not ready yet.
    pub elapsed_s: Option<f64>,
    /// Frames received.
    pub frames: u64,
    /// Frames lost by the camera.
    pub lost: u64,
    /// Frames dropped by the log's queue.
    pub dropped: u64,
    /// Frames not analysed live.
    pub skipped: u64,
    /// Points in the newest stripe.
    pub points: usize,
    /// Bytes in the log.
    pub bytes: u64,
    /// Where a calibration in the making stands.
    pub calibration: Option<String>,
}

/// Account of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// Reason why it ended.
    pub stop: StopReason,
    /// The camera's account.
    pub capture: CaptureCounts,
    /// Frames analysed live.
    pub analysed: u64,
    /// Frames a newer one replaced before the analysis got to them.
    pub skipped: u64,
    /// Frames that came and cannot be used.
    pub unusable: Unusable,
    /// Stripes that were offered to the pose's fit, by outcome; `None` = no poses in this recording.
    pub poses: Option<PoseCounts>,
    /// The thruster service's counters.
    pub thrusters: Option<ServiceStats>,
    /// The log's end.
    pub log: LogOutcome,
    /// Outcome of a calibration in the making; `None` when none was asked for or no frame was seen.
    pub calibration: Option<Calibrating>,
}

/// Numbers of the stripes that were offered to the pose's fit, by outcome.
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize, schemars::JsonSchema)]
pub struct PoseCounts {
    /// Poses in the log.
    pub fitted: u64,
    /// Fitted, but not to be used without a look at the frame (another hexagon, ambiguous, misfit): not in the log.
    #[serde(rename = "doubtful")]
    pub flagged: u64,
    /// Frames without a pose, by reason.
    pub none: BTreeMap<&'static str, u64>,
    /// A newer stripe came before there was time to fit them; `replay` fits every one.
    pub skipped: u64,
    /// Frames of the opening with a pose, which found the camera's response: not in the log, `replay` fits them under it.
    pub opening: u64,
    /// The camera's response as the opening found it; `None` where the recording ended before that.
    #[schemars(with = "Option<crate::response::ResponseReport>")]
    pub response: Option<Found>,
}

impl PoseCounts {
    /// Frames that were fitted, with whatever came of it.
    pub fn looked_at(&self) -> u64 {
        self.fitted + self.opening + self.flagged + self.none.values().sum::<u64>()
    }

    /// Whether fewer than half of the frames looked at have a pose.
    pub fn few(&self) -> bool {
        2 * (self.fitted + self.opening) < self.looked_at()
    }
}

impl Report {
    /// Whether frames or messages are missing, or something of a frame (exit code 3).
    pub fn lost_anything(&self) -> bool {
        self.log.lost || self.capture.lost.total() > 0 || self.unusable.faulty() > 0
    }

    /// Whether the controller has not confirmed neutral at the end (exit code 3).
    pub fn neutral_open(&self) -> bool {
        self.thrusters.is_some_and(|t| t.neutral_open)
    }
}

/// Failure to make a recording.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum RecordError {
    /// The thruster service did not start.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// The rig's thrusters do not work together.
    #[error(transparent)]
    Thrust(#[from] ThrustError),
    #[error(transparent)]
    Log(#[from] LogError),
    /// A thread or the signal handlers could not be set up.
    #[error("cannot start the {what}: {source}")]
    Start {
        what: &'static str,
        source: std::io::Error,
    },
}

struct Shared {
    recorder: Recorder,
    clock: Arc<dyn Clock>,
    shutdown: Shutdown,
    /// Beats with each turn of the capture's loop.
    capture: Heartbeat,
    newest: Mailbox<hydroline_core::frame::Frame>,
    /// For the poses.
    stripes: Mailbox<worker::Seen>,
    progress: Mutex<Progress>,
    /// Words about the last frame that cannot be used.
    unusable: Mutex<Option<String>>,
    controller: Mutex<Option<ControllerClock>>,
    tracker: tracker::Tracker,
    /// Commands for the poses.
    commands: pose_commands::PoseCommands,
    /// From image to laser plane; `None` = no poses.
    map: Option<Arc<dyn PlaneMap>>,
    floor: Mutex<Option<limit_monitor::Measured>>,
    pose: Mutex<Option<MeasuredPose>>,
    calibrating: Mutex<Option<Calibrating>>,
    /// For the live page.
    desk: Option<Desk>,
    /// There is a line to the thrusters.
    drives: bool,
}

impl Shared {
    fn progress<R>(&self, f: impl FnOnce(&mut Progress) -> R) -> R {
        f(&mut self.progress.held())
    }

    /// An event goes to the log and, by its severity, to the diagnostics.
    fn event(&self, event: &Event) {
        self.recorder.event(event);
        if let Some(desk) = &self.desk {
            desk.post(Note::Event(event.into()));
        }
        match event.severity {
            Severity::Info => tracing::info!(kind = event.kind.name, "{}", event.message),
            Severity::Warning => tracing::warn!(kind = event.kind.name, "{}", event.message),
            Severity::Error => tracing::error!(kind = event.kind.name, "{}", event.message),
        }
    }

    fn say(&self, severity: Severity, kind: &'static EventKind, message: impl Into<String>) {
        self.event(&Event::new(
            self.clock.triple().realtime_ns,
            severity,
            kind,
            message,
        ));
    }
}

/// Receives the state of a recording about ten times a second, on a thread of its own: a terminal that
/// stands still must not hold up the recording.
pub type Watch = Box<dyn FnMut(&Status) + Send>;

struct Threads {
    capture: JoinHandle<Option<CaptureCounts>>,
    analysis: JoinHandle<Option<()>>,
    poses: Option<JoinHandle<Option<PoseCounts>>>,
    limits: JoinHandle<Option<()>>,
}

fn start_threads(
    shared: &Arc<Shared>,
    source: Box<dyn FrameSource>,
    map: Option<Arc<dyn PlaneMap>>,
    job: &Job,
    service: Option<&ThrusterService>,
) -> Result<Threads, RecordError> {
    let neutral = service.map(ThrusterService::handle);
    // A frame of the board shows no target.
    let poses = map
        .clone()
        .filter(|_| job.calibrate.is_none())
        .map(|map| worker::poses(shared.clone(), job, map))
        .transpose()?;
    let analysis = worker::analysis(shared.clone(), job, map)?;
    let limits = limit_monitor::start(shared.clone(), job, neutral)?;
    let capture = worker::capture(shared.clone(), source)?;
    Ok(Threads {
        capture,
        analysis,
        poses,
        limits,
    })
}

/// Shows the newest status on a thread that nobody waits for.
fn show(status: Arc<Mailbox<Status>>, mut watch: Watch) {
    let work = move || {
        loop {
            match status.take(Duration::from_secs(1)) {
                mailbox::Taken::Item(status) => watch(&status),
                mailbox::Taken::Nothing => {}
                mailbox::Taken::Closed => return,
            }
        }
    };
    let spawned = std::thread::Builder::new()
        .name("status".to_owned())
        .spawn(work);
    if let Err(error) = spawned {
        tracing::warn!("no status line: {error}");
    }
}

/// Records until the job is done or `shutdown` is raised.
///
/// # Errors
/// [`RecordError`] when a part could not be started; what goes wrong later ends the run and stands in
/// [`Report::stop`], with the log closed and readable.
pub fn run(
    parts: Parts,
    job: &Job,
    shutdown: &Shutdown,
    watch: Watch,
) -> Result<Report, RecordError> {
    let shared = Arc::new(Shared {
        recorder: parts.recorder.clone(),
        clock: parts.clock.clone(),
        shutdown: shutdown.clone(),
        capture: Heartbeat::default(),
        newest: Mailbox::default(),
        stripes: Mailbox::default(),
        progress: Mutex::new(Progress::default()),
        unusable: Mutex::new(None),
        controller: Mutex::new(None),
        tracker: tracker::Tracker::new(&job.rig),
        commands: pose_commands::PoseCommands::default(),
        map: parts.map.clone(),
        floor: Mutex::new(None),
        pose: Mutex::new(None),
        calibrating: Mutex::new(None),
        desk: parts
            .live
            .map(|live| Desk::new(live, job, parts.map.clone())),
        drives: parts.line.is_some(),
    });
    announce(
        &shared,
        &job.rig,
        parts.map.as_deref(),
        job.calibrate.is_some(),
    );
    let service = match parts.line {
        Some(opener) => Some(start_service(&shared, &job.rig, opener)?),
        None => None,
    };
    let live = publisher::start(shared.clone(), job);
    if let (Some(service), Some(desk)) = (&service, &shared.desk) {
        let line = service.handle();
        let stop = move || line.bar(NeutralReason::Request);
        desk.live().feed.attach(Box::new(stop));
    }
    let started = start_threads(&shared, parts.source, parts.map, job, service.as_ref());
    let status = Arc::new(Mailbox::default());
    show(status.clone(), watch);
    // Whatever failed to start, the parts that did are taken down in order and the file gets its end.
    let result = match &started {
        Ok(_) => supervise::supervise(&shared, job, service.as_ref(), &status),
        Err(error) => Ok(StopReason::Failed(error.to_string())),
    };
    let stop = result.unwrap_or_else(|error| StopReason::Failed(error.to_string()));

    // Neutral before anything else is taken down; shutdown() waits until the echo confirms it.
    shutdown.raise(stop.clone());
    manager::stopping(&stop.to_string());
    let thrusters = service.map(ThrusterService::shutdown);
    if let Some(desk) = &shared.desk {
        desk.live().feed.detach();
    }
    if let Ok(signals) = crate::signals::listen() {
        signals.detach_all();
    }
    status.close();
    let mut counts = CaptureCounts::default();
    let mut poses = None;
    if let Ok(threads) = started {
        counts = worker::join(threads.capture).unwrap_or_default();
        shared.newest.close();
        worker::join(threads.analysis);
        shared.stripes.close();
        poses = threads.poses.and_then(worker::join);
        worker::join(threads.limits);
    }
    shared.say(Severity::Info, &kind::DAEMON_STOP, stop.to_string());
    if let Some(desk) = &shared.desk {
        desk.post(Note::End(stop.to_string()));
        desk.status.close();
    }
    if let Some(live) = live {
        // It waits for nobody, and neither does this for long.
        let _ = live.join();
    }

    let skipped = shared.newest.skipped();
    let (analysed, damaged) = shared.progress(|p| (p.analysed, p.damaged));
    let unusable = Unusable {
        marked: counts.excluded,
        damaged,
    };
    let log = parts.recorder.finish(&summary(
        &stop,
        &counts,
        &unusable,
        (analysed, skipped),
        poses.as_ref(),
        thrusters.as_ref(),
    ))?;
    Ok(Report {
        stop,
        capture: counts,
        analysed,
        skipped,
        unusable,
        poses,
        thrusters,
        log,
        calibration: shared.calibrating.held().take(),
    })
}

/// Logs all that a viewer needs before the first frame: intrinsics and the map to the laser plane.
fn announce(shared: &Shared, rig: &Rig, map: Option<&dyn PlaneMap>, searching: bool) {
    let now_ns = shared.clock.triple().realtime_ns;
    shared
        .recorder
        .push(Entry::camera_calibration(&messages::camera_calibration(
            &rig.camera,
            now_ns,
        )));
    match map {
        Some(map) => {
            let calibration = map.describe();
            let message = message::in_force(&calibration, now_ns);
            shared.recorder.push(Entry::plane_calibration(&message));
            if calibration.residuals.is_none() && searching {
                shared.say(
                    Severity::Info,
                    &kind::CALIBRATION_NONE,
                    "the board is searched for; until a calibration is accepted plane coordinates come from the rig's ideal camera",
                );
            } else if calibration.residuals.is_none() {
                shared.say(
                    Severity::Warning,
                    &kind::CALIBRATION_NONE,
                    "no calibration: plane coordinates come from the ideal camera of the rig's numbers (Eqs. 11-12), \
                     their sd is that of the stripe alone; `record --calibrate` makes one, --calibration uses it",
                );
            }
        }
        None => shared.say(
            Severity::Warning,
            &kind::CALIBRATION_NONE,
            "no calibration: profiles hold pixels only, no laser-plane coordinates",
        ),
    }
}

fn start_service(
    shared: &Arc<Shared>,
    rig: &Rig,
    opener: Opener,
) -> Result<ThrusterService, ServiceError> {
    let config = ServiceConfig {
        set: rig.thrusters.clone(),
        resume_after_loss: false,
    };
    let to = shared.clone();
    let sink: Sink = Box::new(move |record| match record {
        LinkRecord::Command(command) => {
            to.tracker.command(&command);
            to.commands.post(&command);
            if let Some(desk) = &to.desk {
                desk.post(Note::Command(command.clone()));
            }
            to.recorder.command(&pb::ThrusterCommand {
                timestamp: Some(timestamp(command.timestamp_ns)),
                sequence: command.sequence,
                thruster: command.thruster.to_string(),
                thrust_n: command.thrust_n,
                pulse_us: command.pulse_us,
                due_ns: command.due_ns,
                plan_step: command.plan_step,
                cause: command.cause.to_owned(),
            });
        }
        LinkRecord::Echo(echo) => {
            to.recorder.push(Entry::echo(&pb::ThrusterEcho {
                timestamp: Some(timestamp(echo.timestamp_ns)),
                sequence: echo.sequence,
                thruster: echo.thruster.to_string(),
                pulse_us: echo.pulse_us,
                controller_time_us: echo.controller_time_us,
                round_trip_s: echo.round_trip_s,
                errors: echo.errors,
            }));
            if let Some(desk) = &to.desk {
                desk.post(Note::Echo(echo));
            }
        }
        LinkRecord::Event(event) => to.event(&event),
        LinkRecord::Heard(heard) => pilot::log(&to.recorder, &heard),
        LinkRecord::Recording { on } => pilot::recording(&to, on),
        LinkRecord::Clock(clock) => {
            *to.controller.held() = Some(clock);
        }
    });
    ThrusterService::start(config, opener, shared.clock.clone(), sink)
}

/// The plan as the service asks for it. A load that cannot be commanded was refused before the start; should one
/// appear all the same it is no thrust at all.
fn loads(
    rig: &Rig,
    plan: &Plan,
) -> Result<impl FnMut(f64) -> PlannedLoad + Send + 'static, ThrustError> {
    let allocation = Allocation::new(&rig.thrusters)?;
    let (rig, plan) = (rig.clone(), plan.clone());
    Ok(
        move |t_s: f64| match setpoint(&rig, &allocation, &plan, t_s) {
            Ok(set) => PlannedLoad {
                thrust_n: set.thrust_n,
                pulses_us: Some(set.pulses_us),
                plan_step: set.plan_step,
            },
            Err(error) => {
                tracing::error!("{error}");
                PlannedLoad {
                    thrust_n: vec![0.0; rig.thrusters.thrusters.len()],
                    pulses_us: None,
                    plan_step: 0,
                }
            }
        },
    )
}

fn summary(
    stop: &StopReason,
    counts: &CaptureCounts,
    unusable: &Unusable,
    (analysed, skipped): (u64, u64),
    poses: Option<&PoseCounts>,
    thrusters: Option<&ServiceStats>,
) -> SummaryInput {
    let lost = [
        ("sequence_gap", counts.lost.sequence_gap),
        ("time_gap", counts.lost.time_gap),
        ("frozen", counts.lost.frozen),
        ("unplugged", counts.lost.unplugged),
        ("restarted", counts.lost.restarted),
    ];
    let mut summary = SummaryInput::clean(stop.to_string());
    summary.clean = !matches!(stop, StopReason::Failed(_) | StopReason::PlanAborted(_));
    summary.frames = Some(FrameLedger {
        expected: counts.expected,
        received: counts.received,
        lost: lost
            .into_iter()
            .filter(|(_, n)| *n > 0)
            .map(|(cause, n)| (cause.to_owned(), n))
            .collect(),
    });
    let mut put = |key: &str, value: &dyn std::fmt::Display| {
        summary.more.insert(key.to_owned(), value.to_string());
    };
    put("frames.analysed", &analysed);
    put("frames.not_analysed", &skipped);
    put("frames.disagreement", &counts.disagreement);
    put("frames.period_s", &counts.period_s);
    let marked = &unusable.marked;
    put("frames.excluded.driver_error", &marked.driver_error);
    put("frames.excluded.truncated", &marked.truncated);
    put("frames.excluded.broken_jpeg", &marked.broken_jpeg);
    put("frames.excluded.stale", &marked.stale);
    put("frames.excluded.damaged", &unusable.damaged);
    put("frames.void", &counts.excluded.void);
    // With these the file's own count closes: logged + dropped = received + leftover + repeated.
    put("frames.leftover", &counts.excluded.leftover);
    put("frames.repeated", &counts.excluded.repeated);
    put("frames.lost_at_end", &counts.lost_at_end);
    put("source.restarts", &counts.restarts);
    if let Some(poses) = poses {
        put("poses.fitted", &poses.fitted);
        put("poses.doubtful", &poses.flagged);
        put("poses.none", &poses.none.values().sum::<u64>());
        for (reason, n) in &poses.none {
            put(&format!("poses.none.{reason}"), &n);
        }
        put("poses.skipped", &poses.skipped);
        put("poses.opening", &poses.opening);
        for (key, value) in poses.response.iter().flat_map(Found::metadata) {
            put(&key, &value);
        }
    }
    if let Some(stats) = thrusters {
        put("commands.sets", &stats.sets);
        put("commands.echoed", &stats.echoed);
        put("commands.skipped", &stats.skipped);
        put("commands.link_losses", &stats.losses);
        put("commands.neutral_confirmed", &!stats.neutral_open);
    }
    summary
}
