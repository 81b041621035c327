//! One-DOF motion: (m - X_udot) u' = (X_u + X_u|u| |u|) u + X, x' = u (paper Eq. 7), in any DOF,
//! with the restoring moment r_Bz m g sin(phi) in roll and pitch (Eq. 1 with all else at rest), and net weight and
//! stiffness of a hull that floats.
//!
//! RK4 over steps that never span a command edge or a stamp. The same function runs on plain
//! numbers (search) and on duals (exact sensitivities).

use std::f64::consts::FRAC_PI_2;

use hydroline_rigs::{Dof, Vehicle};
use hydroline_sim::{Dual, Real};
use nalgebra::DMatrix;

use super::forward::{Forward, ForwardError, Free, Observed, ObservedRun};
use hydroline_core::run::Channel::{Psi, X, Y};
use hydroline_core::run::{Channel, PerChannel, Run, start_s};
use hydroline_identify::parameter::{Coefficient, Term};

/// Prior knowledge of every run's start; by default none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Start {
    /// Nothing: place and velocity are free in each run.
    #[default]
    Free,
    /// At rest: the velocity is 0, the place is free.
    AtRest,
    /// At rest, and positions count from the first frame as the paper's x_i = (X_S,i − X_S,1) cos ψ_S do: place and velocity are 0.
    AtRestFromZero,
}

/// Search range about what the rig says: damping -10 to +1, added mass -5 to 0 times its size.
///
/// Damping may turn out positive: no hull has it, but a fit that is stopped at 0 hides that its model lacks something.
fn free(coefficient: Coefficient, vehicle: &Vehicle) -> Free {
    let start = coefficient.of_vehicle(vehicle);
    let rigid = match coefficient.dof.index() {
        0..3 => vehicle.mass_kg,
        i => vehicle.inertia_kgm2[i - 3],
    };
    let (low, high) = match coefficient.term {
        // Hulls of several times their mass are in it.
        Term::Added => (-5.0 * start.abs().max(rigid), 0.0),
        Term::Linear | Term::Quadratic => (-10.0 * start.abs(), start.abs()),
    };
    Free {
        name: coefficient.key().to_owned(),
        start,
        low,
        high,
    }
}

/// Longest RK4 step \[s\]: with time constants of seconds its error is below 1e-7 of the motion.
const STEP_MAX_S: f64 = 0.04;

/// The three coefficients, mass and restoring moment of one DOF.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisModel<T = f64> {
    /// Rigid plus added mass \[kg, kg m2\].
    pub mass: T,
    /// Linear damping, negative.
    pub linear: T,
    /// Quadratic damping, negative.
    pub quadratic: T,
    /// Restoring moment per unit sine \[N m\], negative = stable; 0 in the other DOFs.
    pub restoring_nm: f64,
    /// Net weight and stiffness of the water; `None` = neither.
    pub statics: Option<AxisStatics>,
}

/// Net weight and hydrostatic stiffness along one DOF, as the rig says them: they are not fitted here.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisStatics {
    /// Weight minus buoyancy \[N\], in heave.
    pub net_weight_n: f64,
    /// Stiffness \[N/m, N m/rad\]; positive restores.
    pub stiffness: f64,
    /// Position at which the stiffness makes no force \[m, rad\].
    pub rest: f64,
}

impl AxisStatics {
    fn of(vehicle: &Vehicle, dof: Dof) -> Option<AxisStatics> {
        let (net_weight_n, float_z_m) = match dof {
            Dof::Heave => (vehicle.net_weight_n, vehicle.float_z_m.unwrap_or(0.0)),
            Dof::Roll | Dof::Pitch => (0.0, 0.0),
            Dof::Surge | Dof::Sway | Dof::Yaw => return None,
        };
        let stiffness = vehicle.stiffness[dof.index() - Dof::Heave.index()];
        let rest = if stiffness != 0.0 { float_z_m } else { 0.0 };
        (net_weight_n != 0.0 || stiffness != 0.0).then_some(AxisStatics {
            net_weight_n,
            stiffness,
            rest,
        })
    }
}

impl<T: Real> AxisModel<T> {
    fn acceleration(&self, inverse_mass: T, position: T, rate: T, load: f64) -> T {
        let mut force = (self.linear + self.quadratic * rate.abs()) * rate + T::from_f64(load);
        if self.restoring_nm != 0.0 {
            force = force + position.sin() * self.restoring_nm;
        }
        if let Some(statics) = &self.statics {
            let away = position - T::from_f64(statics.rest);
            force = force + T::from_f64(statics.net_weight_n) - away * statics.stiffness;
        }
        force * inverse_mass
    }

    /// One RK4 step under a constant load.
    pub fn step(&self, step_s: f64, (position, rate): (T, T), load: f64) -> (T, T) {
        let inverse = T::one() / self.mass;
        let half = 0.5 * step_s;
        let a1 = self.acceleration(inverse, position, rate, load);
        let (p2, v2) = (position + rate * half, rate + a1 * half);
        let a2 = self.acceleration(inverse, p2, v2, load);
        let (p3, v3) = (position + v2 * half, rate + a2 * half);
        let a3 = self.acceleration(inverse, p3, v3, load);
        let (p4, v4) = (position + v3 * step_s, rate + a3 * step_s);
        let a4 = self.acceleration(inverse, p4, v4, load);
        let sixth = step_s / 6.0;
        (
            position + (rate + (v2 + v3) * 2.0 + v4) * sixth,
            rate + (a1 + (a2 + a3) * 2.0 + a4) * sixth,
        )
    }
}

#[derive(Debug, Clone, Copy)]
struct Steps {
    /// Length of each \[s\].
    step_s: f64,
    /// Number of equal steps: the way from one node to the next costs no memory, however long it is.
    count: usize,
    load: f64,
    /// A stamp lies at the end of the last one.
    sample: bool,
}

#[derive(Debug)]
struct AxisRun {
    /// Stamps that coincide with the start.
    at_start: bool,
    steps: Vec<Steps>,
    /// Whether the place at the start is one of the locals.
    place_is_free: bool,
    start: Start,
}

/// A one-DOF model of several runs.
#[derive(Debug)]
pub struct Axis {
    dof: Dof,
    rigid: f64,
    fixed: [f64; 3],
    terms: Vec<Coefficient>,
    restoring_nm: f64,
    statics: Option<AxisStatics>,
    observed: Observed,
    runs: Vec<AxisRun>,
    with_rate: bool,
}

impl Axis {
    /// Takes the runs that measured this DOF.
    ///
    /// In surge and sway the motion is measured along the body axis at the run's median heading
    /// (the paper's path at psi_S); where only one of x, y is measured, along that axis.
    pub fn new(
        runs: &[Run],
        vehicle: &Vehicle,
        dof: Dof,
        free_terms: &[Coefficient],
        start: Start,
    ) -> Axis {
        let i = dof.index();
        let rigid = if i < 3 {
            vehicle.mass_kg
        } else {
            vehicle.inertia_kgm2[i - 3]
        };
        let restores = matches!(dof, Dof::Roll | Dof::Pitch);
        let restoring_nm = if restores {
            vehicle.r_bz_m * vehicle.mass_kg * vehicle.gravity_mps2
        } else {
            0.0
        };
        let statics = AxisStatics::of(vehicle, dof);
        // Where it swings about, if anything brings it back.
        let stiff = statics.filter(|s| s.stiffness != 0.0);
        let rest = match (stiff, restores) {
            (Some(statics), _) => Some(statics.rest),
            (None, restores) => restores.then_some(0.0),
        };
        let [place, rate] = Channel::of(i);
        let with_rate = runs.iter().any(|r| r.has(rate));
        let mut slots = vec![place.name().to_owned()];
        if with_rate {
            slots.push(rate.name().to_owned());
        }
        let (runs, observed) = runs
            .iter()
            .map(|r| AxisRun::new(r, i, with_rate, start, rest))
            .unzip();
        let fixed = Coefficient::of(dof).map(|c| c.of_vehicle(vehicle));
        let terms: Vec<Coefficient> = free_terms
            .iter()
            .copied()
            .filter(|c| c.dof == dof)
            .collect();
        let globals = terms.iter().map(|c| free(*c, vehicle)).collect();
        Axis {
            dof,
            rigid,
            fixed,
            terms,
            restoring_nm,
            statics,
            observed: Observed {
                globals,
                slots,
                runs: observed,
            },
            runs,
            with_rate,
        }
    }

    /// The degree of freedom.
    pub fn dof(&self) -> Dof {
        self.dof
    }

    /// Replaces the search ranges, e.g. by the paper's Table 9.
    pub fn set_ranges(&mut self, ranges: &[(f64, f64)]) {
        for (free, (low, high)) in self.observed.globals.iter_mut().zip(ranges) {
            (free.low, free.high) = (*low, *high);
            free.start = free.start.clamp(*low, *high);
        }
    }

    fn model<T: Real>(&self, globals: &[T]) -> AxisModel<T> {
        let mut numbers = self.fixed.map(T::from_f64);
        for (c, value) in self.terms.iter().zip(globals) {
            numbers[c.term as usize] = *value;
        }
        let [added, linear, quadratic] = numbers;
        AxisModel {
            mass: T::from_f64(self.rigid) - added,
            linear,
            quadratic,
            restoring_nm: self.restoring_nm,
            statics: self.statics,
        }
    }

    fn run<T: Real>(&self, run: usize, parameters: &[T], mut emit: impl FnMut(T, T)) {
        let run = &self.runs[run];
        let (globals, locals) = parameters.split_at(self.globals().len().min(parameters.len()));
        let model = self.model(globals);
        let mut local = locals.iter().copied();
        let mut next = || local.next().unwrap_or_else(T::zero);
        let position = if run.place_is_free {
            next()
        } else {
            T::from_f64(self.statics.map_or(0.0, |s| s.rest))
        };
        let rate = match run.start {
            Start::Free => next(),
            _ => T::zero(),
        };
        let offset = next();
        let mut state = (position, rate);
        if run.at_start {
            emit(state.0 + offset, state.1);
        }
        for steps in &run.steps {
            for _ in 0..steps.count {
                state = model.step(steps.step_s, state, steps.load);
            }
            if steps.sample {
                emit(state.0 + offset, state.1);
            }
        }
    }

    fn finite(&self, run: usize, out: &[f64]) -> Result<(), ForwardError> {
        if out.iter().all(|v| v.is_finite()) {
            return Ok(());
        }
        let reason = "the motion grows without bounds: damping or restoring has the wrong sign";
        Err(ForwardError {
            run,
            reason: reason.to_owned(),
        })
    }

    fn dual<const N: usize>(
        &self,
        run: usize,
        parameters: &[f64],
        out: &mut Vec<f64>,
    ) -> DMatrix<f64> {
        let p = parameters.len();
        let rows = self.measured(run).len();
        let mut jacobian = DMatrix::zeros(rows, p);
        // Passes of N directions: any number of parameters, no heap in the inner loop.
        for first in (0..p.max(1)).step_by(N) {
            out.clear();
            let duals = Dual::<N>::pass(parameters, first);
            let mut row = 0;
            self.run(run, &duals, |position, rate| {
                for value in [Some(position), self.with_rate.then_some(rate)]
                    .into_iter()
                    .flatten()
                {
                    out.push(value.value);
                    for (i, slope) in value.slope.iter().enumerate().take(p.saturating_sub(first)) {
                        jacobian[(row, first + i)] = *slope;
                    }
                    row += 1;
                }
            });
        }
        jacobian
    }
}

impl AxisRun {
    fn new(
        run: &Run,
        i: usize,
        with_rate: bool,
        start: Start,
        rest: Option<f64>,
    ) -> (AxisRun, ObservedRun) {
        let restores = rest.is_some();
        // Path at the median heading; x and y turn into the body axis.
        let [place, rate] = Channel::of(i);
        let psi = run.median(Psi).unwrap_or(0.0);
        let both = run.has(X) && run.has(Y);
        let along = |v: &PerChannel<f64>| match place {
            X if both => v[X] * psi.cos() + v[Y] * psi.sin(),
            Y if both => v[Y] * psi.cos() - v[X] * psi.sin(),
            _ => v[place],
        };
        let mut measured = Vec::new();
        let mut times_s = Vec::new();
        for sample in &run.samples {
            let position = along(&sample.values);
            if position.is_finite() || (with_rate && sample.values[rate].is_finite()) {
                times_s.push(sample.t_s);
                measured.push(position);
                if with_rate {
                    measured.push(sample.values[rate]);
                }
            }
        }
        let start_s = start_s(&times_s);
        let steps = plan_steps(run, i, start_s, &times_s);
        let stride = 1 + usize::from(with_rate);
        let first = |slot: usize| {
            measured
                .iter()
                .skip(slot)
                .step_by(stride)
                .copied()
                .find(|v| v.is_finite())
        };
        let placed = first(0).is_some();
        let seen = first(0).or(rest).unwrap_or(0.0);
        // The start's velocity may be anything that positions or measured rates show.
        let first_rate = if with_rate { first(1) } else { None };
        let measured_rate = if with_rate {
            let rates = measured.iter().skip(1).step_by(stride);
            rates.fold(0.0_f64, |m, v| m.max(v.abs()))
        } else {
            0.0
        };
        let largest_rate = largest_rate(&times_s, &measured, stride).max(measured_rate);
        let any = |name: &str, start: f64, range: f64| Free {
            name: format!("{}.{name}", run.name),
            start,
            low: start - range,
            high: start + range,
        };
        let spread = measured
            .iter()
            .step_by(stride)
            .fold(0.1_f64, |m, v| m.max((v - seen).abs()));
        let mut locals = Vec::new();
        // Where only the rate was measured the place acts through the restoring moment or not at all.
        let place_is_free = start != Start::AtRestFromZero && (placed || restores);
        if place_is_free {
            let range = if placed { 2.0 * spread } else { FRAC_PI_2 };
            locals.push(any(&format!("{}.start", place.name()), seen, range));
        }
        if start == Start::Free {
            locals.push(any(
                &format!("{}.start", rate.name()),
                first_rate.unwrap_or(0.0),
                3.0 * largest_rate + 0.05,
            ));
        }
        if restores && placed {
            locals.push(any(&format!("{}.offset", place.name()), 0.0, spread));
        }
        let at_start = times_s.first() == Some(&start_s);
        let made = AxisRun {
            at_start,
            steps,
            place_is_free,
            start,
        };
        let observed = ObservedRun {
            times_s,
            measured,
            locals,
        };
        (made, observed)
    }
}

/// Largest plausible rate from positions a tenth of a second and more apart.
fn largest_rate(times_s: &[f64], measured: &[f64], stride: usize) -> f64 {
    let mut largest = 0.0_f64;
    let mut last: Option<(f64, f64)> = None;
    for (t, v) in times_s.iter().zip(measured.iter().step_by(stride)) {
        match last {
            Some((t0, v0)) if t - t0 > 0.1 => {
                largest = largest.max(((v - v0) / (t - t0)).abs());
                last = Some((*t, *v));
            }
            None if v.is_finite() => last = Some((*t, *v)),
            _ => {}
        }
    }
    if largest.is_finite() { largest } else { 1.0 }
}

fn plan_steps(run: &Run, i: usize, start_s: f64, times_s: &[f64]) -> Vec<Steps> {
    let end_s = times_s.last().copied().unwrap_or(start_s);
    let mut nodes: Vec<f64> = times_s.iter().copied().filter(|t| *t > start_s).collect();
    let mut last = run.wrench_at(start_s)[i];
    for c in run
        .commands
        .iter()
        .filter(|c| c.t_s > start_s && c.t_s < end_s)
    {
        // Only edges of this DOF cost a node.
        if c.wrench[i] != last {
            nodes.push(c.t_s);
            last = c.wrench[i];
        }
    }
    nodes.sort_by(f64::total_cmp);
    nodes.dedup();
    let mut steps = Vec::new();
    let mut from = start_s;
    let mut samples = times_s.iter().filter(|t| **t > start_s).peekable();
    for node in nodes {
        let load = run.wrench_at(from)[i];
        let count = ((node - from) / STEP_MAX_S - 1e-9).ceil().max(1.0);
        steps.push(Steps {
            step_s: (node - from) / count,
            count: count as usize,
            load,
            sample: samples.next_if(|t| **t == node).is_some(),
        });
        from = node;
    }
    steps
}

impl Forward for Axis {
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
        self.run(run, parameters, |position, rate| {
            out.push(position);
            if self.with_rate {
                out.push(rate);
            }
        });
        self.finite(run, out)
    }

    fn sensitivities(
        &self,
        run: usize,
        parameters: &[f64],
        out: &mut Vec<f64>,
    ) -> Result<DMatrix<f64>, ForwardError> {
        let jacobian = match parameters.len() {
            0..=3 => self.dual::<3>(run, parameters, out),
            4..=5 => self.dual::<5>(run, parameters, out),
            _ => self.dual::<8>(run, parameters, out),
        };
        self.finite(run, out)?;
        Ok(jacobian)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_core::run::{Command, Sample};
    use hydroline_rigs::{Rig, VehicleModel};
    use hydroline_sim::model::{Model, ModelState};
    use hydroline_sim::{EffectStack, Trajectory};

    fn run(dof: usize) -> Run {
        let wrench = |v: f64| std::array::from_fn(|i| if i == dof { v } else { 0.0 });
        let size = if dof < 3 { 8.0 } else { 0.5 };
        let sample = |k: usize| Sample {
            t_s: 0.006 + 0.04 * k as f64,
            values: PerChannel::splat(0.0),
            covariance: None,
        };
        Run {
            name: "r".into(),
            commands: vec![
                Command {
                    t_s: 0.0,
                    wrench: wrench(size),
                },
                Command {
                    t_s: 3.017,
                    wrench: wrench(-size),
                },
                Command {
                    t_s: 7.0,
                    wrench: wrench(0.0),
                },
            ],
            samples: (0..250).map(sample).collect(),
            ..Run::default()
        }
    }

    /// Largest distances of place and rate between one axis and the simulator on its fine grid, from rest at 0.
    fn worst(vehicle: &Vehicle, dof: Dof) -> (f64, f64) {
        let i = dof.index();
        let run = run(i);
        let axis = Axis::new(
            std::slice::from_ref(&run),
            vehicle,
            dof,
            &Coefficient::of(dof),
            Start::AtRest,
        );
        let truth = Coefficient::of(dof).map(|c| c.of_vehicle(vehicle));
        let mut parameters = truth.to_vec();
        parameters.push(0.0);
        let mut out = Vec::new();
        axis.values(0, &parameters, &mut out).unwrap();
        let model = Model {
            hydrodynamics: hydroline_sim::vehicle::Hydrodynamics::new(vehicle),
            effects: EffectStack::empty(),
        };
        let mut path = Trajectory::new(model, ModelState::at_rest([0.0; 6]), 0.001).unwrap();
        for c in &run.commands {
            path.command(c.t_s, c.wrench).unwrap();
        }
        let mut worst = (0.0_f64, 0.0_f64);
        for (sample, pair) in run.samples.iter().zip(out.chunks(2)) {
            let state = path.state_at(sample.t_s).unwrap().vehicle;
            worst = (
                worst.0.max((state.eta[i] - pair[0]).abs()),
                worst.1.max((state.nu[i] - pair[1]).abs()),
            );
        }
        worst
    }

    /// Eq. 7 and its likes are the simulator's decoupled model, on the simulator's fine grid.
    #[test]
    fn every_axis_moves_as_the_simulator_does() {
        let mut vehicle = Rig::builtin("lshpi").unwrap().vehicle;
        vehicle.model = VehicleModel::Decoupled;
        for dof in Dof::ALL {
            let worst = worst(&vehicle, dof);
            // |u| u has a kink where the motion turns: one step there is of second order only.
            // Still a thousandth of the noise of a pose (0.15 mm, 0.01 deg).
            assert!(
                worst.0 < 1.5e-7 && worst.1 < 1e-6,
                "{}: {worst:?}",
                dof.name()
            );
        }
    }

    #[test]
    fn what_floats_or_weighs_moves_as_the_simulator_does() {
        let mut vehicle = Rig::builtin("lshpi").unwrap().vehicle;
        vehicle.model = VehicleModel::Decoupled;
        vehicle.net_weight_n = 3.0;
        for stiffness in [[0.0; 3], [200.0, 4.0, 6.0]] {
            vehicle.stiffness = stiffness;
            vehicle.float_z_m = Some(0.02);
            for dof in Dof::ALL {
                let worst = worst(&vehicle, dof);
                let name = dof.name();
                assert!(worst.0 < 1e-6 && worst.1 < 1e-5, "{name}: {worst:?}");
            }
        }
    }

    #[test]
    fn sensitivities_are_those_of_central_differences() {
        let vehicle = Rig::builtin("lshpi").unwrap().vehicle;
        let run = run(3);
        let axis = Axis::new(
            &[run],
            &vehicle,
            Dof::Roll,
            &Coefficient::of(Dof::Roll),
            Start::Free,
        );
        let at = [-4.2, -1.4, -5.5, 0.1, -0.05, 0.02];
        let mut out = Vec::new();
        let jacobian = axis.sensitivities(0, &at, &mut out).unwrap();
        for p in 0..at.len() {
            let moved = |by: f64| {
                let mut there = at;
                there[p] += by;
                let mut out = Vec::new();
                axis.values(0, &there, &mut out).unwrap();
                out
            };
            for (row, (up, down)) in moved(1e-5).iter().zip(moved(-1e-5)).enumerate() {
                assert!(
                    (jacobian[(row, p)] - (up - down) / 2e-5).abs() < 1e-6,
                    "row {row} parameter {p}"
                );
            }
        }
    }
}
