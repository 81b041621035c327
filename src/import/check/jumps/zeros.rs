//! Runs of exact zeros where a body was lost.

use super::{Jumps, Series};
use crate::check::{Finding, FindingList, name};
use crate::table::Imported;
use std::ops::Range;

/// Largest step of the few rows on one side of a group that are no zeros themselves.
fn nearby(series: &Series<'_>, zero: f64, rows: impl Iterator<Item = usize>) -> f64 {
    let inside = |i: &usize| series.values.get(*i).is_some_and(|v| *v != zero);
    let there = |i: &usize| *i > 0 && inside(i) && inside(&(i - 1));
    rows.filter(there)
        .map(|i| series.change(i - 1, i).abs())
        .fold(0.0, f64::max)
}

/// Runs of the file's exact 0, far from what is before and after: a lost body.
pub(super) fn zeros(place: usize, zero: f64, series: &Series<'_>, limit: f64, out: &mut Jumps) {
    let n = series.values.len();
    let (beside, steps) = (series.options.zero_rows, series.options.zero_steps);
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
        let far = |change: f64, near: f64| change.abs() > limit.max(steps * near);
        let before = (from > 0).then(|| {
            far(
                series.change(from - 1, from),
                nearby(series, zero, from.saturating_sub(beside)..from),
            )
        });
        let after = (i < n).then(|| {
            far(
                series.change(i - 1, i),
                nearby(series, zero, i + 1..i + 1 + beside),
            )
        });
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
            out.lost.push(series.range(from, i));
        }
    }
    if groups > 0 {
        out.findings.fault_at(
            "zeros",
            Some(first),
            format!(
                "{}: {rows} row(s) in {groups} group(s) hold exactly 0, far from the rows around them, the first on line {first}: a lost body written as zeros? missing_value = 0 with missing = \"skip\" in the map leaves them out",
                name(place),
            ),
        );
    }
}

/// Other channels of a lost body that are 0 in the same rows, however near to 0 they were: (place, rows), and findings.
pub(in crate::check) fn of_the_same_body(
    lost: &[(usize, Range<usize>)],
    zero: impl Fn(usize) -> f64,
    data: &Imported,
) -> (Vec<(usize, Range<usize>)>, Vec<Finding>) {
    let (mut spoilt, mut findings) = (Vec::<(usize, Range<usize>)>::new(), Vec::new());
    for place in 0..12 {
        let (values, zero) = (&data.motion[place], zero(place));
        let is_lost = |row: usize| {
            let own = |l: &(usize, Range<usize>)| l.0 == place && l.1.contains(&row);
            values.get(row) == Some(&zero) && !lost.iter().any(own)
        };
        let mut rows: Vec<usize> = lost.iter().flat_map(|l| l.1.clone()).collect();
        rows.sort_unstable();
        rows.dedup();
        rows.retain(|row| is_lost(*row));
        let Some(first) = rows.first().copied() else {
            continue;
        };
        let line = data.lines.get(first).copied().unwrap_or(0);
        findings.fault_at(
            "zeros",
            Some(line),
            format!(
                "{}: {} row(s) hold exactly 0 where other channels of the body are lost, the first on line {line}",
                name(place),
                rows.len(),
            ),
        );
        for row in rows {
            match spoilt.last_mut() {
                Some((p, r)) if *p == place && r.end == row => r.end += 1,
                _ => spoilt.push((place, row..row + 1)),
            }
        }
    }
    (spoilt, findings)
}
