//! Messages in both directions.

use super::frame::{FrameError, frame};
use super::{MAX_CHANNELS, VERSION};
use crate::ChannelPulse;

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

/// State of the outputs.
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
        /// Pulses that are put out now.
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
        /// State of the outputs.
        state: OutputState,
        /// Watchdog in force \[ms\].
        watchdog_ms: u16,
        /// Sound frames received since the reset, wraps.
        frames_ok: u32,
        /// Broken frames since the reset, wraps.
        frames_bad: u32,
        /// Pulses that are put out now.
        pulses: Vec<ChannelPulse>,
    },
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
    /// Appends the whole frame, delimiter included. Pulses beyond [`MAX_CHANNELS`] do not fit and are omitted.
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
