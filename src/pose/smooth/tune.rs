//! Strength of unknown accelerations per DOF: the most likely one for the run's poses.
//!
//! The DOFs hardly share their innovations, so the strengths are searched one after the other on
//! a grid of factors, twice, coarse and fine. The result depends on the poses alone.

use super::{Dynamics, MeasuredFrame, SmoothError, filter};

/// Where the search starts: sd gained in one second \[m/s², rad/s²\].
const START: [f64; 6] = [0.02, 0.02, 0.02, 0.1, 0.1, 0.1];
/// Weakest and strongest. The weakest still lets 1 mm/s² come and go within a run, so that a rig
/// whose coefficients are off does not bias the poses.
const RANGE: [f64; 2] = [3e-4, 30.0];
/// Frames looked at; a longer run is judged by its first ones.
const FRAMES: usize = 400;

pub(super) fn most_likely(
    frames: &[MeasuredFrame],
    dynamics: &Dynamics,
) -> Result<[f64; 6], SmoothError> {
    let some = &frames[..frames.len().min(FRAMES)];
    let judged = |walk_sd: &[f64; 6]| {
        filter::forwards(some, dynamics, walk_sd, true)
            .map(|filtered| filtered.minus_two_log_likelihood)
    };
    let mut walk_sd = START;
    let mut best = judged(&walk_sd)?;
    for factor in [10.0, 10.0, 3.0] {
        for dof in 0..6 {
            for way in [factor, 1.0 / factor] {
                // Strides go on as long as they pay.
                loop {
                    let mut tried = walk_sd;
                    tried[dof] = (tried[dof] * way).clamp(RANGE[0], RANGE[1]);
                    if tried[dof] == walk_sd[dof] {
                        break;
                    }
                    // A strength under which the filter diverges is not likely.
                    let Ok(cost) = judged(&tried) else { break };
                    if cost >= best {
                        break;
                    }
                    (walk_sd, best) = (tried, cost);
                }
            }
        }
    }
    Ok(walk_sd)
}
