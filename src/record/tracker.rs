//! Where the model says the vehicle is, from the commands that were really sent: the only estimate of
//! x, y and pitch while running until a pose estimator reads the target.

use super::limits::Estimate;
use crate::clock::ClockTriple;
use crate::thruster::CommandRecord;
use hydroline_rigs::Rig;
use hydroline_sim::World;
use std::sync::{Mutex, PoisonError};

/// The rig's model, driven by the commands that left the host.
pub struct Tracker {
    state: Mutex<Option<State>>,
    names: Vec<String>,
}

struct State {
    world: World,
    thrust_n: Vec<f64>,
    start_unix_ns: Option<u64>,
    last_t_s: f64,
}

impl Tracker {
    /// At the rig's start pose. A rig that cannot be simulated is not tracked.
    pub fn new(rig: &Rig) -> Self {
        let state = World::new(rig, rig.tank.start_pose)
            .ok()
            .map(|world| State {
                world,
                thrust_n: vec![0.0; rig.thrusters.thrusters.len()],
                start_unix_ns: None,
                last_t_s: 0.0,
            });
        Self {
            state: Mutex::new(state),
            names: rig
                .thrusters
                .thrusters
                .iter()
                .map(|t| t.name.clone())
                .collect(),
        }
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Option<State>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether there is a model that has not diverged.
    pub fn is_tracking(&self) -> bool {
        self.lock().is_some()
    }

    /// Takes a command that was sent.
    pub fn command(&self, command: &CommandRecord, now: &ClockTriple) {
        let Some(place) = self.names.iter().position(|n| **n == *command.thruster) else {
            return;
        };
        let mut slot = self.lock();
        let Some(state) = slot.as_mut() else { return };
        let start = *state
            .start_unix_ns
            .get_or_insert(command.timestamp_ns.min(now.realtime_ns));
        let t_s = (command.timestamp_ns.saturating_sub(start) as f64 / 1e9).max(state.last_t_s);
        if let Some(thrust_n) = state.thrust_n.get_mut(place) {
            *thrust_n = command.thrust_n;
        }
        let thrust_n = state.thrust_n.clone();
        if state.world.command_thrusts(t_s, &thrust_n).is_err() {
            *slot = None; // a model that diverged says nothing any more
        }
    }

    /// Where the vehicle should be at `unix_ns`; nothing before the first command.
    pub fn estimate(&self, unix_ns: u64) -> Estimate {
        let mut slot = self.lock();
        let Some(state) = slot.as_mut() else {
            return Estimate::default();
        };
        let Some(start) = state.start_unix_ns else {
            return Estimate::default();
        };
        let t_s = (unix_ns.saturating_sub(start) as f64 / 1e9).max(state.last_t_s);
        state.last_t_s = t_s;
        let Ok(vehicle) = state.world.state_at(t_s) else {
            *slot = None;
            return Estimate::default();
        };
        let [x, y, z, phi, theta, _] = vehicle.eta.map(Some);
        Estimate {
            x_m: x,
            y_m: y,
            z_m: z,
            phi_rad: phi,
            theta_rad: theta,
        }
    }
}
