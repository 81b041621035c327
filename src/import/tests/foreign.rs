//! Files of instruments and programs that were read for something else.

use super::*;
use crate::guess::{Guess, guess};

fn guessed(text: &str) -> Guess {
    guess(text.as_bytes())
        .unwrap()
        .unwrap_or_else(|e| panic!("{e}"))
}

fn says(found: &Guess, words: &[&str]) -> bool {
    let said = |r: &String| words.iter().all(|w| r.contains(w));
    found.remarks.iter().any(said)
}

fn has(found: &Guess, lines: &str) -> bool {
    found.toml.contains(lines)
}

fn rows(each: impl Fn(usize, f64) -> String) -> String {
    (0..300)
        .map(|k| each(k, (0.02 * k as f64).sin()) + "\n")
        .collect()
}

#[test]
fn qualisys_without_header_frame_and_time_goes_by_its_width() {
    let head = "NO_OF_FRAMES\t300\nNO_OF_MARKERS\t2\nFREQUENCY\t100\nDATA_INCLUDED\t3D\nMARKER_NAMES\tbow\tstern\n";
    let markers = |s: f64| {
        format!(
            "{:.3}\t2.5\t-800.1\t{:.3}\t2.5\t-800.1",
            900.0 + 300.0 * s,
            500.0 + 300.0 * s
        )
    };
    let bare = guessed(&format!("{head}{}", rows(|_, s| markers(s))));
    assert!(
        has(&bare, "rate_hz = 100") && has(&bare, "[motion.x_m]\n# "),
        "{}",
        bare.toml
    );
    let data = read(
        &format!("{head}{}", rows(|_, s| markers(s))),
        &Map::from_toml(&bare.toml, "m").unwrap(),
    );
    assert!((data.motion[0][0] - 0.9).abs() < 1e-9 && (data.times_s[10] - 0.1).abs() < 1e-9);
    for (lead, column) in [(1, 2), (2, 3)] {
        let text = format!(
            "{head}{}",
            rows(|k, s| {
                let own = [format!("{}\t", k + 1), format!("{:.2}\t", 0.01 * k as f64)];
                own[..lead].concat() + &markers(s)
            })
        );
        let found = guessed(&text);
        let data = read(&text, &Map::from_toml(&found.toml, "m").unwrap());
        assert!(
            (data.motion[0][0] - 0.9).abs() < 1e-9,
            "{column}: {}",
            found.toml
        );
        assert!((data.times_s[10] - 0.1).abs() < 1e-9, "{}", found.toml);
    }
}

#[test]
fn motive_on_the_port_side_of_its_origin_stands_upright() {
    let text = format!(
        "Format Version,1.23,Take Name,run,Capture Frame Rate,100.000000,Export Frame Rate,100.000000,Rotation Type,Quaternion,Length Units,Meters,Coordinate Space,Global\n\n,,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body\n,,AUV,AUV,AUV,AUV,AUV,AUV,AUV\n,,1,1,1,1,1,1,1\n,,Rotation,Rotation,Rotation,Rotation,Position,Position,Position\nFrame,Time (Seconds),X,Y,Z,W,X,Y,Z\n{}",
        rows(|k, s| format!(
            "{k},{:.6},0.0,{:.6},0.0,{:.6},{:.6},{:.4},-2.5",
            0.01 * k as f64,
            -(0.2 * s).sin(),
            (0.2 * s).cos(),
            s,
            0.5 + 0.2 * s
        ))
    );
    let found = guessed(&text);
    assert!(has(&found, "axes = \"y_up\""), "{}", found.toml);
    let data = read(&text, &Map::from_toml(&found.toml, "m").unwrap());
    assert!((data.motion[1][0] + 2.5).abs() < 1e-9 && (data.motion[2][0] + 0.5).abs() < 1e-9);
}

#[test]
fn a_messages_own_stamp_is_taken_before_its_receipt() {
    let ns = |k: usize| 1_709_633_472_123_456_789_u64 + 20_000_000 * k as u64;
    let text = format!(
        "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.pose.position.x\n{}",
        rows(|k, s| format!(
            "{},{k},{},odom,{s:.6}",
            ns(k) + 3_000_000 + (k as u64 * 7919 % 1000) * 1000,
            ns(k)
        ))
    );
    let found = guessed(&text);
    assert!(
        has(&found, "column = \"field.header.stamp\"") && says(&found, &["%time"]),
        "{}",
        found.toml
    );
}

#[test]
fn unlabelled_numbers_that_several_messages_have_are_only_proposed() {
    for (numbers, words) in [
        (6, ["WrenchStamped", "TwistStamped"]),
        (3, ["PointStamped", "Vector3Stamped"]),
    ] {
        let text = rows(|k, s| {
            let values: Vec<String> = (0..numbers)
                .map(|i| format!("{:.6}", s * (i + 1) as f64))
                .collect();
            format!(
                "{},{},base_link,{}",
                1_709_633_472 + k / 50,
                (k % 50) * 20_000_000,
                values.join(",")
            )
        });
        let found = guessed(&text);
        assert!(
            words.iter().all(|w| says(&found, &[w])),
            "{:?}",
            found.remarks
        );
        assert!(
            !found
                .toml
                .lines()
                .any(|l| l.starts_with("[motion") || l.starts_with("[[command")),
            "{}",
            found.toml
        );
        // Without the marks of comments the proposals are a map.
        let first: String = found
            .toml
            .split("# if the message")
            .take(2)
            .collect::<Vec<_>>()
            .join("# if the message");
        let open: String = first
            .lines()
            .map(|l| {
                l.strip_prefix("# ")
                    .filter(|l| l.starts_with(['[', 'c', 'u']) && !l.contains(':'))
                    .unwrap_or(l)
                    .to_owned()
                    + "\n"
            })
            .collect();
        let data = read(
            &text,
            &Map::from_toml(&open, "m").unwrap_or_else(|e| panic!("{e}\n{open}")),
        );
        assert!(
            data.motion[if numbers == 6 { 6 } else { 0 }].len() == 300,
            "{open}"
        );
    }
}

#[test]
fn a_date_in_a_column_of_its_own_belongs_to_the_clock() {
    let comma = |v: f64| format!("{v:.5}").replace('.', ",");
    let text = format!(
        "Datum;Uhrzeit;x [m];y [m]\n{}",
        rows(|k, s| {
            let clock = format!("10:11:{:02},{:03}", 12 + k / 50, (k % 50) * 20);
            format!("05.03.2024;{clock};{};{}", comma(s), comma(0.5 * s))
        })
    );
    let found = guessed(&text);
    assert!(
        has(&found, "columns = [\"Datum\", \"Uhrzeit\"]"),
        "{}",
        found.toml
    );
    let data = read(&text, &Map::from_toml(&found.toml, "m").unwrap());
    assert_eq!(data.start_ns / 1_000_000_000, 1_709_633_472);
}

#[test]
fn seconds_since_1904_are_not_the_year_2090() {
    let text = format!(
        "Time\tx [m]\n{}",
        rows(|k, s| format!("{:.3}\t{s:.5}", 3_792_478_272.123 + 0.02 * k as f64))
    );
    let found = guessed(&text);
    assert!(
        has(&found, "unit = \"labview_s\"") && says(&found, &["1904"]),
        "{}",
        found.toml
    );
    let data = read(&text, &Map::from_toml(&found.toml, "m").unwrap());
    assert_eq!(
        data.start_ns / 1_000_000,
        1_709_633_472_123,
        "{:?}",
        data.findings
    );
}

#[test]
fn vicons_quaternions_and_rotation_vectors_are_distinguished() {
    let file = |section: &str, names: &str, turns: &dyn Fn(f64) -> String| {
        format!(
            "{section}\n100\n,,AUV,,,,,,\nFrame,Sub Frame,{names}\n,,,,,,mm,mm,mm\n{}",
            rows(|k, s| format!(
                "{},0,{},{:.3},20.0,-800.0",
                k + 1,
                turns(0.1 * s),
                300.0 * s
            ))
        )
    };
    let tracker = file("Objects", "RX,RY,RZ,RW,TX,TY,TZ", &|a: f64| {
        format!("0,0,{:.6},{:.6}", a.sin(), a.cos())
    });
    let found = guessed(&tracker);
    assert!(
        has(&found, "[quaternion]") && has(&found, "rate_hz = 100"),
        "{}",
        found.toml
    );
    let data = read(&tracker, &Map::from_toml(&found.toml, "m").unwrap());
    assert!((data.motion[5][50] - 0.2 * 1f64.sin()).abs() < 1e-5);
    let nexus = file("Segments", "RX,RY,RZ,TX,TY,TZ", &|a: f64| {
        format!("0,0,{a:.6}")
    });
    let found = guessed(
        &nexus
            .replace(",,,,,,mm", ",,,,,mm")
            .replace(",,AUV,,,,,,", ",,AUV,,,,,"),
    );
    assert!(
        says(&found, &["RX RY RZ", "rotation vector"]),
        "{:?}",
        found.remarks
    );
}

#[test]
fn maps_and_cells_that_are_wrong_get_words_that_help() {
    let unknown =
        Map::from_toml("[time]\nrate_hz = 10\n[motion.foo]\ncolumn = \"x\"\n", "m").unwrap_err();
    assert!(
        unknown.to_string().contains("channels are x_m"),
        "{unknown}"
    );
    let text = "t;x\n".to_owned()
        + &rows(|k, s| {
            format!(
                "{:.2};\"1,{:03}.{:02}\"",
                0.02 * k as f64,
                500 + (100.0 * s) as i64,
                k % 100
            )
        });
    let map = Map::from_toml("[file]\nseparator = \";\"\n[time]\ncolumn = \"t\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"mm\"\n", "m").unwrap();
    let found = read(&text, &map);
    assert!(
        found
            .findings
            .iter()
            .any(|f| f.message.contains("thousands")),
        "{:?}",
        found.findings
    );
    let said = found
        .findings
        .iter()
        .find(|f| f.message.contains("thousands"));
    let said = &said.unwrap().message;
    assert!(
        said.contains("[file] thousands = \",\""),
        "what to say: {said}"
    );
    // As it says, and as a guess says, the same numbers as without the marks.
    let toml = "[file]\nseparator = \";\"\nthousands = \",\"\n[time]\ncolumn = \"t\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"mm\"\n";
    let with = read(&text, &Map::from_toml(toml, "m").unwrap());
    let bare = text.replace(',', "");
    let without = read(&bare, &Map::from_toml(toml, "m").unwrap());
    assert!(!with.has_faults(), "{:?}", with.findings);
    assert_eq!(with.motion, without.motion);
    let guessed = crate::guess::guess(text.as_bytes()).unwrap().unwrap();
    assert!(
        guessed.toml.contains("thousands = \",\""),
        "{}",
        guessed.toml
    );
    assert!(guessed.remarks.iter().any(|r| r.contains("thousands")));
    for (mark, more) in [(".", ""), ("x", ""), (" ", "separator = \"blanks\"\n")] {
        let toml = format!(
            "[file]\n{more}thousands = \"{mark}\"\n[time]\ncolumn = \"t\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"mm\"\n"
        );
        let error = Map::from_toml(&toml, "m").unwrap_err().to_string();
        assert!(error.contains("file.thousands"), "{error}");
    }
}

#[test]
fn two_relative_clocks_are_joined_as_the_files_count() {
    use crate::join::{Given, join};
    use hydroline_log::messages::Stamped;
    let folder = tempfile::tempdir().unwrap();
    let log = |name: &str, text: &str, toml: &str| {
        let map = Map::from_toml(toml, "m").unwrap();
        let out = folder.path().join(name);
        let survey = survey(text.as_bytes(), &map, None).unwrap();
        import_table(
            text.as_bytes(),
            &survey,
            &map,
            toml,
            None,
            &out,
            accept(false),
        )
        .unwrap();
        out
    };
    let time = "[time]\ncolumn = \"t\"\nunit = \"s\"\n";
    // Motion from 10 s on, commands from 12 s on, of one clock.
    let motion = log(
        "a.mcap",
        &("t,x\n".to_owned() + &rows(|k, s| format!("{:.2},{s:.5}", 10.0 + 0.02 * k as f64))),
        &format!("{time}[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n"),
    );
    let commands = log(
        "b.mcap",
        &("t,f\n".to_owned()
            + &rows(|k, s| format!("{:.2},{:.3}", 12.0 + 0.01 * k as f64, 5.0 * s))),
        &format!("{time}[[command]]\nthruster = \"surge\"\ncolumn = \"f\"\n"),
    );
    let given = Given {
        offset_s: Some(0.0),
        offset_sd_s: 0.001,
        ..Given::default()
    };
    let out = folder.path().join("c.mcap");
    let joined = join(&motion, &commands, given, None, &out, Default::default()).unwrap();
    assert!(
        joined
            .relation
            .warnings
            .iter()
            .any(|w| w.contains("2.000000 s")),
        "{:?}",
        joined.relation.warnings
    );
    let (mut first_motion, mut first_command) = (None, None);
    for message in hydroline_log::LogReader::open(&out).unwrap().by_ref() {
        match message.unwrap().record {
            hydroline_log::Record::Motion(m) => {
                first_motion.get_or_insert(m.stamp_ns().unwrap());
            }
            hydroline_log::Record::Command(c) => {
                first_command.get_or_insert(c.stamp_ns().unwrap());
            }
            _ => {}
        }
    }
    assert_eq!(
        first_command.unwrap() - first_motion.unwrap(),
        2_000_000_000
    );
}

#[test]
fn a_second_segment_of_a_labview_file_is_no_row_of_the_first() {
    let head = "Channels\t2\t\nSamples\t100\t100\nDate\t2024/03/05\t2024/03/05\n***End_of_Header***\t\t\nX_Value\tx\tu\n";
    let rows = || {
        (0..100)
            .map(|k| {
                format!(
                    "{:.2}\t{:.4}\t1.0\n",
                    0.1 * f64::from(k),
                    (0.1 * f64::from(k)).sin()
                )
            })
            .collect::<String>()
    };
    let first = format!(
        "LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\n{head}{}",
        rows()
    );
    let toml = "[file]\nseparator = \"\\t\"\nheader_line = 8\n[time]\ncolumn = \"X_Value\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n";
    let map = Map::from_toml(toml, "m").unwrap();
    let alone = read(&first, &map);
    assert!(!alone.has_faults(), "{:?}", alone.findings);
    let both = read(&format!("{first}{head}{}", rows()), &map);
    let faults: Vec<_> = both
        .findings
        .iter()
        .filter(|f| f.severity == Severity::Fault)
        .collect();
    let [segments] = faults[..] else {
        panic!("{faults:?}");
    };
    assert_eq!((segments.kind, segments.line), ("segments", Some(109)));
    assert!(
        segments.message.contains("last_line = 108"),
        "{}",
        segments.message
    );
    assert_eq!(both.motion, alone.motion);
    // Its header and rows are counted.
    assert_eq!(both.lost_rows, 105);
    let one = Map::from_toml(
        &toml.replace("header_line = 8", "header_line = 8\nlast_line = 108"),
        "m",
    )
    .unwrap();
    assert!(!read(&format!("{first}{head}{}", rows()), &one).has_faults());
}

#[test]
fn a_table_with_a_control_character_between_its_cells_is_guessed_and_read() {
    for separator in ['\u{1f}', '\u{1}'] {
        let text = format!("t{separator}x\n")
            + &rows(|k, s| format!("{:.2}{separator}{s:.5}", 0.02 * k as f64));
        let found = guessed(&text);
        let key = format!("separator = \"\\u{:04x}\"", u32::from(separator));
        assert!(has(&found, &key), "{key}: {}", found.toml);
        let data = read(&text, &Map::from_toml(&found.toml, "m").unwrap());
        assert!(!data.has_faults(), "{:?}", data.findings);
        assert_eq!(data.times_s.len(), 300);
    }
}
