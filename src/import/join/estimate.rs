//! Offset and drift from the data: the motion answers to the commands.
//!
//! Each degree of freedom that is commanded and measured follows its own equation (`response`); offset, drift and all
//! coefficients are fitted together to velocities and ways travelled along the body's axes, weighted by the noise
//! that is left, whitened by its correlation from sample to sample. A latency between command and load cannot be told
//! from an offset of the clocks: it is in what is found.

use std::path::Path;

use nalgebra::{DMatrix, DVector, Dyn};

use hydroline_identify::data::{Run, load_messages};
use hydroline_log::messages::{Stamped, pb};
use hydroline_log::{LogReader, Record};
use hydroline_numerics::information::Covariance;
use hydroline_numerics::least_squares::{LeastSquares, Normal, Options, minimise};
use hydroline_rigs::{Dof, Rig};

use super::clocks::Pairs;
use super::response::{COEFFICIENTS, Loads, simulate};
use super::{From, Given, JoinError, Relation};

/// Samples that are looked at: half an hour at 100 Hz.
const SAMPLES_MAX: usize = 200_000;
/// Commands that are looked at.
const COMMANDS_MAX: usize = 200_000;
/// Samples that tell where about the offset is.
const COARSE_SAMPLES: usize = 400;
/// Offsets tried for that.
const COARSE_OFFSETS: usize = 20_000;
/// Steps between them \[s\].
const COARSE_STEP_S: f64 = 0.1;
/// Time constants of the loads' filters that stand for an unknown vehicle \[s\].
const FILTERS_S: [f64; 4] = [0.5, 2.0, 8.0, 40.0];
/// Rounds in which noise and fit are found in turn.
const ROUNDS: usize = 3;
/// Places of offset and drift among the unknowns; drift in parts per thousand, which makes both of one size.
const SHARED: usize = 2;
const DRIFT_UNIT: f64 = 1e-3;

/// What both logs hold of motion, commands and clocks.
pub struct Pair {
    motion_name: String,
    command_name: String,
    motion: Vec<pb::VehicleMotion>,
    commands: Vec<pb::ThrusterCommand>,
    pub(super) motion_clocks: Pairs,
    pub(super) command_clocks: Pairs,
    /// First and last stamp of all motion and of all commands \[ns\].
    pub(super) motion_ns: (u64, u64),
    pub(super) commands_ns: (u64, u64),
    /// The rig that a log carries.
    rig_toml: Option<String>,
}

fn widen(ends: &mut Option<(u64, u64)>, ns: u64) {
    let (first, last) = ends.unwrap_or((ns, ns));
    *ends = Some((first.min(ns), last.max(ns)));
}

impl Pair {
    /// Reads both logs, in bounded memory.
    pub fn read(motion: &Path, commands: &Path) -> Result<Pair, JoinError> {
        let name = |p: &Path| p.display().to_string();
        let mut pair = Pair {
            motion_name: name(motion),
            command_name: name(commands),
            motion: Vec::new(),
            commands: Vec::new(),
            motion_clocks: Vec::new(),
            command_clocks: Vec::new(),
            motion_ns: (0, 0),
            commands_ns: (0, 0),
            rig_toml: None,
        };
        let clock = |c: &pb::ClockPair| (i128::from(c.monotonic_ns), i128::from(c.realtime_ns));
        let mut ends = None;
        let mut reader = LogReader::open(motion)?;
        for message in reader.by_ref() {
            match message?.record {
                Record::Motion(m) => {
                    widen(&mut ends, m.stamp_ns().unwrap_or(0));
                    if pair.motion.len() < SAMPLES_MAX {
                        pair.motion.push(m);
                    }
                }
                Record::Clock(c) if pair.motion_clocks.len() < SAMPLES_MAX => {
                    pair.motion_clocks.push(clock(&c));
                }
                _ => {}
            }
        }
        pair.motion_ns = ends.ok_or(JoinError::NoMotion { log: name(motion) })?;
        let own_rig = |toml: &str| Rig::from_toml(toml, "the log's rig", None).is_ok();
        pair.rig_toml = reader.rig_toml().filter(|t| own_rig(t)).map(str::to_owned);
        let mut ends = None;
        let mut reader = LogReader::open(commands)?;
        for message in reader.by_ref() {
            match message?.record {
                Record::Command(c) => {
                    widen(&mut ends, c.stamp_ns().unwrap_or(0));
                    if pair.commands.len() < COMMANDS_MAX {
                        pair.commands.push(c);
                    }
                }
                Record::Clock(c) if pair.command_clocks.len() < SAMPLES_MAX => {
                    pair.command_clocks.push(clock(&c));
                }
                _ => {}
            }
        }
        pair.commands_ns = ends.ok_or(JoinError::NoCommands {
            log: name(commands),
        })?;
        if let Some(rig) = reader.rig_toml().filter(|t| own_rig(t)) {
            pair.rig_toml = Some(rig.to_owned());
        }
        Ok(pair)
    }

    /// The rig that the joined log carries.
    pub(super) fn rig_toml(&self) -> Option<&str> {
        self.rig_toml.as_deref()
    }

    /// The first command by its own clock.
    pub fn reference_ns(&self) -> u64 {
        self.commands_ns.0
    }

    fn rig(&self, given: Option<&Rig>) -> Result<Rig, JoinError> {
        if let Some(rig) = given {
            return Ok(rig.clone());
        }
        if let Some(rig) = self.rig_toml() {
            return Rig::from_toml(rig, "the log's rig", None)
                .map_err(|e| JoinError::NotFound { why: e.to_string() });
        }
        let foreign = self
            .commands
            .iter()
            .find(|c| Dof::ALL.iter().all(|d| d.name() != c.thruster));
        if let Some(command) = foreign {
            return Err(JoinError::Rig {
                log: self.command_name.clone(),
                thruster: command.thruster.clone(),
            });
        }
        // Components act directly, whatever the rig.
        Rig::builtin("lshpi").map_err(|e| JoinError::NotFound { why: e.to_string() })
    }

    /// Offset and drift from the motion's answer.
    pub fn estimate(&self, rig: Option<&Rig>, given: Given) -> Result<Relation, JoinError> {
        let rig = self.rig(rig)?;
        let motion = load_messages(&self.motion_name, &[], &self.motion, &rig)?;
        let commands = load_messages(&self.command_name, &self.commands, &[], &rig)?;
        let problem = Problem::new(&motion, &commands);
        // Between the two zeros, as the stamps have it.
        let nominal_s = (i128::from(commands.start_ns) - i128::from(motion.start_ns)) as f64 * 1e-9;
        let drift = given.drift_ppm.map(|d| d * 1e-6);
        let found =
            align(&problem, drift, given.search_s).map_err(|why| JoinError::NotFound { why })?;
        let mut warnings = vec![
            "the offset is estimated from how the motion answers to the commands: any latency between command and load is part of it, and neither this log nor its diagnosis can tell the two apart".to_owned(),
        ];
        warnings.extend(found.warnings);
        Ok(Relation {
            from: From::Estimated,
            offset_s: found.offset_s - nominal_s,
            offset_sd_s: found.offset_sd_s,
            drift_ppm: found.drift * 1e6,
            drift_sd_ppm: found.drift_sd * 1e6,
            reference_ns: self.reference_ns(),
            warnings,
        })
    }
}

/// One measured series of a degree of freedom.
struct Series {
    dof: usize,
    /// Way along the body's axis, else velocity.
    is_way: bool,
    values: Vec<f64>,
    sd: f64,
    /// Correlation of the noise from one sample to the next.
    rho: f64,
}

/// What is to be aligned.
pub struct Problem {
    times_s: Vec<f64>,
    /// Of each degree of freedom, by the commands' clock from the first on \[s\].
    loads: Vec<Loads>,
    dofs: Vec<usize>,
    series: Vec<Series>,
    /// Middle of the commands, where the offset is fitted: there it does not go with the drift.
    middle_s: f64,
    end_s: f64,
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
    /// All unknowns, and which of them were held.
    #[cfg(test)]
    at: (DVector<f64>, Vec<bool>),
}

/// Ways along the body's axes, summed from sample to sample by the attitude between them.
fn ways(run: &Run) -> [Vec<f64>; 3] {
    let mut out: [Vec<f64>; 3] = Default::default();
    let mut way = [0.0; 3];
    let mut before: Option<([f64; 3], f64)> = None;
    for s in &run.samples {
        let place = [s.values[0], s.values[1], s.values[2]];
        let psi = if s.values[5].is_finite() {
            s.values[5]
        } else {
            0.0
        };
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
                let of = |c: &hydroline_identify::data::Command| (c.t_s, c.wrench[d]);
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
            let column =
                |c: usize| -> Vec<f64> { motion.samples.iter().map(|s| s.values[c]).collect() };
            let before = series.len();
            for (is_way, values) in [
                (true, if d < 3 { ways[d].clone() } else { column(d) }),
                (false, column(6 + d)),
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
    fn moved(&self, at: &DVector<f64>, t_s: f64) -> f64 {
        t_s + at[0] + at[1] * DRIFT_UNIT * (t_s - self.middle_s)
    }

    /// Residuals in sds, whitened; `None` = the model runs away.
    fn residuals(&self, at: &DVector<f64>) -> Option<Vec<f64>> {
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
                    if !value.is_finite() {
                        last = None;
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
    fn variances(&self, hessian: &DMatrix<f64>, held: &[bool]) -> (f64, f64) {
        let covariance = Covariance::of_information(hessian, 1e-12).with_infinities();
        let free = if held[1] { 0.0 } else { 1.0 };
        let (vo, vd) = (covariance[(0, 0)], covariance[(1, 1)] * free);
        let vod = covariance[(0, 1)] * free;
        // From the middle to the first command.
        let back = -self.middle_s * DRIFT_UNIT;
        (vo + 2.0 * back * vod + back * back * vd, vd)
    }

    /// The least sd of offset and drift that any estimate can have under white noise of these sds, all coefficients
    /// unknown too (Cramer and Rao).
    #[cfg(test)]
    pub(super) fn bound(&self, found: &Aligned, sds: &[f64]) -> Result<[f64; 2], String> {
        let mut own = self.copy();
        for (s, sd) in own.series.iter_mut().zip(sds) {
            (s.sd, s.rho) = (*sd, 0.0);
        }
        let (at, held) = &found.at;
        let mut fit = Fit {
            problem: &own,
            held: held.clone(),
        };
        let mut residuals = Vec::new();
        fit.begin(at, &mut residuals)?;
        let normal = fit.linearise(at, &residuals)?;
        let (offset, drift) = own.variances(&normal.hessian, held);
        Ok([offset.sqrt(), drift.sqrt() * DRIFT_UNIT])
    }

    fn copy(&self) -> Problem {
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
    fn learn_noise(&mut self, at: &DVector<f64>) -> Option<()> {
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
            // What white noise shows by chance is none.
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

/// The fit; drift, restoring and what is not there are held.
struct Fit<'a> {
    problem: &'a Problem,
    held: Vec<bool>,
}

impl Fit<'_> {
    fn size(&self, at: &DVector<f64>, k: usize) -> f64 {
        // A thousandth of a second, of a drift's unit, of a coefficient.
        1e-4 * at[k].abs().max(if k < SHARED { 1.0 } else { 1e-2 })
    }
}

impl LeastSquares<Dyn> for Fit<'_> {
    type Point = DVector<f64>;
    type Evaluated = Vec<f64>;
    type Error = String;

    fn cost(&mut self, at: &DVector<f64>, evaluated: &mut Vec<f64>) -> Option<f64> {
        *evaluated = self.problem.residuals(at)?;
        Some(0.5 * evaluated.iter().map(|r| r * r).sum::<f64>())
    }

    fn begin(&mut self, at: &DVector<f64>, evaluated: &mut Vec<f64>) -> Result<(), String> {
        *evaluated = self
            .problem
            .residuals(at)
            .ok_or("the motion runs away at the start of the fit")?;
        Ok(())
    }

    fn linearise(
        &mut self,
        at: &DVector<f64>,
        evaluated: &Vec<f64>,
    ) -> Result<Normal<Dyn>, String> {
        let n = at.len();
        let mut columns: Vec<Vec<f64>> = Vec::with_capacity(n);
        for k in 0..n {
            if self.held[k] {
                columns.push(vec![0.0; evaluated.len()]);
                continue;
            }
            let h = self.size(at, k);
            let side = |sign: f64| {
                let mut moved = at.clone();
                moved[k] += sign * h;
                self.problem.residuals(&moved)
            };
            let (Some(up), Some(down)) = (side(1.0), side(-1.0)) else {
                return Err("the motion runs away".to_owned());
            };
            columns.push(
                up.iter()
                    .zip(&down)
                    .map(|(u, d)| (u - d) / (2.0 * h))
                    .collect(),
            );
        }
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
        Ok(Normal {
            cost: 0.5 * dot(evaluated, evaluated),
            gradient: DVector::from_fn(n, |k, _| dot(&columns[k], evaluated)),
            hessian: DMatrix::from_fn(n, n, |i, j| {
                if i == j && self.held[i] {
                    1.0
                } else {
                    dot(&columns[i], &columns[j])
                }
            }),
        })
    }

    fn moved(&self, at: &DVector<f64>, step: &DVector<f64>) -> Option<DVector<f64>> {
        Some(at + step)
    }

    fn moves(&self, _: &DVector<f64>, _: &DVector<f64>, k: usize) -> bool {
        !self.held[k]
    }
}

/// Filtered loads on an even grid of the commands' clock.
struct Filtered {
    step_s: f64,
    /// Per filter: velocity and way at each step.
    values: Vec<Vec<(f64, f64)>>,
}

impl Filtered {
    fn new(loads: &Loads, end_s: f64) -> Filtered {
        let step_s = (end_s / 50_000.0).max(0.02);
        let count = (end_s / step_s) as usize + 2;
        let times: Vec<f64> = (0..count).map(|k| k as f64 * step_s).collect();
        let of = |tau: &f64| {
            let c = [1.0 / tau, 1.0 / tau, 0.0, 0.0, 0.0, 0.0, 0.0];
            simulate(&c, loads, &times).unwrap_or_default()
        };
        Filtered {
            step_s,
            values: FILTERS_S.iter().map(of).collect(),
        }
    }

    fn at(&self, filter: usize, t_s: f64, is_way: bool) -> f64 {
        let own = &self.values[filter];
        let pick = |v: &(f64, f64)| if is_way { v.1 } else { v.0 };
        let place = t_s / self.step_s;
        if place <= 0.0 || own.is_empty() {
            return 0.0;
        }
        let k = place as usize;
        match (own.get(k), own.get(k + 1)) {
            (Some(a), Some(b)) => {
                let share = place - k as f64;
                pick(a) * (1.0 - share) + pick(b) * share
            }
            // Behind the last command its load goes on; the filters are near their end.
            _ => own.last().map_or(0.0, |l| {
                let beyond_s = t_s - (own.len() - 1) as f64 * self.step_s;
                if is_way { l.1 + l.0 * beyond_s } else { l.0 }
            }),
        }
    }
}

/// Share of a series that no mixture of filtered loads explains, at an offset.
fn unexplained(
    s: &Series,
    picked: &[usize],
    times_s: &[f64],
    filtered: &Filtered,
    offset_s: f64,
) -> f64 {
    let columns = FILTERS_S.len() + 1 + usize::from(s.is_way);
    let mut rows = Vec::with_capacity(picked.len() * columns);
    let mut right = Vec::with_capacity(picked.len());
    for k in picked.iter().filter(|k| s.values[**k].is_finite()) {
        let t = times_s[*k];
        rows.extend((0..FILTERS_S.len()).map(|f| filtered.at(f, t - offset_s, s.is_way)));
        rows.push(1.0);
        if s.is_way {
            rows.push(t);
        }
        right.push(s.values[*k]);
    }
    if right.len() < 2 * columns {
        return 1.0;
    }
    let a = DMatrix::from_row_slice(right.len(), columns, &rows);
    let y = DVector::from_vec(right);
    let mean = y.mean();
    let power: f64 = y.iter().map(|v| (v - mean).powi(2)).sum();
    let normal = a.tr_mul(&a);
    let weight = normal.trace().max(f64::MIN_POSITIVE) * 1e-12;
    let ridge = &normal + DMatrix::identity(columns, columns) * weight;
    let Some(factor) = ridge.cholesky() else {
        return 1.0;
    };
    let x = factor.solve(&a.tr_mul(&y));
    let rest = (&y - &a * x).norm_squared();
    if power > 0.0 {
        (rest / power).min(1.0)
    } else {
        1.0
    }
}

/// Where about the offset is: (offset, what is left unexplained), best first.
fn coarse(problem: &Problem, search_s: f64) -> Vec<(f64, f64)> {
    let last = problem.times_s.last().copied().unwrap_or(0.0);
    let shorter = last.min(problem.end_s);
    // Half of the shorter must overlap.
    let low = (-(problem.end_s - 0.5 * shorter)).max(-search_s);
    let high = (last - 0.5 * shorter).min(search_s);
    let step = ((high - low) / COARSE_OFFSETS as f64).max(COARSE_STEP_S);
    let stride = problem.times_s.len().div_ceil(COARSE_SAMPLES).max(1);
    let picked: Vec<usize> = (0..problem.times_s.len()).step_by(stride).collect();
    let filtered: Vec<Filtered> = problem
        .dofs
        .iter()
        .map(|d| Filtered::new(&problem.loads[*d], problem.end_s + 1.0))
        .collect();
    let count = ((high - low) / step).max(0.0) as usize + 1;
    let costs: Vec<(f64, f64)> = (0..count)
        .map(|i| {
            let offset_s = low + i as f64 * step;
            let sum: f64 = problem
                .series
                .iter()
                .map(|s| {
                    let own = &filtered[s.dof];
                    unexplained(s, &picked, &problem.times_s, own, offset_s)
                        .max(1e-9)
                        .ln()
                })
                .sum();
            (offset_s, sum)
        })
        .collect();
    let mut minima: Vec<(f64, f64)> = (0..costs.len())
        .filter(|i| {
            let near = [i.checked_sub(1), Some(i + 1)];
            near.into_iter()
                .flatten()
                .filter_map(|j| costs.get(j))
                .all(|o| o.1 >= costs[*i].1)
        })
        .map(|i| costs[i])
        .collect();
    minima.sort_by(|a, b| a.1.total_cmp(&b.1));
    minima
}

/// Coefficients to begin with at an offset: a vehicle that answers within a few seconds.
fn start(problem: &Problem, offset_s: f64, drift: f64) -> DVector<f64> {
    let n = SHARED + problem.dofs.len() * COEFFICIENTS;
    let mut at = DVector::zeros(n);
    at[0] = offset_s + drift * problem.middle_s;
    at[1] = drift / DRIFT_UNIT;
    for (place, dof) in problem.dofs.iter().enumerate() {
        let own = SHARED + place * COEFFICIENTS;
        let c = [1.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0];
        at.as_mut_slice()[own..own + COEFFICIENTS].copy_from_slice(&c);
        // Gain: the size of the answer to the load as it is.
        let loads: Loads = problem.loads[*dof]
            .iter()
            .map(|l| (l.0 + offset_s, l.1))
            .collect();
        let states = simulate(&c, &loads, &problem.times_s).unwrap_or_default();
        let Some(s) = problem.series.iter().filter(|s| s.dof == place).last() else {
            continue;
        };
        let first = s
            .values
            .iter()
            .copied()
            .find(|v| v.is_finite())
            .unwrap_or(0.0);
        let (mut up, mut down) = (0.0, 0.0);
        for (value, state) in s.values.iter().zip(&states) {
            let own = if s.is_way { state.1 } else { state.0 };
            if value.is_finite() {
                up += (value - first) * own;
                down += own * own;
            }
        }
        if down > 0.0 {
            at[own] = up / down;
        }
        at[own + 5] = problem
            .series
            .iter()
            .find(|s| s.dof == place && s.is_way)
            .and_then(|s| s.values.iter().copied().find(|v| v.is_finite()))
            .unwrap_or(0.0);
    }
    at
}

/// Finds offset and drift; `drift` holds it.
///
/// # Errors
/// Why it cannot be done, in words.
pub fn align(problem: &Problem, drift: Option<f64>, search_s: f64) -> Result<Aligned, String> {
    if problem.dofs.is_empty() {
        return Err(
            "no degree of freedom is both commanded (with a load that changes) and measured"
                .to_owned(),
        );
    }
    let minima = coarse(problem, search_s);
    let Some(best) = minima.first().copied() else {
        return Err("the logs do not overlap by half at any offset".to_owned());
    };
    if best.1 > -0.1 * problem.series.len() as f64 {
        return Err("the motion does not answer to the commands at any offset".to_owned());
    }
    let mut own = problem.copy();
    let n = SHARED + own.dofs.len() * COEFFICIENTS;
    let mut held = vec![false; n];
    held[1] = drift.is_some();
    for (place, dof) in own.dofs.iter().enumerate() {
        let first = SHARED + place * COEFFICIENTS;
        // Where no way is measured its start means nothing; surge, sway and yaw have no springs.
        let has_way = own.series.iter().any(|s| s.dof == place && s.is_way);
        held[first + 5] = !has_way;
        held[first + 6] = !has_way || matches!(dof, 0 | 1 | 5);
    }
    let options = Options::default();
    let mut found: Vec<(f64, DVector<f64>)> = Vec::new();
    for (offset_s, _) in minima.iter().take(3) {
        // Weights of one size for all: what each series varies by.
        for s in &mut own.series {
            let values: Vec<f64> = s.values.iter().copied().filter(|v| v.is_finite()).collect();
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            let power = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
            s.sd = (power / values.len() as f64).sqrt().max(1e-9) * 0.1;
            s.rho = 0.0;
        }
        let mut fit = Fit {
            problem: &own,
            held: held.clone(),
        };
        let begin = start(&own, *offset_s, drift.unwrap_or(0.0));
        if let Ok(f) = minimise(&mut fit, begin, &options) {
            found.push((f.normal.cost, f.at));
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some((_, mut at)) = found.first().cloned() else {
        return Err("no fit of the motion to the commands ends".to_owned());
    };
    let mut normal = None;
    for _ in 0..ROUNDS {
        own.learn_noise(&at).ok_or("the fitted motion runs away")?;
        let mut fit = Fit {
            problem: &own,
            held: held.clone(),
        };
        let f = minimise(&mut fit, at.clone(), &options)?;
        at = f.at;
        normal = Some(f.normal);
    }
    let normal = normal.ok_or("no fit")?;
    let back = -own.middle_s * DRIFT_UNIT;
    let (variance, vd) = own.variances(&normal.hessian, &held);
    let mut warnings = Vec::new();
    if !(variance.is_finite() && variance > 0.0) {
        return Err("the commands do not change within the motion, so that no offset fits better than another".to_owned());
    }
    if let Some(second) = minima.iter().skip(1).find(|m| (m.0 - best.0).abs() > 2.0)
        && second.1 - best.1 < 0.05 * problem.series.len() as f64
    {
        warnings.push(format!(
            "an offset {:+.1} s from this one explains the motion nearly as well: are the commands periodic?",
            second.0 - best.0
        ));
    }
    Ok(Aligned {
        offset_s: at[0] + back * at[1],
        offset_sd_s: variance.sqrt(),
        drift: at[1] * DRIFT_UNIT,
        drift_sd: vd.max(0.0).sqrt() * DRIFT_UNIT,
        warnings,
        #[cfg(test)]
        at: (at, held),
    })
}
