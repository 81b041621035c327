//! Where the model says the vehicle is, from the commands that were really sent: the estimate of x, y and pitch while
//! thrusters push and no measured pose is there.
//!
//! Without thrust it says nothing: what a model drifts to by itself (ballast, an assumed current) is no reason to stop, and
//! thrusters that are at neutral already cannot be stopped.
//!
//! The thruster service only posts its commands; the model runs on the thread that asks for the estimate.

use super::limits::Estimate;
use hydroline_core::lock::Lock;
use hydroline_rigs::Rig;
use hydroline_sim::World;
use hydroline_thruster::CommandRecord;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

/// Commands that may wait for the next estimate: eight thrusters at 50 Hz for 20 s, where the limits are looked at
/// every 50 ms.
const WAITING: usize = 8192;

/// The rig's model, driven by the commands that left the host.
pub struct Tracker {
    post: SyncSender<Sent>,
    /// A command found no room: the model has missed it and knows nothing any more.
    missed: AtomicBool,
    model: Mutex<Model>,
    names: Vec<String>,
}

/// One command, as the model needs it.
struct Sent {
    place: usize,
    thrust_n: f64,
    /// CLOCK_MONOTONIC \[ns\]: a wall clock that is set must not move the vehicle.
    at_ns: u64,
}

struct Model {
    inbox: Receiver<Sent>,
    state: Option<State>,
}

/// Largest thrust that a rig's curve may give at the neutral pulse \[N\]: no push.
const NEUTRAL_N: f64 = 0.05;

struct State {
    world: World,
    thrust_n: Vec<f64>,
    start_ns: Option<u64>,
    last_t_s: f64,
}

impl State {
    fn t_s(&self, start_ns: u64, at_ns: u64) -> f64 {
        (at_ns.saturating_sub(start_ns) as f64 / 1e9).max(self.last_t_s)
    }

    /// False when the model diverged.
    fn take(&mut self, sent: &Sent, now_ns: u64) -> bool {
        // The vehicle is held or rests at the rig's start until something pushes it.
        if self.start_ns.is_none() && sent.thrust_n.abs() <= NEUTRAL_N {
            return true;
        }
        let start = *self.start_ns.get_or_insert(sent.at_ns.min(now_ns));
        if let Some(thrust_n) = self.thrust_n.get_mut(sent.place) {
            *thrust_n = sent.thrust_n;
        }
        let t_s = self.t_s(start, sent.at_ns);
        self.world.command_thrusts(t_s, &self.thrust_n).is_ok()
    }

    /// Whether any thruster is commanded to push.
    fn is_driven(&self) -> bool {
        self.thrust_n
            .iter()
            .any(|thrust_n| thrust_n.abs() > NEUTRAL_N)
    }
}

impl Model {
    /// Takes what was posted; `None` when there is no model (any more).
    fn up_to_date(&mut self, now_ns: u64) -> Option<&mut State> {
        for sent in self.inbox.try_iter() {
            if self
                .state
                .as_mut()
                .is_some_and(|state| !state.take(&sent, now_ns))
            {
                self.state = None;
            }
        }
        self.state.as_mut()
    }
}

impl Tracker {
    /// At the rig's start pose. A rig that cannot be simulated is not tracked.
    pub fn new(rig: &Rig) -> Self {
        let state = World::new(rig, rig.tank.start_pose)
            .ok()
            .map(|world| State {
                world,
                thrust_n: vec![0.0; rig.thrusters.thrusters.len()],
                start_ns: None,
                last_t_s: 0.0,
            });
        let (post, inbox) = sync_channel(WAITING);
        Self {
            post,
            missed: AtomicBool::new(false),
            model: Mutex::new(Model { inbox, state }),
            names: rig
                .thrusters
                .thrusters
                .iter()
                .map(|t| t.name.clone())
                .collect(),
        }
    }

    /// Puts the model at a measured pose, at rest; only while nothing has pushed it yet.
    pub fn place(&self, rig: &Rig, pose: [f64; 6]) {
        let mut model = self.model.held();
        if let Some(state) = &mut model.state
            && state.start_ns.is_none()
            && let Ok(world) = World::new(rig, pose)
        {
            state.world = world;
        }
    }

    /// Whether there is a model that has not diverged.
    pub fn is_tracking(&self) -> bool {
        !self.missed.load(Ordering::Acquire) && self.model.held().state.is_some()
    }

    /// Posts a command that was sent. Never waits: the thruster service calls it, and neither the model's arithmetic
    /// nor a lock that its reader holds may keep a command from the wire.
    pub fn command(&self, command: &CommandRecord) {
        let Some(place) = self.names.iter().position(|n| **n == *command.thruster) else {
            return;
        };
        let sent = Sent {
            place,
            thrust_n: command.thrust_n,
            at_ns: command.sent_monotonic_ns,
        };
        if self.post.try_send(sent).is_err() {
            self.missed.store(true, Ordering::Release);
        }
    }

    /// Where the vehicle should be at `at_ns`, CLOCK_MONOTONIC; nothing while no thrust is commanded.
    pub fn estimate(&self, at_ns: u64) -> Estimate {
        let mut model = self.model.held();
        if self.missed.load(Ordering::Acquire) {
            model.state = None;
        }
        let Some(state) = model.up_to_date(at_ns) else {
            return Estimate::default();
        };
        let Some(start) = state.start_ns else {
            return Estimate::default();
        };
        let t_s = state.t_s(start, at_ns);
        state.last_t_s = t_s;
        if !state.is_driven() {
            return Estimate::default();
        }
        let Ok(vehicle) = state.world.state_at(t_s) else {
            model.state = None;
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

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_plan::setpoint::setpoint;
    use hydroline_rigs::Plan;
    use hydroline_sim::Allocation;
    use std::sync::Arc;

    const START_NS: u64 = 77_000_000_000;

    /// The first set of the paper's 4 N surge run.
    fn commands(rig: &Rig) -> Vec<CommandRecord> {
        let plan = Plan::builtin("surge-4n").unwrap();
        let set = setpoint(rig, &Allocation::new(&rig.thrusters).unwrap(), &plan, 0.0).unwrap();
        let thrusters = rig.thrusters.thrusters.iter();
        thrusters
            .zip(set.thrust_n.iter().zip(&set.pulses_us))
            .map(|(thruster, (thrust_n, pulse_us))| CommandRecord {
                timestamp_ns: 0,
                sent_monotonic_ns: START_NS,
                sequence: 1,
                thruster: Arc::from(thruster.name.as_str()),
                thrust_n: *thrust_n,
                pulse_us: *pulse_us,
                due_ns: 0,
                plan_step: 1,
                cause: "plan",
            })
            .collect()
    }

    #[test]
    fn the_model_follows_what_was_posted() {
        let rig = Rig::builtin("lshpi").unwrap();
        let tracker = Tracker::new(&rig);
        assert_eq!(tracker.estimate(START_NS), Estimate::default());
        for command in commands(&rig) {
            tracker.command(&command);
        }
        let x = |t_s: u64| {
            tracker
                .estimate(START_NS + t_s * 1_000_000_000)
                .x_m
                .unwrap()
        };
        let (early, late) = (x(1), x(6));
        assert!(late - early > 0.05, "{early} .. {late}");
    }

    #[test]
    fn the_model_starts_where_the_vehicle_is_measured() {
        let rig = Rig::builtin("lshpi").unwrap();
        let tracker = Tracker::new(&rig);
        let mut measured = rig.tank.start_pose;
        measured[0] += 0.5;
        tracker.place(&rig, measured);
        for command in commands(&rig) {
            tracker.command(&command);
        }
        let x_m = || tracker.estimate(START_NS + 100_000_000).x_m.unwrap();
        assert!((x_m() - measured[0]).abs() < 1e-3, "{}", x_m());
        // What is on its way is not put elsewhere.
        tracker.place(&rig, rig.tank.start_pose);
        assert!((x_m() - measured[0]).abs() < 1e-3, "{}", x_m());
    }

    #[test]
    fn a_model_that_nothing_pushes_says_nothing_however_it_drifts() {
        let rig = Rig::builtin("lshpi").unwrap();
        let tracker = Tracker::new(&rig);
        let minute_ns = 60_000_000_000;
        let neutral: Vec<_> = commands(&rig)
            .into_iter()
            .map(|c| CommandRecord {
                thrust_n: 0.0,
                cause: "neutral",
                ..c
            })
            .collect();
        for command in &neutral {
            tracker.command(command);
        }
        assert_eq!(tracker.estimate(START_NS + minute_ns), Estimate::default());
        // A plan a minute later starts at the rig's start, not where the model had drifted to ...
        let later = |c: &CommandRecord| CommandRecord {
            sent_monotonic_ns: c.sent_monotonic_ns + minute_ns,
            ..c.clone()
        };
        for command in &commands(&rig) {
            tracker.command(&later(command));
        }
        let [.., z, _, _, _] = rig.tank.start_pose;
        let at = tracker.estimate(START_NS + minute_ns + 100_000_000);
        assert!((at.z_m.unwrap() - z).abs() < 1e-3, "{at:?}");
        // ... and with the neutral after it the model is silent again.
        for command in &neutral {
            tracker.command(&CommandRecord {
                sent_monotonic_ns: later(command).sent_monotonic_ns + 1_000_000_000,
                ..command.clone()
            });
        }
        assert_eq!(
            tracker.estimate(START_NS + minute_ns + 2_000_000_000),
            Estimate::default()
        );
    }

    #[test]
    fn posting_does_not_wait_for_who_holds_the_model() {
        let rig = Rig::builtin("lshpi").unwrap();
        let tracker = Tracker::new(&rig);
        // An analysis that holds the model for ever: with a lock in the way this test would never end.
        let held = tracker.model.held();
        let set = commands(&rig);
        for command in set.iter().cycle().take(2 * WAITING) {
            tracker.command(command);
        }
        drop(held);
        // Twice as many as there is room for: the model has missed some, and no longer claims to know.
        assert!(!tracker.is_tracking());
        assert_eq!(tracker.estimate(START_NS), Estimate::default());
    }
}
