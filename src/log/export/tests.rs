//! Exports that were killed: gone on with, and the same as those that were not.

use super::*;
use crate::tests::fixtures::{T0_NS, command, grey_frame};
use crate::{Entry, FileRecorder, Head, SummaryInput, WriteSettings};
use std::time::{Duration, SystemTime};

const ALL: ExportOptions = ExportOptions {
    tables: true,
    frames: true,
};
const FRAMES: u32 = 5;

fn log(path: &Path) {
    let settings = WriteSettings::offline(Some(hydroline_rigs::PixelFormat::Grey));
    let mut log = FileRecorder::create(path, false, Head::default(), settings).unwrap();
    for k in 0..FRAMES {
        let t_ns = T0_NS + u64::from(k) * 40_000_000;
        let frame = grey_frame(k, 24, 16);
        log.write(t_ns, &Entry::frame(&frame, u64::from(k)))
            .unwrap();
        log.write(t_ns, &Entry::command(&command(k))).unwrap();
    }
    log.finish(&SummaryInput::clean("done")).unwrap();
}

/// Files of a folder with their content and time of change.
fn files(folder: &Path) -> BTreeMap<String, (Vec<u8>, SystemTime)> {
    let entries = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap());
    let file = |e: std::fs::DirEntry| {
        let changed = e.metadata().unwrap().modified().unwrap();
        let name = e.file_name().into_string().unwrap();
        (name, (std::fs::read(e.path()).unwrap(), changed))
    };
    entries.map(file).collect()
}

fn same_content(a: &Path, b: &Path) -> bool {
    let content = |folder: &Path| -> BTreeMap<String, Vec<u8>> {
        let all = files(folder).into_iter();
        all.map(|(name, (bytes, _))| (name, bytes)).collect()
    };
    content(a) == content(b)
}

/// Long before any export of these tests.
fn old() -> SystemTime {
    SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000_000)
}

/// Images of a folder, given an old time of change.
fn aged(folder: &Path) -> Vec<String> {
    let names = files(folder).into_keys().filter(|n| n.ends_with(".png"));
    let names: Vec<String> = names.collect();
    for name in &names {
        let file = File::options().write(true).open(folder.join(name));
        file.unwrap().set_modified(old()).unwrap();
    }
    names
}

/// An export that was killed when so many images were whole: its lock is gone, its files are left.
fn killed(log: &Path, into: &Path, images: usize) -> Vec<String> {
    std::fs::create_dir_all(into).unwrap();
    let mut unfinished = Unfinished::begin(log, into, ALL).unwrap();
    let reader = LogReader::open(log).unwrap();
    let rule = reader.grey_rule();
    let records = reader.map(|message| message.unwrap().record);
    let frames = records.filter_map(|record| match record {
        Record::Frame(frame) => Some(frame),
        _ => None,
    });
    for frame in frames.take(images) {
        assert!(save(&frame, &rule, &mut unfinished).unwrap() == Saved::Now);
    }
    std::fs::write(unfinished.part.join("frame_00000004_1.png.tmp"), "half").unwrap();
    std::fs::write(unfinished.part.join("frames.csv"), "half").unwrap();
    aged(&unfinished.part)
}

/// It was removed and begun anew.
#[test]
fn an_export_that_was_killed_goes_on_and_becomes_what_it_would_have_been() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    log(&at("run.mcap"));
    let whole = export(&at("run.mcap"), &at("whole"), ALL).unwrap();
    assert_eq!((whole.frames, whole.frames_resumed), (5, 0));
    for images in [0, 1, 3, 5] {
        let into = at(&format!("after-{images}"));
        let left = killed(&at("run.mcap"), &into, images);
        assert_eq!(left.len(), images);
        let done = export(&at("run.mcap"), &into, ALL).unwrap();
        assert_eq!((done.frames, done.frames_resumed), (5, images as u64));
        assert!(done.rows.values().eq(whole.rows.values()));
        assert!(same_content(&into, &at("whole")));
        // Those that were there were not made again.
        let now = files(&into);
        let kept = now.iter().filter(|(_, (_, changed))| *changed == old());
        let kept: Vec<&String> = kept.map(|(name, _)| name).collect();
        assert!(kept.into_iter().eq(&left), "{left:?}");
        assert!(!is_unfinished(&into));
    }
}

/// What had its place already was removed, and all was begun anew.
#[test]
fn files_of_a_killed_export_that_were_whole_get_their_places() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    log(&at("run.mcap"));
    let whole = export(&at("run.mcap"), &at("whole"), ALL).unwrap();
    let into = at("run");
    let reader = LogReader::open(&at("run.mcap")).unwrap();
    std::fs::create_dir_all(&into).unwrap();
    let mut unfinished = Unfinished::begin(&at("run.mcap"), &into, ALL).unwrap();
    let account = write_all(reader, &mut unfinished, ALL).unwrap();
    let names = unfinished.names().unwrap();
    unfinished.list(&names, &account).unwrap();
    let left = aged(&unfinished.part);
    std::fs::rename(unfinished.part.join(&names[0]), into.join(&names[0])).unwrap();
    drop(unfinished);
    let done = export(&at("run.mcap"), &into, ALL).unwrap();
    assert_eq!((done.frames, done.frames_resumed), (5, 5));
    assert_eq!(done.rows[&into.join("frames.csv")], 5);
    assert_eq!(done.rows.len(), whole.rows.len());
    assert!(same_content(&into, &at("whole")));
    let now = files(&into);
    assert!(left.iter().all(|name| now[name].1 == old()));
}

#[test]
fn what_another_log_or_other_options_left_is_not_gone_on_with() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    log(&at("run.mcap"));
    let tables = ExportOptions {
        frames: false,
        ..ALL
    };
    killed(&at("run.mcap"), &at("tables"), 2);
    let done = export(&at("run.mcap"), &at("tables"), tables).unwrap();
    assert_eq!((done.frames, files(&at("tables")).len()), (0, 2));
    // Written again meanwhile, with as many bytes.
    killed(&at("run.mcap"), &at("later"), 2);
    let file = File::options().write(true).open(at("run.mcap")).unwrap();
    file.set_modified(old()).unwrap();
    let done = export(&at("run.mcap"), &at("later"), ALL).unwrap();
    assert_eq!((done.frames, done.frames_resumed), (5, 0));
    // Files that came since are nobody's of it.
    killed(&at("run.mcap"), &at("mixed"), 2);
    std::fs::write(at("mixed").join("notes.txt"), "precious").unwrap();
    let refused = export(&at("run.mcap"), &at("mixed"), ALL).unwrap_err();
    assert!(matches!(refused, LogError::NotEmpty { .. }), "{refused}");
    assert_eq!(files(&at("mixed/unfinished.part")).len(), 5);
}
