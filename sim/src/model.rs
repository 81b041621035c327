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
        let h = &self.hydrodynamics;
        let VehicleState { mut eta, mut nu } = state.vehicle;
        let companions = given.map(|g| {
            g.put(t_s, &mut eta, &mut nu, false);
            g.companions_at(t_s)
        });
        let coupled = h.model == VehicleModel::Eq1;
        let attitude = Attitude::of(&eta);
        let (heading, own_mass) = (attitude.psi, h.mass());
        let mut moment = Moment {
            t_s,
            step_start_s,
            load: command,
            eta: &eta,
            heading: &heading,
            nu: &nu,
            nu_r: &nu,
            mass: &own_mass,
            hydrodynamics: h,
            companions: companions.as_ref(),
            given,
        };
        let mut own_rate = [T::zero(); OWN_STATES_MAX];

        let mut wrench = *command;
        self.effects
            .thrust(&moment, &mut wrench, &state.own, &mut own_rate);
        let mut nu_r = nu;
        self.effects.relative_velocity(&moment, &mut nu_r);
        moment.nu_r = &nu_r;
        let mut mass = own_mass;
        self.effects.added_mass(&moment, &mut mass);
        moment.mass = &mass;

        let mut drag = equations::damping(h, moment.nu_r);
        self.effects.drag(&moment, &mut drag);
        let (sin_theta, cos_theta) = attitude.theta;
        let tilt = if coupled { cos_theta } else { T::one() };
        let mut force = equations::restoring(h, [attitude.phi.0, sin_theta], tilt);
        if let Some(statics) = &h.hydrostatics {
            let water = equations::hydrostatics(statics, &eta, coupled);
            force = std::array::from_fn(|i| force[i] + water[i]);
        }
        if coupled {
            let cross = equations::coriolis(h, &nu);
            force = std::array::from_fn(|i| force[i] + cross[i]);
        }
        self.effects.force(&moment, &state.own, &mut force);

        let nu_dot: [T; 6] =
            std::array::from_fn(|i| (wrench[i] + drag[i] + force[i]) / moment.mass[i]);
        self.effects
            .own_rate(&moment, &nu_dot, &state.own, &mut own_rate);
        ModelState {
            vehicle: VehicleState {
                eta: attitude.eta_rate(&nu),
                nu: nu_dot,
            },
            own: own_rate,
        }
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
        let (half, sixth) = (step_s * 0.5, step_s * (1.0 / 6.0));
        let third = sixth * 2.0;
        let own = self.effects.states();
        let rate = |at: T, s: &ModelState<T>| self.rate_beside(at, t_s, s, command, given);
        // In place: copies of states with derivatives took a quarter of a diagnosis.
        let (mut sum, mut between) = (*state, *state);
        let mut slope = rate(t_s, state);
        for (span, share) in [(half, sixth), (half, third), (step_s, third)] {
            sum.add(&slope, share, own);
            between.clone_from(state);
            between.add(&slope, span, own);
            slope = rate(t_s + span, &between);
        }
        sum.add(&slope, sixth, own);
        sum
    }
}
