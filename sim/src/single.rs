//! One DOF of the model with every effect: (m - X_udot) u' = drag + restoring + effects + X, s' = u
//! (paper Eq. 7), the five others at rest.
//!
//! The same laws as [`crate::model::Model`], through the same hooks and in the same order; only
//! what the other DOFs would do is left out. A search that refits some hundred sets of effects
//! lives on this: it costs a fifth of the full model. Steps never span a command edge, a law's own
//! edge or a stamp, and all three may carry derivatives (delays, drift of a clock).

use crate::effect::{EffectStack, Moment};
use crate::given::Given;
use crate::real::Real;
use crate::vehicle::{Hydrodynamics, equations};
use hydroline_rigs::VehicleModel;

/// The line along which the DOF moves, and where the others rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Index of the DOF, SNAME order.
    pub dof: usize,
    /// Pose of the others, tank frame; its heading turns surge and sway.
    pub rest: [f64; 6],
}

impl Line {
    /// Position along the line of a pose: body axis for surge and sway, the angle or depth itself else.
    pub fn along<T: Real>(&self, pose: &[T; 6]) -> T {
        let (sin, cos) = self.rest[5].sin_cos();
        match self.dof {
            0 => pose[0] * cos + pose[1] * sin,
            1 => pose[1] * cos - pose[0] * sin,
            i => pose[i],
        }
    }

    /// The pose at a position along the line.
    pub fn pose<T: Real>(&self, position: T) -> [T; 6] {
        Rail::of(self).pose(position)
    }
}

/// A line with its sines taken once.
#[derive(Debug, Clone, Copy)]
struct Rail<T> {
    dof: usize,
    rest: [T; 6],
    /// Direction of x and y along the line.
    along: [f64; 2],
    /// Where position 0 lies.
    foot: [T; 2],
}

impl<T: Real> Rail<T> {
    fn of(line: &Line) -> Self {
        let (sin, cos) = line.rest[5].sin_cos();
        let [x, y, ..] = line.rest;
        let (across, ahead) = (y * cos - x * sin, x * cos + y * sin);
        let (along, foot) = match line.dof {
            0 => ([cos, sin], [-across * sin, across * cos]),
            _ => ([-sin, cos], [ahead * cos, ahead * sin]),
        };
        Rail {
            dof: line.dof,
            rest: line.rest.map(T::from_f64),
            along,
            foot: foot.map(T::from_f64),
        }
    }

    fn pose(&self, position: T) -> [T; 6] {
        let mut pose = self.rest;
        self.put(position, &mut pose);
        pose
    }

    /// The same into a pose on this line: only what moves is written.
    fn put(&self, position: T, pose: &mut [T; 6]) {
        if self.dof < 2 {
            pose[0] = self.foot[0] + position * self.along[0];
            pose[1] = self.foot[1] + position * self.along[1];
        } else {
            pose[self.dof] = position;
        }
    }
}

/// The inputs of one run.
#[derive(Debug, Clone, Copy)]
pub struct Feed<'a> {
    /// First instant \[s\]; the state is given there.
    pub start_s: f64,
    /// (time, load of this DOF from then on), ascending; 0 before the first.
    pub edges: &'a [(f64, f64)],
    /// Stamps of the measurement, ascending \[s\].
    pub stamps_s: &'a [f64],
    /// Longest RK4 step without own states \[s\].
    pub step_max_s: f64,
    /// How the other DOFs move where they do not rest, and companions. The line itself must not turn: nothing of heading for
    /// surge and sway.
    pub given: Option<&'a Given>,
}

/// Longest step over the fastest own state's time constant: RK4 is stable to 2.78, and at 0.8 its
/// error in e^-0.8 is 0.5 %, of a state that has died away after two steps.
const STEP_SHARE: f64 = 0.8;
/// Shortest step taken for that \[s\].
const STEP_LEAST_S: f64 = 0.005;

/// The longest step \[s\] for effects whose fastest own state has this time constant \[s\].
pub(crate) fn longest_step_s(fastest_s: f64, step_max_s: f64) -> f64 {
    step_max_s.min((STEP_SHARE * fastest_s).max(STEP_LEAST_S))
}

/// Own states of all effects along one DOF.
pub const OWN_STATES_MAX: usize = 4;

/// The one-DOF model.
#[derive(Debug)]
pub struct Single<T: Real> {
    hydrodynamics: Hydrodynamics<T>,
    mass: [T; 6],
    line: Line,
    rail: Rail<T>,
}

#[derive(Clone, Copy)]
struct State<T> {
    position: T,
    rate: T,
    own: [T; OWN_STATES_MAX],
}

/// The workspace of one run, kept from one evaluation of the slope to the next: clearing it costs more than the
/// law of one DOF.
struct Scratch<'a, T: Real> {
    effects: &'a EffectStack<T>,
    given: Option<&'a Given>,
    /// Of it, the DOF's own component is the load in force.
    load: [T; 6],
    eta: [T; 6],
    heading: (T, T),
    nu: [T; 6],
    nu_r: [T; 6],
    mass: [T; 6],
    wrench: [T; 6],
    drag: [T; 6],
    force: [T; 6],
    nu_dot: [T; 6],
}

impl<T: Real> Single<T> {
    /// The vehicle along a line.
    pub fn new(hydrodynamics: Hydrodynamics<T>, line: Line) -> Self {
        Single {
            mass: hydrodynamics.mass(),
            hydrodynamics,
            rail: Rail::of(&line),
            line,
        }
    }

    /// Runs the motion; `emit` gets what an instrument reports of the position at each stamp.
    ///
    /// A motion that grows without bounds, or effects with more than [`OWN_STATES_MAX`] own states, emit numbers that
    /// are not finite.
    pub fn run(
        &self,
        effects: &EffectStack<T>,
        feed: &Feed<'_>,
        start: (T, T),
        mut emit: impl FnMut(T),
    ) {
        let delay_s = effects.command_delay_s();
        let first = T::from_f64(feed.start_s);
        if effects.states() > OWN_STATES_MAX {
            feed.stamps_s
                .iter()
                .for_each(|_| emit(T::from_f64(f64::NAN)));
            return;
        }
        // A command of before the start is the one in force at it.
        let mut jumps: Vec<(T, Option<f64>)> = feed
            .edges
            .iter()
            .map(|(t, load)| ((T::from_f64(*t) + delay_s).max(first), Some(*load)))
            .collect();
        jumps.extend(effects.time_edges_s().into_iter().map(|t| (t, None)));
        jumps.sort_by(|a, b| a.0.value().total_cmp(&b.0.value()));
        let mut jumps = jumps
            .into_iter()
            .skip_while(|j| j.0.value() < feed.start_s)
            .peekable();
        let mut scratch = self.scratch(effects, feed.given);
        let mut state = State {
            position: start.0,
            rate: start.1,
            own: [T::zero(); OWN_STATES_MAX],
        };
        let mut stages = [state; 5];
        let mut now = first;
        let step_max_s = longest_step_s(effects.fastest_s(), feed.step_max_s);
        let mut advance = |scratch: &mut _, state: &mut _, now: &mut T, to: T| {
            self.advance(scratch, &mut stages, state, (*now, to), step_max_s);
            *now = to;
        };
        for stamp_s in feed.stamps_s {
            let seen_s = effects.scene_time_s(T::from_f64(*stamp_s), 0.0);
            while let Some((t, new)) = jumps.next_if(|j| j.0.value() <= seen_s.value()) {
                advance(&mut scratch, &mut state, &mut now, t);
                if let Some(new) = new {
                    scratch.load[self.line.dof] = T::from_f64(new);
                }
            }
            if seen_s.value() > feed.start_s {
                advance(&mut scratch, &mut state, &mut now, seen_s);
            }
            emit(if effects.measures() {
                let mut pose = self.rail.pose(state.position);
                if let Some(given) = feed.given {
                    given.put(seen_s, &mut pose, &mut scratch.nu, self.line.dof > 1);
                }
                let shown = effects.reported_pose(seen_s, effects.scene_pose(seen_s, pose));
                self.line.along(&shown)
            } else {
                state.position
            });
        }
    }

    /// Integrates `state` over an interval without edges, in equal steps of at most `step_max_s`.
    fn advance(
        &self,
        scratch: &mut Scratch<'_, T>,
        stages: &mut [State<T>; 5],
        state: &mut State<T>,
        (from, to): (T, T),
        step_max_s: f64,
    ) {
        let span = to - from;
        let count = (span.value() / step_max_s - 1e-9).ceil().max(1.0);
        let step = span * (1.0 / count);
        let half = step * 0.5;
        let sixth = step * (1.0 / 6.0);
        let states = scratch.effects.states();
        let [k1, k2, k3, k4, next] = stages;
        let stepped = |state: &State<T>, slope: &State<T>, step: T, next: &mut State<T>| {
            next.position = state.position + slope.position * step;
            next.rate = state.rate + slope.rate * step;
            for i in 0..states {
                next.own[i] = state.own[i] + slope.own[i] * step;
            }
        };
        for k in 0..count as usize {
            let t = from + step * k as f64;
            let begin = T::from_f64(t.value());
            let mut at = |t, s: &State<T>, k: &mut State<T>| self.slope(scratch, t, begin, s, k);
            let middle = t + half;
            at(t, state, k1);
            stepped(state, k1, half, next);
            at(middle, next, k2);
            stepped(state, k2, half, next);
            at(middle, next, k3);
            stepped(state, k3, step, next);
            at(t + step, next, k4);
            state.position = state.position
                + (k1.position + (k2.position + k3.position) * 2.0 + k4.position) * sixth;
            state.rate = state.rate + (k1.rate + (k2.rate + k3.rate) * 2.0 + k4.rate) * sixth;
            for i in 0..states {
                state.own[i] =
                    state.own[i] + (k1.own[i] + (k2.own[i] + k3.own[i]) * 2.0 + k4.own[i]) * sixth;
            }
        }
    }

    fn scratch<'a>(&self, effects: &'a EffectStack<T>, given: Option<&'a Given>) -> Scratch<'a, T> {
        let zero = [T::zero(); 6];
        Scratch {
            effects,
            given,
            load: zero,
            eta: self.rail.rest,
            heading: self.rail.rest[5].sin_cos(),
            nu: zero,
            nu_r: zero,
            mass: self.mass,
            wrench: zero,
            drag: zero,
            force: zero,
            nu_dot: zero,
        }
    }

    /// Time derivative into `made` (its own states only where there are any), in the order of [`crate::model::Model::rate`].
    fn slope(
        &self,
        scratch: &mut Scratch<'_, T>,
        t_s: T,
        step_start_s: T,
        state: &State<T>,
        made: &mut State<T>,
    ) {
        let h = &self.hydrodynamics;
        let i = self.line.dof;
        let Scratch {
            effects,
            given,
            load,
            eta,
            heading,
            nu,
            nu_r,
            mass,
            wrench,
            drag,
            force,
            nu_dot,
        } = scratch;
        self.rail.put(state.position, eta);
        if i == 5 {
            *heading = state.position.sin_cos();
        }
        nu[i] = state.rate;
        let companions = given.map(|g| {
            // x and y of the others are known beforehand unless they are the line itself.
            g.put(t_s, eta, nu, i > 1);
            if g.places[5].is_some() {
                *heading = eta[5].sin_cos();
            }
            g.companions_at(t_s)
        });
        let mut m = Moment {
            t_s,
            step_start_s,
            load,
            eta,
            heading,
            nu,
            nu_r: nu,
            mass: &self.mass,
            hydrodynamics: h,
            companions: companions.as_ref(),
            given: *given,
        };
        let (own, own_rate) = (&state.own, &mut made.own);
        let stateful = effects.states() > 0;
        if stateful {
            *own_rate = [T::zero(); OWN_STATES_MAX];
        }
        // Only what some law may have written into is cleared.
        let (thrusts, waters) = (effects.thrusts(), effects.waters());
        if waters {
            *drag = [T::zero(); 6];
            *force = [T::zero(); 6];
        }
        if thrusts {
            *wrench = [T::zero(); 6];
        }
        wrench[i] = load[i];
        if thrusts {
            effects.thrust(&m, wrench, own, own_rate);
        }
        if waters {
            *nu_r = *nu;
            effects.relative_velocity(&m, nu_r);
            m.nu_r = nu_r;
            *mass = self.mass;
            effects.added_mass(&m, mass);
            m.mass = mass;
        }
        drag[i] = (h.linear[i] + h.quadratic[i] * m.nu_r[i].abs()) * m.nu_r[i];
        if let 3 | 4 = i {
            let sines = [m.eta[3].sin(), m.eta[4].sin()];
            *force = equations::restoring(h, sines, T::one());
        }
        if let Some(statics) = &h.hydrostatics {
            // At rest the others may be tilted: the weight along the line is that of the whole model.
            let coupled = h.model == VehicleModel::Eq1;
            let water = equations::hydrostatics(statics, m.eta, coupled)[i];
            let cleared = waters || matches!(i, 3 | 4);
            force[i] = if cleared { force[i] + water } else { water };
        }
        if waters {
            effects.drag(&m, drag);
            effects.force(&m, own, force);
        }
        nu_dot[i] = (wrench[i] + drag[i] + force[i]) / m.mass[i];
        if stateful {
            effects.own_rate(&m, nu_dot, own, own_rate);
        }
        made.position = state.rate;
        made.rate = nu_dot[i];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::{ALL, CheckedEffect};
    use crate::fixture::lshpi_rig;
    use crate::model::{Model, ModelState};
    use crate::trajectory::Trajectory;

    const EDGES: [(f64, f64); 4] = [(0.0, 8.0), (3.017, -6.0), (6.0, 0.0), (8.5, 3.0)];

    fn typical(info: &'static crate::effect::EffectInfo) -> CheckedEffect {
        CheckedEffect {
            info,
            numbers: info.parameters.iter().map(|p| p.typical).collect(),
            words: info
                .words
                .iter()
                .map(|w| {
                    w.absent
                        .and_then(|a| w.allowed.iter().position(|x| *x == a))
                        .unwrap_or(0)
                })
                .collect(),
            trend: None,
            notes: Vec::new(),
        }
    }

    /// Every effect of the library moves one DOF as it does in the whole model.
    #[test]
    fn each_effect_acts_as_in_the_whole_model() {
        let mut vehicle = lshpi_rig().vehicle;
        vehicle.model = VehicleModel::Decoupled;
        let stamps: Vec<f64> = (0..300).map(|k| 0.006 + 0.04 * f64::from(k)).collect();
        let mut compared = 0;
        for info in ALL {
            let on = [typical(info)];
            let stack = || EffectStack::assemble(&on, |_, _, v| v).unwrap();
            let model = Model {
                hydrodynamics: Hydrodynamics::new(&vehicle),
                effects: stack(),
            };
            let mut path = Trajectory::new(model, ModelState::at_rest([0.0; 6]), 0.005).unwrap();
            for (t, load) in EDGES {
                path.command(t, [load, 0.0, 0.0, 0.0, 0.0, 0.0]).unwrap();
            }
            let single = Single::new(
                Hydrodynamics::new(&vehicle),
                Line {
                    dof: 0,
                    rest: [0.0; 6],
                },
            );
            let mut seen = Vec::new();
            let feed = Feed {
                start_s: 0.0,
                edges: &EDGES,
                stamps_s: &stamps,
                step_max_s: 0.04,
                given: None,
            };
            single.run(&stack(), &feed, (0.0, 0.0), |x| seen.push(x));
            let mut turned = 0.0_f64;
            let mut worst = 0.0_f64;
            for (stamp, x) in stamps.iter().zip(&seen) {
                let effects = &path.model().effects;
                let t = effects.scene_time_s(*stamp, 0.0);
                let eta = path.state_at(t).unwrap().vehicle.eta;
                let effects = &path.model().effects;
                let shown = effects.reported_pose(t, effects.scene_pose(t, eta));
                turned = eta[1..].iter().fold(turned, |m, v| m.max(v.abs()));
                worst = worst.max((shown[0] - x).abs());
            }
            if turned < 1e-9 {
                compared += 1;
                assert!(worst < 2e-5, "{}: {worst:.1e} m apart", info.id);
            }
        }
        assert!(compared >= 3, "{compared} effects compared");
    }

    /// Net weight and stiffness of the water in heave and roll, beside an effect in the water and without.
    #[test]
    fn a_hull_that_floats_moves_as_in_the_whole_model() {
        let mut vehicle = lshpi_rig().vehicle;
        vehicle.model = VehicleModel::Decoupled;
        vehicle.net_weight_n = 4.0;
        vehicle.stiffness = [300.0, 5.0, 5.0];
        vehicle.float_z_m = Some(-0.8);
        let stamps: Vec<f64> = (0..300).map(|k| 0.006 + 0.04 * f64::from(k)).collect();
        let beside = crate::effect::find("cubic_damping").unwrap();
        for (dof, load) in [(2, 3.0), (3, 0.2)] {
            for on in [vec![], vec![typical(beside)]] {
                let stack = || EffectStack::assemble(&on, |_, _, v| v).unwrap();
                let model = Model {
                    hydrodynamics: Hydrodynamics::new(&vehicle),
                    effects: stack(),
                };
                let mut rest = [0.0, 0.0, -0.8, 0.0, 0.0, 0.0];
                rest[dof] += 0.03;
                let mut path = Trajectory::new(model, ModelState::at_rest(rest), 0.005).unwrap();
                let mut wrench = [0.0; 6];
                wrench[dof] = load;
                path.command(1.003, wrench).unwrap();
                let single = Single::new(Hydrodynamics::new(&vehicle), Line { dof, rest });
                let feed = Feed {
                    start_s: 0.0,
                    edges: &[(1.003, load)],
                    stamps_s: &stamps,
                    step_max_s: 0.02,
                    given: None,
                };
                let mut seen = Vec::new();
                single.run(&stack(), &feed, (rest[dof], 0.0), |x| seen.push(x));
                for (stamp, x) in stamps.iter().zip(&seen) {
                    let eta = path.state_at(*stamp).unwrap().vehicle.eta;
                    assert!((eta[dof] - x).abs() < 1e-5, "{dof} at {stamp}");
                }
            }
        }
    }
}
