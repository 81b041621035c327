//! The controller's side: bytes to commands.

use super::{
    GET_ERRORS, GET_MOVING_STATE, GET_POSITION, GO_HOME, SET_ACCELERATION, SET_SPEED, SET_TARGET,
};

/// A command as the controller understands it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Command {
    /// New target of a channel \[quarter us\]; 0 = stop pulses.
    SetTarget {
        /// Number of the channel.
        channel: u8,
        /// Target of the pulse \[quarter us\].
        quarter_us: u16,
    },
    /// Speed or acceleration limit: accepted, without effect in the simulated controller.
    SetLimit,
    /// Position asked.
    GetPosition {
        /// Number of the channel.
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
