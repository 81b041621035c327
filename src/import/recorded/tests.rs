//! Logs of autopilots as reports have them, made here byte by byte.

use std::io::Write;
use std::path::PathBuf;

use super::*;
use crate::check::Severity;
use crate::table::Imported;

const ROWS: usize = 200;

fn x_m(k: usize) -> f32 {
    0.3 * (0.05 * k as f32).sin()
}

/// A file in a folder of its own.
fn file(name: &str, bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    (dir, path)
}

fn map(column: &str, time: &str) -> Map {
    let text = format!(
        "[time]\ncolumn = \"stamp\"\nunit = \"ns\"\n{time}[motion.x_m]\ncolumn = \"{column}\"\nunit = \"m\"\n"
    );
    Map::from_toml(&text, "map.toml").unwrap()
}

/// The table of a log, with all that was found.
fn table(bytes: &[u8], map: &Map) -> Result<Imported, RecordedError> {
    let (_dir, path) = file("log", bytes);
    let mut table = Recording::open(&path)?.unwrap().table(map)?;
    let findings = std::mem::take(&mut table.findings);
    let mut data = crate::read_table(&table, &table.map, None)?;
    data.findings.splice(0..0, findings);
    Ok(data)
}

fn faults(data: &Imported) -> Vec<&str> {
    let faults = data.findings.iter();
    faults
        .filter(|f| f.severity == Severity::Fault)
        .map(|f| f.kind)
        .collect()
}

fn finding<'a>(data: &'a Imported, kind: &str) -> &'a str {
    let found = data.findings.iter().find(|f| f.kind == kind);
    found.map_or("", |f| &f.message)
}

fn ulog_record(kind: u8, body: &[u8]) -> Vec<u8> {
    let length = u16::try_from(body.len()).unwrap().to_le_bytes();
    [&length[..], &[kind], body].concat()
}

/// A ULog with these incompatible flags, stamps \[us\], and bytes of data behind the stamp and x.
fn ulog(flags: u8, stamps_us: &[u64], cut: usize) -> Vec<u8> {
    let mut all = b"ULog\x01\x12\x35\x01\0\0\0\0\0\0\0\0".to_vec();
    let mut own = [0; 40];
    own[8] = flags;
    all.extend(ulog_record(b'B', &own));
    all.extend(ulog_record(
        b'F',
        b"vehicle_local_position:uint64_t timestamp;float x;float y;",
    ));
    all.extend(ulog_record(b'A', b"\0\0\0vehicle_local_position"));
    for (k, us) in stamps_us.iter().enumerate() {
        let mut body = [
            &[0, 0][..],
            &us.to_le_bytes(),
            &x_m(k).to_le_bytes(),
            &[0; 4],
        ]
        .concat();
        body.truncate(body.len() - cut);
        all.extend(ulog_record(b'D', &body));
    }
    all
}

fn stamps_us(from_us: u64, rows: usize) -> Vec<u64> {
    (0..rows as u64).map(|k| from_us + 40_000 * k).collect()
}

#[test]
fn a_ulog_with_incompatible_flags_that_are_not_known_is_refused() {
    let map = map("vehicle_local_position.x", "");
    let stamps = stamps_us(61_000_000, ROWS);
    for known in [0, 1] {
        let data = table(&ulog(known, &stamps, 0), &map).unwrap();
        assert_eq!((data.times_s.len(), faults(&data)), (ROWS, vec![]));
    }
    for unknown in [2, 3, 0x80] {
        let error = table(&ulog(unknown, &stamps, 0), &map).unwrap_err();
        let words = error.to_string();
        assert!(words.contains(&format!("{unknown:#x}")), "{words}");
        assert!(
            words.contains("0x1 are known") && words.contains("ulog2csv"),
            "{words}"
        );
    }
}

#[test]
fn bytes_behind_damage_that_look_like_flags_refused_the_whole_ulog() {
    let map = map("vehicle_local_position.x", "");
    let whole = ulog(0, &stamps_us(61_000_000, ROWS), 0);
    // Behind the rows 0 .. 149.
    let at = whole.len() - 50 * ulog_record(b'D', &[0; 18]).len();
    let chance = [&[0; 30][..], &ulog_record(b'B', &[0xff; 40])].concat();
    let damaged = [&whole[..at], &chance, &whole[at..]].concat();
    let data = table(&damaged, &map).unwrap();
    assert_eq!(
        (data.times_s.len(), faults(&data)),
        (ROWS, vec!["damaged_records"])
    );
}

#[test]
fn data_of_a_ulog_that_are_shorter_than_their_format_are_said() {
    let map = map("vehicle_local_position.x", "");
    let stamps = stamps_us(61_000_000, ROWS);
    let error = table(&ulog(0, &stamps, 4), &map).unwrap_err().to_string();
    assert!(error.contains("200 message(s)"), "{error}");
    assert!(error.contains("have 12 bytes, 16 by its format"), "{error}");
    assert!(!error.contains("recover"), "{error}");
    // Some of them: the others are read.
    let whole = ulog(0, &stamps, 0);
    let short = ulog_record(b'D', &[0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9]);
    let data = table(&[&whole[..], &short, &short].concat(), &map).unwrap();
    assert_eq!(faults(&data), ["damaged_records"]);
    let words = finding(&data, "damaged_records");
    assert!(
        words.contains("2 not read") && words.contains("9 bytes"),
        "{words}"
    );
    assert_eq!(data.times_s.len(), ROWS);
}

#[test]
fn a_stamp_of_zero_that_was_never_set_is_no_beginning() {
    let map = map("vehicle_local_position.x", "");
    for (name, zeros) in [
        ("at the start", 0..5),
        ("one at the start", 0..1),
        ("between", 100..102),
    ] {
        let mut stamps = stamps_us(61_000_000, ROWS);
        stamps[zeros.clone()].fill(0);
        let data = table(&ulog(0, &stamps, 0), &map).unwrap();
        assert_eq!(faults(&data), ["zero_stamps"], "{name}");
        let words = finding(&data, "zero_stamps");
        let count = format!("{} message(s) have the stamp 0", zeros.len());
        assert!(words.contains(&count), "{name}: {words}");
        assert_eq!(data.times_s.len(), ROWS - zeros.len(), "{name}");
    }
    // A clock that begins at 0 is one.
    let data = table(&ulog(0, &stamps_us(0, ROWS), 0), &map).unwrap();
    assert_eq!((data.times_s.len(), faults(&data)), (ROWS, vec![]));
}

#[test]
fn advice_for_a_damaged_log_is_that_of_its_kind() {
    let map = map("vehicle_local_position.x", "");
    let noise = [&ulog(0, &[], 0)[..16], &[0xff; 400]].concat();
    let error = table(&noise, &map).unwrap_err().to_string();
    assert!(
        error.contains("fetch it anew") && !error.contains("recover"),
        "{error}"
    );
    assert!(Kind::Mcap.mending().contains("hydroline recover"));
    assert!(Kind::Db3.mending().contains("sqlite3 FILE .recover"));
}

/// A LOCAL_POSITION_NED behind its stamp.
fn packet(time_us: u64, boot_ms: u32, k: usize) -> Vec<u8> {
    let values = [x_m(k), 0.0, 0.0, 0.0, 0.0, 1.0];
    let floats: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    let payload = [&boot_ms.to_le_bytes()[..], &floats].concat();
    let length = u8::try_from(payload.len()).unwrap();
    let head = [length, 0, 0, (k % 256) as u8, 1, 1, 32, 0, 0];
    let crc = crc::Crc::<u16>::new(&crc::CRC_16_MCRF4XX);
    let sum = crc.checksum(&[&head[..], &payload, &[185]].concat());
    [
        &time_us.to_be_bytes()[..],
        &[0xfd],
        &head,
        &payload,
        &sum.to_le_bytes(),
    ]
    .concat()
}

fn telemetry(from_us: u64, boot_ms: u32, rows: usize) -> Vec<u8> {
    (0..rows)
        .flat_map(|k| packet(from_us + 40_000 * k as u64, boot_ms + 40 * k as u32, k))
        .collect()
}

#[test]
fn telemetry_of_a_computer_without_a_clock_is_read() {
    let map = map("LOCAL_POSITION_NED.x", "");
    let expected = table(&telemetry(1_700_000_000_000_000, 30_000, ROWS), &map).unwrap();
    assert_eq!((expected.times_s.len(), faults(&expected)), (ROWS, vec![]));
    // From 1970 on; and NTP set the clock in the middle.
    let half = ROWS / 2;
    let set = [
        telemetry(45_000_000, 30_000, ROWS)[..half * packet(0, 0, 0).len()].to_vec(),
        telemetry(1_700_000_000_000_000, 30_000, ROWS)[half * packet(0, 0, 0).len()..].to_vec(),
    ];
    for bytes in [telemetry(45_000_000, 30_000, ROWS), set.concat()] {
        let data = table(&bytes, &map).unwrap();
        assert_eq!(
            (&data.times_s, &data.motion),
            (&expected.times_s, &expected.motion)
        );
        assert_eq!(faults(&data), Vec::<&str>::new());
    }
}

fn dataflash_format(kind: u8, bytes: u8, name: &str, letters: &str, labels: &str) -> Vec<u8> {
    let mut record = vec![0xa3, 0x95, 0x80, kind, bytes];
    for (text, length) in [(name, 4), (letters, 16), (labels, 64)] {
        let end = record.len() + length;
        record.extend_from_slice(text.as_bytes());
        record.resize(end, 0);
    }
    record
}

/// Formats of two types, their numbers from `first` on.
fn dataflash_formats(first: u8) -> Vec<u8> {
    [
        dataflash_format(0x80, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns"),
        dataflash_format(first, 15, "POS", "Qf", "TimeUS,X"),
        dataflash_format(first + 1, 15, "ATT", "Qf", "TimeUS,Roll"),
    ]
    .concat()
}

fn dataflash_rows(first: u8, from_us: u64, rows: usize) -> Vec<u8> {
    (0..rows)
        .flat_map(|k| {
            let us = from_us + 40_000 * k as u64;
            let record = |kind: u8, us: u64, value: f32| {
                [
                    &[0xa3, 0x95, kind][..],
                    &us.to_le_bytes(),
                    &value.to_le_bytes(),
                ]
                .concat()
            };
            [
                record(first, us, x_m(k)),
                record(first + 1, us + 300, 10.0 * x_m(k)),
            ]
            .concat()
        })
        .collect()
}

#[test]
fn dataflash_is_read_whatever_its_first_record_is() {
    let map = map("POS.X", "");
    let formats = dataflash_formats(20);
    let rows = dataflash_rows(20, 61_000_000, ROWS);
    let record = rows[..15].to_vec();
    let expected = table(&[&formats[..], &rows].concat(), &map).unwrap();
    assert_eq!((expected.times_s.len(), faults(&expected)), (ROWS, vec![]));
    // Space that was never written; the format of formats not first; records before any format.
    let second = [&formats[89..178], &formats[..89], &formats[178..]].concat();
    for bytes in [
        [&[0; 512][..], &formats, &rows].concat(),
        [&second[..], &rows].concat(),
        [&record[..], &formats, &rows[15..]].concat(),
    ] {
        let data = table(&bytes, &map).unwrap();
        assert_eq!(
            (&data.times_s, &data.motion),
            (&expected.times_s, &expected.motion)
        );
        assert_eq!(faults(&data), Vec::<&str>::new());
    }
    // Other bytes are a loss: what they were nobody knows.
    let data = table(&[&[7; 300][..], &formats, &rows].concat(), &map).unwrap();
    assert_eq!(
        (data.times_s.len(), faults(&data)),
        (ROWS, vec!["damaged_records"])
    );
}

#[test]
fn what_is_packed_with_gzip_is_read_as_it_is_without() {
    let packed = |bytes: &[u8]| {
        let mut packer = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        packer.write_all(bytes).unwrap();
        packer.finish().unwrap()
    };
    let own = map("vehicle_local_position.x", "");
    let bytes = ulog(0, &stamps_us(61_000_000, ROWS), 0);
    let (plain, unpacked) = (
        table(&bytes, &own).unwrap(),
        table(&packed(&bytes), &own).unwrap(),
    );
    assert_eq!(plain, unpacked);
    let csv = b"t,x\n0,0.1\n1,0.2\n2,0.3\n3,0.4\n";
    let (_dir, path) = file("t.csv.gz", &packed(csv));
    assert!(Recording::open(&path).unwrap().is_none());
    let mut text = Vec::new();
    let source = crate::TableFile::open(&path).unwrap();
    source.open().unwrap().read_to_end(&mut text).unwrap();
    assert_eq!(text, csv);
    assert_eq!(source.foreign().unwrap(), None);
    // What is packed is named, not the packing.
    let (_dir, path) = file("run.csv", &packed(b"PAR1\x15\x04 and more"));
    let error = Recording::open(&path).unwrap_err().to_string();
    assert!(
        error.contains("Parquet") && error.contains("to_csv"),
        "{error}"
    );
}

#[test]
fn an_autopilot_that_restarted_is_two_runs_of_which_the_map_takes_one() {
    let second = ROWS - 50;
    let tlog = [
        telemetry(1_700_000_000_000_000, 60_000, ROWS),
        telemetry(1_700_000_100_000_000, 30_000, second),
    ];
    // Types have other numbers in the second log.
    let bin = [
        dataflash_formats(20),
        dataflash_rows(20, 61_000_000, ROWS),
        dataflash_formats(70),
        dataflash_rows(70, 30_000_000, second),
    ];
    for (bytes, column) in [
        (tlog.concat(), "LOCAL_POSITION_NED.x"),
        (bin.concat(), "POS.X"),
    ] {
        let none = table(&bytes, &map(column, "")).unwrap();
        assert_eq!(
            faults(&none),
            ["restarted"],
            "{column}: {:?}",
            none.findings
        );
        let words = finding(&none, "restarted");
        assert!(
            words.contains("two runs") && words.contains("boot = 2 takes the second"),
            "{words}"
        );
        assert_eq!(
            (none.times_s.len(), none.lost_rows),
            (ROWS, second),
            "{column}"
        );
        for (boot, rows) in [(1, ROWS), (2, second)] {
            let data = table(&bytes, &map(column, &format!("boot = {boot}\n"))).unwrap();
            assert_eq!(
                (faults(&data), data.lost_rows),
                (vec![], 0),
                "{column}: {:?}",
                data.findings
            );
            assert_eq!(data.times_s.len(), rows, "{column} {boot}");
            assert!((data.times_s[10] - 0.4).abs() < 1e-9);
            assert!((data.motion[0][7] - f64::from(x_m(7))).abs() < 1e-12);
        }
        let third = table(&bytes, &map(column, "boot = 3\n")).unwrap();
        assert!(
            finding(&third, "boot").contains("1 .. 2"),
            "{:?}",
            third.findings
        );
    }
}

#[test]
fn topics_of_two_runs_do_not_mingle() {
    let bin = [
        dataflash_formats(20),
        dataflash_rows(20, 61_000_000, ROWS),
        dataflash_formats(20),
        dataflash_rows(20, 30_000_000, ROWS),
    ];
    for boot in [1, 2] {
        let text = format!(
            "[time]\ncolumn = \"stamp\"\nunit = \"ns\"\nboot = {boot}\n[motion.x_m]\ncolumn = \"POS.X\"\nunit = \"m\"\n[motion.phi_rad]\ncolumn = \"ATT.Roll\"\nunit = \"deg\"\n"
        );
        let data = table(&bin.concat(), &Map::from_toml(&text, "map").unwrap()).unwrap();
        assert_eq!(faults(&data), Vec::<&str>::new(), "{:?}", data.findings);
        assert_eq!(data.times_s.len(), 2 * ROWS);
        assert!(data.times_s.is_sorted());
    }
}

#[test]
fn a_run_is_chosen_of_counters_only() {
    for (time, is_fine) in [
        ("unit = \"s\"\nboot = 2\n", true),
        ("rate_hz = 100\nboot = 2\n", true),
        ("unit = \"s\"\nboot = 0\n", false),
        ("unit = \"s\"\nclock = \"unix\"\nboot = 2\n", false),
        ("unit = \"iso8601\"\nboot = 2\n", false),
    ] {
        let text =
            format!("[time]\ncolumn = \"t\"\n{time}[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n");
        let found = Map::from_toml(&text, "map");
        assert_eq!(found.is_ok(), is_fine, "{time}");
        if let Err(error) = found {
            assert!(error.to_string().contains("time.boot"), "{error}");
        }
    }
}
