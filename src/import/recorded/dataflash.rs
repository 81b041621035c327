//! ArduPilot's DataFlash log: records whose formats stand in the log.

use std::collections::HashMap;
use std::path::Path;

use super::head::head;
use super::message::{Account, Leaves, Message, Number, RecordedError, Sink};
use super::packed::{self, Field, Kind};
use super::stamps::counted;
use super::window::{NO_RECORD, each_record};
use hydroline_log::foreign;

const HEAD: [u8; 2] = [0xa3, 0x95];
const FORMAT_TYPE: u8 = 0x80;
const FORMAT_BYTES: usize = 89;

/// Record layout of a type.
#[derive(Debug, Clone, Default)]
struct Format {
    name: String,
    /// With the head.
    bytes: usize,
    fields: Vec<Field>,
    /// The field that tells several sensors or cores apart.
    instance: Option<String>,
}

/// Kind, elements and worth of a letter.
fn letter(c: char) -> Option<(Kind, Option<usize>, f64)> {
    let own = foreign::dataflash::letter(u8::try_from(c).ok()?)?;
    match (own.value, own.elements) {
        ("text", bytes) => Some((Kind::Text(bytes?), None, own.scale)),
        (name, elements) => Some((Kind::number(name)?, elements, own.scale)),
    }
}

/// Formats and units that the log has stated so far.
#[derive(Default)]
struct Learnt {
    formats: HashMap<u8, Format>,
    /// Words of units and powers of ten, by their letters.
    units: HashMap<u8, String>,
    multipliers: HashMap<u8, f64>,
    /// Letters of units and multipliers per type: they may come before the words.
    marks: HashMap<u8, (String, String)>,
}

impl Learnt {
    /// A record that says how others are written; whether it holds together.
    fn format(&mut self, record: &[u8]) -> bool {
        let (kind, bytes) = (record[3], record[4] as usize);
        let letters = packed::text(record, 9, 16);
        let mut labels = packed::text(record, 25, 64).split(',').map(str::trim);
        let mut fields = Vec::new();
        for c in letters.chars() {
            let (Some((kind, elements, scale)), Some(label)) = (letter(c), labels.next()) else {
                return false;
            };
            fields.push(Field {
                name: label.to_owned(),
                kind,
                elements,
                scale,
                unit: String::new(),
            });
        }
        let name = packed::text(record, 5, 4).to_owned();
        if packed::bytes(&fields) + 3 != bytes || name.is_empty() {
            return false;
        }
        let instance = None;
        let mut format = Format {
            name,
            bytes,
            fields,
            instance,
        };
        if let Some(marks) = self.marks.get(&kind) {
            mark(&mut format, marks, &self.units, &self.multipliers);
        }
        self.formats.insert(kind, format);
        true
    }

    /// A record that says which units others have.
    fn unit(&mut self, name: &str, leaves: &Leaves) {
        let byte = |path: &str| match leaves.get(path)?.whole()? {
            v @ 0..=255 => u8::try_from(v).ok(),
            _ => None,
        };
        match name {
            "UNIT" => {
                if let (Some(id), Some(label)) = (byte("Id"), leaves.get_text("Label")) {
                    self.units.insert(id, label.to_owned());
                }
            }
            "MULT" => {
                if let (Some(id), Some(Number::Float(value))) = (byte("Id"), leaves.get("Mult")) {
                    self.multipliers.insert(id, value);
                }
            }
            "FMTU" => {
                let texts = (leaves.get_text("UnitIds"), leaves.get_text("MultIds"));
                if let (Some(kind), (Some(units), Some(multipliers))) = (byte("FmtType"), texts) {
                    self.marks
                        .insert(kind, (units.to_owned(), multipliers.to_owned()));
                }
            }
            _ => return,
        }
        for (kind, marks) in &self.marks {
            if let Some(format) = self.formats.get_mut(kind) {
                mark(format, marks, &self.units, &self.multipliers);
            }
        }
    }
}

/// Units and the instance's field of a format.
fn mark(
    format: &mut Format,
    (units, multipliers): &(String, String),
    words: &HashMap<u8, String>,
    powers: &HashMap<u8, f64>,
) {
    let mut multipliers = multipliers.bytes();
    for (field, unit) in format.fields.iter_mut().zip(units.bytes()) {
        let power = multipliers.next();
        if unit == b'#' {
            format.instance = Some(field.name.clone());
        }
        let Some(word) = words
            .get(&unit)
            .filter(|_| !matches!(unit, b'-' | b'?' | b'#'))
        else {
            continue;
        };
        // The value contains the factor of the format's letter already.
        let power = power.and_then(|p| powers.get(&p)).copied().unwrap_or(0.0);
        let own = if power > 0.0 {
            power / field.scale
        } else {
            1.0
        };
        field.unit = unit_word(word, own);
    }
}

/// The unit that is a power of ten of another, as people write it.
fn unit_word(word: &str, power: f64) -> String {
    let near = |p: f64| (power / p - 1.0).abs() < 1e-6;
    if near(1.0) {
        word.to_owned()
    } else if near(1e-3) && matches!(word, "s" | "m" | "m/s") {
        format!("m{word}")
    } else if near(1e-2) && matches!(word, "m" | "m/s" | "deg") {
        format!("c{word}")
    } else if near(1e-6) && word == "s" {
        "us".to_owned()
    } else {
        format!("{power} {word}")
    }
}

/// Field of the instance where no record of units says which: as ArduPilot's main messages have it.
fn usual_instance(format: &Format) -> Option<&str> {
    let first = format.fields.get(1)?;
    let is_count = matches!(first.kind, Kind::U8);
    (is_count && matches!(first.name.as_str(), "I" | "C" | "Instance"))
        .then_some(first.name.as_str())
}

/// Whether a record is the format of formats, with which a log begins.
fn begins_log(record: &[u8]) -> bool {
    record.len() == FORMAT_BYTES
        && record[..2] == HEAD
        && record[2..4] == [FORMAT_TYPE; 2]
        && usize::from(record[4]) == FORMAT_BYTES
}

/// Formats that stand in the head of a log, the first of each type: records may come before theirs. With them the zeros before
/// the format of formats \[bytes\]: space that was never written, where nothing else stands.
fn formats_ahead(head: &[u8]) -> (Learnt, usize) {
    let mut learnt = Learnt::default();
    let mut at = 0;
    while let Some(record) = head.get(at..at + FORMAT_BYTES) {
        let is_format = record[..2] == HEAD && record[2] == FORMAT_TYPE;
        let is_new = is_format && !learnt.formats.contains_key(&record[3]);
        let taken = is_new && learnt.format(record);
        at += if taken { FORMAT_BYTES } else { 1 };
    }
    let zeros = head.iter().take_while(|b| **b == 0).count();
    let is_beginning = head
        .get(zeros..zeros + FORMAT_BYTES)
        .is_some_and(begins_log);
    (learnt, if is_beginning { zeros } else { 0 })
}

pub(super) fn read(path: &Path, sink: &mut dyn Sink) -> Result<Account, RecordedError> {
    let (mut learnt, zeros) = formats_ahead(&head(path, foreign::HEAD_BYTES)?);
    let mut leaves = Leaves::default();
    each_record(path, |window, _, _| {
        if window.offset == 0 && zeros > 0 {
            return Ok(Ok(zeros));
        }
        let head = window.ahead(3)?;
        let &[.., kind] = head else {
            return Ok(Err(NO_RECORD));
        };
        let length = match kind {
            FORMAT_TYPE => Some(FORMAT_BYTES),
            _ => learnt.formats.get(&kind).map(|f| f.bytes),
        };
        let Some(length) = length.filter(|_| head.len() == 3 && head[..2] == HEAD) else {
            return Ok(Err(NO_RECORD));
        };
        let record = window.ahead(length)?;
        if record.len() < length || (kind == FORMAT_TYPE && !learnt.format(record)) {
            return Ok(Err(|at| {
                format!("the record at byte {at} is cut, or is no format")
            }));
        }
        let Some(format) = learnt.formats.get(&kind).filter(|_| kind != FORMAT_TYPE) else {
            return Ok(Ok(length));
        };
        let body = &record[3..];
        if matches!(format.name.as_str(), "UNIT" | "MULT" | "FMTU") {
            let name = format.name.clone();
            leaves.clear();
            packed::decode(&format.fields, body, &mut leaves);
            learnt.unit(&name, &leaves);
        } else {
            message(format, body, &mut leaves, sink)?;
        }
        Ok(Ok(length))
    })
}

fn message(
    format: &Format,
    body: &[u8],
    leaves: &mut Leaves,
    sink: &mut dyn Sink,
) -> Result<(), RecordedError> {
    let instance = format.instance.as_deref().or(usual_instance(format));
    let topic = match instance.and_then(|name| place_of(format, body, name)) {
        Some(number) => format!("{}[{number}]", format.name),
        None => format.name.clone(),
    };
    if !sink.wants(&topic, &format.name, body.len()) {
        sink.other(&topic, &format.name, None);
        return Ok(());
    }
    leaves.clear();
    packed::decode(&format.fields, body, leaves);
    let stamp_ns =
        counted(leaves.get("TimeUS"), 1000).or_else(|| counted(leaves.get("TimeMS"), 1_000_000));
    let whole = Message {
        topic: &topic,
        schema: &format.name,
        log_ns: stamp_ns,
        stamp_ns,
        leaves,
        unit: &|path| packed::unit_of(&format.fields, path),
    };
    Ok(sink.message(&whole)?)
}

/// The instance's number.
fn place_of(format: &Format, body: &[u8], name: &str) -> Option<i128> {
    let mut at = 0;
    for field in &format.fields {
        if field.name == name {
            return packed::number(body, at, field.kind)?.whole();
        }
        at += field.bytes();
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_letter_by_which_a_log_is_known_is_read() {
        for byte in foreign::dataflash::letters() {
            assert!(letter(char::from(byte)).is_some(), "{}", char::from(byte));
        }
        assert_eq!(letter('L'), Some((Kind::I32, None, 1.0e-7)));
        assert_eq!(letter('a'), Some((Kind::I16, Some(32), 1.0)));
        assert_eq!(letter('Z'), Some((Kind::Text(64), None, 1.0)));
        assert_eq!(letter('x'), None);
    }
}
