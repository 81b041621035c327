//! The live page of work that does not keep to the clock (`simulate`, `replay`): shown a few times a second, however fast
//! or slow the work is.

use super::outline::Scene;
use super::prediction::Prediction;
use super::{Live, picture, thrusters};
use hydroline_calib::Pose;
use hydroline_calib::plane::PlaneMap;
use hydroline_core::frame::{Frame, GreyRule};
use hydroline_live::State;
use hydroline_live::state;
use hydroline_log::messages::{
    self,
    pb::{Event, StripeProfile, ThrusterCommand, ThrusterEcho, VehicleMotion},
    unix_ns,
};
use hydroline_rigs::Rig;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Between two states, and between two pictures.
const PERIOD: Duration = Duration::from_millis(100);

/// Live page of such work.
pub struct Unhurried {
    live: Live,
    state: State,
    rule: GreyRule,
    scene: Option<Scene>,
    rig: Option<Rig>,
    pose: Option<Pose>,
    /// Of the commands, where a plan is known.
    prediction: Option<Prediction>,
    /// Newest time that the prediction has been asked for, UNIX \[ns\].
    predicted_ns: u64,
    first_ns: Option<u64>,
    shown: Option<Instant>,
    pictured: Option<Instant>,
}

impl Unhurried {
    /// `rig` and `map` where they are known: without them there are no loads and no outline.
    pub fn new(
        live: &Live,
        mode: &'static str,
        rule: GreyRule,
        rig: Option<&Rig>,
        map: Option<Arc<dyn PlaneMap>>,
    ) -> Self {
        let state = State {
            mode,
            title: live.title.clone(),
            phase: format!("{mode} is running"),
            thrusters: rig.map(thrusters).unwrap_or_default(),
            ..State::default()
        };
        live.feed.publish(state.clone());
        Self {
            live: live.clone(),
            state,
            rule,
            scene: rig.zip(map).map(|(rig, map)| Scene::new(rig, map)),
            rig: rig.cloned(),
            pose: None,
            prediction: None,
            predicted_ns: 0,
            first_ns: None,
            shown: None,
            pictured: None,
        }
    }

    /// Whether a picture is wanted now: somebody looks, and the last one is old enough.
    pub fn wants_picture(&self) -> bool {
        self.live.feed.is_watched() && self.pictured.is_none_or(|at| at.elapsed() >= PERIOD)
    }

    /// A frame with its stripe.
    pub fn frame(&mut self, frame: &Frame, profile: &StripeProfile) {
        if !self.wants_picture() {
            return;
        }
        self.pictured = Some(Instant::now());
        self.state.frames.points = profile.row_px.len() as u64;
        let outline = self
            .scene
            .as_ref()
            .zip(self.pose)
            .map(|(s, pose)| s.outline(&pose));
        self.live
            .feed
            .show(picture(frame, profile, self.rule, outline));
    }

    /// A pose of the run.
    pub fn motion(&mut self, kind: &'static str, motion: &VehicleMotion) {
        let values = motion.channels().pose();
        let sd = |i: usize| motion.covariance.get(7 * i).map_or(f64::NAN, |v| v.sqrt());
        let measured = std::array::from_fn(|i| values[i].map(|value| (value, sd(i))));
        let stamp_ns = motion.timestamp.as_ref().map_or(0, unix_ns);
        self.predict_to(stamp_ns);
        let predicted = self.prediction.as_ref().and_then(|p| p.at(stamp_ns));
        self.state.pose = Some(state::Pose::new(
            kind,
            stamp_ns as f64 * 1e-9,
            0.0,
            measured,
            predicted,
        ));
        let start = self.rig.as_ref().map_or([0.0; 6], |r| r.tank.start_pose);
        self.pose = Some(Pose::from_array(std::array::from_fn(|i| {
            values[i].unwrap_or(start[i])
        })));
    }

    /// The prediction up to a time of the run; poses may come after commands that are younger.
    fn predict_to(&mut self, at_ns: u64) {
        if let Some(prediction) = &mut self.prediction
            && at_ns > self.predicted_ns
        {
            self.predicted_ns = at_ns;
            prediction.advance(at_ns);
        }
    }

    /// A command of the run.
    pub fn command(&mut self, command: &ThrusterCommand) {
        self.state.run.step = command.plan_step;
        let at_ns = command.timestamp.as_ref().map_or(0, unix_ns);
        self.predict_to(at_ns);
        let mut thrusters = self.state.thrusters.iter();
        let place = thrusters.position(|t| t.name == command.thruster);
        if let Some((prediction, place)) = self.prediction.as_mut().zip(place) {
            prediction.command(place, command.thrust_n, at_ns);
        }
        if let Some(thruster) = place.map(|place| &mut self.state.thrusters[place]) {
            thruster.thrust_n = Some(command.thrust_n);
            thruster.pulse_us = Some(command.pulse_us);
        }
    }

    /// An echo of the run.
    pub fn echo(&mut self, echo: &ThrusterEcho) {
        let curves = self.rig.as_ref().map(|r| &r.thrusters.thrusters);
        let curve = curves.and_then(|t| t.iter().find(|t| t.name == echo.thruster));
        if let Some(thruster) = self
            .state
            .thrusters
            .iter_mut()
            .find(|t| t.name == echo.thruster)
        {
            thruster.echo_us = Some(echo.pulse_us);
            thruster.echo_n = curve.map(|t| t.curve.thrust_n(echo.pulse_us));
        }
    }

    /// Something that happened in the run.
    pub fn event(&mut self, event: &Event) {
        let stamp_ns = event.timestamp.as_ref().map_or(0, unix_ns);
        let severity = messages::event_severity(event);
        let event = state::Event::new(stamp_ns, severity, &event.kind, &event.message);
        state::keep(&mut self.state.events, event);
    }

    /// So many frames are done, the newest of them true at `stamp_ns` (UNIX); of so many, where that is known.
    pub fn done(&mut self, frames: u64, stamp_ns: u64, of: Option<u64>) {
        if self.shown.is_some_and(|at| at.elapsed() < PERIOD) {
            return;
        }
        self.shown = Some(Instant::now());
        let first_ns = *self.first_ns.get_or_insert(stamp_ns);
        let elapsed_s = stamp_ns.saturating_sub(first_ns) as f64 * 1e-9;
        self.state.frames.received = frames;
        self.state.run.elapsed_s = Some(elapsed_s);
        self.state.run.length_s = of
            .filter(|_| frames > 1)
            .map(|n| elapsed_s * n as f64 / frames as f64);
        self.live.feed.publish(self.state.clone());
    }

    /// The name and the number of steps of the plan: from here on poses are held against the rig's model under the
    /// run's commands.
    pub fn plan(&mut self, name: &str, steps: u32) {
        self.state.run.plan = Some(name.to_owned());
        self.state.run.steps = steps;
        self.prediction = self.rig.as_ref().map(Prediction::new);
    }

    /// The work is over.
    pub fn end(mut self, words: &str) {
        self.state.phase = words.to_owned();
        self.state.ended = true;
        self.live.feed.publish(self.state);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_live::Feed;
    use hydroline_log::messages::timestamp;
    use hydroline_sim::World;

    const S: u64 = 1_000_000_000;
    const START_NS: u64 = 1_700_000_000 * S;

    fn motion(at_ns: u64, x_m: f64) -> VehicleMotion {
        VehicleMotion {
            timestamp: Some(timestamp(at_ns)),
            x_m: Some(x_m),
            ..VehicleMotion::default()
        }
    }

    #[test]
    fn a_pose_is_held_against_the_plan_where_there_is_one_also_when_it_comes_late() {
        let rig = Rig::builtin("lshpi").unwrap();
        let live = Live {
            feed: Arc::new(Feed::new(false)),
            title: String::new(),
            log: std::path::PathBuf::new(),
        };
        let rule = rig.grey_rule();
        let mut shown = Unhurried::new(&live, "replay", rule, Some(&rig), None);
        let x = |shown: &Unhurried| shown.state.pose.as_ref().unwrap().channels[0].clone();
        shown.motion("fitted", &motion(START_NS, 0.1));
        assert_eq!(x(&shown).predicted, None, "no plan");
        shown.plan("surge", 1);
        shown.motion("fitted", &motion(START_NS, 0.1));
        assert_eq!(x(&shown).predicted, Some(rig.tank.start_pose[0]));
        // Two seconds ahead, commanded at 50 Hz.
        for k in 0..100 {
            for t in &rig.thrusters.thrusters[..4] {
                shown.command(&ThrusterCommand {
                    timestamp: Some(timestamp(START_NS + k * S / 50)),
                    thruster: t.name.clone(),
                    thrust_n: 2.0,
                    ..ThrusterCommand::default()
                });
            }
        }
        let mut world = World::new(&rig, rig.tank.start_pose).unwrap();
        world
            .command_thrusts(0.0, &[2.0, 2.0, 2.0, 2.0, 0.0, 0.0, 0.0, 0.0])
            .unwrap();
        // A pose that was fitted after later commands had come, and one of now.
        let at_1 = world.state_at(1.0).unwrap().eta[0];
        let at_2 = world.state_at(2.0).unwrap().eta[0];
        for (t_s, exact) in [(1, at_1), (2, at_2)] {
            shown.motion("fitted", &motion(START_NS + t_s * S, exact + 0.01));
            let residual = x(&shown).residual.unwrap();
            assert!((residual - 0.01).abs() < 1e-4, "{t_s} s: {residual}");
        }
    }
}
