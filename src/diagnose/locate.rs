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

/// Range in which a free function stands out: from the first to the last knot with at least half
/// the largest amplitude next to the strongest, ends between knots; and the mean amplitude there.
pub fn stands_out(setting: &Setting, found: &FamilyFit) -> ([f64; 2], f64) {
    let a = &found.amplitudes;
    let knots = &found.family.knots;
    // The surest knot, not the largest: at the ends of a range amplitudes are hardly known.
    let sure = |i: usize| a[i].abs() / found.sds[i].max(1e-300);
    let Some(peak) = (0..a.len()).max_by(|i, j| sure(*i).total_cmp(&sure(*j))) else {
        return ([f64::NAN, f64::NAN], 0.0);
    };
    let half = 0.5 * a[peak];
    let over = |i: usize| a[i] * half.signum() >= half.abs();
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
    let mean = a[low..=high].iter().sum::<f64>() / (high - low + 1) as f64;
    ([from, to], mean)
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
/// mean nothing, so that they go back to the clock of the run they are of.
pub fn told(setting: &Setting, variable: Variable, range: [f64; 2]) -> (String, [f64; 2]) {
    if variable != Variable::TimeEach {
        return (variable.name(), range);
    }
    let run = run_of(setting, 0.5 * (range[0] + range[1]));
    let offset_s = laid_out(setting).get(run).copied().unwrap_or(0.0);
    (
        format!("{}, most clearly in run {}", variable.name(), run + 1),
        range.map(|v| v - offset_s),
    )
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
