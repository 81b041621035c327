//! Logs that were changed, joined, or made to hurt.

use super::{bounded, ours, path, simulated, words};
use hydroline::event::{Event, EventKind, Severity};
use hydroline::log::{Entry, FileRecorder, Head, SummaryInput, WriteSettings};
use hydroline_rigs::Rig;
use std::path::Path;

fn flip(bytes: &mut [u8], before: &[u8], by: usize) {
    let at = bytes
        .windows(before.len())
        .position(|w| w == before)
        .unwrap();
    bytes[at + before.len() + by] ^= 1;
}

/// Each command ends with 3 and names the damaged rig.
fn say_of_the_rig(lines: &[Vec<&str>]) {
    for line in lines {
        let output = bounded(line);
        let said = words(&output);
        assert_eq!(output.status.code(), Some(3), "{said}");
        assert!(said.contains("`rig`"), "{said}");
    }
}

/// 1. A digit of the rig's mass in a log that was killed: recover, doctor and replay took it for sound.
#[test]
fn metadata_without_checksum() {
    let dir = tempfile::tempdir().unwrap();
    let log = simulated(dir.path(), "run.mcap", "lshpi");
    let mut bytes = std::fs::read(&log).unwrap();
    flip(&mut bytes, b"mass_kg = ", 0);
    bytes.truncate(bytes.len() - 3000);
    let (killed, mended) = (
        path(dir.path(), "killed.mcap"),
        path(dir.path(), "mended.mcap"),
    );
    std::fs::write(&killed, bytes).unwrap();
    say_of_the_rig(&[
        vec!["recover", &killed, "--out", &mended],
        vec!["doctor", &killed],
    ]);
    // The replay of a recovered run with images says so too, and so does the doctor of the log that it wrote.
    let [recorded, recovered, replayed] =
        ["recorded", "recovered", "replayed"].map(|name| path(dir.path(), &format!("{name}.mcap")));
    let words_of = format!("record --rig lshpi --for 1s --no-thrusters --out {recorded}");
    let output = bounded(&words_of.split(' ').collect::<Vec<_>>());
    assert!(output.status.success(), "{}", words(&output));
    let mut bytes = std::fs::read(&recorded).unwrap();
    flip(&mut bytes, b"mass_kg = ", 0);
    bytes.truncate(bytes.len() - 3000);
    std::fs::write(&recorded, bytes).unwrap();
    say_of_the_rig(&[
        vec!["recover", &recorded, "--out", &recovered],
        vec!["replay", &recovered, "--out", &replayed],
        vec!["doctor", &replayed],
    ]);
}

/// 7. A second log behind the first one's end was passed over without a word.
#[test]
fn two_logs_joined_are_no_sound_log() {
    let dir = tempfile::tempdir().unwrap();
    let log = simulated(dir.path(), "run.mcap", "lshpi");
    let mut bytes = std::fs::read(&log).unwrap();
    bytes.extend_from_within(..);
    let joined = path(dir.path(), "joined.mcap");
    std::fs::write(&joined, bytes).unwrap();
    let output = bounded(&["doctor", &joined]);
    assert_eq!(output.status.code(), Some(3), "{}", words(&output));
}

/// 7. Messages that do not decode were "recovered and verified", and nothing lost.
#[test]
fn undecodable_messages_are_no_whole_recovery() {
    let dir = tempfile::tempdir().unwrap();
    let mended = path(dir.path(), "mended.mcap");
    let log = ours("recover-undecodable.mcap");
    let output = bounded(&["recover", log.to_str().unwrap(), "--out", &mended]);
    assert_eq!(output.status.code(), Some(3), "{}", words(&output));
}

/// 5. A width whose row does not fit a number: panic.
#[test]
fn image_geometry_unchecked() {
    let dir = tempfile::tempdir().unwrap();
    let log = ours("yuyv_overflow.mcap");
    let log = log.to_str().unwrap();
    let (tables, replayed) = (
        path(dir.path(), "tables"),
        path(dir.path(), "replayed.mcap"),
    );
    for line in [
        vec!["doctor", log],
        vec!["export", log, "--out", &tables],
        vec!["replay", log, "--rig", "lshpi", "--out", &replayed],
    ] {
        let output = bounded(&line);
        let said = words(&output);
        assert!(
            matches!(output.status.code(), Some(1 | 3)),
            "{line:?}: {said}"
        );
        assert!(!said.contains("panicked"), "{said}");
    }
}

/// 9. Escape sequences in a log's strings reached the terminal raw.
#[test]
fn strings_of_a_log_on_the_terminal() {
    let dir = tempfile::tempdir().unwrap();
    let log = path(dir.path(), "esc.mcap");
    const EVIL: &str = "\u{1b}]0;title\u{7}\u{1b}[2J\r\nsound";
    static KIND: EventKind = EventKind {
        name: EVIL,
        severities: &[Severity::Error],
        meaning: "",
        values: &[],
    };
    let evil = EVIL;
    let head = Head {
        rig_toml: Rig::builtin("lshpi").unwrap().effective_toml,
        session: [("note".to_owned(), evil.to_owned())].into(),
        ..Head::default()
    };
    let file = Path::new(&log);
    let mut recorder =
        FileRecorder::create(file, false, head, WriteSettings::offline(None)).unwrap();
    let event = Event {
        timestamp_ns: 1_760_000_000_000_000_000,
        severity: Severity::Error,
        kind: &KIND,
        message: evil.to_owned(),
        values: Vec::new(),
    };
    recorder
        .write(event.timestamp_ns, &Entry::event(&event))
        .unwrap();
    recorder.finish(&SummaryInput::clean("done")).unwrap();
    for command in ["info", "doctor"] {
        let output = bounded(&[command, &log]);
        let raw = [output.stdout.as_slice(), output.stderr.as_slice()].concat();
        let acts = |byte: &u8| *byte < 0x20 && *byte != b'\n';
        assert!(!raw.iter().any(acts), "{command}: {}", words(&output));
    }
}

/// 10. Replaying 115 kB of messages took 5 GB; a JPEG of 8 kB that unpacks to gigabytes was no loss.
#[test]
fn work_bounded_by_the_size_of_the_file() {
    let dir = tempfile::tempdir().unwrap();
    let (flood, bomb) = (ours("msgflood20.mcap"), ours("jpegbomb.mcap"));
    let (replayed, tables) = (
        path(dir.path(), "replayed.mcap"),
        path(dir.path(), "tables"),
    );
    let flood = flood.to_str().unwrap();
    let output = bounded(&["replay", flood, "--rig", "lshpi", "--out", &replayed]);
    let said = words(&output);
    assert!(matches!(output.status.code(), Some(0..=3)), "{said}");
    assert!(!said.contains("allocation"), "{said}");
    let output = bounded(&["export", bomb.to_str().unwrap(), "--out", &tables]);
    assert_eq!(output.status.code(), Some(3), "{}", words(&output));
}
