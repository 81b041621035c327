//! Bytes to frames and back. A frame is handed out only with a right check sum.

use mavlink::dialects::ardupilotmega::MavMessage;
use mavlink::{
    MAVLinkV1MessageRaw, MAVLinkV2MessageRaw, MavHeader, MavlinkVersion, Message, MessageData,
};

const STX_V1: u8 = 0xFE;
const STX_V2: u8 = 0xFD;
/// Largest frame of version 2 with its signature \[bytes\].
const FRAME_MAX: usize = 280;
/// Bit of the incompatibility flags: 13 bytes of signature follow.
const SIGNED: u8 = 0x01;

/// A frame with a right check sum.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Frame {
    /// Version on the wire.
    pub version: MavlinkVersion,
    /// Counter of the sender.
    pub sequence: u8,
    /// Sender's system.
    pub system: u8,
    /// Sender's component.
    pub component: u8,
    /// Message id.
    pub id: u32,
    /// Payload as sent; version 2 cuts zeros at its end.
    pub payload: Vec<u8>,
}

impl Frame {
    /// The message, if the frame holds this kind; `None` also where a value is none of its enumeration.
    pub fn message<D: MessageData>(&self) -> Option<D> {
        if self.id != D::ID {
            return None;
        }
        D::deser(self.version, &self.payload).ok()
    }
}

/// Bytes in, frames out; what is none is counted.
#[derive(Debug, Default)]
pub struct Deframer {
    buffer: Vec<u8>,
    dropped: usize,
}

impl Deframer {
    /// Takes one byte.
    pub fn feed(&mut self, byte: u8) -> Option<Frame> {
        self.buffer.push(byte);
        loop {
            match self.buffer.first()? {
                &STX_V1 | &STX_V2 => {}
                _ => {
                    self.skip();
                    continue;
                }
            }
            let length = self.length()?;
            if self.buffer.len() < length {
                return None;
            }
            if let Some(frame) = self.whole(length) {
                self.buffer.drain(..length);
                return Some(frame);
            }
            // The start was a byte of something else: look for the next one in what is here.
            self.skip();
        }
    }

    /// Bytes that were part of no frame since the last call.
    pub fn take_dropped(&mut self) -> usize {
        std::mem::take(&mut self.dropped)
    }

    fn skip(&mut self) {
        let next = self
            .buffer
            .iter()
            .skip(1)
            .position(|b| matches!(*b, STX_V1 | STX_V2));
        let gone = next.map_or(self.buffer.len(), |i| i + 1);
        self.buffer.drain(..gone);
        self.dropped += gone;
    }

    /// Length of the frame at the buffer's start \[bytes\]; `None` = not known yet.
    fn length(&self) -> Option<usize> {
        let payload = usize::from(*self.buffer.get(1)?);
        match self.buffer[0] {
            STX_V1 => Some(6 + payload + 2),
            _ => {
                let signed = *self.buffer.get(2)? & SIGNED != 0;
                Some(10 + payload + 2 + if signed { 13 } else { 0 })
            }
        }
    }

    fn whole(&self, length: usize) -> Option<Frame> {
        let bytes = &self.buffer[..length];
        if bytes[0] == STX_V1 {
            let mut all = [0; 263];
            all.get_mut(..length)?.copy_from_slice(bytes);
            let raw = MAVLinkV1MessageRaw::from_bytes_unparsed(all);
            return raw.has_valid_crc::<MavMessage>().then(|| Frame {
                version: MavlinkVersion::V1,
                sequence: raw.sequence(),
                system: raw.system_id(),
                component: raw.component_id(),
                id: raw.message_id().into(),
                payload: raw.payload().to_vec(),
            });
        }
        // Other incompatible features than a signature change the frame's shape.
        if bytes[2] & !SIGNED != 0 {
            return None;
        }
        let id = u32::from_le_bytes([bytes[7], bytes[8], bytes[9], 0]);
        let end = 10 + usize::from(bytes[1]);
        let sum = mavlink::calculate_crc(&bytes[1..end], MavMessage::extra_crc(id));
        (sum.to_le_bytes() == bytes[end..end + 2]).then(|| Frame {
            version: MavlinkVersion::V2,
            sequence: bytes[4],
            system: bytes[5],
            component: bytes[6],
            id,
            payload: bytes[10..end].to_vec(),
        })
    }
}

/// Frames of one sender, version 2.
#[derive(Debug, Clone)]
pub struct Sender {
    /// Own system.
    pub system: u8,
    /// Own component.
    pub component: u8,
    sequence: u8,
}

impl Sender {
    /// Counts from 0.
    pub fn new(system: u8, component: u8) -> Self {
        Self {
            system,
            component,
            sequence: 0,
        }
    }

    /// Appends the frame of a message.
    pub fn encode<D: MessageData>(&mut self, message: &D, out: &mut Vec<u8>) {
        let header = MavHeader {
            system_id: self.system.into(),
            component_id: self.component,
            sequence: self.sequence,
        };
        self.sequence = self.sequence.wrapping_add(1);
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.serialize_message_data(header, message);
        out.extend_from_slice(raw.raw_bytes());
        debug_assert!(raw.raw_bytes().len() <= FRAME_MAX);
    }
}
