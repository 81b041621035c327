#![doc = include_str!("stamped.md")]

mod frame;
mod message;

pub use frame::{Deframer, FrameError};
pub use message::{ControllerMessage, HostMessage, OutputState};

use crc::{CRC_16_IBM_3740, Crc};

/// Protocol version, first byte of every frame.
pub const VERSION: u8 = 1;
/// Most channels in one frame.
pub const MAX_CHANNELS: usize = 24;
/// Longest frame on the wire, delimiter included \[bytes\].
pub const MAX_FRAME: usize = 26 + 3 * MAX_CHANNELS + 2 + 2;

const CRC: Crc<u16> = Crc::<u16>::new(&CRC_16_IBM_3740);

/// Error bits of Ack and Status.
pub mod error {
    /// A frame with a wrong CRC was dropped.
    pub const CRC: u16 = 1 << 0;
    /// A frame was too long, or COBS or its length was wrong.
    pub const FRAMING: u16 = 1 << 1;
    /// Unknown version or type.
    pub const UNKNOWN: u16 = 1 << 2;
    /// A pulse outside the configured range: the whole SetPulses was refused.
    pub const RANGE: u16 = 1 << 3;
    /// A channel the controller does not have: the whole SetPulses was refused.
    pub const CHANNEL: u16 = 1 << 4;
    /// The watchdog has put all outputs to neutral.
    pub const WATCHDOG: u16 = 1 << 5;

    /// By bit; the last two are the controller's own. Any that every answer reports stops a plan.
    const NAMES: [&str; 8] = [
        "CRC error",
        "framing error",
        "unknown version or type",
        "pulse out of range",
        "unknown channel",
        "watchdog: neutral",
        "undervoltage",
        "output fault",
    ];

    /// Names of the bits that are set.
    pub fn names(bits: u16) -> Vec<&'static str> {
        crate::bit_names(NAMES, bits)
    }
}

/// CRC-16/IBM-3740 (CCITT-FALSE): polynomial 0x1021, initial 0xFFFF, not reflected, no final xor.
pub fn crc16(bytes: &[u8]) -> u16 {
    CRC.checksum(bytes)
}

#[cfg(test)]
mod tests;
