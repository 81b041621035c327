//! Where the plan should have taken the vehicle: the rig's model from the rig's start, driven by the commands that were
//! sent, with what it said in the last seconds, for poses take some tenths of a second to be fitted.

use hydroline_rigs::{Rig, Wrench};
use hydroline_sim::{VehicleState, World};
use std::collections::VecDeque;

/// Largest thrust that a rig's curve may give at the neutral pulse \[N\]: no push.
const NEUTRAL_N: f64 = 0.05;
/// Kept \[ns\]: a pose older than this is not compared any more. On a busy computer one takes many seconds to fit.
const KEPT_NS: u64 = 60_000_000_000;

/// The model beside the run.
pub struct Prediction {
    /// `None` for a rig that cannot be simulated, or after the model diverged.
    world: Option<World>,
    thrust_n: Vec<f64>,
    start_pose: [f64; 6],
    start_ns: Option<u64>,
    last_t_s: f64,
    past: VecDeque<(u64, [f64; 6])>,
}

/// State of the model now, and the wrench on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Pose and velocity.
    pub state: VehicleState,
    /// Wrench of the thrusts that were sent, surge to yaw \[N, N m\].
    pub wrench: [f64; 6],
}

impl Prediction {
    /// At the rig's start.
    pub fn new(rig: &Rig) -> Self {
        Self {
            world: World::new(rig, rig.tank.start_pose).ok(),
            thrust_n: vec![0.0; rig.thrusters.thrusters.len()],
            start_pose: rig.tank.start_pose,
            start_ns: None,
            last_t_s: 0.0,
            past: VecDeque::new(),
        }
    }

    /// A command to the thruster at `place` that was sent at `at_ns`. Time begins with the first that pushes.
    pub fn command(&mut self, place: usize, thrust_n: f64, at_ns: u64) {
        if self.start_ns.is_none() && thrust_n.abs() <= NEUTRAL_N {
            return;
        }
        let start_ns = *self.start_ns.get_or_insert(at_ns);
        if let Some(slot) = self.thrust_n.get_mut(place) {
            *slot = thrust_n;
        }
        let t_s = self.t_s(start_ns, at_ns);
        let taken = self
            .world
            .as_mut()
            .map(|w| w.command_thrusts(t_s, &self.thrust_n));
        if taken.is_some_and(|t| t.is_err()) {
            self.world = None;
        }
    }

    fn t_s(&self, start_ns: u64, at_ns: u64) -> f64 {
        (at_ns.saturating_sub(start_ns) as f64 * 1e-9).max(self.last_t_s)
    }

    /// Up to `now_ns`; `None` without a model.
    pub fn advance(&mut self, now_ns: u64) -> Option<Motion> {
        let state = match self.start_ns {
            None => VehicleState::at_rest(self.start_pose),
            Some(start_ns) => {
                let t_s = self.t_s(start_ns, now_ns);
                match self.world.as_mut()?.state_at(t_s) {
                    Ok(state) => {
                        self.last_t_s = t_s;
                        state
                    }
                    Err(_) => {
                        self.world = None;
                        self.past.clear();
                        return None;
                    }
                }
            }
        };
        self.past.push_back((now_ns, state.eta));
        while self
            .past
            .front()
            .is_some_and(|(at_ns, _)| now_ns.saturating_sub(*at_ns) > KEPT_NS)
        {
            self.past.pop_front();
        }
        let wrench = self
            .world
            .as_ref()?
            .allocation()
            .wrench(&self.thrust_n)
            .ok()?;
        Some(Motion {
            state,
            wrench: components(&wrench),
        })
    }

    /// Where the vehicle was to be at `at_ns`: the start until it is pushed, linear between two looks, nothing after the
    /// last.
    pub fn at(&self, at_ns: u64) -> Option<[f64; 6]> {
        self.world.as_ref()?;
        if self.start_ns.is_none_or(|start_ns| at_ns <= start_ns) {
            return Some(self.start_pose);
        }
        let after = self.past.iter().position(|(t, _)| *t >= at_ns)?;
        let (t1, b) = self.past[after];
        let (t0, a) = self.past[after.checked_sub(1)?];
        let part = (at_ns - t0) as f64 / (t1 - t0).max(1) as f64;
        Some(std::array::from_fn(|i| a[i] + part * (b[i] - a[i])))
    }
}

/// Surge to yaw.
pub fn components(w: &Wrench) -> [f64; 6] {
    [
        w.surge_n, w.sway_n, w.heave_n, w.roll_nm, w.pitch_nm, w.yaw_nm,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;

    #[test]
    fn it_rests_at_the_start_until_pushed_and_then_goes_as_the_model_does() {
        let rig = Rig::builtin("lshpi").unwrap();
        let mut prediction = Prediction::new(&rig);
        let x0 = rig.tank.start_pose[0];
        prediction.command(0, 0.0, 5 * S);
        prediction.advance(6 * S).unwrap();
        assert_eq!(prediction.at(6 * S).unwrap()[0], x0);
        // Every level thruster ahead: surge.
        for place in 0..4 {
            prediction.command(place, 2.0, 7 * S);
        }
        let mut world = World::new(&rig, rig.tank.start_pose).unwrap();
        world
            .command_thrusts(0.0, &[2.0, 2.0, 2.0, 2.0, 0.0, 0.0, 0.0, 0.0])
            .unwrap();
        let mut motion = None;
        for k in 1..=40 {
            motion = prediction.advance(7 * S + k * S / 10);
        }
        let motion = motion.unwrap();
        let exact = world.state_at(4.0).unwrap();
        assert!((motion.state.eta[0] - exact.eta[0]).abs() < 1e-9);
        assert!(motion.wrench[0] > 5.0 && motion.wrench[1].abs() < 1e-9);
        let between = prediction.at(7 * S + 2 * S + S / 20).unwrap()[0];
        let exact = world.state_at(2.05).unwrap().eta[0];
        assert!((between - exact).abs() < 1e-4, "{between} {exact}");
        assert_eq!(prediction.at(20 * S), None, "nothing of what is to come");
        assert_eq!(prediction.at(S), Some(rig.tank.start_pose));
    }
}
