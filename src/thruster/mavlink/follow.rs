//! Following an autopilot: a heartbeat out, its messages asked for, its clock by TIMESYNC, what it says in.

use super::frame::{Deframer, Frame, Sender};
use super::said::{self, FAST, SLOW};
use super::{Content, Heard, State};
use crate::clocksync::{Added, ClockSync, Estimate, Exchange, SyncSettings};
use crate::link::LinkEvent;
use hydroline_rigs::{Mavlink, RecordOn};
use mavlink::MessageData;
use mavlink::dialects::ardupilotmega::{
    COMMAND_ACK_DATA, COMMAND_LONG_DATA, HEARTBEAT_DATA, MISSION_CURRENT_DATA, MavAutopilot,
    MavCmd, MavModeFlag, MavResult, MavSeverity, MavState, MavType, STATUSTEXT_DATA, TIMESYNC_DATA,
};
use std::collections::VecDeque;

/// MAV_COMP_ID_ONBOARD_COMPUTER: hydroline's component in the vehicle's system.
pub const COMPONENT: u8 = 191;
/// Period of our heartbeat \[ns\], as MAVLink wants it.
const HEARTBEAT_NS: u64 = 1_000_000_000;
/// Period of TIMESYNC \[ns\]: 256 exchanges in a window of a minute.
const SYNC_NS: u64 = 250_000_000;
/// The same until the clock is known \[ns\].
const FIRST_SYNC_NS: u64 = 20_000_000;
/// Exchanges before stamps are converted: as many as the fit needs to judge the fastest.
const SYNC_MIN: u32 = 4;
/// Requests on their way; older ones are given up.
const REQUESTS: usize = 64;
/// Messages of status text that wait for their turn.
const TEXTS: usize = 8;
/// Jump of the sequence that is a message out of order and no loss: half the counter.
const OUT_OF_ORDER: u8 = 128;

/// The state machine, without I/O.
pub struct Follower {
    settings: Mavlink,
    rate_hz: f64,
    deframer: Deframer,
    sender: Sender,
    /// The autopilot's system and component, once its heartbeat was heard.
    autopilot: Option<(u8, u8)>,
    last_sequence: Option<u8>,
    sync: ClockSync,
    next_heartbeat_ns: u64,
    next_sync_ns: u64,
    /// TIMESYNC requests: their ts1, and when their last byte left \[ns\].
    requests: VecDeque<(i64, Option<u64>)>,
    /// Messages still to be asked for.
    wanted: Vec<u32>,
    texts: VecDeque<String>,
    acks: VecDeque<MavCmd>,
    recording: Option<bool>,
}

impl Follower {
    /// Asks for the fast messages at `rate_hz`.
    pub fn new(settings: Mavlink, rate_hz: f64) -> Self {
        // A stamp of the autopilot's loop and a scheduler's slice on either side.
        let sync = SyncSettings {
            floor_us: 50.0,
            ..SyncSettings::default()
        };
        Self {
            settings,
            rate_hz,
            deframer: Deframer::default(),
            sender: Sender::new(1, COMPONENT),
            autopilot: None,
            last_sequence: None,
            sync: ClockSync::new(sync),
            next_heartbeat_ns: 0,
            next_sync_ns: 0,
            requests: VecDeque::new(),
            wanted: Vec::new(),
            texts: VecDeque::new(),
            acks: VecDeque::new(),
            recording: None,
        }
    }

    /// The line was (re)opened.
    pub fn opened(&mut self, now_ns: u64) {
        self.deframer = Deframer::default();
        self.autopilot = None;
        self.last_sequence = None;
        self.requests.clear();
        (self.next_heartbeat_ns, self.next_sync_ns) = (now_ns, now_ns);
    }

    /// Text for the pilot, cut to what STATUSTEXT carries; the oldest give way.
    pub fn tell(&mut self, words: &str) {
        if self.texts.len() == TEXTS {
            self.texts.pop_front();
        }
        self.texts
            .push_back(words.chars().filter(char::is_ascii).take(50).collect());
    }

    /// The autopilot's clock.
    pub fn clock(&self) -> Option<Estimate> {
        self.sync.estimate()
    }

    /// The frame that is due first; `out` stays empty when none is.
    pub fn housekeeping(&mut self, now_ns: u64, out: &mut Vec<u8>) {
        if now_ns >= self.next_heartbeat_ns {
            self.next_heartbeat_ns = now_ns + HEARTBEAT_NS;
            let heartbeat = HEARTBEAT_DATA {
                mavtype: MavType::MAV_TYPE_ONBOARD_CONTROLLER,
                autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
                system_status: MavState::MAV_STATE_ACTIVE,
                mavlink_version: 3,
                ..HEARTBEAT_DATA::default()
            };
            return self.sender.encode(&heartbeat, out);
        }
        let Some((system, component)) = self.autopilot else {
            return;
        };
        if let Some(command) = self.acks.pop_front() {
            let ack = COMMAND_ACK_DATA {
                command,
                result: MavResult::MAV_RESULT_ACCEPTED,
                ..COMMAND_ACK_DATA::default()
            };
            self.sender.encode(&ack, out);
        } else if let Some(id) = self.wanted.pop() {
            let rate_hz = if FAST.contains(&id) {
                self.rate_hz
            } else {
                2.0
            };
            let ask = COMMAND_LONG_DATA {
                command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
                param1: id as f32,
                param2: (1e6 / rate_hz) as f32,
                target_system: system,
                target_component: component,
                ..COMMAND_LONG_DATA::default()
            };
            self.sender.encode(&ask, out);
        } else if now_ns >= self.next_sync_ns {
            let known = self.sync.estimate().is_some_and(|e| e.samples >= SYNC_MIN);
            self.next_sync_ns = now_ns + if known { SYNC_NS } else { FIRST_SYNC_NS };
            if self.requests.len() == REQUESTS {
                self.requests.pop_front();
            }
            let ts1 = now_ns as i64;
            self.requests.push_back((ts1, None));
            let ask = TIMESYNC_DATA {
                ts1,
                ..TIMESYNC_DATA::default()
            };
            self.sender.encode(&ask, out);
        } else if let Some(text) = self.texts.pop_front() {
            let text = STATUSTEXT_DATA {
                severity: MavSeverity::MAV_SEVERITY_INFO,
                text: text.as_str().into(),
                ..STATUSTEXT_DATA::default()
            };
            self.sender.encode(&text, out);
        }
    }

    /// The last frame's last byte has left \[ns\].
    pub fn sent(&mut self, last_byte_out_ns: u64) {
        if let Some((_, out_ns)) = self.requests.back_mut() {
            out_ns.get_or_insert(last_byte_out_ns);
        }
    }

    /// Takes bytes, all with the arrival time of the last of them.
    pub fn receive(&mut self, bytes: &[u8], at_ns: u64, events: &mut Vec<LinkEvent>) {
        for &byte in bytes {
            if let Some(frame) = self.deframer.feed(byte) {
                self.frame(&frame, at_ns, events);
            }
        }
        let dropped = self.deframer.take_dropped();
        if dropped > 0 {
            events.push(LinkEvent::Garbage {
                reason: format!("{dropped} bytes are part of no sound MAVLink frame"),
            });
        }
    }

    fn frame(&mut self, frame: &Frame, at_ns: u64, events: &mut Vec<LinkEvent>) {
        // A router hands on what others say: of the recording any component may decide, of the vehicle its autopilot.
        if let Some(command) = frame.message::<COMMAND_LONG_DATA>() {
            self.command(&command, events);
        }
        let from = (frame.system, frame.component);
        let heartbeat = frame.message::<HEARTBEAT_DATA>().filter(is_autopilot);
        if self.autopilot.is_none() && heartbeat.is_some() {
            self.autopilot = Some(from);
            self.sender.system = frame.system;
            self.wanted = SLOW.iter().chain(&FAST).copied().collect();
        }
        if self.autopilot != Some(from) {
            return;
        }
        events.push(LinkEvent::Alive);
        self.count(frame.sequence, events);
        if let Some(heartbeat) = heartbeat {
            self.heartbeat(&heartbeat, at_ns, events);
        } else if let Some(answer) = frame.message::<TIMESYNC_DATA>() {
            self.timesync(&answer, at_ns, events);
        } else if let Some(item) = frame.message::<MISSION_CURRENT_DATA>() {
            let inside =
                (self.settings.mission_first..=self.settings.mission_last).contains(&item.seq);
            self.record(RecordOn::Mission, inside, events);
        }
        for (stamp, what) in said::contents(frame) {
            let heard = self.stamped(stamp, at_ns, what);
            events.push(LinkEvent::Heard(heard));
        }
    }

    /// Messages that never came, by the sender's counter.
    fn count(&mut self, sequence: u8, events: &mut Vec<LinkEvent>) {
        if let Some(last) = self.last_sequence {
            let step = sequence.wrapping_sub(last);
            if step == 0 || step >= OUT_OF_ORDER {
                return;
            }
            if step > 1 {
                events.push(LinkEvent::Missed {
                    messages: u64::from(step - 1),
                });
            }
        }
        self.last_sequence = Some(sequence);
    }

    fn heartbeat(&mut self, said: &HEARTBEAT_DATA, at_ns: u64, events: &mut Vec<LinkEvent>) {
        let armed = said
            .base_mode
            .contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
        self.record(RecordOn::Arming, armed, events);
        let state = State {
            message: HEARTBEAT_DATA::NAME,
            armed: Some(armed),
            mode: Some(said.custom_mode),
            ..State::default()
        };
        let heard = self.stamped(None, at_ns, Content::State(state));
        events.push(LinkEvent::Heard(heard));
    }

    fn command(&mut self, said: &COMMAND_LONG_DATA, events: &mut Vec<LinkEvent>) {
        let on = match said.command {
            MavCmd::MAV_CMD_LOGGING_START | MavCmd::MAV_CMD_VIDEO_START_CAPTURE => true,
            MavCmd::MAV_CMD_LOGGING_STOP | MavCmd::MAV_CMD_VIDEO_STOP_CAPTURE => false,
            _ => return,
        };
        let for_us = said.target_component == COMPONENT
            && [0, self.sender.system].contains(&said.target_system);
        if for_us && self.settings.record_on == RecordOn::Command {
            self.acks.push_back(said.command);
            self.record(RecordOn::Command, on, events);
        }
    }

    /// Says a change of what begins and ends the recording; the first word of it counts as one.
    fn record(&mut self, by: RecordOn, on: bool, events: &mut Vec<LinkEvent>) {
        if by == self.settings.record_on && self.recording != Some(on) {
            self.recording = Some(on);
            events.push(LinkEvent::Recording { on });
        }
    }

    fn timesync(&mut self, answer: &TIMESYNC_DATA, at_ns: u64, events: &mut Vec<LinkEvent>) {
        // tc1 = 0 is a request of the other side.
        if answer.tc1 <= 0 {
            return;
        }
        let asked = self.requests.iter().position(|(ts1, _)| *ts1 == answer.ts1);
        let Some((_, Some(t1_ns))) = asked.and_then(|i| self.requests.remove(i)) else {
            return;
        };
        let stamp_us = (answer.tc1 / 1000) as u32;
        let added = self.sync.add(Exchange {
            t1_ns,
            t2_us: stamp_us,
            t3_us: stamp_us,
            t4_ns: at_ns,
            boot_id: 0,
        });
        match added {
            Added::Taken => {}
            Added::Reset { jump_us } => events.push(LinkEvent::Reset {
                reason: format!("its clock jumped by {:.3} s", jump_us * 1e-6),
            }),
            Added::Refused { rtt_us } => events.push(LinkEvent::Garbage {
                reason: format!("a TIMESYNC with a round trip of {rtt_us:.0} us"),
            }),
        }
        events.extend(self.sync.estimate().map(LinkEvent::Clock));
    }

    fn stamped(&mut self, stamp_us: Option<u32>, received_ns: u64, what: Content) -> Heard {
        let known = self.sync.estimate().filter(|e| e.samples >= SYNC_MIN);
        let autopilot_us = stamp_us.map_or(0, |us| self.sync.unwrap(us, received_ns));
        let at_ns = match (known, stamp_us) {
            (Some(estimate), Some(_)) => estimate.host_at_ns(autopilot_us as f64),
            _ => received_ns,
        };
        Heard {
            at_ns,
            received_ns,
            autopilot_us,
            what,
        }
    }
}

fn is_autopilot(said: &HEARTBEAT_DATA) -> bool {
    said.autopilot != MavAutopilot::MAV_AUTOPILOT_INVALID && said.mavtype != MavType::MAV_TYPE_GCS
}
