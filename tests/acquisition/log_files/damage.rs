//! Cuts, bit flips and rubbish: a clear error each time, no panic, no silently wrong data.

use hydroline::log::doctor::{self, Grade, doctor};
use hydroline::log::export::{ExportOptions, export};
use hydroline::log::info::{Ending, info};
use hydroline::log::recover::recover;
use hydroline::log::*;
use proptest::prelude::*;
use std::path::Path;

use super::support::{Rng, python_counts, read_all, small_log};

/// Offsets of the top-level records with this opcode.
fn offsets(bytes: &[u8], opcode: u8) -> Vec<(usize, usize)> {
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

/// Cuts a log at every `step`-th byte of its last chunk.
fn cut_everywhere(zstd_level: u32, (frames, chunk_bytes): (u32, u64), step: usize, salvages: bool) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("whole.mcap");
    small_log(&path, frames, chunk_bytes, zstd_level);
    let bytes = std::fs::read(&path).unwrap();
    let (whole, errors) = read_all(&bytes);
    assert!(errors.is_empty());
    let chunks = offsets(&bytes, 6);
    let (start, end) = *chunks.last().unwrap();
    let in_closed = whole.iter().filter(|m| (m.offset as usize) < start).count();
    assert!(chunks.len() >= 3 && in_closed > 10 && whole.len() > in_closed + 2);
    let (cut_path, mended) = (dir.path().join("cut.mcap"), dir.path().join("mended.mcap"));
    let mut most_salvaged = 0;
    for cut in (start..end).step_by(step) {
        let (messages, errors) = read_all(&bytes[..cut]);
        assert_eq!(messages[..], whole[..in_closed], "cut at {cut}");
        assert_eq!(
            errors.len(),
            1,
            "cut at {cut}: the reader says that the end is missing"
        );
        std::fs::write(&cut_path, &bytes[..cut]).unwrap();
        let recovery = recover(&cut_path, &mended).unwrap();
        let (back, errors) = read_all(&std::fs::read(&mended).unwrap());
        assert!(errors.is_empty(), "cut at {cut}: {errors:?}");
        assert!(
            back.len() >= in_closed,
            "cut at {cut}: {} of {in_closed}",
            back.len()
        );
        // Messages salvaged beyond the closed chunks are those written, in order.
        for (a, b) in back.iter().zip(&whole) {
            assert_eq!(
                (&a.record, a.log_ns, a.publish_ns, a.sequence),
                (&b.record, b.log_ns, b.publish_ns, b.sequence)
            );
        }
        assert_eq!(recovery.lossy, cut > start, "cut at {cut}");
        assert_eq!(
            recovery.from_truncated_chunk,
            (back.len() - in_closed) as u64
        );
        most_salvaged = most_salvaged.max(recovery.from_truncated_chunk);
        std::fs::remove_file(&mended).unwrap();
    }
    assert_eq!(
        most_salvaged > 0,
        salvages,
        "salvaged {most_salvaged} from the truncated chunk"
    );
}

#[test]
fn a_cut_in_the_last_chunk_keeps_all_closed_chunks() {
    // zstd gives nothing before its first 128 KiB block is whole, so a small chunk is all or nothing.
    cut_everywhere(1, (12, 14_000), 131, false);
    cut_everywhere(1, (260, 350_000), 20_011, true);
    cut_everywhere(0, (12, 14_000), 131, true);
}

/// `cargo test -p hydroline --test log_files -- --ignored every_byte`
#[test]
#[ignore = "some 20000 recoveries take minutes"]
fn a_cut_at_every_byte_of_the_last_chunk() {
    cut_everywhere(1, (12, 14_000), 1, false);
    cut_everywhere(1, (260, 350_000), 211, true);
    cut_everywhere(0, (12, 14_000), 1, true);
}

#[test]
fn recover_replaces_nothing_and_whole_files_stay_whole() {
    let dir = tempfile::tempdir().unwrap();
    let (path, mended) = (dir.path().join("a.mcap"), dir.path().join("b.mcap"));
    small_log(&path, 10, 14_000, 1);
    assert!(matches!(
        recover(&path, &path),
        Err(LogError::OutputExists { .. })
    ));
    let recovery = recover(&path, &mended).unwrap();
    assert!(recovery.was_whole && !recovery.lossy && recovery.damage.is_empty());
    assert!(matches!(
        recover(&path, &mended),
        Err(LogError::OutputExists { .. })
    ));
    let (a, b) = (
        std::fs::read(&path).unwrap(),
        std::fs::read(&mended).unwrap(),
    );
    let strip = |m: Vec<LogMessage>| {
        m.into_iter()
            .map(|m| (m.log_ns, m.sequence, m.record))
            .collect::<Vec<_>>()
    };
    assert_eq!(strip(read_all(&a).0), strip(read_all(&b).0));
    let report = info(&mended).unwrap();
    assert_eq!(report.ending, Ending::Clean);
    for name in ["rig", "calibration", "session", "summary", "recovered"] {
        assert!(report.metadata.contains_key(name), "{name}");
    }
    if let Some(counts) = python_counts(&mended) {
        assert_eq!(counts["/camera/image"], 10);
    }
}

#[test]
fn a_damaged_chunk_costs_only_itself() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.mcap");
    small_log(&path, 12, 14_000, 1);
    let mut bytes = std::fs::read(&path).unwrap();
    let (whole, _) = read_all(&bytes);
    // One of commands, with some before and behind.
    let mut commands = whole
        .iter()
        .filter(|m| matches!(m.record, Record::Command(_)));
    let hit = commands.nth(5).unwrap().offset as usize;
    let chunks = offsets(&bytes, 6);
    let (start, end) = *chunks.iter().find(|(start, _)| *start == hit).unwrap();
    bytes[(start + end) / 2] ^= 0x10;
    let (messages, errors) = read_all(&bytes);
    let expected: Vec<_> = whole
        .iter()
        .filter(|m| m.offset as usize != start)
        .cloned()
        .collect();
    assert_eq!(messages, expected);
    assert!(
        matches!(&errors[0], LogError::Damaged { offset, .. } if *offset as usize == start),
        "{errors:?}"
    );
    std::fs::write(&path, &bytes).unwrap();
    let recovery = recover(&path, &dir.path().join("b.mcap")).unwrap();
    assert!(recovery.lossy);
    assert_eq!(recovery.messages_total, expected.len() as u64);
    let diagnosis = doctor(&path).unwrap();
    assert!(
        diagnosis.found("damage", Grade::Error) && diagnosis.found("command_gap", Grade::Error)
    );
    let text = errors[0].to_string();
    assert!(
        text.contains("bytes.mcap")
            && text.contains(&start.to_string())
            && text.contains("recover"),
        "{text}"
    );
}

/// A wrong length hides where the next record begins; recovery looks for the next sound chunk.
#[test]
fn a_wrong_length_does_not_cost_the_rest_of_the_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.mcap");
    small_log(&path, 20, 14_000, 1);
    let bytes = std::fs::read(&path).unwrap();
    for chunk in [2, 3] {
        damaged_length(&path, &bytes, chunk);
    }
}

fn damaged_length(path: &Path, bytes: &[u8], chunk: usize) {
    let (whole, _) = read_all(bytes);
    let (start, _) = offsets(bytes, 6)[chunk];
    // Bytes of the length: beyond the end of the file, absurd, wrong within the file.
    for (n, (at, value)) in [(4, 0xFF), (8, 0x7F), (2, 0x01), (3, 0x40)]
        .into_iter()
        .enumerate()
    {
        let mut damaged = bytes.to_owned();
        damaged[start + at] = value;
        std::fs::write(path, &damaged).unwrap();
        let mended = path.with_file_name(format!("{chunk}-{n}.mcap"));
        let recovery = recover(path, &mended).unwrap();
        assert!(recovery.lossy && !recovery.damage.is_empty(), "{recovery}");
        let (back, errors) = read_all(&std::fs::read(&mended).unwrap());
        assert!(errors.is_empty());
        let in_others = whole.iter().filter(|m| m.offset as usize != start).count();
        assert!(
            back.len() >= in_others,
            "case {n}: {} of {in_others}: {recovery}",
            back.len()
        );
        let strip = |m: &LogMessage| (m.log_ns, m.sequence, m.record.clone());
        let known: Vec<_> = whole.iter().map(strip).collect();
        assert!(back.iter().all(|m| known.contains(&strip(m))));
    }
}

#[test]
fn doctor_finds_a_sound_log_sound_and_names_what_is_missing() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.mcap");
    small_log(&path, 10, 14_000, 1);
    let diagnosis = doctor(&path).unwrap();
    assert!(
        diagnosis.sound && diagnosis.findings.is_empty(),
        "{diagnosis}"
    );
    let bytes = std::fs::read(&path).unwrap();
    let cut = dir.path().join("cut.mcap");
    std::fs::write(&cut, &bytes[..bytes.len() - 200]).unwrap();
    let diagnosis = doctor(&cut).unwrap();
    assert!(
        !diagnosis.sound && diagnosis.found("end", Grade::Error),
        "{diagnosis}"
    );
    assert_eq!(info(&cut).unwrap().ending, Ending::Cut);
    serde_json::to_string(&diagnosis).unwrap();
    serde_json::to_string(&info(&cut).unwrap()).unwrap();
}

#[test]
fn export_writes_what_the_log_says() {
    let dir = tempfile::tempdir().unwrap();
    let (path, into) = (dir.path().join("a.mcap"), dir.path().join("out"));
    small_log(&path, 5, 14_000, 1);
    let done = export(
        &path,
        &into,
        ExportOptions {
            tables: true,
            frames: true,
        },
    )
    .unwrap();
    assert_eq!((done.frames, done.frames_skipped), (5, 0));
    assert_eq!(
        (
            done.rows[&into.join("commands.csv")],
            done.rows[&into.join("frames.csv")]
        ),
        (5, 5)
    );
    let commands = std::fs::read_to_string(into.join("commands.csv")).unwrap();
    let lines: Vec<&str> = commands.lines().collect();
    assert_eq!(lines[0].split(',').count(), lines[1].split(',').count());
    assert!(lines[3].ends_with(",2,surge,4,0,0,0,"), "{}", lines[3]);
    let image = image::open(into.join("frame_00000003_1760000000120000000.png"))
        .unwrap()
        .into_luma8();
    assert_eq!(image.into_raw(), super::support::noise(3, 64 * 48));
}

/// One flipped bit anywhere: every message that comes out without an error before it is as it was,
/// and if any is missing or the file differs in what it holds, there is an error.
pub fn flip_bits(bytes: &[u8], flips: usize, seed: u64) -> (usize, usize) {
    let (whole, errors) = read_all(bytes);
    assert!(errors.is_empty(), "{errors:?}");
    let mut rng = Rng(seed);
    let (mut detected, mut harmless) = (0, 0);
    let mut damaged = bytes.to_vec();
    for _ in 0..flips {
        let bit = rng.below(bytes.len() as u64 * 8) as usize;
        damaged[bit / 8] ^= 1 << (bit % 8);
        let (messages, errors) = read_all(&damaged);
        if errors.is_empty() {
            assert_eq!(messages, whole, "bit {bit} is wrong and nobody noticed");
            harmless += 1;
        } else {
            let known = |m: &LogMessage| whole.iter().any(|w| w == m);
            assert!(
                messages.iter().all(known),
                "bit {bit}: a message that was never written"
            );
            detected += 1;
        }
        damaged[bit / 8] ^= 1 << (bit % 8);
    }
    (detected, harmless)
}

#[test]
fn single_bit_flips_are_noticed() {
    let dir = tempfile::tempdir().unwrap();
    for level in [0, 1] {
        let path = dir.path().join(format!("{level}.mcap"));
        small_log(&path, 6, 14_000, level);
        let (detected, harmless) = flip_bits(&std::fs::read(&path).unwrap(), 300, 77);
        println!("zstd level {level}: {detected} noticed, {harmless} harmless");
        // Our files carry a checksum over every byte: hardly a flip goes by.
        assert!(detected >= 290, "{detected}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn rubbish_gives_an_error(mut bytes in proptest::collection::vec(any::<u8>(), 0..2000), magic in any::<bool>()) {
        if magic {
            let mut with = b"\x89MCAP0\r\n".to_vec();
            with.append(&mut bytes);
            bytes = with;
        }
        let (_, errors) = read_all(&bytes);
        prop_assert!(!errors.is_empty());
    }

    /// Records of every kind with forged lengths and arbitrary bodies.
    #[test]
    fn forged_records_give_an_error(records in proptest::collection::vec((0u8..17, any::<u64>(), 0u32..64, proptest::collection::vec(any::<u8>(), 0..300)), 1..12)) {
        let mut bytes = b"\x89MCAP0\r\n".to_vec();
        for (opcode, forged, shift, body) in records {
            bytes.push(opcode);
            // Mostly the right length, sometimes an absurd one.
            let len = if shift < 8 { forged >> shift } else { body.len() as u64 };
            bytes.extend(len.to_le_bytes());
            bytes.extend(body);
        }
        let (_, errors) = read_all(&bytes);
        prop_assert!(!errors.is_empty());
    }
}

/// Several flips at once, cuts and swaps on a real file's bytes: never a panic.
#[test]
fn mutated_files_never_panic() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.mcap");
    small_log(&path, 6, 14_000, 1);
    let bytes = std::fs::read(&path).unwrap();
    let mut rng = Rng(4242);
    for _ in 0..400 {
        let mut damaged = bytes.clone();
        for _ in 0..1 + rng.below(8) {
            let at = rng.below(damaged.len() as u64) as usize;
            match rng.below(4) {
                0 => damaged[at] = rng.next() as u8,
                1 => damaged.truncate(at.max(1)),
                2 => drop(damaged.drain(at..(at + 1 + rng.below(40) as usize).min(damaged.len()))),
                _ => damaged.insert(at, rng.next() as u8),
            }
            if damaged.is_empty() {
                break;
            }
        }
        if damaged == bytes {
            continue;
        }
        let (_, errors) = read_all(&damaged);
        assert!(!errors.is_empty());
    }
}

/// The rig, the calibration and the session of a killed log: 274 of 300 flips passed recover and doctor.
#[test]
fn metadata_without_checksum_a_flipped_bit_in_a_killed_log_is_said() {
    let dir = tempfile::tempdir().unwrap();
    let whole = dir.path().join("whole.mcap");
    small_log(&whole, 12, 14_000, 1);
    let mut bytes = std::fs::read(&whole).unwrap();
    let last_chunk = offsets(&bytes, 6).last().unwrap().1;
    bytes.truncate(last_chunk);
    let records = offsets(&bytes, 12);
    assert_eq!(records.len(), 3, "rig, calibration and session");
    let (path, mended) = (dir.path().join("flip.mcap"), dir.path().join("mended.mcap"));
    let metadata = |diagnosis: &doctor::Diagnosis| diagnosis.found("metadata", Grade::Error);
    std::fs::write(&path, &bytes).unwrap();
    let before = doctor(&path).unwrap();
    let clean = before.findings.iter().all(|f| f.check == "end");
    assert!(clean, "nothing is flipped yet: {before}");
    let mut rng = Rng(7);
    for _ in 0..300 {
        let (start, end) = records[rng.below(3) as usize];
        let at = start + rng.below((end - start) as u64) as usize;
        let bit = rng.below(8);
        let mut flipped = bytes.clone();
        flipped[at] ^= 1 << bit;
        std::fs::write(&path, &flipped).unwrap();
        let recovery = recover(&path, &mended).unwrap();
        let place = format!("bit {bit} of byte {at} in {start}..{end}");
        assert!(recovery.lossy && !recovery.was_whole, "recover: {place}");
        // A flipped length hides all that follows it from doctor, which says so.
        let found = doctor(&path).unwrap();
        let said = metadata(&found)
            || found.found("damage", Grade::Error)
            || found.found("head", Grade::Warning);
        assert!(said, "doctor: {place}: {found}");
        let found = doctor(&mended).unwrap();
        assert!(metadata(&found), "mended: {place}: {found}");
        std::fs::remove_file(&mended).unwrap();
    }
}
