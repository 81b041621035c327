//! The vehicle between two frames: the rig's equations of motion under the commands of the log.

use super::{ACCELERATIONS, RATES, STATES, Square, State};
use hydroline_rigs::Rig;
use hydroline_sim::ThrustError;
use hydroline_sim::effect::EffectStack;
use hydroline_sim::model::{Model, ModelState};
use hydroline_sim::thrust::{Commanded, Target};
use hydroline_sim::vehicle::{Hydrodynamics, VehicleState};

/// Longest step of the integration \[s\].
const STEP_S: f64 = 0.02;
/// Nearest to the pole of the Euler angles that is integrated \[rad\].
const PITCH_MAX_RAD: f64 = 1.4;

/// Vehicle and commands.
///
/// Effects of `[[physics]]` are not modelled: what they do goes into the unknown accelerations, which
/// hold for whatever the water does.
#[derive(Debug)]
pub struct Dynamics {
    model: Model<f64>,
    /// From when \[ns\] which wrench holds, by time.
    wrenches: Vec<(u64, [f64; 6])>,
}

impl Dynamics {
    /// A rig's vehicle without commands: no thrust at all.
    pub fn new(rig: &Rig) -> Self {
        Dynamics {
            model: Model {
                hydrodynamics: Hydrodynamics::new(&rig.vehicle),
                effects: EffectStack::empty(),
            },
            wrenches: Vec::new(),
        }
    }

    /// With the commands of a log: (stamp \[ns\], thruster, thrust \[N\]). Thrusters that the rig does
    /// not name are ignored: what they did is then unknown acceleration too.
    ///
    /// # Errors
    /// [`ThrustError`] for a layout of thrusters that makes no wrench.
    pub fn with_commands<'a>(
        rig: &Rig,
        commands: impl IntoIterator<Item = (u64, &'a str, f64)>,
    ) -> Result<Self, ThrustError> {
        let mut out = Dynamics::new(rig);
        let mut commanded = Commanded::new(rig)?;
        let thruster = |name: &str| {
            let target = commanded.target(name);
            target.filter(|t| matches!(t, Target::Thruster(_)))
        };
        let mut known: Vec<(u64, Target, f64)> = commands
            .into_iter()
            .filter_map(|(stamp_ns, name, thrust_n)| Some((stamp_ns, thruster(name)?, thrust_n)))
            .collect();
        known.sort_by_key(|c| c.0);
        for set in known.chunk_by(|a, b| a.0 == b.0) {
            for (_, target, thrust_n) in set {
                commanded.set(*target, *thrust_n);
            }
            let wrench = commanded.wrench()?;
            if out.wrenches.last().is_none_or(|(_, last)| *last != wrench) {
                out.wrenches.push((set[0].0, wrench));
            }
        }
        Ok(out)
    }

    /// The state `from_ns` → `to_ns` later, with its derivative by the state before. `None` where
    /// numbers leave their range.
    pub(super) fn step(&self, from_ns: u64, to_ns: u64, x: &State) -> Option<(State, Square)> {
        let base = self.carried(from_ns, to_ns, x)?;
        let mut slopes = Square::identity();
        // Positions shift the motion of nothing but themselves, but for the depth of a hull that floats.
        let floats = self.model.hydrodynamics.hydrostatics.is_some();
        let first = if floats { 2 } else { 3 };
        for k in first..STATES - 1 {
            // Differences of a smooth flow: 1e-5 of a metre per second is 1e-10 in its curvature.
            let h = 1e-5;
            let mut moved = *x;
            moved[k] += h;
            let there = self.carried(from_ns, to_ns, &moved)?;
            slopes.set_column(k, &((there - base) / h));
        }
        Some((base, slopes))
    }

    fn carried(&self, from_ns: u64, to_ns: u64, x: &State) -> Option<State> {
        let mut at_ns = from_ns;
        let mut state = ModelState::at_rest(std::array::from_fn(|i| x[i]));
        state.vehicle.nu = std::array::from_fn(|i| x[RATES + i]);
        let mass = self.model.hydrodynamics.mass();
        let unknown_wrench: [f64; 6] = std::array::from_fn(|i| mass[i] * x[ACCELERATIONS + i]);
        while at_ns < to_ns {
            let after = self.wrenches.partition_point(|w| w.0 <= at_ns);
            let edge_ns = self
                .wrenches
                .get(after)
                .map_or(to_ns, |w| w.0)
                .clamp(at_ns + 1, to_ns);
            let command = match after {
                0 => [0.0; 6],
                n => self.wrenches[n - 1].1,
            };
            let wrench = std::array::from_fn(|i| command[i] + unknown_wrench[i]);
            let span_s = (edge_ns - at_ns) as f64 * 1e-9;
            let steps = (span_s / STEP_S).ceil().max(1.0);
            for _ in 0..steps as usize {
                state = self.model.rk4(0.0, span_s / steps, &state, &wrench);
            }
            at_ns = edge_ns;
        }
        let VehicleState { eta, nu } = state.vehicle;
        let sound = state.is_finite() && eta[4].abs() < PITCH_MAX_RAD;
        let mut out = *x;
        for i in 0..6 {
            out[i] = eta[i];
            out[RATES + i] = nu[i];
        }
        sound.then_some(out)
    }
}
