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

/// Places that share one mean: next to the reach of a mean, its middle may be this coarse.
const GROUP: usize = 8;

/// Means of `N` values within about `reach` places, inside each stretch, one for every eight
/// places; `None` values do not count. Places without any counted neighbour get `fallback`.
pub(super) fn pooled<const N: usize>(
    stretches: &[Range<usize>],
    reach: usize,
    fallback: [f64; N],
    value: impl Fn(usize) -> Option<[f64; N]>,
    scratch: &mut Vec<([f64; N], f64)>,
    out: &mut Vec<[f64; N]>,
) {
    let zero = ([0.0; N], 0.0);
    let add = |sum: &mut ([f64; N], f64), values: [f64; N], count: f64| {
        for (s, v) in sum.0.iter_mut().zip(values) {
            *s += v;
        }
        sum.1 += count;
    };
    out.clear();
    for stretch in stretches {
        scratch.clear();
        for start in stretch.clone().step_by(GROUP) {
            let mut sum = zero;
            for i in start..(start + GROUP).min(stretch.end) {
                if let Some(values) = value(i) {
                    add(&mut sum, values, 1.0);
                }
            }
            scratch.push(sum);
        }
        let groups = reach.div_ceil(GROUP);
        for group in 0..scratch.len() {
            let mut sum = zero;
            for (values, count) in
                &scratch[group.saturating_sub(groups)..(group + groups + 1).min(scratch.len())]
            {
                add(&mut sum, *values, *count);
            }
            let mean = match sum {
                (values, count) if count > 0.5 => values.map(|v| v / count),
                _ => fallback,
            };
            let places = GROUP.min(stretch.len() - group * GROUP);
            out.extend(std::iter::repeat_n(mean, places));
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
        let values = [Some(1.0), Some(3.0), None, Some(10.0), Some(20.0), None];
        let value = |i: usize| {
            values
                .get(i)
                .map_or(Some([1.0, 9.0]), |v| v.map(|v| [v, 2.0 * v]))
        };
        let (mut scratch, mut out) = (Vec::new(), Vec::new());
        let stretches = [0..3, 3..5, 5..6, 6..26];
        pooled(&stretches, 1, [-1.0, -2.0], value, &mut scratch, &mut out);
        assert_eq!(out.len(), 26);
        let expected = [2.0, 2.0, 2.0, 15.0, 15.0, -1.0].map(|v| [v, 2.0 * v]);
        assert_eq!(out[..6], expected);
        assert!(out[6..].iter().all(|v| *v == [1.0, 9.0]));
    }

    #[test]
    fn means_reach_into_the_neighbouring_groups_and_no_farther() {
        let value = |i: usize| Some([i as f64]);
        let (mut scratch, mut out) = (Vec::new(), Vec::new());
        #[allow(clippy::single_range_in_vec_init)] // one run of columns
        pooled(&[0..40], GROUP, [0.0], value, &mut scratch, &mut out);
        // Mean of 8..32 in the middle group, of 0..16 in the first.
        assert_eq!((out[16], out[23], out[0]), ([19.5], [19.5], [7.5]));
    }
}
