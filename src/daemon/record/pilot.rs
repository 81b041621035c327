//! The autopilot's side of a recording: what it says into the log, what its pilot hears, when it ends.

use super::Shared;
use hydroline_core::event::{Severity, kind};
use hydroline_core::shutdown::StopReason;
use hydroline_log::messages::{pb, timestamp};
use hydroline_log::{Entry, Recorder};
use hydroline_thruster::mavlink::{Content, Motion, State};
use hydroline_thruster::record::HeardRecord;

/// Period of the words for the pilot while nothing changes \[ns\]: a ground station keeps and speaks each of them.
const WORDS_NS: u64 = 30_000_000_000;

/// Logs what the autopilot says.
pub(super) fn log(recorder: &Recorder, heard: &HeardRecord) {
    let stamp = Some(timestamp(heard.timestamp_ns));
    match &heard.what {
        // Written as commands by the service.
        Content::Outputs(_) => {}
        Content::Motion(motion) => {
            recorder.push(Entry::autopilot_motion(&pb::VehicleMotion {
                timestamp: stamp,
                ..motion_message(motion)
            }));
        }
        Content::State(state) => {
            recorder.push(Entry::autopilot_state(&pb::AutopilotState {
                timestamp: stamp,
                autopilot_time_us: heard.autopilot_us,
                ..state_message(state)
            }));
        }
    }
}

fn motion_message(motion: &Motion) -> pb::VehicleMotion {
    let axis = |of: Option<[f64; 3]>, i: usize| of.map(|v| v[i]);
    pb::VehicleMotion {
        z_m: motion.depth_m,
        phi_rad: axis(motion.attitude_rad, 0),
        theta_rad: axis(motion.attitude_rad, 1),
        psi_rad: axis(motion.attitude_rad, 2),
        p_radps: axis(motion.rates_radps, 0),
        q_radps: axis(motion.rates_radps, 1),
        r_radps: axis(motion.rates_radps, 2),
        ..pb::VehicleMotion::default()
    }
}

fn state_message(state: &State) -> pb::AutopilotState {
    let axis = |of: Option<[f64; 3]>, i: usize| of.map(|v| v[i]);
    pb::AutopilotState {
        message: state.message.to_owned(),
        armed: state.armed,
        mode: state.mode,
        battery_v: state.battery_v,
        battery_a: state.battery_a,
        esc_first: state.esc_first,
        esc_rpm: state.esc_rpm.clone(),
        esc_v: state.esc_v.clone(),
        esc_a: state.esc_a.clone(),
        north_m: axis(state.place_ned_m, 0),
        east_m: axis(state.place_ned_m, 1),
        down_m: axis(state.place_ned_m, 2),
        north_mps: axis(state.velocity_ned_mps, 0),
        east_mps: axis(state.velocity_ned_mps, 1),
        down_mps: axis(state.velocity_ned_mps, 2),
        ..pb::AutopilotState::default()
    }
}

/// The autopilot's side begins or ends the recording; its end is the recording's.
pub(super) fn recording(shared: &Shared, on: bool) {
    let words = if on { "begins" } else { "ends" };
    let words =
        format!("the autopilot's side {words} the recording (thrusters.link.mavlink.record_on)");
    shared.say(Severity::Info, &kind::AUTOPILOT_RECORDING, words);
    if !on {
        shared.shutdown.raise(StopReason::Finished);
    }
}

/// State of a recording for the pilot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct News {
    pub now_ns: u64,
    pub frames: u64,
    /// Frames lost by the camera or the log.
    pub lost: u64,
    /// Whether the target is seen; `None` = no poses are measured.
    pub in_sight: Option<bool>,
}

/// Words for the pilot: at the begin, at each change, else now and then.
#[derive(Debug, Default)]
pub(super) struct Pilot {
    /// At the last look, and at the last words.
    last: Option<(News, News)>,
}

impl Pilot {
    /// Words that are due; asked about once a second.
    pub(super) fn words(&mut self, news: &News) -> Option<String> {
        let Some((looked, said)) = self.last.replace((*news, *news)) else {
            return (news.frames > 0)
                .then(|| "recording".to_owned())
                .or_else(|| {
                    self.last = None;
                    None
                });
        };
        let is_due = news.now_ns.saturating_sub(said.now_ns) >= WORDS_NS
            || news.lost > said.lost
            || news.in_sight != said.in_sight;
        if !is_due {
            self.last = Some((*news, said));
            return None;
        }
        let for_s = news.now_ns.saturating_sub(looked.now_ns) as f64 * 1e-9;
        let rate_fps = (news.frames - looked.frames) as f64 / for_s.max(1e-3);
        let sight = match news.in_sight {
            Some(true) => "; target in sight",
            Some(false) => "; no target",
            None => "",
        };
        Some(format!(
            "recording, {rate_fps:.0} fps, {} lost{sight}",
            news.lost
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pilot_hears_of_begin_loss_and_sight_and_is_not_flooded() {
        let news = |s: u64, lost: u64, in_sight| News {
            now_ns: s * 1_000_000_000,
            frames: 25 * s,
            lost,
            in_sight: Some(in_sight),
        };
        let mut pilot = Pilot::default();
        assert_eq!(pilot.words(&news(0, 0, false)), None, "no frame yet");
        assert_eq!(
            pilot.words(&news(1, 0, false)).as_deref(),
            Some("recording")
        );
        let heard: Vec<(u64, String)> = (2..40)
            .filter_map(|s| Some((s, pilot.words(&news(s, u64::from(s >= 6), s >= 4))?)))
            .collect();
        let words = [
            (4, "recording, 25 fps, 0 lost; target in sight"),
            (6, "recording, 25 fps, 1 lost; target in sight"),
            (36, "recording, 25 fps, 1 lost; target in sight"),
        ];
        assert_eq!(heard, words.map(|(s, words)| (s, words.to_owned())));
        assert!(
            heard.iter().all(|(_, words)| words.len() <= 50),
            "STATUSTEXT"
        );
    }
}
