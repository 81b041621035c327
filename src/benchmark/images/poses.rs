//! Poses after the effects are removed, beside those of the same frames without them.

use super::ImageCase;
use hydroline_diagnose::profiles::known::{self, Poses};

/// Errors of x, y, z \[m\] and of the angles \[rad\] below which nothing is compared: a tenth of what a frame gives at best.
const LEAST: [f64; 6] = [3e-5, 3e-6, 1e-5, 5e-7, 3e-5, 1e-5];

/// rms of the errors of the six numbers against the truth.
fn rms(poses: &[Poses], truth: &[Poses]) -> Option<[f64; 6]> {
    let (mut sums, mut n) = ([0.0; 6], 0usize);
    for (run, truth) in poses.iter().zip(truth) {
        for (t_s, pose) in run {
            let after = truth.partition_point(|p| p.0 < *t_s);
            let (Some(a), Some(b)) = (truth.get(after.saturating_sub(1)), truth.get(after)) else {
                continue;
            };
            let share = if b.0 > a.0 {
                (t_s - a.0) / (b.0 - a.0)
            } else {
                0.0
            };
            for (d, sum) in sums.iter_mut().enumerate() {
                let there = a.1[d] + share * (b.1[d] - a.1[d]);
                *sum += (pose[d] - there).powi(2);
            }
            n += 1;
        }
    }
    (n > 0).then(|| sums.map(|s| (s / n as f64).sqrt()))
}

/// rms over the six numbers of error after over error of the clean frames; `None` where either gives no poses.
pub(super) fn ratio(case: &ImageCase, after: &[Poses]) -> Option<f64> {
    let clean = known::poses(&case.clean, &case.rig).ok()??;
    let (clean, after) = (rms(&clean, &case.poses)?, rms(after, &case.poses)?);
    let each = (0..6).map(|d| (after[d].max(LEAST[d]) / clean[d].max(LEAST[d])).powi(2));
    Some((each.sum::<f64>() / 6.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_taken_between_the_truths_stamps() {
        let truth = vec![vec![(0.0, [0.0; 6]), (1.0, [0.1; 6])]];
        let poses = vec![vec![(0.5, [0.05, 0.06, 0.05, 0.05, 0.05, 0.05])]];
        let found = rms(&poses, &truth).unwrap();
        assert!(
            found[0] < 1e-12 && (found[1] - 0.01).abs() < 1e-12,
            "{found:?}"
        );
    }
}
