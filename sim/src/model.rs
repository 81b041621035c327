//! Vehicle and effects together: the right-hand side of the equations of motion.
//!
//! Order per evaluation: thruster stage on the commanded wrench, velocity through the
//! water, added mass, damping, restoring, Coriolis (coupled model only), added forces,
//! acceleration, then the effects' own states (which may use the acceleration).

use crate::effect::{CheckedEffect, EffectError, EffectStack, Moment};
use crate::given::Given;
use crate::real::Real;
use crate::vehicle::kinematics::Attitude;
use crate::vehicle::{Hydrodynamics, VehicleState, equations};
use hydroline_rigs::{Rig, VehicleModel};

/// Number of own states that all effects of a stack may have together.
pub const OWN_STATES_MAX: usize = 12;

/// Vehicle state plus the effects' own states (thruster lag, energy drawn, ...).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModelState<T = f64> {
    /// Pose and rates.
    pub vehicle: VehicleState<T>,
    /// Own states of the effects, in stack order; unused ones stay 0.
    pub own: [T; OWN_STATES_MAX],
}

impl<T: Real> ModelState<T> {
    /// At rest, every own state 0 ("integrals start at 0 with the log").
    pub fn at_rest(eta: [T; 6]) -> Self {
        ModelState {
            vehicle: VehicleState::at_rest(eta),
            own: [T::zero(); OWN_STATES_MAX],
        }
    }

    /// Adds `rate * step_s`; of the own states the first `own` move.
    pub(crate) fn add(&mut self, rate: &ModelState<T>, step_s: T, own: usize) {
        let add = |to: &mut [T], rate: &[T]| {
            for (value, rate) in to.iter_mut().zip(rate) {
                *value = *value + *rate * step_s;
            }
        };
        add(&mut self.vehicle.eta, &rate.vehicle.eta);
        add(&mut self.vehicle.nu, &rate.vehicle.nu);
        add(&mut self.own[..own], &rate.own[..own]);
    }

    /// Becomes `from + rate * step_s`; of the own states the first `own` are looked at.
    fn set_sum(&mut self, from: &ModelState<T>, rate: &ModelState<T>, step_s: T, own: usize) {
        let set = |to: &mut [T], from: &[T], rate: &[T]| {
            for (to, (from, rate)) in to.iter_mut().zip(from.iter().zip(rate)) {
                *to = *from + *rate * step_s;
            }
        };
        let (to, of) = (&mut self.vehicle, (&from.vehicle, &rate.vehicle));
        set(&mut to.eta, &of.0.eta, &of.1.eta);
        set(&mut to.nu, &of.0.nu, &of.1.nu);
        set(&mut self.own[..own], &from.own[..own], &rate.own[..own]);
    }

    /// Becomes the other state; of the own states the first `own` are looked at.
    fn set(&mut self, to: &ModelState<T>, own: usize) {
        self.vehicle = to.vehicle;
        self.own[..own].copy_from_slice(&to.own[..own]);
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        let all = self
            .vehicle
            .eta
            .iter()
            .chain(&self.vehicle.nu)
            .chain(&self.own);
        all.map(|v| v.value()).all(f64::is_finite)
    }
}

/// Vehicle and effects.
#[derive(Debug)]
pub struct Model<T: Real = f64> {
    /// The vehicle's numbers.
    pub hydrodynamics: Hydrodynamics<T>,
    /// The effects that are switched on.
    pub effects: EffectStack<T>,
}

impl Model<f64> {
    /// The model a rig describes.
    ///
    /// # Errors
    /// [`EffectError`] when a `[[physics]]` entry is unknown, incomplete or out of its limits.
    pub fn from_rig(rig: &Rig) -> Result<Self, EffectError> {
        Ok(Model {
            hydrodynamics: Hydrodynamics::new(&rig.vehicle),
            effects: EffectStack::build(&rig.physics)?,
        })
    }
}

impl<T: Real> Model<T> {
    /// A model with effect parameters lifted to `T` (see [`EffectStack::assemble`]).
    ///
    /// # Errors
    /// [`EffectError::TooManyStates`].
    pub fn assemble(
        hydrodynamics: Hydrodynamics<T>,
        effects: &[CheckedEffect],
        lift: impl FnMut(usize, usize, f64) -> T,
    ) -> Result<Self, EffectError> {
        Ok(Model {
            hydrodynamics,
            effects: EffectStack::assemble(effects, lift)?,
        })
    }

    /// Time derivative of the whole state at `t_s` under a commanded wrench \[N, N m\].
    ///
    /// `step_start_s` is the start of the current (never split) step: a law that jumps in
    /// time decides by it on which side of its jump the step lies.
    pub fn rate(
        &self,
        t_s: T,
        step_start_s: T,
        state: &ModelState<T>,
        command: &[T; 6],
    ) -> ModelState<T> {
        self.rate_beside(t_s, step_start_s, state, command, None)
    }

    /// The same beside what is given. Given DOFs in `state` are not looked at; what comes back of them says nothing, but x
    /// and y move by all rates.
    pub fn rate_beside(
        &self,
        t_s: T,
        step_start_s: T,
        state: &ModelState<T>,
        command: &[T; 6],
        given: Option<&Given>,
    ) -> ModelState<T> {
        let mut rate = ModelState::at_rest([T::zero(); 6]);
        self.put_rate((t_s, step_start_s), state, command, given, &mut rate);
        rate
    }

    /// The same in place: with derivatives a state has some kilobytes, and copies of it took a quarter of a diagnosis.
    fn put_rate(
        &self,
        (t_s, step_start_s): (T, T),
        state: &ModelState<T>,
        command: &[T; 6],
        given: Option<&Given>,
        rate: &mut ModelState<T>,
    ) {
        let h = &self.hydrodynamics;
        let mut placed;
        let VehicleState { eta, nu } = match given {
            Some(given) => {
                placed = state.vehicle;
                given.put(t_s, &mut placed.eta, &mut placed.nu, false);
                &placed
            }
            None => &state.vehicle,
        };
        let companions = given.map(|g| g.companions_at(t_s));
        // Nobody asks how a given DOF would accelerate.
        let is_free: [bool; 6] =
            std::array::from_fn(|i| given.is_none_or(|g| g.rates[i].is_none()));
        let coupled = h.model == VehicleModel::Eq1;
        let attitude = Attitude::of(eta);
        let (heading, own_mass) = (attitude.psi, h.mass());
        let mut moment = Moment {
            t_s,
            step_start_s,
            load: command,
            eta,
            heading: &heading,
            nu,
            nu_r: nu,
            mass: &own_mass,
            hydrodynamics: h,
            companions: companions.as_ref(),
            given,
        };
        rate.own[..self.effects.states()].fill(T::zero());
        let wrench = &mut rate.vehicle.nu;
        *wrench = *command;
        self.effects
            .thrust(&moment, wrench, &state.own, &mut rate.own);
        let (mut nu_r, mut mass);
        if self.effects.waters() {
            nu_r = *nu;
            self.effects.relative_velocity(&moment, &mut nu_r);
            moment.nu_r = &nu_r;
            mass = own_mass;
            self.effects.added_mass(&moment, &mut mass);
            moment.mass = &mass;
        }

        let mut drag = equations::damping(h, moment.nu_r);
        self.effects.drag(&moment, &mut drag);
        let (sin_theta, cos_theta) = attitude.theta;
        let tilt = if coupled { cos_theta } else { T::one() };
        let mut force = equations::restoring(h, [attitude.phi.0, sin_theta], tilt);
        if let Some(statics) = &h.hydrostatics {
            let water = equations::hydrostatics(statics, eta, coupled);
            force = std::array::from_fn(|i| force[i] + water[i]);
        }
        if coupled {
            equations::add_coriolis(h, &own_mass, nu, &is_free, &mut force);
        }
        self.effects.force(&moment, &state.own, &mut force);

        let nu_dot = wrench;
        for i in (0..6).filter(|i| is_free[*i]) {
            nu_dot[i] = (nu_dot[i] + drag[i] + force[i]) / moment.mass[i];
        }
        let nu_dot = &rate.vehicle.nu;
        self.effects
            .own_rate(&moment, nu_dot, &state.own, &mut rate.own);
        attitude.put_eta_rate(nu, &mut rate.vehicle.eta);
    }

    /// One classic Runge-Kutta step of fourth order (the paper's integrator) from `t_s` over `step_s`.
    ///
    /// The command holds over the step; the caller never steps across an edge.
    pub fn rk4(&self, t_s: T, step_s: T, state: &ModelState<T>, command: &[T; 6]) -> ModelState<T> {
        self.rk4_beside(t_s, step_s, state, command, None)
    }

    /// The same beside what is given: the caller never steps across a knot of it either.
    pub fn rk4_beside(
        &self,
        t_s: T,
        step_s: T,
        state: &ModelState<T>,
        command: &[T; 6],
        given: Option<&Given>,
    ) -> ModelState<T> {
        let mut state = *state;
        self.step(&mut state, (t_s, step_s), 1, command, given);
        state
    }

    /// As many such steps, each of `step_s`, in place.
    pub(crate) fn step(
        &self,
        state: &mut ModelState<T>,
        (t_s, step_s): (T, T),
        count: usize,
        command: &[T; 6],
        given: Option<&Given>,
    ) {
        let (half, sixth) = (step_s * 0.5, step_s * (1.0 / 6.0));
        let third = sixth * 2.0;
        let own = self.effects.states();
        let (mut sum, mut between, mut slope) = (*state, *state, *state);
        for k in 0..count {
            let from = t_s + step_s * k as f64;
            let put_rate = |at: T, s: &ModelState<T>, rate: &mut ModelState<T>| {
                self.put_rate((at, from), s, command, given, rate);
            };
            put_rate(from, state, &mut slope);
            sum.set(state, own);
            for (span, share) in [(half, sixth), (half, third), (step_s, third)] {
                sum.add(&slope, share, own);
                between.set_sum(state, &slope, span, own);
                put_rate(from + span, &between, &mut slope);
            }
            sum.add(&slope, sixth, own);
            state.set(&sum, own);
        }
    }
}
