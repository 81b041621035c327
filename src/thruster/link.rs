//! One [`ThrusterLink`] for every controller: sets of pulses out, echoes in.
//!
//! [`Protocol`] is the part without I/O (bytes to events and back); the link drives one over a byte
//! [`Transport`]. Both protocols answer every command: `stamped` with its Ack,
//! the Maestro with the positions that are asked for right behind the targets.

mod maestro;
mod mavlink;
mod stamped;

pub use maestro::MaestroProtocol;
pub use stamped::{StampedProtocol, StampedSettings};

use super::ChannelPulse;
use super::clocksync::{Estimate, SyncSettings};
use super::mavlink::Heard;
use super::mavlink::follow::Follower;
use super::transport::{Sent, Transport};
use hydroline_rigs::{LinkKind, ThrusterSet};
use std::io;
use std::time::Duration;

/// The controller's answer to one set of commands.
#[derive(Debug, Clone, PartialEq)]
pub struct Echo {
    /// Of the command.
    pub sequence: u32,
    /// Pulses put out, of one or several channels.
    pub pulses: Vec<ChannelPulse>,
    /// Controller clock when the pulses took effect \[us\], unwrapped; 0 where the link has none.
    pub controller_time_us: u64,
    /// Last byte of the answer in \[ns\].
    pub received_ns: u64,
    /// Last byte out to last byte in \[ns\].
    pub round_trip_ns: u64,
    /// Error bits reported with it.
    pub errors: u32,
}

/// Event on a link.
#[derive(Debug, Clone, PartialEq)]
pub enum LinkEvent {
    /// An answer to a command.
    Echo(Echo),
    /// The controller said something sound that is not an echo: it is alive.
    Alive,
    /// Error bits that are set, at every reading.
    Errors {
        /// Reported error bits.
        bits: u32,
        /// Their names.
        names: Vec<&'static str>,
    },
    /// A new clock estimate.
    Clock(Estimate),
    /// The controller was reset: its outputs may be anything it starts with.
    Reset {
        /// Observation that shows it.
        reason: String,
    },
    /// Received bytes that made no sense were dropped.
    Garbage {
        /// Description of the fault.
        reason: String,
    },
    /// Commands whose answer never came.
    Unanswered {
        /// Sequence of the oldest.
        sequence: u32,
        /// Number of sets.
        sets: usize,
    },
    /// An autopilot's message for the log.
    Heard(Heard),
    /// Messages of the autopilot that never came.
    Missed {
        /// Their number.
        messages: u64,
    },
    /// The autopilot's side begins or ends the recording.
    Recording {
        /// Whether it begins.
        on: bool,
    },
}

impl LinkEvent {
    /// Whether it proves that a controller is there and understood.
    pub fn is_sound(&self) -> bool {
        !matches!(
            self,
            LinkEvent::Garbage { .. } | LinkEvent::Unanswered { .. }
        )
    }
}

/// A controller's protocol without I/O.
pub trait Protocol: Send {
    /// Bytes on the wire for one set of `channels` and its echo: (host to controller, controller to host).
    fn bytes_per_set(&self, channels: usize) -> (usize, usize);
    /// The port was (re)opened: forget open requests; bytes that bring the controller into a known state.
    fn opened(&mut self, now_ns: u64, out: &mut Vec<u8>);
    /// Bytes of one set. `neutral` = all channels to neutral, whatever the protocol's shortest way.
    fn set_pulses(
        &mut self,
        sequence: u32,
        pulses: &[ChannelPulse],
        neutral: bool,
        out: &mut Vec<u8>,
    );
    /// Bytes that are due besides commands (clock sync, errors); at most one request per call.
    fn housekeeping(&mut self, now_ns: u64, out: &mut Vec<u8>);
    /// The bytes made by the last call of one of the above have left the host.
    fn sent(&mut self, last_byte_out_ns: u64);
    /// Received bytes, all with the arrival time of the last of them.
    fn receive(&mut self, bytes: &[u8], at_ns: u64, events: &mut Vec<LinkEvent>);
    /// Lets time pass: open requests grow old.
    fn tick(&mut self, now_ns: u64, events: &mut Vec<LinkEvent>);
    /// State of the controller's clock, where it has one.
    fn clock(&self) -> Option<Estimate>;
    /// Words for whoever drives, where the protocol has a way to them.
    fn tell(&mut self, _words: &str) {}
}

/// A link to a thruster controller: its protocol over a byte line.
pub struct ThrusterLink {
    protocol: Box<dyn Protocol>,
    transport: Box<dyn Transport>,
    buffer: Vec<u8>,
    write_timeout: Duration,
    silent_since_ns: Option<u64>,
}

impl ThrusterLink {
    /// `write_timeout` bounds every write.
    pub fn new(
        protocol: Box<dyn Protocol>,
        transport: Box<dyn Transport>,
        write_timeout: Duration,
    ) -> Self {
        Self {
            protocol,
            transport,
            buffer: Vec::with_capacity(256),
            write_timeout,
            silent_since_ns: None,
        }
    }

    /// Gives up the line, which closes it, and keeps the protocol for the next one.
    pub fn into_protocol(self) -> Box<dyn Protocol> {
        self.protocol
    }

    fn write(&mut self) -> io::Result<Sent> {
        let sent = self.transport.write(&self.buffer, self.write_timeout)?;
        self.protocol.sent(sent.last_byte_out_ns);
        self.silent_since_ns.get_or_insert(sent.last_byte_out_ns);
        Ok(sent)
    }

    fn housekeeping(&mut self) -> io::Result<()> {
        self.buffer.clear();
        self.protocol
            .housekeeping(self.transport.now_ns(), &mut self.buffer);
        if self.buffer.is_empty() {
            Ok(())
        } else {
            self.write().map(drop)
        }
    }

    /// Brings a freshly opened line into a known state.
    ///
    /// # Errors
    /// When the line does not take the bytes.
    pub fn open(&mut self) -> io::Result<()> {
        self.buffer.clear();
        self.protocol
            .opened(self.transport.now_ns(), &mut self.buffer);
        self.write().map(drop)
    }

    /// Sends one set, all channels.
    ///
    /// # Errors
    /// When the line does not take the bytes in time.
    pub fn send(
        &mut self,
        sequence: u32,
        pulses: &[ChannelPulse],
        neutral: bool,
    ) -> io::Result<Sent> {
        self.buffer.clear();
        self.protocol
            .set_pulses(sequence, pulses, neutral, &mut self.buffer);
        self.write()
    }

    /// Waits up to `wait` for bytes and returns what they mean; sends housekeeping that is due.
    ///
    /// # Errors
    /// When the line is gone.
    pub fn poll(&mut self, wait: Duration) -> io::Result<Vec<LinkEvent>> {
        self.housekeeping()?;
        let mut events = Vec::new();
        let mut bytes = [0u8; 256];
        let mut wait = wait;
        loop {
            let got = self.transport.read(&mut bytes, wait)?;
            let now_ns = self.transport.now_ns();
            self.protocol.receive(&bytes[..got], now_ns, &mut events);
            if got < bytes.len() {
                self.protocol.tick(now_ns, &mut events);
                if events.iter().any(LinkEvent::is_sound) {
                    self.silent_since_ns = None;
                }
                return Ok(events);
            }
            wait = Duration::ZERO;
        }
    }

    /// Words for whoever drives, where the protocol has a way to them.
    pub fn tell(&mut self, words: &str) {
        self.protocol.tell(words);
    }

    /// Bytes the kernel still holds although they should be out; `None` where it cannot say.
    pub fn unsent_bytes(&mut self) -> Option<usize> {
        self.transport.unsent_bytes()
    }

    /// Since when something was asked and nothing sound has been heard \[ns\]; `None` = no answer is overdue.
    pub fn silent_since_ns(&self) -> Option<u64> {
        self.silent_since_ns
    }

    /// State of the controller's clock, where it has one.
    pub fn clock(&self) -> Option<Estimate> {
        self.protocol.clock()
    }
}

/// The protocol a rig names, with the rig's limits.
pub fn protocol_for(set: &ThrusterSet) -> Box<dyn Protocol> {
    let timeout_s = set.link.timeout_s.max(0.01);
    let timeout_ns = (timeout_s * 1e9) as u64;
    match set.link.kind {
        LinkKind::Maestro => Box::new(MaestroProtocol::new(set.min_us, set.max_us, timeout_ns)),
        LinkKind::Stamped => Box::new(StampedProtocol::new(StampedSettings {
            watchdog_ms: (timeout_s * 1e3).min(f64::from(u16::MAX)) as u16,
            neutral_us: set.neutral_us,
            min_us: set.min_us,
            max_us: set.max_us,
            timeout_ns,
            sync_rate_hz: 2.0,
            sync: SyncSettings::default(),
        })),
        LinkKind::Mavlink => Box::new(Follower::new(set.link.autopilot(), set.link.rate_hz)),
    }
}

#[cfg(test)]
mod tests;
