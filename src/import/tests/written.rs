//! Meanings that the guess finds in names and in the units beside them.

use crate::guess::{Guess, guess};

/// 400 rows at 50 Hz: t, and as many columns of slow swings as there are names.
fn swings(names: &str) -> String {
    let columns = names.split(',').count();
    let row = |k: usize| -> String {
        let t = 0.02 * k as f64;
        (0..columns)
            .map(|c| {
                format!(
                    ",{:.5}",
                    0.4 * ((0.7 + 0.13 * c as f64) * t + c as f64).sin()
                )
            })
            .collect()
    };
    let rows: String = (0..400)
        .map(|k| format!("{:.2}{}\n", 0.02 * k as f64, row(k)))
        .collect();
    format!("t,{names}\n{rows}")
}

fn guessed(text: &str) -> Guess {
    guess(text.as_bytes())
        .unwrap()
        .unwrap_or_else(|e| panic!("{e}"))
}

/// Table of the map, column and unit, in the order of the map; comments are none.
fn mapped(found: &Guess) -> Vec<String> {
    let (mut out, mut key) = (Vec::<String>::new(), String::new());
    for line in found.toml.lines() {
        if let Some(name) = line.strip_prefix("[motion.") {
            key = name.trim_end_matches(']').to_owned();
        } else if let Some(name) = line.strip_prefix("thruster = ") {
            key = format!("cmd {}", name.trim_matches('"'));
        } else if line.starts_with('[') {
            key.clear();
        } else if let Some(column) = line.strip_prefix("column = ") {
            if !key.is_empty() {
                out.push(format!("{key}: {}", column.trim_matches('"')));
            }
        } else if let (Some(unit), Some(last)) = (line.strip_prefix("unit = "), out.last_mut())
            && !key.is_empty()
        {
            *last += &format!(" {}", unit.trim_matches('"'));
        }
    }
    out
}

fn says(found: &Guess, words: &[&str]) -> bool {
    let said = |r: &String| words.iter().all(|w| r.contains(w));
    found.remarks.iter().any(said)
}

#[test]
fn a_written_unit_decides_what_a_name_means() {
    for (names, expected) in [
        ("Roll (deg/s)", vec!["p_radps: Roll (deg/s) deg/s"]),
        (
            "X (m/s),yaw [rad]",
            vec!["psi_rad: yaw [rad] rad", "u_mps: X (m/s) m/s"],
        ),
        ("x [m],x [m/s]", vec!["x_m: x [m] m", "u_mps: x [m/s] m/s"]),
        (
            "Heading [deg],Surge [N],Heave [N],Yaw [Nm]",
            vec![
                "psi_rad: Heading [deg] deg",
                "cmd surge: Surge [N] N",
                "cmd heave: Heave [N] N",
                "cmd yaw: Yaw [Nm] N m",
            ],
        ),
        ("x [m],yaw_cmd [deg]", vec!["x_m: x [m] m"]),
        (
            "x [m],F_surge",
            vec!["x_m: x [m] m", "cmd surge: F_surge N"],
        ),
        (
            "yaw [deg],x [m/s^2],z [mm/s²]",
            vec!["psi_rad: yaw [deg] deg"],
        ),
        (
            "Pos X (mm),Angle X (deg),Angle Y (deg)",
            vec!["x_m: Pos X (mm) mm"],
        ),
        ("x (mm),Rotation Z (deg)", vec!["x_m: x (mm) mm"]),
        ("x [m],surge_cmd [%]", vec!["x_m: x [m] m"]),
    ] {
        let found = guessed(&swings(names));
        assert_eq!(mapped(&found), expected, "{names}\n{}", found.toml);
        // A column that is not mapped is named in the remarks.
        for name in names.split(',') {
            let is_mapped = found.toml.contains(&format!("column = \"{name}\""));
            assert!(
                is_mapped || says(&found, &[name]),
                "{names}: {:?}",
                found.remarks
            );
        }
    }
}

#[test]
fn a_units_row_decides_between_columns_of_one_name() {
    let text = swings("x,y,x,y").replacen('\n', "\ns,m,m,mm/s,mm/s\n", 1);
    let found = guessed(&text);
    assert_eq!(
        mapped(&found),
        ["x_m: x m", "y_m: y m", "u_mps: x mm/s", "v_mps: y mm/s"],
        "{}",
        found.toml
    );
}

#[test]
fn angles_of_a_vicon_model_are_no_positions() {
    let mut text = "Model Outputs\n100\n,,AUV:Angles,,,AUV:Position,,\nFrame,Sub Frame,X,Y,Z,X,Y,Z\n,,deg,deg,deg,mm,mm,mm\n".to_owned();
    for k in 0..300 {
        let s = (0.02 * k as f64).sin();
        text += &format!(
            "{},0,{:.3},0.2,{:.3},{:.2},{:.2},-800.0\n",
            k + 1,
            3.0 * s,
            40.0 * s,
            900.0 * s,
            300.0 * s
        );
    }
    let found = guessed(&text);
    assert!(
        found.toml.contains("nth = 2") && found.toml.contains("unit = \"mm\""),
        "{}",
        found.toml
    );
    assert!(!found.toml.contains("nth = 1"), "{}", found.toml);
}

#[test]
fn velocities_to_the_north_are_rotated_by_the_heading() {
    let found = guessed(&swings("V_North [m/s],V_East [m/s],yaw [deg]"));
    assert!(
        found.toml.matches("frame = \"tank\"").count() == 2,
        "{}",
        found.toml
    );
    // Without a heading they are no velocities of the body.
    let found = guessed(&swings("V_North [m/s],V_East [m/s],z [m]"));
    assert_eq!(mapped(&found), ["z_m: z [m] m"]);
    assert!(says(&found, &["V_North", "heading"]), "{:?}", found.remarks);
}

#[test]
fn what_was_wished_for_and_how_uncertain_it_is_are_no_motion() {
    for (names, yaw, x) in [
        ("desired_yaw,yaw,x", "yaw", "x"),
        ("sigma_yaw,yaw,x", "yaw", "x"),
        ("ref_x,ref_y,x,y,yaw", "yaw", "x"),
        ("yaw_std,x_var,yaw_meas,x_meas", "yaw_meas", "x_meas"),
        ("x_soll,x_ist,yaw_sp,yaw", "yaw", "x_ist"),
    ] {
        let found = guessed(&swings(names));
        for (channel, column) in [("psi_rad", yaw), ("x_m", x)] {
            let start = format!("{channel}: {column} ");
            let own = mapped(&found);
            assert!(
                own.iter().any(|m| m.starts_with(&start)),
                "{names}\n{}",
                found.toml
            );
        }
    }
    // A wished-for load is the command.
    let found = guessed(&swings("x [m],tau_ref_surge [N]"));
    assert_eq!(
        mapped(&found),
        ["x_m: x [m] m", "cmd surge: tau_ref_surge [N] N"]
    );
}

#[test]
fn seventy_covariances_are_no_remarks() {
    let names: Vec<String> = (0..36)
        .map(|i| format!("field.pose.covariance{i}"))
        .collect();
    let found = guessed(&swings(&format!(
        "field.pose.position.x,{}",
        names.join(",")
    )));
    assert!(!says(&found, &["covariance"]), "{:?}", found.remarks);
}
