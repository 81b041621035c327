//! MAVLink as ground stations keep it: eight bytes of UNIX time before each packet.
//!
//! The messages' fields stand in `mavlink.tsv` (`generate/mavlink.py`).

use std::collections::HashMap;
use std::path::Path;

use super::message::{Account, Leaves, Message, RecordedError, Sink};
use super::packed::{self, Field, Kind};
use super::stamps::counted;
use super::window::each_record;

const TABLE: &str = include_str!("mavlink.tsv");
const STAMP_BYTES: usize = 8;
const SIGNED: u8 = 1;
const SIGNATURE_BYTES: usize = 13;
const CRC: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_MCRF4XX);
/// Latest stamp, the year 2096 \[us\]. A computer without a clock begins in 1970.
const STAMP_MAX_US: u64 = 4_000_000_000_000_000;

struct Known {
    name: &'static str,
    crc_extra: u8,
    fields: Vec<Field>,
}

fn field(text: &str) -> Option<Field> {
    let mut parts = text.split(':');
    let (name, kind, elements, unit) = (parts.next()?, parts.next()?, parts.next()?, parts.next()?);
    let count: usize = elements.parse().ok()?;
    let (kind, elements) = match kind {
        "c" => (Kind::Text(count.max(1)), None),
        _ => {
            let kind = match kind {
                "u8" => Kind::U8,
                "i8" => Kind::I8,
                "u16" => Kind::U16,
                "i16" => Kind::I16,
                "u32" => Kind::U32,
                "i32" => Kind::I32,
                "u64" => Kind::U64,
                "i64" => Kind::I64,
                "f32" => Kind::F32,
                "f64" => Kind::F64,
                _ => return None,
            };
            (kind, (count > 0).then_some(count))
        }
    };
    Some(Field {
        name: name.to_owned(),
        kind,
        elements,
        scale: 1.0,
        unit: unit.to_owned(),
    })
}

fn table() -> HashMap<u32, Known> {
    let mut known = HashMap::new();
    for line in TABLE.lines() {
        let mut cells = line.split('\t');
        let head = (
            cells.next().and_then(|c| c.parse().ok()),
            cells.next(),
            cells.next().and_then(|c| c.parse().ok()),
        );
        if let (Some(id), Some(name), Some(crc_extra)) = head {
            let fields = cells.filter_map(field).collect();
            known.insert(
                id,
                Known {
                    name,
                    crc_extra,
                    fields,
                },
            );
        }
    }
    known
}

/// A packet behind its stamp.
struct Packet<'a> {
    time_us: u64,
    id: u32,
    system: u8,
    component: u8,
    payload: &'a [u8],
    /// With the stamp.
    bytes: usize,
    /// `None` = the message is none that is known, so that its checksum says nothing.
    sound: Option<bool>,
}

/// Packet at the beginning of these bytes, if they look like one.
fn packet<'a>(bytes: &'a [u8], known: &HashMap<u32, Known>) -> Option<Packet<'a>> {
    let time_us = u64::from_be_bytes(bytes.get(..STAMP_BYTES)?.try_into().ok()?);
    let own = &bytes[STAMP_BYTES..];
    let length = *own.get(1)? as usize;
    let (head, id, sender, signed) = match own.first()? {
        0xfe => (6, u32::from(*own.get(5)?), 3, false),
        0xfd => {
            let id = own.get(7..10)?;
            let id = u32::from(id[0]) | u32::from(id[1]) << 8 | u32::from(id[2]) << 16;
            (10, id, 5, own[2] & SIGNED != 0)
        }
        _ => return None,
    };
    if time_us > STAMP_MAX_US {
        return None;
    }
    let end = head + length;
    let stated = own.get(end..end + 2)?;
    let bytes = STAMP_BYTES + end + 2 + if signed { SIGNATURE_BYTES } else { 0 };
    let sound = known.get(&id).map(|k| {
        let mut digest = CRC.digest();
        digest.update(&own[1..end]);
        digest.update(&[k.crc_extra]);
        digest.finalize().to_le_bytes() == stated
    });
    Some(Packet {
        time_us,
        id,
        system: own[sender],
        component: own[sender + 1],
        payload: &own[head..end],
        bytes,
        sound,
    })
}

/// Whether bytes may begin a packet, as far as they go.
fn may_begin(bytes: &[u8]) -> bool {
    let Some((stamp, own)) = bytes.split_first_chunk::<STAMP_BYTES>() else {
        return true;
    };
    let is_marker = own.first().is_none_or(|b| matches!(b, 0xfe | 0xfd));
    is_marker && u64::from_be_bytes(*stamp) <= STAMP_MAX_US
}

/// A packet of a later protocol: stamp, head, 255 bytes, checksum, signature.
const PACKET_BYTES_MAX: usize = STAMP_BYTES + 10 + 255 + 2 + SIGNATURE_BYTES;

pub(super) fn read(path: &Path, sink: &mut dyn Sink) -> Result<Account, RecordedError> {
    let known = table();
    let mut leaves = Leaves::default();
    each_record(path, |window, account, _| {
        let at = window.offset;
        let ahead = window.ahead(2 * PACKET_BYTES_MAX)?;
        let found = packet(ahead, &known).filter(|p| match p.sound {
            Some(sound) => sound,
            // Without a checksum that can be held against it, what follows must look like a packet.
            None => ahead.get(p.bytes..).is_some_and(may_begin),
        });
        let Some(packet) = found else {
            return Ok(Err(|at| {
                format!("at byte {at} begins no packet with the checksum it states")
            }));
        };
        match known.get(&packet.id) {
            None => account.note(
                &format!("messages of MAVLink number {}", packet.id),
                at,
                || "it is no message of the dialects ardupilotmega and common".to_owned(),
            ),
            Some(kind) => message(kind, &packet, &mut leaves, sink)?,
        }
        Ok(Ok(packet.bytes))
    })
}

fn message(
    kind: &Known,
    packet: &Packet<'_>,
    leaves: &mut Leaves,
    sink: &mut dyn Sink,
) -> Result<(), RecordedError> {
    // The first autopilot goes without its numbers.
    let topic = match (packet.system, packet.component) {
        (1, 1) => kind.name.to_owned(),
        (system, component) => format!("{}[{system}.{component}]", kind.name),
    };
    let log_ns = i128::from(packet.time_us) * 1000;
    if !sink.wants(&topic, kind.name, packet.payload.len()) {
        sink.other(&topic, kind.name, Some(log_ns));
        return Ok(());
    }
    // Zeros at the end are not sent.
    let mut payload = packet.payload.to_vec();
    payload.resize(packed::bytes(&kind.fields).max(payload.len()), 0);
    leaves.clear();
    packed::decode(&kind.fields, &payload, leaves);
    let stamp_ns = counted(leaves.get("time_boot_ms"), 1_000_000).or_else(|| {
        let us = leaves.get("time_usec")?.whole()?;
        let short = kind
            .fields
            .iter()
            .any(|f| f.name == "time_usec" && f.kind == Kind::U32);
        // UNIX time is another clock than the autopilot's own, and 32 bits of microseconds turn after 71 minutes.
        (us < 300_000_000_000_000 && !short).then_some(us * 1000)
    });
    let whole = Message {
        topic: &topic,
        schema: kind.name,
        log_ns: Some(log_ns),
        stamp_ns,
        leaves,
        unit: &|path| packed::unit_of(&kind.fields, path),
    };
    Ok(sink.message(&whole)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_holds_the_usual_messages() {
        let known = table();
        assert!(known.len() > 250);
        let attitude = &known[&30];
        assert_eq!((attitude.name, attitude.crc_extra), ("ATTITUDE", 39));
        assert_eq!(packed::bytes(&attitude.fields), 28);
        for (id, k) in &known {
            assert!(packed::bytes(&k.fields) <= 255, "{id} {}", k.name);
            assert!(!k.fields.is_empty(), "{id} {}", k.name);
        }
    }
}
