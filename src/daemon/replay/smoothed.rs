//! `replay --smooth`: the poses of a whole log first, bound together, then written frame by frame.

use super::{Analysed, BATCH, Options, ReplayError, commanded};
use hydroline_core::frame::Frame;
use hydroline_log::Record;
use hydroline_log::messages::{pb::VehicleMotion, unix_ns};
use hydroline_pose::run::{PoseRun, RunPose, smoothed_message};
use hydroline_pose::smooth::{Dynamics, MeasuredFrame, smooth};
use hydroline_rigs::Rig;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::HashMap;
use std::path::Path;

/// Account of a run whose frames were bound.
#[derive(Debug, Clone, PartialEq, Default, Serialize, schemars::JsonSchema)]
pub struct SmoothReport {
    /// Frames given a pose.
    pub frames: usize,
    /// Of these, frames without a pose of their own, filled in between their neighbours.
    pub filled: usize,
    /// Frames that disagreed with their neighbours and counted less.
    #[serde(rename = "doubted")]
    pub downweighted: usize,
    /// Squared innovation per measured number: about 1 where the frames' covariances are honest.
    pub chi2: f64,
    /// Reported sd of single frames, rms: x, y, z \[m\], φ, θ, ψ \[rad\].
    pub sd_single: [f64; 6],
    /// Reported sd after smoothing, rms.
    pub sd_smoothed: [f64; 6],
    /// Thickness of the laser sheet over the run \[m\].
    pub thickness_m: Option<f64>,
    /// Its sd \[m\].
    pub thickness_sd_m: f64,
    /// sd that unknown accelerations were found to gain in one second \[m/s², rad/s²\].
    #[serde(rename = "push_per_root_s")]
    pub walk_sd_per_root_s: [f64; 6],
}

/// Smoothed motion by stamp, and the account.
pub(super) type Bound = (HashMap<u64, VehicleMotion>, SmoothReport);

/// Reads the log once for its poses and binds them through the rig's dynamics.
/// It binds the sheet's thickness over the run by itself.
pub(super) fn bound(
    log: &Path,
    options: &Options,
    run: Option<&PoseRun>,
    rig: &Rig,
) -> Result<Bound, ReplayError> {
    let mut run = run.map(|run| run.with_fitter(run.fitter().with_thickness_open()));
    let mut frames: Vec<MeasuredFrame> = Vec::new();
    let mut commands: Vec<(u64, String, f64)> = Vec::new();
    let mut pending: Vec<Frame> = Vec::with_capacity(BATCH);
    for message in options.open(log)? {
        match message?.record {
            Record::Frame(frame) => {
                pending.push(frame);
                if pending.len() == BATCH {
                    measure(&mut pending, &mut run, options, &mut frames);
                }
            }
            Record::Command(command) => {
                if let Some(run) = &mut run {
                    commanded(run, &command);
                }
                let stamp_ns = command.timestamp.as_ref().map_or(0, unix_ns);
                commands.push((stamp_ns, command.thruster, command.thrust_n));
            }
            _ => {}
        }
    }
    measure(&mut pending, &mut run, options, &mut frames);
    let named = commands
        .iter()
        .map(|(ns, name, n)| (*ns, name.as_str(), *n));
    let dynamics = Dynamics::with_commands(rig, named).map_err(|e| ReplayError::Dynamics {
        reason: e.to_string(),
    })?;
    let smoothed = smooth(&frames, &dynamics)?;
    let mut report = SmoothReport {
        frames: smoothed.frames.len(),
        filled: smoothed.frames.iter().filter(|f| !f.own).count(),
        downweighted: smoothed.downweighted,
        chi2: smoothed.chi2,
        thickness_m: smoothed.thickness_m,
        thickness_sd_m: smoothed.thickness_sd_m,
        walk_sd_per_root_s: smoothed.walk_sd_per_root_s,
        ..SmoothReport::default()
    };
    for i in 0..6 {
        let single = frames
            .iter()
            .filter_map(|f| f.measured.as_ref())
            .map(|m| m.covariance[(i, i)]);
        report.sd_single[i] = rms(single);
        report.sd_smoothed[i] = rms(smoothed.frames.iter().map(|f| f.covariance[(i, i)]));
    }
    let motions = smoothed
        .frames
        .iter()
        .map(|f| (f.stamp_ns, smoothed_message(f)));
    Ok((motions.collect(), report))
}

fn rms(variances: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = variances.fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
    (sum / f64::max(n, 1.0)).sqrt()
}

/// Extracts and fits in parallel, takes over in order.
fn measure(
    pending: &mut Vec<Frame>,
    run: &mut Option<PoseRun>,
    options: &Options,
    frames: &mut Vec<MeasuredFrame>,
) {
    let analysed: Vec<_> = pending
        .par_iter()
        .map_init(
            || options.analyst(),
            |analyst, frame| {
                run.as_ref()
                    .and_then(|run| Analysed::of(analyst, Some(run), frame).posed)
            },
        )
        .collect();
    for (frame, pixels) in pending.drain(..).zip(analysed) {
        let stamp_ns = frame.meta.mid_exposure_ns;
        let pose = run
            .as_mut()
            .zip(pixels)
            .map(|(run, (image, profile, speculative))| {
                run.pose_speculative(stamp_ns, &image, &profile, speculative)
            });
        frames.push(MeasuredFrame {
            stamp_ns,
            measured: match pose {
                Some(RunPose::Good(fit)) => Some(fit.as_ref().into()),
                _ => None,
            },
        });
    }
}
