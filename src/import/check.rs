//! Findings about a table in SI: time, kinematics, units, dead channels, jumps.
//!
//! A table of any length is looked at a stretch at a time ([`Watch`]); what only the whole can tell is summed up.

mod channel;
mod clock_steps;
mod clocks;
mod commands;
mod drift;
mod finding;
mod jumps;
mod kinematics;
mod names;
mod options;
mod watch;

use super::map::PLACES;
use super::table::Imported;
pub(crate) use finding::FindingList;
pub use finding::{Finding, Severity};
pub use options::Options;
pub(crate) use watch::{Spoilt, Watch};

/// Equal rows that a moving channel does not have.
pub const STUCK_ROWS: usize = 25;

/// The value at a share of a series, by size; order is lost.
pub(crate) fn quantile(values: &mut [f64], share: f64) -> Option<f64> {
    let at = ((values.len() as f64 * share) as usize).min(values.len().checked_sub(1)?);
    Some(*values.select_nth_unstable_by(at, f64::total_cmp).1)
}

/// Motion that came without a map (a log): time, units, dead channels, kinematics. `since_s` is the first row's time since
/// the log's first stamp, from which a window of the log counts.
pub fn check_motion(data: &Imported, since_s: f64, findings: &mut Vec<Finding>) {
    let options = Options::default();
    if data.times_s.len() < 4 {
        findings.push(too_short(data.times_s.len()));
        return;
    }
    let mut clocks = clocks::Clocks::default();
    clocks.stretch(&data.times_s, &data.lines, 0);
    if !clocks.report(findings) {
        return;
    }
    let windows = |to_s: f64, from_s: f64| {
        format!(
            "Two runs: LOG@..{:.3} and LOG@{:.3}..",
            since_s + to_s,
            since_s + from_s
        )
    };
    clock_steps::check(data, &options, windows, findings);
    for place in 0..PLACES {
        let values = &data.motion[place];
        if values.is_empty() {
            continue;
        }
        let mut extent = channel::Extent::default();
        extent.add(values);
        if !extent.report(place, findings) {
            channel::check(place, values, data, &options, findings);
        }
    }
    kinematics::check(data, kinematics::Assumed::default(), &options, findings);
}

fn too_short(rows: usize) -> Finding {
    Finding::fault(
        "too_short",
        None,
        format!("{rows} usable row(s); at least 4 are needed"),
    )
}

fn name(place: usize) -> &'static str {
    super::map::place_name(place)
}
