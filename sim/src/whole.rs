//! All six DOFs of the model along one run, from stamp to stamp.
//!
//! Counterpart of [`crate::single`] for six DOFs: steps never span a command edge, a law's own edge or a stamp, and all three may
//! carry derivatives. [`crate::trajectory`] answers in any order and takes late commands; this goes through once and
//! keeps nothing, at half of its cost.

use hydroline_rigs::channel::PerChannel;

use crate::given::Given;
use crate::model::{Model, ModelState};
use crate::real::Real;
use crate::single::longest_step_s;
use crate::vehicle::VehicleState;

/// Inputs of one run.
#[derive(Debug, Clone, Copy)]
pub struct Course<'a> {
    /// First instant \[s\]; the state is given there.
    pub start_s: f64,
    /// (time, body wrench \[N, N m\] from then on), ascending; 0 before the first.
    pub commands: &'a [(f64, [f64; 6])],
    /// Stamps of the measurement, ascending \[s\].
    pub stamps_s: &'a [f64],
    /// Longest RK4 step without own states \[s\].
    pub step_max_s: f64,
    /// DOFs and companions that are given instead of simulated; their knots lie at stamps.
    pub given: Option<&'a Given>,
}

/// Runs the motion; `emit` gets what instruments report at each stamp: the pose in the tank frame and the rates in the
/// body frame.
///
/// A motion that grows without bounds emits numbers that are not finite.
pub fn run<T: Real>(
    model: &Model<T>,
    course: &Course<'_>,
    start: ModelState<T>,
    mut emit: impl FnMut(PerChannel<T>),
) {
    let effects = &model.effects;
    let delay_s = effects.command_delay_s();
    let first = T::from_f64(course.start_s);
    // A command of before the start is the one in force at it.
    let mut jumps: Vec<(T, Option<[f64; 6]>)> = course
        .commands
        .iter()
        .map(|(t, wrench)| ((T::from_f64(*t) + delay_s).max(first), Some(*wrench)))
        .collect();
    let own = effects.time_edges_s().into_iter();
    jumps.extend(
        own.map(|t| (t, None))
            .filter(|j| j.0.value() > course.start_s),
    );
    jumps.sort_by(|a, b| a.0.value().total_cmp(&b.0.value()));
    let mut jumps = jumps.into_iter().peekable();
    let step_s = longest_step_s(effects.fastest_s(), course.step_max_s);
    let (mut now, mut state, mut wrench) = (first, start, [T::zero(); 6]);
    for stamp_s in course.stamps_s {
        let seen_s = effects.scene_time_s(T::from_f64(*stamp_s), 0.0);
        while let Some((t, new)) = jumps.next_if(|j| j.0.value() <= seen_s.value()) {
            advance(model, &mut state, (now, t), &wrench, step_s, course.given);
            now = t;
            if let Some(new) = new {
                wrench = new.map(T::from_f64);
            }
        }
        if seen_s.value() > course.start_s {
            advance(
                model,
                &mut state,
                (now, seen_s),
                &wrench,
                step_s,
                course.given,
            );
            now = seen_s;
        }
        if let Some(given) = course.given {
            let VehicleState { eta, nu } = &mut state.vehicle;
            given.put(seen_s, eta, nu, false);
        }
        let pose = effects.reported_pose(seen_s, effects.scene_pose(seen_s, state.vehicle.eta));
        emit(PerChannel::of_state(pose, state.vehicle.nu));
    }
}

fn advance<T: Real>(
    model: &Model<T>,
    state: &mut ModelState<T>,
    (from, to): (T, T),
    wrench: &[T; 6],
    step_max_s: f64,
    given: Option<&Given>,
) {
    let span = to - from;
    let count = (span.value() / step_max_s - 1e-9).ceil().max(1.0);
    let step = span * (1.0 / count);
    model.step(state, (from, step), count as usize, wrench, given);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::{ALL, CheckedEffect, EffectStack};
    use crate::fixture::lshpi_rig;
    use crate::trajectory::Trajectory;
    use crate::vehicle::Hydrodynamics;

    /// Every effect moves the vehicle as it does in the simulator, command edges off the grid included.
    #[test]
    fn each_effect_acts_as_in_the_simulator() {
        let vehicle = lshpi_rig().vehicle;
        let commands = [
            (0.0, [8.0, 3.0, 2.0, 0.3, 0.4, 0.5]),
            (3.017, [-6.0, 0.0, 2.0, 0.0, -0.4, 0.5]),
            (7.5, [0.0; 6]),
        ];
        let stamps: Vec<f64> = (0..250).map(|k| 0.006 + 0.04 * f64::from(k)).collect();
        for info in ALL {
            let on = [CheckedEffect::typical(info)];
            let model = || Model {
                hydrodynamics: Hydrodynamics::new(&vehicle),
                effects: EffectStack::assemble(&on, |_, _, v| v).unwrap(),
            };
            let start = ModelState::at_rest([0.1, 0.2, 1.0, 0.02, -0.01, 0.3]);
            let mut path = Trajectory::new(model(), start, 0.005).unwrap();
            for (t, wrench) in commands {
                path.command(t, wrench).unwrap();
            }
            let course = Course {
                start_s: 0.0,
                commands: &commands,
                stamps_s: &stamps,
                step_max_s: 0.04,
                given: None,
            };
            let mut seen = Vec::new();
            run(&model(), &course, start, |state| seen.push(state));
            for (stamp, ours) in stamps.iter().zip(&seen) {
                let effects = &path.model().effects;
                let t = effects.scene_time_s(*stamp, 0.0);
                let eta = path.state_at(t).unwrap().vehicle.eta;
                let effects = &path.model().effects;
                let shown = effects.reported_pose(t, effects.scene_pose(t, eta));
                for (c, (a, b)) in ours.iter().zip(&shown).enumerate() {
                    assert!(
                        (a - b).abs() < 2e-5,
                        "{} channel {c} at {stamp}: {a} {b}",
                        info.id
                    );
                }
            }
        }
    }
}
