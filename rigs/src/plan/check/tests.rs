use super::*;

fn check(steps: &str) -> Result<(), RigError> {
    let rig = Rig::builtin("lshpi").unwrap_or_else(|e| panic!("{e}"));
    Plan::from_toml(steps, "test.toml")
        .unwrap_or_else(|e| panic!("{e}"))
        .check_against(&rig)
}

fn refused(steps: &str, words: &[&str]) {
    let message = check(steps).expect_err(steps).to_string();
    for word in words {
        assert!(message.contains(word), "no {word:?} in {message}");
    }
}

/// Six thrusters of a BlueROV2 turn it about every axis but pitch: plans that ask for that are refused, by their steps, with those
/// that it can run.
#[test]
fn builtin_plans_fit_the_builtin_rigs() {
    for name in Rig::builtin_names() {
        let rig = Rig::builtin(name).unwrap_or_else(|e| panic!("{e}"));
        for plan in Plan::builtin_names() {
            let plan = Plan::builtin(plan).unwrap_or_else(|e| panic!("{e}"));
            let fits = plan.check_against(&rig);
            let needs_pitch = ["mixed-6dof", "bluerov2-heavy-mixed"];
            if name == "bluerov2" && needs_pitch.contains(&plan.name.as_str()) {
                let said = fits.expect_err("pitch without a thruster").to_string();
                for words in [
                    "step[3].wrench",
                    "step[4].wrench",
                    "nothing makes pitch_nm",
                    "that it can run",
                    "bluerov2-mixed",
                ] {
                    assert!(said.contains(words), "no {words:?} in {said}");
                }
                assert!(!said.contains("bluerov2-heavy-mixed,"), "{said}");
            } else {
                fits.unwrap_or_else(|e| panic!("{name}: {e}"));
            }
        }
    }
}

#[test]
fn unknown_thruster_and_thrust_beyond_the_curve() {
    refused(
        "[[step]]\nfor_s = 1.0\nthrust_n = { h_fore_stb = 1.0 }",
        &[
            "test",
            "step[0].thrust_n.h_fore_stb",
            "did you mean `h_fore_stbd`",
        ],
    );
    refused(
        "[[step]]\nfor_s = 1.0\nwrench = {}\n\n[[step]]\nfor_s = 1.0\nthrust_n = { h_fore_stbd = 60 }",
        &[":5:", "step[1]", "60 N", "-39.9 to 51.5 N"],
    );
    // Half a period stays positive, a whole one reaches -45 N.
    let sine = |for_s: f64| {
        format!(
            "[[step]]\nfor_s = {for_s}\nshape = 'sine'\nperiod_s = 4.0\nthrust_n = {{ h_fore_stbd = 45.0 }}"
        )
    };
    check(&sine(1.9)).unwrap_or_else(|e| panic!("{e}"));
    refused(&sine(4.0), &["-45 N"]);
}

/// Four level thrusters at 45 deg, each within -39.9 .. 51.5 N: 4 * 51.5 cos 45 deg
/// = 145.7 N ahead and 112.9 N astern; sideways the two that push must not turn the
/// vehicle against the two that pull: 4 * 39.9 cos 45 deg = 112.9 N. Upright: 206 N
/// down, 159.6 N up.
#[test]
fn wrench_limits_are_those_of_the_layout() {
    let step = |wrench: &str| format!("[[step]]\nfor_s = 1.0\nwrench = {{ {wrench} }}");
    for (inside, outside) in [
        ("surge_n = 145", "surge_n = 147"),
        ("surge_n = -112", "surge_n = -114"),
        ("sway_n = 112", "sway_n = 114"),
        ("heave_n = 205", "heave_n = 207"),
        ("heave_n = -159", "heave_n = -161"),
    ] {
        check(&step(inside)).unwrap_or_else(|e| panic!("{inside}: {e}"));
        refused(&step(outside), &["step[0].wrench", "% of"]);
    }
}

#[test]
fn a_direction_nobody_can_push_is_named() {
    let mut rig = Rig::builtin("lshpi").unwrap_or_else(|e| panic!("{e}"));
    rig.thrusters.thrusters.retain(|t| t.name.starts_with("h_"));
    let plan = Plan::from_toml("[[step]]\nfor_s = 1.0\nwrench = { heave_n = 1.0 }", "p")
        .unwrap_or_else(|e| panic!("{e}"));
    let message = plan
        .check_against(&rig)
        .expect_err("no vertical thruster")
        .to_string();
    assert!(message.contains("no combination"), "{message}");
}

#[test]
fn jumps_and_fast_oscillations_are_refused() {
    let mut rig = Rig::builtin("lshpi").unwrap_or_else(|e| panic!("{e}"));
    rig.thrusters.max_slew_us_per_s = 1000.0;
    let on = |steps: &str| {
        let plan = Plan::from_toml(steps, "p").unwrap_or_else(|e| panic!("{e}"));
        plan.check_against(&rig).map_err(|e| e.to_string())
    };
    let jump = on("[[step]]\nfor_s = 1.0\nthrust_n = { v_aft_port = 51.5 }").expect_err("jump");
    assert!(
        jump.contains("v_aft_port would jump by 400 us") && jump.contains("allows 40 us"),
        "{jump}"
    );
    // Below the deadband's own jump nothing is possible at 1000 us/s; from above it a ramp is.
    rig.thrusters.max_slew_us_per_s = 2000.0;
    let on = |steps: &str| {
        let plan = Plan::from_toml(steps, "p").unwrap_or_else(|e| panic!("{e}"));
        plan.check_against(&rig).map_err(|e| e.to_string())
    };
    on("[[step]]\nfor_s = 4.0\nshape = 'ramp'\nthrust_n = { v_aft_port = 51.5 }")
        .unwrap_or_else(|e| panic!("{e}"));
    refused(
        "[[step]]\nfor_s = 4.0\nshape = 'sine'\nperiod_s = 0.05\nwrench = { surge_n = 1.0 }",
        &["period_s", "20 Hz", "12.5 Hz"],
    );
    refused("[[step]]\nfor_s = 0.01\nwrench = {}", &["for_s", "0.04 s"]);
}

#[test]
fn factor_ranges() {
    let step = |for_s, shape| PlanStep {
        for_s,
        load: StepLoad::ThrustN(vec![]),
        shape,
    };
    let near = |(a, b): (f64, f64), (c, d): (f64, f64)| {
        assert!(
            (a - c).abs() < 1e-12 && (b - d).abs() < 1e-12,
            "{a} {b} {c} {d}"
        );
    };
    let sine = |period_s, phase_rad| Shape::Sine {
        period_s,
        phase_rad,
    };
    near(factor_range(&step(1.0, sine(12.0, 0.0))), (0.0, 0.5));
    near(factor_range(&step(6.0, sine(12.0, 0.0))), (0.0, 1.0));
    near(factor_range(&step(9.0, sine(12.0, 0.0))), (-1.0, 1.0));
    near(
        factor_range(&step(1.0, sine(12.0, FRAC_PI_2))),
        ((TAU / 3.0).sin(), 1.0),
    );
    near(
        factor_range(&step(1.0, sine(12.0, -FRAC_PI_2))),
        (-1.0, -(TAU / 3.0).sin()),
    );
    near(
        factor_range(&step(
            1.0,
            Shape::Chirp {
                f0_hz: 0.0,
                f1_hz: 0.5,
            },
        )),
        (0.0, 1.0),
    );
}
