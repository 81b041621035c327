//! What an autopilot that drives the thrusters and hydroline, which listens, agree on.

use crate::raw::{Kind, Section, whole, words};

/// What begins and ends a recording, besides the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RecordOn {
    /// The start of the program.
    #[default]
    Start,
    /// Arming, and disarming.
    Arming,
    /// MAV_CMD_LOGGING_START or MAV_CMD_VIDEO_START_CAPTURE to hydroline's component, and the STOP of the same.
    Command,
    /// The mission item `mission_first`, and the one after `mission_last`.
    Mission,
}

table! {
    /// An autopilot that speaks MAVLink (ArduSub, PX4) and drives the thrusters.
    pub struct Mavlink as MavlinkTyped, checked by in_order {
        /// What begins and ends a recording.
        pub record_on: RecordOn = words([
            ("start", RecordOn::Start),
            ("arming", RecordOn::Arming),
            ("command", RecordOn::Command),
            ("mission", RecordOn::Mission),
        ]).or_said(RecordOn::Start, "`\"start\"`"),
        /// First mission item that is recorded, with `record_on = "mission"`.
        pub mission_first: u16 = whole(0, 65_535, "").or(1),
        /// Last mission item that is recorded.
        pub mission_last: u16 = whole(0, 65_535, "").or(65_535),
    }
}

impl Default for Mavlink {
    fn default() -> Self {
        Self {
            record_on: RecordOn::Start,
            mission_first: 1,
            mission_last: u16::MAX,
        }
    }
}

fn in_order(typed: &mut MavlinkTyped, s: &Section<'_>) {
    if let (Some(first), Some(last)) = (typed.mission_first, typed.mission_last)
        && first > last
    {
        s.rule(
            "mission_first",
            format!("mission_first = {first} lies after mission_last = {last}"),
            "Swap them",
        );
    }
}
