//! PX4's ULog: formats, subscriptions to topics, data.

use std::collections::HashMap;
use std::path::Path;

use super::DAMAGED;
use super::message::{Account, Leaves, Message, RecordedError, Sink};
use super::packed::{self, Field, Kind};
use super::stamps::counted;
use super::window::{NO_RECORD, each_record};

const FILE_HEAD_BYTES: usize = 16;
const HEAD_BYTES: usize = 3;
/// Incompatible flags that are known: data were appended behind the log's end, where they are read as well.
const FLAGS_KNOWN: u64 = 1;
/// Compatible flags, which say nothing that reading needs, before the incompatible ones.
const COMPATIBLE_BYTES: usize = 8;
/// Formats hold formats, so deep at most.
const DEPTH_MAX: usize = 12;
/// Fields of one topic.
const FIELDS_MAX: usize = 4000;

/// Types of records that there are.
fn is_type(byte: u8) -> bool {
    matches!(
        byte,
        b'F' | b'A' | b'D' | b'B' | b'I' | b'M' | b'P' | b'Q' | b'L' | b'C' | b'S' | b'O' | b'R'
    )
}

struct Topic {
    name: String,
    schema: String,
    fields: Vec<Field>,
}

#[derive(Default)]
struct Learnt {
    /// (type, name) of a format's fields.
    formats: HashMap<String, Vec<(String, String)>>,
    topics: HashMap<u16, Topic>,
}

fn kind(word: &str) -> Option<Kind> {
    Some(match word {
        "int8_t" => Kind::I8,
        "uint8_t" | "bool" => Kind::U8,
        "int16_t" => Kind::I16,
        "uint16_t" => Kind::U16,
        "int32_t" => Kind::I32,
        "uint32_t" => Kind::U32,
        "int64_t" => Kind::I64,
        "uint64_t" => Kind::U64,
        "float" => Kind::F32,
        "double" => Kind::F64,
        "char" => Kind::Text(1),
        _ => return None,
    })
}

impl Learnt {
    fn format(&mut self, body: &[u8]) -> Result<(), String> {
        let text = std::str::from_utf8(body).map_err(|_| "a format is no text".to_owned())?;
        let (name, fields) = text
            .split_once(':')
            .ok_or_else(|| format!("'{text}' is no format"))?;
        let typed = fields
            .split(';')
            .filter_map(|f| f.trim().split_once(' '))
            .map(|(t, n)| (t.trim().to_owned(), n.trim().to_owned()))
            .collect();
        self.formats.insert(name.trim().to_owned(), typed);
        Ok(())
    }

    /// The fields of a format in a row, those of formats within it under their names.
    fn flat(
        &self,
        name: &str,
        lead: &str,
        depth: usize,
        out: &mut Vec<Field>,
    ) -> Result<(), String> {
        let fields = self
            .formats
            .get(name)
            .ok_or_else(|| format!("the log has no format '{name}'"))?;
        for (word, field) in fields {
            if out.len() > FIELDS_MAX || depth > DEPTH_MAX {
                return Err(format!(
                    "the format '{name}' is nested too deep or too long"
                ));
            }
            let (base, elements) = match word.split_once('[') {
                Some((base, count)) => {
                    let count = count.trim_end_matches(']').parse::<usize>();
                    let count = count.ok().filter(|c| *c <= usize::from(u16::MAX));
                    (
                        base,
                        Some(count.ok_or_else(|| format!("'{word}' is no type"))?),
                    )
                }
                None => (word.as_str(), None),
            };
            let full = format!("{lead}{field}");
            let mut push = |kind, elements| {
                out.push(Field {
                    name: full.clone(),
                    kind,
                    elements,
                    scale: 1.0,
                    unit: String::new(),
                });
            };
            match (kind(base), elements) {
                (Some(k), _) if field.starts_with("_padding") => {
                    push(Kind::Padding(k.bytes() * elements.unwrap_or(1)), None);
                }
                (Some(Kind::Text(_)), n) => push(Kind::Text(n.unwrap_or(1)), None),
                (Some(k), n) => push(k, n),
                (None, None) => self.flat(base, &format!("{full}."), depth + 1, out)?,
                (None, Some(n)) => {
                    for index in 0..n {
                        if out.len() > FIELDS_MAX {
                            return Err(format!("the format '{name}' is too long"));
                        }
                        self.flat(base, &format!("{full}[{index}]."), depth + 1, out)?;
                    }
                }
            }
        }
        Ok(())
    }

    fn subscribe(&mut self, body: &[u8]) -> Result<(), String> {
        let (Some(multi), Some(id), Some(name)) = (body.first(), body.get(1..3), body.get(3..))
        else {
            return Err("a subscription is cut".to_owned());
        };
        let schema =
            std::str::from_utf8(name).map_err(|_| "a topic's name is no text".to_owned())?;
        let mut fields = Vec::new();
        self.flat(schema, "", 0, &mut fields)?;
        // Padding at the end is not written.
        while let Some(Kind::Padding(_)) = fields.last().map(|f| f.kind) {
            fields.pop();
        }
        let name = match multi {
            0 => schema.to_owned(),
            n => format!("{schema}[{n}]"),
        };
        let topic = Topic {
            name,
            schema: schema.to_owned(),
            fields,
        };
        self.topics
            .insert(u16::from_le_bytes([id[0], id[1]]), topic);
        Ok(())
    }
}

/// Whether a record may begin here: a type that there is, and behind it another, or the end. `searched` = the place was looked
/// for behind damage, where data that are shorter than their format are no record.
fn plausible(ahead: &[u8], learnt: &Learnt, searched: bool) -> bool {
    let [low, high, kind, ..] = ahead else {
        return false;
    };
    let length = usize::from(u16::from_le_bytes([*low, *high]));
    if !is_type(*kind) || length == 0 {
        return false;
    }
    let body = ahead.get(HEAD_BYTES..).unwrap_or(&[]);
    if *kind == b'D' {
        let Some(id) = body.get(..2) else {
            return false;
        };
        let topic = learnt.topics.get(&u16::from_le_bytes([id[0], id[1]]));
        if topic.is_none_or(|t| searched && packed::bytes(&t.fields) + 2 > length) {
            return false;
        }
    }
    match body.get(length..) {
        Some([]) => true,
        Some(next) => next.get(2).is_some_and(|b| is_type(*b)),
        None => false,
    }
}

pub(super) fn read(path: &Path, sink: &mut dyn Sink) -> Result<Account, RecordedError> {
    let mut learnt = Learnt::default();
    let mut leaves = Leaves::default();
    each_record(path, |window, account, broken| {
        let at = window.offset;
        if at == 0 {
            return Ok(Ok(FILE_HEAD_BYTES));
        }
        let length = match window.ahead(HEAD_BYTES)? {
            [low, high, _] => usize::from(u16::from_le_bytes([*low, *high])),
            _ => 0,
        };
        let ahead = window.ahead(HEAD_BYTES + length + HEAD_BYTES)?;
        if !plausible(ahead, &learnt, broken) {
            let whole = ahead.len() >= HEAD_BYTES + length && length > 0;
            let kind = ahead.get(2).copied().unwrap_or(0);
            // A record whose follower is broken is sound itself as far as the file shows.
            if broken || !whole || !is_type(kind) || !fits(ahead, &learnt) {
                return Ok(Err(NO_RECORD));
            }
        }
        let record = window.ahead(HEAD_BYTES + length)?;
        let (kind, body) = (record[2], &record[HEAD_BYTES..]);
        match kind {
            b'F' => learnt.format(body),
            b'A' => learnt.subscribe(body),
            // They stand before everything else; behind damage bytes may look like them.
            b'B' if at == FILE_HEAD_BYTES as u64 => {
                return flags(body).map(|()| Ok(record.len()));
            }
            b'O' => {
                let lost_ms = body
                    .get(..2)
                    .map_or(0, |b| u16::from_le_bytes([b[0], b[1]]));
                account.note("gaps that the logger reports (dropouts)", at, || {
                    format!(
                        "the first is {lost_ms} ms long: the logger could not write fast enough"
                    )
                });
                Ok(())
            }
            b'D' => data(body, &learnt, &mut leaves, sink)?,
            _ => Ok(()),
        }
        .unwrap_or_else(|reason| account.note(DAMAGED, at, || reason));
        Ok(Ok(record.len()))
    })
}

/// Whether a record's own bytes hold together, whatever follows.
fn fits(record: &[u8], learnt: &Learnt) -> bool {
    let length = usize::from(u16::from_le_bytes([record[0], record[1]]));
    let mut own = record.get(..HEAD_BYTES + length).unwrap_or(&[]).to_vec();
    own.truncate(HEAD_BYTES + length);
    plausible(&own, learnt, true)
}

/// Holds the incompatible flags against those that are known: the format's rule is to read no further.
fn flags(body: &[u8]) -> Result<(), RecordedError> {
    let own = body.get(COMPATIBLE_BYTES..).and_then(|b| b.first_chunk());
    let flags = own.map_or(0, |b| u64::from_le_bytes(*b));
    if flags & !FLAGS_KNOWN == 0 {
        return Ok(());
    }
    Err(RecordedError::Flags {
        flags,
        known: FLAGS_KNOWN,
    })
}

fn data(
    body: &[u8],
    learnt: &Learnt,
    leaves: &mut Leaves,
    sink: &mut dyn Sink,
) -> Result<Result<(), String>, RecordedError> {
    let Some((id, body)) = body.split_at_checked(2) else {
        return Ok(Err("data without a topic".to_owned()));
    };
    let id = u16::from_le_bytes([id[0], id[1]]);
    let Some(topic) = learnt.topics.get(&id) else {
        return Ok(Err(format!(
            "data of topic number {id}, which is not declared"
        )));
    };
    let stated = packed::bytes(&topic.fields);
    if body.len() < stated {
        // Which fields are there, only the format says, and it is wrong.
        sink.other(&topic.name, &topic.schema, None);
        return Ok(Err(format!(
            "the data of {} have {} bytes, {stated} by its format, so that no field of it is sure (written by a firmware of another version?)",
            topic.name,
            body.len()
        )));
    }
    if !sink.wants(&topic.name, &topic.schema, body.len()) {
        sink.other(&topic.name, &topic.schema, None);
        return Ok(Ok(()));
    }
    leaves.clear();
    packed::decode(&topic.fields, body, leaves);
    let stamp_ns = counted(leaves.get("timestamp"), 1000);
    let message = Message {
        topic: &topic.name,
        schema: &topic.schema,
        log_ns: stamp_ns,
        stamp_ns,
        leaves,
        unit: &|_| None,
    };
    sink.message(&message)?;
    Ok(Ok(()))
}
