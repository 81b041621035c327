//! Runs at rest: they measure the noise and nothing else.

use super::Run;

/// Shortest run at rest that measures a noise's colour \[s\].
pub const STILL_MIN_S: f64 = 20.0;

/// Whether a run is one at rest: no load at all for at least 20 s, and no channel that drifts
/// by more than `[position_m, attitude_rad]` between its first, middle and last third.
///
/// A decay test has no command either, but it moves.
pub fn is_still(run: &Run, tolerance: [f64; 2]) -> bool {
    let span_s = run.end_s() - run.samples.first().map_or(0.0, |s| s.t_s);
    if span_s < STILL_MIN_S
        || run.largest_wrench().iter().any(|w| *w > 0.0)
        || run.samples.len() < 30
    {
        return false;
    }
    (0..6).all(|channel| {
        let values: Vec<f64> = run
            .samples
            .iter()
            .map(|s| s.values[channel])
            .filter(|v| v.is_finite())
            .collect();
        if values.len() < 30 {
            return true;
        }
        let limit = if channel < 3 {
            tolerance[0]
        } else {
            tolerance[1]
        };
        let mut medians: Vec<f64> = values
            .chunks(values.len() / 8)
            .filter_map(|c| super::super::statistics::median(&mut c.to_vec()))
            .collect();
        medians.sort_by(f64::total_cmp);
        medians
            .last()
            .zip(medians.first())
            .is_some_and(|(high, low)| high - low < limit)
    })
}
