//! Layouts of instruments and programs, and what the map says of each; the guessed map says the same.

use super::*;
use crate::guess::guess;

/// x \[m\] and F \[N\] at 100 Hz.
fn x(k: usize) -> f64 {
    0.3 * (0.011 * k as f64).sin() + 0.0004 * (1.7 * k as f64).sin()
}
fn f(k: usize) -> f64 {
    if (k / 50).is_multiple_of(2) {
        8.0
    } else {
        -4.0
    }
}

const ROWS: usize = 400;
const XF: &str = "[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n[[command]]\nthruster = \"surge\"\ncolumn = \"F\"\n";
const T: &str = "[time]\ncolumn = \"t\"\nunit = \"s\"\n";

fn rows(each: impl Fn(usize) -> String) -> String {
    (0..ROWS).map(|k| each(k) + "\n").collect()
}

/// Sound, and x (shifted) and F to the printed digits.
fn check(text: &[u8], toml: &str, shift_m: f64) -> Imported {
    let map = Map::from_toml(toml, "m").unwrap_or_else(|e| panic!("{e}\n{toml}"));
    let data = read_table(text, &map, None).unwrap();
    assert!(!data.has_faults(), "{toml}\n{:?}", data.findings);
    assert_eq!(data.times_s.len(), ROWS, "{toml}");
    for k in 0..ROWS {
        assert!(
            (data.times_s[k] - 0.01 * k as f64).abs() < 2e-9,
            "{toml}: row {k} at {}",
            data.times_s[k]
        );
        let own = data.motion[0][k] - shift_m;
        assert!((own - x(k)).abs() < 0.51e-6, "{toml}: {own} for {}", x(k));
        if let Some(load) = data.commands.first() {
            assert!((load[k] - f(k)).abs() < 1e-9, "{toml}: row {k}");
        }
    }
    data
}

/// With the map, and with the guessed one unchanged.
fn both(text: &[u8], toml: &str, shift_m: f64) -> Imported {
    let found = guess(text).unwrap().unwrap_or_else(|e| panic!("{e}"));
    check(text, &found.toml, shift_m);
    check(text, toml, shift_m)
}

#[test]
fn notes_units_separators_and_encodings() {
    let plain = rows(|k| format!("{:.2},{:.6},{:.3}", 0.01 * k as f64, x(k), f(k)));
    let head = format!("# run 7\n# operator: me\nt,x,F\n{plain}");
    both(
        head.as_bytes(),
        &format!("[file]\ncomment = \"#\"\n{T}{XF}"),
        0.0,
    );
    // Notes in between are none of the table either.
    let noted = head.replace("0.05,", "# stopped here\n0.05,");
    check(
        noted.as_bytes(),
        &format!("[file]\ncomment = \"#\"\n{T}{XF}"),
        0.0,
    );
    let units = format!("t,x,F\ns,m,N\n{plain}");
    both(
        units.as_bytes(),
        &format!("[file]\nunits_line = 2\n{T}{XF}"),
        0.0,
    );
    let comma = |text: &str| text.replace(',', ";").replace('.', ",");
    let excel = format!(
        "\u{feff}sep=;\r\nt;x;F\r\n{}",
        comma(&plain).replace('\n', "\r\n")
    );
    both(
        excel.as_bytes(),
        &format!("[file]\ndecimal = \",\"\nseparator = \";\"\n{T}{XF}"),
        0.0,
    );
    let blanks = format!(
        "  t    x   F\n{}",
        rows(|k| format!("{:>9.2} {:>12.6}\t{:>8.3}", 0.01 * k as f64, x(k), f(k)))
    );
    both(
        blanks.as_bytes(),
        &format!("[file]\nseparator = \"blanks\"\n{T}{XF}"),
        0.0,
    );
    let quoted = format!(
        "\"t\",\"x\",\"F\"\n{}",
        rows(|k| format!("\"{:.2}\",\"{:.6}\",\"{:.3}\"", 0.01 * k as f64, x(k), f(k)))
    );
    both(quoted.as_bytes(), &format!("{T}{XF}"), 0.0);
    // In UTF-16 and Latin-1.
    let degrees = format!(
        "t [s];Weg [m];Kraft [N];Höhe\n{}",
        comma(&rows(|k| format!(
            "{:.2},{:.6},{:.3},0",
            0.01 * k as f64,
            x(k),
            f(k)
        )))
    );
    let map = "[time]\ncolumn = \"t [s]\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"Weg [m]\"\nunit = \"m\"\n[[command]]\nthruster = \"surge\"\ncolumn = \"Kraft [N]\"\n";
    let latin: Vec<u8> = degrees.chars().map(|c| c as u32 as u8).collect();
    check(
        &latin,
        &format!("[file]\nseparator = \";\"\ndecimal = \",\"\nencoding = \"latin1\"\n{map}"),
        0.0,
    );
    let wide: Vec<u8> = degrees.encode_utf16().flat_map(u16::to_le_bytes).collect();
    check(
        &wide,
        &format!("[file]\nseparator = \";\"\ndecimal = \",\"\nencoding = \"utf-16\"\n{map}"),
        0.0,
    );
    let said = read_table(
        &latin[..],
        &Map::from_toml(
            &format!("[file]\nseparator = \";\"\ndecimal = \",\"\n{map}"),
            "m",
        )
        .unwrap(),
        None,
    )
    .unwrap();
    assert!(kinds(&said, Severity::Fault).contains(&"encoding"));
}

#[test]
fn empty_columns_at_the_end_are_dropped_and_said() {
    let plain =
        |end: &str| rows(|k| format!("{:.2},{:.6},{:.3}{end}", 0.01 * k as f64, x(k), f(k)));
    for text in [
        format!("t,x,F\n{}", plain(",")),
        format!("t,x,F,\n{}", plain("")),
        format!("t,x,F,,\n{}", plain(",,")),
    ] {
        let data = both(text.as_bytes(), &format!("{T}{XF}"), 0.0);
        let said = data.findings.iter().any(|f| f.kind == "empty_columns");
        assert!(said || text.starts_with("t,x,F,,"), "{:?}", data.findings);
    }
    // A name that stands in no row, as LabVIEW's Comment.
    let comment =
        format!("t,x,F,Comment\n{}", plain("")).replace("8.000\n0.01,", "8.000,start\n0.01,");
    check(comment.as_bytes(), &format!("{T}{XF}"), 0.0);
    // A row that lost a cell in the middle is none of these.
    let lost = format!("t,x,F,Comment\n{}", plain(",ok")).replace("0.09,", "");
    let map = Map::from_toml(&format!("{T}{XF}"), "m").unwrap();
    let data = read(&lost, &map);
    let row = data
        .findings
        .iter()
        .find(|f| f.kind == "truncated_rows")
        .unwrap();
    assert_eq!(row.line, Some(11));
}

#[test]
fn motion_capture_and_measurement_files() {
    let vicon = format!(
        "Trajectories\n100\n,,AUV:front,,,AUV:rear,,\nFrame,Sub Frame,X,Y,Z,X,Y,Z\n,,mm,mm,mm,mm,mm,mm\n{}",
        rows(|k| format!(
            "{},0,{:.3},1.0,-800.0,{:.3},1.0,-800.0",
            k + 1,
            1e3 * x(k) + 200.0,
            1e3 * x(k) - 200.0
        ))
    );
    let map = "[file]\nheader_line = 4\nunits_line = 5\nrate_hz = 100\n[time]\ncolumn = \"Frame\"\n[motion.x_m]\ncolumn = \"X\"\nnth = 1\nunit = \"mm\"\n";
    both(vicon.as_bytes(), map, 0.2);
    check(vicon.as_bytes(), &map.replace("nth = 1", "nth = 2"), -0.2);
    // Two sections: the other ends where the first begins.
    let devices = format!(
        "Devices\n1000\n,,Force\nFrame,Sub Frame,Fx\n,,N\n{}\n\n{vicon}",
        "1,0,2.5\n".repeat(30).trim_end()
    );
    let found = guess(devices.as_bytes()).unwrap().unwrap();
    check(devices.as_bytes(), &found.toml, 0.2);

    let qtm = format!(
        "NO_OF_FRAMES\t{ROWS}\nNO_OF_CAMERAS\t8\nNO_OF_BODIES\t1\nFREQUENCY\t100\nDESCRIPTION\t--\nTIME_STAMP\t2024-03-05, 10:11:12.123\t9876.5\nDATA_INCLUDED\t6D\nBODY_NAMES\tAUV\nFrame\tTime\tAUV X\tY\tZ\tRoll\tPitch\tYaw\tResidual\n{}",
        rows(|k| format!(
            "{}\t{:.5}\t{:.3}\t2.5\t-800.1\t0.1\t{:.3}\t1.0\t0.4",
            k + 1,
            0.01 * k as f64,
            1e3 * x(k) + 1500.0,
            2.0 + x(k)
        ))
    );
    let map = "[file]\nseparator = \"\\t\"\nheader_line = 9\n[time]\ncolumn = \"Time\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"AUV X\"\nunit = \"mm\"\n[motion.theta_rad]\ncolumn = \"Pitch\"\nunit = \"deg\"\n";
    both(qtm.as_bytes(), map, 1.5);

    let motive = format!(
        "Format Version,1.23,Take Name,run,Capture Frame Rate,100.000000,Export Frame Rate,100.000000,Rotation Type,Quaternion,Length Units,Meters,Coordinate Space,Global\n\n,,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body\n,,AUV,AUV,AUV,AUV,AUV,AUV,AUV,AUV\n,,1,1,1,1,1,1,1,1\n,,Rotation,Rotation,Rotation,Rotation,Position,Position,Position,Mean Marker Error\nFrame,Time (Seconds),X,Y,Z,W,X,Y,Z,\n{}",
        rows(|k| {
            // Heading 0.2 rad to starboard: about Motive's y the other way.
            let half: f64 = 0.1;
            format!(
                "{k},{:.6},0.0,{:.6},0.0,{:.6},{:.6},0.8,0.25,0.0002",
                0.01 * k as f64,
                -half.sin(),
                half.cos(),
                x(k)
            )
        })
    );
    let found = guess(motive.as_bytes()).unwrap().unwrap();
    let data = check(motive.as_bytes(), &found.toml, 0.0);
    assert!(
        (data.motion[5][7] - 0.2).abs() < 1e-6,
        "{}",
        data.motion[5][7]
    );
    assert!((data.motion[1][7] - 0.25).abs() < 1e-9 && (data.motion[2][7] + 0.8).abs() < 1e-9);

    let lvm = format!(
        "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t,\nX_Columns\tOne\nDate\t2024/03/05\nTime\t10:11:12,123\n***End_of_Header***\t\n\t\nChannels\t2\t\t\nSamples\t100\t100\t\nY_Unit_Label\tMeter\tNewton\t\nX_Dimension\tTime\tTime\t\nDelta_X\t0,010000\t0,010000\t\n***End_of_Header***\t\t\t\nX_Value\tPosition\tForce\tComment\n{}",
        rows(|k| format!("{:.6}\t{:.6}\t{:.3}\r", 0.01 * k as f64, x(k), f(k)).replace('.', ","))
    );
    let map = "[file]\nseparator = \"\\t\"\ndecimal = \",\"\nheader_line = 16\n[time]\ncolumn = \"X_Value\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"Position\"\nunit = \"m\"\n[[command]]\nthruster = \"surge\"\ncolumn = \"Force\"\n";
    both(lvm.as_bytes(), map, 0.0);
}

#[test]
fn robots_and_their_trajectories() {
    let ns = |k: usize| 1_709_633_472_123_456_789_u64 + 10_000_000 * k as u64;
    let q = |k: usize| {
        let half = 0.05 * (0.02 * k as f64).sin();
        (half.sin(), half.cos())
    };
    let heading = |data: &Imported| {
        for k in 0..ROWS {
            let psi = 0.1 * (0.02 * k as f64).sin();
            assert!((data.motion[5][k] - psi).abs() < 1e-6, "row {k}");
        }
    };
    let echo = rows(|k| {
        let ((s, c), ns) = (q(k), ns(k));
        format!(
            "{},{},odom,base_link,{:.9},0.1,-0.8,0.0,0.0,{s:.9},{c:.9}",
            ns / 1_000_000_000,
            ns % 1_000_000_000,
            x(k)
        )
    });
    let map = "[file]\nheader = false\n[time]\ncolumns = [1, 2]\nunit = [\"s\", \"ns\"]\nclock = \"unix\"\n[motion.x_m]\ncolumn = 5\nunit = \"m\"\n[quaternion]\ncolumns = [8, 9, 10, 11]\norder = \"xyzw\"\n";
    let data = both(echo.as_bytes(), map, 0.0);
    heading(&data);
    assert_eq!(data.start_ns, ns(0), "to the nanosecond");

    let tum = rows(|k| {
        let (s, c) = q(k);
        format!(
            "{}.{:09} {:.9} 0.1 -0.8 0 0 {s:.9} {c:.9}",
            ns(k) / 1_000_000_000,
            ns(k) % 1_000_000_000,
            x(k)
        )
    });
    let map = "[file]\nseparator = \"blanks\"\nheader = false\ncomment = \"#\"\n[time]\ncolumn = 1\nunit = \"s\"\nclock = \"unix\"\n[motion.x_m]\ncolumn = 2\nunit = \"m\"\n[quaternion]\ncolumns = [5, 6, 7, 8]\norder = \"xyzw\"\n";
    heading(&both(tum.as_bytes(), map, 0.0));
    heading(&both(
        format!("# timestamp tx ty tz qx qy qz qw\n{tum}").as_bytes(),
        map,
        0.0,
    ));

    let euroc = format!(
        "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []\n{}",
        rows(|k| {
            let (s, c) = q(k);
            format!("{},{:.9},0.1,-0.8,{c:.9},0.0,0.0,{s:.9}", ns(k), x(k))
        })
    );
    let map = "[file]\nheader_line = 1\n[time]\ncolumn = 1\nunit = \"ns\"\nclock = \"unix\"\n[motion.x_m]\ncolumn = \"p_RS_R_x [m]\"\nunit = \"m\"\n[quaternion]\ncolumns = [5, 6, 7, 8]\norder = \"wxyz\"\n";
    heading(&both(euroc.as_bytes(), map, 0.0));

    let rostopic = format!(
        "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.pose.position.x,field.pose.position.y,field.pose.position.z\n{}",
        rows(|k| format!("{},{k},{},odom,{:.9},0.1,-0.8", ns(k), ns(k), x(k)))
    );
    let map = "[time]\ncolumn = \"%time\"\nunit = \"ns\"\nclock = \"unix\"\n[motion.x_m]\ncolumn = \"field.pose.position.x\"\nunit = \"m\"\n";
    both(rostopic.as_bytes(), map, 0.0);

    // Two topics in one table, each in rows of its own.
    let mut juggler = "__time,/odom/pose/position/x,/cmd/surge\n".to_owned();
    for k in 0..ROWS {
        let t = 1_709_633_472.0 + 0.01 * k as f64;
        juggler += &format!("{t:.6},{:.6},\n", x(k));
        if k % 10 == 0 {
            juggler += &format!("{:.6},,{:.3}\n", t + 0.0013, f(k));
        }
    }
    let hand = "[time]\ncolumn = \"__time\"\nunit = \"s\"\nclock = \"unix\"\n[motion.x_m]\ncolumn = \"/odom/pose/position/x\"\nunit = \"m\"\nmissing = \"skip\"\n[[command]]\nthruster = \"surge\"\ncolumn = \"/cmd/surge\"\nmissing = \"hold\"\n";
    let guessed = guess(juggler.as_bytes()).unwrap().unwrap();
    assert_eq!(guessed.kind, "PlotJuggler");
    for toml in [hand, &guessed.toml] {
        let map = Map::from_toml(toml, "m").unwrap();
        let data = read(&juggler, &map);
        assert!(!data.has_faults(), "{:?}", data.findings);
        let folder = tempfile::tempdir().unwrap();
        let outcome = import(
            &data,
            &map,
            "",
            &folder.path().join("o.mcap"),
            accept(false),
        )
        .unwrap();
        assert_eq!(
            (outcome.samples, outcome.commands, outcome.lost.total()),
            (ROWS, ROWS / 10, 0)
        );
    }
}

#[test]
fn clocks_of_every_kind() {
    let body =
        |stamp: &dyn Fn(usize) -> String| rows(|k| format!("{},{:.6},{:.3}", stamp(k), x(k), f(k)));
    let clock = |k: usize| (10 + k / 360_000, (k / 6000) % 60, (k / 100) % 60, k % 100);
    let time = |keys: &str| format!("[time]\n{keys}{XF}");
    let two = format!(
        "Date,Time,x,F\n{}",
        body(&|k| {
            let (h, m, s, c) = clock(k);
            format!("2026-01-01,{h:02}:{m:02}:{s:02}.{c:02}0000")
        })
    );
    both(
        two.as_bytes(),
        &time("columns = [\"Date\", \"Time\"]\nunit = \"iso8601\"\n"),
        0.0,
    );
    let german = format!(
        "Date,Time,x,F\n{}",
        body(&|k| {
            let (h, m, s, c) = clock(k);
            format!("31.01.2026,{h:02}:{m:02}:{s:02}.{c:02}")
        })
    );
    both(
        german.as_bytes(),
        &time("columns = [\"Date\", \"Time\"]\nformat = \"%d.%m.%Y %H:%M:%S%.f\"\n"),
        0.0,
    );
    let american = format!(
        "Timestamp,x,F\n{}",
        body(&|k| {
            let (h, m, s, c) = clock(k);
            format!("03/25/2026 {h:02}:{m:02}:{s:02}.{c:02} AM")
        })
    );
    both(
        american.as_bytes(),
        &time("column = \"Timestamp\"\nformat = \"%m/%d/%Y %I:%M:%S%.f %p\"\n"),
        0.0,
    );
    let matlab = format!(
        "Time,x,F\n{}",
        body(&|k| {
            let (h, m, s, c) = clock(k);
            format!("05-Mar-2024 {h:02}:{m:02}:{s:02}.{c:02}0")
        })
    );
    both(
        matlab.as_bytes(),
        &time("column = \"Time\"\nformat = \"%d-%b-%Y %H:%M:%S%.f\"\n"),
        0.0,
    );
    let duration = format!(
        "Time,x,F\n{}",
        body(&|k| format!("{:.2} sec", 0.01 * k as f64))
    );
    both(
        duration.as_bytes(),
        &time("column = \"Time\"\nunit = \"s\"\n"),
        0.0,
    );
    // Over midnight without a date: the day goes on.
    let midnight = format!(
        "Time,x,F\n{}",
        body(&|k| {
            let s = (86_398 * 100 + k) % 8_640_000;
            format!(
                "{:02}:{:02}:{:02}.{:02}",
                s / 360_000,
                s / 6000 % 60,
                s / 100 % 60,
                s % 100
            )
        })
    );
    both(
        midnight.as_bytes(),
        &time("column = \"Time\"\nformat = \"%H:%M:%S%.f\"\n"),
        0.0,
    );
    // Days: exact as far as they are printed.
    let days = format!(
        "t,x,F\n{}",
        body(&|k| format!("{:.10}", 46_082.5 + 0.01 * k as f64 / 86_400.0))
    );
    let map = Map::from_toml(&time("column = \"t\"\nunit = \"spreadsheet_days\"\n"), "m").unwrap();
    let data = read(&days, &map);
    assert!(!data.has_faults(), "{:?}", data.findings);
    assert_eq!(data.start_ns, ((46_082.5 - 25_569.0) * 86_400e9) as u64);
    assert!((data.times_s[399] - 3.99).abs() < 1e-5);
    // Counters that start again, of any width.
    for (bits, start) in [(32_u32, 4_294_000_000_u64), (24, 15_000_000)] {
        let text = format!(
            "t,x,F\n{}",
            body(&|k| ((start + 10_000 * k as u64) % (1 << bits)).to_string())
        );
        both(
            text.as_bytes(),
            &time(&format!("column = \"t\"\nunit = \"us\"\nunwrap = {bits}\n")),
            0.0,
        );
        let without = Map::from_toml(&time("column = \"t\"\nunit = \"us\"\n"), "m").unwrap();
        let found = read(&text, &without);
        let back = found
            .findings
            .iter()
            .find(|f| f.kind == "time_backwards")
            .unwrap();
        assert!(
            back.message.contains(&format!("unwrap = {bits}")),
            "{back:?}"
        );
    }
    // Stamps rounded to 0.1 s: rows stay where they were.
    let rounded = format!(
        "t,x,F\n{}",
        body(&|k| format!("{:.1}", (0.1 * k as f64).floor() / 10.0))
    );
    both(
        rounded.as_bytes(),
        &time("column = \"t\"\nunit = \"s\"\nrate_hz = 100\n"),
        0.0,
    );
    // Rows at a rate, and nothing else.
    let bare = format!("x,F\n{}", rows(|k| format!("{:.6},{:.3}", x(k), f(k))));
    check(bare.as_bytes(), &time("rate_hz = 100\n"), 0.0);
}

/// `export --merged` names each thruster's thrust: the `v` of an upright one is no velocity.
#[test]
fn a_thruster_named_v_is_no_velocity() {
    let text =
        "t_s,x_m,surge_n,thrust_v_aft_port_n\n0,0.0,1,0\n0.1,0.1,1,2\n0.2,0.3,1,1\n0.3,0.6,2,0\n";
    let found = guess(text.as_bytes()).unwrap().unwrap();
    assert!(!found.toml.contains("u_mps"), "{}", found.toml);
}
