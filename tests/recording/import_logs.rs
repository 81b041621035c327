//! Logs of other programs: every number as those programs' own readers have it, damage counted, and the way to a log of
//! ours. `import_logs/make.py` writes the logs and what their readers make of them.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::support::hydroline;
use hydroline::import::recorded::Recording;
use hydroline::import::{Map, Source};
use serde_json::Value;

/// Logs of a kind, in a folder of their own.
fn made(kind: &str) -> Option<tempfile::TempDir> {
    let python =
        crate::inputs::python(&["mcap", "rosbags", "pymavlink", "pyulog", "google.protobuf"])?;
    let dir = tempfile::tempdir().unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/recording/import_logs/make.py");
    let out = Command::new(python)
        .arg(script)
        .arg(dir.path())
        .arg(kind)
        .output()
        .unwrap();
    assert!(
        out.status.success(),
        "{}",
        String::from_utf8_lossy(&out.stderr)
    );
    Some(dir)
}

/// Messages as their own reader has them, by topic.
fn expected(log: &Path) -> BTreeMap<String, Vec<Value>> {
    let mut all: BTreeMap<String, Vec<Value>> = BTreeMap::new();
    let text = std::fs::read_to_string(format!("{}.jsonl", log.display())).unwrap();
    for line in text.lines() {
        let message: Value = serde_json::from_str(line).unwrap();
        let topic = message["topic"].as_str().unwrap().to_owned();
        all.entry(topic).or_default().push(message);
    }
    all
}

/// Whether a cell is exactly that number.
fn is_same(cell: &str, value: &Value) -> bool {
    match value {
        Value::String(text) => {
            cell == text
                || matches!((cell.parse::<f64>(), text.parse::<f64>()), (Ok(a), Ok(b)) if a == b)
        }
        Value::Number(n) => cell == n.to_string(),
        _ => false,
    }
}

/// Every field of every topic, topic by topic; `lost` messages may be missing of each. How many numbers were compared.
fn compare(log: &Path, lost: usize) -> usize {
    let compared = numbers(log, lost);
    assert!(compared > 1000, "{compared}");
    compared
}

fn numbers(log: &Path, lost: usize) -> usize {
    let recording = Recording::open(log).unwrap().unwrap();
    let mut compared = 0;
    for (topic, messages) in expected(log) {
        let fields: BTreeSet<String> = messages
            .iter()
            .flat_map(|m| m["fields"].as_object().unwrap().keys().cloned())
            .collect();
        if fields.is_empty() {
            continue;
        }
        // A map of commands may name as many columns as there are.
        let mut map = "[time]\ncolumn = \"stamp\"\nunit = \"ns\"\n".to_owned();
        for field in &fields {
            map += &format!(
                "[[command]]\nthruster = \"surge\"\nmissing = \"skip\"\ncolumn = \"{topic}.{field}\"\n"
            );
        }
        let map = Map::from_toml(&map, "map").unwrap();
        let table = recording.table(&map).unwrap();
        let bad: Vec<_> = table
            .findings
            .iter()
            .filter(|f| f.kind == "column_missing")
            .collect();
        assert!(bad.is_empty(), "{bad:?}");
        let mut text = String::new();
        table.open().unwrap().read_to_string(&mut text).unwrap();
        let rows: Vec<Vec<&str>> = text
            .lines()
            .skip(1)
            .map(|l| l.split(',').collect())
            .collect();
        assert!(
            rows.len() <= messages.len() && rows.len() + lost >= messages.len(),
            "{}: {topic}: {} rows of {} messages",
            log.display(),
            rows.len(),
            messages.len()
        );
        let mut next = rows.iter();
        let mut row = next.next();
        for message in &messages {
            let Some(cells) = row else { break };
            // A message that was lost here is passed over.
            if lost > 0 && !is_same(cells[1], &message["log_ns"]) {
                continue;
            }
            assert!(
                is_same(cells[1], &message["log_ns"]),
                "{topic} {} {message}",
                cells[1]
            );
            if !message["stamp_ns"].is_null() {
                assert!(
                    is_same(cells[0], &message["stamp_ns"]),
                    "{topic} {} {message}",
                    cells[0]
                );
            }
            for (place, field) in fields.iter().enumerate() {
                match message["fields"].get(field) {
                    Some(value) => {
                        assert!(
                            is_same(cells[2 + place], value),
                            "{}: {topic}.{field}: {} here, {value} there",
                            log.display(),
                            cells[2 + place]
                        );
                        compared += 1;
                    }
                    None => assert!(matches!(cells[2 + place], "" | "nan"), "{topic}.{field}"),
                }
            }
            row = next.next();
        }
        assert!(
            row.is_none(),
            "{topic}: rows that the other reader does not have"
        );
    }
    compared
}

fn unreadable(log: &Path) -> u64 {
    let recording = Recording::open(log).unwrap().unwrap();
    let own = recording.contents().unreadable.iter();
    own.filter(|u| u.what == "damaged records")
        .map(|u| u.count)
        .sum()
}

fn run(words: &[&str]) -> Output {
    hydroline().args(words).output().unwrap()
}

fn words(out: &Output) -> String {
    format!(
        "{}{}",
        String::from_utf8_lossy(&out.stdout),
        String::from_utf8_lossy(&out.stderr)
    )
}

/// Guesses a map, imports with it unchanged; the samples of motion that were written and what was said.
fn guessed(log: &Path, more: &[&str]) -> (usize, String) {
    let (map, out): (PathBuf, PathBuf) = (log.with_extension("map"), log.with_extension("run"));
    let log = log.to_str().unwrap();
    let mut line = vec!["import", "--guess", log];
    line.extend(more);
    let guess = run(&line);
    assert_eq!(guess.status.code(), Some(0), "{}", words(&guess));
    std::fs::write(&map, &guess.stdout).unwrap();
    let done = run(&[
        "import",
        log,
        "--map",
        map.to_str().unwrap(),
        "--out",
        out.to_str().unwrap(),
        "--json",
    ]);
    assert_eq!(
        done.status.code(),
        Some(0),
        "{}\n{}",
        String::from_utf8_lossy(&guess.stdout),
        words(&done)
    );
    let found: Value = serde_json::from_slice(&done.stdout).unwrap();
    let samples = found["samples"].as_u64().unwrap() as usize;
    std::fs::remove_file(&out).unwrap();
    (samples, words(&guess))
}

/// Bags that ROS 2 itself recorded, which do not come with the clone:
/// `HYDROLINE_BAGS=DIR cargo test --test recording bags_that_ros_recorded -- --ignored`.
#[test]
#[ignore = "needs recorded bags: HYDROLINE_BAGS=DIR"]
fn bags_that_ros_recorded_are_read_as_rosbags_reads_them() {
    let dir = made("recorded").expect("a Python with rosbags: tests/setup");
    let mut bags = 0;
    for entry in std::fs::read_dir(dir.path()).unwrap() {
        let log = entry.unwrap().path();
        if log.extension().is_none_or(|e| e != "mcap") {
            continue;
        }
        let recording = Recording::open(&log).unwrap().unwrap();
        let expected = expected(&log);
        for (topic, messages) in &expected {
            let own = recording.contents().topics.iter();
            let own = own.filter(|t| t.topic == *topic).map(|t| t.messages);
            assert_eq!(own.sum::<u64>(), messages.len() as u64, "{topic}");
        }
        let messages: usize = expected.values().map(Vec::len).sum();
        let compared = numbers(&log, 0);
        println!("{}: {messages} messages, {compared} numbers", log.display());
        bags += 1;
    }
    assert!(bags > 0, "rosbags could read none of the bags");
}

#[test]
fn ros2_bags_are_read_as_rosbags_reads_them() {
    let Some(dir) = made("ros2") else { return };
    for name in [
        "none.mcap",
        "lz4.mcap",
        "zstd.mcap",
        "bag_db3",
        "bag_db3_old",
        "bag_mcap",
        "bag_packed",
    ] {
        let log = dir.path().join(name);
        println!("{name}: {} numbers", compare(&log, 0));
        let (samples, said) = guessed(&log, &["--topic", "/odom"]);
        assert_eq!(samples, 150, "{said}");
        // Several topics: those of equal stamps share a row, a load without a stamp goes by the recording's clock.
        let (samples, said) = guessed(&log, &[]);
        assert!(samples >= 150, "{said}");
        assert!(said.contains("/cmd/surge"), "{said}");
    }
}

/// A map with the places of one body of an array, to a file.
fn map_of_body(dir: &Path, body: usize) -> PathBuf {
    let path = dir.join(format!("body_{body}.toml"));
    let mut map = "[time]\ncolumn = \"stamp\"\nunit = \"ns\"\nclock = \"unix\"\n".to_owned();
    for (place, axis) in [("x_m", "x"), ("y_m", "y"), ("z_m", "z")] {
        let column = format!("/markers.poses[{body}].position.{axis}");
        map +=
            &format!("[motion.{place}]\ncolumn = \"{column}\"\nunit = \"m\"\nmissing = \"skip\"\n");
    }
    std::fs::write(&path, map).unwrap();
    path
}

#[test]
fn bodies_of_an_array_are_taken_by_their_number() {
    let Some(dir) = made("ros2") else { return };
    let log = dir.path().join("zstd.mcap");
    let said = words(&run(&["info", log.to_str().unwrap()]));
    assert!(said.contains("poses[1].position.x"), "{said}");
    // A guessed map takes place and attitude of one body, the first.
    let (samples, said) = guessed(&log, &["--topic", "/markers"]);
    assert_eq!(samples, 150, "{said}");
    for word in ["poses[0].orientation.w", "poses[0] is taken, of up to 2"] {
        assert!(said.contains(word), "{word}: {said}");
    }
    assert!(!said.contains("poses[1]"), "{said}");
    // The second was not seen in every tenth message.
    for (body, samples) in [(0, 150), (1, 135)] {
        let map = map_of_body(dir.path(), body);
        let out = dir.path().join(format!("body_{body}.run"));
        let done = run(&[
            "import",
            log.to_str().unwrap(),
            "--map",
            map.to_str().unwrap(),
            "--out",
            out.to_str().unwrap(),
            "--json",
        ]);
        assert_eq!(done.status.code(), Some(0), "{}", words(&done));
        let found: Value = serde_json::from_slice(&done.stdout).unwrap();
        assert_eq!(found["samples"], samples, "body {body}: {found}");
    }
}

#[test]
fn logs_that_are_not_read_say_what_makes_one_that_is() {
    let dir = tempfile::tempdir().unwrap();
    let refuse = |log: &Path, expected: &[&str]| {
        let log = log.to_str().unwrap();
        for line in [&["info", log][..], &["import", "--guess", log]] {
            let said = run(line);
            assert_eq!(said.status.code(), Some(2), "{line:?}: {}", words(&said));
            for word in expected {
                assert!(words(&said).contains(word), "{word}: {}", words(&said));
            }
        }
    };
    let rerun = dir.path().join("run.rrd");
    std::fs::write(&rerun, b"RRF2\0\x18\0\0\0\0\0\0").unwrap();
    refuse(&rerun, &["run.rrd: it is a recording of Rerun", "table"]);
    let bag = dir.path().join("old.bag");
    std::fs::write(&bag, b"#ROSBAG V2.0\nE\0\0\0").unwrap();
    refuse(&bag, &["old.bag: it is a bag of ROS 1", "rosbags-convert"]);
    let Some(dir) = made("ros1") else { return };
    let convert = "rosbags-convert --src FILE.bag --dst FOLDER";
    refuse(&dir.path().join("old.bag"), &["a bag of ROS 1", convert]);
    let old = dir.path().join("old.mcap");
    let old = old.to_str().unwrap();
    for (line, code) in [
        (&["info", old][..], 0),
        (&["info", old, "--json"], 0),
        (&["import", "--guess", old], 2),
    ] {
        let said = run(line);
        assert_eq!(said.status.code(), Some(code), "{}", words(&said));
        for word in ["messages of ROS 1", convert] {
            assert!(words(&said).contains(word), "{word}: {}", words(&said));
        }
    }
    // The converted recording is imported.
    let (samples, said) = guessed(&dir.path().join("converted"), &[]);
    assert_eq!(samples, 150, "{said}");
}

/// Files of other programs: name, content, and the word that names each.
fn foreign_files() -> Vec<(&'static str, Vec<u8>, &'static str)> {
    // Bytes as packed ones are, of no format.
    let noise: Vec<u8> = (1..3000_u32)
        .map(|k| (k.wrapping_mul(2_654_435_761) >> 13) as u8)
        .collect();
    let with = |lead: &[u8]| [lead, &noise].concat();
    let mut hdf5 = with(b"MATLAB 7.3 MAT-file");
    hdf5.resize(4096, 0);
    vec![
        ("run.mat", with(b"MATLAB 5.0 MAT-file"), "MATLAB"),
        ("run73.mat", hdf5, "MATLAB"),
        (
            "run.xlsx",
            with(b"PK\x03\x04\x14\0xl/workbook.xml"),
            "spreadsheet",
        ),
        ("run.zip", with(b"PK\x03\x04\x14\0run.bin"), ".zip"),
        ("run.npz", with(b"PK\x03\x04\x14\0t.npy"), "NumPy"),
        ("run.parquet", with(b"PAR1"), "Parquet"),
        ("run.tdms", with(b"TDSm"), "TDMS"),
        ("run.mf4", with(b"MDF     4.10    "), "MDF"),
        ("run.h5", with(b"\x89HDF\r\n\x1a\n"), "HDF5"),
        ("run.ulge", with(b"ULogEnc\x01"), "encrypted"),
        ("run.mcap.gz", with(b"\x1f\x8b\x08\0"), "unpack"),
        ("run.json", b"[{\"t\": 0.0, \"x\": 1.5}]".to_vec(), "JSON"),
        ("run.html", b"<!DOCTYPE html><p>404".to_vec(), "HTML"),
        (
            "run.ulg",
            b"version https://git-lfs.github.com/spec/v1\noid sha256:4d\n".to_vec(),
            "Git LFS",
        ),
        (
            "run.log",
            b"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nATT, 1, 2\n".to_vec(),
            "DataFlash log as text",
        ),
        ("run.mcap", noise.clone(), "no kind that is known"),
    ]
}

#[test]
fn a_file_of_another_program_is_named_by_every_command_that_takes_a_log() {
    let dir = tempfile::tempdir().unwrap();
    let map = dir.path().join("map.toml");
    std::fs::write(
        &map,
        "[time]\ncolumn = \"t\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n",
    )
    .unwrap();
    let new = dir.path().join("new.mcap");
    let (map, new) = (map.to_str().unwrap(), new.to_str().unwrap());
    for (at, (name, bytes, word)) in foreign_files().into_iter().enumerate() {
        let path = dir.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let file = path.to_str().unwrap();
        let lines = [
            &["info", file][..],
            &["import", file, "--map", map, "--out", new],
            &["import", "--guess", file],
            &["identify", file, "--rig", "lshpi"],
            &["doctor", file],
            &["recover", file, "--out", new],
            &["export", file, "--out", new],
            &["diagnose", file, "--rig", "lshpi", "--time-limit", "none"],
            &["replay", file, "--out", new],
            &["join", file, file, "--out", new],
        ];
        // All of one, and two of each other.
        let rest = if at == 0 { lines.len() } else { 2 };
        for line in lines.iter().cycle().skip(at).take(rest) {
            let said = run(line);
            let words = words(&said);
            assert_eq!(said.status.code(), Some(2), "{line:?}: {words}");
            assert!(words.contains(word), "{line:?}: no '{word}' in: {words}");
            assert!(!words.contains('\u{fffd}'), "{line:?}: {words}");
            assert!(words.len() < 1500, "{line:?}: {words}");
        }
    }
}

#[test]
fn messages_with_their_schemas_are_read() {
    let Some(dir) = made("foxglove") else { return };
    let log = dir.path().join("foxglove.mcap");
    compare(&log, 0);
    let (samples, said) = guessed(&log, &[]);
    assert_eq!(samples, 150, "{said}");
}

#[test]
fn dataflash_is_read_as_pymavlink_reads_it_and_damage_is_counted() {
    let Some(dir) = made("dataflash") else { return };
    let (clean, damaged) = (dir.path().join("clean.bin"), dir.path().join("damaged.bin"));
    println!("{} numbers", compare(&clean, 0));
    assert_eq!(unreadable(&clean), 0);
    compare(&damaged, 0);
    // Two places in between, and the record that the file ends in.
    assert_eq!(unreadable(&damaged), 3);
    let (samples, said) = guessed(&clean, &[]);
    assert!(samples > 700, "{said}");
    assert_is_damaged(&damaged, "ATT.Roll", "deg");
}

#[test]
fn telemetry_is_read_as_pymavlink_reads_it_and_damage_is_counted() {
    let Some(dir) = made("telemetry") else { return };
    let (clean, damaged) = (
        dir.path().join("clean.tlog"),
        dir.path().join("damaged.tlog"),
    );
    println!("{} numbers", compare(&clean, 0));
    assert_eq!(unreadable(&clean), 0);
    compare(&damaged, 0);
    assert_eq!(unreadable(&damaged), 2);
    let (samples, said) = guessed(
        &clean,
        &["--topic", "ATTITUDE", "--topic", "LOCAL_POSITION_NED"],
    );
    assert!(samples >= 150, "{said}");
    assert_is_damaged(&damaged, "ATTITUDE.roll", "rad");
}

#[test]
fn ulog_is_read_as_pyulog_reads_it_and_damage_is_counted() {
    let Some(dir) = made("ulog") else { return };
    let (clean, damaged) = (dir.path().join("clean.ulg"), dir.path().join("damaged.ulg"));
    println!("{} numbers", compare(&clean, 0));
    assert_eq!(unreadable(&clean), 0);
    compare(&damaged, 0);
    assert_eq!(unreadable(&damaged), 1);
    let (samples, said) = guessed(&clean, &[]);
    assert!(samples >= 150, "{said}");
    assert_is_damaged(&damaged, "vehicle_local_position.x", "m");
}

/// Damage is a fault; what is sound comes in when it is accepted, with exit code 3.
fn assert_is_damaged(log: &Path, column: &str, unit: &str) {
    let place = if unit == "m" { "x_m" } else { "phi_rad" };
    let (map, out) = (log.with_extension("map"), log.with_extension("run"));
    std::fs::write(
        &map,
        format!("[time]\ncolumn = \"stamp\"\nunit = \"ns\"\n[motion.{place}]\ncolumn = \"{column}\"\nunit = \"{unit}\"\n"),
    )
    .unwrap();
    let line = [
        "import",
        log.to_str().unwrap(),
        "--map",
        map.to_str().unwrap(),
        "--out",
        out.to_str().unwrap(),
    ];
    let refused = run(&line);
    assert_eq!(refused.status.code(), Some(2), "{}", words(&refused));
    assert!(
        words(&refused).contains("damaged_records"),
        "{}",
        words(&refused)
    );
    let accepted = run(&[&line[..], &["--accept-faults"]].concat());
    assert_eq!(accepted.status.code(), Some(3), "{}", words(&accepted));
}

#[test]
fn info_lists_what_a_map_can_name() {
    let Some(dir) = made("ulog") else { return };
    let log = dir.path().join("clean.ulg");
    let said = run(&["info", log.to_str().unwrap()]);
    assert_eq!(said.status.code(), Some(0));
    for word in ["PX4", "vehicle_attitude[1]", "q[0]", "150 messages"] {
        assert!(words(&said).contains(word), "{word}: {}", words(&said));
    }
    let json = run(&["info", log.to_str().unwrap(), "--json"]);
    let found: Value = serde_json::from_slice(&json.stdout).unwrap();
    assert_eq!(found["topics"][0]["topic"], "vehicle_local_position");
    let wrong = run(&[
        "import",
        "--guess",
        log.to_str().unwrap(),
        "--topic",
        "vehicle_pose",
    ]);
    assert_eq!(wrong.status.code(), Some(2));
    assert!(words(&wrong).contains("name one of"), "{}", words(&wrong));
}
