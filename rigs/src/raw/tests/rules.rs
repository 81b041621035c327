//! Rules between several keys of a rig.

use toml::Value;

use super::{changed, full_rig, tells};
use crate::{ParameterValue, PhysicsEntry, Rig};

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
            "shadows = false",
            "shadows = false\norientation = \"vertical\"",
            &[
                "laser.orientation",
                "along the image's rows",
                "Turn the camera",
            ],
        ),
        (
            "shadows = false",
            "shadows = false\norientation = \"upright\"",
            &["laser.orientation", "horizontal", "vertical"],
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
fn a_frame_beyond_what_a_log_holds_is_refused_where_the_rig_is_read() {
    let of = |side_px: i64, format: &str| {
        let mut table = full_rig("lshpi");
        for key in ["width_px", "height_px"] {
            table["camera"][key] = Value::Integer(side_px);
        }
        table["camera"]["pixel_format"] = Value::String(format.into());
        Rig::from_toml(&table.to_string(), "a", None)
    };
    for (side_px, format) in [(8192, "GREY"), (4096, "RGB24"), (8192, "MJPG")] {
        assert!(of(side_px, format).is_ok(), "{side_px} {format}");
    }
    for (side_px, format, bytes) in [
        (8194, "GREY", "67141636"),
        (8192, "YUYV", "134217728"),
        (16384, "MJPG", "268435456"),
    ] {
        let error = of(side_px, format).expect_err(format);
        tells(&error, &["camera.height_px", format, bytes, "67108864"]);
    }
}

#[test]
fn a_colour_cameras_keys_are_held_against_its_format() {
    let with = |edits: &[(&str, &str, Value)]| {
        let mut table = full_rig("lshpi");
        for (section, key, value) in edits {
            table[*section]
                .as_table_mut()
                .unwrap()
                .insert((*key).to_owned(), value.clone());
        }
        Rig::from_toml(&table.to_string(), "a", None)
    };
    let word = |text: &str| Value::String(text.to_owned());
    let rig = with(&[
        ("camera", "pixel_format", word("GBRG16")),
        ("camera", "bits", Value::Integer(12)),
        ("laser", "channel", word("green")),
    ])
    .unwrap();
    let rule = rig.grey_rule();
    assert_eq!((rule.channel, rule.bits), (crate::Channel::Green, Some(12)));
    let again = Rig::from_toml(&rig.to_toml(), "b", None).unwrap();
    assert_eq!(again.grey_rule(), rule);
    assert_eq!(again.camera, rig.camera);
    let full = with(&[
        ("camera", "pixel_format", word("NV12")),
        ("camera", "yuv_range", word("full")),
    ])
    .unwrap();
    assert_eq!(full.grey_rule().yuv_range, crate::YuvRange::Full);
    // A rig that says none of them is the same text as before there were any.
    let plain = with(&[]).unwrap().to_toml();
    for key in ["bits", "yuv_range", "channel = \"luma"] {
        assert!(!plain.contains(key), "{key}");
    }
    for (edits, words) in [
        (
            vec![("laser", "channel", word("green"))],
            vec!["laser.channel", "GREY", "Leave out `channel`"],
        ),
        (
            vec![("laser", "channel", word("infrared"))],
            vec!["laser.channel", "red", "luma"],
        ),
        (
            vec![("camera", "bits", Value::Integer(12))],
            vec!["camera.bits", "GREY have 8 bits"],
        ),
        (
            vec![("camera", "bits", Value::Integer(17))],
            vec!["camera.bits", "8", "16"],
        ),
        (
            vec![("camera", "yuv_range", word("full"))],
            vec!["camera.yuv_range", "only YUYV, UYVY and NV12"],
        ),
        (
            vec![
                ("camera", "pixel_format", word("NV12")),
                ("camera", "height_px", Value::Integer(481)),
            ],
            vec!["camera.height_px", "481 is odd", "pairs of rows"],
        ),
        (
            vec![("camera", "pixel_format", word("Y14"))],
            vec!["camera.pixel_format", "RGGB10", "UYVY"],
        ),
    ] {
        tells(&with(&edits).expect_err("refused"), &words);
    }
}

#[test]
fn physics_entries_keep_their_order_and_kinds() {
    let text = format!(
        "{}\n[[physics]]\neffect = \"thruster_lag\"\nlag_s = 0.25\n\n[[physics]]\neffect = \"cubic_damping\"\nd3 = 40\ndof = \"surge\"\na_b-c = -1e-3\n",
        include_str!("../../../lshpi.toml")
    );
    let rig = Rig::from_toml(&text, "my.toml", None).unwrap();
    let number = |name: &str, value| (name.to_owned(), ParameterValue::Number(value));
    let want = [
        PhysicsEntry {
            effect: "thruster_lag".into(),
            parameters: vec![number("lag_s", 0.25)],
        },
        PhysicsEntry {
            effect: "cubic_damping".into(),
            parameters: vec![
                number("d3", 40.0),
                ("dof".into(), ParameterValue::Word("surge".into())),
                number("a_b-c", -1e-3),
            ],
        },
    ];
    assert_eq!(rig.physics, want);
    assert_eq!(Rig::from_toml(&rig.effective_toml, "e", None).unwrap(), rig);
    for (wrong, words) in [
        ("effect = 3", &["physics[2].effect"][..]),
        ("lag_s = 1", &["physics[2].effect: missing"]),
        ("effect = \"x\"\nlag_s = nan", &["physics[2].lag_s", "nan"]),
        (
            "effect = \"x\"\non = true",
            &["physics[2].on", "a number or a word"],
        ),
        (
            "effect = \"x\"\n\"a b\" = 1",
            &["physics[2].a b", "parameter name"],
        ),
    ] {
        let error = Rig::from_toml(&format!("{text}[[physics]]\n{wrong}\n"), "my.toml", None);
        tells(&error.expect_err(wrong), words);
    }
}
