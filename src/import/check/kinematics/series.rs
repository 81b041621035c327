//! Series of a table as kinematics needs them: without holes, at half the samples, summed over time, with their noise.

use crate::check::quantile;

/// Share of the differences that is taken for noise, and the normal distribution's quantile there.
const NOISE_SHARE: f64 = 0.9;
const NOISE_QUANTILE: f64 = 1.645;
/// Variance of a third difference of white noise: 1 + 9 + 9 + 1.
const THIRD_DIFFERENCE: f64 = 20.0;

/// Rows that hold a value.
pub(super) fn measured(values: &[f64]) -> Vec<usize> {
    let there = |i: &usize| values[*i].is_finite();
    (0..values.len()).filter(there).collect()
}

/// Usual time from one of the rows to the next \[s\].
pub(super) fn usual_step_s(rows: &[usize], times_s: &[f64]) -> f64 {
    let steps = rows.windows(2).map(|w| times_s[w[1]] - times_s[w[0]]);
    let mut steps: Vec<f64> = steps.filter(|s| *s > 0.0).collect();
    quantile(&mut steps, 0.5).unwrap_or(0.0)
}

/// Straight lines between the given rows of a series; nothing before, after, and in holes of more than so many steps.
pub(super) fn lines(values: &[f64], rows: &[usize], times_s: &[f64], bridged: f64) -> Vec<f64> {
    let mut out = vec![f64::NAN; values.len()];
    let bridged_s = bridged * usual_step_s(rows, times_s);
    for w in rows.windows(2) {
        let (a, b) = (w[0], w[1]);
        (out[a], out[b]) = (values[a], values[b]);
        let step_s = times_s[b] - times_s[a];
        if step_s > bridged_s || step_s <= 0.0 {
            continue;
        }
        for k in a + 1..b {
            out[k] = values[a] + (values[b] - values[a]) * (times_s[k] - times_s[a]) / step_s;
        }
    }
    out
}

/// Sd of a series' noise from its third differences, which a motion that is well sampled does not have.
pub(super) fn noise(values: &[f64], rows: &[usize]) -> f64 {
    let third = |w: &[usize]| {
        let v = |i: usize| values[w[i]];
        (v(3) - 3.0 * v(2) + 3.0 * v(1) - v(0)).abs()
    };
    let mut all: Vec<f64> = rows.windows(4).map(third).collect();
    quantile(&mut all, NOISE_SHARE).unwrap_or(0.0) / NOISE_QUANTILE / THIRD_DIFFERENCE.sqrt()
}

/// A series summed over time: what it makes between any two rows with no hole of more than so many steps between them.
pub(super) struct Sum {
    sum: Vec<f64>,
    /// Steps so far that have no sum.
    holes: Vec<usize>,
}

impl Sum {
    pub fn of(values: &[f64], times_s: &[f64], bridged: f64) -> Sum {
        let rows: Vec<usize> = (0..times_s.len()).collect();
        let longest_s = bridged * usual_step_s(&rows, times_s);
        let mut out = Sum {
            sum: vec![0.0; values.len()],
            holes: vec![0; values.len()],
        };
        for i in 1..values.len() {
            let step_s = times_s[i] - times_s[i - 1];
            let step = 0.5 * (values[i] + values[i - 1]) * step_s;
            let whole = step.is_finite() && step_s <= longest_s && step_s >= 0.0;
            out.sum[i] = out.sum[i - 1] + if whole { step } else { 0.0 };
            out.holes[i] = out.holes[i - 1] + usize::from(!whole);
        }
        out
    }

    pub fn between(&self, a: usize, b: usize) -> Option<f64> {
        (self.holes[a] == self.holes[b]).then(|| self.sum[b] - self.sum[a])
    }
}
