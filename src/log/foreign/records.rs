//! Records of autopilots, which may begin behind other bytes: formats of DataFlash, packets of MAVLink.

use super::mavlink::{STAMP_BYTES, frame, stamp_us};
use super::{Foreign, dataflash};

/// Head of a DataFlash record that states a format, and its length.
const FORMAT_HEAD: [u8; 3] = [0xa3, 0x95, 0x80];
const FORMAT_BYTES: usize = 89;
/// Records without any format that make a DataFlash log: by chance 64 kB hold one head or two.
const HEADLESS_LEAST: usize = 16;
/// Packets in a row that are no chance.
const PACKETS_LEAST: usize = 4;

fn is_format(record: &[u8]) -> bool {
    let Some(own) = record.get(..FORMAT_BYTES) else {
        return false;
    };
    let (name, letters) = (&own[5..9], &own[9..25]);
    let ends = |bytes: &[u8], fits: &dyn Fn(&u8) -> bool| {
        let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
        end > 0 && bytes[..end].iter().all(fits) && bytes[end..].iter().all(|b| *b == 0)
    };
    own.starts_with(&FORMAT_HEAD)
        && own[4] > 3
        && ends(name, &|b| b.is_ascii_alphanumeric() || *b == b'_')
        && ends(letters, &|b| dataflash::letter(*b).is_some())
}

/// Place of the first DataFlash record that states a format.
pub fn dataflash_at(head: &[u8]) -> Option<usize> {
    (0..head.len().saturating_sub(FORMAT_BYTES - 1)).find(|at| is_format(&head[*at..]))
}

/// Bytes of a MAVLink packet by its head.
fn packet_bytes(bytes: &[u8]) -> Option<usize> {
    frame(bytes).map(|f| f.bytes)
}

/// The same with the stamp before it.
fn stamped_bytes(bytes: &[u8]) -> Option<usize> {
    stamp_us(bytes)?;
    Some(STAMP_BYTES + packet_bytes(&bytes[STAMP_BYTES..])?)
}

/// Whether packets follow each other from a place on, `least` of them or up to the end.
fn chain(head: &[u8], from: usize, least: usize, bytes: fn(&[u8]) -> Option<usize>) -> bool {
    let (mut at, mut count) = (from, 0);
    while count < least {
        let Some(own) = head.get(at..).and_then(bytes) else {
            return false;
        };
        at += own;
        count += 1;
        // A file of so few packets, or its last ones; the very last may be cut.
        if at >= head.len() {
            let is_whole = at == head.len();
            return count >= 3 || (is_whole && (from == 0 || count == 2));
        }
    }
    true
}

/// Place of the first MAVLink packet behind a stamp, as telemetry logs have them, with others behind it.
pub fn telemetry_at(head: &[u8]) -> Option<usize> {
    (0..head.len()).find(|at| chain(head, *at, PACKETS_LEAST, stamped_bytes))
}

/// Autopilots' records that no log can be made of: DataFlash without its formats, MAVLink without stamps.
pub(super) fn incomplete(head: &[u8]) -> Option<Foreign> {
    let records = head
        .windows(2)
        .filter(|w| w.starts_with(&FORMAT_HEAD[..2]))
        .count();
    if records >= HEADLESS_LEAST {
        return Some(Foreign::new(
            "an ArduPilot DataFlash log without the formats that stand at its beginning (FMT records)",
            "fetch the whole log from the vehicle anew",
        ));
    }
    // Fewer may be chance, without a stamp before each.
    chain(head, 0, 2 * PACKETS_LEAST, packet_bytes).then(|| {
        Foreign::new(
            "a stream of MAVLink without the stamps of a telemetry log",
            "`hydroline import` the .tlog of the ground station, or the log in the vehicle (.bin, .ulg)",
        )
    })
}
