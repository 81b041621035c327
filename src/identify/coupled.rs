//! Several DOFs at once: the full Eq. 1 with its cross terms, or the six equations side by side,
//! with whatever `[[physics]]` the rig has switched on, through the simulator's own model.

use std::f64::consts::FRAC_PI_2;

use hydroline_numerics::parallel;
use hydroline_rigs::{Rig, Vehicle};
use hydroline_sim::effect::{CheckedEffect, EffectError, check};
use hydroline_sim::model::{Model, ModelState};
use hydroline_sim::vehicle::{Hydrodynamics, VehicleState};
use hydroline_sim::{Dual, Real, Trajectory};
use nalgebra::{Cholesky, DMatrix};

use super::data::Start;
use super::forward::{ChannelSeries, Forward, ForwardError, Observed, ObservedRun};
use super::parameter::{Coefficient, Free, Term, free};
use hydroline_core::run::{Channel, PerChannel, Run, Sample, start_s};

/// RK4 step without effects \[s\]: the fastest motion of the vehicle (roll, 1.3 rad/s) keeps 1e-7.
const STEP_S: f64 = 0.04;
/// Step with effects on \[s\]: the shortest lag, 50 ms, keeps 1e-5.
const STEP_EFFECTS_S: f64 = 0.01;
/// Derivatives per pass.
const PASS: usize = 16;

#[derive(Debug)]
struct CoupledRun {
    raw: Vec<PerChannel<f64>>,
    /// Rows of L^-1 per sample where the covariance is known.
    whiten: Option<Vec<[[f64; 6]; 6]>>,
    commands: Vec<(f64, [f64; 6])>,
    start_s: f64,
    /// State at the start that each local is.
    places: Vec<Channel>,
}

/// The coupled model of several runs.
#[derive(Debug)]
pub struct Coupled {
    vehicle: Vehicle,
    effects: Vec<CheckedEffect>,
    free: Vec<Coefficient>,
    observed: Observed,
    runs: Vec<CoupledRun>,
    measured_channels: Vec<Channel>,
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
        let measured_channels: Vec<Channel> = Channel::ALL
            .into_iter()
            .filter(|c| runs.iter().any(|r| r.has(*c)))
            .collect();
        let names = |c: &Channel| match c.name() {
            name if with_covariance && !c.is_rate() => whitened_name(name),
            name => name.to_owned(),
        };
        let slots = measured_channels.iter().map(names).collect();
        let step_s = if effects.is_empty() {
            STEP_S
        } else {
            STEP_EFFECTS_S
        };
        let (built, observed) = runs
            .iter()
            .map(|r| CoupledRun::new(r, &measured_channels, start, with_covariance))
            .unzip();
        let globals = free_terms.iter().map(|c| free(*c, &rig.vehicle)).collect();
        Ok(Coupled {
            vehicle: rig.vehicle.clone(),
            effects,
            free: free_terms.to_vec(),
            observed: Observed {
                globals,
                slots,
                runs: observed,
            },
            runs: built,
            measured_channels,
            start_pose: rig.tank.start_pose,
            step_s,
        })
    }

    fn motion<T: Real>(
        &self,
        run: usize,
        parameters: &[T],
        mut emit: impl FnMut(PerChannel<T>),
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
            *start.vehicle.channel(*place) = *value;
        }
        let mut path = Trajectory::new(model, start, self.step_s).map_err(|e| failed(&e))?;
        for (t_s, wrench) in &r.commands {
            path.command(T::from_f64(*t_s), wrench.map(T::from_f64))
                .map_err(|e| failed(&e))?;
        }
        for t_s in self.times_s(run) {
            let seen_s = path
                .model()
                .effects
                .scene_time_s(T::from_f64(t_s - r.start_s), 0.0);
            let VehicleState { eta, nu } = path.state_at(seen_s).map_err(|e| failed(&e))?.vehicle;
            let effects = &path.model().effects;
            let pose = effects.reported_pose(seen_s, effects.scene_pose(seen_s, eta));
            emit(PerChannel::of_state(pose, nu));
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
        let mut jacobian = DMatrix::zeros(self.measured(run).len(), width);
        let mut out = Vec::with_capacity(self.measured(run).len());
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
    fn new(
        run: &Run,
        channels: &[Channel],
        start: Start,
        with_covariance: bool,
    ) -> (CoupledRun, ObservedRun) {
        let times_s: Vec<f64> = run.samples.iter().map(|s| s.t_s).collect();
        let start_s = start_s(&times_s);
        let whiten = with_covariance.then(|| {
            run.samples
                .iter()
                .map(|s| inverse_root(s.covariance.as_deref()))
                .collect()
        });
        let raw = run.samples.iter().map(|s| s.values).collect();
        let (mut locals, mut places) = (Vec::new(), Vec::new());
        let mut local = |place: Channel, start: f64, range: f64| {
            let name = format!("{}.{}.start", run.name, place.name());
            locals.push(Free {
                name,
                start,
                low: start - range,
                high: start + range,
            });
            places.push(place);
        };
        for [place, rate] in (0..6).map(Channel::of) {
            if let Some(first) = run.measured(place).next() {
                local(place, first, 1.0);
            } else if matches!(place, Channel::Phi | Channel::Theta) && run.has(rate) {
                // Only the rate was measured: the restoring moment needs the angle it starts from.
                local(place, 0.0, FRAC_PI_2);
            }
        }
        if start == Start::Free {
            for [place, rate] in (0..6).map(Channel::of) {
                if run.has(place) || run.has(rate) {
                    let mut rates = run.measured(rate);
                    let largest = rates.clone().fold(0.0_f64, |m, v| m.max(v.abs()));
                    local(rate, rates.next().unwrap_or(0.0), (3.0 * largest).max(2.0));
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
        let made = CoupledRun {
            raw,
            whiten,
            commands,
            start_s,
            places,
        };
        let slots = made.raw.iter().enumerate();
        let mut observed = ObservedRun {
            measured: slots
                .flat_map(|(k, state)| made.project(k, state, channels))
                .collect(),
            logged_sd: Vec::new(),
            times_s,
            locals,
        };
        if !with_covariance && run.samples.iter().any(|s| s.covariance.is_some()) {
            let sds = |s: &Sample| {
                channels
                    .iter()
                    .map(|c| s.sd(*c).unwrap_or(f64::NAN))
                    .collect::<Vec<_>>()
            };
            observed.logged_sd = run.samples.iter().flat_map(sds).collect();
        }
        (made, observed)
    }

    /// Physical channels of sample `k` to slots.
    fn project<T: Real>(&self, k: usize, state: &PerChannel<T>, channels: &[Channel]) -> Vec<T> {
        channels
            .iter()
            .map(|&c| match self.whiten.as_ref().and_then(|w| w.get(k)) {
                Some(rows) if !c.is_rate() => {
                    let row = state.iter().zip(&rows[c.index()]).take(c.index() + 1);
                    row.fold(T::zero(), |sum, (v, by)| sum + *v * *by)
                }
                _ => state[c],
            })
            .collect()
    }
}

/// Whether every sample has its whole pose with a covariance.
pub(super) fn every_pose_is_known(run: &Run) -> bool {
    let known =
        |s: &Sample| s.covariance.is_some() && s.values.pose().iter().all(|v| v.is_finite());
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
    fn observed(&self) -> &Observed {
        &self.observed
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
        let passes = parallel::map_slice(&firsts, |first| self.pass(run, parameters, *first));
        let mut jacobian = DMatrix::zeros(self.measured(run).len(), parameters.len());
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
                name: c.name().to_owned(),
                measured: r.raw.iter().map(|v| v[c]).collect(),
                predicted: Vec::new(),
            })
            .collect();
        self.motion(run, parameters, |state: PerChannel<f64>| {
            for (s, &c) in series.iter_mut().zip(&self.measured_channels) {
                s.predicted.push(state[c]);
            }
        })?;
        Ok(series)
    }
}
