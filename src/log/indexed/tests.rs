//! Logs of other writers: whatever their summary leaves out, no message is lost for it.

use std::collections::BTreeMap;
use std::path::Path;

use mcap::records::{MessageHeader, op};
use mcap::{WriteOptions, Writer};
use prost::Message as _;

use super::IndexedLog;
use crate::tests::fixtures::command;
use crate::{LogError, Record, Topic};

const TOPIC: &str = "/thruster/command";
const MESSAGES: u32 = 60;

/// Commands by number, in chunks of five between which a second channel has one; `options` say what is left out.
fn written(options: WriteOptions) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let mut writer: Writer<_> = options.create(&mut bytes).unwrap();
    let schema = Topic::Command.schema();
    let schema = writer.add_schema(&schema.name, "protobuf", &schema.data);
    let own = writer.add_channel(schema.unwrap(), TOPIC, "protobuf", &BTreeMap::new());
    let other = writer.add_channel(0, "/other", "json", &BTreeMap::new());
    for sequence in 0..MESSAGES {
        let mut write = |channel_id: u16, data: &[u8]| {
            let (log_time, publish_time) = (u64::from(sequence), 0);
            let header = MessageHeader {
                channel_id,
                sequence,
                log_time,
                publish_time,
            };
            writer.write_to_known_channel(&header, data).unwrap();
        };
        write(*own.as_ref().unwrap(), &command(sequence).encode_to_vec());
        if sequence % 10 == 0 {
            write(*other.as_ref().unwrap(), b"{}");
        }
        if sequence % 5 == 4 {
            writer.flush().unwrap();
        }
    }
    writer.finish().unwrap();
    drop(writer);
    bytes.into_inner()
}

/// Numbers of the commands by `visit`, by `messages` and one by one; checked against the count.
fn found(bytes: &[u8], path: &Path) -> Result<Vec<u32>, LogError> {
    std::fs::write(path, bytes).unwrap();
    let log = IndexedLog::open(path)?;
    let number = |record: &Record| match record {
        Record::Command(c) => c.sequence,
        other => panic!("{other:?}"),
    };
    let (mut numbers, mut visited) = (Vec::new(), 0);
    for place in log.places(&[TOPIC]) {
        let messages = log.messages(place, &[TOPIC])?;
        numbers.extend(messages.iter().map(|m| number(&m.record)));
    }
    log.visit(&log.places(&[TOPIC]), &[Topic::Command], |_, _, _| {
        visited += 1;
        Ok(())
    })?;
    log.all_found(Topic::Command, visited)?;
    assert_eq!(visited, numbers.len() as u64);
    assert_eq!(log.counts()[TOPIC], visited);
    for (index, expected) in numbers.iter().enumerate() {
        let message = log.nth(TOPIC, index as u64)?.unwrap();
        assert_eq!(number(&message.record), *expected);
    }
    assert_eq!(log.nth(TOPIC, visited)?, None);
    Ok(numbers)
}

#[test]
fn what_a_summary_leaves_out_costs_no_message() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let all: Vec<u32> = (0..MESSAGES).collect();
    let plain = WriteOptions::new;
    for (name, options) in [
        ("all of it", plain()),
        ("small chunks", plain().chunk_size(Some(200))),
        ("no compression", plain().compression(None)),
        ("no chunks", plain().use_chunks(false)),
        (
            "no indexes of messages",
            plain().emit_message_indexes(false),
        ),
        ("no indexes of chunks", plain().emit_chunk_indexes(false)),
        ("no statistics", plain().emit_statistics(false)),
        ("no schemas", plain().repeat_schemas(false)),
        ("no channels", plain().repeat_channels(false)),
        ("no summary", plain().emit_summary_records(false)),
        ("no checksum", plain().calculate_summary_section_crc(false)),
    ] {
        assert_eq!(found(&written(options), &path).unwrap(), all, "{name}");
    }
}

fn number_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

/// Offsets of the footer and the summary.
fn ends(bytes: &[u8]) -> (usize, usize) {
    // Magic, and a footer with its prefix.
    let footer = bytes.len() - 8 - 29;
    (footer, number_at(bytes, footer + 9) as usize)
}

/// Offset of the first record of an opcode, from the record at `from` on.
fn record_from(bytes: &[u8], opcode: u8, from: usize) -> usize {
    let mut at = from;
    loop {
        let len = number_at(bytes, at + 1);
        if bytes[at] == opcode {
            return at;
        }
        at += 9 + len as usize;
    }
}

/// A message by itself behind the last chunk; the statistics count it when `counted`.
fn with_a_loose_message(counted: bool) -> Vec<u8> {
    let mut bytes = written(
        WriteOptions::new()
            .calculate_summary_section_crc(false)
            .calculate_data_section_crc(false),
    );
    let (footer, start) = ends(&bytes);
    let channel = mcap::Summary::read(&bytes).unwrap().unwrap();
    let channel = channel.channels.values().find(|c| c.topic == TOPIC);
    let channel = channel.unwrap().id;
    let mut body = channel.to_le_bytes().to_vec();
    body.extend(MESSAGES.to_le_bytes());
    body.extend([0; 16]);
    body.extend(command(MESSAGES).encode_to_vec());
    let mut record = vec![op::MESSAGE];
    record.extend((body.len() as u64).to_le_bytes());
    record.extend(body);
    if counted {
        let statistics = record_from(&bytes, op::STATISTICS, start) + 9;
        let mut raise = |at: usize| {
            let n = number_at(&bytes, at);
            bytes[at..at + 8].copy_from_slice(&(n + 1).to_le_bytes());
        };
        raise(statistics);
        // Behind counts (8 2 4 4 4 4) and times (8 8), and the map's length.
        let map = statistics + 42 + 4;
        raise(map + 10 * usize::from(channel) + 2);
    }
    // DataEnd is 13 bytes, right before the summary; the offsets of the summary's groups are of no use here.
    let at = start - 13;
    bytes[footer + 9..footer + 17].copy_from_slice(&((start + record.len()) as u64).to_le_bytes());
    bytes[footer + 17..footer + 25].fill(0);
    bytes.splice(at..at, record);
    bytes
}

#[test]
fn a_message_outside_of_the_chunks_is_found_although_the_index_names_none() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let all: Vec<u32> = (0..=MESSAGES).collect();
    assert_eq!(found(&with_a_loose_message(true), &path).unwrap(), all);
    // Nor is one hidden that the statistics do not count.
    let error = found(&with_a_loose_message(false), &path).unwrap_err();
    let words = error.to_string();
    assert!(
        words.contains("counts 66 messages, the file holds 67"),
        "{words}"
    );
}

#[test]
fn statistics_that_disagree_with_the_messages_are_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut bytes = written(WriteOptions::new().calculate_summary_section_crc(false));
    let (_, start) = ends(&bytes);
    let statistics = record_from(&bytes, op::STATISTICS, start) + 9;
    // A sum that does not fit is none: the log is read through.
    let mut hostile = bytes.clone();
    hostile[statistics + 46 + 2..statistics + 46 + 10].fill(0xff);
    std::fs::write(&path, &hostile).unwrap();
    let log = IndexedLog::open(&path).unwrap();
    assert_eq!(log.counts()[TOPIC], u64::from(MESSAGES));
    // One command more, one message of the other channel less: the sum holds.
    bytes[statistics + 46 + 2] += 1;
    bytes[statistics + 46 + 12] -= 1;
    std::fs::write(&path, &bytes).unwrap();
    let log = IndexedLog::open(&path).unwrap();
    assert_eq!(log.counts()[TOPIC], u64::from(MESSAGES) + 1);
    let error = log.all_found(Topic::Command, u64::from(MESSAGES));
    let words = error.unwrap_err().to_string();
    assert!(
        words.contains("counts 61 messages, the file holds 60"),
        "{words}"
    );
    let error = log.nth(TOPIC, u64::from(MESSAGES)).unwrap_err();
    assert_eq!(error.to_string(), words);
    assert_eq!(log.nth(TOPIC, u64::from(MESSAGES) + 1).unwrap(), None);
}

#[test]
fn an_index_whose_places_are_wrong_costs_no_message_and_no_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let whole = written(WriteOptions::new().calculate_summary_section_crc(false));
    let all: Vec<u32> = (0..MESSAGES).collect();
    let (footer, start) = ends(&whole);
    let chunk = record_from(&whole, op::CHUNK_INDEX, start) + 9;
    let map = u32::from_le_bytes(whole[chunk + 32..chunk + 36].try_into().unwrap()) as usize;
    let set = |at: usize, value: u64| {
        let mut bytes = whole.clone();
        bytes[at..at + 8].copy_from_slice(&value.to_le_bytes());
        bytes
    };
    let of = |at: usize| number_at(&whole, at);
    // A chunk index: times, offset, length, map of message indexes, their length.
    let (length, indexes) = (chunk + 24, chunk + 36 + map);
    for bytes in [
        set(length, 0),
        set(length, of(length) + 1),
        set(length, u64::MAX),
        set(indexes, 0),
        set(indexes, 2 * of(indexes)),
        set(indexes, u64::MAX),
    ] {
        assert_eq!(found(&bytes, &path).unwrap(), all);
    }
    for bytes in [
        // The summary's start: within the data, at its end, behind it.
        set(footer + 9, of(chunk + 16)),
        set(footer + 9, start as u64 - 13),
        set(footer + 9, footer as u64 + 29),
        set(footer + 9, footer as u64 + 28),
        set(footer + 9, u64::MAX),
    ] {
        if let Ok(found) = found(&bytes, &path) {
            assert_eq!(found, all);
        }
    }
}
