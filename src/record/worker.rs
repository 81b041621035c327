//! The two threads around the camera: capture, which waits for nothing else, and analysis, which
//! takes the newest frame when it has time.

use super::{Job, RecordError, Shared, floor, limits::LimitMonitor, newest::Taken};
use crate::analysis::Analyst;
use crate::capture::{CaptureCounts, Captured, FrameSource};
use crate::event::Severity;
use crate::log::messages::{self, pb::StripeProfile};
use crate::pose::run::{PoseRun, RunPose, motion_message};
use crate::shutdown::StopReason;
use crate::thruster::NeutralHandle;
use crate::thruster::safety::NeutralReason;
use hydroline_calib::plane::PlaneMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

/// Longest wait in either thread before it looks at the shutdown again.
const LOOK: Duration = Duration::from_millis(100);

/// Starts a thread. Should it panic, the run ends at once (and with it the thrusters), with words.
fn spawn<T: Send + 'static>(
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
                shared.say(Severity::Error, "daemon.panic", words);
            }
            result.ok()
        })
        .map_err(|source| RecordError::Start { what, source })
}

/// A signal must not interrupt a camera's ioctl: the main thread alone takes them.
fn block_signals() {
    // SAFETY: sigset_t is plain data filled by sigfillset; only this thread's mask changes.
    unsafe {
        let mut set: libc::sigset_t = std::mem::zeroed();
        libc::sigfillset(&mut set);
        libc::pthread_sigmask(libc::SIG_BLOCK, &set, std::ptr::null_mut());
    }
}

/// Waits for a thread; `None` when it panicked, which it has then said itself.
pub(super) fn join<T>(thread: JoinHandle<Option<T>>) -> Option<T> {
    thread.join().ok().flatten()
}

/// Captures until shutdown; returns the source's account.
pub(super) fn capture(
    shared: Arc<Shared>,
    mut source: Box<dyn FrameSource>,
) -> Result<JoinHandle<Option<CaptureCounts>>, RecordError> {
    spawn("capture", shared, move |shared| {
        let mut index = 0;
        while !shared.shutdown.is_raised() {
            match source.next(LOOK) {
                Ok(Captured::Frame(frame)) => {
                    shared.recorder.frame(&frame, index);
                    index += 1;
                    let good = frame.meta.fault.is_none();
                    let counts = source.counts();
                    shared.progress(|p| {
                        p.counts = counts;
                        if good {
                            p.first_good_ns.get_or_insert(frame.meta.received_monotonic_ns);
                        }
                    });
                    shared.newest.put(frame);
                }
                Ok(Captured::Event(event)) => shared.event(&event),
                Ok(Captured::Nothing) => {
                    let counts = source.counts();
                    shared.progress(|p| p.counts = counts);
                }
                Ok(Captured::Finished) => shared.shutdown.raise(StopReason::SourceEnded),
                Err(error) => {
                    shared.say(Severity::Error, "camera.failed", error.to_string());
                    shared.shutdown.raise(StopReason::Failed(error.to_string()));
                }
            }
        }
        source.counts()
    })
}

/// Analyses the newest frame whenever there is time, and watches the rig's limits.
pub(super) fn analysis(
    shared: Arc<Shared>,
    job: &Job,
    map: Option<Arc<dyn PlaneMap>>,
    neutral: Option<NeutralHandle>,
) -> Result<JoinHandle<Option<()>>, RecordError> {
    let mut poses = map.clone().map(|map| PoseRun::new(&job.rig, map));
    let mut analyst = Analyst::new(job.extractor.clone(), map);
    let mut monitor = LimitMonitor::new(job.rig.limits);
    let h_centre_m = job.rig.mounts.h_centre_m;
    spawn("analysis", shared, move |shared| {
        loop {
            match shared.newest.take(LOOK) {
                Taken::Item(frame) => {
                    let (profile, pixels) = analyst.analyse_whole(&frame);
                    shared.recorder.profile(&profile);
                    shared.recorder.annotations(&messages::stripe_annotations(&profile));
                    shared.progress(|p| {
                        p.analysed += 1;
                        p.points = profile.row_px.len();
                    });
                    if let (Some(poses), Some((image, full))) = (&mut poses, &pixels) {
                        let stamp_ns = frame.meta.mid_exposure_ns;
                        if let RunPose::Good(fit) = poses.pose(stamp_ns, image, full) {
                            let motion = motion_message(stamp_ns, &fit);
                            shared.recorder.motion(&motion);
                            if let Some(pose) = messages::pose_message(&motion) {
                                shared.recorder.pose(&pose);
                            }
                        }
                    }
                    let mut estimate = shared.tracker.estimate(frame.meta.mid_exposure_ns);
                    if let Some(floor) = floor::floor(&plane_points(&profile), h_centre_m) {
                        estimate.z_m = Some(-floor.height_m);
                        estimate.phi_rad = Some(floor.phi_rad);
                    }
                    if let Some(words) = monitor.update(&estimate) {
                        if let Some(neutral) = &neutral {
                            neutral.request(NeutralReason::Limit);
                        }
                        shared.say(Severity::Error, "limit.passed", words.clone());
                        shared.shutdown.raise(StopReason::Limit(words));
                    }
                }
                Taken::Nothing => {}
                Taken::Closed => return,
            }
        }
    })
}

fn plane_points(profile: &StripeProfile) -> Vec<floor::PlanePointM> {
    let pairs = profile.xi_m.iter().zip(&profile.eta_m);
    pairs.map(|(xi, eta)| (f64::from(*xi), f64::from(*eta))).filter(|(xi, eta)| xi.is_finite() && eta.is_finite()).collect()
}
