use super::*;
use proptest::prelude::*;

mod clocks;
mod foreign;
mod guesses;
#[path = "../../tests/support/inputs.rs"]
mod inputs;
mod layouts;
mod motions;
mod notations;
mod recordings;
mod reports;
mod values;
mod written;

fn accept(accept_faults: bool) -> Options {
    Options {
        accept_faults,
        ..Options::default()
    }
}

fn map(extra: &str) -> Map {
    let text = format!(
        "[time]\ncolumn = \"t\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n[motion.psi_rad]\ncolumn = \"psi\"\nunit = \"rad\"\n{extra}"
    );
    Map::from_toml(&text, "map.toml").unwrap()
}

/// t, x, psi, r: a slow swing; `edit` may spoil a row.
fn table(rows: usize, edit: impl Fn(usize, &mut Vec<String>)) -> String {
    let mut out = "t,x,psi,r,q\n".to_owned();
    for k in 0..rows {
        let t = k as f64 * 0.04;
        let mut cells: Vec<String> = [
            t,
            0.05 * t,
            0.3 * (0.9 * t).sin(),
            0.27 * (0.9 * t).cos(),
            0.1 * (2.3 * t).sin(),
        ]
        .iter()
        .map(|v| format!("{v:.6}"))
        .collect();
        edit(k, &mut cells);
        out += &(cells.join(",") + "\n");
    }
    out
}

fn kinds(imported: &Imported, least: Severity) -> Vec<&'static str> {
    imported
        .findings
        .iter()
        .filter(|f| f.severity >= least)
        .map(|f| f.kind)
        .collect()
}

const WITH_R: &str = "[motion.r_radps]\ncolumn = \"r\"\nunit = \"rad/s\"\n";

#[test]
fn a_sound_table_has_no_warning() {
    let read = read(&table(300, |_, _| {}), &map(WITH_R));
    assert_eq!(
        kinds(&read, Severity::Warning),
        Vec::<&str>::new(),
        "{:?}",
        read.findings
    );
    assert_eq!(read.times_s.len(), 300);
    assert!(
        read.findings
            .iter()
            .any(|f| f.kind == "kinematics" && f.message.contains("d(psi_rad)/dt"))
    );
}

#[test]
fn each_fault_has_its_finding_and_nothing_is_mended() {
    type Edit = fn(usize, &mut Vec<String>);
    let cases: [(&str, Edit); 8] = [
        ("nan", |k, c| {
            if k == 7 {
                c[1] = "NaN".into()
            }
        }),
        ("empty_cells", |k, c| {
            if k == 7 {
                c[1] = String::new()
            }
        }),
        ("not_a_number", |k, c| {
            if k == 7 {
                c[2] = "lost".into()
            }
        }),
        ("truncated_rows", |k, c| {
            if k == 299 {
                c.truncate(2)
            }
        }),
        ("too_many_cells", |_, c| {
            *c = c
                .iter()
                .flat_map(|v| v.split('.').map(str::to_owned).collect::<Vec<_>>())
                .collect()
        }),
        ("repeated_stamps", |k, c| {
            if k == 9 {
                c[0] = format!("{:.6}", 8.0 * 0.04)
            }
        }),
        ("time_backwards", |k, c| {
            if k == 9 {
                c[0] = "0.1".into()
            }
        }),
        ("time_zone_jump", |k, c| {
            if k >= 150 {
                c[0] = format!("{:.6}", k as f64 * 0.04 + 3600.0)
            }
        }),
    ];
    for (kind, edit) in cases {
        let read = read(&table(300, edit), &map(""));
        assert!(
            kinds(&read, Severity::Fault).contains(&kind),
            "{kind}: {:?}",
            read.findings
        );
    }
    let read = read(
        &table(300, |k, c| {
            if k == 7 {
                c[1] = "NaN".into()
            }
        }),
        &map(""),
    );
    assert!(
        read.motion[0][7].is_nan() && read.motion[0][6].is_finite(),
        "the cell stays lost"
    );
    assert_eq!(
        read.findings.iter().find(|f| f.kind == "nan").unwrap().line,
        Some(9)
    );
}

#[test]
fn gaps_are_counted() {
    let text: String = table(300, |_, _| {})
        .lines()
        .enumerate()
        .filter(|(i, _)| !(100..105).contains(i))
        .map(|(_, l)| format!("{l}\n"))
        .collect();
    let read = read(&text, &map(""));
    let gap = read.findings.iter().find(|f| f.kind == "gaps").unwrap();
    assert!(gap.message.contains("1 gap(s), about 5 row(s)"), "{gap:?}");
}

#[test]
fn decimal_commas_are_named() {
    let semicolons = table(100, |_, _| {}).replace(',', ";").replace('.', ",");
    let separator = |decimal: &str| {
        Map::from_toml(&format!("[file]\nseparator = \";\"\ndecimal = \"{decimal}\"\n[time]\ncolumn = \"t\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n"), "m").unwrap()
    };
    assert!(
        kinds(&read(&semicolons, &separator(".")), Severity::Fault).contains(&"decimal_separator")
    );
    let good = read(&semicolons, &separator(","));
    assert!(!good.has_faults(), "{:?}", good.findings);
    assert!((good.motion[0][99] - 0.198).abs() < 1e-9);
    // The wrong separator altogether: the column is not found, with the header shown.
    assert!(kinds(&read(&semicolons, &map("")), Severity::Fault).contains(&"column_missing"));
}

#[test]
fn units_signs_and_swapped_columns_show_in_the_kinematics() {
    let degrees = |_: usize, c: &mut Vec<String>| {
        c[2] = format!("{:.6}", c[2].parse::<f64>().unwrap().to_degrees())
    };
    assert!(kinds(&read(&table(300, degrees), &map(WITH_R)), Severity::Fault).contains(&"units"));
    assert!(
        kinds(
            &read(
                &table(300, |_, _| {}),
                &map(&WITH_R.replace("unit =", "sign = -1\nunit ="))
            ),
            Severity::Fault
        )
        .contains(&"sign")
    );
    let swapped = "[motion.theta_rad]\ncolumn = \"x\"\nunit = \"rad\"\n[motion.q_radps]\ncolumn = \"r\"\nunit = \"rad/s\"\n";
    let found = read(
        &table(300, |k, c| {
            c[1] = format!("{:.6}", 0.04 * (2.3 * 0.04 * k as f64).cos())
        }),
        &map(swapped),
    );
    assert!(
        kinds(&found, Severity::Fault).contains(&"swapped_columns"),
        "{:?}",
        found.findings
    );
    let millimetres =
        |_: usize, c: &mut Vec<String>| c[1] = format!("{:.3}", c[1].parse::<f64>().unwrap() * 1e3);
    assert!(kinds(&read(&table(300, millimetres), &map("")), Severity::Fault).contains(&"units"));
    let roll_in_degrees = "[motion.phi_rad]\ncolumn = \"q\"\nunit = \"rad\"\n";
    let deg = read(
        &table(300, |_, c| {
            c[4] = format!("{:.4}", 57.3 * c[4].parse::<f64>().unwrap())
        }),
        &map(roll_in_degrees),
    );
    assert!(
        kinds(&deg, Severity::Fault).contains(&"units"),
        "{:?}",
        deg.findings
    );
}

#[test]
fn mixed_time_zones_are_named_even_when_the_clock_face_goes_on() {
    let text: String = "t,x\n".to_owned()
        + &(0..60)
            .map(|k| {
                format!(
                    "2026-03-01T12:00:{k:02}{},{}\n",
                    if k < 30 { "+01:00" } else { "Z" },
                    k as f64 * 0.1
                )
            })
            .collect::<String>();
    let map = Map::from_toml(
        "[time]\ncolumn = \"t\"\nunit = \"iso8601\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n",
        "m",
    )
    .unwrap();
    let found = read(&text, &map);
    let kinds = kinds(&found, Severity::Fault);
    assert!(
        kinds.contains(&"mixed_time_zones") && kinds.contains(&"time_zone_jump"),
        "{:?}",
        found.findings
    );
}

#[test]
fn dead_and_stuck_channels_and_drift_are_seen() {
    let dead = read(&table(300, |_, c| c[1] = "0.5".into()), &map(""));
    assert!(kinds(&dead, Severity::Warning).contains(&"dead_channel"));
    let stuck = read(
        &table(300, |k, c| {
            if (100..160).contains(&k) {
                c[2] = "0.123".into()
            }
        }),
        &map(""),
    );
    assert!(
        kinds(&stuck, Severity::Warning).contains(&"stuck_channel"),
        "{:?}",
        stuck.findings
    );
    let text = "[time]\ncolumn = \"t\"\nunit = \"s\"\ncompare_column = \"q\"\ncompare_unit = \"s\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n";
    let drifting = read(
        &table(300, |k, c| {
            c[4] = format!("{:.6}", 5.0 + k as f64 * 0.04 * 1.0005)
        }),
        &Map::from_toml(text, "m").unwrap(),
    );
    let drift = drifting
        .findings
        .iter()
        .find(|f| f.kind == "clock_drift")
        .unwrap();
    assert!(
        drift.severity == Severity::Warning && drift.message.contains("500 ppm"),
        "{drift:?}"
    );
}

#[test]
fn a_map_that_is_wrong_says_where() {
    for (text, word) in [
        (
            "[time]\ncolumn = \"t\"\nunit = \"s\"\n",
            "at least one channel",
        ),
        (
            "[time]\ncolumn = \"t\"\nunit = \"fortnight\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n",
            "time.unit",
        ),
        (
            "[time]\ncolumn = \"t\"\nunit = \"s\"\n[motion.x]\ncolumn = \"x\"\nunit = \"m\"\n",
            "channels are x_m",
        ),
        (
            "[time]\ncolumn = \"t\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"deg\"\n",
            "one of m cm mm",
        ),
        ("[time]\ncolunm = \"t\"\n", "colunm"),
    ] {
        let error = Map::from_toml(text, "m.toml").unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
    }
}

#[test]
fn a_table_at_rest_leaves_its_noise_in_the_log() {
    use hydroline_core::run::StillNoise;
    use hydroline_identify::data::load;
    let still = table(1000, |k, c| {
        // A hash of k: no motion, no period.
        let noise = |salt: u64| {
            let mut v = (k as u64 + salt).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            v = (v ^ (v >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            ((v >> 11) as f64 / (1u64 << 53) as f64 - 0.5) * 1e-3
        };
        c[1] = format!("{:.7}", 0.2 + noise(1));
        c[2] = format!("{:.7}", noise(77_777));
    });
    let map = map("");
    let data = read(&still, &map);
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("still.mcap");
    import(&data, &map, "", &out, accept(true)).unwrap();
    let rig = hydroline_rigs::Rig::builtin("lshpi").unwrap();
    let noise: StillNoise = load(&out, &rig).unwrap().noise_at_rest.unwrap();
    // Uniform over 1 mm: sd 1 mm / sqrt(12).
    let sd = noise["x_m"].noise.total_sd();
    assert!((sd / (1e-3 / 12f64.sqrt()) - 1.0).abs() < 0.1, "{sd}");
    assert_eq!(noise.len(), 2);
}

#[test]
fn a_heading_that_wraps_still_follows_its_rate() {
    // 0.4 rad/s for 60 s: four turns, written in -pi .. pi.
    let turning = |k: usize, c: &mut Vec<String>| {
        let t = k as f64 * 0.04;
        let psi = 0.4 * t + 0.1 * (0.5 * t).sin();
        let wrapped = (psi + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU);
        c[2] = format!("{:.6}", wrapped - std::f64::consts::PI);
        c[3] = format!("{:.6}", 0.4 + 0.05 * (0.5 * t).cos());
    };
    let found = read(&table(1500, turning), &map(WITH_R));
    assert_eq!(
        kinds(&found, Severity::Warning),
        Vec::<&str>::new(),
        "{:?}",
        found.findings
    );
    let wraps = found.findings.iter().find(|f| f.kind == "angle_wraps");
    assert!(
        wraps.is_some_and(|f| f.message.contains("4 jump(s)")),
        "{:?}",
        found.findings
    );
}

#[test]
fn commands_are_held_against_the_rig() {
    let rig = hydroline_rigs::Rig::builtin("lshpi").unwrap();
    let found = |extra: &str, edit: fn(usize, &mut Vec<String>)| {
        read_for(&table(300, edit), &map(extra), Some(&rig))
    };
    let command = |name: &str| format!("[[command]]\nthruster = \"{name}\"\ncolumn = \"q\"\n");
    let surge = command("surge");
    let sound = found(&surge, |_, _| {});
    assert_eq!(
        kinds(&sound, Severity::Warning),
        Vec::<&str>::new(),
        "{:?}",
        sound.findings
    );
    let fault = |extra: &str, edit, kind: &str| {
        let read = found(extra, edit);
        assert!(
            kinds(&read, Severity::Fault).contains(&kind),
            "{kind}: {:?}",
            read.findings
        );
    };
    fault(&command("bow"), |_, _| {}, "unknown_thruster");
    fault(&format!("{surge}{surge}"), |_, _| {}, "duplicate_thruster");
    fault(
        &surge,
        |k, c| c[4] = format!("{}", 8000 * (k / 150)),
        "command_size",
    );
    fault(
        &command("h_fore_stbd"),
        |k, c| c[4] = format!("{}", 1500 + k % 2),
        "command_size",
    );
    let dead = found(&surge, |_, c| c[4] = "2.0".into());
    assert!(kinds(&dead, Severity::Warning).contains(&"dead_command"));
}

#[test]
fn what_is_left_out_is_counted_by_kind() {
    let toml = "[[command]]\nthruster = \"surge\"\ncolumn = \"q\"\n";
    let map = map(toml);
    let spoilt = table(300, |k, c| match k {
        7 => c[4] = "NaN".into(),
        8 => c[1] = "lost".into(),
        9 => c[0] = "?".into(),
        10 => c.truncate(3),
        11 => c[0] = format!("{:.6}", 8.0 * 0.04),
        _ => {}
    });
    let data = read(&spoilt, &map);
    let folder = tempfile::tempdir().unwrap();
    let outcome = import(&data, &map, "", &folder.path().join("o.mcap"), accept(true)).unwrap();
    assert_eq!(
        outcome.lost,
        Lost {
            rows: 3,
            motion_cells: 1,
            command_cells: 1
        }
    );
    assert_eq!((outcome.samples, outcome.commands), (297, 296));
}

#[test]
fn stamps_without_a_zone_a_clock_from_zero_and_a_cut_number_are_named() {
    let iso = Map::from_toml(
        "[time]\ncolumn = \"t\"\nunit = \"iso8601\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n",
        "m",
    )
    .unwrap();
    let stamps = |zone: &str, day: u32| -> String {
        let row = |k| format!("2026-02-{day}T12:00:{k:02}{zone},{}\n", k as f64 * 0.1);
        "t,x\n".to_owned() + &(0..60).map(row).collect::<String>()
    };
    assert!(kinds(&read(&stamps("", 27), &iso), Severity::Warning).contains(&"time_zone_missing"));
    assert!(kinds(&read(&stamps("Z", 27), &iso), Severity::Warning).is_empty());
    assert!(read(&stamps("Z", 31), &iso).times_s.is_empty());

    let unix = Map::from_toml(
        "[time]\ncolumn = \"t\"\nunit = \"s\"\nclock = \"unix\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n",
        "m",
    )
    .unwrap();
    assert!(kinds(&read(&table(300, |_, _| {}), &unix), Severity::Fault).contains(&"time_clock"));

    let whole = table(300, |_, _| {});
    let cut = &whole[..whole.len() - 4];
    assert!(kinds(&read(cut, &map("")), Severity::Fault).contains(&"cut_number"));
    // A line that ends is complete, however short its last number; a whole last row without an end is too.
    let ended = format!("{cut}\n");
    assert!(kinds(&read(&ended, &map("")), Severity::Warning).is_empty());
    assert!(kinds(&read(whole.trim_end(), &map("")), Severity::Warning).is_empty());
    // Numbers of any length: a short one at an end without a newline may be whole, and is only a warning.
    let uneven = table(300, |k, c| c[4] = format!("{:.*}", 3 + k % 4, 0.1234567));
    let short = format!("{}0.1", &uneven[..uneven.rfind(',').unwrap() + 1]);
    let warned = read(&short, &map(""));
    assert!(!warned.has_faults() && kinds(&warned, Severity::Warning).contains(&"cut_number"));
}

/// Of fewer than six pose channels, and of any rate, the log held nothing.
#[test]
fn the_sd_of_a_map_stands_in_the_log_for_positions_and_rates() {
    use hydroline_core::run::{Channel, instrument_sd};
    let text = WITH_R.to_owned() + "sd = 0.01\n";
    let map = map(&text);
    let data = read(&table(300, |_, _| {}), &map);
    let words = data.findings.iter().find(|f| f.kind == "instrument_sd");
    assert!(words.is_some_and(|f| f.message.contains("r_radps") && f.severity == Severity::Info));
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("log.mcap");
    import(&data, &map, &text, &out, accept(false)).unwrap();
    let rig = hydroline_rigs::Rig::builtin("lshpi").unwrap();
    let run = hydroline_identify::data::load(&out, &rig).unwrap();
    assert_eq!(run.instrument_sd[Channel::R], 0.01);
    assert_eq!(run.instrument_sd[Channel::X], 0.0);
    let session = instrument_sd::entry(Channel::R, 0.01);
    assert_eq!(session, ("import.sd.r_radps".to_owned(), "0.01".to_owned()));
}

#[test]
fn the_sd_of_a_rudder_is_named_as_ignored() {
    let rudder = "[motion.rudder_rad]\ncolumn = \"q\"\nunit = \"rad\"\nsd = 0.01\n";
    let found = read(&table(300, |_, _| {}), &map(rudder));
    let words = found.findings.iter().find(|f| f.kind == "sd_ignored");
    assert!(words.is_some_and(|f| f.message.contains("rudder_rad")));
}

#[test]
fn a_decay_seen_by_a_gyro_leaves_no_noise_at_rest() {
    use hydroline_identify::data::load;
    let toml = "[time]\ncolumn = \"t\"\nunit = \"s\"\n[motion.p_radps]\ncolumn = \"q\"\nunit = \"rad/s\"\n";
    let map = Map::from_toml(toml, "m").unwrap();
    let decay = table(1500, |k, c| {
        let t = 0.04 * k as f64;
        c[4] = format!("{:.6}", 0.4 * (-0.1 * t).exp() * (1.3 * t).sin());
    });
    let data = read(&decay, &map);
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("decay.mcap");
    import(&data, &map, "", &out, accept(false)).unwrap();
    let rig = hydroline_rigs::Rig::builtin("lshpi").unwrap();
    assert!(load(&out, &rig).unwrap().noise_at_rest.is_none());
}

/// Texts that may be in a cell that should hold a number.
const SPOILT: [&str; 7] = ["NaN", "inf", "", "1,5e", "0x1F", "--", "1 2"];

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// One bad cell: a fault names its line, the cell stays lost, every other cell stays as it was.
    #[test]
    fn one_bad_cell_is_named_and_spoils_nothing_else(row in 5usize..95, column in 1usize..3, word in 0usize..SPOILT.len()) {
        let sound = read(&table(100, |_, _| {}), &map(""));
        let found = read(&table(100, |k, c| if k == row {
            // A comma would split the cell; quoted it stays one.
            c[column] = if SPOILT[word].contains(',') { format!("\"{}\"", SPOILT[word]) } else { SPOILT[word].to_owned() };
        }), &map(""));
        let line = row as u64 + 2;
        prop_assert!(found.findings.iter().any(|f| f.severity == Severity::Fault && f.line == Some(line)), "{:?}", found.findings);
        let channel = if column == 1 { 0 } else { 5 };
        prop_assert!(found.motion[channel][row].is_nan());
        for c in [0, 5] {
            for k in 0..100 {
                if (c, k) != (channel, row) {
                    prop_assert_eq!(found.motion[c][k], sound.motion[c][k]);
                }
            }
        }
    }

    /// Whatever the text: no panic, columns as long as the time, and a table without numbers has a fault.
    #[test]
    fn any_text_is_read_or_refused(text in "[a-z0-9,;.:TZ+\\-\"\n ]{0,400}") {
        for text in [text.clone(), format!("t,x,psi,r,q\n{text}")] {
            let found = read(&text, &map(WITH_R));
            let n = found.times_s.len();
            for c in [0usize, 5, 11] {
                prop_assert!(found.motion[c].is_empty() || found.motion[c].len() == n);
            }
            prop_assert!(n >= 4 || found.has_faults());
            prop_assert!(found.times_s.iter().all(|t| t.is_finite()));
        }
    }

    /// Cut anywhere, even inside a number: the rows before the cut are those of the whole file.
    #[test]
    fn a_cut_file_keeps_what_came_before_and_says_so(cut in 200usize..3000) {
        let text = table(100, |_, _| {});
        let whole = read(&text, &map(""));
        let part = read(&text[..cut], &map(""));
        let complete = text[..cut].matches('\n').count().saturating_sub(1);
        prop_assert!(part.motion[0].len() >= complete);
        prop_assert_eq!(&part.motion[0][..complete], &whole.motion[0][..complete]);
        let cells = text[..cut].rsplit('\n').next().unwrap_or("").split(',').count();
        if cells < 5 && !text[..cut].ends_with('\n') {
            prop_assert!(kinds(&part, Severity::Fault).contains(&"truncated_rows"));
        }
    }
}
