//! The effects that are switched on, in the order they act.

use super::covariate_table::{covariate, interpolated};
use super::{
    CheckedEffect, EffectError, EffectInfo, Law, Moment, Optics, Stage, Values, check, registry,
};
use crate::model::OWN_STATES_MAX;
use crate::real::Real;
use hydroline_rigs::PhysicsEntry;

#[derive(Debug)]
struct Member<T: Real> {
    info: &'static EffectInfo,
    law: Box<dyn Law<T>>,
    /// Where one of its numbers depends on a covariate.
    state_dependent: Option<StateDependent<T>>,
    /// Its slice of the own states.
    first: usize,
    last: usize,
}

/// An effect one number of which depends on where the motion is: its law is made anew wherever it is asked.
#[derive(Debug)]
struct StateDependent<T> {
    numbers: Vec<T>,
    words: Vec<usize>,
    parameter: usize,
    nothing: f64,
    along: usize,
    dof: usize,
    range: (f64, f64),
    shares: Vec<T>,
}

impl<T: Real> StateDependent<T> {
    fn law(&self, info: &'static EffectInfo, m: &Moment<'_, T>) -> Option<Box<dyn Law<T>>> {
        let at = covariate(m, self.along, self.dof);
        let share = interpolated(&self.shares, self.range, at);
        let (low, high) = info.parameters[self.parameter].limits;
        let mut numbers = self.numbers.clone();
        let value = &mut numbers[self.parameter];
        *value = *value + (*value - T::from_f64(self.nothing)) * share;
        *value = value.max(T::from_f64(low)).min(T::from_f64(high));
        registry::law(&Values {
            info,
            numbers: &numbers,
            words: &self.words,
        })
    }
}

impl<T: Real> Member<T> {
    /// Asks its law as it is here.
    fn here<R>(&self, m: &Moment<'_, T>, ask: impl FnOnce(&dyn Law<T>) -> R) -> R {
        let state_dependent = self
            .state_dependent
            .as_ref()
            .and_then(|b| b.law(self.info, m));
        match state_dependent {
            Some(law) => ask(&*law),
            None => ask(&*self.law),
        }
    }
}

/// Effects sorted by stage and by order within it; same order, file order.
#[derive(Debug)]
pub struct EffectStack<T: Real = f64> {
    members: Vec<Member<T>>,
    /// Whether a stage has members: thruster, hydrodynamics, measurement.
    busy: [bool; 3],
    notes: Vec<String>,
}

impl EffectStack<f64> {
    /// Checks the rig's `[[physics]]` entries and builds their laws.
    ///
    /// # Errors
    /// [`EffectError`], the first in file order.
    pub fn build(entries: &[PhysicsEntry]) -> Result<Self, EffectError> {
        Self::assemble(&check(entries)?, |_, _, value| value)
    }
}

impl<T: Real> EffectStack<T> {
    /// No effect.
    pub fn empty() -> Self {
        EffectStack {
            members: Vec::new(),
            busy: [false; 3],
            notes: Vec::new(),
        }
    }

    /// Builds the laws in the scalar `T`; `lift(effect, parameter, value)` makes each number a `T`
    /// (indices into `effects` and its `info.parameters`, then into its trend's shares), e.g. a dual with its own derivative.
    ///
    /// # Errors
    /// [`EffectError::TooManyStates`].
    pub fn assemble(
        effects: &[CheckedEffect],
        mut lift: impl FnMut(usize, usize, f64) -> T,
    ) -> Result<Self, EffectError> {
        let mut members = Vec::with_capacity(effects.len());
        for (e, effect) in effects.iter().enumerate() {
            let numbers: Vec<T> = effect
                .numbers
                .iter()
                .enumerate()
                .map(|(p, &value)| lift(e, p, value))
                .collect();
            let state_dependent = effect.trend.as_ref().map(|t| StateDependent {
                words: effect.words.clone(),
                parameter: t.parameter,
                nothing: t.nothing,
                along: t.along,
                dof: effect.dof(),
                range: t.range,
                shares: (numbers.len()..)
                    .zip(&t.shares)
                    .map(|(p, &share)| lift(e, p, share))
                    .collect(),
                numbers: numbers.clone(),
            });
            let values = Values {
                info: effect.info,
                numbers: &numbers,
                words: &effect.words,
            };
            let law = registry::law(&values).ok_or_else(|| EffectError::UnknownEffect {
                effect: effect.info.id.to_owned(),
                nearest: None,
                known: registry::ALL.iter().map(|i| i.id).collect(),
            })?;
            members.push(Member {
                info: effect.info,
                law,
                state_dependent,
                first: 0,
                last: 0,
            });
        }
        members.sort_by_key(|m| (m.info.stage, m.info.order));
        let mut used = 0;
        for m in &mut members {
            m.first = used;
            used += m.law.states();
            m.last = used;
        }
        if used > OWN_STATES_MAX {
            return Err(EffectError::TooManyStates {
                needed: used,
                limit: OWN_STATES_MAX,
            });
        }
        let notes = effects
            .iter()
            .flat_map(|e| e.notes.iter().cloned())
            .collect();
        let busy = [Stage::Thruster, Stage::Hydrodynamics, Stage::Measurement]
            .map(|stage| members.iter().any(|m| m.info.stage == stage));
        Ok(EffectStack {
            members,
            busy,
            notes,
        })
    }

    /// Notes on unusual parameters, one line each.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Infos in the order the effects act.
    pub fn infos(&self) -> impl Iterator<Item = &'static EffectInfo> + '_ {
        self.members.iter().map(|m| m.info)
    }

    /// Number of own states of each effect, in the order the effects act.
    pub fn own_states(&self) -> impl Iterator<Item = (&'static EffectInfo, usize)> + '_ {
        self.members.iter().map(|m| (m.info, m.last - m.first))
    }

    /// Own states of all effects together.
    pub(crate) fn states(&self) -> usize {
        self.members.last().map_or(0, |m| m.last)
    }

    /// Whether anything acts in the thruster stage.
    pub(crate) fn thrusts(&self) -> bool {
        self.busy[0]
    }

    /// Whether anything acts in the water.
    pub(crate) fn waters(&self) -> bool {
        self.busy[1]
    }

    /// Whether anything acts in the measurement.
    pub(crate) fn measures(&self) -> bool {
        self.busy[2]
    }

    /// Time constant of the fastest own state \[s\]; infinite without any.
    pub(crate) fn fastest_s(&self) -> f64 {
        self.members
            .iter()
            .map(|m| m.law.fastest_s())
            .fold(f64::INFINITY, f64::min)
    }

    fn stage(&self, stage: Stage) -> impl Iterator<Item = &Member<T>> {
        self.members.iter().filter(move |m| m.info.stage == stage)
    }

    /// Sum of the command delays \[s\].
    pub fn command_delay_s(&self) -> T {
        self.stage(Stage::Timing)
            .fold(T::zero(), |sum, m| sum + m.law.command_delay_s())
    }

    /// Time the scene was as row `row_px` of a frame stamped `stamp_s` shows it \[s\].
    pub fn scene_time_s(&self, stamp_s: T, row_px: f64) -> T {
        self.stage(Stage::Timing)
            .fold(stamp_s, |t, m| m.law.scene_time_s(t, row_px))
    }

    /// All times at which some law jumps \[s\].
    pub fn time_edges_s(&self) -> Vec<T> {
        self.members
            .iter()
            .flat_map(|m| m.law.time_edges_s())
            .collect()
    }

    pub(crate) fn thrust(&self, m: &Moment<'_, T>, wrench: &mut [T; 6], own: &[T], rate: &mut [T]) {
        for e in self.stage(Stage::Thruster) {
            e.here(m, |law| {
                law.thrust(m, wrench, &own[e.first..e.last], &mut rate[e.first..e.last]);
            });
        }
    }

    /// Changes `nu_r`, which begins as the rates over ground.
    pub(crate) fn relative_velocity(&self, m: &Moment<'_, T>, nu_r: &mut [T; 6]) {
        for e in self.stage(Stage::Hydrodynamics) {
            e.here(m, |law| law.relative_velocity(m, nu_r));
        }
    }

    /// Changes `mass`, which begins as the vehicle's own.
    pub(crate) fn added_mass(&self, m: &Moment<'_, T>, mass: &mut [T; 6]) {
        for e in self.stage(Stage::Hydrodynamics) {
            e.here(m, |law| law.added_mass(m, mass));
        }
    }

    pub(crate) fn drag(&self, m: &Moment<'_, T>, drag: &mut [T; 6]) {
        for e in self.stage(Stage::Hydrodynamics) {
            e.here(m, |law| law.drag(m, drag));
        }
    }

    pub(crate) fn force(&self, m: &Moment<'_, T>, own: &[T], force: &mut [T; 6]) {
        for e in self.stage(Stage::Hydrodynamics) {
            e.here(m, |law| law.force(m, &own[e.first..e.last], force));
        }
    }

    pub(crate) fn own_rate(&self, m: &Moment<'_, T>, nu_dot: &[T; 6], own: &[T], rate: &mut [T]) {
        for e in &self.members {
            e.here(m, |law| {
                law.own_rate(m, nu_dot, &own[e.first..e.last], &mut rate[e.first..e.last]);
            });
        }
    }

    /// The pose at which the camera looks at the scene at `t_s`.
    pub fn scene_pose(&self, t_s: T, mut pose: [T; 6]) -> [T; 6] {
        for e in self.stage(Stage::Measurement) {
            e.law.scene_pose(t_s, &mut pose);
        }
        pose
    }

    /// The scene pose as an instrument reports it.
    pub fn reported_pose(&self, t_s: T, mut pose: [T; 6]) -> [T; 6] {
        for e in self.stage(Stage::Measurement) {
            e.law.reported_pose(t_s, &mut pose);
        }
        pose
    }

    /// Applies the measurement effects to the rig's optics.
    pub fn optics(&self, mut optics: Optics<T>) -> Optics<T> {
        for e in self.stage(Stage::Measurement) {
            e.law.optics(&mut optics);
        }
        optics
    }
}
