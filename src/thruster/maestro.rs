//! Pololu Maestro servo controllers, compact protocol, both directions, without I/O.
//!
//! Source: Pololu Maestro Servo Controller User's Guide, section 5 "Serial Interface" (5.c compact protocol,
//! 5.e commands) and section 4.b (error bits). Command bytes have bit 7 set, data bytes do not; targets and
//! positions are quarters of a microsecond; answers are two bytes, low byte first, without any framing.
//!
//! Set Target has no answer: the echo of a command is Get Position. Because answers carry neither a command nor a
//! channel, a lost byte would shift every later answer; [`Responses`] therefore refuses implausible values and,
//! after a timeout or a surplus byte, throws everything away until the line has been quiet.

use std::collections::VecDeque;

/// Set Target: 0x84, channel, low 7 bits, high 7 bits.
pub const SET_TARGET: u8 = 0x84;
/// Set Speed: 0x87, channel, low 7 bits, high 7 bits.
pub const SET_SPEED: u8 = 0x87;
/// Set Acceleration: 0x89, channel, low 7 bits, high 7 bits.
pub const SET_ACCELERATION: u8 = 0x89;
/// Get Position: 0x90, channel; answer: position low, high.
pub const GET_POSITION: u8 = 0x90;
/// Get Moving State: 0x93; answer: one byte.
pub const GET_MOVING_STATE: u8 = 0x93;
/// Get Errors: 0xA1; answer: error bits low, high; reading clears them.
pub const GET_ERRORS: u8 = 0xA1;
/// Go Home: 0xA2: every channel to its home position (for a rig: set to neutral in the controller's settings).
pub const GO_HOME: u8 = 0xA2;
/// Largest target the 14 data bits carry \[quarter us\].
pub const MAX_TARGET: u16 = 0x3fff;

/// Bit 5 of the error register: no valid command within the controller's own serial timeout.
pub const ERROR_SERIAL_TIMEOUT: u16 = 1 << 5;
/// Bit 4 of the error register: a command byte or data byte that makes no sense.
pub const ERROR_SERIAL_PROTOCOL: u16 = 1 << 4;

const ERROR_NAMES: [&str; 9] = [
    "serial signal error",
    "serial overrun",
    "serial receive buffer full",
    "serial CRC error",
    "serial protocol error",
    "serial timeout",
    "script stack error",
    "script call stack error",
    "script program counter error",
];

/// Names of the error bits that are set; bits 9..16 are unassigned and reported as such.
pub fn error_names(bits: u16) -> Vec<&'static str> {
    let mut names: Vec<_> = ERROR_NAMES
        .iter()
        .enumerate()
        .filter(|(bit, _)| bits & (1 << bit) != 0)
        .map(|(_, name)| *name)
        .collect();
    if bits >> ERROR_NAMES.len() != 0 {
        names.push("unassigned error bit");
    }
    names
}

/// Set Target; channels above 127 and targets above [`MAX_TARGET`] do not fit the data bits: `None`.
pub fn set_target(channel: u8, quarter_us: u16) -> Option<[u8; 4]> {
    (channel < 0x80 && quarter_us <= MAX_TARGET).then_some([
        SET_TARGET,
        channel,
        (quarter_us & 0x7f) as u8,
        (quarter_us >> 7) as u8,
    ])
}

/// Get Position.
pub fn get_position(channel: u8) -> Option<[u8; 2]> {
    (channel < 0x80).then_some([GET_POSITION, channel])
}

/// An answer the host waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Request {
    /// Position of a channel; the smallest and largest believable answer \[quarter us\].
    Position {
        /// Channel.
        channel: u8,
        /// Smallest believable position.
        min: u16,
        /// Largest believable position.
        max: u16,
    },
    /// The error register.
    Errors,
}

/// What the decoder found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Response {
    /// The answer to the oldest open request.
    Answer {
        /// The request.
        request: Request,
        /// Position \[quarter us\] or error bits.
        value: u16,
    },
    /// Answers were lost or shifted: all open requests are void; bytes are ignored until the line is quiet.
    Resync {
        /// Requests given up.
        lost: usize,
        /// Why.
        reason: ResyncReason,
    },
}

/// Why the decoder threw its state away.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ResyncReason {
    /// The oldest request was not answered in time.
    Timeout,
    /// A byte came although nothing was asked.
    Surplus,
    /// An answer outside the believable range.
    Implausible,
}

/// Decoder of the controller's answers, fed byte by byte.
#[derive(Debug)]
pub struct Responses {
    open: VecDeque<(Request, u64)>,
    low: Option<u8>,
    timeout_ns: u64,
    quiet_ns: u64,
    /// Ignore bytes until the line was silent up to this time.
    deaf_until_ns: Option<u64>,
}

impl Responses {
    /// `timeout_ns` for one answer; `quiet_ns` of silence end a resync.
    pub fn new(timeout_ns: u64, quiet_ns: u64) -> Self {
        Self {
            open: VecDeque::new(),
            low: None,
            timeout_ns,
            quiet_ns,
            deaf_until_ns: None,
        }
    }

    /// A request has been put on the wire; its answer is expected after those before it.
    pub fn expect(&mut self, request: Request, sent_ns: u64) {
        self.open.push_back((request, sent_ns));
    }

    /// Open requests.
    pub fn open(&self) -> usize {
        self.open.len()
    }

    /// Whether bytes are being ignored until the line is quiet: requests made now would lose their answers.
    pub fn resyncing(&self, now_ns: u64) -> bool {
        self.deaf_until_ns.is_some_and(|until| now_ns < until)
    }

    /// Takes one received byte.
    pub fn feed(&mut self, byte: u8, at_ns: u64) -> Option<Response> {
        if let Some(until) = self.deaf_until_ns {
            if at_ns < until {
                self.deaf_until_ns = Some(at_ns.saturating_add(self.quiet_ns));
                return None;
            }
            self.deaf_until_ns = None;
        }
        let Some(&(request, _)) = self.open.front() else {
            return Some(self.resync(at_ns, ResyncReason::Surplus));
        };
        let Some(low) = self.low.take() else {
            self.low = Some(byte);
            return None;
        };
        let value = u16::from_le_bytes([low, byte]);
        let believable = match request {
            Request::Position { min, max, .. } => (min..=max).contains(&value),
            Request::Errors => value >> ERROR_NAMES.len() == 0,
        };
        if !believable {
            return Some(self.resync(at_ns, ResyncReason::Implausible));
        }
        self.open.pop_front();
        Some(Response::Answer { request, value })
    }

    /// Lets time pass without bytes.
    pub fn tick(&mut self, now_ns: u64) -> Option<Response> {
        let &(_, sent_ns) = self.open.front()?;
        (now_ns > sent_ns.saturating_add(self.timeout_ns))
            .then(|| self.resync(now_ns, ResyncReason::Timeout))
    }

    /// Forgets everything, as after opening the port.
    pub fn reset(&mut self) {
        self.open.clear();
        self.low = None;
        self.deaf_until_ns = None;
    }

    fn resync(&mut self, now_ns: u64, reason: ResyncReason) -> Response {
        let lost = self.open.len();
        self.open.clear();
        self.low = None;
        self.deaf_until_ns = Some(now_ns.saturating_add(self.quiet_ns));
        Response::Resync { lost, reason }
    }
}

/// A command as the controller understands it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Command {
    /// New target of a channel \[quarter us\]; 0 = stop pulses.
    SetTarget {
        /// Channel.
        channel: u8,
        /// Target.
        quarter_us: u16,
    },
    /// Speed or acceleration limit: accepted, without effect in the simulated controller.
    SetLimit,
    /// Position asked.
    GetPosition {
        /// Channel.
        channel: u8,
    },
    /// Moving state asked.
    GetMovingState,
    /// Errors asked.
    GetErrors,
    /// All channels home.
    GoHome,
    /// A byte that fits no command: error bit 4.
    ProtocolError,
}

/// The controller's side: bytes to commands.
#[derive(Debug, Default)]
pub struct CommandParser {
    command: Option<u8>,
    data: [u8; 3],
    have: usize,
}

impl CommandParser {
    /// Takes one byte from the host.
    pub fn feed(&mut self, byte: u8) -> Option<Command> {
        if byte & 0x80 != 0 {
            // A new command byte before the old one is complete: the old one is lost, as in the real device.
            let cut_short = self.command.take().is_some();
            self.have = 0;
            return match byte {
                GET_ERRORS => Some(Command::GetErrors),
                GO_HOME => Some(Command::GoHome),
                GET_MOVING_STATE => Some(Command::GetMovingState),
                SET_TARGET | SET_SPEED | SET_ACCELERATION | GET_POSITION => {
                    self.command = Some(byte);
                    cut_short.then_some(Command::ProtocolError)
                }
                // 0xAA: baud-rate detection, or the start of the long protocol we do not speak.
                0xAA => None,
                _ => Some(Command::ProtocolError),
            };
        }
        let Some(command) = self.command else {
            return Some(Command::ProtocolError);
        };
        self.data[self.have] = byte;
        self.have += 1;
        let needed = if command == GET_POSITION { 1 } else { 3 };
        if self.have < needed {
            return None;
        }
        self.command = None;
        self.have = 0;
        let [channel, low, high] = self.data;
        Some(match command {
            GET_POSITION => Command::GetPosition { channel },
            SET_TARGET => Command::SetTarget {
                channel,
                quarter_us: u16::from(low) | (u16::from(high) << 7),
            },
            _ => Command::SetLimit,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MS: u64 = 1_000_000;
    const POSITION: Request = Request::Position {
        channel: 2,
        min: 4400,
        max: 7600,
    };

    fn feed_all(r: &mut Responses, bytes: &[u8], at_ns: u64) -> Vec<Response> {
        bytes.iter().filter_map(|b| r.feed(*b, at_ns)).collect()
    }

    #[test]
    fn set_target_is_the_guides_example() {
        // User's Guide 5.e: channel 2 to 1500 us = 6000 quarters = 0x84 0x02 0x70 0x2E.
        assert_eq!(set_target(2, 6000), Some([0x84, 0x02, 0x70, 0x2e]));
        assert_eq!(set_target(128, 6000), None);
        assert_eq!(set_target(2, 0x4000), None);
    }

    #[test]
    fn answers_come_in_order() {
        let mut r = Responses::new(50 * MS, 5 * MS);
        r.expect(POSITION, 0);
        r.expect(Request::Errors, 0);
        let got = feed_all(&mut r, &[0x70, 0x17, 0x20, 0x00], MS);
        assert_eq!(
            got,
            [
                Response::Answer {
                    request: POSITION,
                    value: 6000
                },
                Response::Answer {
                    request: Request::Errors,
                    value: ERROR_SERIAL_TIMEOUT
                },
            ]
        );
        assert_eq!(
            error_names(ERROR_SERIAL_TIMEOUT | 1),
            ["serial signal error", "serial timeout"]
        );
    }

    #[test]
    fn a_lost_byte_shifts_nothing() {
        let mut r = Responses::new(50 * MS, 5 * MS);
        r.expect(POSITION, 0);
        r.expect(POSITION, 0);
        // First byte lost: 0x17 0x70 = 28695 is not believable.
        let got = feed_all(&mut r, &[0x17, 0x70, 0x17], MS);
        assert_eq!(
            got,
            [Response::Resync {
                lost: 2,
                reason: ResyncReason::Implausible
            }]
        );
        assert!(r.resyncing(3 * MS));
        r.expect(POSITION, 10 * MS);
        let got = feed_all(&mut r, &[0x70, 0x17], 11 * MS);
        assert_eq!(
            got,
            [Response::Answer {
                request: POSITION,
                value: 6000
            }]
        );
    }

    #[test]
    fn silence_and_surplus_resync() {
        let mut r = Responses::new(50 * MS, 5 * MS);
        r.expect(POSITION, 0);
        assert_eq!(r.tick(50 * MS), None);
        assert_eq!(
            r.tick(51 * MS),
            Some(Response::Resync {
                lost: 1,
                reason: ResyncReason::Timeout
            })
        );
        assert_eq!(r.tick(52 * MS), None);
        assert_eq!(
            r.feed(1, 60 * MS),
            Some(Response::Resync {
                lost: 0,
                reason: ResyncReason::Surplus
            })
        );
    }

    proptest! {
        #[test]
        fn commands_survive_their_own_encoding(channel in 0u8..128, quarter_us in 0u16..=MAX_TARGET) {
            let mut parser = CommandParser::default();
            let bytes = set_target(channel, quarter_us).unwrap();
            let got: Vec<_> = bytes.iter().filter_map(|b| parser.feed(*b)).collect();
            prop_assert_eq!(got, vec![Command::SetTarget { channel, quarter_us }]);
        }

        #[test]
        fn arbitrary_bytes_never_panic_and_a_clean_command_is_understood_after_them(
            garbage in prop::collection::vec(any::<u8>(), 0..200)
        ) {
            let mut parser = CommandParser::default();
            for b in &garbage {
                parser.feed(*b);
            }
            let bytes = set_target(3, 6000).unwrap();
            let got: Vec<_> = bytes.iter().filter_map(|b| parser.feed(*b)).collect();
            prop_assert_eq!(got.last(), Some(&Command::SetTarget { channel: 3, quarter_us: 6000 }));
        }

        #[test]
        fn arbitrary_answers_never_panic_and_quiet_ends_the_resync(
            garbage in prop::collection::vec((any::<u8>(), 0u64..20 * MS), 0..200)
        ) {
            let mut r = Responses::new(50 * MS, 5 * MS);
            let mut now = 0;
            for (byte, wait) in garbage {
                now += wait;
                r.tick(now);
                r.feed(byte, now);
                if byte & 1 == 1 {
                    r.expect(POSITION, now);
                }
            }
            now += 100 * MS;
            r.tick(now);
            now += 10 * MS;
            prop_assert!(!r.resyncing(now));
            r.expect(POSITION, now);
            let got = feed_all(&mut r, &[0x70, 0x17], now);
            prop_assert_eq!(got, vec![Response::Answer { request: POSITION, value: 6000 }]);
        }
    }
}
