//! How well a measured rate agrees with what the pose says, and what the data cannot tell.

use crate::check::Options;

/// One span: means over it of what the pose says, of the measured rate, and of that rate by every second of its samples.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pair {
    pub pose: f64,
    pub rate: f64,
    pub coarse: f64,
}

/// Means, variances and covariances of the pose's rate and of the measured rate over many spans.
#[derive(Debug, Clone, Copy)]
pub(super) struct Agreement<'a> {
    pub options: &'a Options,
    spans: usize,
    /// Variance that noise alone makes.
    noise: f64,
    mean_pose: f64,
    mean_rate: f64,
    pose: f64,
    rate: f64,
    both: f64,
    both_coarse: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Verdict {
    /// Neither moves beyond noise.
    TooLittle,
    /// One follows the other with a gain, which may be anything from .. to.
    Follows {
        fit: f64,
        gain: f64,
        from: f64,
        to: f64,
    },
    /// Both stand still at values other than zero.
    Steady { ratio: f64 },
    /// One moves, and the other does not with it.
    Apart { fit: f64 },
}

impl<'a> Agreement<'a> {
    pub fn of(pairs: &[Pair], noise: f64, options: &'a Options) -> Agreement<'a> {
        let n = pairs.len().max(1) as f64;
        let mean = |f: &dyn Fn(&Pair) -> f64| pairs.iter().map(f).sum::<f64>() / n;
        let (mean_pose, mean_rate) = (mean(&|p| p.pose), mean(&|p| p.rate));
        let mean_coarse = mean(&|p| p.coarse);
        Agreement {
            options,
            spans: pairs.len(),
            noise,
            mean_pose,
            mean_rate,
            pose: mean(&|p| (p.pose - mean_pose).powi(2)),
            rate: mean(&|p| (p.rate - mean_rate).powi(2)),
            both: mean(&|p| (p.pose - mean_pose) * (p.rate - mean_rate)),
            both_coarse: mean(&|p| (p.pose - mean_pose) * (p.coarse - mean_coarse)),
        }
    }

    /// By how much the pose's motion stands out of the noise.
    pub fn clarity(&self) -> f64 {
        self.pose / self.noise.max(f64::MIN_POSITIVE)
    }

    pub fn fit(&self) -> f64 {
        let size = (self.pose * self.rate).sqrt();
        if size > 0.0 { self.both / size } else { 0.0 }
    }

    pub fn pose_moves(&self) -> bool {
        self.pose > 0.0 && self.pose >= self.options.moves_variances * self.noise
    }

    /// Bounds of the gain. Noise of the pose makes the first regression too small, noise of the rate the second one too
    /// large; what half the samples change is what the samples there are may lack.
    pub fn gains(&self) -> (f64, f64) {
        let (low, high) = (self.both / self.pose, self.rate / self.both);
        let unresolved = (low - self.both_coarse / self.pose).abs();
        (low.min(high) - unresolved, low.max(high) + unresolved)
    }

    pub fn verdict(&self) -> Verdict {
        let options = self.options;
        let moves = options.moves_variances;
        if self.spans < options.spans {
            return Verdict::TooLittle;
        }
        let rate_moves = self.rate > 0.0 && self.rate >= moves * self.noise;
        if !self.pose_moves() {
            let steady = |mean: f64, spread: f64| mean.powi(2) > moves * spread.max(self.noise);
            return if steady(self.mean_pose, self.pose) && steady(self.mean_rate, self.rate) {
                Verdict::Steady {
                    ratio: self.mean_rate / self.mean_pose,
                }
            } else if rate_moves
                && self.rate >= options.moves_alone_variances * self.noise.max(self.pose)
            {
                Verdict::Apart { fit: self.fit() }
            } else {
                Verdict::TooLittle
            };
        }
        let fit = self.fit();
        if fit.abs() * (self.spans as f64).sqrt() < options.no_chance_sds || fit == 0.0 {
            return Verdict::Apart { fit };
        }
        let (from, to) = self.gains();
        Verdict::Follows {
            fit,
            gain: fit.signum() * (self.rate / self.pose).sqrt(),
            from,
            to,
        }
    }
}
