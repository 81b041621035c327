//! What the effects' unit tests share: entries, a vehicle without friction, forces at one state.

use super::EffectStack;
use crate::fixture::lshpi_rig;
use crate::model::{Model, ModelState};
use crate::trajectory::Trajectory;
use crate::vehicle::Hydrodynamics;
use crate::world::World;
use hydroline_rigs::{ParameterValue, PhysicsEntry, Wrench};

pub(in crate::effect) fn entry(effect: &str, parameters: &[(&str, f64)]) -> PhysicsEntry {
    let numbers = parameters
        .iter()
        .map(|(n, v)| ((*n).to_owned(), ParameterValue::Number(*v)));
    PhysicsEntry {
        effect: effect.to_owned(),
        parameters: numbers.collect(),
    }
}

pub(in crate::effect) fn with_word(mut e: PhysicsEntry, name: &str, word: &str) -> PhysicsEntry {
    e.parameters
        .push((name.to_owned(), ParameterValue::Word(word.to_owned())));
    e
}

pub(in crate::effect) fn stack(entries: &[PhysicsEntry]) -> EffectStack {
    EffectStack::build(entries).unwrap()
}

pub(in crate::effect) fn surge(x_n: f64) -> [f64; 6] {
    [x_n, 0.0, 0.0, 0.0, 0.0, 0.0]
}

/// Surge alone, without drag: M u' = thrust, so u shows the thrust's integral. With M.
pub(in crate::effect) fn frictionless(entries: &[PhysicsEntry]) -> (Trajectory, f64) {
    let mut v = lshpi_rig().vehicle;
    for c in &mut v.coefficients {
        (c.linear, c.quadratic) = (0.0, 0.0);
    }
    let hydrodynamics = Hydrodynamics::new(&v);
    let mass = hydrodynamics.mass()[0];
    let model = Model {
        hydrodynamics,
        effects: stack(entries),
    };
    let start = ModelState::at_rest([0.0; 6]);
    (Trajectory::new(model, start, 0.005).unwrap(), mass)
}

/// The rig at the tank's origin with these effects.
pub(in crate::effect) fn world(entries: &[PhysicsEntry]) -> World {
    let mut rig = lshpi_rig();
    rig.physics = entries.to_vec();
    World::new(&rig, [0.0; 6]).unwrap()
}

/// 8 N ahead and astern by turns, a second each.
pub(in crate::effect) fn drive(w: &mut World, until_s: f64) {
    let mut t_s = 0.1;
    let mut surge_n = 8.0;
    while t_s < until_s {
        let wrench = Wrench {
            surge_n,
            ..Wrench::default()
        };
        w.command(t_s, &wrench).unwrap();
        (t_s, surge_n) = (t_s + 1.0, -surge_n);
    }
}

#[derive(Debug, Clone, Copy, Default)]
pub(in crate::effect) struct State {
    pub eta: [f64; 6],
    pub nu: [f64; 6],
}

/// Acceleration at a state at t = 0, own states 0.
pub(in crate::effect) fn acceleration(
    entries: &[PhysicsEntry],
    state: State,
    wrench: [f64; 6],
) -> [f64; 6] {
    let model = Model {
        hydrodynamics: Hydrodynamics::new(&lshpi_rig().vehicle),
        effects: stack(entries),
    };
    let mut s = ModelState::at_rest(state.eta);
    s.vehicle.nu = state.nu;
    model.rate(0.0, 0.0, &s, &wrench).vehicle.nu
}

/// Mass (without effects) times acceleration.
pub(in crate::effect) fn force(
    entries: &[PhysicsEntry],
    state: State,
    wrench: [f64; 6],
) -> [f64; 6] {
    let mass = Hydrodynamics::<f64>::new(&lshpi_rig().vehicle).mass();
    let a = acceleration(entries, state, wrench);
    std::array::from_fn(|i| a[i] * mass[i])
}

/// What the effects add to the force.
pub(in crate::effect) fn extra(
    entries: &[PhysicsEntry],
    state: State,
    wrench: [f64; 6],
) -> [f64; 6] {
    let (with, without) = (force(entries, state, wrench), force(&[], state, wrench));
    std::array::from_fn(|i| with[i] - without[i])
}
