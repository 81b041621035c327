//! Several DOFs at once: the full Eq. 1 with its cross terms, or the six equations side by side,
//! with whatever `[[physics]]` the rig has switched on, through the simulator's own model.

use std::f64::consts::FRAC_PI_2;

use hydroline_rigs::{Rig, Vehicle};
use hydroline_sim::effect::{CheckedEffect, EffectError, check};
use hydroline_sim::model::{Model, ModelState};
use hydroline_sim::vehicle::{Hydrodynamics, VehicleState};
use hydroline_sim::{Dual, Real, Trajectory};
use nalgebra::{Cholesky, DMatrix};
use rayon::prelude::*;

use super::data::{CHANNELS, Run, Sample, Start};
use super::forward::{ChannelSeries, Forward, ForwardError};
use super::parameter::{Coefficient, Free, Term, free};

/// RK4 step without effects \[s\]: the fastest motion of the vehicle (roll, 1.3 rad/s) keeps 1e-7.
const STEP_S: f64 = 0.04;
/// Step with effects on \[s\]: the shortest lag, 50 ms, keeps 1e-5.
const STEP_EFFECTS_S: f64 = 0.01;
/// Derivatives per pass.
const PASS: usize = 16;
/// As in the one-DOF model.
const START_SLACK_S: f64 = 1.0;

#[derive(Debug)]
struct CoupledRun {
    times_s: Vec<f64>,
    /// Physical channels, 12 per sample.
    raw: Vec<f64>,
    /// Slots.
    measured: Vec<f64>,
    /// sd of each slot as logged, where the slots are not whitened by it already; empty = none is.
    logged_sd: Vec<f64>,
    /// Rows of L^-1 per sample where the covariance is known.
    whiten: Option<Vec<[[f64; 6]; 6]>>,
    commands: Vec<(f64, [f64; 6])>,
    start_s: f64,
    locals: Vec<Free>,
    /// Which of eta (0..6) and nu (6..12) each local is.
    places: Vec<usize>,
}

/// The coupled model of several runs.
#[derive(Debug)]
pub struct Coupled {
    vehicle: Vehicle,
    effects: Vec<CheckedEffect>,
    free: Vec<Coefficient>,
    globals: Vec<Free>,
    runs: Vec<CoupledRun>,
    slots: Vec<String>,
    measured_channels: Vec<usize>,
    start_pose: [f64; 6],
    step_s: f64,
}

impl Coupled {
    /// Builds the model of a rig for these runs; `with_covariance`: poses as the combinations that their
    /// covariance leaves uncorrelated, in units of it (needs [`every_pose_is_known`]).
    ///
    /// # Errors
    /// [`EffectError`] for a bad `[[physics]]` entry.
    pub fn new(
        runs: &[Run],
        rig: &Rig,
        free_terms: &[Coefficient],
        start: Start,
        with_covariance: bool,
    ) -> Result<Coupled, EffectError> {
        let effects = check(&rig.physics)?;
        let measured_channels: Vec<usize> = (0..12)
            .filter(|c| runs.iter().any(|r| r.count(*c) > 0))
            .collect();
        let names = |c: &usize| match CHANNELS[*c] {
            name if with_covariance && *c < 6 => whitened_name(name),
            name => name.to_owned(),
        };
        let slots = measured_channels.iter().map(names).collect();
        let step_s = if effects.is_empty() {
            STEP_S
        } else {
            STEP_EFFECTS_S
        };
        let built = runs
            .iter()
            .map(|r| CoupledRun::new(r, &measured_channels, start, with_covariance))
            .collect();
        let globals = free_terms.iter().map(|c| free(*c, &rig.vehicle)).collect();
        Ok(Coupled {
            vehicle: rig.vehicle.clone(),
            effects,
            free: free_terms.to_vec(),
            globals,
            runs: built,
            slots,
            measured_channels,
            start_pose: rig.tank.start_pose,
            step_s,
        })
    }

    fn motion<T: Real>(
        &self,
        run: usize,
        parameters: &[T],
        mut emit: impl FnMut([T; 12]),
    ) -> Result<(), ForwardError> {
        let failed = |e: &dyn std::fmt::Display| ForwardError {
            run,
            reason: e.to_string(),
        };
        let r = &self.runs[run];
        let mut hydrodynamics: Hydrodynamics<T> = Hydrodynamics::new(&self.vehicle);
        for (c, value) in self.free.iter().zip(parameters) {
            let place = match c.term {
                Term::Added => &mut hydrodynamics.added,
                Term::Linear => &mut hydrodynamics.linear,
                Term::Quadratic => &mut hydrodynamics.quadratic,
            };
            place[c.dof.index()] = *value;
        }
        let model = Model::assemble(hydrodynamics, &self.effects, |_, _, v| T::from_f64(v))
            .map_err(|e| failed(&e))?;
        let mut start = ModelState::at_rest(self.start_pose.map(T::from_f64));
        let locals = parameters.get(self.free.len()..).unwrap_or(&[]);
        for (place, value) in r.places.iter().zip(locals) {
            if *place < 6 {
                start.vehicle.eta[*place] = *value;
            } else {
                start.vehicle.nu[*place - 6] = *value;
            }
        }
        let mut path = Trajectory::new(model, start, self.step_s).map_err(|e| failed(&e))?;
        for (t_s, wrench) in &r.commands {
            path.command(T::from_f64(*t_s), wrench.map(T::from_f64))
                .map_err(|e| failed(&e))?;
        }
        for t_s in &r.times_s {
            let seen_s = path
                .model()
                .effects
                .scene_time_s(T::from_f64(t_s - r.start_s), 0.0);
            let VehicleState { eta, nu } = path.state_at(seen_s).map_err(|e| failed(&e))?.vehicle;
            let effects = &path.model().effects;
            let pose = effects.reported_pose(seen_s, effects.scene_pose(seen_s, eta));
            emit(std::array::from_fn(
                |c| if c < 6 { pose[c] } else { nu[c - 6] },
            ));
        }
        Ok(())
    }

    fn pass(
        &self,
        run: usize,
        parameters: &[f64],
        first: usize,
    ) -> Result<(Vec<f64>, DMatrix<f64>), ForwardError> {
        let r = &self.runs[run];
        let width = PASS.min(parameters.len() - first);
        let mut jacobian = DMatrix::zeros(r.measured.len(), width);
        let mut out = Vec::with_capacity(r.measured.len());
        let duals = Dual::<PASS>::pass(parameters, first);
        let mut sample = 0;
        self.motion(run, &duals, |state| {
            for slot in r.project(sample, &state, &self.measured_channels) {
                for (i, slope) in slot.slope.iter().take(width).enumerate() {
                    jacobian[(out.len(), i)] = *slope;
                }
                out.push(slot.value);
            }
            sample += 1;
        })?;
        Ok((out, jacobian))
    }
}

impl CoupledRun {
    fn new(run: &Run, channels: &[usize], start: Start, with_covariance: bool) -> CoupledRun {
        let times_s: Vec<f64> = run.samples.iter().map(|s| s.t_s).collect();
        let first_s = times_s.first().copied().unwrap_or(0.0);
        let start_s = if first_s > START_SLACK_S {
            first_s
        } else {
            0.0
        };
        let whiten = with_covariance.then(|| {
            run.samples
                .iter()
                .map(|s| inverse_root(s.covariance.as_deref()))
                .collect()
        });
        let raw: Vec<f64> = run.samples.iter().flat_map(|s| s.values).collect();
        let (mut locals, mut places) = (Vec::new(), Vec::new());
        let mut local = |place: usize, start: f64, range: f64| {
            let name = format!("{}.{}.start", run.name, CHANNELS[place]);
            locals.push(Free {
                name,
                start,
                low: start - range,
                high: start + range,
            });
            places.push(place);
        };
        for c in 0..6 {
            if let Some(first) = run
                .samples
                .iter()
                .map(|s| s.values[c])
                .find(|v| v.is_finite())
            {
                local(c, first, 1.0);
            } else if matches!(c, 3 | 4) && run.count(6 + c) > 0 {
                // Only the rate was measured: the restoring moment needs the angle it starts from.
                local(c, 0.0, FRAC_PI_2);
            }
        }
        if start == Start::Free {
            for c in 0..6 {
                if run.count(c) > 0 || run.count(6 + c) > 0 {
                    let rates = run.samples.iter().map(|s| s.values[6 + c]);
                    let largest = rates.clone().fold(0.0_f64, |m, v| m.max(v.abs()));
                    let first = rates.clone().find(|v| v.is_finite());
                    local(6 + c, first.unwrap_or(0.0), (3.0 * largest).max(2.0));
                }
            }
        }
        let mut commands: Vec<(f64, [f64; 6])> = run
            .commands
            .iter()
            .filter(|c| c.t_s > start_s)
            .map(|c| (c.t_s - start_s, c.wrench))
            .collect();
        commands.insert(0, (0.0, run.wrench_at(start_s)));
        let mut made = CoupledRun {
            times_s,
            raw,
            measured: Vec::new(),
            logged_sd: Vec::new(),
            whiten,
            commands,
            start_s,
            locals,
            places,
        };
        for k in 0..made.times_s.len() {
            let state: [f64; 12] = std::array::from_fn(|c| made.raw[12 * k + c]);
            let slots = made.project(k, &state, channels);
            made.measured.extend(slots);
        }
        if !with_covariance && run.samples.iter().any(|s| s.covariance.is_some()) {
            let sd = |sample: &Sample, c: usize| {
                let own = sample.covariance.as_deref().filter(|_| c < 6);
                own.map(|p| p[7 * c])
                    .filter(|v| *v > 0.0)
                    .map_or(f64::NAN, f64::sqrt)
            };
            made.logged_sd = run
                .samples
                .iter()
                .flat_map(|s| channels.iter().map(move |c| sd(s, *c)))
                .collect();
        }
        made
    }

    /// Physical channels of sample `k` to slots.
    fn project<T: Real>(&self, k: usize, state: &[T; 12], channels: &[usize]) -> Vec<T> {
        channels
            .iter()
            .map(|&c| match self.whiten.as_ref().and_then(|w| w.get(k)) {
                Some(rows) if c < 6 => {
                    (0..=c).fold(T::zero(), |sum, j| sum + state[j] * rows[c][j])
                }
                _ => state[c],
            })
            .collect()
    }
}

/// Whether every sample has its whole pose with a covariance.
pub(super) fn every_pose_is_known(run: &Run) -> bool {
    let known = |s: &Sample| s.covariance.is_some() && s.values[..6].iter().all(|v| v.is_finite());
    run.samples.iter().all(known)
}

/// Name of the slot that is the combination of the pose up to this channel which is uncorrelated with those before it.
pub(super) fn whitened_name(channel: &str) -> String {
    format!("whitened {channel}")
}

/// L^-1 of a covariance L L^T (rows); a matrix that is none gives its diagonal's.
pub(super) fn inverse_root(covariance: Option<&[f64; 36]>) -> [[f64; 6]; 6] {
    let full = covariance
        .map(|c| DMatrix::from_row_slice(6, 6, c))
        .unwrap_or_else(|| DMatrix::identity(6, 6));
    let root = Cholesky::new(full.clone())
        .map(|c| c.l())
        .and_then(|l| l.try_inverse());
    let rows = root.unwrap_or_else(|| {
        DMatrix::from_diagonal(&full.diagonal().map(|v| 1.0 / v.abs().sqrt().max(1e-9)))
    });
    std::array::from_fn(|i| std::array::from_fn(|j| rows[(i, j)]))
}

impl Forward for Coupled {
    fn globals(&self) -> &[Free] {
        &self.globals
    }
    fn runs(&self) -> usize {
        self.runs.len()
    }
    fn locals(&self, run: usize) -> &[Free] {
        &self.runs[run].locals
    }
    fn slots(&self) -> &[String] {
        &self.slots
    }
    fn times_s(&self, run: usize) -> &[f64] {
        &self.runs[run].times_s
    }
    fn measured(&self, run: usize) -> &[f64] {
        &self.runs[run].measured
    }
    fn logged_sd(&self, run: usize) -> &[f64] {
        &self.runs[run].logged_sd
    }

    fn values(
        &self,
        run: usize,
        parameters: &[f64],
        out: &mut Vec<f64>,
    ) -> Result<(), ForwardError> {
        out.clear();
        let r = &self.runs[run];
        let mut sample = 0;
        self.motion(run, parameters, |state| {
            out.extend(r.project(sample, &state, &self.measured_channels));
            sample += 1;
        })
    }

    fn sensitivities(
        &self,
        run: usize,
        parameters: &[f64],
        out: &mut Vec<f64>,
    ) -> Result<DMatrix<f64>, ForwardError> {
        let firsts: Vec<usize> = (0..parameters.len().max(1)).step_by(PASS).collect();
        let passes: Vec<_> = firsts
            .par_iter()
            .map(|first| self.pass(run, parameters, *first))
            .collect();
        let mut jacobian = DMatrix::zeros(self.runs[run].measured.len(), parameters.len());
        for (first, pass) in firsts.into_iter().zip(passes) {
            let (values, block) = pass?;
            jacobian.columns_mut(first, block.ncols()).copy_from(&block);
            *out = values;
        }
        Ok(jacobian)
    }

    fn channels(&self, run: usize, parameters: &[f64]) -> Result<Vec<ChannelSeries>, ForwardError> {
        let r = &self.runs[run];
        let mut series: Vec<ChannelSeries> = self
            .measured_channels
            .iter()
            .map(|&c| ChannelSeries {
                name: CHANNELS[c].to_owned(),
                measured: r.raw.iter().skip(c).step_by(12).copied().collect(),
                predicted: Vec::new(),
            })
            .collect();
        self.motion(run, parameters, |state: [f64; 12]| {
            for (s, &c) in series.iter_mut().zip(&self.measured_channels) {
                s.predicted.push(state[c]);
            }
        })?;
        Ok(series)
    }
}
