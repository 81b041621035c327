//! The three threads around the camera: capture, which waits for nothing else, analysis, which
//! extracts the newest frame when it has time, and the poses, which fit the newest stripe when nobody else wants to.

use super::{
    Job, PoseCounts, RecordError, Shared, calibrating, floor, mailbox::Taken,
    measured_pose::MeasuredPose,
};
use crate::analysis::{Analyst, NotExtracted};
use crate::calibrate::live::Live;
use crate::response::Found;
use hydroline_calib::plane::PlaneMap;
use hydroline_capture::{CaptureCounts, Captured, FrameSource};
use hydroline_core::event::{Event, Severity, kind};
use hydroline_core::frame::{BlockAccount, Frame, GreyImage};
use hydroline_core::lock::Lock;
use hydroline_core::shutdown::StopReason;
use hydroline_core::thread_class::{block_signals, step_back};
use hydroline_log::{Entry, messages};
use hydroline_pose::joint::{JointPose, PoseFault};
use hydroline_pose::opening::{self, Opening};
use hydroline_pose::run::{PoseRun, RunPose, motion_message};
use hydroline_stripe::Profile;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

/// A frame's stripe on its way to the poses.
pub(super) struct Seen {
    /// Mid-exposure, UNIX \[ns\].
    pub stamp_ns: u64,
    /// When the frame was received, CLOCK_MONOTONIC \[ns\].
    pub received_ns: u64,
    /// Its luma.
    pub image: GreyImage,
    pub profile: Profile,
}

/// Longest wait in either thread before it looks at the shutdown again.
const LOOK: Duration = Duration::from_millis(100);

/// Starts a thread. Should it panic, the run ends at once (and with it the thrusters), with words.
pub(super) fn spawn<T: Send + 'static>(
    what: &'static str,
    shared: Arc<Shared>,
    work: impl FnOnce(&Shared) -> T + Send + 'static,
) -> Result<JoinHandle<Option<T>>, RecordError> {
    std::thread::Builder::new()
        .name(what.to_owned())
        .spawn(move || {
            block_signals();
            let result = catch_unwind(AssertUnwindSafe(|| work(&shared)));
            if result.is_err() {
                let words = format!("the {what} thread panicked: this is a bug of hydroline");
                shared.shutdown.raise(StopReason::Failed(words.clone()));
                shared.say(Severity::Error, &kind::DAEMON_PANIC, words);
            }
            result.ok()
        })
        .map_err(|source| RecordError::Start { what, source })
}

/// Waits for a thread; `None` when it panicked, which it has then said itself.
pub(super) fn join<T>(thread: JoinHandle<Option<T>>) -> Option<T> {
    thread.join().ok().flatten()
}

/// Most things fetched after the end: twice a driver's queue of 8, frames and events.
const DRAIN: usize = 16;

/// Hands one frame on: to the log, to the counters, to the analysis. Waits for none of them.
fn take(shared: &Shared, source: &dyn FrameSource, frame: Frame, index: u64) {
    shared.recorder.frame(&frame, index);
    let counts = source.counts();
    shared.progress(|p| p.received(&frame.meta, counts));
    shared.newest.put(frame);
}

/// Hands on an event of the source.
fn happened(shared: &Shared, source: &dyn FrameSource, event: &Event) {
    shared.event(event);
    if *event.kind == kind::CAMERA_ERROR_FRAME {
        *shared.unusable.held() = Some(event.message.clone());
    }
    if *event.kind == kind::CAMERA_REPLUGGED {
        describe_again(shared, source);
    }
}

/// The head of the log describes the camera of the start; the one that came back may have been set up otherwise.
fn describe_again(shared: &Shared, source: &dyn FrameSource) {
    let words = serde_json::to_string(&source.describe()).unwrap_or_default();
    shared.say(Severity::Info, &kind::CAMERA_SOURCE, words);
}

/// Captures until shutdown; returns the source's account.
pub(super) fn capture(
    shared: Arc<Shared>,
    mut source: Box<dyn FrameSource>,
) -> Result<JoinHandle<Option<CaptureCounts>>, RecordError> {
    spawn("capture", shared, move |shared| {
        let mut index = 0;
        while !shared.shutdown.is_raised() {
            shared.capture.beat();
            match source.next(LOOK) {
                Ok(Captured::Frame(frame)) => {
                    take(shared, &*source, frame, index);
                    index += 1;
                }
                Ok(Captured::Event(event)) => happened(shared, &*source, &event),
                Ok(Captured::Nothing) => {
                    let counts = source.counts();
                    shared.progress(|p| p.counts = counts);
                }
                Ok(Captured::Finished) => shared.shutdown.raise(StopReason::SourceEnded),
                Err(error) => {
                    shared.say(Severity::Error, &kind::CAMERA_FAILED, error.to_string());
                    shared.shutdown.raise(StopReason::Failed(error.to_string()));
                }
            }
        }
        // Frames that the driver already holds are not lost: at most one queue of them.
        for _ in 0..DRAIN {
            match source.next(Duration::ZERO) {
                Ok(Captured::Frame(frame)) => {
                    take(shared, &*source, frame, index);
                    index += 1;
                }
                Ok(Captured::Event(event)) => happened(shared, &*source, &event),
                _ => break,
            }
        }
        // Closes the account: what fell due up to now and never came is a loss too.
        source.finish();
        source.counts()
    })
}

/// Frames that nothing marks and that cannot be read.
#[derive(Debug, Default)]
struct Unread {
    frames: u64,
    /// Whether blocks that look like damage and are the picture's were said.
    said: bool,
}

impl Unread {
    /// Counts a frame and says why it cannot be read. It is in the log as it came.
    fn frame(&mut self, shared: &Shared, frame: &Frame, why: &str) {
        self.frames += 1;
        let at_ns = frame.meta.mid_exposure_ns;
        let words = format!("{why}; kept, excluded from analysis");
        let event = Event::new(at_ns, Severity::Warning, &kind::CAMERA_ERROR_FRAME, words);
        let event = event
            .with("sequence", f64::from(frame.meta.sequence))
            .with("bytes_used", frame.data.len() as f64);
        shared.event(&event);
        *shared.unusable.held() = Some(event.message);
    }

    /// Takes out of the count what turned out to be the camera's picture, and says that once.
    fn picture(&mut self, shared: &Shared, blocks: Option<&BlockAccount>) {
        let explained = blocks.map_or(0, BlockAccount::explained_later);
        shared.progress(|p| p.damaged = self.frames.saturating_sub(explained));
        if self.said {
            return;
        }
        let picture = blocks.map(BlockAccount::picture).unwrap_or_default();
        if let Some(words) = picture.words() {
            self.said = true;
            let at_ns = shared.clock.triple().realtime_ns;
            let event = Event::new(
                at_ns,
                Severity::Warning,
                &kind::CAMERA_PICTURE_BLOCKS,
                words,
            );
            shared.event(&event.with("blocks", picture.len() as f64));
        }
    }
}

/// Analyses the newest frame whenever there is time.
pub(super) fn analysis(
    shared: Arc<Shared>,
    job: &Job,
    map: Option<Arc<dyn PlaneMap>>,
) -> Result<JoinHandle<Option<()>>, RecordError> {
    let mut live = job.calibrate.clone().map(Live::new);
    let ends = job.length.is_none() && job.plan.is_none();
    // A board in the sheet is neither floor nor target.
    let with_poses = map.is_some() && live.is_none();
    let mut analyst = Analyst::new(job.extractor.clone(), map, job.rig.grey_rule()).learning();
    let h_centre_m = job.rig.mounts.h_centre_m;
    spawn("analysis", shared, move |shared| {
        step_back(10);
        let mut unread = Unread::default();
        loop {
            match shared.newest.take(LOOK) {
                Taken::Item(frame) => {
                    let (profile, pixels) = analyst.analyse_whole(&frame);
                    shared.progress(|p| p.looked_at(&frame.meta, pixels.is_ok()));
                    if matches!(pixels, Err(NotExtracted::Unreadable(_))) {
                        unread.frame(shared, &frame, &profile.fault);
                    }
                    unread.picture(shared, analyst.blocks());
                    shared.recorder.push(Entry::profile(&profile));
                    let drawing = messages::stripe_annotations(&profile);
                    shared.recorder.push(Entry::annotations(&drawing));
                    if let Some(desk) = &shared.desk {
                        desk.show(&frame, &profile);
                    }
                    if let (Some(live), Ok((image, _))) = (&mut live, &pixels) {
                        let stamp_ns = frame.meta.mid_exposure_ns;
                        calibrating::look(shared, live, image, stamp_ns, ends);
                    } else if let Some(floor) = floor::floor(&floor::points(&profile), h_centre_m) {
                        let at_ns = frame.meta.received_monotonic_ns;
                        *shared.floor.held() = Some((at_ns, floor));
                    }
                    shared.progress(|p| {
                        p.analysed += 1;
                        p.points = profile.row_px.len();
                    });
                    if let (true, Ok((image, full))) = (with_poses, pixels) {
                        shared.stripes.put(Seen {
                            stamp_ns: frame.meta.mid_exposure_ns,
                            received_ns: frame.meta.received_monotonic_ns,
                            image,
                            profile: full,
                        });
                    }
                }
                Taken::Nothing => {}
                Taken::Closed => return,
            }
        }
    })
}

/// Fits the pose of the newest stripe, behind everything else: a fit costs many times an extraction,
/// and must not keep stripes from being extracted.
pub(super) fn poses(
    shared: Arc<Shared>,
    job: &Job,
    map: Arc<dyn PlaneMap>,
) -> Result<JoinHandle<Option<PoseCounts>>, RecordError> {
    let mut poses = PoseRun::new(&job.rig, map);
    let mut opening = Some(Opening::new(&poses, opening::Options::default()));
    spawn("poses", shared, move |shared| {
        step_back(19);
        let mut counts = PoseCounts::default();
        let mut waiting = Waiting::default();
        loop {
            match shared.stripes.take(LOOK) {
                Taken::Item(seen) => {
                    let stamp_ns = seen.stamp_ns;
                    let commands = shared.commands.fetched();
                    if let Some(open) = &mut opening {
                        open.commands(&commands);
                        let pose = open.look(stamp_ns, &seen.image, &seen.profile);
                        waiting.see(shared, stamp_ns, &pose);
                        match pose {
                            RunPose::Good(fit) => {
                                counts.opening += 1;
                                measured(shared, &seen, &fit);
                            }
                            other => counts.count(&other),
                        }
                        if let Some(open) = opening.take_if(|open| open.is_over()) {
                            counts.response = Some(found(shared, &open));
                            poses = open.into_run();
                        }
                        continue;
                    }
                    poses.commands(&commands);
                    let pose = poses.pose(stamp_ns, &seen.image, &seen.profile);
                    waiting.see(shared, stamp_ns, &pose);
                    counts.count(&pose);
                    if let RunPose::Good(fit) = pose {
                        measured(shared, &seen, &fit);
                        let motion = motion_message(stamp_ns, &fit);
                        shared.recorder.push(Entry::motion(&motion));
                        if let Some(pose) = messages::pose_message(&motion) {
                            shared.recorder.push(Entry::pose(&pose));
                        }
                    }
                }
                Taken::Nothing => {}
                Taken::Closed => {
                    counts.skipped = shared.stripes.skipped();
                    return counts;
                }
            }
        }
    })
}

/// Without a pose for so long, what is waited for is said \[ns\].
const WAITING_SAID_NS: u64 = 1_000_000_000;

/// A gap in the poses of a run.
#[derive(Debug, Default)]
struct Waiting {
    /// Stamp of the last pose.
    last_ns: Option<u64>,
    said: bool,
}

impl Waiting {
    /// Sees a frame's outcome; says once per gap what is waited for.
    fn see(&mut self, shared: &Shared, stamp_ns: u64, pose: &RunPose) {
        let (words, carried) = match pose {
            RunPose::Good(_) => {
                *self = Waiting {
                    last_ns: Some(stamp_ns),
                    said: false,
                };
                return;
            }
            RunPose::Flagged(fit) => (fit.reasons(), fit.carried),
            RunPose::None(fault) => (fault.to_string(), None),
        };
        let Some(last_ns) = self.last_ns else {
            return;
        };
        let since_ns = stamp_ns.saturating_sub(last_ns);
        if self.said || since_ns < WAITING_SAID_NS {
            return;
        }
        self.said = true;
        let words = format!("no pose for {:.1} s: {words}", since_ns as f64 * 1e-9);
        let event = Event::new(stamp_ns, Severity::Warning, &kind::POSE_WAITING, words)
            .with("since_s", since_ns as f64 * 1e-9);
        let event = carried.iter().fold(event, |event, carried| {
            event.with("x_m", carried.x_m).with("x_sd_m", carried.sd_m)
        });
        shared.event(&event);
    }
}

/// Hands a measured pose to the limits, and to the page.
fn measured(shared: &Shared, seen: &Seen, fit: &JointPose) {
    let measured = MeasuredPose::of(seen.received_ns, fit);
    *shared.pose.held() = Some(measured);
    if let Some(desk) = &shared.desk {
        let now = shared.clock.triple();
        let ahead_ns = now.realtime_ns.saturating_sub(now.monotonic_ns);
        let at_ns = seen.stamp_ns.saturating_sub(ahead_ns);
        desk.pose(measured, at_ns, seen.stamp_ns);
    }
}

/// The camera's response as an opening shows it, said in the log.
fn found(shared: &Shared, opening: &Opening) -> Found {
    let found = Found::of(opening);
    shared.event(&found.event(shared.clock.triple().realtime_ns));
    found
}

impl PoseCounts {
    fn count(&mut self, pose: &RunPose) {
        match pose {
            RunPose::Good(_) => self.fitted += 1,
            RunPose::Flagged(_) => self.flagged += 1,
            RunPose::None(fault) => *self.none.entry(word(fault)).or_default() += 1,
        }
    }
}

/// A word for the summary's keys.
fn word(fault: &PoseFault) -> &'static str {
    match fault {
        PoseFault::NoStripe(_) => "no_stripe",
        PoseFault::Segments(_) => "segments",
        PoseFault::Size { .. } => "size",
        PoseFault::Nowhere { .. } => "nowhere_on_target",
        PoseFault::FloorOrFace { .. } => "floor_or_top",
        PoseFault::FarFromHint { .. } => "far_from_expected",
        PoseFault::Unexplained { .. } => "unexplained",
        PoseFault::NotConverged => "unsettled",
    }
}
