//! Values that no motion leads to: groups of exact zeros, teleports, angles averaged through the wrap.

use std::f64::consts::{PI, TAU};
use std::ops::Range;

use super::channel::{RATE_MAX_RADPS, SPEED_MAX_MPS};
use super::{Finding, name, quantile};
use crate::table::Imported;

/// A jump is this many times what nineteen of twenty rows do.
const JUMP: f64 = 12.0;
/// No vehicle is pushed harder \[m/s²\]: twenty times its weight.
const PUSH_MAX: f64 = 200.0;
/// What comes back after so many rows was lost; what does not has moved.
const ROWS_AWAY: usize = 50;
/// An angle's jump that is worth looking at \[rad\].
const ANGLE_JUMP: f64 = 0.3;

/// What a channel's rows are not.
pub(super) struct Jumps {
    /// Rows of no motion: their values are to be left out.
    pub spoilt: Vec<Range<usize>>,
    pub findings: Vec<Finding>,
}

/// The rows of one channel that have a value.
struct Series<'a> {
    rows: Vec<usize>,
    values: Vec<f64>,
    data: &'a Imported,
    angle: bool,
}

impl Series<'_> {
    fn change(&self, from: usize, to: usize) -> f64 {
        let change = self.values[to] - self.values[from];
        if self.angle {
            (change + PI).rem_euclid(TAU) - PI
        } else {
            change
        }
    }
    fn time_s(&self, from: usize, to: usize) -> f64 {
        self.data.times_s[self.rows[to]] - self.data.times_s[self.rows[from]]
    }
    fn line(&self, i: usize) -> u64 {
        self.data.lines.get(self.rows[i]).copied().unwrap_or(0)
    }
    /// Rows of the table between two of the series.
    fn range(&self, from: usize, to: usize) -> Range<usize> {
        self.rows[from]..self.rows[to - 1] + 1
    }
}

/// Looks at one channel of a stretch; `zero` is what the file's 0 becomes.
pub(super) fn check(place: usize, zero: f64, data: &Imported) -> Jumps {
    let mut out = Jumps {
        spoilt: Vec::new(),
        findings: Vec::new(),
    };
    let values = &data.motion[place];
    // A rudder is put over as fast as it likes, and stands at exactly 0.
    if place >= 12 {
        return out;
    }
    let rows: Vec<usize> = (0..values.len())
        .filter(|i| values[*i].is_finite())
        .collect();
    if rows.len() < 20 {
        return out;
    }
    let series = Series {
        values: rows.iter().map(|i| values[*i]).collect(),
        rows,
        data,
        angle: (3..6).contains(&place),
    };
    let Some(limit) = limit(&series) else {
        return out;
    };
    zeros(place, zero, &series, limit, &mut out);
    let lost: Vec<Range<usize>> = out.spoilt.clone();
    if place < 6 {
        teleports(place, &series, limit, &lost, &mut out);
    }
    out
}

/// How far a row may be from where the one before led.
fn limit(series: &Series<'_>) -> Option<f64> {
    let n = series.values.len();
    let mut steps: Vec<f64> = (1..n).map(|i| series.change(i - 1, i).abs()).collect();
    let mut bends: Vec<f64> = (2..n)
        .map(|i| (series.change(i - 1, i) - series.change(i - 2, i - 1)).abs())
        .collect();
    let bend = quantile(&mut bends, 0.95)?;
    steps.retain(|s| *s > 0.0);
    // A coarse instrument stands and steps.
    let coarse = 2 * steps.len() < n;
    let quantum = quantile(&mut steps, 0.5)?;
    Some(JUMP * if coarse { bend.max(quantum) } else { bend })
}

/// Largest step of the few rows on one side of a group that are no zeros themselves.
fn nearby(series: &Series<'_>, zero: f64, rows: impl Iterator<Item = usize>) -> f64 {
    let inside = |i: &usize| series.values.get(*i).is_some_and(|v| *v != zero);
    let there = |i: &usize| *i > 0 && inside(i) && inside(&(i - 1));
    rows.filter(there)
        .map(|i| series.change(i - 1, i).abs())
        .fold(0.0, f64::max)
}

/// Runs of the file's exact 0, far from what is before and after: a lost body.
fn zeros(place: usize, zero: f64, series: &Series<'_>, limit: f64, out: &mut Jumps) {
    let n = series.values.len();
    let (mut groups, mut rows, mut first) = (0, 0, 0);
    let mut i = 0;
    while i < n {
        if series.values[i] != zero {
            i += 1;
            continue;
        }
        let from = i;
        while i < n && series.values[i] == zero {
            i += 1;
        }
        // A channel that passes through 0 comes and goes in steps like those before and after.
        let far = |change: f64, near: f64| change.abs() > limit.max(4.0 * near);
        let before = (from > 0).then(|| {
            far(
                series.change(from - 1, from),
                nearby(series, zero, from.saturating_sub(6)..from),
            )
        });
        let after =
            (i < n).then(|| far(series.change(i - 1, i), nearby(series, zero, i + 1..i + 7)));
        let far = match (before, after) {
            (Some(b), Some(a)) => b && a,
            (Some(one), None) | (None, Some(one)) => one,
            (None, None) => false,
        };
        if far {
            if groups == 0 {
                first = series.line(from);
            }
            groups += 1;
            rows += i - from;
            out.spoilt.push(series.range(from, i));
        }
    }
    if groups > 0 {
        out.findings.push(Finding::fault(
            "zeros",
            Some(first),
            format!(
                "{}: {rows} row(s) in {groups} group(s) hold exactly 0, far from the rows around them, the first on line {first}: a lost body written as zeros? missing_value = 0 with missing = \"skip\" in the map leaves them out",
                name(place)
            ),
        ));
    }
}

/// Steps that no vehicle makes.
fn teleports(
    place: usize,
    series: &Series<'_>,
    limit: f64,
    lost: &[Range<usize>],
    out: &mut Jumps,
) {
    let n = series.values.len();
    let is_lost = |i: usize| {
        let row = series.rows[i];
        let at = lost.partition_point(|r| r.end <= row);
        lost.get(at).is_some_and(|r| r.contains(&row))
    };
    let fastest = if series.angle {
        RATE_MAX_RADPS
    } else {
        SPEED_MAX_MPS
    };
    let (mut moved, mut away, mut through) = (Vec::new(), Vec::new(), Vec::new());
    let mut i = 1;
    while i < n {
        let (change, dt_s) = (series.change(i - 1, i), series.time_s(i - 1, i));
        if dt_s <= 0.0 || change.abs() <= limit || is_lost(i - 1) || is_lost(i) {
            i += 1;
            continue;
        }
        let before_s = if i > 1 {
            series.time_s(i - 2, i - 1)
        } else {
            dt_s
        };
        let before = if i > 1 {
            series.change(i - 2, i - 1) / before_s.max(0.3 * dt_s)
        } else {
            0.0
        };
        let bend = change / dt_s - before;
        // A gap says nothing of the push, only of the speed.
        let pushed = !series.angle && dt_s < 3.0 * before_s && bend.abs() / dt_s > PUSH_MAX;
        let back = (i + 1..n.min(i + ROWS_AWAY)).find(|j| {
            series.change(i - 1, *j).abs()
                <= limit.max(before.abs() * series.time_s(i - 1, *j) * 2.0)
        });
        let whole_turn = |j: &usize| (series.values[*j] - series.values[i - 1]).abs() > 1.5 * PI;
        let wrapped =
            series.angle && change.abs() > ANGLE_JUMP && back.as_ref().is_some_and(whole_turn);
        let fast = change.abs() / dt_s > fastest && (!series.angle || change.abs() > ANGLE_JUMP);
        // The jump is this row's, not the way back of the row before.
        if !(fast || pushed || wrapped) || (change - before * dt_s).abs() <= limit {
            i += 1;
            continue;
        }
        let seen = (series.line(i), change, dt_s, series.values[i]);
        match back {
            Some(j) => {
                out.spoilt.push(series.range(i, j));
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
}

/// (line, change, time, value) of jumps of one kind.
fn report(
    place: usize,
    kind: &'static str,
    seen: &[(u64, f64, f64, f64)],
    findings: &mut Vec<Finding>,
) {
    let Some((line, change, dt_s, value)) = seen.first() else {
        return;
    };
    let (name, count) = (name(place), seen.len());
    let (unit, change, value) = if (3..6).contains(&place) {
        ("deg", change.to_degrees(), value.to_degrees())
    } else {
        ("m", *change, *value)
    };
    let words = format!("{change:+.4} {unit} within {dt_s:.4} s");
    let message = match kind {
        "angle_through_wrap" => format!(
            "{name}: {count} time(s) a value between both sides of a whole turn, the first on line {line}: {value:.1} {unit}: an angle averaged or interpolated through the wrap"
        ),
        "outlier" => format!(
            "{name}: leaves {count} time(s) for a few rows as no vehicle does, the first on line {line}: {words}"
        ),
        _ => format!(
            "{name}: jumps {count} time(s) as no vehicle does, the first on line {line}: {words}; another body, a lost one, or rows missing?"
        ),
    };
    findings.push(Finding::fault(kind, Some(*line), message));
}
