//! MAVLink as ground stations keep it: eight bytes of UNIX time before each packet.
//!
//! The messages' fields stand in `mavlink.tsv` (`generate/mavlink.py`).

use std::collections::HashMap;
use std::path::Path;

use hydroline_log::foreign::mavlink::{PACKET_BYTES_MAX, STAMP_BYTES, frame, is_marker, stamp_us};

use super::message::{Account, Leaves, Message, RecordedError, Sink};
use super::packed::{self, Field, Kind};
use super::stamps::counted;
use super::window::each_record;

const TABLE: &str = include_str!("mavlink.tsv");
const CRC: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_MCRF4XX);

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
        _ => (Kind::number(kind)?, (count > 0).then_some(count)),
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
    let time_us = stamp_us(bytes)?;
    let own = &bytes[STAMP_BYTES..];
    let frame = frame(own)?;
    let end = frame.payload.end;
    let stated = own.get(end..end + 2)?;
    let id = own[frame.id].iter().rev();
    let id = id.fold(0, |id, byte| (id << 8) | u32::from(*byte));
    let sound = known.get(&id).map(|k| {
        let mut digest = CRC.digest();
        digest.update(&own[1..end]);
        digest.update(&[k.crc_extra]);
        digest.finalize().to_le_bytes() == stated
    });
    Some(Packet {
        time_us,
        id,
        system: own[frame.sender],
        component: own[frame.sender + 1],
        payload: &own[frame.payload],
        bytes: STAMP_BYTES + frame.bytes,
        sound,
    })
}

/// Whether bytes may begin a packet, as far as they go.
fn may_begin(bytes: &[u8]) -> bool {
    let is_stamp = bytes.len() < STAMP_BYTES || stamp_us(bytes).is_some();
    is_stamp && bytes.get(STAMP_BYTES).is_none_or(|b| is_marker(*b))
}

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
