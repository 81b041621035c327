//! The live page between two runs.

use super::Way;
use hydroline_calib::Pose;
use hydroline_core::frame::{Frame, GreyRule};
use hydroline_daemon::bring_back::finder::Look;
use hydroline_daemon::live::outline::Scene;
use hydroline_daemon::live::{Live, picture};
use hydroline_live::State;
use hydroline_live::state;

/// The live page between the runs: the picture, with the line where it is to be, and the way in words.
pub struct Page {
    live: Live,
    rule: GreyRule,
    scene: Scene,
    start: [f64; 6],
    state: State,
}

impl Page {
    pub fn new(way: &Way<'_>, live: Live) -> Self {
        let state = State {
            mode: "record",
            title: live.title.clone(),
            ..State::default()
        };
        Self {
            live,
            rule: way.rig.grey_rule(),
            scene: Scene::new(way.rig, way.map.clone()),
            start: way.rig.tank.start_pose,
            state,
        }
    }

    /// A frame, what it gave and the line of words.
    pub fn show(&mut self, frame: &Frame, look: &Look, line: &str) {
        self.state.phase = format!("between runs: {line}; the blue line is the start's");
        self.state.frames.received += 1;
        let seen = &look.seen;
        let mut measured = [None; 6];
        let values = [(0, seen.x_m), (1, seen.y_m), (5, seen.psi_rad)];
        for (i, value) in values {
            measured[i] = value.map(|v| (v, f64::NAN));
        }
        let at_s = frame.meta.mid_exposure_ns as f64 * 1e-9;
        let pose = state::Pose::new("measured", at_s, 0.0, measured, Some(self.start));
        self.state.pose = Some(pose);
        self.live.feed.publish(self.state.clone());
        if self.live.feed.is_watched() {
            let start = self.scene.outline(&Pose::from_array(self.start));
            let shown = picture(frame, &look.profile, self.rule, Some(start));
            self.live.feed.show(shown);
        }
    }
}
