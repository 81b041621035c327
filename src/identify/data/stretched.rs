//! Runs cut where nothing of them is left to know.

use hydroline_core::run::{Run, longest_step_s};
use hydroline_rigs::Rig;

use super::memory_s;

/// Logs whose samples are too far apart to show motion.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "{logs} log(s): no four samples in a row are less than {apart_s:.0} s apart, the time constant of the vehicle's slowest motion, so that they do not show how it moves: are the stamps of the import right ([time] unit)?"
)]
pub struct TooSparse {
    /// Number of logs.
    pub logs: usize,
    /// Distance of samples at which motion no longer shows \[s\].
    pub apart_s: f64,
}

/// Runs cut at gaps that are longer than the rig's vehicle remembers, without samples that are too far apart to show motion.
///
/// # Errors
/// [`TooSparse`] where nothing is left.
pub fn stretched(runs: &[Run], rig: &Rig) -> Result<Vec<Run>, TooSparse> {
    let memory_s = memory_s(&rig.vehicle);
    let all: Vec<Run> = runs.iter().flat_map(|r| r.stretches(memory_s)).collect();
    match all.is_empty() && !runs.is_empty() {
        true => Err(TooSparse {
            logs: runs.len(),
            apart_s: longest_step_s(memory_s),
        }),
        false => Ok(all),
    }
}
