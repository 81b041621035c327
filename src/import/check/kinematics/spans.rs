//! Pose differences and measured rates over the same spans: the mean of a rate over a span is the difference of the pose
//! over it, whatever the sampling and however long the span.

use super::agreement::{Agreement, Pair, SPANS_MIN};
use super::series::{Sum, lines, measured, noise, usual_step_s};
use super::{Assumed, ROWS_COMPARED};
use crate::attitude::{to_body, to_tank};
use crate::table::Imported;

/// Motion that is so many times the noise's variance needs no longer spans.
const CLEAR: f64 = 100.0;

/// One measured series: by all of its samples and by every second of them.
struct Rate {
    fine: Vec<f64>,
    coarse: Vec<f64>,
    sd: f64,
    step_s: f64,
}

/// Pose and rates of a table, without holes.
pub(super) struct Tracks<'a> {
    times_s: &'a [f64],
    pose: Vec<Vec<f64>>,
    /// Rows in which each pose channel was measured, and its noise.
    rows: Vec<Vec<usize>>,
    sd: Vec<f64>,
    rates: Vec<Option<Rate>>,
}

/// What a comparison takes: sums of the measured vector, by all and by half the samples.
pub(super) struct Vector {
    fine: [Sum; 3],
    coarse: [Sum; 3],
}

impl<'a> Tracks<'a> {
    /// `pose` goes on over whole turns.
    pub fn new(data: &'a Imported, mut pose: Vec<Vec<f64>>, assumed: Assumed) -> Tracks<'a> {
        let n = data.times_s.len();
        let times_s = &data.times_s;
        let rows: Vec<Vec<usize>> = pose
            .iter()
            .map(|v| {
                if v.len() == n {
                    measured(v)
                } else {
                    Vec::new()
                }
            })
            .collect();
        let sd = pose.iter().zip(&rows).map(|(v, r)| noise(v, r)).collect();
        if assumed.sparse {
            for (values, rows) in pose.iter_mut().zip(&rows) {
                if !rows.is_empty() {
                    *values = lines(values, rows, times_s);
                }
            }
        }
        let rate = |c: usize| {
            let values = &data.motion[6 + c];
            let all = (values.len() == n).then(|| measured(values))?;
            let half: Vec<usize> = all.iter().copied().step_by(2).collect();
            Some(Rate {
                fine: if assumed.sparse {
                    lines(values, &all, times_s)
                } else {
                    values.clone()
                },
                coarse: lines(values, &half, times_s),
                sd: noise(values, &all),
                step_s: usual_step_s(&all, times_s),
            })
        };
        Tracks {
            times_s,
            rows,
            sd,
            rates: (0..6).map(rate).collect(),
            pose,
        }
    }

    pub fn has_pose(&self, c: usize) -> bool {
        !self.rows[c].is_empty()
    }
    pub fn has_rate(&self, c: usize) -> bool {
        self.rates[c].is_some()
    }

    /// Attitude of a row; what is not measured of it is 0.
    fn angles(&self, i: usize) -> [f64; 3] {
        [3, 4, 5].map(|c| {
            if self.has_pose(c) {
                self.pose[c][i]
            } else {
                0.0
            }
        })
    }

    /// What the pose's neighbours make of a rate along the body that is not measured.
    fn derived(&self, i: usize) -> [f64; 3] {
        let (a, b) = (i.saturating_sub(1), (i + 1).min(self.times_s.len() - 1));
        let step_s = self.times_s[b] - self.times_s[a];
        let change = |c: usize| {
            if self.has_pose(c) {
                (self.pose[c][b] - self.pose[c][a]) / step_s
            } else {
                0.0
            }
        };
        to_body(self.angles(i), [change(0), change(1), change(2)])
    }

    /// Sums of a vector that each row makes of its rates: all of them, or every second sample's.
    fn vector(&self, kind: usize, make: impl Fn(usize, [f64; 3]) -> [f64; 3]) -> Vector {
        let n = self.times_s.len();
        let sums = |coarse: bool| -> [Sum; 3] {
            let row = |i: usize| {
                let own: [f64; 3] = std::array::from_fn(|k| match &self.rates[3 * kind + k] {
                    Some(r) if coarse => r.coarse[i],
                    Some(r) => r.fine[i],
                    None => f64::NAN,
                });
                make(i, own)
            };
            let rows: Vec<[f64; 3]> = (0..n).map(row).collect();
            [0, 1, 2].map(|k| {
                let values: Vec<f64> = rows.iter().map(|r| r[k]).collect();
                Sum::of(&values, self.times_s)
            })
        };
        Vector {
            fine: sums(false),
            coarse: sums(true),
        }
    }

    /// The rates as they stand.
    pub fn direct(&self, kind: usize) -> Vector {
        self.vector(kind, |_, own| own)
    }

    /// Velocities along the tank's axes, of rows that hold them along the body's; what is not measured is the pose's.
    pub fn in_tank(&self) -> Vector {
        let level = !self.has_pose(2);
        self.vector(0, |i, own| {
            let whole = own.iter().all(|v| v.is_finite());
            let from_pose = if whole { own } else { self.derived(i) };
            let filled: [f64; 3] = std::array::from_fn(|k| {
                if self.rates[k].is_some() {
                    own[k]
                } else {
                    from_pose[k]
                }
            });
            let mut tank = to_tank(self.angles(i), filled);
            if level {
                tank[2] = 0.0;
            }
            tank
        })
    }

    /// Velocities of the file taken the other way: along the tank's axes where they were said to be the body's, and
    /// turned twice where they were turned already.
    pub fn in_other_frame(&self, assumed: Assumed) -> Vector {
        self.vector(0, |i, own| {
            let own = own.map(|v| if v.is_finite() { v } else { 0.0 });
            let whole = [0, 1].iter().all(|k| {
                self.rates[*k]
                    .as_ref()
                    .is_some_and(|r| r.fine[i].is_finite())
            });
            if !whole {
                return [f64::NAN; 3];
            }
            if assumed.in_tank {
                to_tank(self.angles(i), to_tank(self.angles(i), own))
            } else {
                own
            }
        })
    }

    /// Changes of roll, pitch and heading that the body's rates make together.
    pub fn of_angles(&self) -> Vector {
        self.vector(1, |i, own| {
            let [phi, theta, _] = self.angles(i);
            let turned = own[1] * phi.sin() + own[2] * phi.cos();
            [
                own[0] + turned * theta.tan(),
                own[1] * phi.cos() - own[2] * phi.sin(),
                turned / theta.cos(),
            ]
        })
    }

    /// Rows between which spans of a channel lie: those in which its pose was measured.
    fn ends(&self, c: usize, every: usize) -> Vec<usize> {
        let rows = &self.rows[c];
        let thin = (rows.len() / every / ROWS_COMPARED).max(1);
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
    fn clearest(&self, c: usize, of: impl Fn(usize) -> Agreement) -> Agreement {
        let mut best = of(1);
        let mut every = 2;
        while best.clarity() < CLEAR && self.rows[c].len() / every > 2 * SPANS_MIN {
            let next = of(every);
            if next.clarity() > best.clarity() {
                best = next;
            }
            every *= 2;
        }
        best
    }

    /// One rate against the change of one pose channel.
    pub fn scalar(&self, rate: usize, pose: usize, sums: &Vector) -> Agreement {
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
            Agreement::of(&pairs, self.noise_of(pose, rate, span_s))
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
        let turned = all.map(|v| to_body(middle, v));
        turned
            .iter()
            .flatten()
            .all(|v| v.is_finite())
            .then_some(turned)
    }

    /// One velocity along the body against the way along one of its axes.
    pub fn velocity(&self, rate: usize, axis: usize, tank: &Vector) -> Agreement {
        self.clearest(0, |every| {
            let (pairs, span_s) = self.pairs(0, every, |a, b, span_s| {
                let [pose, fine, coarse] = self.along_body(tank, a, b, span_s)?;
                Some(Pair {
                    pose: pose[axis],
                    rate: fine[rate],
                    coarse: coarse[rate],
                })
            });
            Agreement::of(&pairs, self.noise_of(0, rate, span_s))
        })
    }

    /// How far velocities are from the way: (size of the way, distance of one reading, of the other, noise, what half the samples change), mean squares.
    pub fn distances(&self, own: &Vector, other: &Vector) -> Option<Distances> {
        let mut best: Option<Distances> = None;
        let mut every = 1;
        while best.is_none_or(|b| b.way < CLEAR * b.noise) && self.rows[0].len() / every > SPANS_MIN
        {
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
            if all.len() >= SPANS_MIN {
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
    /// What noise alone makes.
    pub noise: f64,
    /// What half the samples change.
    pub unresolved: f64,
}
