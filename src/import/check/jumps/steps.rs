//! Steps that no vehicle makes, and such as hardly one makes.

use std::f64::consts::PI;

use super::{Jumps, Series};
use crate::check::channel::{RATE_MAX_RADPS, SPEED_MAX_MPS};
use crate::check::{Finding, Severity, name, quantile};

/// No vehicle is pushed harder \[m/s²\]: twenty times its weight.
const PUSH_MAX: f64 = 200.0;
/// A vehicle's own means push it with less than its weight \[m/s²\], and turn it less than such a force half a metre off would \[rad/s²\].
const PUSH_SUDDEN: f64 = 10.0;
const TURN_SUDDEN: f64 = 20.0;
/// What comes back after so many rows was lost; what does not has moved.
const ROWS_AWAY: usize = 50;
/// Share of a jump that what comes back does so by at once.
const BACK: f64 = 0.5;
/// An angle's jump that is worth looking at \[rad\].
const ANGLE_JUMP: f64 = 0.3;
/// Steps on one side that tell how the channel goes on there.
const STEPS_BESIDE: usize = 4;
/// Rows on one side that have to be quiet about a sudden jump, which is so many times what they do.
const ROWS_QUIET: usize = 6;
const QUIET: f64 = 4.0;
/// Equal rows before a jump that look like a measurement that had stopped.
const ROWS_FROZEN: usize = 5;
/// Steps of other lengths than the usual one: longer ones are gaps; shorter ones are stamps that came late.
const GAP: f64 = 3.0;
const LATE: f64 = 0.3;

/// A jump as a person is told of it.
struct Seen {
    line: u64,
    change: f64,
    dt_s: f64,
    value: f64,
    /// Rows of one value before it, and the line of the first.
    stood: (usize, u64),
}

/// Each step with what is beside it.
struct Steps<'a> {
    series: &'a Series<'a>,
    usual_s: f64,
    /// Steps that are jumps: they tell nothing of how the channel goes on.
    jumps: Vec<bool>,
}

impl Steps<'_> {
    fn rate(&self, i: usize) -> f64 {
        self.series.change(i - 1, i) / self.dt_s(i)
    }

    /// Never so short that rounding and late stamps would make a speed of nothing.
    fn dt_s(&self, i: usize) -> f64 {
        self.series.time_s(i - 1, i).max(LATE * self.usual_s)
    }

    /// Median change per row and per second of the steps on one side.
    fn beside(&self, steps: impl Iterator<Item = usize>) -> Option<(f64, f64)> {
        let steps: Vec<usize> = steps
            .filter(|i| *i > 0 && *i < self.series.values.len() && !self.jumps[*i])
            .take(STEPS_BESIDE)
            .collect();
        let mut changes: Vec<f64> = steps
            .iter()
            .map(|i| self.series.change(i - 1, *i))
            .collect();
        let mut rates: Vec<f64> = steps.iter().map(|i| self.rate(*i)).collect();
        Some((quantile(&mut changes, 0.5)?, quantile(&mut rates, 0.5)?))
    }

    /// How far a step is from where both sides lead, by rows and by time; none if it lies between them.
    fn out_of_line(&self, i: usize) -> f64 {
        let change = self.series.change(i - 1, i);
        let dt_s = self.series.time_s(i - 1, i);
        let sides = [
            self.beside((1..i).rev()),
            self.beside(i + 1..i + 1 + 2 * STEPS_BESIDE),
        ];
        let all: Vec<f64> = sides
            .into_iter()
            .flatten()
            .flat_map(|(per_row, per_s)| [change - per_row, change - per_s * dt_s])
            .collect();
        let one_way = all.iter().all(|v| *v > 0.0) || all.iter().all(|v| *v < 0.0);
        if !one_way {
            return 0.0;
        }
        all.into_iter()
            .min_by(|a, b| a.abs().total_cmp(&b.abs()))
            .unwrap_or(0.0)
    }

    /// How long the channel has stood at one value before a step.
    fn stood(&self, i: usize) -> (usize, u64) {
        let value = self.series.values[i - 1];
        let same = |k: &usize| self.series.values[*k] == value;
        let rows = (0..i).rev().take_while(same).count();
        (rows, self.series.line(i - rows))
    }

    /// Largest bend of the rows around, without those that a jump at these steps makes.
    fn bends(&self, i: usize, back: Option<usize>) -> Option<f64> {
        let n = self.series.values.len();
        let last = back.unwrap_or(i);
        let of_jump = |k: usize| {
            [Some(i), back]
                .into_iter()
                .flatten()
                .any(|s| k + 1 == s || k == s)
        };
        let centres = (i.saturating_sub(ROWS_QUIET + 1)..i).chain(last..last + ROWS_QUIET + 1);
        let all: Vec<f64> = centres
            .filter(|k| *k > 0 && k + 1 < n && !of_jump(*k))
            .map(|k| (self.series.change(k, k + 1) - self.series.change(k - 1, k)).abs())
            .collect();
        (all.len() >= ROWS_QUIET).then(|| all.into_iter().fold(0.0, f64::max))
    }
}

/// Looks at the steps of one channel; a change of `limit` from row to row is nothing unusual in it.
pub(super) fn check(place: usize, series: &Series<'_>, limit: f64, out: &mut Jumps) {
    let n = series.values.len();
    let mut all_s: Vec<f64> = (1..n).map(|i| series.time_s(i - 1, i)).collect();
    all_s.retain(|s| *s > 0.0);
    let Some(usual_s) = quantile(&mut all_s, 0.5) else {
        return;
    };
    let mut steps = Steps {
        series,
        usual_s,
        jumps: vec![false; n],
    };
    let fastest = if series.angle {
        RATE_MAX_RADPS
    } else {
        SPEED_MAX_MPS
    };
    let (mut moved, mut away, mut through, mut sudden) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut i = 1;
    while i < n {
        let (change, time_s) = (series.change(i - 1, i), series.time_s(i - 1, i));
        let out_of_line = if time_s > 0.0 && change.abs() > limit {
            steps.out_of_line(i)
        } else {
            0.0
        };
        if out_of_line.abs() <= limit {
            i += 1;
            continue;
        }
        let dt_s = steps.dt_s(i);
        // A gap says nothing of the push, only of the speed.
        let gap = time_s > GAP * usual_s;
        // What comes back at once is pushed twice as hard on its way back.
        let turn = if i + 1 < n && series.time_s(i, i + 1) <= GAP * usual_s {
            (steps.rate(i + 1) - steps.rate(i)).abs()
        } else {
            0.0
        };
        let push = turn.max(out_of_line.abs() / dt_s) / dt_s;
        let pushed = !series.angle && !gap && push > PUSH_MAX;
        let going = steps
            .beside((1..i).rev())
            .map_or(0.0, |(_, rate)| rate.abs());
        // What was lost comes back by a jump of its own; what goes back slowly has moved.
        let back = (i + 1..n.min(i + ROWS_AWAY)).find(|j| {
            let (left, last) = (series.change(i - 1, *j), series.change(j - 1, *j));
            let near = limit.max(2.0 * going * series.time_s(i - 1, *j));
            let jumps = last.abs() > BACK * out_of_line.abs();
            let opposite = series.angle || last * out_of_line < 0.0;
            left.abs() <= near.max((1.0 - BACK) * out_of_line.abs()) && jumps && opposite
        });
        let whole_turn = |j: &usize| (series.values[*j] - series.values[i - 1]).abs() > 1.5 * PI;
        let wrapped =
            series.angle && change.abs() > ANGLE_JUMP && back.as_ref().is_some_and(whole_turn);
        let fast = change.abs() / dt_s > fastest && (!series.angle || change.abs() > ANGLE_JUMP);
        let seen = Seen {
            line: series.line(i),
            change,
            dt_s: time_s,
            value: series.values[i],
            stood: steps.stood(i),
        };
        if !(fast || pushed || wrapped) {
            let hardly = if series.angle {
                TURN_SUDDEN
            } else {
                PUSH_SUDDEN
            };
            let quiet = || {
                let bends = steps.bends(i, back);
                bends.is_some_and(|b| out_of_line.abs() > QUIET * b)
            };
            if !gap && out_of_line.abs() / dt_s.powi(2) > hardly && quiet() {
                sudden.push(seen);
                steps.jumps[i] = true;
                if let Some(j) = back {
                    steps.jumps[j] = true;
                    i = j;
                }
            }
            i += 1;
            continue;
        }
        steps.jumps[i] = true;
        match back {
            Some(j) => {
                out.spoilt.push(series.range(i, j));
                steps.jumps[j] = true;
                if wrapped { &mut through } else { &mut away }.push(seen);
                i = j + 1;
            }
            None => {
                moved.push(seen);
                i += 1;
            }
        }
    }
    out.spoilt.sort_by_key(|r| r.start);
    report(place, "angle_through_wrap", &through, &mut out.findings);
    report(place, "outlier", &away, &mut out.findings);
    report(place, "teleport", &moved, &mut out.findings);
    report(place, "sudden_jump", &sudden, &mut out.findings);
}

/// Jumps of one kind.
fn report(place: usize, kind: &'static str, seen: &[Seen], findings: &mut Vec<Finding>) {
    let Some(first) = seen.first() else {
        return;
    };
    let (line, dt_s) = (first.line, first.dt_s);
    let (name, count) = (name(place), seen.len());
    let (unit, change, value) = if (3..6).contains(&place) {
        ("deg", first.change.to_degrees(), first.value.to_degrees())
    } else {
        ("m", first.change, first.value)
    };
    let mut words = format!("{change:+.4} {unit} within {dt_s:.4} s");
    if let (rows @ ROWS_FROZEN.., from) = first.stood {
        words += &format!(
            " after {rows} rows of one value from line {from} on, as if the measurement had stopped there"
        );
    }
    let message = match kind {
        "angle_through_wrap" => format!(
            "{name}: {count} time(s) a value between both sides of a whole turn, the first on line {line}: {value:.1} {unit}: an angle averaged or interpolated through the wrap"
        ),
        "outlier" => format!(
            "{name}: leaves {count} time(s) for a few rows as no vehicle does, the first on line {line}: {words}"
        ),
        "sudden_jump" => format!(
            "{name}: jumps {count} time(s) while the rows before and after are quiet, the first on line {line}: {words}; the vehicle, or the measurement?"
        ),
        _ => format!(
            "{name}: jumps {count} time(s) as no vehicle does, the first on line {line}: {words}; another body, a lost one, or rows missing?"
        ),
    };
    let severity = if kind == "sudden_jump" {
        Severity::Warning
    } else {
        Severity::Fault
    };
    findings.push(Finding {
        severity,
        kind,
        line: Some(line),
        message,
    });
}
