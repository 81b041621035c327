//! Units, scales, constants, frames, pulses, and what is lost.

use super::*;
use crate::guess::guess;

fn value_of(toml: &str, cell: &str) -> f64 {
    let text: String = "t,a\n".to_owned()
        + &(0..30)
            .map(|k| format!("{:.2},{cell}\n", 0.04 * k as f64))
            .collect::<String>();
    let map = Map::from_toml(
        &format!("[time]\ncolumn = \"t\"\nunit = \"s\"\n{toml}"),
        "m",
    )
    .unwrap();
    let data = read(&text, &map);
    data.motion
        .iter()
        .find_map(|v| v.first().copied())
        .unwrap_or(f64::NAN)
}

#[test]
fn units_of_the_field_scale_offset_and_constants() {
    let of = |name: &str, unit: &str, more: &str| {
        value_of(
            &format!("[motion.{name}]\ncolumn = \"a\"\nunit = \"{unit}\"\n{more}"),
            "2.5",
        )
    };
    for (name, unit, factor) in [
        ("u_mps", "kn", 1852.0 / 3600.0),
        ("u_mps", "km/h", 1.0 / 3.6),
        ("z_m", "ft", 0.3048),
        ("psi_rad", "cdeg", std::f64::consts::PI / 18_000.0),
        ("r_radps", "deg/min", std::f64::consts::PI / 10_800.0),
        ("r_radps", "rpm", std::f64::consts::PI / 30.0),
    ] {
        assert!(
            (of(name, unit, "") / (2.5 * factor) - 1.0).abs() < 1e-14,
            "{unit}"
        );
    }
    assert!(
        (of("x_m", "mm", "sign = -1\nscale = 2\noffset = 0.25\n") - (0.25 - 0.005)).abs() < 1e-15
    );
    assert_eq!(
        value_of("[motion.z_m]\nvalue = -800\nunit = \"mm\"\n", "1"),
        -0.8
    );
    let minutes = Map::from_toml(
        "[time]\ncolumn = \"t\"\nunit = \"min\"\n[motion.x_m]\ncolumn = \"a\"\nunit = \"m\"\n",
        "m",
    )
    .unwrap();
    let text: String = "t,a\n".to_owned()
        + &(0..30)
            .map(|k| format!("{:.4},{k}\n", 0.001 * k as f64))
            .collect::<String>();
    assert!((read(&text, &minutes).times_s[10] - 0.6).abs() < 1e-9);
}

#[test]
fn units_that_the_file_states_are_held_against_the_map() {
    let text = table(100, |_, _| {}).replace("t,x,psi,r,q\n", "t,x,psi,r,q\ns,mm,deg,deg/s,-\n");
    let toml = |x: &str, psi: &str| {
        format!(
            "[file]\nunits_line = 2\n[time]\ncolumn = \"t\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"{x}\"\n[motion.psi_rad]\ncolumn = \"psi\"\nunit = \"{psi}\"\n"
        )
    };
    let found = |x, psi| read(&text, &Map::from_toml(&toml(x, psi), "m").unwrap());
    let faults = kinds(&found("m", "rad"), Severity::Fault);
    assert_eq!(
        faults.iter().filter(|k| **k == "units").count(),
        2,
        "{faults:?}"
    );
    assert!(!kinds(&found("mm", "deg"), Severity::Fault).contains(&"units"));
    let named = table(100, |_, _| {}).replace("t,x,psi", "t,x (mm),psi");
    let toml =
        "[time]\ncolumn = \"t\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"x (mm)\"\nunit = \"m\"\n";
    assert!(
        kinds(
            &read(&named, &Map::from_toml(toml, "m").unwrap()),
            Severity::Fault
        )
        .contains(&"units")
    );
}

/// A vehicle on a curved way: t, x, y, psi, and velocities along the body's or the tank's axes.
fn curve(in_tank: bool) -> String {
    let mut out = "t,x,y,psi,vx,vy\n".to_owned();
    for k in 0..1500 {
        let t = 0.02 * k as f64;
        let (psi, speed) = (0.3 * t, 0.4);
        // Integrals of speed (cos psi, sin psi).
        let (x, y) = (speed / 0.3 * psi.sin(), speed / 0.3 * (1.0 - psi.cos()));
        let (vx, vy) = if in_tank {
            (speed * psi.cos(), speed * psi.sin())
        } else {
            (speed + 0.01 * (3.0 * t).sin(), 0.01 * (2.0 * t).sin())
        };
        out += &format!("{t:.2},{x:.6},{y:.6},{psi:.6},{vx:.6},{vy:.6}\n");
    }
    out
}

fn curve_map(frame: &str) -> Map {
    let channel = |name: &str, column: &str, unit: &str| {
        format!("[motion.{name}]\ncolumn = \"{column}\"\nunit = \"{unit}\"\n")
    };
    let speed =
        |name: &str, column: &str| channel(name, column, "m/s") + &format!("frame = \"{frame}\"\n");
    let toml = "[time]\ncolumn = \"t\"\nunit = \"s\"\n".to_owned()
        + &channel("x_m", "x", "m")
        + &channel("y_m", "y", "m")
        + &channel("psi_rad", "psi", "rad")
        + &speed("u_mps", "vx")
        + &speed("v_mps", "vy");
    Map::from_toml(&toml, "m").unwrap()
}

#[test]
fn velocities_are_rotated_and_the_frame_is_checked() {
    let right = read(&curve(true), &curve_map("tank"));
    assert!(!right.has_faults(), "{:?}", right.findings);
    assert!(
        right.motion[6].iter().all(|u| (u - 0.4).abs() < 1e-5),
        "along the body"
    );
    for (in_tank, frame) in [(true, "body"), (false, "tank")] {
        let wrong = read(&curve(in_tank), &curve_map(frame));
        assert!(
            kinds(&wrong, Severity::Fault).contains(&"velocity_frame"),
            "{:?}",
            wrong.findings
        );
    }
    assert!(!read(&curve(false), &curve_map("body")).has_faults());
    // Guessed from the positions.
    let guessed = |text: String| guess(text.as_bytes()).unwrap().unwrap().toml;
    let rotated = |toml: &str| toml.lines().any(|l| l == "frame = \"tank\"");
    let stated = |in_tank| guessed(curve(in_tank).replace("psi", "psi_rad"));
    assert!(rotated(&stated(true)) && !rotated(&stated(false)));
    // A heading that goes on over a turn and a half is in radians if the way says so.
    let open = guessed(curve(false));
    assert!(open.contains("unit = \"rad\"") && !rotated(&open), "{open}");
}

#[test]
fn pulses_go_through_the_rigs_curve() {
    let rig = hydroline_rigs::Rig::builtin("lshpi").unwrap();
    let thruster = &rig.thrusters.thrusters[0];
    let (low, high) = (
        thruster.curve.points[0].0,
        thruster.curve.points.last().unwrap().0,
    );
    let pulse = |k: usize| low + (high - low) * (k % 7) as f64 / 6.0;
    let text = table(300, |k, c| c[4] = format!("{:.3}", pulse(k)));
    let extra = format!(
        "[[command]]\nthruster = \"{}\"\ncolumn = \"q\"\nunit = \"us\"\n",
        thruster.name
    );
    let found = read_for(&text, &map(&extra), Some(&rig));
    assert!(!found.has_faults(), "{:?}", found.findings);
    assert!((found.commands[0][3] - thruster.curve.thrust_n(pulse(3))).abs() < 1e-2);
    assert!((found.pulses_us[0][3] - pulse(3)).abs() < 1e-3);
    assert!(
        kinds(&read_for(&text, &map(&extra), None), Severity::Fault).contains(&"pulse_without_rig")
    );
    let beyond = table(300, |k, c| {
        c[4] = format!("{:.3}", if k == 9 { high + 500.0 } else { pulse(k) })
    });
    let found = read_for(&beyond, &map(&extra), Some(&rig));
    let fault = found
        .findings
        .iter()
        .find(|f| f.kind == "pulse_range")
        .unwrap();
    assert_eq!(fault.line, Some(11));
    assert!(found.commands[0][9].is_nan());
}

/// 60 s at 100 Hz, 1.5 m from zero, with noise of 0.3 mm.
fn capture(edit: impl Fn(usize, f64) -> f64) -> String {
    let noise = |k: usize| 0.3 * ((k * 7919 % 1000) as f64 / 500.0 - 1.0);
    let x = |k: usize| 1500.0 + 400.0 * (0.002 * k as f64).sin() + noise(k);
    "t,x,yaw\n".to_owned()
        + &(0..6000)
            .map(|k| {
                format!(
                    "{:.2},{:.3},{:.3}\n",
                    0.01 * k as f64,
                    edit(k, x(k)),
                    (0.3 * k as f64) % 360.0
                )
            })
            .collect::<String>()
}

const CAPTURE: &str =
    "[time]\ncolumn = \"t\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"mm\"\n";

#[test]
fn lost_bodies_teleports_and_averaged_angles_are_faults() {
    let with = |extra: &str, edit: &dyn Fn(usize, f64) -> f64| {
        read(
            &capture(edit),
            &Map::from_toml(&format!("{CAPTURE}{extra}"), "m").unwrap(),
        )
    };
    assert!(!with("", &|_, x| x).has_faults());
    let lost = |k: usize, x: f64| {
        if (2000..2020).contains(&k) || (3000..3300).contains(&k) {
            0.0
        } else {
            x
        }
    };
    let found = with("", &lost);
    let zeros = found.findings.iter().find(|f| f.kind == "zeros").unwrap();
    assert_eq!((zeros.line, zeros.severity), (Some(2002), Severity::Fault));
    assert!(
        zeros.message.contains("320 row(s) in 2 group(s)"),
        "{zeros:?}"
    );
    // With the loss accepted none of them is written.
    let folder = tempfile::tempdir().unwrap();
    let one = Map::from_toml(CAPTURE, "m").unwrap();
    for streamed in [false, true] {
        let out = folder.path().join(format!("{streamed}.mcap"));
        let outcome = if streamed {
            let text = capture(lost);
            let survey = survey(text.as_bytes(), &one, None).unwrap();
            import_table(text.as_bytes(), &survey, &one, "", None, &out, accept(true)).unwrap()
        } else {
            import(&found, &one, "", &out, accept(true)).unwrap()
        };
        assert_eq!(
            (outcome.samples, outcome.lost.motion_cells),
            (5680, 320),
            "{streamed}"
        );
    }
    // The map may say that zeros are none.
    assert!(!with("missing = \"skip\"\nmissing_value = 0\n", &lost).has_faults());
    // A vehicle that passes through the file's zero is not lost there.
    assert!(
        !with("", &|k, x| if (x - 1500.0).abs() < 1.0 && k > 100 {
            x
        } else {
            x - 1500.0 + 1500.0
        })
        .has_faults()
    );
    let through = "t,x\n".to_owned()
        + &(0..600)
            .map(|k| format!("{:.2},{:.3}\n", 0.01 * k as f64, 0.01 * (k as f64 - 300.0)))
            .collect::<String>();
    assert!(!read(&through, &Map::from_toml("[time]\ncolumn = \"t\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n", "m").unwrap()).has_faults());

    let jumped = with("", &|k, x| if k >= 2500 { x + 900.0 } else { x });
    let fault = jumped
        .findings
        .iter()
        .find(|f| f.kind == "teleport")
        .unwrap();
    assert_eq!(fault.line, Some(2502));
    let spike = with("", &|k, x| if k == 2500 { x + 700.0 } else { x });
    assert_eq!(
        spike
            .findings
            .iter()
            .find(|f| f.kind == "outlier")
            .unwrap()
            .line,
        Some(2502)
    );
    assert!(spike.motion[0][2500].is_nan() && spike.motion[0][2501].is_finite());

    // 359.9, then half way round, then 0.2.
    let yaw = "[motion.psi_rad]\ncolumn = \"yaw\"\nunit = \"deg\"\n";
    assert!(
        !with(yaw, &|_, x| x).has_faults(),
        "a heading that wraps is none"
    );
    let averaged = capture(|_, x| x)
        .replace("11.99,", "#")
        .lines()
        .map(|l| match l.strip_prefix('#') {
            Some(rest) => format!("11.99,{},180.1\n", rest.split(',').next().unwrap()),
            None => format!("{l}\n"),
        })
        .collect::<String>();
    let found = read(
        &averaged,
        &Map::from_toml(&format!("{CAPTURE}{yaw}"), "m").unwrap(),
    );
    let fault = found
        .findings
        .iter()
        .find(|f| f.kind == "angle_through_wrap")
        .unwrap_or_else(|| panic!("{:?}", found.findings));
    assert_eq!(fault.line, Some(1201));
}

#[test]
fn a_quaternion_that_is_none_is_named() {
    let text: String = "t,a,b,c,d\n".to_owned()
        + &(0..100)
            .map(|k| {
                let half = 0.002 * k as f64;
                if k == 40 {
                    format!("{:.2},0,0,0,0\n", 0.01 * k as f64)
                } else {
                    format!(
                        "{:.2},0,0,{:.6},{:.6}\n",
                        0.01 * k as f64,
                        half.sin(),
                        half.cos()
                    )
                }
            })
            .collect::<String>();
    let map = |order: &str, more: &str| {
        Map::from_toml(&format!("[time]\ncolumn = \"t\"\nunit = \"s\"\n[quaternion]\ncolumns = [\"a\", \"b\", \"c\", \"d\"]\norder = \"{order}\"\n{more}"), "m").unwrap()
    };
    let found = read(&text, &map("xyzw", ""));
    let fault = found
        .findings
        .iter()
        .find(|f| f.kind == "quaternion")
        .unwrap();
    assert_eq!((fault.line, found.motion[5][40].is_nan()), (Some(42), true));
    assert!((found.motion[5][50] - 0.2).abs() < 1e-5);
    assert!(
        !read(
            &text,
            &map("xyzw", "missing = \"skip\"\nmissing_value = 0\n")
        )
        .has_faults()
    );
}

#[test]
fn a_table_of_commands_alone_is_a_log() {
    let text: String = "t,F\n".to_owned()
        + &(0..50)
            .map(|k| format!("{:.3},{}\n", 0.04 * k as f64, k % 3))
            .collect::<String>();
    let map = Map::from_toml("[time]\ncolumn = \"t\"\nunit = \"s\"\n[[command]]\nthruster = \"surge\"\ncolumn = \"F\"\nunit = \"kN\"\n", "m").unwrap();
    let data = read(&text, &map);
    assert!(!data.has_faults(), "{:?}", data.findings);
    assert_eq!(data.commands[0][2], 2000.0);
}

#[test]
fn maps_that_contradict_themselves_say_where() {
    let t = "[time]\ncolumn = \"t\"\nunit = \"s\"\n";
    let x = "[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n";
    for (text, word) in [
        (format!("[time]\ncolumn = \"t\"\n{x}"), "time.unit"),
        (format!("[time]\n{x}"), "rate_hz"),
        (
            format!("[time]\ncolumn = \"t\"\nunit = \"s\"\nunwrap = 4\n{x}"),
            "8 .. 62",
        ),
        (
            format!("[time]\ncolumns = [1, 2]\nunit = \"s\"\n{x}"),
            "each its unit",
        ),
        (
            format!("[time]\ncolumn = \"t\"\nformat = \"%Q\"\n{x}"),
            "strftime",
        ),
        (format!("{t}[motion.x_m]\nunit = \"m\"\n"), "value = .."),
        (
            format!("{t}[motion.x_m]\ncolumn = \"x\"\nvalue = 1\nunit = \"m\"\n"),
            "one of the two",
        ),
        (
            format!("{t}[motion.x_m]\ncolumn = 0\nunit = \"m\"\n"),
            "count from 1",
        ),
        (format!("{t}{x}missing = \"ignore\"\n"), "skip"),
        (format!("{t}{x}frame = \"tank\"\n"), "body"),
        (
            format!("[file]\nheader = false\nheader_line = 2\n{t}{x}"),
            "header_line",
        ),
        (format!("[file]\nencoding = \"ebcdic\"\n{t}{x}"), "latin1"),
        (format!("[file]\nseparator = \"ab\"\n{t}{x}"), "blanks"),
        (
            format!("[file]\nrate_hz = 10\n[time]\nrate_hz = 20\n{x}"),
            "give one",
        ),
        (
            format!("{t}{x}[quaternion]\ncolumns = [1, 2, 3]\norder = \"xyzw\"\n"),
            "four",
        ),
        (
            format!("{t}{x}[[command]]\nthruster = \"surge\"\ncolumn = \"F\"\nunit = \"deg\"\n"),
            "pulse",
        ),
    ] {
        let error = Map::from_toml(&text, "m.toml").unwrap_err().to_string();
        assert!(error.contains(word), "{text}\n{error}");
    }
}

#[test]
fn companions_stand_beside_the_motion() {
    let text: String = "t,x,rudder [deg],n [rpm]\n".to_owned()
        + &(0..50)
            .map(|k| {
                format!(
                    "{:.2},{:.3},{},{}\n",
                    0.04 * k as f64,
                    0.01 * k as f64,
                    2 * (k % 9),
                    60 + k
                )
            })
            .collect::<String>();
    let toml = "[time]\ncolumn = \"t\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n[motion.rudder_rad]\ncolumn = \"rudder [deg]\"\nunit = \"deg\"\n[motion.shaft_radps]\ncolumn = 4\nunit = \"rpm\"\n";
    let map = Map::from_toml(toml, "m").unwrap();
    let data = read(&text, &map);
    assert!(!data.has_faults(), "{:?}", data.findings);
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("o.mcap");
    import(&data, &map, "", &out, accept(false)).unwrap();
    let rig = hydroline_rigs::Rig::builtin("lshpi").unwrap();
    let run = hydroline_identify::data::load(&out, &rig).unwrap();
    let (times_s, rudder) = run.companions.measured(0);
    assert_eq!(times_s.len(), 50);
    assert!((rudder[4] - 8f64.to_radians()).abs() < 1e-12);
    assert!((run.companions.measured(2).1[0] - std::f64::consts::TAU).abs() < 1e-12);
    let guessed = guess(text.as_bytes()).unwrap().unwrap().toml;
    assert!(guessed.contains("[motion.rudder_rad]"), "{guessed}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Whatever stands in a file: a guess or a refusal, and a guessed map loads.
    #[test]
    fn any_file_is_guessed_or_refused(text in "([a-z%#,;.:0-9 \t-]{0,40}\n){0,12}") {
        if let Ok(found) = guess(text.as_bytes()).unwrap() {
            prop_assert!(Map::from_toml(&found.toml, "m").is_ok(), "{}", found.toml);
        }
    }

    /// A table read in stretches and from bytes is the one read whole.
    #[test]
    fn streamed_and_whole_write_the_same(rows in 10usize..60, bad in 0usize..60) {
        let text = table(rows, |k, c| if k == bad { c[1] = "lost".into() });
        let map = map(WITH_R);
        let folder = tempfile::tempdir().unwrap();
        let data = read(&text, &map);
        let survey = survey(text.as_bytes(), &map, None).unwrap();
        prop_assert_eq!(&data.findings, &survey.findings);
        let whole = import(&data, &map, "", &folder.path().join("a.mcap"), accept(true)).unwrap();
        let streamed = import_table(text.as_bytes(), &survey, &map, "", None, &folder.path().join("b.mcap"), accept(true)).unwrap();
        prop_assert_eq!(whole, streamed);
        let bytes = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
        prop_assert_eq!(bytes("a.mcap"), bytes("b.mcap"));
    }
}

#[test]
fn rows_that_repeat_a_stamp_with_other_cells_are_one_sample() {
    // As PlotJuggler writes series of several topics.
    let map = Map::from_toml(
        "[time]\ncolumn = \"t\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\nmissing = \"skip\"\n\
         [motion.u_mps]\ncolumn = \"u\"\nunit = \"m/s\"\nmissing = \"skip\"\n[[command]]\nthruster = \"surge\"\ncolumn = \"c\"\nmissing = \"skip\"\n",
        "map",
    )
    .unwrap();
    let mut text = "t,x,u,c\n".to_owned();
    for k in 0..40 {
        let t = 0.1 * f64::from(k);
        text += &format!(
            "{t:.1},{:.4},,\n{t:.1},,{:.4},\n{t:.1},,,{k}\n",
            t * t,
            2.0 * t
        );
    }
    let data = read(&text, &map);
    assert!(!data.has_faults(), "{:?}", data.findings);
    assert_eq!(data.times_s.len(), 40);
    assert!(
        data.motion[0]
            .iter()
            .chain(&data.motion[6])
            .all(|v| v.is_finite())
    );
    // Two values of one cell at one time: one of them is wrong.
    let twice = text.replace("1.0,1.0000,,\n", "1.0,1.0000,,\n1.0,1.0100,,\n");
    assert!(read(&twice, &map).has_faults());
}

/// A vehicle that looks along the tank's x axis but for a few degrees, and its velocities along the tank's axes.
fn nearly_along_x(psi_deg: f64, noise_m: f64) -> String {
    let mut out = "t,x,y,psi,vx,vy\n".to_owned();
    for k in 0..1500 {
        let t = 0.02 * k as f64;
        let psi = psi_deg.to_radians() * (0.5 * t).sin();
        let (x, vx) = (0.4 * t, 0.4);
        let (y, vy) = (0.05 * (0.4 * t).sin(), 0.02 * (0.4 * t).cos());
        let jitter = noise_m * f64::from((k * 7919 % 101) - 50) / 50.0;
        out += &format!("{t:.2},{:.6},{y:.6},{psi:.6},{vx:.6},{vy:.6}\n", x + jitter);
    }
    out
}

#[test]
fn velocities_that_may_be_of_either_frame_were_said_to_be_the_bodys() {
    for psi_deg in [1.0, 3.0, 6.0] {
        let found = read(&nearly_along_x(psi_deg, 2e-4), &curve_map("body"));
        let said: Vec<_> = found
            .findings
            .iter()
            .filter(|f| f.kind == "velocity_frame")
            .collect();
        assert_eq!(said.len(), 1, "{psi_deg}: {:?}", found.findings);
        assert!(said[0].severity < Severity::Fault, "{said:?}");
        let words = &said[0].message;
        assert!(
            words.contains(&format!("within {psi_deg:.1} deg")),
            "{words}"
        );
        assert!(words.contains("0.40"), "the speed: {words}");
    }
    // Where the heading turns enough, nothing is left open.
    let given = read(&curve(false), &curve_map("body"));
    assert!(given.findings.iter().all(|f| f.kind != "velocity_frame"));
}
