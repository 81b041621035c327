//! Images and stripes in chunks of their own: what lies where, in which order, and what it does not cost.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Cursor;
use std::path::Path;

use crate::messages::{DecodeOver, pb};
use crate::tests::fixtures::{MemoryDisk, T0_NS, command, grey_frame};
use crate::{
    Counts, Entry, Head, IndexedLog, Limits, LogReader, LogWriter, Record, SummaryInput, Topic,
    WriteSettings, recover,
};

const PERIOD_NS: u64 = 40_000_000;

fn settings(limits: Limits) -> WriteSettings {
    WriteSettings {
        limits,
        ..WriteSettings::offline(Some(hydroline_rigs::PixelFormat::Grey))
    }
}

/// Two commands, a frame, one more command and a stripe each period; ticks in between, as the recorder's thread makes them.
fn written(disk: &MemoryDisk, periods: u32, limits: Limits) {
    let counts = Counts::default;
    let (opener, head) = (disk.opener(), Head::default());
    let mut log = LogWriter::create(opener, head, settings(limits), 0).unwrap();
    for i in 0..periods {
        let at_ns = u64::from(i) * PERIOD_NS;
        let mut write = |after_ns: u64, entry: &Entry| {
            let now_ns = at_ns + after_ns;
            log.tick(now_ns, &counts);
            log.write(now_ns, T0_NS + now_ns, entry, &counts);
        };
        write(0, &Entry::command(&command(3 * i)));
        write(1, &Entry::command(&command(3 * i + 1)));
        write(2, &Entry::frame(&grey_frame(i, 72, 58), u64::from(i)));
        write(3, &Entry::command(&command(3 * i + 2)));
        let profile = pb::StripeProfile {
            sequence: i,
            column_px: vec![1.5; 700],
            ..Default::default()
        };
        write(4, &Entry::profile(&profile));
    }
    let outcome = log.finish(
        u64::from(periods) * PERIOD_NS,
        &SummaryInput::clean("done"),
        &counts,
    );
    assert!(!outcome.lost);
}

/// Topics of each chunk, in the file's order.
fn chunks(bytes: &[u8]) -> Vec<BTreeSet<String>> {
    let summary = mcap::Summary::read(bytes).unwrap().unwrap();
    let mut chunks: Vec<_> = summary.chunk_indexes.iter().collect();
    chunks.sort_by_key(|c| c.chunk_start_offset);
    let topic = |id: &u16| summary.channels[id].topic.clone();
    let topics = chunks.iter().map(|c| {
        let ids = c.message_index_offsets.keys();
        ids.map(topic).collect::<BTreeSet<String>>()
    });
    topics.filter(|t| !t.is_empty()).collect()
}

fn bulk_is_apart(chunks: &[BTreeSet<String>]) {
    let (image, info) = (Topic::RawImage.name(), Topic::FrameInfo.name());
    let stripe = Topic::Profile.name();
    for topics in chunks {
        for (bulk, with) in [(image, [image, info]), (stripe, [stripe; 2])] {
            let apart = topics.iter().all(|t| with.contains(&t.as_str()));
            assert!(!topics.contains(bulk) || apart, "{topics:?}");
        }
    }
    for bulk in [image, stripe] {
        assert!(chunks.iter().any(|t| t.contains(bulk)), "{bulk}");
    }
}

/// Commands and frames in the order in which a reader finds them: commands by number, frames as negative ones.
fn order(bytes: Vec<u8>) -> Vec<i64> {
    let reader = LogReader::from_source(Path::new("m"), Cursor::new(bytes)).unwrap();
    let number = |record: Record| match record {
        Record::Command(c) => Some(i64::from(c.sequence)),
        Record::Frame(f) => Some(-1 - i64::from(f.meta.sequence)),
        _ => None,
    };
    reader.filter_map(|m| number(m.unwrap().record)).collect()
}

fn expected(periods: u32) -> Vec<i64> {
    let of = |i: i64| [3 * i, 3 * i + 1, -1 - i, 3 * i + 2];
    (0..i64::from(periods)).flat_map(of).collect()
}

#[test]
fn images_and_stripes_lie_apart_and_the_order_stays() {
    let disk = MemoryDisk::default();
    written(&disk, 20, Limits::offline());
    let found = chunks(&disk.file(0));
    bulk_is_apart(&found);
    // Commands, the frame, a command, the stripe.
    assert_eq!(found.len(), 80);
    assert_eq!(order(disk.file(0)), expected(20));
}

#[test]
fn frames_that_follow_each_other_share_a_chunk() {
    let disk = MemoryDisk::default();
    let (opener, counts) = (disk.opener(), Counts::default);
    let settings = settings(Limits::offline());
    let mut log = LogWriter::create(opener, Head::default(), settings, 0).unwrap();
    for i in 0..20 {
        let at_ns = u64::from(i) * 1_000_000;
        let frame = Entry::frame(&grey_frame(i, 72, 58), u64::from(i));
        log.write(at_ns, T0_NS + at_ns, &frame, &counts);
    }
    log.finish(20_000_000, &SummaryInput::clean("done"), &counts);
    assert_eq!(chunks(&disk.file(0)).len(), 1);
}

#[test]
fn a_live_recording_syncs_no_oftener_and_commands_wait_no_longer() {
    let disk = MemoryDisk::default();
    let limits = Limits {
        min_free_bytes: 0,
        ..Limits::default()
    };
    // Ten seconds, synced every two: the head, five times, the end.
    written(&disk, 250, limits);
    let syncs = disk.state.lock().unwrap().syncs;
    assert!((6..=7).contains(&syncs), "{syncs} syncs");
    bulk_is_apart(&chunks(&disk.file(0)));
    assert_eq!(order(disk.file(0)), expected(250));
}

#[test]
fn a_recovered_log_has_them_apart_too() {
    let (disk, folder) = (MemoryDisk::default(), tempfile::tempdir().unwrap());
    written(&disk, 20, Limits::offline());
    let whole = disk.file(0);
    let (cut, mended) = (folder.path().join("a.mcap"), folder.path().join("b.mcap"));
    std::fs::write(&cut, &whole[..whole.len() - 3000]).unwrap();
    recover::recover(&cut, &mended).unwrap();
    let bytes = std::fs::read(&mended).unwrap();
    bulk_is_apart(&chunks(&bytes));
    let found = order(bytes);
    assert!(found.len() > 60 && found[..] == expected(20)[..found.len()]);
}

#[test]
fn a_visit_finds_what_the_index_says_without_an_image() {
    let (disk, folder) = (MemoryDisk::default(), tempfile::tempdir().unwrap());
    written(&disk, 20, Limits::offline());
    let path = folder.path().join("a.mcap");
    let mut bytes = disk.file(0);
    std::fs::write(&path, &bytes).unwrap();
    let log = IndexedLog::open(&path).unwrap();
    let topics = [Topic::Command, Topic::Motion];
    let visited = |log: &IndexedLog| {
        let (mut numbers, mut decoded) = (Vec::new(), pb::ThrusterCommand::default());
        let places = log.places(&topics.map(Topic::name));
        log.visit(&places, &topics, |topic, log_ns, data| {
            assert_eq!(topic, Topic::Command);
            decoded.decode_over(data)?;
            numbers.push((log_ns, decoded.clone()));
            Ok(())
        })?;
        Ok::<_, crate::LogError>(numbers)
    };
    let found = visited(&log).unwrap();
    let read = LogReader::open(&path).unwrap().filter_map(|m| {
        let m = m.unwrap();
        match m.record {
            Record::Command(c) => Some((m.log_ns, c)),
            _ => None,
        }
    });
    assert_eq!(found, read.collect::<Vec<_>>());
    assert_eq!(found.len(), 60);
    // Words of the visitor come with the place.
    let place = log.places(&[Topic::Command.name()])[0];
    let refused = log.visit(&[place], &topics, |_, _, _| Err("no".to_owned()));
    assert!(
        refused
            .unwrap_err()
            .to_string()
            .contains("/thruster/command")
    );
    // Damage in the images hurts who reads them only.
    let images = log.places(&[Topic::RawImage.name()]);
    assert_eq!(images.len(), 20);
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let counts: BTreeMap<u64, usize> = (summary.chunk_indexes.iter())
        .map(|c| (c.chunk_start_offset, c.message_index_offsets.len()))
        .collect();
    let image_at = counts.iter().find(|(_, channels)| **channels == 2).unwrap();
    bytes[*image_at.0 as usize + 100] ^= 0x20;
    std::fs::write(&path, &bytes).unwrap();
    let damaged = IndexedLog::open(&path).unwrap();
    assert_eq!(visited(&damaged).unwrap(), found);
    let mut places = damaged.places(&[Topic::RawImage.name()]).into_iter();
    assert!(places.any(|p| damaged.messages(p, &[Topic::RawImage.name()]).is_err()));
}
