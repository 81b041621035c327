//! Frames: COBS, CRC, resynchronisation.

use super::{MAX_FRAME, VERSION, crc16};

/// Reason why a received frame was dropped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum FrameError {
    #[error(
        "more than {max} bytes without a 00 delimiter: dropped up to the next one (wrong baud rate or protocol?)"
    )]
    TooLong { max: usize },
    #[error("{len} bytes between delimiters are not valid COBS")]
    Cobs { len: usize },
    /// Fewer bytes than version, type and CRC.
    #[error("frame of {len} bytes is shorter than version, type and CRC (4)")]
    Short { len: usize },
    #[error("CRC-16 is {got:#06x}, frame says {want:#06x}")]
    Crc { got: u16, want: u16 },
    #[error("protocol version {got}, this side speaks {VERSION}: update the firmware or the host")]
    Version { got: u8 },
    #[error("unknown message type {got:#04x}")]
    Type { got: u8 },
    #[error("message type {kind:#04x} of {len} bytes does not have its type's length")]
    Length { kind: u8, len: usize },
    #[error("message type {kind:#04x}: field value {got} is not defined")]
    Value { kind: u8, got: u8 },
}

/// Appends a frame of this type, delimiter included.
pub(super) fn frame(kind: u8, body: impl FnOnce(&mut Vec<u8>), out: &mut Vec<u8>) {
    let mut raw = vec![VERSION, kind];
    body(&mut raw);
    let crc = crc16(&raw);
    raw.extend_from_slice(&crc.to_le_bytes());
    out.extend_from_slice(&cobs::encode_vec(&raw));
    out.push(0);
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
