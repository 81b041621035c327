//! The follower against the simulated autopilot, in simulated time, and the frames against foreign bytes.

mod service;

use super::autopilot::{AutopilotConfig, SimAutopilot, Truth};
use super::follow::{COMPONENT, Follower};
use super::frame::Deframer;
use super::{Content, Heard};
use crate::link::LinkEvent;
use hydroline_rigs::{Mavlink, RecordOn};
use mavlink::dialects::ardupilotmega::{ATTITUDE_DATA, MavCmd};
use std::f64::consts::TAU;

const MS: u64 = 1_000_000;
const S: u64 = 1_000_000_000;

/// Output 1 steps once a second, roll swings, depth grows.
fn law(t_s: f64) -> Truth {
    let turn = TAU * 0.2 * t_s;
    Truth {
        pulses_us: [
            1500 + 10 * (t_s as u16 % 20),
            1500,
            1500,
            1500,
            1500,
            1500,
            0,
            0,
        ],
        attitude_rad: [turn.sin() as f32, 0.0, 1.0],
        rates_radps: [(TAU * 0.2 * turn.cos()) as f32, 0.0, 0.0],
        depth_m: 0.01 * t_s,
    }
}

struct Line {
    autopilot: SimAutopilot,
    follower: Follower,
    now_ns: u64,
    events: Vec<LinkEvent>,
}

impl Line {
    fn new(config: AutopilotConfig, settings: Mavlink) -> Self {
        let mut follower = Follower::new(settings, 50.0);
        follower.opened(0);
        Self {
            autopilot: SimAutopilot::new(config, Box::new(law)),
            follower,
            now_ns: 0,
            events: Vec::new(),
        }
    }

    /// Runs in steps of a fifth of a millisecond.
    fn run(&mut self, for_ns: u64) {
        let end_ns = self.now_ns + for_ns;
        let (mut out, mut datagrams) = (Vec::new(), Vec::new());
        while self.now_ns < end_ns {
            self.now_ns += MS / 5;
            out.clear();
            self.follower.housekeeping(self.now_ns, &mut out);
            if !out.is_empty() {
                self.follower.sent(self.now_ns);
                self.autopilot.receive(self.now_ns, &out);
            }
            self.autopilot.poll(self.now_ns, &mut datagrams);
            for bytes in datagrams.drain(..) {
                self.follower.receive(&bytes, self.now_ns, &mut self.events);
            }
        }
    }

    fn heard(&self) -> impl Iterator<Item = &Heard> {
        self.events.iter().filter_map(|e| match e {
            LinkEvent::Heard(heard) => Some(heard),
            _ => None,
        })
    }

    /// Errors of the stamps of outputs heard after `from_ns` \[ms\].
    fn stamp_errors_ms(&self, from_ns: u64) -> Vec<f64> {
        let truth = self.autopilot.outputs();
        let of_output =
            |h: &&Heard| matches!(h.what, Content::Outputs(_)) && h.received_ns > from_ns;
        let error = |h: &Heard| {
            // One wrap in reserve: the low 32 bits are the autopilot's own.
            let sent = truth
                .iter()
                .find(|(us, _)| *us as u32 == h.autopilot_us as u32)
                .unwrap();
            (h.at_ns as f64 - sent.1 as f64) * 1e-6
        };
        self.heard().filter(of_output).map(error).collect()
    }

    fn recordings(&self) -> Vec<bool> {
        let on = |e: &LinkEvent| match e {
            LinkEvent::Recording { on } => Some(*on),
            _ => None,
        };
        self.events.iter().filter_map(on).collect()
    }
}

#[test]
fn outputs_and_motion_come_at_the_rate_asked_for_with_their_values() {
    let mut line = Line::new(AutopilotConfig::default(), Mavlink::default());
    line.run(4 * S);
    let outputs: Vec<_> = line
        .heard()
        .filter(|h| matches!(h.what, Content::Outputs(_)))
        .collect();
    assert!((190..=201).contains(&outputs.len()), "{}", outputs.len());
    for heard in &outputs {
        let Content::Outputs(pulses) = &heard.what else {
            unreachable!()
        };
        assert_eq!(pulses.len(), 6, "an output at 0 is not used");
        assert!(
            pulses
                .iter()
                .all(|p| (1500.0..=1700.0).contains(&p.pulse_us()))
        );
    }
    let motions: Vec<_> = line
        .heard()
        .filter_map(|h| match h.what {
            Content::Motion(m) => Some((h.at_ns, m)),
            _ => None,
        })
        .collect();
    let (at_ns, roll) = motions
        .iter()
        .rev()
        .find_map(|(at, m)| Some((*at, m.attitude_rad?[0])))
        .unwrap();
    let truth = f64::from(law(at_ns as f64 * 1e-9).attitude_rad[0]);
    assert!((roll - truth).abs() < 2e-3, "{roll} {truth}");
    let depth_m = motions.iter().rev().find_map(|(_, m)| m.depth_m).unwrap();
    assert!((depth_m - 0.04).abs() < 2e-3, "{depth_m}");
}

#[test]
fn stamps_are_within_half_a_millisecond_over_latency_jitter_and_drift() {
    let config = AutopilotConfig {
        drift_ppm: 100.0,
        to_autopilot_ns: 20 * MS,
        to_host_ns: 20 * MS,
        jitter_ns: 1e6,
        ..AutopilotConfig::default()
    };
    let mut line = Line::new(config, Mavlink::default());
    line.run(90 * S);
    let errors = line.stamp_errors_ms(20 * S);
    assert!(errors.len() > 3000);
    let worst = errors.iter().fold(0.0_f64, |m, e| m.max(e.abs()));
    assert!(worst < 0.5, "{worst} ms");
    let drift_ppm = line.follower.clock().unwrap().drift_ppm;
    assert!((drift_ppm - 100.0).abs() < 20.0, "{drift_ppm}");
}

#[test]
fn an_asymmetric_path_lies_inside_the_stated_sd() {
    let config = AutopilotConfig {
        drift_ppm: 100.0,
        to_autopilot_ns: 25 * MS,
        to_host_ns: 15 * MS,
        jitter_ns: 1e6,
        ..AutopilotConfig::default()
    };
    let mut line = Line::new(config, Mavlink::default());
    line.run(40 * S);
    let sd_ms = line.follower.clock().unwrap().offset_sd_us * 1e-3;
    let errors = line.stamp_errors_ms(20 * S);
    let worst = errors.iter().fold(0.0_f64, |m, e| m.max(e.abs()));
    assert!(
        worst > 4.0,
        "half of the asymmetry cannot be seen: {worst} ms"
    );
    assert!(worst < sd_ms, "{worst} ms, sd {sd_ms} ms");
}

#[test]
fn every_message_that_is_lost_is_counted() {
    let config = AutopilotConfig {
        loss: 0.05,
        ..AutopilotConfig::default()
    };
    let mut line = Line::new(config, Mavlink::default());
    line.run(30 * S);
    let missed: u64 = line
        .events
        .iter()
        .map(|e| match e {
            LinkEvent::Missed { messages } => *messages,
            _ => 0,
        })
        .sum();
    let alive = line
        .events
        .iter()
        .filter(|e| matches!(e, LinkEvent::Alive))
        .count() as u64;
    let (sent, lost) = line.autopilot.frames();
    assert!(lost > 100, "{lost}");
    // Before the first heartbeat arrives nothing is known of a counter, and a loss at the end shows with the next message.
    assert!(
        (alive + missed).abs_diff(sent) <= 60,
        "{alive} + {missed}, {sent}"
    );
    assert!(missed <= lost && missed + 8 >= lost, "{missed} of {lost}");
}

#[test]
fn arming_a_command_or_a_mission_item_begins_and_ends_a_recording() {
    let by = |record_on| Mavlink {
        record_on,
        mission_first: 3,
        mission_last: 5,
    };
    let mut arming = Line::new(AutopilotConfig::default(), by(RecordOn::Arming));
    arming.run(2 * S);
    arming.autopilot.config().armed = true;
    arming.run(2 * S);
    arming.autopilot.config().armed = false;
    arming.run(2 * S);
    assert_eq!(arming.recordings(), [false, true, false]);

    let mut command = Line::new(AutopilotConfig::default(), by(RecordOn::Command));
    command.run(2 * S);
    for (order, to) in [
        (MavCmd::MAV_CMD_LOGGING_START, COMPONENT + 1),
        (MavCmd::MAV_CMD_LOGGING_START, COMPONENT),
        (MavCmd::MAV_CMD_VIDEO_STOP_CAPTURE, COMPONENT),
    ] {
        command.autopilot.ground_station(command.now_ns, order, to);
        command.run(S);
    }
    assert_eq!(
        command.recordings(),
        [true, false],
        "and not by another's command"
    );
    assert_eq!(command.autopilot.acks(), 2);

    let mut mission = Line::new(AutopilotConfig::default(), by(RecordOn::Mission));
    for item in 1..=6 {
        mission.autopilot.config().mission_item = item;
        mission.run(2 * S);
    }
    assert_eq!(mission.recordings(), [false, true, false]);
}

#[test]
fn the_pilot_hears_of_the_recording() {
    let mut line = Line::new(AutopilotConfig::default(), Mavlink::default());
    line.run(2 * S);
    line.follower
        .tell("recording, 25 fps, 0 lost; target in sight, and what is beyond it");
    line.run(S);
    assert_eq!(
        line.autopilot.texts(),
        ["recording, 25 fps, 0 lost; target in sight, and wh"]
    );
}

#[test]
fn a_restarted_autopilot_is_a_reset_and_its_clock_is_found_again() {
    let mut line = Line::new(AutopilotConfig::default(), Mavlink::default());
    line.run(5 * S);
    line.autopilot.config().clock_offset_us = 1000;
    line.run(30 * S);
    let resets = line
        .events
        .iter()
        .filter(|e| matches!(e, LinkEvent::Reset { .. }))
        .count();
    assert_eq!(resets, 1);
    let errors = line.stamp_errors_ms(10 * S);
    assert!(errors.iter().all(|e| e.abs() < 0.5));
}

/// Frames by pymavlink 2.4.50: ATTITUDE(12345, .1, -.2, .3, .01, .02, -.03) from 1/1, sequence 7, version 1 and 2.
const FOREIGN: [&[u8]; 2] = [
    &[
        0xfe, 0x1c, 0x07, 0x01, 0x01, 0x1e, 0x39, 0x30, 0x00, 0x00, 0xcd, 0xcc, 0xcc, 0x3d, 0xcd,
        0xcc, 0x4c, 0xbe, 0x9a, 0x99, 0x99, 0x3e, 0x0a, 0xd7, 0x23, 0x3c, 0x0a, 0xd7, 0xa3, 0x3c,
        0x8f, 0xc2, 0xf5, 0xbc, 0xa6, 0x37,
    ],
    &[
        0xfd, 0x1c, 0x00, 0x00, 0x07, 0x01, 0x01, 0x1e, 0x00, 0x00, 0x39, 0x30, 0x00, 0x00, 0xcd,
        0xcc, 0xcc, 0x3d, 0xcd, 0xcc, 0x4c, 0xbe, 0x9a, 0x99, 0x99, 0x3e, 0x0a, 0xd7, 0x23, 0x3c,
        0x0a, 0xd7, 0xa3, 0x3c, 0x8f, 0xc2, 0xf5, 0xbc, 0xb1, 0x40,
    ],
];

#[test]
fn frames_of_another_program_are_read_in_any_pieces_between_garbage() {
    for bytes in FOREIGN {
        for lead in [&[][..], &[0xFD], &[0xFE, 0x03], &[0x55, 0xFD, 0x01]] {
            let mut deframer = Deframer::default();
            let all = [lead, bytes, bytes, &[0; 300]].concat();
            let frames: Vec<_> = all.iter().filter_map(|b| deframer.feed(*b)).collect();
            assert_eq!(frames.len(), 2, "{lead:?}");
            let attitude: ATTITUDE_DATA = frames[0].message().unwrap();
            assert_eq!((attitude.time_boot_ms, attitude.pitch), (12345, -0.2));
            assert_eq!(attitude.yawspeed, -0.03);
            assert_eq!((frames[1].system, frames[1].sequence), (1, 7));
        }
        for i in 0..bytes.len() {
            let mut broken = bytes.to_vec();
            broken[i] ^= 0x10;
            let mut deframer = Deframer::default();
            let frames = broken
                .iter()
                .chain(&[0; 300])
                .filter_map(|b| deframer.feed(*b))
                .count();
            assert_eq!(frames, 0, "byte {i}");
        }
    }
}
