//! A rig's equations of motion as formulas: inputs, parameters, states and their rates.

use hydroline_rigs::{Dof, Rig};
use hydroline_sim::effect::{CheckedEffect, Stage, check};
use hydroline_sim::model::{Model, ModelState, OWN_STATES_MAX};
use hydroline_sim::vehicle::{Hydrodynamics, Hydrostatics, VehicleState};
use hydroline_sim::{Allocation, EffectError, Real, ThrustError};

use super::formula::{Formula, Plain, formula};
use super::stored::TooLarge;
use super::traced::{Graph, Place, Traced, record};

/// Names of pose and rates, in the order of the state.
pub const STATE: [&str; 12] = [
    "x", "y", "z", "phi", "theta", "psi", "u", "v", "w", "p", "q", "r",
];
/// Their units.
pub const STATE_UNITS: [&str; 12] = [
    "m", "m", "m", "rad", "rad", "rad", "m/s", "m/s", "m/s", "rad/s", "rad/s", "rad/s",
];

/// Failure to write a model down.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum ModelError {
    #[error(transparent)]
    Effect(#[from] EffectError),
    #[error(transparent)]
    Thrust(#[from] ThrustError),
    #[error(
        "the law of {effect} looks at {symbol} instead of choosing by its sign: it cannot be written as a formula; take the effect out of [[physics]], or use --to fmu, which runs hydroline's own code"
    )]
    Branches { effect: String, symbol: String },
    #[error(
        "the library of an FMU was not found beside the program or in ../lib/hydroline: build it (cargo build --release -p hydroline-fmu), or name it in HYDROLINE_FMU_LIBRARY"
    )]
    NoLibrary,
    #[error("FMI has no name for {system} on {machine}; export on Linux, macOS or Windows")]
    NoPlatform {
        system: &'static str,
        machine: &'static str,
    },
    #[error(transparent)]
    TooLarge(#[from] TooLarge),
}

/// A number that the model is made of.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Name, with its unit where rigs give it one.
    pub name: String,
    /// Value, SI.
    pub value: f64,
}

/// A thruster: name, wrench per newton, curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Thruster {
    /// Name in the rig.
    pub name: String,
    /// X, Y, Z \[N\], K, M, N \[N m\] of one newton of thrust.
    pub wrench: [f64; 6],
    /// (pulse \[us\], thrust \[N\]), rising.
    pub curve: Vec<(f64, f64)>,
    /// Least and largest thrust within the rig's pulses \[N\].
    pub limits_n: [f64; 2],
}

/// Why an effect is not in the formulas.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Absent {
    /// It acts between motion and measurement: no part of the vehicle.
    OfMeasurement,
    /// It changes no rate: it needs what was measured beside the motion (shaft speed, fin angles, waves), or the equations have it
    /// already.
    Idle,
    /// Commands act later: held by what calls the formulas.
    Delay,
}

impl Absent {
    /// The reason as a sentence, with what to do.
    pub fn words(self) -> &'static str {
        match self {
            Absent::OfMeasurement => "acts between motion and measurement: no part of the vehicle",
            Absent::Idle => {
                "changes no rate: it needs what is measured beside the motion (shaft speed, fin angles, waves), or Eq. 1 has it already"
            }
            Absent::Delay => {
                "rates know no past: hold commands back by the delay that is written beside them"
            }
        }
    }
}

/// A model as formulas.
#[derive(Debug)]
pub struct Written {
    /// Name of the rig.
    pub name: String,
    /// All that the rates are made of.
    pub graph: Graph,
    /// Rates of the states, in their order.
    pub rates: Vec<Place>,
    /// Names of the states: twelve of the vehicle, then the effects' own.
    pub states: Vec<String>,
    /// Numbers that may be changed, in order of their use.
    pub parameters: Vec<Parameter>,
    /// Thrusters, in the order of the input.
    pub thrusters: Vec<Thruster>,
    /// Time from a command to the load \[s\].
    pub delay_s: f64,
    /// Effects that the formulas hold, as `[[physics]]` names them.
    pub held: Vec<String>,
    /// Those that they do not, with the reason.
    pub absent: Vec<(String, Absent)>,
}

/// Name of an effect with the words that place it.
pub fn name_of(effect: &CheckedEffect) -> String {
    let words = effect.info.words.iter().zip(&effect.words);
    let named = words
        .filter(|(w, _)| w.name == "dof")
        .filter_map(|(w, i)| w.allowed.get(*i));
    named.fold(effect.info.id.to_owned(), |name, dof| {
        format!("{name}_{dof}")
    })
}

/// Parameters as inputs, in the order they are made.
struct Numbers {
    all: Vec<Parameter>,
}

impl Numbers {
    fn symbol(&mut self, name: String, value: f64) -> Traced {
        let traced = Traced::symbol(&name, value);
        self.all.push(Parameter { name, value });
        traced
    }
}

/// A value that no number of a model has by chance, so that no branch is taken at a corner.
fn sample(k: usize) -> f64 {
    0.0123 + 0.0071 * k as f64
}

/// What a trace leaves.
struct Traces {
    rates: Vec<Place>,
    states: Vec<String>,
    parameters: Vec<Parameter>,
    graph: Graph,
    /// Number of symbols that move: time, states, thrusts.
    moving: usize,
}

impl Traces {
    /// The vehicle's rates as text.
    fn of_vehicle(&self) -> Formula {
        formula(&self.graph, &self.rates[..STATE.len()], &Plain)
    }
}

fn trace(
    rig: &Rig,
    wrenches: &[[f64; 6]],
    effects: &[CheckedEffect],
    fixed: &[String],
) -> Result<Traces, EffectError> {
    let (made, graph) = record(|| -> Result<_, EffectError> {
        let t_s = Traced::symbol("t", 1.234);
        let motion: [Traced; 12] = std::array::from_fn(|k| Traced::symbol(STATE[k], sample(k)));
        let thrusts: Vec<Traced> = (0..wrenches.len())
            .map(|k| Traced::symbol(&format!("thrust_{}", k + 1), sample(20 + k)))
            .collect();
        let mut numbers = Numbers { all: Vec::new() };
        let hydrodynamics = hydrodynamics(rig, &mut numbers);
        let model = Model::assemble(hydrodynamics, effects, |e, p, value| {
            let effect = &effects[e];
            let parameter = effect.info.parameters.get(p);
            let name = parameter.map(|i| format!("{}_{}", name_of(effect), i.name));
            match name {
                // Tables, and shares of trends, are data and no parameters.
                Some(name) if !effect.info.is_a_table() && !fixed.contains(&name) => {
                    numbers.symbol(name, value)
                }
                _ => Traced::from_f64(value),
            }
        })?;
        let mut own_names = Vec::new();
        for (info, count) in model.effects.own_states() {
            own_names.extend((1..=count).map(|k| (info.id, k)));
        }
        let mut states: Vec<String> = STATE.iter().map(|s| (*s).to_owned()).collect();
        let mut own = [Traced::zero(); OWN_STATES_MAX];
        for (k, (id, _)) in own_names.iter().enumerate() {
            let name = format!("state_{}_{id}", k + 1);
            own[k] = Traced::symbol(&name, sample(40 + k));
            states.push(name);
        }
        let load: [Traced; 6] = std::array::from_fn(|d| {
            let each = thrusts.iter().zip(wrenches);
            each.fold(Traced::zero(), |sum, (thrust, w)| sum + *thrust * w[d])
        });
        let state = ModelState {
            vehicle: VehicleState {
                eta: std::array::from_fn(|k| motion[k]),
                nu: std::array::from_fn(|k| motion[6 + k]),
            },
            own,
        };
        let rate = model.rate(t_s, t_s, &state, &load);
        let VehicleState { eta, nu } = rate.vehicle;
        let of_own = &rate.own[..own_names.len()];
        let rates = eta.iter().chain(&nu).chain(of_own).map(|r| r.place());
        Ok((rates.collect::<Vec<Place>>(), states, numbers.all))
    });
    let (rates, states, parameters) = made?;
    Ok(Traces {
        moving: 1 + wrenches.len() + states.len(),
        rates,
        states,
        parameters,
        graph,
    })
}

fn hydrodynamics(rig: &Rig, numbers: &mut Numbers) -> Hydrodynamics<Traced> {
    let v = &rig.vehicle;
    let mass = numbers.symbol("mass_kg".into(), v.mass_kg);
    let inertia: [Traced; 3] = std::array::from_fn(|k| {
        let name = ["ix_kgm2", "iy_kgm2", "iz_kgm2"][k];
        numbers.symbol(name.into(), v.inertia_kgm2[k])
    });
    let mut coefficient = |term: usize| {
        std::array::from_fn(|d| {
            let of = &v.coefficients[d];
            let value = [of.added, of.linear, of.quadratic][term];
            numbers.symbol(Dof::ALL[d].coefficient_names()[term].into(), value)
        })
    };
    let (added, linear, quadratic) = (coefficient(0), coefficient(1), coefficient(2));
    let arm = numbers.symbol("r_bz_m".into(), v.r_bz_m);
    let gravity = numbers.symbol("gravity_mps2".into(), v.gravity_mps2);
    let plain = Hydrodynamics::<f64>::new(v);
    let hydrostatics = plain.hydrostatics.map(|_| Hydrostatics {
        net_weight_n: numbers.symbol("net_weight_n".into(), v.net_weight_n),
        stiffness: std::array::from_fn(|k| {
            let name = [
                "heave_stiffness_npm",
                "roll_stiffness_nmprad",
                "pitch_stiffness_nmprad",
            ][k];
            numbers.symbol(name.into(), v.stiffness[k])
        }),
        float_z_m: numbers.symbol("float_z_m".into(), v.float_z_m.unwrap_or(0.0)),
    });
    Hydrodynamics {
        model: v.model,
        rigid: [mass, mass, mass, inertia[0], inertia[1], inertia[2]],
        added,
        linear,
        quadratic,
        restoring_nm: arm * mass * gravity,
        hydrostatics,
    }
}

/// Effects sorted into those of the formulas and others.
struct Sorted {
    held: Vec<CheckedEffect>,
    absent: Vec<(String, Absent)>,
    delay_s: f64,
    /// Parameters that a law looks at when it is made: constants of the formulas.
    fixed: Vec<String>,
}

fn sorted(rig: &Rig, wrenches: &[[f64; 6]]) -> Result<Sorted, ModelError> {
    let mut sorted = Sorted {
        held: Vec::new(),
        absent: Vec::new(),
        delay_s: 0.0,
        fixed: Vec::new(),
    };
    let without = trace(rig, wrenches, &[], &[])?.of_vehicle();
    for effect in check(&rig.physics)? {
        let name = name_of(&effect);
        match effect.info.stage {
            Stage::Measurement => sorted.absent.push((name, Absent::OfMeasurement)),
            Stage::Timing => {
                let alone = std::slice::from_ref(&effect);
                let stack = hydroline_sim::EffectStack::<f64>::assemble(alone, |_, _, v| v)?;
                let delay_s = stack.command_delay_s();
                sorted.delay_s += delay_s;
                let reason = if delay_s > 0.0 {
                    Absent::Delay
                } else {
                    Absent::OfMeasurement
                };
                sorted.absent.push((name, reason));
            }
            Stage::Thruster | Stage::Hydrodynamics => {
                let found = trace(rig, wrenches, std::slice::from_ref(&effect), &[])?;
                for symbol in found.graph.symbols_of(&found.graph.looked_at) {
                    let symbol = &found.graph.symbols[symbol];
                    if !found.parameters.iter().any(|p| p.name == *symbol) {
                        return Err(ModelError::Branches {
                            effect: name,
                            symbol: symbol.clone(),
                        });
                    }
                    sorted.fixed.push(symbol.clone());
                }
                let acts = found.of_vehicle() != without;
                if acts {
                    sorted.held.push(effect);
                } else {
                    sorted.absent.push((name, Absent::Idle));
                }
            }
        }
    }
    Ok(sorted)
}

/// The model of a rig as formulas.
///
/// # Errors
/// [`ModelError`].
pub fn written(rig: &Rig) -> Result<Written, ModelError> {
    let allocation = Allocation::new(&rig.thrusters)?;
    let set = &rig.thrusters;
    let mut thrusters = Vec::new();
    for (k, thruster) in set.thrusters.iter().enumerate() {
        let mut one = vec![0.0; set.thrusters.len()];
        one[k] = 1.0;
        let (least, most) = thruster.curve.thrust_range_n(set.min_us, set.max_us);
        thrusters.push(Thruster {
            name: thruster.name.clone(),
            wrench: allocation.wrench(&one)?.to_array(),
            curve: thruster.curve.points.clone(),
            limits_n: [least, most],
        });
    }
    let wrenches: Vec<[f64; 6]> = thrusters.iter().map(|t| t.wrench).collect();
    let sorted = sorted(rig, &wrenches)?;
    let found = trace(rig, &wrenches, &sorted.held, &sorted.fixed)?;
    // Alone each was looked through; together nothing more may be.
    if let Some(symbol) = found
        .graph
        .symbols_of(&found.graph.looked_at)
        .first()
        .filter(|s| **s < found.moving)
    {
        return Err(ModelError::Branches {
            effect: "[[physics]]".to_owned(),
            symbol: found.graph.symbols[*symbol].clone(),
        });
    }
    Ok(Written {
        name: rig.name.clone(),
        graph: found.graph,
        rates: found.rates,
        states: found.states,
        parameters: found.parameters,
        thrusters,
        delay_s: sorted.delay_s,
        held: sorted.held.iter().map(name_of).collect(),
        absent: sorted.absent,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_sim::effect::ALL;

    /// Each effect of the library by itself is a formula, or says why it is none.
    #[test]
    fn every_effect_is_a_formula_or_has_a_reason() {
        let mut without = Vec::new();
        for info in ALL {
            let mut rig = Rig::builtin("lshpi").unwrap();
            rig.physics = vec![CheckedEffect::typical(info).entry()];
            let model = written(&rig).unwrap_or_else(|e| panic!("{}: {e}", info.id));
            let in_water = matches!(info.stage, Stage::Thruster | Stage::Hydrodynamics);
            assert_eq!(model.held.len() + model.absent.len(), 1, "{}", info.id);
            if in_water && model.held.is_empty() {
                without.push(info.id);
            }
        }
        // The first and the last two need a companion; Eq. 1 has the coupling already.
        let idle = [
            "shaft_thrust",
            "added_mass_coupling",
            "fin_force",
            "wave_force",
        ];
        assert_eq!(without, idle);
    }

    #[test]
    fn parameters_are_the_rigs_numbers_by_their_names() {
        let mut rig = Rig::builtin("lshpi").unwrap();
        rig.physics = vec![hydroline_rigs::PhysicsEntry {
            effect: "thruster_lag".into(),
            parameters: vec![("lag_s".into(), hydroline_rigs::ParameterValue::Number(0.25))],
        }];
        let model = written(&rig).unwrap();
        let value = |name: &str| {
            model
                .parameters
                .iter()
                .find(|p| p.name == name)
                .unwrap()
                .value
        };
        assert_eq!(value("x_udot"), -250.0);
        assert_eq!(value("thruster_lag_surge_lag_s"), 0.25);
        assert_eq!(model.states[12], "state_1_thruster_lag");
        assert_eq!(model.thrusters.len(), 8);
        assert!(model.thrusters[4].wrench[2] > 0.99);
    }
}
