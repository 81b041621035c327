#![doc = include_str!("stamped.md")]

use super::ChannelPulse;
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
    /// Supply voltage too low.
    pub const UNDERVOLTAGE: u16 = 1 << 6;
    /// An output stage reports a fault.
    pub const OUTPUT: u16 = 1 << 7;

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
        let mut names: Vec<_> = NAMES
            .iter()
            .enumerate()
            .filter(|(bit, _)| bits & (1 << bit) != 0)
            .map(|(_, name)| *name)
            .collect();
        if bits >> NAMES.len() != 0 {
            names.push("unassigned error bit");
        }
        names
    }
}

/// Host to controller.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum HostMessage {
    /// 0x01: new pulses; answered by [`ControllerMessage::Ack`].
    SetPulses {
        /// Counts commands.
        sequence: u32,
        /// One per channel.
        pulses: Vec<ChannelPulse>,
    },
    /// 0x02: two-way clock sync and ping; answered by [`ControllerMessage::TimeSyncReply`].
    TimeSync {
        /// Host's CLOCK_MONOTONIC when the frame was made \[us\]; comes back untouched.
        host_us: u64,
    },
    /// 0x03: all outputs to neutral; answered by Ack.
    Neutral {
        /// Counts commands, one series with SetPulses.
        sequence: u32,
    },
    /// 0x04: answered by [`ControllerMessage::Status`].
    GetStatus {
        /// Comes back in the answer.
        token: u32,
    },
    /// 0x05: watchdog and limits; answered by Status.
    Configure {
        /// Comes back in the answer.
        token: u32,
        /// Neutral after this long without a sound frame \[ms\]; 0 keeps the firmware's own.
        watchdog_ms: u16,
        /// Neutral pulse \[quarter us\].
        neutral: u16,
        /// Smallest pulse accepted \[quarter us\].
        min: u16,
        /// Largest pulse accepted \[quarter us\].
        max: u16,
    },
}

/// What the outputs are doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OutputState {
    /// 0: neutral since the reset.
    Start,
    /// 1: driven by SetPulses.
    Running,
    /// 2: neutral on command.
    Neutral,
    /// 3: neutral because the watchdog ran out.
    Watchdog,
}

/// Controller to host.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ControllerMessage {
    /// 0x81: answer to SetPulses and Neutral.
    Ack {
        /// Of the command.
        sequence: u32,
        /// Controller clock when the pulses took effect \[us\], wraps at 2^32.
        time_us: u32,
        /// Error bits since the last Ack or Status.
        errors: u16,
        /// What is put out now.
        pulses: Vec<ChannelPulse>,
    },
    /// 0x82: answer to TimeSync.
    TimeSyncReply {
        /// As received.
        host_us: u64,
        /// Controller clock at the last byte of the request \[us\].
        rx_us: u32,
        /// Controller clock at the last byte of this reply \[us\].
        tx_us: u32,
        /// A number that differs after every reset.
        boot_id: u16,
    },
    /// 0x83: answer to GetStatus and Configure.
    Status {
        /// As received.
        token: u32,
        /// Controller clock \[us\].
        time_us: u32,
        /// A number that differs after every reset.
        boot_id: u16,
        /// Error bits since the last Ack or Status.
        errors: u16,
        /// Outputs.
        state: OutputState,
        /// Watchdog in force \[ms\].
        watchdog_ms: u16,
        /// Sound frames received since the reset, wraps.
        frames_ok: u32,
        /// Broken frames since the reset, wraps.
        frames_bad: u32,
        /// What is put out now.
        pulses: Vec<ChannelPulse>,
    },
}

/// Why a received frame was dropped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// No delimiter within the longest frame.
    #[error(
        "more than {max} bytes without a 00 delimiter: dropped up to the next one (wrong baud rate or protocol?)"
    )]
    TooLong {
        /// Longest frame.
        max: usize,
    },
    /// COBS code byte points beyond the frame.
    #[error("{len} bytes between delimiters are not valid COBS")]
    Cobs {
        /// Bytes between delimiters.
        len: usize,
    },
    /// Fewer bytes than version, type and CRC.
    #[error("frame of {len} bytes is shorter than version, type and CRC (4)")]
    Short {
        /// Decoded bytes.
        len: usize,
    },
    /// CRC differs.
    #[error("CRC-16 is {got:#06x}, frame says {want:#06x}")]
    Crc {
        /// Computed.
        got: u16,
        /// In the frame.
        want: u16,
    },
    /// Another version.
    #[error("protocol version {got}, this side speaks {VERSION}: update the firmware or the host")]
    Version {
        /// In the frame.
        got: u8,
    },
    /// Unknown type for this direction.
    #[error("unknown message type {got:#04x}")]
    Type {
        /// In the frame.
        got: u8,
    },
    /// Length does not fit the type.
    #[error("message type {kind:#04x} of {len} bytes does not have its type's length")]
    Length {
        /// Type.
        kind: u8,
        /// Decoded bytes.
        len: usize,
    },
    /// A field holds a value outside its enumeration.
    #[error("message type {kind:#04x}: field value {got} is not defined")]
    Value {
        /// Type.
        kind: u8,
        /// Value.
        got: u8,
    },
}

/// CRC-16/IBM-3740 (CCITT-FALSE): polynomial 0x1021, initial 0xFFFF, not reflected, no final xor.
pub fn crc16(bytes: &[u8]) -> u16 {
    CRC.checksum(bytes)
}

fn frame(kind: u8, body: impl FnOnce(&mut Vec<u8>), out: &mut Vec<u8>) {
    let mut raw = vec![VERSION, kind];
    body(&mut raw);
    let crc = crc16(&raw);
    raw.extend_from_slice(&crc.to_le_bytes());
    out.extend_from_slice(&cobs::encode_vec(&raw));
    out.push(0);
}

fn put_pulses(pulses: &[ChannelPulse], raw: &mut Vec<u8>) {
    let pulses = &pulses[..pulses.len().min(MAX_CHANNELS)];
    raw.push(pulses.len() as u8);
    for p in pulses {
        raw.push(p.channel);
        raw.extend_from_slice(&p.quarter_us.to_le_bytes());
    }
}

impl HostMessage {
    /// Appends the whole frame, delimiter included. Pulses beyond [`MAX_CHANNELS`] do not fit and are left out.
    pub fn encode(&self, out: &mut Vec<u8>) {
        match self {
            HostMessage::SetPulses { sequence, pulses } => frame(
                0x01,
                |raw| {
                    raw.extend_from_slice(&sequence.to_le_bytes());
                    put_pulses(pulses, raw);
                },
                out,
            ),
            HostMessage::TimeSync { host_us } => frame(
                0x02,
                |raw| raw.extend_from_slice(&host_us.to_le_bytes()),
                out,
            ),
            HostMessage::Neutral { sequence } => frame(
                0x03,
                |raw| raw.extend_from_slice(&sequence.to_le_bytes()),
                out,
            ),
            HostMessage::GetStatus { token } => {
                frame(0x04, |raw| raw.extend_from_slice(&token.to_le_bytes()), out)
            }
            HostMessage::Configure {
                token,
                watchdog_ms,
                neutral,
                min,
                max,
            } => frame(
                0x05,
                |raw| {
                    raw.extend_from_slice(&token.to_le_bytes());
                    for value in [watchdog_ms, neutral, min, max] {
                        raw.extend_from_slice(&value.to_le_bytes());
                    }
                },
                out,
            ),
        }
    }

    /// The message in a deframed, CRC-checked payload.
    ///
    /// # Errors
    /// [`FrameError`] when version, type or length is wrong.
    pub fn parse(payload: &[u8]) -> Result<Self, FrameError> {
        let (kind, mut r) = Reader::open(payload)?;
        let message = match kind {
            0x01 => HostMessage::SetPulses {
                sequence: r.u32()?,
                pulses: r.pulses()?,
            },
            0x02 => HostMessage::TimeSync { host_us: r.u64()? },
            0x03 => HostMessage::Neutral { sequence: r.u32()? },
            0x04 => HostMessage::GetStatus { token: r.u32()? },
            0x05 => HostMessage::Configure {
                token: r.u32()?,
                watchdog_ms: r.u16()?,
                neutral: r.u16()?,
                min: r.u16()?,
                max: r.u16()?,
            },
            got => return Err(FrameError::Type { got }),
        };
        r.end()?;
        Ok(message)
    }
}

impl ControllerMessage {
    /// Appends the whole frame, delimiter included.
    pub fn encode(&self, out: &mut Vec<u8>) {
        match self {
            ControllerMessage::Ack {
                sequence,
                time_us,
                errors,
                pulses,
            } => frame(
                0x81,
                |raw| {
                    raw.extend_from_slice(&sequence.to_le_bytes());
                    raw.extend_from_slice(&time_us.to_le_bytes());
                    raw.extend_from_slice(&errors.to_le_bytes());
                    put_pulses(pulses, raw);
                },
                out,
            ),
            ControllerMessage::TimeSyncReply {
                host_us,
                rx_us,
                tx_us,
                boot_id,
            } => frame(
                0x82,
                |raw| {
                    raw.extend_from_slice(&host_us.to_le_bytes());
                    raw.extend_from_slice(&rx_us.to_le_bytes());
                    raw.extend_from_slice(&tx_us.to_le_bytes());
                    raw.extend_from_slice(&boot_id.to_le_bytes());
                },
                out,
            ),
            ControllerMessage::Status {
                token,
                time_us,
                boot_id,
                errors,
                state,
                watchdog_ms,
                frames_ok,
                frames_bad,
                pulses,
            } => frame(
                0x83,
                |raw| {
                    raw.extend_from_slice(&token.to_le_bytes());
                    raw.extend_from_slice(&time_us.to_le_bytes());
                    raw.extend_from_slice(&boot_id.to_le_bytes());
                    raw.extend_from_slice(&errors.to_le_bytes());
                    raw.push(*state as u8);
                    raw.extend_from_slice(&watchdog_ms.to_le_bytes());
                    raw.extend_from_slice(&frames_ok.to_le_bytes());
                    raw.extend_from_slice(&frames_bad.to_le_bytes());
                    put_pulses(pulses, raw);
                },
                out,
            ),
        }
    }

    /// The message in a deframed, CRC-checked payload.
    ///
    /// # Errors
    /// [`FrameError`] when version, type, length or a field is wrong.
    pub fn parse(payload: &[u8]) -> Result<Self, FrameError> {
        let (kind, mut r) = Reader::open(payload)?;
        let message = match kind {
            0x81 => ControllerMessage::Ack {
                sequence: r.u32()?,
                time_us: r.u32()?,
                errors: r.u16()?,
                pulses: r.pulses()?,
            },
            0x82 => ControllerMessage::TimeSyncReply {
                host_us: r.u64()?,
                rx_us: r.u32()?,
                tx_us: r.u32()?,
                boot_id: r.u16()?,
            },
            0x83 => ControllerMessage::Status {
                token: r.u32()?,
                time_us: r.u32()?,
                boot_id: r.u16()?,
                errors: r.u16()?,
                state: match r.u8()? {
                    0 => OutputState::Start,
                    1 => OutputState::Running,
                    2 => OutputState::Neutral,
                    3 => OutputState::Watchdog,
                    got => return Err(FrameError::Value { kind, got }),
                },
                watchdog_ms: r.u16()?,
                frames_ok: r.u32()?,
                frames_bad: r.u32()?,
                pulses: r.pulses()?,
            },
            got => return Err(FrameError::Type { got }),
        };
        r.end()?;
        Ok(message)
    }
}

/// Little-endian reader that knows the frame it reads, for its errors.
struct Reader<'a> {
    kind: u8,
    len: usize,
    rest: &'a [u8],
}

impl<'a> Reader<'a> {
    fn open(payload: &'a [u8]) -> Result<(u8, Self), FrameError> {
        let [version, kind, rest @ ..] = payload else {
            return Err(FrameError::Short { len: payload.len() });
        };
        if *version != VERSION {
            return Err(FrameError::Version { got: *version });
        }
        Ok((
            *kind,
            Self {
                kind: *kind,
                len: payload.len(),
                rest,
            },
        ))
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N], FrameError> {
        let Some((head, rest)) = self.rest.split_first_chunk::<N>() else {
            return Err(FrameError::Length {
                kind: self.kind,
                len: self.len,
            });
        };
        self.rest = rest;
        Ok(*head)
    }

    fn u8(&mut self) -> Result<u8, FrameError> {
        Ok(self.take::<1>()?[0])
    }

    fn u16(&mut self) -> Result<u16, FrameError> {
        Ok(u16::from_le_bytes(self.take()?))
    }

    fn u32(&mut self) -> Result<u32, FrameError> {
        Ok(u32::from_le_bytes(self.take()?))
    }

    fn u64(&mut self) -> Result<u64, FrameError> {
        Ok(u64::from_le_bytes(self.take()?))
    }

    fn pulses(&mut self) -> Result<Vec<ChannelPulse>, FrameError> {
        let count = usize::from(self.u8()?);
        if count > MAX_CHANNELS {
            return Err(FrameError::Value {
                kind: self.kind,
                got: count as u8,
            });
        }
        (0..count)
            .map(|_| {
                Ok(ChannelPulse {
                    channel: self.u8()?,
                    quarter_us: self.u16()?,
                })
            })
            .collect()
    }

    fn end(&self) -> Result<(), FrameError> {
        if self.rest.is_empty() {
            Ok(())
        } else {
            Err(FrameError::Length {
                kind: self.kind,
                len: self.len,
            })
        }
    }
}

/// Bytes to CRC-checked payloads (version, type, body), either direction, fed byte by byte.
#[derive(Debug, Default)]
pub struct Deframer {
    buffer: Vec<u8>,
    overflow: bool,
}

impl Deframer {
    /// Takes one byte; at a delimiter, the payload or why it was dropped. Resynchronises at every 00.
    pub fn feed(&mut self, byte: u8) -> Option<Result<Vec<u8>, FrameError>> {
        if byte != 0 {
            if self.buffer.len() < MAX_FRAME - 1 {
                self.buffer.push(byte);
                return None;
            }
            // Reported once; then silence until the next delimiter, so that a wrong baud rate cannot flood the log.
            return (!std::mem::replace(&mut self.overflow, true))
                .then_some(Err(FrameError::TooLong { max: MAX_FRAME }));
        }
        let mut raw = std::mem::take(&mut self.buffer);
        if std::mem::take(&mut self.overflow) || raw.is_empty() {
            return None;
        }
        Some(Self::unpack(&mut raw).map(|len| {
            raw.truncate(len);
            raw
        }))
    }

    fn unpack(raw: &mut [u8]) -> Result<usize, FrameError> {
        let coded = raw.len();
        let len = cobs::decode_in_place(raw).map_err(|_| FrameError::Cobs { len: coded })?;
        if len < 4 || len > coded {
            return Err(FrameError::Short { len });
        }
        let (payload, crc) = raw[..len].split_at(len - 2);
        let want = u16::from_le_bytes([crc[0], crc[1]]);
        let got = crc16(payload);
        if got == want {
            Ok(len - 2)
        } else {
            Err(FrameError::Crc { got, want })
        }
    }
}

#[cfg(test)]
mod tests;
