//! A simulated autopilot without I/O: its own state machine and clock, at the far end of a line with latency.
//!
//! It shares with the follower only the frames; what it does is by the MAVLink services' own description.

use super::frame::{Deframer, Frame, Sender};
use mavlink::MessageData;
use mavlink::dialects::ardupilotmega::{
    ATTITUDE_DATA, COMMAND_ACK_DATA, COMMAND_LONG_DATA, GLOBAL_POSITION_INT_DATA, HEARTBEAT_DATA,
    MISSION_CURRENT_DATA, MavAutopilot, MavCmd, MavModeFlag, MavState, MavType,
    SERVO_OUTPUT_RAW_DATA, STATUSTEXT_DATA, TIMESYNC_DATA,
};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use std::collections::VecDeque;

/// Properties of a simulated autopilot and of the line to it.
#[derive(Debug, Clone, PartialEq)]
pub struct AutopilotConfig {
    /// Its clock at host monotonic 0 \[us\].
    pub clock_offset_us: u64,
    /// Its clock fast against the host's \[ppm\].
    pub drift_ppm: f64,
    /// Latency from the host to it \[ns\].
    pub to_autopilot_ns: u64,
    /// Latency from it to the host \[ns\].
    pub to_host_ns: u64,
    /// Mean of an exponential delay on top, in each direction \[ns\].
    pub jitter_ns: f64,
    /// Share of its frames that are lost on the way.
    pub loss: f64,
    /// Whether it is armed.
    pub armed: bool,
    /// Its current mission item.
    pub mission_item: u16,
    /// Seed of delays and losses.
    pub seed: u64,
}

impl Default for AutopilotConfig {
    fn default() -> Self {
        Self {
            clock_offset_us: 77_000_000,
            drift_ppm: 0.0,
            to_autopilot_ns: 0,
            to_host_ns: 0,
            jitter_ns: 0.0,
            loss: 0.0,
            armed: false,
            mission_item: 0,
            seed: 1,
        }
    }
}

/// Truth at a time: what the simulated autopilot puts out and measures.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Truth {
    /// Pulses of its first eight outputs \[us\].
    pub pulses_us: [u16; 8],
    /// Roll, pitch, yaw \[rad\].
    pub attitude_rad: [f32; 3],
    /// Body rates \[rad/s\].
    pub rates_radps: [f32; 3],
    /// Depth \[m\].
    pub depth_m: f64,
}

/// Law of the truth over host time \[s\].
pub type Law = Box<dyn FnMut(f64) -> Truth + Send>;

/// A message that is sent at a rate.
struct Stream {
    id: u32,
    period_ns: u64,
    next_ns: u64,
}

/// The simulated autopilot.
pub struct SimAutopilot {
    config: AutopilotConfig,
    law: Law,
    sender: Sender,
    deframer: Deframer,
    /// Bytes on the way to it, and to the host.
    inbox: VecDeque<(u64, Vec<u8>)>,
    outbox: VecDeque<(u64, Vec<u8>)>,
    streams: Vec<Stream>,
    rng: StdRng,
    texts: Vec<String>,
    acks: u64,
    sent: u64,
    lost: u64,
    outputs: Vec<(u64, u64)>,
}

impl SimAutopilot {
    /// Sends its heartbeat once a second, and what it is asked for.
    pub fn new(config: AutopilotConfig, law: Law) -> Self {
        let heartbeat = Stream {
            id: HEARTBEAT_DATA::ID,
            period_ns: 1_000_000_000,
            next_ns: 0,
        };
        let item = Stream {
            id: MISSION_CURRENT_DATA::ID,
            period_ns: 500_000_000,
            next_ns: 0,
        };
        Self {
            rng: StdRng::seed_from_u64(config.seed),
            config,
            law,
            sender: Sender::new(1, 1),
            deframer: Deframer::default(),
            inbox: VecDeque::new(),
            outbox: VecDeque::new(),
            streams: vec![heartbeat, item],
            texts: Vec::new(),
            acks: 0,
            sent: 0,
            lost: 0,
            outputs: Vec::new(),
        }
    }

    /// Its properties, to be changed on the way.
    pub fn config(&mut self) -> &mut AutopilotConfig {
        &mut self.config
    }

    /// Status texts it has received.
    pub fn texts(&self) -> &[String] {
        &self.texts
    }

    /// Acknowledgements it has received.
    pub fn acks(&self) -> u64 {
        self.acks
    }

    /// Frames sent, and those of them lost on the way.
    pub fn frames(&self) -> (u64, u64) {
        (self.sent, self.lost)
    }

    /// Its clock \[us\] with the host time \[ns\] of every SERVO_OUTPUT_RAW sent.
    pub fn outputs(&self) -> &[(u64, u64)] {
        &self.outputs
    }

    /// A command from the ground station to the component `target`, through the autopilot as a router.
    pub fn ground_station(&mut self, now_ns: u64, command: MavCmd, target: u8) {
        let mut bytes = Vec::new();
        let message = COMMAND_LONG_DATA {
            command,
            target_system: 1,
            target_component: target,
            ..COMMAND_LONG_DATA::default()
        };
        Sender::new(255, 190).encode(&message, &mut bytes);
        self.outbox.push_back((now_ns, bytes));
    }

    /// Bytes of the host at `now_ns`.
    pub fn receive(&mut self, now_ns: u64, bytes: &[u8]) {
        let due_ns = now_ns + self.config.to_autopilot_ns + self.jitter();
        let due_ns = due_ns.max(self.inbox.back().map_or(0, |b| b.0));
        self.inbox.push_back((due_ns, bytes.to_vec()));
    }

    /// Does everything up to `now_ns`; bytes that are at the host by then go to `out`, one `Vec` per datagram.
    pub fn poll(&mut self, now_ns: u64, out: &mut Vec<Vec<u8>>) {
        while let Some((at_ns, bytes)) = due(&mut self.inbox, now_ns) {
            for byte in bytes {
                if let Some(frame) = self.deframer.feed(byte) {
                    self.take(&frame, at_ns);
                }
            }
        }
        for i in 0..self.streams.len() {
            while self.streams[i].next_ns <= now_ns {
                let at_ns = self.streams[i]
                    .next_ns
                    .max(now_ns.saturating_sub(self.streams[i].period_ns));
                self.streams[i].next_ns = at_ns + self.streams[i].period_ns;
                self.stream(self.streams[i].id, at_ns);
            }
        }
        while let Some((_, bytes)) = due(&mut self.outbox, now_ns) {
            out.push(bytes);
        }
    }

    fn clock_us(&self, host_ns: u64) -> u64 {
        let rate = 1.0 + self.config.drift_ppm * 1e-6;
        self.config.clock_offset_us + (host_ns as f64 * 1e-3 * rate) as u64
    }

    fn jitter(&mut self) -> u64 {
        let share: f64 = self.rng.random();
        (-(1.0 - share).ln() * self.config.jitter_ns) as u64
    }

    fn take(&mut self, frame: &Frame, at_ns: u64) {
        if let Some(ask) = frame.message::<TIMESYNC_DATA>().filter(|m| m.tc1 == 0) {
            let answer = TIMESYNC_DATA {
                tc1: self.clock_us(at_ns) as i64 * 1000,
                ts1: ask.ts1,
                ..ask
            };
            self.send(&answer, at_ns);
        } else if let Some(command) = frame.message::<COMMAND_LONG_DATA>() {
            if command.command == MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL
                && command.target_component == 1
            {
                let id = command.param1 as u32;
                self.streams.retain(|s| s.id != id);
                self.streams.push(Stream {
                    id,
                    period_ns: (f64::from(command.param2) * 1e3) as u64,
                    next_ns: at_ns,
                });
            }
        } else if let Some(text) = frame.message::<STATUSTEXT_DATA>() {
            self.texts
                .push(text.text.to_str().unwrap_or("?").to_owned());
        } else if frame.message::<COMMAND_ACK_DATA>().is_some() {
            self.acks += 1;
        }
    }

    fn stream(&mut self, id: u32, at_ns: u64) {
        let clock_us = self.clock_us(at_ns);
        let time_boot_ms = (clock_us / 1000) as u32;
        let truth = (self.law)(at_ns as f64 * 1e-9);
        let [p1, p2, p3, p4, p5, p6, p7, p8] = truth.pulses_us;
        match id {
            HEARTBEAT_DATA::ID => {
                let armed = MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;
                let heartbeat = HEARTBEAT_DATA {
                    custom_mode: 19,
                    mavtype: MavType::MAV_TYPE_SUBMARINE,
                    autopilot: MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
                    base_mode: if self.config.armed {
                        armed
                    } else {
                        MavModeFlag::empty()
                    },
                    system_status: MavState::MAV_STATE_ACTIVE,
                    mavlink_version: 3,
                };
                self.send(&heartbeat, at_ns);
            }
            MISSION_CURRENT_DATA::ID => {
                let item = MISSION_CURRENT_DATA {
                    seq: self.config.mission_item,
                    ..MISSION_CURRENT_DATA::default()
                };
                self.send(&item, at_ns);
            }
            SERVO_OUTPUT_RAW_DATA::ID => {
                self.outputs.push((clock_us, at_ns));
                let outputs = SERVO_OUTPUT_RAW_DATA {
                    time_usec: clock_us as u32,
                    servo1_raw: p1,
                    servo2_raw: p2,
                    servo3_raw: p3,
                    servo4_raw: p4,
                    servo5_raw: p5,
                    servo6_raw: p6,
                    servo7_raw: p7,
                    servo8_raw: p8,
                    ..SERVO_OUTPUT_RAW_DATA::default()
                };
                self.send(&outputs, at_ns);
            }
            ATTITUDE_DATA::ID => {
                let ([roll, pitch, yaw], rates) = (truth.attitude_rad, truth.rates_radps);
                let attitude = ATTITUDE_DATA {
                    time_boot_ms,
                    roll,
                    pitch,
                    yaw,
                    rollspeed: rates[0],
                    pitchspeed: rates[1],
                    yawspeed: rates[2],
                };
                self.send(&attitude, at_ns);
            }
            GLOBAL_POSITION_INT_DATA::ID => {
                let position = GLOBAL_POSITION_INT_DATA {
                    time_boot_ms,
                    relative_alt: (-1e3 * truth.depth_m) as i32,
                    ..GLOBAL_POSITION_INT_DATA::default()
                };
                self.send(&position, at_ns);
            }
            // It has no sensor for it.
            _ => {}
        }
    }

    fn send<D: MessageData>(&mut self, message: &D, at_ns: u64) {
        let mut bytes = Vec::new();
        self.sender.encode(message, &mut bytes);
        self.sent += 1;
        if self.rng.random::<f64>() < self.config.loss {
            self.lost += 1;
            return;
        }
        let due_ns = at_ns + self.config.to_host_ns + self.jitter();
        let due_ns = due_ns.max(self.outbox.back().map_or(0, |b| b.0));
        self.outbox.push_back((due_ns, bytes));
    }
}

/// First of a queue, where its time has come.
fn due(queue: &mut VecDeque<(u64, Vec<u8>)>, now_ns: u64) -> Option<(u64, Vec<u8>)> {
    match queue.front()?.0 <= now_ns {
        true => queue.pop_front(),
        false => None,
    }
}
