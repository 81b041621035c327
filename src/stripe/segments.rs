//! Unbroken stretches of the stripe, and means pooled along them.

use std::ops::Range;

/// Largest change of row per column inside a stretch \[px\].
const MAX_SLOPE_PX: f64 = 3.0;
/// Most missing columns inside a stretch.
const MAX_GAP_COLUMNS: usize = 3;

/// Splits points `(column, row)`, ordered by column, where row or column jumps.
pub(super) fn split(points: impl Iterator<Item = (usize, f64)>, out: &mut Vec<Range<usize>>) {
    out.clear();
    let mut start = 0;
    let mut last: Option<(usize, f64)> = None;
    let mut count = 0;
    for (index, (column, row)) in points.enumerate() {
        if let Some((c, r)) = last {
            let gap = column.saturating_sub(c).max(1);
            if gap > MAX_GAP_COLUMNS + 1 || (row - r).abs() > MAX_SLOPE_PX * gap as f64 {
                out.push(start..index);
                start = index;
            }
        }
        last = Some((column, row));
        count = index + 1;
    }
    if count > start {
        out.push(start..count);
    }
}

/// Mean of `values` within `reach` places, inside each stretch; `None` values do not count.
/// Places without any counted neighbour get `fallback`.
pub(super) fn pooled(
    stretches: &[Range<usize>],
    reach: usize,
    fallback: f64,
    value: impl Fn(usize) -> Option<f64>,
    out: &mut Vec<f64>,
) {
    out.clear();
    for stretch in stretches {
        // Running sums restart in each stretch: sums of small numbers, no drift.
        let mut sum = 0.0;
        let mut count = 0.0;
        let (mut low, mut high) = (stretch.start, stretch.start);
        for i in stretch.clone() {
            while high < (i + reach + 1).min(stretch.end) {
                if let Some(v) = value(high) {
                    sum += v;
                    count += 1.0;
                }
                high += 1;
            }
            while low + reach < i {
                if let Some(v) = value(low) {
                    sum -= v;
                    count -= 1.0;
                }
                low += 1;
            }
            out.push(if count > 0.5 { sum / count } else { fallback });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jumps_and_gaps_split_slopes_do_not() {
        let mut out = Vec::new();
        let rows = [
            (0, 1.0),
            (1, 3.0),
            (2, 5.0),
            (3, 15.0),
            (4, 15.0),
            (12, 15.0),
        ];
        split(rows.into_iter(), &mut out);
        assert_eq!(out, [0..3, 3..5, 5..6]);
        split(std::iter::empty(), &mut out);
        assert!(out.is_empty());
    }

    #[test]
    fn means_stay_inside_their_stretch() {
        let values = [Some(1.0), Some(3.0), None, Some(10.0), Some(20.0)];
        let mut out = Vec::new();
        pooled(&[0..3, 3..5], 1, -1.0, |i| values[i], &mut out);
        assert_eq!(out, [2.0, 2.0, 3.0, 15.0, 15.0]);
    }
}
