//! Where the mismatch acts: windows of time, and what it depends on.

use std::collections::BTreeMap;

use super::bank::View;
use super::family::{Acts, FamilyFit, Variable, laid_out, regimes};
use super::fit::Fit;
use super::search::Search;
use super::setting::Setting;
use super::verdict::Where;

/// Length over which residuals are averaged \[s\].
const WINDOW_S: f64 = 0.5;
/// Mean whitened innovation, in its sd, above which a window counts: 1 in 16 000 by chance.
const BEYOND: f64 = 4.0;
/// Ranges in which a free function stands out that are told at most.
const STRETCHES: usize = 4;
/// Amplitude over its sd from which it is there for certain.
const CERTAIN: f64 = 4.0;

/// Windows per run in which the whitened residual of a fit is more than noise.
pub fn windows(search: &Search<'_>, fit: &Fit) -> BTreeMap<String, Vec<[f64; 2]>> {
    let setting = search.setting;
    let mut out = BTreeMap::new();
    for (run, (track, mut residual)) in setting
        .tracks
        .iter()
        .zip(fit.residuals(setting))
        .enumerate()
    {
        search.weights.whiten(run, residual.iter_mut());
        let mut found: Vec<[f64; 2]> = Vec::new();
        let mut first = 0;
        while first < residual.len() {
            let from_s = track.times_s[first];
            let next = track
                .times_s
                .partition_point(|t| *t < from_s + WINDOW_S)
                .max(first + 1);
            let n = search.weights.used[run][first..next]
                .iter()
                .filter(|u| **u)
                .count() as f64;
            let sum: f64 = residual[first..next].iter().sum();
            let energy: f64 = residual[first..next].iter().map(|v| v * v).sum();
            let high = n > 0.0
                && (sum.abs() / n.sqrt() > BEYOND
                    || (energy - n) / (2.0 * n).sqrt() > BEYOND + 2.0);
            if high {
                let to_s = track.times_s[next - 1];
                match found.last_mut().filter(|w| from_s - w[1] < 2.0 * WINDOW_S) {
                    Some(last) => last[1] = to_s,
                    None => found.push([from_s, to_s]),
                }
            }
            first = next;
        }
        if !found.is_empty() {
            out.insert(track.name.clone(), found);
        }
    }
    out
}

/// Free forces beside a fit, each with what it gains.
pub fn dependences(search: &Search<'_>, fit: &Fit) -> Vec<FamilyFit> {
    let view = View::new(search.setting, &search.weights, fit);
    let mut all: Vec<FamilyFit> = regimes(search.setting, fit)
        .iter()
        .filter_map(|f| f.fit(search.setting, &search.weights, fit, &view))
        .collect();
    all.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    all
}

/// Range in which a free function stands out most surely, and its mean amplitude there.
pub fn stands_out(setting: &Setting, found: &FamilyFit) -> ([f64; 2], f64) {
    stretches(setting, found)
        .first()
        .map_or(([f64::NAN, f64::NAN], 0.0), |s| (s.range, s.mean))
}

/// A range of a free function's variable in which it stands out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stretch {
    /// Ends, between knots.
    pub range: [f64; 2],
    /// Mean amplitude there.
    pub mean: f64,
    /// Amplitude at its surest knot.
    peak: f64,
    /// First and last knot within.
    knots: (usize, usize),
}

impl Stretch {
    fn holds(&self, knot: usize) -> bool {
        (self.knots.0..=self.knots.1).contains(&knot)
    }
}

/// Ranges in which a free function stands out, the surest first: each from the first to the last knot with at least half
/// of the amplitude at its surest knot. Those after the first are there for certain and half as strong at least.
pub fn stretches(setting: &Setting, found: &FamilyFit) -> Vec<Stretch> {
    let a = &found.amplitudes;
    // The surest knot, not the largest: at the ends of a range amplitudes are hardly known.
    let sure = |i: usize| a[i].abs() / found.sds[i].max(1e-300);
    let mut out: Vec<Stretch> = Vec::new();
    while out.len() < STRETCHES {
        let open = |i: usize| !out.iter().any(|s| s.holds(i));
        let strong = |i: usize| {
            out.first()
                .is_none_or(|first| a[i].abs() >= 0.5 * first.peak.abs() && sure(i) >= CERTAIN)
        };
        let next = (0..a.len())
            .filter(|i| open(*i) && strong(*i))
            .max_by(|i, j| sure(*i).total_cmp(&sure(*j)));
        let Some(peak) = next else { break };
        let stretch = around(setting, found, peak, &out);
        out.push(stretch);
    }
    out
}

/// Largest amplitude that is there for certain outside of all stretches.
pub fn elsewhere(found: &FamilyFit, stretches: &[Stretch]) -> f64 {
    let a = &found.amplitudes;
    // The knot at a stretch's foot is its own where it has its sign.
    let apart = |i: usize| {
        !stretches.iter().any(|s| {
            let foot = (i + 1 == s.knots.0 || i == s.knots.1 + 1) && a[i] * s.mean > 0.0;
            foot || s.holds(i)
        })
    };
    (0..a.len())
        .filter(|i| apart(*i) && a[*i].abs() > CERTAIN * found.sds[*i])
        .map(|i| a[i].abs())
        .fold(0.0, f64::max)
}

/// The stretch about a knot, up to those that are taken.
fn around(setting: &Setting, found: &FamilyFit, peak: usize, taken: &[Stretch]) -> Stretch {
    let (a, knots) = (&found.amplitudes, &found.family.knots);
    let half = 0.5 * a[peak];
    let holder = |i: usize| taken.iter().find(|s| s.holds(i));
    let over = |i: usize| holder(i).is_none() && a[i] * half.signum() >= half.abs();
    let (mut low, mut high) = (peak, peak);
    // Run by run the end of one is no neighbour of the next one's start.
    let joined = |i: usize, j: usize| {
        found.family.variable != Variable::TimeEach
            || run_of(setting, knots[i]) == run_of(setting, knots[j])
    };
    while low > 0 && joined(low - 1, low) && over(low - 1) {
        low -= 1;
    }
    while high + 1 < a.len() && joined(high, high + 1) && over(high + 1) {
        high += 1;
    }
    let cross = |inside: usize, outside: usize| {
        // Up to where one that is taken ends.
        if let Some(s) = holder(outside) {
            return s.range[usize::from(outside < inside)];
        }
        let share = (a[inside] - half) / (a[inside] - a[outside]);
        knots[inside] + share.clamp(0.0, 1.0) * (knots[outside] - knots[inside])
    };
    let from = if low > 0 && joined(low - 1, low) {
        cross(low, low - 1)
    } else {
        knots[low]
    };
    let to = if high + 1 < a.len() && joined(high, high + 1) {
        cross(high, high + 1)
    } else {
        knots[high]
    };
    Stretch {
        range: [from, to],
        mean: a[low..=high].iter().sum::<f64>() / (high - low + 1) as f64,
        peak: a[peak],
        knots: (low, high),
    }
}

/// Run (from 0) that a time belongs to when the runs are laid end to end \[s\].
fn run_of(setting: &Setting, laid_s: f64) -> usize {
    laid_out(setting)
        .iter()
        .zip(&setting.tracks)
        .rposition(|(o, t)| *o + t.start_s <= laid_s + 1e-6)
        .unwrap_or(0)
}

/// A free force's variable and range as a reader means them: laid end to end the times of the runs
/// mean nothing, so that they go back to the clock of the run they are of (from 1).
pub fn told(setting: &Setting, variable: Variable, range: [f64; 2]) -> (String, [f64; 2]) {
    match of_one_run(setting, variable, range) {
        None => (variable.name(), range),
        Some((run, range)) => (
            format!("{}, most clearly in run {run}", variable.name()),
            range,
        ),
    }
}

/// Run (from 1) and range by its clock \[s\] of a range of time in each run by itself.
pub fn of_one_run(
    setting: &Setting,
    variable: Variable,
    range: [f64; 2],
) -> Option<(usize, [f64; 2])> {
    if variable != Variable::TimeEach {
        return None;
    }
    let run = run_of(setting, 0.5 * (range[0] + range[1]));
    let offset_s = laid_out(setting).get(run).copied().unwrap_or(0.0);
    Some((run + 1, range.map(|v| v - offset_s)))
}

/// Place of the mismatch of the model without effects.
pub fn locate(search: &Search<'_>, plain: &Fit, stage: Option<&str>) -> Where {
    let windows = windows(search, plain);
    let found = dependences(search, plain);
    let depends_on: BTreeMap<String, f64> = found
        .iter()
        .filter(|f| f.family.acts == Acts::Force)
        .map(|f| (f.family.variable.name(), f.gain))
        .collect();
    let regime = match found.first().filter(|f| f.gain > 5.0) {
        None => "no window, place, rate or command stands out".to_owned(),
        Some(f) => {
            let (range, force) = stands_out(search.setting, f);
            let (name, [from, to]) = told(search.setting, f.family.variable, range);
            let next = found
                .iter()
                .find(|o| o.family.variable != f.family.variable);
            let sure = next.map_or(String::new(), |n| {
                format!(
                    "; {} explains {:.1} less in log evidence",
                    n.family.variable.name(),
                    f.gain - n.gain
                )
            });
            let what = match f.family.variable {
                Variable::SinceEdge | Variable::AfterEdge => "after command edges",
                Variable::Load if from < 0.0 && to <= 0.0 => "under astern commands",
                Variable::Rate if from < 0.0 && to <= 0.0 => "going astern",
                _ => "as a function",
            };
            format!(
                "a free force {what} of {} gains {:.1} in log evidence, strongest ({force:.3} N) for {from:.3} .. {to:.3}{sure}",
                name, f.gain
            )
        }
    };
    Where {
        stage: stage.map(str::to_owned),
        dof: vec![search.setting.dof.name().to_owned()],
        windows_s: windows.values().next().cloned().unwrap_or_default(),
        windows,
        regime,
        depends_on,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{hats, pulled, setting};

    fn places(amplitudes: &[f64]) -> FamilyFit {
        let knots = (0..amplitudes.len()).map(|k| k as f64).collect();
        hats(
            Acts::Force,
            Variable::Place,
            knots,
            amplitudes.to_vec(),
            0.02,
        )
    }

    #[test]
    fn every_place_at_which_a_force_is_as_strong_is_told() {
        let own = setting(&[pulled(0, &[], None)]);
        let three = [
            0.0, 0.0, 0.7, 0.0, 0.0, -0.4, -0.5, 0.0, 0.06, 0.0, 0.4, 0.0,
        ];
        let found = places(&three);
        let all = stretches(&own, &found);
        let told: Vec<([f64; 2], f64)> = all.iter().map(|s| (s.range, s.mean)).collect();
        assert_eq!(all.len(), 3, "{told:?}");
        assert_eq!(told[0], ([1.5, 2.5], 0.7));
        assert_eq!(stands_out(&own, &found), told[0]);
        assert_eq!(told[1], ([4.625, 6.5], -0.45));
        assert_eq!(told[2], ([9.5, 10.5], 0.4));
        // What is weaker, or next to a stretch, is no place of its own.
        assert_eq!(elsewhere(&found, &all), 0.0);
        let weaker = places(&[0.0, 0.7, 0.1, 0.0, 0.2, 0.0]);
        let one = stretches(&own, &weaker);
        assert_eq!(one.len(), 1);
        assert_eq!(elsewhere(&weaker, &one), 0.2);
        // Its flanks are part of it.
        let flanks = places(&[0.4, 0.5, 0.6, 0.9, 0.6, 0.5, 0.4]);
        let smooth = stretches(&own, &flanks);
        assert_eq!(smooth.len(), 1, "{smooth:?}");
        assert_eq!(elsewhere(&flanks, &smooth), 0.0);
        // Two that adjoin share nothing.
        let two = stretches(&own, &places(&[0.0, 0.9, 0.44, 0.6, 0.0]));
        assert_eq!(two.len(), 2, "{two:?}");
        assert!(two[0].range[1] <= two[1].range[0]);
    }
}
