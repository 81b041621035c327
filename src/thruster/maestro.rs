//! Pololu Maestro servo controllers, compact protocol, both directions, without I/O.
//!
//! Source: Pololu Maestro Servo Controller User's Guide, section 5 "Serial Interface" (5.c compact protocol,
//! 5.e commands) and section 4.b (error bits). Command bytes have bit 7 set, data bytes do not; targets and
//! positions are quarters of a microsecond; answers are two bytes, low byte first, without any framing.
//!
//! Set Target has no answer: the echo of a command is Get Position. Because answers carry neither a command nor a
//! channel, a lost byte would shift every later answer; [`Responses`] therefore refuses implausible values and,
//! after a timeout or a surplus byte, throws everything away until the line has been quiet.

mod command;
mod responses;

pub use command::{Command, CommandParser};
pub use responses::{Request, Response, Responses, ResyncReason};

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
    crate::bit_names(ERROR_NAMES, bits)
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

#[cfg(test)]
mod tests;
