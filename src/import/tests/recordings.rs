//! Bags of other programs that are damaged, undecodable in part, or not whole.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use mcap::records::MessageHeader;

use super::*;
use crate::recorded::{RecordedError, Recording};

const T0_NS: u64 = 1_760_000_000_000_000_000;
const STEP_NS: u64 = 40_000_000;
const POSE: &str = "geometry_msgs/msg/PoseStamped";
const DEFINITION: &str = "std_msgs/Header header\ngeometry_msgs/Pose pose\n";

fn x_of(k: usize) -> f64 {
    0.02 * k as f64
}

/// A pose with its stamp, at x; its bytes as CDR has them.
fn pose(k: usize) -> Vec<u8> {
    let ns = T0_NS + STEP_NS * k as u64;
    let mut b = vec![0, 1, 0, 0];
    b.extend(((ns / 1_000_000_000) as i32).to_le_bytes());
    b.extend(((ns % 1_000_000_000) as u32).to_le_bytes());
    b.extend(4u32.to_le_bytes());
    b.extend(b"tow\0");
    for v in [x_of(k), 0.1, -0.8, 0.0, 0.0, 0.0, 1.0] {
        b.extend(f64::to_le_bytes(v));
    }
    b
}

fn load(_: usize) -> Vec<u8> {
    let mut b = vec![0, 1, 0, 0];
    b.extend(3f64.to_le_bytes());
    b
}

/// A topic of a bag: its messages one every 40 ms.
struct Topic<'a> {
    name: &'a str,
    schema: (&'a str, &'a str, &'a [u8]),
    encoding: &'a str,
    message: &'a dyn Fn(usize) -> Vec<u8>,
}

fn poses<'a>(message: &'a dyn Fn(usize) -> Vec<u8>) -> Topic<'a> {
    Topic {
        name: "/pose",
        schema: (POSE, "ros2msg", DEFINITION.as_bytes()),
        encoding: "cdr",
        message,
    }
}

fn loads() -> Topic<'static> {
    Topic {
        name: "/cmd/surge",
        schema: ("std_msgs/msg/Float64", "ros2msg", b"float64 data\n"),
        encoding: "cdr",
        message: &load,
    }
}

fn mcap_bytes(
    options: mcap::WriteOptions,
    rows: std::ops::Range<usize>,
    topics: &[Topic<'_>],
) -> Vec<u8> {
    let mut writer = options.create(Cursor::new(Vec::new())).unwrap();
    let none = Default::default();
    let channels: Vec<u16> = topics
        .iter()
        .map(|t| {
            let schema = writer
                .add_schema(t.schema.0, t.schema.1, t.schema.2)
                .unwrap();
            writer
                .add_channel(schema, t.name, t.encoding, &none)
                .unwrap()
        })
        .collect();
    for k in rows {
        for (t, channel_id) in topics.iter().zip(&channels) {
            let time = T0_NS + STEP_NS * k as u64;
            let header = MessageHeader {
                channel_id: *channel_id,
                sequence: k as u32,
                log_time: time,
                publish_time: time,
            };
            writer
                .write_to_known_channel(&header, &(t.message)(k))
                .unwrap();
        }
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

fn chunked(chunk_bytes: u64) -> mcap::WriteOptions {
    mcap::WriteOptions::new()
        .chunk_size(Some(chunk_bytes))
        .compression(None)
}

fn db3(path: &Path, rows: usize, message: impl Fn(usize) -> Vec<u8>) {
    let bag = rusqlite::Connection::open(path).unwrap();
    bag.execute_batch("CREATE TABLE topics(id INTEGER PRIMARY KEY,name TEXT NOT NULL,type TEXT NOT NULL,serialization_format TEXT NOT NULL,offered_qos_profiles TEXT NOT NULL); CREATE TABLE messages(id INTEGER PRIMARY KEY,topic_id INTEGER NOT NULL,timestamp INTEGER NOT NULL,data BLOB NOT NULL); CREATE INDEX timestamp_idx ON messages(timestamp ASC); INSERT INTO topics VALUES(1,'/pose','geometry_msgs/msg/PoseStamped','cdr',''); INSERT INTO topics VALUES(2,'/cmd/surge','std_msgs/msg/Float64','cdr',''); BEGIN").unwrap();
    for k in 0..rows {
        for (topic, data) in [(2, load(k)), (1, message(k))] {
            bag.execute(
                "INSERT INTO messages(topic_id,timestamp,data) VALUES(?,?,?)",
                (topic, (T0_NS + STEP_NS * k as u64) as i64, data),
            )
            .unwrap();
        }
    }
    bag.execute_batch("COMMIT").unwrap();
}

/// A map of these fields, by when they were recorded.
fn map_of(x: Option<&str>, load: Option<&str>) -> Map {
    let mut text = "[time]\ncolumn = \"log_time\"\nunit = \"ns\"\nclock = \"unix\"\n".to_owned();
    if let Some(x) = x {
        text += &format!("[motion.x_m]\ncolumn = \"{x}\"\nunit = \"m\"\n");
    }
    if let Some(load) = load {
        text += &format!("[[command]]\nthruster = \"surge\"\ncolumn = \"{load}\"\nunit = \"N\"\n");
    }
    Map::from_toml(&text, "map.toml").unwrap()
}

fn both() -> Map {
    map_of(Some("/pose.pose.position.x"), Some("/cmd/surge.data"))
}

/// Findings about log and table, and the values of x that come through.
fn imported(path: &Path, map: &Map) -> (Vec<Finding>, Vec<f64>) {
    let recording = Recording::open(path).unwrap().unwrap();
    let table = recording.table(map).unwrap();
    let read = read_table(&table, &table.map, None).unwrap();
    let x: Vec<f64> = read.motion[0]
        .iter()
        .copied()
        .filter(|v| v.is_finite())
        .collect();
    let findings = table
        .findings
        .iter()
        .cloned()
        .chain(read.findings)
        .collect();
    (findings, x)
}

fn faults(findings: &[Finding]) -> Vec<(&'static str, &str)> {
    let faults = findings.iter().filter(|f| f.severity == Severity::Fault);
    faults.map(|f| (f.kind, f.message.as_str())).collect()
}

fn written(dir: &tempfile::TempDir, name: &str, bytes: &[u8]) -> PathBuf {
    let path = dir.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

#[test]
fn half_of_a_mapped_topic_that_cannot_be_decoded_is_a_fault() {
    let dir = tempfile::tempdir().unwrap();
    let cut = |k: usize| {
        let mut b = pose(k);
        if (50..150).contains(&k) {
            b.truncate(b.len() - 20);
        }
        b
    };
    let bytes = mcap_bytes(chunked(5000), 0..200, &[loads(), poses(&cut)]);
    let files = [written(&dir, "a.mcap", &bytes), dir.path().join("a.db3")];
    db3(&files[1], 200, cut);
    for file in files {
        let (findings, x) = imported(&file, &both());
        assert_eq!(x.len(), 100);
        let [("not_decoded", words)] = faults(&findings)[..] else {
            panic!("{findings:?}");
        };
        assert!(words.contains("/pose: 100 of 200 messages"), "{words}");
        let contents = Recording::open(&file)
            .unwrap()
            .unwrap()
            .contents()
            .to_string();
        assert!(
            contents.contains("200 messages, 100 OF THEM NOT READ"),
            "{contents}"
        );
        // What nobody asked for is a remark.
        let (findings, _) = imported(&file, &map_of(None, Some("/cmd/surge.data")));
        assert_eq!(faults(&findings), [], "{findings:?}");
        assert!(findings.iter().any(|f| f.kind == "not_decoded"));
    }
}

#[test]
fn one_undecodable_transform_list_is_a_fault_of_the_child_that_is_mapped() {
    let dir = tempfile::tempdir().unwrap();
    let transforms = |k: usize| {
        let mut b = vec![0, 1, 0, 0];
        b.extend(1u32.to_le_bytes());
        b.extend(&pose(k)[4..20]);
        b.extend(4u32.to_le_bytes());
        b.extend(b"auv\0");
        b.extend([0; 4]);
        b.extend(&pose(k)[20..]);
        b.truncate(if k == 7 { 30 } else { b.len() });
        b
    };
    let topic = Topic {
        name: "/tf",
        schema: ("tf2_msgs/msg/TFMessage", "ros2msg", b""),
        encoding: "cdr",
        message: &transforms,
    };
    let file = written(&dir, "a.mcap", &mcap_bytes(chunked(5000), 0..50, &[topic]));
    let (findings, x) = imported(
        &file,
        &map_of(Some("/tf[auv].transform.translation.x"), None),
    );
    assert_eq!(x.len(), 49, "{findings:?}");
    let [("not_decoded", words)] = faults(&findings)[..] else {
        panic!("{findings:?}");
    };
    assert!(words.contains("/tf: 1 of 50"), "{words}");
}

#[test]
fn json_messages_with_nan_are_a_fault_where_the_nan_is_mapped() {
    let dir = tempfile::tempdir().unwrap();
    let json = |k: usize| {
        let x = if k % 10 == 3 {
            "NaN".to_owned()
        } else {
            x_of(k).to_string()
        };
        format!("{{\"x\": {x}, \"y\": {}, \"note\": \"NaN\"}}", 0.1).into_bytes()
    };
    let topic = Topic {
        name: "/place",
        schema: ("place", "jsonschema", b"{}"),
        encoding: "json",
        message: &json,
    };
    let file = written(&dir, "a.mcap", &mcap_bytes(chunked(5000), 0..200, &[topic]));
    let (findings, x) = imported(&file, &map_of(Some("/place.x"), None));
    assert_eq!(x.len(), 180);
    let found = faults(&findings);
    assert!(matches!(found[..], [("nan", _)]), "{found:?}");
    let contents = Recording::open(&file)
        .unwrap()
        .unwrap()
        .contents()
        .to_string();
    assert!(
        contents.contains("NaN or infinite: x in 20 messages"),
        "{contents}"
    );
    let (findings, y) = imported(&file, &map_of(Some("/place.y"), None));
    assert!(
        !faults(&findings).iter().any(|f| f.0 == "nan"),
        "{findings:?}"
    );
    assert_eq!(y.len(), 200);
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

/// Damage by name.
type Case<'a> = (&'a str, &'a dyn Fn(&mut Vec<u8>));

#[test]
fn reading_stopped_at_the_first_damaged_record_of_an_mcap() {
    let dir = tempfile::tempdir().unwrap();
    let kinds: [(&str, mcap::WriteOptions); 4] = [
        ("plain", chunked(5000)),
        (
            "zstd",
            chunked(5000).compression(Some(mcap::Compression::Zstd)),
        ),
        (
            "without checksums",
            chunked(5000).calculate_chunk_crcs(false),
        ),
        (
            "without chunks",
            mcap::WriteOptions::new().use_chunks(false),
        ),
    ];
    for (name, options) in kinds {
        let whole = mcap_bytes(options, 0..400, &[loads(), poses(&pose)]);
        let own = if name == "without chunks" { 5 } else { 6 };
        let places = records(&whole, own);
        assert!(places.len() > 5, "{name}");
        // The first chunk holds the declarations of all. Messages stand in turn: the odd ones are poses.
        let hit: &[usize] = if own == 6 {
            &[0, places.len() / 2]
        } else {
            &[401]
        };
        for nth in hit {
            let (start, end) = places[*nth];
            let zeros = |bytes: &mut Vec<u8>, from: usize, to: usize| bytes[from..to].fill(0);
            let cases: [Case<'_>; 4] = [
                ("zeroed", &|b| zeros(b, start, end)),
                ("zeroed, and some before and behind", &|b| {
                    zeros(b, start + 3, end + 17)
                }),
                ("a length beyond the file", &|b| b[start + 6] = 0x7f),
                ("a length that is a little wrong", &|b| b[start + 1] ^= 0x15),
            ];
            for (case, damage) in cases {
                let mut bytes = whole.clone();
                damage(&mut bytes);
                let file = written(&dir, "a.mcap", &bytes);
                let (findings, x) = imported(&file, &both());
                let place = format!("{name}, {nth}, {case}");
                // Of one record and, where it went over the border, of its neighbour.
                let (chunks, per) = if own == 6 {
                    (2, 400 / places.len() + 3)
                } else {
                    (4, 1)
                };
                assert!(x.len() >= 400 - chunks * per, "{place}: {} rows", x.len());
                assert!(x.len() < 400 || case.starts_with("a length"), "{place}");
                let known = |v: &f64| (0..400).any(|k| x_of(k) == *v);
                assert!(
                    x.iter().all(known),
                    "{place}: numbers that were never written"
                );
                let found = faults(&findings);
                assert!(
                    found.iter().any(|f| f.0 == "damaged_records"),
                    "{place}: {found:?}"
                );
            }
        }
    }
}

#[test]
fn a_part_of_a_bag_that_is_missing_or_short_passed() {
    let dir = tempfile::tempdir().unwrap();
    let part = |n: usize| {
        let bytes = mcap_bytes(chunked(5000), 50 * n..50 * n + 50, &[loads(), poses(&pose)]);
        written(&dir, &format!("run_{n}.mcap"), &bytes)
    };
    let parts: Vec<PathBuf> = (0..4).map(part).collect();
    let account = |count: u64| {
        format!(
            "rosbag2_bagfile_information:\n  version: 9\n  message_count: {count}\n  relative_file_paths:\n    - run_0.mcap\n    - run_1.mcap\n    - run_2.mcap\n    - run_3.mcap\n"
        )
    };
    let metadata = written(&dir, "metadata.yaml", account(400).as_bytes());
    let (findings, x) = imported(dir.path(), &both());
    assert_eq!(
        (faults(&findings), x.len()),
        (Vec::new(), 200),
        "{findings:?}"
    );
    written(&dir, "metadata.yaml", account(2500).as_bytes());
    let (findings, x) = imported(dir.path(), &both());
    let [("missing_messages", words)] = faults(&findings)[..] else {
        panic!("{findings:?}");
    };
    assert!(
        words.contains("counts 2500 messages, 400 are there"),
        "{words}"
    );
    assert_eq!(x.len(), 200);
    written(&dir, "metadata.yaml", account(400).as_bytes());
    std::fs::remove_file(&parts[2]).unwrap();
    let missing = |words: &str| {
        let (findings, x) = imported(dir.path(), &both());
        let found = faults(&findings);
        let [("missing_parts", said)] = found[..] else {
            panic!("{findings:?}");
        };
        assert!(said.contains(words), "{said}");
        assert_eq!(x.len(), 150);
    };
    missing("run_2.mcap, and 100 messages with them");
    std::fs::remove_file(metadata).unwrap();
    missing("part(s) 2 are not in the folder");
    // Empty, as a recorder that was killed leaves its last part.
    written(&dir, "run_2.mcap", b"");
    let (findings, x) = imported(dir.path(), &both());
    let [("damaged_records", words)] = faults(&findings)[..] else {
        panic!("{findings:?}");
    };
    assert!(words.contains("run_2.mcap"), "{words}");
    assert_eq!(x.len(), 150);
    for part in parts {
        std::fs::remove_file(part).unwrap();
    }
    written(&dir, "metadata.yaml", account(400).as_bytes());
    let error = Recording::open(dir.path()).unwrap_err();
    assert!(matches!(error, RecordedError::NoParts { .. }), "{error}");
    assert!(
        error.to_string().contains("run_0.mcap, run_1.mcap"),
        "{error}"
    );
}

#[test]
fn an_empty_schema_of_a_known_type_left_a_topic_without_fields_and_a_list_of_nothing_to_name() {
    let dir = tempfile::tempdir().unwrap();
    for (encoding, text) in [
        ("ros2msg", ""),
        ("", ""),
        ("ros2idl", "module x {};"),
        ("ros2msg", "Banana b"),
    ] {
        let topic = Topic {
            schema: (POSE, encoding, text.as_bytes()),
            ..poses(&pose)
        };
        let file = written(&dir, "a.mcap", &mcap_bytes(chunked(5000), 0..50, &[topic]));
        let (findings, x) = imported(&file, &map_of(Some("/pose.pose.position.x"), None));
        assert_eq!(
            (faults(&findings), x.len()),
            (Vec::new(), 50),
            "{findings:?}"
        );
    }
    // Of a type that is not known there is nothing to name, and why.
    let unknown = |text: &'static str| Topic {
        schema: ("my_msgs/msg/Place", "ros2msg", text.as_bytes()),
        ..poses(&pose)
    };
    let bytes = mcap_bytes(chunked(5000), 0..50, &[loads(), unknown("")]);
    let file = written(&dir, "a.mcap", &bytes);
    let (findings, _) = imported(
        &file,
        &map_of(Some("/pose.pose.position.x"), Some("/cmd/surge.data")),
    );
    let missing = findings
        .iter()
        .find(|f| f.kind == "column_missing")
        .unwrap();
    assert!(
        missing.message.contains("definition in the log is empty"),
        "{missing:?}"
    );
    let text = |k: usize| {
        let mut b = vec![0, 1, 0, 0];
        b.extend(2u32.to_le_bytes());
        b.extend([b'0' + (k % 10) as u8, 0]);
        b
    };
    let texts = Topic {
        name: "/note",
        schema: ("std_msgs/msg/String", "ros2msg", b"string data\n"),
        encoding: "cdr",
        message: &text,
    };
    let file = written(&dir, "a.mcap", &mcap_bytes(chunked(5000), 0..50, &[texts]));
    for column in ["/note.data", "x", "/pose.x"] {
        let (findings, _) = imported(&file, &map_of(Some(column), None));
        let missing = findings
            .iter()
            .find(|f| f.kind == "column_missing")
            .unwrap();
        let words = &missing.message;
        assert!(
            !words.contains("name one of: ") && !words.contains("such as ;"),
            "{words}"
        );
        assert!(words.contains("no topic of it holds numbers"), "{words}");
    }
    let open = Recording::open(&file).unwrap().unwrap();
    let error = open
        .with_topics(&["/pose".to_owned()])
        .unwrap_err()
        .to_string();
    assert!(
        error.ends_with("no topic of it holds numbers that a map could name"),
        "{error}"
    );
}

#[test]
fn foxgloves_own_messages_are_known_without_their_schema() {
    let dir = tempfile::tempdir().unwrap();
    // foxglove.Point3: x in field 1.
    let point = |k: usize| [&[9][..], &x_of(k + 1).to_le_bytes()].concat();
    let topic = Topic {
        name: "/point",
        schema: ("foxglove.Point3", "protobuf", b""),
        encoding: "protobuf",
        message: &point,
    };
    let file = written(&dir, "a.mcap", &mcap_bytes(chunked(5000), 0..50, &[topic]));
    let (findings, x) = imported(&file, &map_of(Some("/point.x"), None));
    assert_eq!(
        (faults(&findings), x.len()),
        (Vec::new(), 50),
        "{findings:?}"
    );
}

#[test]
fn a_bag_in_sqlite_that_is_cut_gives_the_rows_that_are_there() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.db3");
    db3(&path, 3000, pose);
    let whole = std::fs::read(&path).unwrap();
    assert_eq!(imported(&path, &both()).1.len(), 3000);
    let mut before = 0;
    for tenths in [2, 5, 9] {
        let cut = written(&dir, "cut.db3", &whole[..whole.len() * tenths / 10 + 123]);
        let (findings, x) = imported(&cut, &both());
        let [("damaged_records", words)] = faults(&findings)[..] else {
            panic!("{findings:?}");
        };
        assert!(words.contains("`sqlite3 FILE .recover"), "{words}");
        // Pages of the index lie between those of the rows.
        assert!(
            x.len() > before && x.len() * 10 > 3000 * tenths * 8 / 10,
            "{tenths}: {}",
            x.len()
        );
        assert!(x.iter().enumerate().all(|(k, v)| *v == x_of(k)));
        before = x.len();
    }
    // A page in the middle of the rows costs only itself.
    let mut bytes = whole.clone();
    let page = bytes.len() / 2 / 4096 * 4096;
    bytes[page..page + 4096].fill(0);
    let (_, x) = imported(&written(&dir, "wiped.db3", &bytes), &both());
    assert!(x.len() > 2900, "{}", x.len());
    // Nothing is left of its first page's tables.
    let error = Recording::open(&written(&dir, "first.db3", &whole[..4096])).unwrap_err();
    assert!(
        error.to_string().contains("sqlite3 BAG.db3 .recover"),
        "{error}"
    );
}

#[test]
fn parts_that_are_packed_otherwise_than_rosbag2_packs_them_were_left_out_of_a_folder() {
    use std::io::Write;
    let dir = tempfile::tempdir().unwrap();
    let bytes = |n: usize| mcap_bytes(chunked(5000), 50 * n..50 * n + 50, &[loads(), poses(&pose)]);
    let zstd = |n: usize| zstd::bulk::compress(&bytes(n), 1).unwrap();
    let gzip = |n: usize| {
        let mut packer = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        packer.write_all(&bytes(n)).unwrap();
        packer.finish().unwrap()
    };
    written(&dir, "run_0.mcap", &bytes(0));
    written(&dir, "run_1.mcap.zst", &zstd(1));
    written(&dir, "run_2.mcap.gz", &gzip(2));
    written(&dir, "run_3.mcap.zstd", &zstd(3));
    // A player left the unpacked file beside the packed one.
    written(&dir, "run_3.mcap", &bytes(3));
    for account in [false, true] {
        if account {
            let text = "rosbag2_bagfile_information:\n  message_count: 400\n  relative_file_paths:\n    - run_0.mcap\n    - run_1.mcap.zstd\n    - run_2.mcap\n    - run_3.mcap.zstd\n";
            written(&dir, "metadata.yaml", text.as_bytes());
        }
        let (findings, x) = imported(dir.path(), &both());
        let all: Vec<f64> = (0..200).map(x_of).collect();
        assert_eq!((faults(&findings), x), (Vec::new(), all), "{findings:?}");
    }
}

#[test]
fn a_pipe_named_as_a_bags_account_was_waited_for() {
    let dir = tempfile::tempdir().unwrap();
    let bytes = mcap_bytes(chunked(5000), 0..50, &[loads(), poses(&pose)]);
    let file = written(&dir, "run_0.mcap", &bytes);
    let pipe = dir.path().join("metadata.yaml");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status();
    assert!(made.unwrap().success());
    let (send, receive) = std::sync::mpsc::channel();
    let folder = dir.path().to_owned();
    // Whoever waits for the pipe waits in this thread.
    std::thread::spawn(move || {
        let rows = imported(&file, &both()).1.len();
        let error = Recording::open(&folder).unwrap_err().to_string();
        send.send((rows, error)).unwrap();
    });
    let waited = std::time::Duration::from_secs(20);
    let (rows, error) = receive.recv_timeout(waited).unwrap();
    assert_eq!(rows, 50);
    assert!(
        error.contains("metadata.yaml") && error.contains("a pipe"),
        "{error}"
    );
}

#[test]
fn damaged_jpegs_of_a_bag_whose_messages_are_packed_one_by_one_were_not_seen() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.db3");
    db3(&path, 20, pose);
    let bag = rusqlite::Connection::open(&path).unwrap();
    bag.execute_batch("INSERT INTO topics VALUES(3,'/camera','sensor_msgs/msg/CompressedImage','cdr',''); CREATE TABLE message_definitions(topic_type TEXT,encoding TEXT,encoded_message_definition TEXT)").unwrap();
    let definition = "std_msgs/Header header\nstring format\nuint8[] data\n";
    bag.execute(
        "INSERT INTO message_definitions VALUES('sensor_msgs/msg/CompressedImage','ros2msg',?)",
        [definition],
    )
    .unwrap();
    // A JPEG of which only the beginning is there, behind stamp, frame and format.
    let image = |k: usize| {
        let mut b = pose(k)[..20].to_vec();
        b.extend(5u32.to_le_bytes());
        b.extend(b"jpeg\0\0\0\0");
        b.extend(4u32.to_le_bytes());
        b.extend(b"\xff\xd8\xff\xdb");
        b
    };
    let mut insert = bag
        .prepare("INSERT INTO messages(topic_id,timestamp,data) VALUES(3,?,?)")
        .unwrap();
    for k in 0..20 {
        let packed = zstd::bulk::compress(&image(k), 1).unwrap();
        // Two that do not unpack.
        let packed = if k < 18 { &packed[..] } else { &packed[..9] };
        insert
            .execute(((T0_NS + STEP_NS * k as u64) as i64, packed))
            .unwrap();
    }
    drop(insert);
    drop(bag);
    let recording = Recording::open(&path).unwrap().unwrap();
    let unreadable = &recording.contents().unreadable;
    let of = |what: &str| unreadable.iter().find(|u| u.what == what).map(|u| u.count);
    assert_eq!(of("images of /camera"), Some(18), "{unreadable:?}");
    assert_eq!(of("messages of /camera"), Some(2), "{unreadable:?}");
    let (findings, x) = imported(&path, &both());
    assert_eq!((faults(&findings), x.len()), (Vec::new(), 20));
    assert!(
        findings.iter().any(|f| f.kind == "damaged_images"),
        "{findings:?}"
    );
}
