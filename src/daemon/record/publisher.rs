//! The live page of a recording: what the threads leave on their way, put together on a thread that nobody waits for.
//!
//! The thruster service and whoever has an event only post ([`Desk::post`] tries once and never waits); what finds no room
//! is missing on the page and nowhere else. The capture thread leaves nothing here: its counters are read.

use super::measured_pose::MeasuredPose;
use super::{Job, Shared, Status};
use crate::live::excited::Excited;
use crate::live::outline::Scene;
use crate::live::prediction::Prediction;
use crate::live::{Live, picture, thrusters};
use crate::record::mailbox::{Mailbox, Taken};
use hydroline_calib::Pose;
use hydroline_calib::plane::PlaneMap;
use hydroline_core::frame::{Frame, GreyRule};
use hydroline_core::lock::Lock;
use hydroline_core::thread_class::{block_signals, step_back};
use hydroline_live::State;
use hydroline_live::state::{self, Clock, Disk, Frames, Run, Thruster};
use hydroline_log::messages::pb::StripeProfile;
use hydroline_log::{bytes_per_s, free_bytes};
use hydroline_rigs::Rig;
use hydroline_thruster::record::{CommandRecord, EchoRecord};
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

/// Notes that may wait: eight thrusters at 50 Hz, commands and echoes, for five seconds.
const WAITING: usize = 4096;
/// The frame rate is that of so many looks, ten a second.
const RATE_LOOKS: usize = 20;
/// A pose older than this says nothing about where the next frame shows the target \[s\].
const FRESH_S: f64 = 1.0;

/// Note that a thread leaves for the page.
#[derive(Debug, Clone)]
pub(super) enum Note {
    Command(CommandRecord),
    Echo(EchoRecord),
    Event(state::Event),
    /// A pose, and when it was true on CLOCK_MONOTONIC \[ns\] and UNIX \[ns\].
    Pose(MeasuredPose, u64, u64),
    /// The recording is over, for this reason.
    End(String),
}

/// Where the threads of a recording leave what the page shows.
pub(super) struct Desk {
    live: Live,
    rule: GreyRule,
    scene: Option<Scene>,
    start_pose: [f64; 6],
    post: SyncSender<Note>,
    inbox: Mutex<Option<Receiver<Note>>>,
    /// The last two poses and when they were true, UNIX \[ns\].
    poses: Mutex<VecDeque<(u64, Pose)>>,
    pub(super) status: Mailbox<Status>,
}

impl Desk {
    pub(super) fn new(live: Live, job: &Job, map: Option<Arc<dyn PlaneMap>>) -> Self {
        let (post, inbox) = sync_channel(WAITING);
        // Where a board stands there is no target to expect.
        let map = map.filter(|_| job.calibrate.is_none());
        Self {
            live,
            rule: job.rig.grey_rule(),
            scene: map.map(|map| Scene::new(&job.rig, map)),
            start_pose: job.rig.tank.start_pose,
            post,
            inbox: Mutex::new(Some(inbox)),
            poses: Mutex::new(VecDeque::new()),
            status: Mailbox::default(),
        }
    }

    pub(super) fn live(&self) -> &Live {
        &self.live
    }

    /// Leaves a note if there is room. Never waits.
    pub(super) fn post(&self, note: Note) {
        let _ = self.post.try_send(note);
    }

    /// Shows a frame, if anybody looks. Called by the analysis.
    pub(super) fn show(&self, frame: &Frame, profile: &StripeProfile) {
        if !self.live.feed.is_watched() {
            return;
        }
        let pose = self.pose_at(frame.meta.mid_exposure_ns);
        let outline = self
            .scene
            .as_ref()
            .zip(pose)
            .map(|(s, pose)| s.outline(&pose));
        self.live
            .feed
            .show(picture(frame, profile, self.rule, outline));
    }

    /// A pose was measured. Called by the poses.
    pub(super) fn pose(&self, measured: MeasuredPose, at_ns: u64, stamp_ns: u64) {
        let eta =
            std::array::from_fn(|i| measured.eta[i].map_or(self.start_pose[i], |(value, _)| value));
        let mut poses = self.poses.held();
        if poses.len() == 2 {
            poses.pop_front();
        }
        poses.push_back((stamp_ns, Pose::from_array(eta)));
        drop(poses);
        self.post(Note::Pose(measured, at_ns, stamp_ns));
    }

    /// Where the vehicle was at a stamp: on from the last two poses, for a pose takes longer to fit than a stripe.
    fn pose_at(&self, stamp_ns: u64) -> Option<Pose> {
        let poses = self.poses.held();
        let (t1_ns, last) = poses.back()?;
        let ahead_s = (stamp_ns as f64 - *t1_ns as f64) * 1e-9;
        if ahead_s.abs() > FRESH_S {
            return None;
        }
        let Some((t0_ns, before)) = poses.front().filter(|(t0_ns, _)| t0_ns < t1_ns) else {
            return Some(*last);
        };
        let part = ahead_s / ((t1_ns - t0_ns) as f64 * 1e-9);
        let (a, b) = (before.to_array(), last.to_array());
        Some(Pose::from_array(std::array::from_fn(|i| {
            b[i] + part * (b[i] - a[i])
        })))
    }
}

/// Starts the thread that puts the page's state together; it ends when the desk's status is closed.
pub(super) fn start(shared: Arc<Shared>, job: &Job) -> Option<JoinHandle<()>> {
    let inbox = {
        let desk = shared.desk.as_ref()?;
        let mut inbox = desk.inbox.held();
        inbox.take()?
    };
    let board = Board::new(job);
    let spawned = std::thread::Builder::new()
        .name("live state".to_owned())
        .spawn(move || {
            block_signals();
            step_back(15);
            // A page that fails is no reason to end a run.
            if catch_unwind(AssertUnwindSafe(|| publish(&shared, board, &inbox))).is_err() {
                tracing::error!("the live page's state stands still: this is a bug of hydroline; the recording goes on");
            }
        });
    match spawned {
        Ok(thread) => Some(thread),
        Err(error) => {
            tracing::warn!("no live page: {error}");
            None
        }
    }
}

fn publish(shared: &Shared, mut board: Board, inbox: &Receiver<Note>) {
    let Some(desk) = &shared.desk else { return };
    loop {
        let status = match desk.status.take(Duration::from_secs(1)) {
            Taken::Item(status) => Some(status),
            Taken::Nothing => None,
            Taken::Closed => return,
        };
        for note in inbox.try_iter() {
            board.take(note);
        }
        if let Some(status) = status {
            board.status = status;
        }
        let state = board.state(shared, desk);
        desk.live.feed.publish(state);
    }
}

/// Everything the page's state is made of.
struct Board {
    rig: Rig,
    plan: Option<(String, u32)>,
    length_s: Option<f64>,
    thrusters: Vec<Thruster>,
    /// Cause and step of the newest command.
    newest: (&'static str, u32),
    events: VecDeque<state::Event>,
    pose: Option<(MeasuredPose, u64, u64)>,
    /// The newest pose beside the prediction of its own time: later the prediction knows it no more.
    predicted: Option<[f64; 6]>,
    /// The newest pose has not been compared yet.
    uncompared: bool,
    prediction: Prediction,
    excited: Excited,
    looked_ns: Option<u64>,
    /// Frames received at the last looks, CLOCK_MONOTONIC \[ns\].
    received: VecDeque<(u64, u64)>,
    status: Status,
    end: Option<String>,
}

impl Board {
    fn new(job: &Job) -> Self {
        Self {
            rig: job.rig.clone(),
            plan: job
                .plan
                .as_ref()
                .map(|p| (p.name.clone(), p.steps.len() as u32)),
            length_s: job.length.map(|l| l.as_secs_f64()),
            thrusters: thrusters(&job.rig),
            newest: ("", 0),
            events: VecDeque::new(),
            pose: None,
            predicted: None,
            uncompared: false,
            prediction: Prediction::new(&job.rig),
            excited: Excited::new(&job.rig),
            looked_ns: None,
            received: VecDeque::new(),
            status: Status::default(),
            end: None,
        }
    }

    fn take(&mut self, note: Note) {
        match note {
            Note::Command(command) => {
                let place = self.place(&command.thruster);
                if let Some(place) = place {
                    self.prediction
                        .command(place, command.thrust_n, command.sent_monotonic_ns);
                    let thruster = &mut self.thrusters[place];
                    thruster.thrust_n = Some(command.thrust_n);
                    thruster.pulse_us = Some(command.pulse_us);
                }
                self.newest = (command.cause, command.plan_step);
            }
            Note::Echo(echo) => {
                if let Some(place) = self.place(&echo.thruster) {
                    let curve = &self.rig.thrusters.thrusters[place].curve;
                    let thruster = &mut self.thrusters[place];
                    thruster.echo_us = Some(echo.pulse_us);
                    thruster.echo_n = Some(curve.thrust_n(echo.pulse_us));
                }
            }
            Note::Event(event) => state::keep(&mut self.events, event),
            Note::Pose(pose, at_ns, stamp_ns) => {
                self.pose = Some((pose, at_ns, stamp_ns));
                self.uncompared = true;
            }
            Note::End(words) => self.end = Some(words),
        }
    }

    fn place(&self, name: &str) -> Option<usize> {
        self.thrusters.iter().position(|t| t.name == name)
    }

    fn state(&mut self, shared: &Shared, desk: &Desk) -> State {
        let now_ns = shared.clock.monotonic_ns();
        let motion = self.prediction.advance(now_ns);
        let step_s = self
            .looked_ns
            .map_or(0.0, |last| now_ns.saturating_sub(last) as f64 * 1e-9);
        self.looked_ns = Some(now_ns);
        let drives = shared.drives;
        if let Some((_, at_ns, _)) = self.pose.filter(|_| self.uncompared) {
            self.predicted = self.prediction.at(at_ns).filter(|_| drives);
            self.uncompared = false;
        }
        if let Some(motion) = motion.filter(|_| drives && self.status.elapsed_s.is_some()) {
            self.excited.look(&motion, step_s);
        }
        State {
            mode: "record",
            title: desk.live.title.clone(),
            phase: self.phase(shared, desk),
            ended: self.end.is_some(),
            run: Run {
                elapsed_s: self.status.elapsed_s,
                length_s: self.length_s,
                plan: self.plan.as_ref().map(|p| p.0.clone()),
                step: self.newest.1,
                steps: self.plan.as_ref().map_or(0, |p| p.1),
            },
            frames: self.frames(now_ns),
            disk: Some(self.disk(desk)),
            clock: clock(shared),
            pose: self.pose.map(|(pose, at_ns, stamp_ns)| {
                let age_s = now_ns.saturating_sub(at_ns) as f64 * 1e-9;
                state::Pose::new(
                    "measured",
                    stamp_ns as f64 * 1e-9,
                    age_s,
                    pose.eta,
                    self.predicted,
                )
            }),
            thrusters: if drives {
                self.thrusters.clone()
            } else {
                Vec::new()
            },
            not_shown: if drives && self.plan.is_some() {
                self.excited.missing()
            } else {
                Vec::new()
            },
            events: self.events.clone(),
            ..State::default()
        }
    }

    fn phase(&self, shared: &Shared, desk: &Desk) -> String {
        if let Some(words) = &self.end {
            return format!("ended: {words}");
        }
        if let Some(reason) = shared.shutdown.reason() {
            return format!("closing the log: {reason}");
        }
        if desk.live.feed.pressed() {
            return "STOP was pressed: thrusters at neutral, recording goes on".to_owned();
        }
        if self.status.elapsed_s.is_none() {
            return "waiting for camera and controller".to_owned();
        }
        if let Some(line) = &self.status.calibration {
            return line.clone();
        }
        match (&self.plan, self.newest) {
            (Some((name, _)), ("plan", _)) => format!("plan {name} is running"),
            (Some((name, _)), (_, 0)) => format!("plan {name}: thrusters at neutral"),
            (Some((name, _)), (cause, _)) => format!("plan {name}: {cause}"),
            (None, _) => "recording".to_owned(),
        }
    }

    fn frames(&mut self, now_ns: u64) -> Frames {
        let status = &self.status;
        if self.received.len() == RATE_LOOKS {
            self.received.pop_front();
        }
        self.received.push_back((now_ns, status.frames));
        let first = self.received.front().copied().unwrap_or_default();
        let over_s = now_ns.saturating_sub(first.0) as f64 * 1e-9;
        let frames = status.frames.saturating_sub(first.1) as f64;
        Frames {
            received: status.frames,
            lost: status.lost,
            dropped: status.dropped,
            skipped: status.skipped,
            rate_fps: (over_s > 0.5).then(|| frames / over_s),
            points: status.points as u64,
        }
    }

    fn disk(&self, desk: &Desk) -> Disk {
        let per_min = 60.0 * bytes_per_s(&self.rig.camera);
        let free = free_bytes(&desk.live.log);
        Disk {
            bytes: self.status.bytes,
            left_min: free
                .map(|free| free.saturating_sub(self.rig.log.min_free_bytes) as f64 / per_min)
                .filter(|min| min.is_finite()),
        }
    }
}

fn clock(shared: &Shared) -> Option<Clock> {
    let clock = *shared.controller.held();
    clock.map(|c| Clock {
        offset_sd_us: c.offset_sd_us,
        drift_ppm: c.drift_ppm,
        round_trip_us: c.round_trip_us,
    })
}
