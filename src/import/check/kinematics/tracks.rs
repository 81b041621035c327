//! Pose and rates of a table without holes, and the vectors that are made of the rates.

use super::Assumed;
use super::series::{Sum, lines, measured, noise, usual_step_s};
use crate::attitude::{to_body, to_tank};
use crate::check::Options;
use crate::table::Imported;

/// One measured series: by all of its samples and by every second of them.
pub(super) struct Rate {
    fine: Vec<f64>,
    coarse: Vec<f64>,
    pub(super) sd: f64,
    pub(super) step_s: f64,
}

/// Pose and rates of a table, without holes.
pub(super) struct Tracks<'a> {
    pub(super) options: &'a Options,
    pub(super) times_s: &'a [f64],
    pub(super) pose: Vec<Vec<f64>>,
    /// Rows in which each pose channel was measured, and its noise.
    pub(super) rows: Vec<Vec<usize>>,
    pub(super) sd: Vec<f64>,
    pub(super) rates: Vec<Option<Rate>>,
}

/// Running sums of a measured vector for a comparison: by all samples, and by every second one.
pub(super) struct Vector {
    pub(super) fine: [Sum; 3],
    pub(super) coarse: [Sum; 3],
}

impl<'a> Tracks<'a> {
    /// `pose` goes on over whole turns.
    pub fn new(
        data: &'a Imported,
        mut pose: Vec<Vec<f64>>,
        assumed: Assumed,
        options: &'a Options,
    ) -> Tracks<'a> {
        let bridged = options.bridged_steps;
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
                    *values = lines(values, rows, times_s, bridged);
                }
            }
        }
        let rate = |c: usize| {
            let values = &data.motion[6 + c];
            let all = (values.len() == n).then(|| measured(values))?;
            let half: Vec<usize> = all.iter().copied().step_by(2).collect();
            Some(Rate {
                fine: if assumed.sparse {
                    lines(values, &all, times_s, bridged)
                } else {
                    values.clone()
                },
                coarse: lines(values, &half, times_s, bridged),
                sd: noise(values, &all),
                step_s: usual_step_s(&all, times_s),
            })
        };
        Tracks {
            options,
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
    pub(super) fn angles(&self, i: usize) -> [f64; 3] {
        [3, 4, 5].map(|c| {
            if self.has_pose(c) {
                self.pose[c][i]
            } else {
                0.0
            }
        })
    }

    /// Velocity along the body by the difference between the neighbouring rows' positions, for an axis that is not measured.
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
                Sum::of(&values, self.times_s, self.options.bridged_steps)
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
    /// rotated twice where they were rotated already.
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
            let rotated = own[1] * phi.sin() + own[2] * phi.cos();
            [
                own[0] + rotated * theta.tan(),
                own[1] * phi.cos() - own[2] * phi.sin(),
                rotated / theta.cos(),
            ]
        })
    }
}
