//! The two firmwares: bytes to reactions.

use super::{ControllerConfig, OwnClock};
use crate::ChannelPulse;
use crate::maestro::{self, Command, CommandParser};
use crate::stamped::{ControllerMessage, Deframer, FrameError, HostMessage, OutputState, error};
use crate::transport::LineModel;
use hydroline_rigs::LinkKind;

/// Clock, times and outputs that the firmware sees while it handles one byte.
pub(super) struct View<'a> {
    pub clock: OwnClock,
    /// The byte's last bit \[ns\].
    pub at_ns: u64,
    /// The answer's first bit at the earliest \[ns\].
    pub start_ns: u64,
    pub tx_line: LineModel,
    pub outputs: &'a [ChannelPulse],
}

impl View<'_> {
    /// Controller clock at the byte \[us\].
    fn now_us(&self) -> u32 {
        self.clock.read_us(self.at_ns)
    }

    /// Controller clock when the last of `bytes` answer bytes will be out \[us\].
    fn tx_end_us(&self, bytes: usize) -> u32 {
        let mut line = self.tx_line;
        self.clock.read_us(line.push(self.start_ns, bytes))
    }
}

/// An answer; what depends on the outputs is filled in after they have changed.
pub(super) enum Answer {
    Bytes(Vec<u8>),
    Message(ControllerMessage),
}

impl Answer {
    /// Makes an Ack one of a command that was never sent.
    pub fn misnumber(&mut self) {
        if let Answer::Message(ControllerMessage::Ack { sequence, .. }) = self {
            *sequence ^= 0x8000_0000;
        }
    }

    /// Takes the channels out of an Ack.
    pub fn unname(&mut self) {
        if let Answer::Message(ControllerMessage::Ack { pulses, .. }) = self {
            pulses.clear();
        }
    }

    pub fn bytes(self, outputs: &[ChannelPulse]) -> Vec<u8> {
        match self {
            Answer::Bytes(bytes) => bytes,
            Answer::Message(mut message) => {
                match &mut message {
                    ControllerMessage::Status { pulses, .. } => *pulses = outputs.to_vec(),
                    ControllerMessage::Ack { pulses, .. } => {
                        for pulse in pulses {
                            let now = outputs.iter().find(|o| o.channel == pulse.channel);
                            pulse.quarter_us = now.map_or(0, |o| o.quarter_us);
                        }
                    }
                    ControllerMessage::TimeSyncReply { .. } => {}
                }
                let mut out = Vec::new();
                message.encode(&mut out);
                out
            }
        }
    }
}

/// Effects of one byte.
#[derive(Default)]
pub(super) struct Reaction {
    /// A sound command: feeds the watchdog.
    pub sound: bool,
    pub neutral: bool,
    pub pulses: Vec<ChannelPulse>,
    pub watchdog_ns: Option<u64>,
    pub answer: Option<Answer>,
}

pub(super) trait Device: Send {
    fn feed(&mut self, byte: u8, view: &View<'_>) -> Reaction;
    fn watchdog_tripped(&mut self);
    /// Sets error bits, until they are sent.
    fn fail(&mut self, bits: u16);
}

pub(super) fn new(config: &ControllerConfig) -> Box<dyn Device> {
    match config.kind {
        LinkKind::Maestro => Box::new(Maestro {
            parser: CommandParser::default(),
            errors: 0,
        }),
        LinkKind::Stamped | LinkKind::Mavlink => Box::new(Stamped {
            deframer: Deframer::default(),
            boot_id: config.boot_id,
            errors: 0,
            state: OutputState::Start,
            watchdog_ms: (config.watchdog_ns / 1_000_000).min(u64::from(u16::MAX)) as u16,
            range: (
                ChannelPulse::from_us(0, config.min_us).quarter_us,
                ChannelPulse::from_us(0, config.max_us).quarter_us,
            ),
            frames_ok: 0,
            frames_bad: 0,
        }),
    }
}

struct Maestro {
    parser: CommandParser,
    errors: u16,
}

impl Device for Maestro {
    fn feed(&mut self, byte: u8, view: &View<'_>) -> Reaction {
        let Some(command) = self.parser.feed(byte) else {
            return Reaction::default();
        };
        let mut reaction = Reaction {
            sound: true,
            ..Reaction::default()
        };
        let answer = |value: u16| Some(Answer::Bytes(value.to_le_bytes().to_vec()));
        match command {
            Command::SetTarget {
                channel,
                quarter_us,
            } => reaction.pulses.push(ChannelPulse {
                channel,
                quarter_us,
            }),
            Command::GetPosition { channel } => {
                let position = view
                    .outputs
                    .iter()
                    .find(|o| o.channel == channel)
                    .map_or(0, |o| o.quarter_us);
                reaction.answer = answer(position);
            }
            Command::GetErrors => reaction.answer = answer(std::mem::take(&mut self.errors)),
            Command::GetMovingState => reaction.answer = Some(Answer::Bytes(vec![0])),
            Command::GoHome => reaction.neutral = true,
            Command::SetLimit => {}
            Command::ProtocolError => {
                self.errors |= maestro::ERROR_SERIAL_PROTOCOL;
                reaction.sound = false;
            }
        }
        reaction
    }

    fn watchdog_tripped(&mut self) {
        self.errors |= maestro::ERROR_SERIAL_TIMEOUT;
    }

    fn fail(&mut self, bits: u16) {
        self.errors |= bits;
    }
}

struct Stamped {
    deframer: Deframer,
    boot_id: u16,
    errors: u16,
    state: OutputState,
    watchdog_ms: u16,
    range: (u16, u16),
    frames_ok: u32,
    frames_bad: u32,
}

impl Stamped {
    /// `named`: the channels of the command; what they really put out is filled in when they have changed.
    fn ack(&mut self, sequence: u32, named: Vec<ChannelPulse>, view: &View<'_>) -> Option<Answer> {
        let errors = std::mem::take(&mut self.errors);
        Some(Answer::Message(ControllerMessage::Ack {
            sequence,
            time_us: view.now_us(),
            errors,
            pulses: named,
        }))
    }

    fn status(&mut self, token: u32, view: &View<'_>) -> Option<Answer> {
        Some(Answer::Message(ControllerMessage::Status {
            token,
            time_us: view.now_us(),
            boot_id: self.boot_id,
            errors: std::mem::take(&mut self.errors),
            state: self.state,
            watchdog_ms: self.watchdog_ms,
            frames_ok: self.frames_ok,
            frames_bad: self.frames_bad,
            pulses: Vec::new(),
        }))
    }

    fn obey(&mut self, message: HostMessage, view: &View<'_>) -> Reaction {
        let mut reaction = Reaction {
            sound: true,
            ..Reaction::default()
        };
        match message {
            HostMessage::SetPulses { sequence, pulses } => {
                let (min, max) = self.range;
                let known = |p: &ChannelPulse| view.outputs.iter().any(|o| o.channel == p.channel);
                if !pulses.iter().all(known) {
                    self.errors |= error::CHANNEL;
                } else if !pulses.iter().all(|p| (min..=max).contains(&p.quarter_us)) {
                    self.errors |= error::RANGE;
                } else {
                    self.state = OutputState::Running;
                    reaction.pulses = pulses.clone();
                }
                reaction.answer = self.ack(sequence, pulses, view);
            }
            HostMessage::Neutral { sequence } => {
                self.state = OutputState::Neutral;
                reaction.neutral = true;
                reaction.answer = self.ack(sequence, view.outputs.to_vec(), view);
            }
            HostMessage::TimeSync { host_us } => {
                let reply = |tx_us| ControllerMessage::TimeSyncReply {
                    host_us,
                    rx_us: view.now_us(),
                    tx_us,
                    boot_id: self.boot_id,
                };
                let mut bytes = Vec::new();
                reply(0).encode(&mut bytes);
                reaction.answer = Some(Answer::Message(reply(view.tx_end_us(bytes.len()))));
            }
            HostMessage::GetStatus { token } => reaction.answer = self.status(token, view),
            HostMessage::Configure {
                token,
                watchdog_ms,
                min,
                max,
                ..
            } => {
                if watchdog_ms != 0 {
                    self.watchdog_ms = watchdog_ms;
                    reaction.watchdog_ns = Some(u64::from(watchdog_ms) * 1_000_000);
                }
                self.range = (min, max);
                reaction.answer = self.status(token, view);
            }
        }
        reaction
    }
}

impl Device for Stamped {
    fn feed(&mut self, byte: u8, view: &View<'_>) -> Reaction {
        match self
            .deframer
            .feed(byte)
            .map(|frame| frame.and_then(|payload| HostMessage::parse(&payload)))
        {
            None => Reaction::default(),
            Some(Ok(message)) => {
                self.frames_ok = self.frames_ok.wrapping_add(1);
                self.obey(message, view)
            }
            Some(Err(why)) => {
                self.frames_bad = self.frames_bad.wrapping_add(1);
                self.errors |= match why {
                    FrameError::Crc { .. } => error::CRC,
                    FrameError::Version { .. } | FrameError::Type { .. } => error::UNKNOWN,
                    _ => error::FRAMING,
                };
                Reaction::default()
            }
        }
    }

    fn watchdog_tripped(&mut self) {
        self.state = OutputState::Watchdog;
        self.errors |= error::WATCHDOG;
    }

    fn fail(&mut self, bits: u16) {
        self.errors |= bits;
    }
}
