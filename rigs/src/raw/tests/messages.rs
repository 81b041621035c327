//! What a person is told.

use toml::Value;

use super::{Step, at, full_rig, leaves};
use crate::{Board, Plan, ProblemKind, Rig, RigError, Target};

/// The built-in rig with one text replaced; panics when the text is not there.
fn changed(from: &str, to: &str) -> RigError {
    let text = include_str!("../../../lshpi.toml");
    assert!(text.contains(from), "{from:?} is not in lshpi.toml");
    Rig::from_toml(&text.replacen(from, to, 1), "my.toml", None).expect_err(to)
}

fn tells(error: &RigError, words: &[&str]) {
    let message = error.to_string();
    for word in words {
        assert!(message.contains(word), "no {word:?} in:\n{message}");
    }
}

/// Every number of a rig with NaN, a text, and far too large: refused, naming the key.
#[test]
fn every_number_out_of_range_is_named() {
    for name in Rig::builtin_names() {
        let table = full_rig(name);
        let mut numbers = 0;
        for (path, steps) in leaves(&table) {
            let mut table = table.clone();
            let is_number = matches!(at(&mut table, &steps), Value::Float(_) | Value::Integer(_));
            numbers += usize::from(is_number);
            let bad: &[Value] = if is_number {
                &[
                    Value::Float(f64::NAN),
                    Value::Float(f64::INFINITY),
                    Value::String("a lot".into()),
                    Value::Float(1e30),
                    Value::Float(-1e30),
                    Value::Boolean(true),
                    Value::Array(vec![]),
                ]
            } else {
                &[Value::Float(1e30), Value::Array(vec![]), Value::Integer(3)]
            };
            for value in bad {
                *at(&mut table, &steps) = value.clone();
                let text = toml::to_string(&table).unwrap();
                let error = Rig::from_toml(&text, "my.toml", None).expect_err(&path);
                let problem = error.problems().iter().find(|p| p.key == path);
                let problem = problem.unwrap_or_else(|| panic!("{path} = {value}: {error}"));
                assert!(
                    problem.line.is_some() && problem.file == "my.toml",
                    "{problem}"
                );
            }
        }
        assert!(numbers > 100, "{numbers} numbers in {name}");
    }
}

/// Every key left out: a default, or an error that names it. Every key misspelt: refused.
#[test]
fn every_key_left_out_or_misspelt() {
    let table = full_rig("bench-v4l");
    for (path, steps) in leaves(&table) {
        let Some(Step::Key(last)) = steps.last() else {
            continue;
        };
        let typo = format!("{last}x");
        for misspelt in [false, true] {
            let mut table = table.clone();
            let parent = match steps.len() {
                1 => &mut table,
                n => at(&mut table, &steps[..n - 1]).as_table_mut().unwrap(),
            };
            let value = parent.remove(last).unwrap();
            if misspelt {
                parent.insert(typo.clone(), value);
            }
            let result = Rig::from_toml(&toml::to_string(&table).unwrap(), "my.toml", None);
            if misspelt {
                let error = result.expect_err(&path);
                let unknown = error
                    .problems()
                    .iter()
                    .find(|p| p.key == format!("{path}x"));
                let unknown = unknown.unwrap_or_else(|| panic!("{path}: {error}"));
                let ProblemKind::UnknownKey {
                    suggestion,
                    allowed,
                } = &unknown.kind
                else {
                    panic!("{unknown}")
                };
                assert_eq!(suggestion.as_deref(), Some(last.as_str()), "{unknown}");
                assert!(allowed.contains(last), "{unknown}");
            } else if let Err(error) = result {
                // An angle may be missed under its other spelling.
                let stem = path.trim_end_matches("_rad").trim_end_matches("_deg");
                assert!(
                    error.problems().iter().any(|p| p.key.starts_with(stem)),
                    "{path}: {error}"
                );
            }
        }
    }
}

#[test]
fn all_problems_at_once_with_lines() {
    let text = include_str!("../../../lshpi.toml")
        .replace("exposure_s = 0.002", "exposure = 0.002")
        .replace("fan_deg = 40", "fan_deg = 400")
        .replace("l_laser_m = 0.27", "l_laser_m = \"0.27\"")
        .replace("mass_kg = 29.777", "mass_kg = -29.777")
        .replace("attitude_deg = 0.1", "attitude_deg = nan");
    let error = Rig::from_toml(&text, "my.toml", None).expect_err("five mistakes");
    let line = |word: &str| 1 + text.lines().position(|l| l.contains(word)).unwrap();
    tells(
        &error,
        &[
            "6 things to put right",
            &format!(
                "my.toml:{}: camera.exposure: unknown key (did you mean `exposure_s`?)",
                line("exposure = ")
            ),
            "camera.exposure_s: missing. Add `exposure_s = …`, a number above 0 and up to 10 s",
            &format!(
                "my.toml:{}: laser.fan_deg: is 400, but must be a number from 1 to 170 deg",
                line("fan_deg = 400")
            ),
            "mounts.l_laser_m: is \"0.27\", but must be a number from -20 to 20 m",
            "vehicle.mass_kg: is -29.777, but must be a number above 0 and up to 1000000 kg",
            "tolerance.attitude_deg: is nan",
        ],
    );
}

#[test]
fn syntax_errors_have_a_line() {
    let error = Rig::from_toml(
        "[rig]\nname = \"a\"\n[camera\nrate_fps = = 3\n",
        "my.toml",
        None,
    );
    tells(
        &error.expect_err("broken"),
        &["my.toml:3", "not valid TOML"],
    );
    let twice = changed("mass_kg = 29.777", "mass_kg = 29.777\nmass_kg = 30");
    tells(&twice, &["not valid TOML", "duplicate"]);
}

#[test]
fn an_empty_rig_lists_its_tables() {
    let error = Rig::from_toml("", "my.toml", None).expect_err("empty");
    for table in [
        "rig",
        "camera",
        "laser",
        "mounts",
        "thrusters",
        "thruster",
        "vehicle",
        "tank",
    ] {
        assert!(
            error.problems().iter().any(|p| p.key == table),
            "{table}: {error}"
        );
    }
    assert_eq!(error.problems().len(), 8, "{error}");
}

#[test]
fn unstable_names_are_refused_unless_allowed() {
    let v4l = |device: &str| {
        include_str!("../../../lshpi.toml").replacen(
            "backend = \"sim\"",
            &format!("backend = \"v4l\"\n{device}"),
            1,
        )
    };
    let read = |device: &str| Rig::from_toml(&v4l(device), "my.toml", None);
    let node = read("device = \"/dev/video0\"").expect_err("unstable");
    tells(
        &node,
        &[
            "camera.device",
            "/dev/video0 is not a stable name",
            "hydroline devices",
            "allow_unstable_node = true",
        ],
    );
    let rig = read("device = \"/dev/video0\"\nallow_unstable_node = true").unwrap();
    assert_eq!(Rig::from_toml(&rig.effective_toml, "e", None).unwrap(), rig);
    tells(
        &read("").expect_err("no device"),
        &["camera.device: missing", "hydroline devices"],
    );
    for bad in [
        "/dev/v4l/by-id/",
        "/dev/v4l/by-id/../../sda",
        "video0",
        "/dev/v4l/by-name/x",
        "/etc/passwd",
        "/dev/../etc/x",
    ] {
        let error = read(&format!("device = \"{bad}\"\nallow_unstable_node = true"));
        tells(
            &error.expect_err(bad),
            &["camera.device", bad, "/dev/v4l/by-id/"],
        );
    }
    let port = changed("port = \"sim\"", "port = \"/dev/ttyUSB0\"");
    tells(
        &port,
        &["thrusters.link.port", "/dev/ttyUSB0", "hydroline devices"],
    );
    tells(
        &changed(
            "backend = \"sim\"",
            "backend = \"sim\"\ndevice = \"/dev/v4l/by-id/x\"",
        ),
        &["camera.device", "v4l"],
    );
}

#[test]
fn angles_in_either_spelling_but_not_both() {
    let text = include_str!("../../../lshpi.toml");
    let rad = text.replace(
        "fan_deg = 40",
        &format!("fan_rad = {:?}", 40_f64.to_radians()),
    );
    assert_eq!(
        Rig::from_toml(&rad, "a", None).unwrap(),
        Rig::builtin("lshpi").unwrap()
    );
    tells(
        &changed("fan_deg = 40", "fan_deg = 40\nfan_rad = 0.7"),
        &["laser.fan_deg", "both given"],
    );
    tells(
        &changed("fan_deg = 40", "fan_rad = 40"),
        &["laser.fan_rad", "is 40", "rad"],
    );
    tells(&changed("fan_deg = 40", ""), &["laser.fan_deg: missing"]);
}

#[test]
fn intrinsics_either_way() {
    let camera = Rig::builtin("lshpi").unwrap().camera;
    // Half of 576 px under half of 36 deg; the centre of the middle four pixels.
    assert!((camera.fx_px - 288.0 / 18_f64.to_radians().tan()).abs() < 1e-12);
    assert_eq!(
        (camera.fx_px, camera.cx_px, camera.cy_px),
        (camera.fy_px, 359.5, 287.5)
    );
    tells(
        &changed(
            "fov_vertical_deg = 36",
            "fov_vertical_deg = 36\nfx_px = 900",
        ),
        &["camera.fx_px", "both"],
    );
    tells(
        &changed("fov_vertical_deg = 36", "fx_px = 900"),
        &["camera.fy_px: missing", "camera.cx_px: missing"],
    );
    tells(
        &changed("fov_vertical_deg = 36", ""),
        &["camera.fov_vertical_deg: missing"],
    );
}

#[test]
fn rules_between_keys() {
    for (from, to, words) in [
        (
            "exposure_s = 0.002",
            "exposure_s = 0.05",
            &["camera.exposure_s", "0.04 s"][..],
        ),
        (
            "frozen_after_s = 0.5",
            "frozen_after_s = 0.05",
            &["camera.frozen_after_s", "0.08 s"],
        ),
        (
            "pixel_format = \"GREY\"",
            "pixel_format = \"grey\"",
            &["did you mean `GREY`"],
        ),
        (
            "l_camera_m = 0.19",
            "l_camera_m = -0.27",
            &["mounts.l_camera_m", "edge on"],
        ),
        (
            "min_us = 1100",
            "min_us = 1600",
            &["thrusters.neutral_us", "1600"],
        ),
        (
            "max_us = 1900",
            "max_us = 2100",
            &["thrusters.max_us", "from 1000 to 2000 us"],
        ),
        (
            "[1435, -2.18]",
            "[1400, -2.18]",
            &["thrusters.curve[4]", "1400 us does not exceed"],
        ),
        (
            "[1435, -2.18]",
            "[1435, -5.18]",
            &["thrusters.curve[4]", "falls below"],
        ),
        (
            "[1435, -2.18]",
            "[1435]",
            &["thrusters.curve[4]", "a point [pulse_us, thrust_n]"],
        ),
        (
            "[1468, 0.0],\n  [1532, 0.0]",
            "[1468, 0.5],\n  [1532, 0.5]",
            &["thrusters.curve", "neutral"],
        ),
        (
            "  [1900, 51.5],\n",
            "",
            &["thrusters.curve", "1100 to 1800 us"],
        ),
        (
            "name = \"h_fore_port\"",
            "name = \"h_fore_stbd\"",
            &["thruster[1].name", "used twice"],
        ),
        (
            "channel = 3",
            "channel = 2",
            &["thruster[3].channel", "h_aft_stbd"],
        ),
        (
            "direction = [0.70711, -0.70711, 0.0]",
            "direction = [0.8, -0.8, 0.0]",
            &["thruster[0].direction", "1.1314", "unit vector"],
        ),
        (
            "baud = 115200",
            "baud = 4800",
            &["thrusters.link.baud", "8000 bit/s"],
        ),
        (
            "added_kg = -250",
            "added_kg = 250",
            &["vehicle.surge.added_kg", "SNAME"],
        ),
        (
            "depth_m = 1.5",
            "depth_m = 0.5",
            &["tank.start_m", "outside the water"],
        ),
        (
            "x_m = [-1.0, 7.0]",
            "x_m = [-1.0, 17.0]",
            &["limits.x_m", "beyond the tank"],
        ),
        (
            "x_m = [-1.0, 7.0]",
            "x_m = [1.0, 7.0]",
            &["limits.x_m", "start"],
        ),
        (
            "x_m = [-1.0, 7.0]",
            "x_m = [7.0, -1.0]",
            &["limits.x_m", "not an interval"],
        ),
        (
            "file = \"targets/hexagons.toml\"",
            "file = \"targets/hexagon.toml\"",
            &["target", "no built-in target", "builtin:hexagons"],
        ),
        (
            "origin_m = [0.0, 0.0]",
            "name = \"x\"",
            &["target.name: unknown key"],
        ),
        (
            "# effect = \"thruster_lag\"",
            "[[physics]]\neffect = \"thruster_lag\"\nlag_s = [1]",
            &["physics[0].lag_s", "a number or a word"],
        ),
        (
            "kind = \"stamped\"",
            "kind = \"stampt\"",
            &["thrusters.link.kind", "did you mean `stamped`"],
        ),
    ] {
        tells(&changed(from, to), words);
    }
    let mut table = full_rig("lshpi");
    table["log"]["queue_bytes"] = Value::Integer(1 << 20);
    table["log"]["chunk_bytes"] = Value::Integer(1 << 21);
    let error = Rig::from_toml(&table.to_string(), "a", None).expect_err("chunk");
    tells(&error, &["log.chunk_bytes", "2097152", "1048576"]);
    let mut table = full_rig("lshpi");
    table["camera"]["pixel_format"] = Value::String("YUYV".into());
    table["camera"]["width_px"] = Value::Integer(721);
    let error = Rig::from_toml(&table.to_string(), "a", None).expect_err("odd");
    tells(&error, &["camera.width_px", "721 is odd", "pairs"]);
}

#[test]
fn mistakes_in_an_included_file_name_that_file() {
    let folder = tempfile_dir();
    std::fs::create_dir_all(folder.join("targets")).unwrap();
    let target = include_str!("../../../targets/hexagons.toml");
    let rig_path = folder.join("rig.toml");
    std::fs::write(&rig_path, include_str!("../../../lshpi.toml")).unwrap();
    let missing = Rig::load(&rig_path).expect_err("no target file yet");
    tells(
        &missing,
        &["rig.toml", "target", "hexagons.toml", "builtin:hexagons"],
    );
    std::fs::write(folder.join("targets/hexagons.toml"), target).unwrap();
    assert_eq!(
        Rig::load(&rig_path).unwrap(),
        Rig::builtin("lshpi").unwrap()
    );
    std::fs::write(
        folder.join("targets/hexagons.toml"),
        target.replace("count = 6", "count = 0"),
    )
    .unwrap();
    let wrong = Rig::load(&rig_path).expect_err("no hexagons");
    tells(&wrong, &["targets/hexagons.toml:", "slab[1].count", "is 0"]);
    std::fs::write(&rig_path, [0xff, 0xfe, 0x00]).unwrap();
    tells(
        &Rig::load(&rig_path).expect_err("binary"),
        &["rig.toml", "not UTF-8"],
    );
    tells(
        &Rig::load(&folder).expect_err("a folder"),
        &["cannot be read"],
    );
    tells(
        &Rig::load_or_builtin("lshp").expect_err("name"),
        &["did you mean `lshpi`", "bench-v4l"],
    );
    tells(
        &Rig::load_or_builtin("no/such.toml").expect_err("path"),
        &["no/such.toml", "cannot be read"],
    );
    std::fs::remove_dir_all(&folder).unwrap();
}

fn tempfile_dir() -> std::path::PathBuf {
    let folder = std::env::temp_dir().join(format!("hydroline-rigs-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

#[test]
fn a_rig_may_place_its_target() {
    let text = include_str!("../../../lshpi.toml")
        .replace("origin_m = [0.0, 0.0]", "origin_m = [0.5, -0.1]")
        .replace("heading_deg = 0 ", "heading_deg = 4 ");
    let target = Rig::from_toml(&text, "a", None).unwrap().target.unwrap();
    assert_eq!(target.origin, [0.5, -0.1, 4_f64.to_radians()]);
    let text = include_str!("../../../lshpi.toml")
        .replace("[rig]", "target = \"builtin:sway-board\"\n[rig]")
        .replace("[target]\nfile", "[other]\nfile");
    let error = Rig::from_toml(&text, "a", None).expect_err("an unknown table");
    tells(&error, &["other: unknown key"]);
}

#[test]
fn plans_that_make_no_sense() {
    for (text, words) in [
        ("", &["step: missing"][..]),
        ("name = \"x\"\nstep = []", &["step"]),
        (
            "[[step]]\nfor_s = -1\nwrench = {}",
            &["step[0].for_s", "is -1", "above 0"],
        ),
        ("[[step]]\nfor_s = 0\nwrench = {}", &["step[0].for_s"]),
        ("[[step]]\nwrench = {}", &["step[0].for_s: missing"]),
        ("[[step]]\nfor_s = 1", &["step[0].wrench: missing"]),
        (
            "[[step]]\nfor_s = 1\nwrench = {}\nthrust_n = {}",
            &["step[0].thrust_n", "both given"],
        ),
        (
            "[[step]]\nfor_s = 1\nwrench = { surge = 1 }",
            &[
                "step[0].wrench.surge: unknown key",
                "did you mean `surge_n`",
            ],
        ),
        (
            "[[step]]\nfor_s = 1\nwrench = { surge_n = inf }",
            &["step[0].wrench.surge_n"],
        ),
        (
            "[[step]]\nfor_s = 1\nwrench = {}\nshape = \"sine\"",
            &["step[0].period_s: missing"],
        ),
        (
            "[[step]]\nfor_s = 1\nwrench = {}\nshape = \"chirp\"\nf0_hz = 1",
            &["step[0].f1_hz: missing"],
        ),
        (
            "[[step]]\nfor_s = 1\nwrench = {}\nperiod_s = 2",
            &["step[0].period_s", "shape = \"sine\" only"],
        ),
        (
            "[[step]]\nfor_s = 1\nwrench = {}\nshape = \"sin\"\nperiod_s = 1",
            &["step[0].shape", "did you mean `sine`"],
        ),
        (
            "[[step]]\nfor_s = 1\nwrench = {}\n[[step]]\nfor_s = 1\nshape = \"ramp\"\nthrust_n = { a = 1 }",
            &["step[1].shape", "ramp"],
        ),
        (
            "[[step]]\nfor_s = 1\nthrust_n = { \"a b\" = 1 }",
            &["step[0].thrust_n.a b"],
        ),
        (
            "[[step]]\nfor_s = 1\nwrench = {}\nfors = 2",
            &["step[0].fors: unknown key"],
        ),
    ] {
        tells(&Plan::from_toml(text, "p.toml").expect_err(text), words);
    }
    let unnamed = Plan::from_toml("[[step]]\nfor_s = 1\nwrench = {}", "plans/my-run.toml").unwrap();
    assert_eq!(
        (unnamed.name.as_str(), unnamed.duration_s()),
        ("my-run", 1.0)
    );
}

#[test]
fn targets_and_boards_that_make_no_sense() {
    let polygon = |points: &str| {
        format!(
            "name = \"t\"\n[[slab]]\nname = \"s\"\nshape = \"polygon\"\ntop_m = 0.1\npoints_m = {points}"
        )
    };
    Target::from_toml(
        &polygon("[[0, 0], [1, 0], [1, 1], [0.5, 0.2], [0, 1]]"),
        "t",
    )
    .unwrap();
    Target::from_toml(&polygon("[[0, 0], [1, 0], [0, 1]]"), "t").unwrap();
    for (points, word) in [
        ("[[0, 0], [1, 1], [1, 0], [0, 1]]", "meets side"),
        ("[[0, 0], [1, 0], [0.5, 0]]", "meets side"),
        ("[[0, 0], [0, 0], [1, 0], [1, 1]]", "meets side"),
        ("[[0, 0], [2, 0], [2, 1], [1, 0], [0, 1]]", "meets side"),
        ("[[0, 0], [1, 0]]", "3 to 1000 corners"),
        ("[[0, 0], [1, 0], [1]]", "points_m[2]"),
        ("[[0, 0], [1, 0], [1, nan]]", "points_m[2][1]"),
    ] {
        tells(
            &Target::from_toml(&polygon(points), "t").expect_err(points),
            &["slab[0].points_m", word],
        );
    }
    let target = include_str!("../../../targets/hexagons.toml");
    for (from, to, words) in [
        (
            "x0_m = 0.0\nx1_m",
            "x0_m = 9.0\nx1_m",
            &["slab[0].x1_m", "before its start"][..],
        ),
        (
            "name = \"hexagons\"\nshape",
            "name = \"board\"\nshape",
            &["slab[1].name", "twice"],
        ),
        (
            "side_m = 0.12",
            "width_m = 0.12",
            &["slab[1].side_m: missing", "slab[1].width_m: unknown"],
        ),
        (
            "shape = \"hexagon_chain\"",
            "shape = \"hexagons\"",
            &["slab[1].shape"],
        ),
    ] {
        assert!(target.contains(from), "{from}");
        tells(
            &Target::from_toml(&target.replace(from, to), "t").expect_err(to),
            words,
        );
    }
    let board = include_str!("../../../boards/wc-lines-50.toml");
    for (from, to, words) in [
        ("line_m = 0.002", "line_m = 0.06", &["line_m", "pitch"][..]),
        (
            "line_m = 0.002",
            "diameter_m = 0.002",
            &["line_m: missing", "diameter_m: unknown"],
        ),
        ("columns = 11", "columns = 1", &["columns", "from 2 to 200"]),
        ("height_m = 0.010", "height_m = 0", &["block[0].height_m"]),
    ] {
        assert!(board.contains(from), "{from}");
        tells(
            &Board::from_toml(&board.replacen(from, to, 1), "b").expect_err(to),
            words,
        );
    }
}
