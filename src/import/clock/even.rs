//! Rounded stamps put back to the rate at which rows were taken.

use crate::check::{Finding, FindingList};

/// The coarsest power of ten of nanoseconds that all stamps are multiples of.
pub(crate) fn granularity(stamps_ns: &[i128]) -> i128 {
    let mut step = 1_000_000_000_i128;
    while step > 1 && stamps_ns.iter().any(|s| s % step != 0) {
        step /= 10;
    }
    step
}

/// Rows at a rate, with gaps where the stamps say so.
#[derive(Default)]
pub(crate) struct EvenRows {
    rate_hz: f64,
    period_ns: f64,
    granularity_ns: f64,
    /// First stamp, and the number of the row before.
    start: Option<(i128, i64)>,
    first_stamp_ns: i128,
    last_stamp_ns: i128,
    rows: u64,
    gaps: Vec<(u64, i64)>,
    gap_count: usize,
    missing: i64,
    /// Rows whose stamp is behind the rate's: (count, first line).
    behind: (usize, u64),
    farthest_ns: f64,
}

impl EvenRows {
    pub fn new(rate_hz: f64, granularity_ns: i128) -> Self {
        EvenRows {
            rate_hz,
            period_ns: 1e9 / rate_hz,
            granularity_ns: granularity_ns as f64,
            ..EvenRows::default()
        }
    }

    /// The time of the row with this stamp.
    pub fn put_back(&mut self, stamp_ns: i128, line: u64) -> i128 {
        self.rows += 1;
        self.last_stamp_ns = stamp_ns;
        let Some((zero_ns, before)) = self.start else {
            self.start = Some((stamp_ns, 0));
            self.first_stamp_ns = stamp_ns;
            return stamp_ns;
        };
        let since_ns = (stamp_ns - zero_ns) as f64;
        let mut row = before.saturating_add(1);
        let off_ns = since_ns - row as f64 * self.period_ns;
        // Two stamps may both be rounded, to either side.
        let allowed_ns = self.granularity_ns + 0.6 * self.period_ns;
        if off_ns > allowed_ns {
            let at = (since_ns / self.period_ns).round() as i64;
            self.missing = self.missing.saturating_add(at.saturating_sub(row));
            self.gap_count += 1;
            if self.gaps.len() < 8 {
                self.gaps.push((line, at.saturating_sub(row)));
            }
            row = at;
        } else if off_ns < -allowed_ns {
            if self.behind.0 == 0 {
                self.behind.1 = line;
            }
            self.behind.0 += 1;
        } else {
            self.farthest_ns = self.farthest_ns.max(off_ns.abs());
        }
        self.start = Some((zero_ns, row));
        zero_ns + (row as f64 * self.period_ns).round() as i128
    }

    pub fn report(&self, findings: &mut Vec<Finding>) {
        let rate_hz = self.rate_hz;
        let span_s = (self.last_stamp_ns - self.first_stamp_ns) as f64 * 1e-9;
        let counted_hz = (self.rows.saturating_sub(1)) as f64 / span_s;
        if self.behind.0 > 0 {
            findings.fault_at(
                "rate_hz",
                Some(self.behind.1),
                format!(
                    "rate_hz is {rate_hz}, but {} stamp(s) lie behind it, the first on line {}: there are {counted_hz:.3} rows per second",
                    self.behind.0,
                    self.behind.1,
                ),
            );
            return;
        }
        // Many small gaps, evenly: the rate is another.
        if self.gap_count > 10 && self.missing <= 3 * self.gap_count as i64 {
            findings.fault_at(
                "rate_hz",
                self.gaps.first().map(|g| g.0),
                format!(
                    "rate_hz is {rate_hz}, but the stamps run ahead of it {} times: there are {counted_hz:.3} rows per second",
                    self.gap_count,
                ),
            );
            return;
        }
        let gaps: Vec<String> = self
            .gaps
            .iter()
            .map(|(line, n)| format!("{n} before line {line}"))
            .collect();
        let gaps = if gaps.is_empty() {
            "no row missing".to_owned()
        } else {
            format!("rows missing: {}", gaps.join(", "))
        };
        findings.info(
            "even_rows",
            format!(
                "stamps are rounded to {:.3e} s; times are made of rate_hz = {rate_hz}, at most {:.3e} s from them; {gaps}",
                self.granularity_ns * 1e-9,
                self.farthest_ns * 1e-9,
            ),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Rounded in whatever way, at whatever rate: the rows are where they were, but for the first stamp's rounding.
        #[test]
        fn rounded_stamps_are_put_back(rate_hz in 20.0..400.0_f64, digits in 0..4, mode in 0..3, gap_at in 100..200_i64, gap in 0..40_i64) {
            let step_ns = 10_i128.pow(9 - digits as u32);
            let gap = if gap as f64 / rate_hz * 1e9 > 3.0 * step_ns as f64 { gap } else { 0 };
            let truth: Vec<i128> = (0..300)
                .map(|k| if k < gap_at { k } else { k + gap })
                .map(|k| (k as f64 / rate_hz * 1e9).round() as i128)
                .collect();
            let rounded = |t: &i128| match mode {
                0 => t / step_ns * step_ns,
                1 => (t + step_ns / 2) / step_ns * step_ns,
                _ => (t + step_ns - 1) / step_ns * step_ns,
            };
            let stamps: Vec<i128> = truth.iter().map(rounded).collect();
            let mut even = EvenRows::new(rate_hz, step_ns);
            let found: Vec<i128> = stamps.iter().zip(1..).map(|(s, line)| even.put_back(*s, line)).collect();
            prop_assert_eq!(even.behind.0, 0);
            for k in 0..gap_at as usize {
                prop_assert!((found[k] - truth[k]).abs() <= 1, "row {}", k);
            }
            // After a gap to within the rounding.
            for k in gap_at as usize..300 {
                let off = (found[k] - truth[k]).abs() as f64;
                prop_assert!(off <= step_ns as f64 + 1e9 / rate_hz, "row {} by {}", k, off);
            }
        }
    }

    #[test]
    fn the_granularity_is_that_of_the_stamps() {
        assert_eq!(
            granularity(&[0, 10_000_000, 20_000_000, 130_000_000]),
            10_000_000
        );
        assert_eq!(granularity(&[0, 1_000_000_000]), 1_000_000_000);
        assert_eq!(granularity(&[1]), 1);
    }
}
