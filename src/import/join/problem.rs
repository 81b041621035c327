//! Problem that a fit solves: measured series, loads, and what a set of unknowns leaves of them.

use nalgebra::{DMatrix, DVector};

use hydroline_core::run::{Channel, Run};
use hydroline_numerics::information::Covariance;

use super::response::{COEFFICIENTS, Loads, simulate};

/// Places of offset and drift among the unknowns; drift in parts per thousand, which makes both of one size.
pub(super) const SHARED: usize = 2;
pub(super) const DRIFT_UNIT: f64 = 1e-3;

/// One measured series of a degree of freedom.
pub(super) struct Series {
    pub(super) dof: usize,
    /// Way along the body's axis, else velocity.
    pub(super) is_way: bool,
    pub(super) values: Vec<f64>,
    pub(super) sd: f64,
    /// Correlation of the noise from one sample to the next.
    pub(super) rho: f64,
}

/// Measured series and loads that are to be aligned.
pub struct Problem {
    pub(super) times_s: Vec<f64>,
    /// Of each degree of freedom, by the commands' clock from the first on \[s\].
    pub(super) loads: Vec<Loads>,
    pub(super) dofs: Vec<usize>,
    pub(super) series: Vec<Series>,
    /// Middle of the commands, where the offset is fitted: there it does not go with the drift.
    pub(super) middle_s: f64,
    pub(super) end_s: f64,
}

/// Offset at the first command, and drift.
#[derive(Debug, Clone, PartialEq)]
pub struct Aligned {
    /// Between the two zeros \[s\].
    pub offset_s: f64,
    /// Its standard deviation \[s\].
    pub offset_sd_s: f64,
    /// Second per second.
    pub drift: f64,
    /// Its standard deviation.
    pub drift_sd: f64,
    /// For a person.
    pub warnings: Vec<String>,
}

/// Ways along the body's axes, summed from sample to sample by the attitude between them.
pub(super) fn ways(run: &Run) -> [Vec<f64>; 3] {
    let mut out: [Vec<f64>; 3] = Default::default();
    let mut way = [0.0; 3];
    let mut before: Option<([f64; 3], f64)> = None;
    let measured: [bool; 3] = [Channel::X, Channel::Y, Channel::Z].map(|c| run.has(c));
    // Rows of another topic hold no place, or no heading: the last one stands.
    let mut psi = 0.0;
    for s in &run.samples {
        let place = [Channel::X, Channel::Y, Channel::Z].map(|c| s.values[c]);
        if s.values[Channel::Psi].is_finite() {
            psi = s.values[Channel::Psi];
        }
        if place
            .iter()
            .zip(measured)
            .any(|(v, there)| there && !v.is_finite())
        {
            out.iter_mut().for_each(|values| values.push(f64::NAN));
            continue;
        }
        // An axis that is not measured moves nothing.
        let known = place.map(|v| if v.is_finite() { v } else { 0.0 });
        if let Some((last, turn)) = before {
            let half = 0.5 * (psi + turn);
            let d: [f64; 3] = std::array::from_fn(|i| known[i] - last[i]);
            way[0] += half.cos() * d[0] + half.sin() * d[1];
            way[1] += -half.sin() * d[0] + half.cos() * d[1];
            way[2] += d[2];
        }
        before = Some((known, psi));
        for (axis, values) in out.iter_mut().enumerate() {
            // Surge and sway need both coordinates unless the heading never leaves the axis.
            values.push(if place[axis].is_finite() {
                way[axis]
            } else {
                f64::NAN
            });
        }
    }
    out
}

impl Problem {
    /// Motion by its clock, commands by theirs; both from their own zero on.
    pub fn new(motion: &Run, commands: &Run) -> Problem {
        let times_s: Vec<f64> = motion.samples.iter().map(|s| s.t_s).collect();
        let loads: Vec<Loads> = (0..6)
            .map(|d| {
                let of = |c: &hydroline_core::run::Command| (c.t_s, c.wrench[d]);
                commands.commands.iter().map(of).collect()
            })
            .collect();
        let varies = |d: &usize| {
            let own = loads[*d].iter().map(|l| l.1);
            let (low, high) = own.fold((0.0, 0.0), |(l, h): (f64, f64), v| (l.min(v), h.max(v)));
            high > low
        };
        let ways = ways(motion);
        let mut series = Vec::new();
        let mut dofs = Vec::new();
        for d in (0..6).filter(varies) {
            let [place, rate] = Channel::of(d);
            let column =
                |c: Channel| -> Vec<f64> { motion.samples.iter().map(|s| s.values[c]).collect() };
            let before = series.len();
            for (is_way, values) in [
                (
                    true,
                    if d < 3 {
                        ways[d].clone()
                    } else {
                        column(place)
                    },
                ),
                (false, column(rate)),
            ] {
                if values.iter().filter(|v| v.is_finite()).count() > 20 {
                    series.push(Series {
                        dof: dofs.len(),
                        is_way,
                        values,
                        sd: 1.0,
                        rho: 0.0,
                    });
                }
            }
            if series.len() > before {
                dofs.push(d);
            }
        }
        let end_s = commands.commands.last().map_or(0.0, |c| c.t_s);
        Problem {
            times_s,
            loads,
            dofs,
            series,
            middle_s: 0.5 * end_s,
            end_s,
        }
    }

    /// A time of the commands on the motion's clock.
    pub(super) fn moved(&self, at: &DVector<f64>, t_s: f64) -> f64 {
        t_s + at[0] + at[1] * DRIFT_UNIT * (t_s - self.middle_s)
    }

    /// Residuals in sds, whitened; `None` = the model runs away.
    pub(super) fn residuals(&self, at: &DVector<f64>) -> Option<Vec<f64>> {
        let mut out = Vec::new();
        for (place, dof) in self.dofs.iter().enumerate() {
            let own = SHARED + place * COEFFICIENTS;
            let c = &at.as_slice()[own..own + COEFFICIENTS];
            let loads: Loads = self.loads[*dof]
                .iter()
                .map(|l| (self.moved(at, l.0), l.1))
                .collect();
            let states = simulate(c, &loads, &self.times_s)?;
            for s in self.series.iter().filter(|s| s.dof == place) {
                let mut last = None;
                let scale = 1.0 / (s.sd * (1.0 - s.rho * s.rho).sqrt());
                for (value, state) in s.values.iter().zip(&states) {
                    // Noise is correlated from one measured sample to the next, as it was learnt.
                    if !value.is_finite() {
                        continue;
                    }
                    let r = value - if s.is_way { state.1 } else { state.0 };
                    out.push(match last {
                        Some(before) => scale * (r - s.rho * before),
                        None => r / s.sd,
                    });
                    last = Some(r);
                }
            }
        }
        Some(out)
    }

    /// Of the offset at the first command and of the drift, from the normal equations' matrix.
    pub(super) fn variances(&self, hessian: &DMatrix<f64>, held: &[bool]) -> (f64, f64) {
        let covariance = Covariance::of_information(hessian, 1e-12).with_infinities();
        let free = if held[1] { 0.0 } else { 1.0 };
        let (vo, vd) = (covariance[(0, 0)], covariance[(1, 1)] * free);
        let vod = covariance[(0, 1)] * free;
        // From the middle to the first command.
        let back = -self.middle_s * DRIFT_UNIT;
        (vo + 2.0 * back * vod + back * back * vd, vd)
    }

    pub(super) fn copy(&self) -> Problem {
        let series = self.series.iter().map(|s| Series {
            values: s.values.clone(),
            ..*s
        });
        Problem {
            times_s: self.times_s.clone(),
            loads: self.loads.clone(),
            dofs: self.dofs.clone(),
            series: series.collect(),
            ..*self
        }
    }

    /// Noise of each series from what the fit leaves.
    pub(super) fn learn_noise(&mut self, at: &DVector<f64>) -> Option<()> {
        for s in &mut self.series {
            (s.sd, s.rho) = (1.0, 0.0);
        }
        let all = self.residuals(at)?;
        let mut from = 0;
        // Series stand in the order of their degrees of freedom, as the residuals do.
        for s in &mut self.series {
            let count = s.values.iter().filter(|v| v.is_finite()).count();
            let own = &all[from..from + count];
            from += count;
            let power: f64 = own.iter().map(|r| r * r).sum();
            let lagged: f64 = own.windows(2).map(|w| w[0] * w[1]).sum();
            let free = (count as f64 - COEFFICIENTS as f64).max(1.0);
            s.sd = (power / free).sqrt().max(1e-12);
            let rho = lagged / power.max(f64::MIN_POSITIVE);
            // A correlation that white noise may show by chance counts as none.
            let chance = 2.5 / (count as f64).sqrt();
            s.rho = if rho.abs() > chance {
                rho.clamp(-0.9, 0.999)
            } else {
                0.0
            };
        }
        Some(())
    }
}
