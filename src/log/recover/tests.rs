//! What is saved of damaged files: all that is sound, and no loss is said where there is none.

use std::io::Cursor;
use std::path::Path;

use super::fixtures::MemoryDisk;
use super::{offline, sample};
use crate::RawReader;
use crate::recover::{Recovery, recover};

/// A log of ours.
fn ours() -> Vec<u8> {
    let disk = MemoryDisk::default();
    sample(&disk, 12, offline());
    disk.file(0)
}

/// 200 messages in chunks of 20.
fn foreign(options: mcap::WriteOptions) -> Vec<u8> {
    let options = options.chunk_size(Some(20 * 51)).compression(None);
    let mut writer = options.create(Cursor::new(Vec::new())).unwrap();
    let schema = writer.add_schema("a/B", "ros2msg", b"float64 x").unwrap();
    let none = Default::default();
    let channel_id = writer.add_channel(schema, "/a", "cdr", &none).unwrap();
    for k in 0..200 {
        let header = mcap::records::MessageHeader {
            channel_id,
            sequence: k,
            log_time: u64::from(k),
            publish_time: u64::from(k),
        };
        writer.write_to_known_channel(&header, &[7; 20]).unwrap();
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

/// 200 messages of each of two topics in turn, outside chunks.
fn two_topics(options: mcap::WriteOptions) -> Vec<u8> {
    let options = options.use_chunks(false);
    let mut writer = options.create(Cursor::new(Vec::new())).unwrap();
    let schema = writer.add_schema("a/B", "ros2msg", b"float64 x").unwrap();
    let none = Default::default();
    let channels = ["/a", "/b"].map(|topic| {
        let added = writer.add_channel(schema, topic, "cdr", &none);
        added.unwrap()
    });
    for k in 0..200 {
        for channel_id in channels {
            let header = mcap::records::MessageHeader {
                channel_id,
                sequence: k,
                log_time: u64::from(k),
                publish_time: u64::from(k),
            };
            writer.write_to_known_channel(&header, &[7; 20]).unwrap();
        }
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

fn without_checksums() -> mcap::WriteOptions {
    mcap::WriteOptions::new()
        .calculate_chunk_crcs(false)
        .calculate_data_section_crc(false)
        .calculate_summary_section_crc(false)
}

/// Offsets and ends of the records of a kind.
fn records(bytes: &[u8], opcode: u8) -> Vec<(usize, usize)> {
    let (mut at, mut found) = (8, Vec::new());
    while at + 9 <= bytes.len() {
        let len = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        if bytes[at] == opcode {
            found.push((at, at + 9 + len));
        }
        at += 9 + len;
    }
    found
}

/// Offsets of the records from a place on.
fn summary_records(bytes: &[u8], from: usize) -> Vec<usize> {
    let (mut at, mut found) = (from, Vec::new());
    while at + 9 <= bytes.len() {
        found.push(at);
        at += 9 + u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
    }
    found
}

fn recovered(dir: &Path, bytes: &[u8]) -> Recovery {
    let (path, out) = (dir.join("a.mcap"), dir.join("b.mcap"));
    std::fs::write(&path, bytes).unwrap();
    let recovery = recover(&path, &out).unwrap();
    std::fs::remove_file(&out).unwrap();
    let raw = RawReader::open(&path)
        .unwrap()
        .filter(Result::is_ok)
        .count();
    assert_eq!(raw as u64, recovery.messages_total, "{recovery}");
    recovery
}

#[test]
fn a_damaged_summary_alone_was_called_a_loss() {
    let dir = tempfile::tempdir().unwrap();
    let files = [
        ours(),
        foreign(mcap::WriteOptions::new()),
        foreign(without_checksums()),
        foreign(without_checksums().emit_statistics(false)),
        two_topics(mcap::WriteOptions::new()),
        two_topics(without_checksums()),
    ];
    for (n, whole) in files.iter().enumerate() {
        let all = recovered(dir.path(), whole);
        assert!(all.was_whole && !all.lossy, "{n}: {all}");
        let behind_data = records(whole, 0x0f)[0].1;
        let holds = |what: &str, bytes: &[u8]| {
            let found = recovered(dir.path(), bytes);
            assert!(!found.lossy, "{n}: {what}: {found}");
            assert_eq!(found.messages, all.messages, "{n}: {what}");
        };
        // Opcode, length and content of records from all over it, and the last bytes of the file.
        let summary = summary_records(whole, behind_data);
        let spread = summary.len().div_ceil(8);
        let places = summary.iter().step_by(spread).chain(summary.last());
        let hit = places.flat_map(|at| [*at, at + 1, at + 8, at + 9, at + 12]);
        for (k, at) in hit.chain(whole.len() - 30..whole.len()).enumerate() {
            let mut bytes = whole.clone();
            bytes[at] ^= [0x01, 0x10, 0x80][k % 3];
            holds(&format!("bit of byte {}", at - behind_data), &bytes);
        }
        for part in 0..4 {
            let at = behind_data + (whole.len() - behind_data) * part / 4;
            holds("cut", &whole[..at]);
            let mut bytes = whole.clone();
            bytes[at..].fill(0);
            holds("zeroed", &bytes);
            bytes[at..].fill(0xa5);
            holds("overwritten", &bytes);
        }
    }
    // Not so where the summary is sound and the data is not: a chunk that was cut out, one whose opcode was hit.
    let whole = ours();
    let (start, end) = records(&whole, 6)[1];
    let mut gone = whole.clone();
    gone.drain(start..end);
    let mut other = whole.clone();
    other[start] = 0x86;
    for bytes in [gone, other.clone()] {
        let found = recovered(dir.path(), &bytes);
        assert!(found.lossy, "{found}");
    }
    // Nor where both were hit.
    let at = other.len() - 60;
    other[at] ^= 1;
    assert!(recovered(dir.path(), &other).lossy);
}

#[test]
fn the_first_chunk_took_all_messages_with_it_whose_channels_it_declares() {
    let dir = tempfile::tempdir().unwrap();
    for options in [mcap::WriteOptions::new(), without_checksums()] {
        let whole = foreign(options.clone());
        let chunks = records(&whole, 6);
        let (start, end) = chunks[0];
        for damage in [start..end, start + 9..end, start..start + 60] {
            let mut bytes = whole.clone();
            bytes[damage.clone()].fill(0);
            let found = recovered(dir.path(), &bytes);
            let least = 200 - 200 / (chunks.len() as u64 - 1) - 2;
            assert!(found.messages_total >= least, "{damage:?}: {found}");
            assert!(found.lossy && found.messages_total < 200, "{found}");
        }
    }
}

#[test]
fn a_stretch_of_zeros_was_walked_through_as_records_without_content() {
    let dir = tempfile::tempdir().unwrap();
    let mut bytes = foreign(without_checksums().emit_statistics(false));
    let chunks = records(&bytes, 6);
    // A multiple of a record's head, so that the next record was met: nobody noticed.
    bytes.splice(chunks[3].0..chunks[4].0, [0; 900]);
    let found = recovered(dir.path(), &bytes);
    assert!(found.lossy && found.messages_total < 200, "{found}");
    assert!(found.to_string().contains("only zeros stand"), "{found}");
}

#[test]
fn messages_outside_chunks_are_found_again_behind_damage() {
    let dir = tempfile::tempdir().unwrap();
    let whole = foreign(mcap::WriteOptions::new().use_chunks(false));
    let messages = records(&whole, 5);
    assert_eq!(messages.len(), 200);
    let (start, end) = messages[100];
    for (damage, least) in [
        (start..end, 199),
        (start - 20..start + 5, 198),
        (start + 1..start + 4, 199),
    ] {
        let mut bytes = whole.clone();
        bytes[damage.clone()].fill(0xff);
        let found = recovered(dir.path(), &bytes);
        let total = found.messages_total;
        assert!(total >= least && total < 201, "{damage:?}: {found}");
        assert!(found.lossy, "{found}");
    }
}

#[test]
fn one_hit_in_the_declarations_of_a_log_without_chunks_took_its_messages_with_it() {
    let dir = tempfile::tempdir().unwrap();
    let whole = two_topics(mcap::WriteOptions::new());
    assert_eq!(recovered(dir.path(), &whole).messages_total, 400);
    let channels = records(&whole, 4);
    for (what, place) in [
        ("header", records(&whole, 1)[0].0),
        ("schema", records(&whole, 3)[0].0),
        ("first channel", channels[0].0),
        ("second channel", channels[1].0),
    ] {
        // A length beyond what is allowed, and one beyond the file.
        for (byte, value) in [(8, 0x7f), (4, 1)] {
            let mut bytes = whole.clone();
            bytes[place + byte] = value;
            let found = recovered(dir.path(), &bytes);
            assert_eq!(found.messages_total, 400, "{what}, byte {byte}: {found}");
            assert!(found.lossy, "{what}, byte {byte}: {found}");
        }
    }
}

#[test]
fn messages_of_a_truncated_chunk_whose_channel_only_the_summary_declares_were_dropped() {
    let dir = tempfile::tempdir().unwrap();
    let mut bytes = foreign(mcap::WriteOptions::new());
    let chunks = records(&bytes, 6);
    // The content of the chunk with the declarations; then the next one's length too, which reaches beyond the file.
    bytes[chunks[0].0 + 60] ^= 1;
    let first = recovered(dir.path(), &bytes);
    assert!(first.lossy && first.messages_total < 200, "{first}");
    bytes[chunks[1].0 + 4] = 1;
    let both = recovered(dir.path(), &bytes);
    assert_eq!(both.messages_total, first.messages_total, "{both}");
    assert!(both.from_truncated_chunk > 0, "{both}");
}
