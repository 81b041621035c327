//! A run's poses bound together by the vehicle's dynamics.
//!
//! One frame leaves one combination of x, z and θ weak (theory/geometry.md, one frame: δz = l δθ, δx = −H δθ) and
//! shows the sheet's thickness no better. A vehicle of 30 kg with its added mass cannot jump
//! along that combination from one frame to the next, and the sheet stays as thick as it is: so
//! the frames of a run are smoothed together (extended Kalman filter forwards, Rauch–Tung–Striebel
//! backwards), with the state
//!
//! η (6: tank frame), ν (6: body rates), d (6: accelerations that the model does not know), σ (thickness).
//!
//! η and ν follow the rig's equations of motion under the commands of the log plus d; d is a random
//! walk whose strength per DOF is the most likely one for the run's own poses. Where nothing
//! disturbs the vehicle d is found to be small and a run is bound tightly; where it is pushed
//! about, d follows. The rig's coefficients thus only lend their shape where the poses agree with
//! them: what they miss goes into d, not into the poses.

mod dynamics;
mod filter;
mod measurement;
mod tune;

pub use dynamics::Dynamics;
pub use measurement::{Measured, MeasuredFrame};

use crate::joint::MapLoadings;
use nalgebra::{Matrix6, SMatrix, SVector};

/// η, ν, d, σ.
pub(crate) const STATES: usize = 19;
/// Place of ν.
pub(crate) const RATES: usize = 6;
/// Place of d.
pub(crate) const ACCELERATIONS: usize = 12;
/// Place of σ, in units of [`THICKNESS_UNIT_M`].
pub(crate) const THICKNESS: usize = 18;
/// The state holds the thickness in tenths of a millimetre, so that all variances are of one kind.
pub(crate) const THICKNESS_UNIT_M: f64 = 1e-4;

pub(crate) type State = SVector<f64, STATES>;
pub(crate) type Square = SMatrix<f64, STATES, STATES>;

/// Fewest frames with a pose.
pub const FRAMES_MIN: usize = 4;
/// Longest gap between frames that the dynamics bridge \[s\].
pub const GAP_MAX_S: f64 = 5.0;
/// Longest gap between frames, with or without poses \[s\]: what lies behind is another run, and what it costs to integrate over
/// the gap is bounded.
const FRAMES_GAP_MAX_S: f64 = 120.0;

/// One smoothed frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Smoothed {
    /// When \[ns\], as measured.
    pub stamp_ns: u64,
    /// x, y, z \[m\], φ, θ, ψ \[rad\].
    pub eta: [f64; 6],
    /// u, v, w \[m/s\], p, q, r \[rad/s\], body frame.
    pub nu: [f64; 6],
    /// Covariance of η \[m², rad²\], of the frames' own errors.
    pub covariance: Matrix6<f64>,
    /// What errors that all poses share do to it, as the nearest frame with a pose states it: averaging leaves them.
    pub loadings: MapLoadings,
    /// Whether this run determines each of η at all.
    pub measured: [bool; 6],
    /// The frame had a pose of its own.
    pub own: bool,
}

/// A smoothed run.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// One per frame given, in their order.
    pub frames: Vec<Smoothed>,
    /// Thickness of the sheet over the run \[m\]; `None` where no frame measured it.
    pub thickness_m: Option<f64>,
    /// Its sd \[m\].
    pub thickness_sd_m: f64,
    /// Strength of the unknown accelerations' walk per DOF: sd gained in one second \[m/s², rad/s²\].
    pub walk_sd_per_root_s: [f64; 6],
    /// Frames whose pose disagreed with its neighbours and counted less.
    pub downweighted: usize,
    /// Squared innovation per measured number, mean over the run: 1 where covariances are honest.
    pub chi2: f64,
}

/// Failure to smooth a run.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum SmoothError {
    #[error(
        "{frames} frames with a pose, at least {needed} are needed to bind a run: replay without --smooth"
    )]
    TooFew { frames: usize, needed: usize },
    #[error(
        "frame {frame}: its stamp does not follow the one before; smooth one recording at a time"
    )]
    Order { frame: usize },
    #[error(
        "{gap_s:.1} s without a pose before frame {frame}, more than the dynamics bridge ({allowed_s} s): cut the log there, or replay without --smooth"
    )]
    Gap {
        frame: usize,
        gap_s: f64,
        allowed_s: f64,
    },
    #[error(
        "frame {frame}: the smoother diverged (not finite); check [vehicle] in the rig, or replay without --smooth"
    )]
    Diverged { frame: usize },
}

/// Loadings of the frame with a pose that is the nearest in time.
fn loadings_at(frames: &[MeasuredFrame], stamp_ns: u64) -> MapLoadings {
    let after = frames.partition_point(|f| f.stamp_ns < stamp_ns);
    let of =
        |f: &MeasuredFrame| Some((f.stamp_ns.abs_diff(stamp_ns), f.measured.as_ref()?.loadings));
    let near = [
        frames[..after].iter().rev().find_map(of),
        frames[after..].iter().find_map(of),
    ];
    let nearest = near.into_iter().flatten().min_by_key(|(away, _)| *away);
    nearest.map_or_else(MapLoadings::zeros, |(_, by)| by)
}

/// Smooths the frames of one run, in the order of their stamps.
pub fn smooth(frames: &[MeasuredFrame], dynamics: &Dynamics) -> Result<Run, SmoothError> {
    check(frames)?;
    let walk_sd = tune::most_likely(frames, dynamics)?;
    let filtered = filter::forwards(frames, dynamics, &walk_sd, true)?;
    let smoothed = filter::backwards(&filtered)?;
    let shown: [bool; 6] = std::array::from_fn(|i| {
        frames
            .iter()
            .any(|f| f.measured.as_ref().is_some_and(|m| m.measured[i]))
    });
    let out = frames
        .iter()
        .zip(&smoothed)
        .map(|(frame, (x, p))| Smoothed {
            loadings: loadings_at(frames, frame.stamp_ns),
            stamp_ns: frame.stamp_ns,
            eta: std::array::from_fn(|i| x[i]),
            nu: std::array::from_fn(|i| x[RATES + i]),
            covariance: Matrix6::from_fn(|i, j| if shown[i] && shown[j] { p[(i, j)] } else { 0.0 }),
            measured: shown,
            own: frame.measured.is_some(),
        });
    let thick = frames
        .iter()
        .any(|f| f.measured.as_ref().is_some_and(|m| m.thickness));
    let last = smoothed.last();
    Ok(Run {
        frames: out.collect(),
        thickness_m: last
            .filter(|_| thick)
            .map(|(x, _)| x[THICKNESS] * THICKNESS_UNIT_M),
        thickness_sd_m: last.map_or(0.0, |(_, p)| p[(THICKNESS, THICKNESS)].sqrt())
            * THICKNESS_UNIT_M,
        walk_sd_per_root_s: walk_sd,
        downweighted: filtered.downweighted,
        chi2: filtered.chi2,
    })
}

fn check(frames: &[MeasuredFrame]) -> Result<(), SmoothError> {
    let with = frames.iter().filter(|f| f.measured.is_some()).count();
    if with < FRAMES_MIN {
        return Err(SmoothError::TooFew {
            frames: with,
            needed: FRAMES_MIN,
        });
    }
    let mut last_pose_ns = None;
    for (frame, f) in frames.iter().enumerate() {
        if frame > 0 && f.stamp_ns <= frames[frame - 1].stamp_ns {
            return Err(SmoothError::Order { frame });
        }
        let before_ns = frames[frame.saturating_sub(1)].stamp_ns;
        let gap_s = f.stamp_ns.saturating_sub(before_ns) as f64 * 1e-9;
        if gap_s > FRAMES_GAP_MAX_S {
            return Err(SmoothError::Gap {
                frame,
                gap_s,
                allowed_s: FRAMES_GAP_MAX_S,
            });
        }
        if f.measured.is_none() {
            continue;
        }
        let gap_s = last_pose_ns.map_or(0.0, |last: u64| (f.stamp_ns - last) as f64 * 1e-9);
        if gap_s > GAP_MAX_S {
            return Err(SmoothError::Gap {
                frame,
                gap_s,
                allowed_s: GAP_MAX_S,
            });
        }
        last_pose_ns = Some(f.stamp_ns);
    }
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
