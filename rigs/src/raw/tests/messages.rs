//! Messages for a person.

use toml::Value;

use super::{Step, at, changed, full_rig, leaves, tells};
use crate::{ProblemKind, Rig};

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

/// Every key omitted: a default, or an error that names it. Every key misspelt: refused.
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
