//! Frames of MAVLink, and the stamps before them in telemetry logs.

/// Bytes of the stamp before a packet.
pub const STAMP_BYTES: usize = 8;
/// Latest stamp, the year 2096 \[us\]. A computer without a clock begins in 1970.
const STAMP_MAX_US: u64 = 4_000_000_000_000_000;
/// The only incompatible flag that is known: a signature stands behind the checksum. Packets with others may be framed otherwise, and
/// the protocol's rule is to pass them over.
const SIGNED: u8 = 1;
const SIGNATURE_BYTES: usize = 13;
const CHECKSUM_BYTES: usize = 2;
const HEAD_BYTES_1: usize = 6;
const HEAD_BYTES_2: usize = 10;
/// Longest packet with its stamp.
pub const PACKET_BYTES_MAX: usize =
    STAMP_BYTES + HEAD_BYTES_2 + 255 + CHECKSUM_BYTES + SIGNATURE_BYTES;

/// Places of a packet's parts, from its marker on \[bytes\].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Frame {
    /// The sender's system, and behind it its component.
    pub sender: usize,
    /// The message's number, its least byte first.
    pub id: std::ops::Range<usize>,
    /// The message's fields; the checksum stands behind them.
    pub payload: std::ops::Range<usize>,
    /// Length of the whole packet, with checksum and signature.
    pub bytes: usize,
}

/// Whether a byte begins a packet, of either protocol.
pub fn is_marker(byte: u8) -> bool {
    matches!(byte, 0xfe | 0xfd)
}

/// The frame of a packet by its first bytes; `None` = they begin none.
pub fn frame(bytes: &[u8]) -> Option<Frame> {
    let (marker, length) = (*bytes.first()?, usize::from(*bytes.get(1)?));
    let (sender, id, head, signature) = match marker {
        0xfe => (3, 5..6, HEAD_BYTES_1, 0),
        0xfd => {
            let signature = match *bytes.get(2)? {
                0 => 0,
                SIGNED => SIGNATURE_BYTES,
                _ => return None,
            };
            (5, 7..10, HEAD_BYTES_2, signature)
        }
        _ => return None,
    };
    let payload = head..head + length;
    let bytes = payload.end + CHECKSUM_BYTES + signature;
    Some(Frame {
        sender,
        id,
        payload,
        bytes,
    })
}

/// The stamp with which bytes begin, UNIX \[us\]; `None` = it is later than any, or not all there.
pub fn stamp_us(bytes: &[u8]) -> Option<u64> {
    let stamp_us = u64::from_be_bytes(*bytes.first_chunk::<STAMP_BYTES>()?);
    (stamp_us <= STAMP_MAX_US).then_some(stamp_us)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_end_behind_checksum_and_signature_and_unknown_flags_are_none() {
        let bytes = |packet: &[u8]| frame(packet).map(|f| f.bytes);
        assert_eq!(bytes(&[0xfe, 4]), Some(6 + 4 + 2));
        assert_eq!(bytes(&[0xfd, 4, 0]), Some(10 + 4 + 2));
        assert_eq!(bytes(&[0xfd, 255, 1]), Some(PACKET_BYTES_MAX - STAMP_BYTES));
        for none in [&[0xfd, 4, 2][..], &[0xfd, 4], &[0xfe], &[0x55, 4, 0], &[]] {
            assert_eq!(bytes(none), None, "{none:?}");
        }
    }

    #[test]
    fn the_latest_stamp_is_one() {
        assert_eq!(stamp_us(&STAMP_MAX_US.to_be_bytes()), Some(STAMP_MAX_US));
        assert_eq!(stamp_us(&(STAMP_MAX_US + 1).to_be_bytes()), None);
        assert_eq!(stamp_us(&[0; 7]), None);
    }
}
