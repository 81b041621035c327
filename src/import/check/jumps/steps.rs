//! Steps that no vehicle makes, and such as hardly one makes.

use std::f64::consts::PI;

use super::{Jumps, Series};
use crate::check::{Finding, Options, Severity, name, quantile};

/// A jump as reported.
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
        self.series
            .time_s(i - 1, i)
            .max(self.series.options.late_share * self.usual_s)
    }

    /// Median change per row and per second of the steps on one side.
    fn beside(&self, steps: impl Iterator<Item = usize>) -> Option<(f64, f64)> {
        let steps: Vec<usize> = steps
            .filter(|i| *i > 0 && *i < self.series.values.len() && !self.jumps[*i])
            .take(self.series.options.beside_steps)
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
        let after = i + 1 + 2 * self.series.options.beside_steps;
        let sides = [self.beside((1..i).rev()), self.beside(i + 1..after)];
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

    /// Largest curvature of the rows around, without those that a jump at these steps makes.
    fn curvatures(&self, i: usize, back: Option<usize>) -> Option<f64> {
        let n = self.series.values.len();
        let last = back.unwrap_or(i);
        let of_jump = |k: usize| {
            [Some(i), back]
                .into_iter()
                .flatten()
                .any(|s| k + 1 == s || k == s)
        };
        let quiet = self.series.options.quiet_rows;
        let centres = (i.saturating_sub(quiet + 1)..i).chain(last..last + quiet + 1);
        let all: Vec<f64> = centres
            .filter(|k| *k > 0 && k + 1 < n && !of_jump(*k))
            .map(|k| (self.series.change(k, k + 1) - self.series.change(k - 1, k)).abs())
            .collect();
        (all.len() >= quiet).then(|| all.into_iter().fold(0.0, f64::max))
    }

    /// The step by which what was lost comes back, by a jump of its own; what goes back slowly has moved.
    fn back(&self, i: usize, limit: f64, out_of_line: f64) -> Option<usize> {
        let series = self.series;
        let Options {
            away_rows,
            back_share,
            ..
        } = *series.options;
        let before = self.beside((1..i).rev());
        let going = before.map_or(0.0, |(_, rate)| rate.abs());
        (i + 1..series.values.len().min(i + away_rows)).find(|j| {
            let (left, last) = (series.change(i - 1, *j), series.change(j - 1, *j));
            let near = limit.max(2.0 * going * series.time_s(i - 1, *j));
            let jumps = last.abs() > back_share * out_of_line.abs();
            let opposite = series.angle || last * out_of_line < 0.0;
            left.abs() <= near.max((1.0 - back_share) * out_of_line.abs()) && jumps && opposite
        })
    }

    /// A step that leaves the line by more than `limit`, and what it is.
    fn jump(&self, i: usize, limit: f64) -> Option<Jump> {
        let (series, options) = (self.series, self.series.options);
        let (change, time_s) = (series.change(i - 1, i), series.time_s(i - 1, i));
        if !(time_s > 0.0 && change.abs() > limit) {
            return None;
        }
        let out_of_line = self.out_of_line(i);
        if out_of_line.abs() <= limit {
            return None;
        }
        let dt_s = self.dt_s(i);
        let longest_s = options.gap_steps * self.usual_s;
        let gap = time_s > longest_s;
        // A value that returns at once is pushed twice as hard on its way back.
        let turn = if i + 1 < series.values.len() && series.time_s(i, i + 1) <= longest_s {
            (self.rate(i + 1) - self.rate(i)).abs()
        } else {
            0.0
        };
        let push = turn.max(out_of_line.abs() / dt_s) / dt_s;
        let pushed = !series.angle && !gap && push > options.push_max_mps2;
        let back = self.back(i, limit, out_of_line);
        let whole_turn = |j: usize| (series.values[j] - series.values[i - 1]).abs() > 1.5 * PI;
        let large = !series.angle || change.abs() > options.angle_jump_rad;
        let wrapped = series.angle && large && back.is_some_and(whole_turn);
        let fastest = if series.angle {
            options.rate_max_radps
        } else {
            options.speed_max_mps
        };
        // By what it is beyond the motion around it: a ball is thrown faster than a vehicle goes.
        let fast = out_of_line.abs() / dt_s > fastest && large;
        Some(Jump {
            seen: Seen {
                line: series.line(i),
                change,
                dt_s: time_s,
                value: series.values[i],
                stood: self.stood(i),
            },
            out_of_line,
            dt_s,
            gap,
            back,
            wrapped,
            impossible: fast || pushed || wrapped,
        })
    }

    /// Whether hardly a vehicle jumps so, and the rows around are quiet.
    fn is_sudden(&self, i: usize, jump: &Jump) -> bool {
        let options = self.series.options;
        let hardly = if self.series.angle {
            options.turn_sudden_radps2
        } else {
            options.push_sudden_mps2
        };
        let off = jump.out_of_line.abs();
        let quiet = |curvature: f64| off > options.quiet_curvatures * curvature;
        !jump.gap
            && off / jump.dt_s.powi(2) > hardly
            && self.curvatures(i, jump.back).is_some_and(quiet)
    }
}

/// A step that is out of line.
struct Jump {
    seen: Seen,
    out_of_line: f64,
    /// Never so short that it makes a speed of nothing \[s\].
    dt_s: f64,
    /// Over a gap, which says nothing of the push, only of the speed.
    gap: bool,
    /// The step by which the channel comes back.
    back: Option<usize>,
    /// It comes back over a whole turn.
    wrapped: bool,
    /// No vehicle does so.
    impossible: bool,
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
    let (mut moved, mut away, mut through, mut sudden) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut i = 1;
    while i < n {
        let Some(jump) = steps.jump(i, limit) else {
            i += 1;
            continue;
        };
        if !jump.impossible {
            if steps.is_sudden(i, &jump) {
                sudden.push(jump.seen);
                steps.jumps[i] = true;
                if let Some(j) = jump.back {
                    steps.jumps[j] = true;
                    i = j;
                }
            }
            i += 1;
            continue;
        }
        steps.jumps[i] = true;
        match jump.back {
            Some(j) => {
                out.spoilt.push(series.range(i, j));
                steps.jumps[j] = true;
                let of = if jump.wrapped {
                    &mut through
                } else {
                    &mut away
                };
                of.push(jump.seen);
                i = j + 1;
            }
            None => {
                moved.push(jump.seen);
                i += 1;
            }
        }
    }
    out.spoilt.sort_by_key(|r| r.start);
    for (kind, seen) in [
        ("angle_through_wrap", through),
        ("outlier", away),
        ("teleport", moved),
        ("sudden_jump", sudden),
    ] {
        let frozen = series.options.frozen_rows;
        report(place, kind, &seen, frozen, &mut out.findings);
    }
}

/// Jumps of one kind.
fn report(
    place: usize,
    kind: &'static str,
    seen: &[Seen],
    frozen: usize,
    findings: &mut Vec<Finding>,
) {
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
    let (rows, from) = first.stood;
    if rows >= frozen {
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
