//! Values that no motion leads to: groups of exact zeros, teleports, angles averaged through the wrap.

mod steps;
mod zeros;

use std::f64::consts::{PI, TAU};
use std::ops::Range;

use super::{Finding, Options, quantile};
use crate::table::Imported;

pub(super) use zeros::of_the_same_body;

/// Rows of a channel that hold no motion, and the findings about them.
pub(super) struct Jumps {
    /// Rows of no motion: their values are to be left out.
    pub spoilt: Vec<Range<usize>>,
    /// Rows of zeros, where the body was lost.
    pub lost: Vec<Range<usize>>,
    pub findings: Vec<Finding>,
}

/// The rows of one channel that have a value.
struct Series<'a> {
    rows: Vec<usize>,
    values: Vec<f64>,
    data: &'a Imported,
    options: &'a Options,
    angle: bool,
}

impl<'a> Series<'a> {
    /// The rows that are not lost: what stands beside a loss is no jump of its own.
    fn without(&self, lost: &[Range<usize>]) -> Series<'a> {
        let kept = |i: &usize| {
            let row = self.rows[*i];
            let at = lost.partition_point(|r| r.end <= row);
            !lost.get(at).is_some_and(|r| r.contains(&row))
        };
        let kept: Vec<usize> = (0..self.rows.len()).filter(kept).collect();
        Series {
            rows: kept.iter().map(|i| self.rows[*i]).collect(),
            values: kept.iter().map(|i| self.values[*i]).collect(),
            ..*self
        }
    }
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
pub(super) fn check(place: usize, zero: f64, data: &Imported, options: &Options) -> Jumps {
    let mut out = Jumps {
        spoilt: Vec::new(),
        lost: Vec::new(),
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
    if rows.len() < options.jump_rows {
        return out;
    }
    let series = Series {
        values: rows.iter().map(|i| values[*i]).collect(),
        rows,
        data,
        options,
        angle: (3..6).contains(&place),
    };
    let Some(limit) = limit(&series) else {
        return out;
    };
    zeros::zeros(place, zero, &series, limit, &mut out);
    if place < 6 {
        steps::check(place, &series.without(&out.lost), limit, &mut out);
    }
    out
}

/// How far a row may be from where the one before led.
fn limit(series: &Series<'_>) -> Option<f64> {
    let n = series.values.len();
    let mut steps: Vec<f64> = (1..n).map(|i| series.change(i - 1, i).abs()).collect();
    let mut curvatures: Vec<f64> = (2..n)
        .map(|i| (series.change(i - 1, i) - series.change(i - 2, i - 1)).abs())
        .collect();
    let most = quantile(&mut curvatures, 0.95)?;
    let body = series.options.body_curvatures * quantile(&mut curvatures, 0.75)?;
    steps.retain(|s| *s > 0.0);
    // A coarse instrument stands and steps.
    let coarse = 2 * steps.len() < n;
    let quantum = quantile(&mut steps, 0.5)?;
    // Jumps must not hide each other: where they are some in a hundred rows they make the largest twentieth themselves.
    let curvature = most.min(if body > 0.0 { body } else { quantum });
    let usual = if coarse {
        curvature.max(quantum)
    } else {
        curvature
    };
    Some(series.options.jump_curvatures * usual)
}
