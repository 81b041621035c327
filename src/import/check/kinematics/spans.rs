//! Pose differences and measured rates over the same spans: the mean of a rate over a span is the difference of the pose
//! over it, whatever the sampling and however long the span.

use super::agreement::{Agreement, Pair};
use super::series::Sum;
use super::tracks::{Tracks, Vector};
use crate::attitude::to_body;
use crate::check::Options;

impl<'a> Tracks<'a> {
    /// Rows between which spans of a channel lie: those in which its pose was measured.
    fn ends(&self, c: usize, every: usize) -> Vec<usize> {
        let rows = &self.rows[c];
        let thin = (rows.len() / every / self.options.compared_rows).max(1);
        // A long table tells no more: every so many spans.
        rows.iter().copied().step_by(every * thin).collect()
    }

    /// Variance that noise makes of a mean over a span.
    fn noise_of(&self, c: usize, rate: usize, span_s: f64) -> f64 {
        let own = self.rates[rate].as_ref();
        let of_rate = own.map_or(0.0, |r| r.sd.powi(2) * (r.step_s / span_s).min(1.0));
        2.0 * (self.sd[c] / span_s).powi(2) + of_rate
    }

    /// Pairs of every span of so many rows, by what `make` makes of its ends.
    fn pairs<T>(
        &self,
        c: usize,
        every: usize,
        make: impl Fn(usize, usize, f64) -> Option<T>,
    ) -> (Vec<T>, f64) {
        let ends = self.ends(c, every);
        let mut total_s = 0.0;
        let out: Vec<T> = ends
            .windows(2)
            .filter_map(|w| {
                let span_s = self.times_s[w[1]] - self.times_s[w[0]];
                let made = (span_s > 0.0).then(|| make(w[0], w[1], span_s))??;
                total_s += span_s;
                Some(made)
            })
            .collect();
        let mean_s = total_s / out.len().max(1) as f64;
        (out, mean_s)
    }

    /// The shortest spans over which the pose moves clearly, or those over which it does most.
    fn clearest(&self, c: usize, of: impl Fn(usize) -> Agreement<'a>) -> Agreement<'a> {
        let mut best = of(1);
        let mut every = 2;
        while best.clarity() < self.options.clear_variances
            && self.rows[c].len() / every > 2 * self.options.spans
        {
            let next = of(every);
            if next.clarity() > best.clarity() {
                best = next;
            }
            every *= 2;
        }
        best
    }

    /// One rate against the change of one pose channel.
    pub fn scalar(&self, rate: usize, pose: usize, sums: &Vector) -> Agreement<'a> {
        let k = rate % 3;
        self.clearest(pose, |every| {
            let (pairs, span_s) = self.pairs(pose, every, |a, b, span_s| {
                let pair = Pair {
                    pose: (self.pose[pose][b] - self.pose[pose][a]) / span_s,
                    rate: sums.fine[k].between(a, b)? / span_s,
                    coarse: sums.coarse[k].between(a, b)? / span_s,
                };
                pair.pose.is_finite().then_some(pair)
            });
            Agreement::of(&pairs, self.noise_of(pose, rate, span_s), self.options)
        })
    }

    /// Mean velocities of a span along the axes of the body in its middle: the pose's, the measured ones.
    fn along_body(&self, sums: &Vector, a: usize, b: usize, span_s: f64) -> Option<[[f64; 3]; 3]> {
        let change = |c: usize| {
            if self.has_pose(c) {
                (self.pose[c][b] - self.pose[c][a]) / span_s
            } else {
                0.0
            }
        };
        let mean = |s: &[Sum; 3]| -> Option<[f64; 3]> {
            Some([
                s[0].between(a, b)? / span_s,
                s[1].between(a, b)? / span_s,
                s[2].between(a, b)? / span_s,
            ])
        };
        let middle = self.angles(usize::midpoint(a, b));
        let all = [
            [change(0), change(1), change(2)],
            mean(&sums.fine)?,
            mean(&sums.coarse)?,
        ];
        let rotated = all.map(|v| to_body(middle, v));
        rotated
            .iter()
            .flatten()
            .all(|v| v.is_finite())
            .then_some(rotated)
    }

    /// One velocity along the body against the way along one of its axes.
    pub fn velocity(&self, rate: usize, axis: usize, tank: &Vector) -> Agreement<'a> {
        self.clearest(0, |every| {
            let (pairs, span_s) = self.pairs(0, every, |a, b, span_s| {
                let [pose, fine, coarse] = self.along_body(tank, a, b, span_s)?;
                Some(Pair {
                    pose: pose[axis],
                    rate: fine[rate],
                    coarse: coarse[rate],
                })
            });
            Agreement::of(&pairs, self.noise_of(0, rate, span_s), self.options)
        })
    }

    /// How far velocities are from the way: (size of the way, distance of one reading, of the other, noise, what half the samples change), mean squares.
    pub fn distances(&self, own: &Vector, other: &Vector) -> Option<Distances> {
        let mut best: Option<Distances> = None;
        let mut every = 1;
        let Options {
            clear_variances: clear,
            spans,
            ..
        } = *self.options;
        while best.is_none_or(|b| b.way < clear * b.noise) && self.rows[0].len() / every > spans {
            let (all, span_s) = self.pairs(0, every, |a, b, span_s| {
                let mean = |s: &[Sum; 3], k: usize| s[k].between(a, b).map(|v| v / span_s);
                let mut of_span = [0.0; 4];
                for k in 0..2 {
                    let way = (self.pose[k][b] - self.pose[k][a]) / span_s;
                    let (x, y) = (mean(&own.fine, k)?, mean(&other.fine, k)?);
                    let coarse = mean(&own.coarse, k)?;
                    let parts = [way, x - way, y - way, coarse - x];
                    (0..4).for_each(|i| of_span[i] += parts[i].powi(2));
                }
                of_span.iter().all(|v| v.is_finite()).then_some(of_span)
            });
            let n = all.len() as f64;
            if all.len() >= spans {
                let mean = |i: usize| all.iter().map(|s| s[i]).sum::<f64>() / n;
                let noise = self.noise_of(0, 0, span_s) + self.noise_of(1, 1, span_s);
                let next = Distances {
                    way: mean(0),
                    own: mean(1),
                    other: mean(2),
                    noise,
                    unresolved: mean(3),
                };
                if best.is_none_or(|b| next.way * b.noise > b.way * next.noise) {
                    best = Some(next);
                }
            }
            every *= 2;
        }
        best
    }
}

/// Mean squares \[m²/s²\].
#[derive(Debug, Clone, Copy)]
pub(super) struct Distances {
    /// Of the way's speed.
    pub way: f64,
    /// Between it and the velocities as the map has them, and the other way.
    pub own: f64,
    pub other: f64,
    /// Of noise alone.
    pub noise: f64,
    /// Between the velocities by all samples and by every second one.
    pub unresolved: f64,
}
