//! Clean motion of every kind raises no fault; what is wrong is found at its own line, at any rate.

use super::*;
use std::f64::consts::{PI, TAU};

fn channel(name: &str, column: &str, unit: &str) -> String {
    format!("[motion.{name}]\ncolumn = \"{column}\"\nunit = \"{unit}\"\n")
}

fn map_of(channels: &[(&str, &str, &str)]) -> Map {
    let all: String = channels.iter().map(|(n, c, u)| channel(n, c, u)).collect();
    Map::from_toml(&format!("[time]\ncolumn = \"t\"\nunit = \"s\"\n{all}"), "m").unwrap()
}

/// A row for each k: t and what `at(t)` says, printed to a micro.
fn sampled(names: &str, rate_hz: f64, rows: usize, at: impl Fn(usize, f64) -> Vec<f64>) -> String {
    let mut out = format!("t,{names}\n");
    for k in 0..rows {
        let t = k as f64 / rate_hz;
        let cells: Vec<String> = at(k, t).iter().map(|v| format!("{v:.6}")).collect();
        out += &format!("{t:.4},{}\n", cells.join(","));
    }
    out
}

/// Even noise of 1 in sd, the same each time.
fn noise(k: usize, of: usize) -> f64 {
    let mut x = (k as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15)
        ^ (of as u64).wrapping_mul(0xD1B5_4A32_D192_ED03);
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((x ^ (x >> 31)) as f64 / u64::MAX as f64 - 0.5) * 12f64.sqrt()
}

fn faults(data: &Imported) -> Vec<&Finding> {
    data.findings
        .iter()
        .filter(|f| f.severity == Severity::Fault)
        .collect()
}

#[test]
fn fast_swings_at_low_rates_agree_with_their_own_rates() {
    let map = map_of(&[("phi_rad", "roll", "rad"), ("p_radps", "p", "rad/s")]);
    for (rate_hz, swing_hz) in [
        (20.0, 0.5),
        (10.0, 0.7),
        (50.0, 1.0),
        (20.0, 2.0),
        (10.0, 2.5),
        (4.0, 0.9),
        (200.0, 3.0),
    ] {
        let w = TAU * swing_hz;
        let text = sampled("roll,p", rate_hz, 2000, |_, t| {
            vec![0.17 * (w * t).sin(), 0.17 * w * (w * t).cos()]
        });
        let data = read(&text, &map);
        assert_eq!(
            kinds(&data, Severity::Warning),
            Vec::<&str>::new(),
            "{rate_hz} Hz, {swing_hz} Hz: {:?}",
            data.findings
        );
        // A sign or a unit that is wrong is still found.
        if swing_hz / rate_hz < 0.15 {
            for (key, kind) in [("sign = -1\nunit", "sign"), ("scale = 57.3\nunit", "units")] {
                let wrong = format!(
                    "[time]\ncolumn = \"t\"\nunit = \"s\"\n{}{}",
                    channel("phi_rad", "roll", "rad"),
                    channel("p_radps", "p", "rad/s").replace("unit", key)
                );
                let found = read(&text, &Map::from_toml(&wrong, "m").unwrap());
                assert!(
                    faults(&found).iter().any(|f| f.kind == kind),
                    "{rate_hz} {swing_hz} {kind}: {:?}",
                    found.findings
                );
            }
        }
    }
}

/// A way whose frequencies, attitude and sampling are drawn from `seed`.
fn random_motion(seed: usize, rate_hz: f64, noise_m: f64, in_tank: bool) -> String {
    let draw = |k: usize| 0.5 + noise(seed, k) / 12f64.sqrt();
    // Slow enough to be resolved, as fast as a vehicle swings.
    let fastest_hz = (rate_hz / 12.0).min(0.8);
    let sum = |c: usize, size: f64, t: f64| -> (f64, f64) {
        (0..3).fold((0.0, 0.0), |(x, v), i| {
            let w = TAU * fastest_hz * (0.1 + 0.9 * draw(10 * c + i));
            let (a, p) = (
                size * draw(10 * c + i + 100) / 3.0,
                TAU * draw(10 * c + i + 200),
            );
            (x + a * (w * t + p).sin(), v + a * w * (w * t + p).cos())
        })
    };
    sampled("x,y,z,roll,pitch,yaw,u,v,w,p,q,r", rate_hz, 1200, |k, t| {
        let s: Vec<(f64, f64)> = [0.8, 0.6, 0.2, 0.12, 0.1, 2.5]
            .iter()
            .enumerate()
            .map(|(c, a)| sum(c, *a, t))
            .collect();
        let (a, d) = ([s[3].0, s[4].0, s[5].0], [s[3].1, s[4].1, s[5].1]);
        let tank = [s[0].1, s[1].1, s[2].1];
        let v = if in_tank {
            tank
        } else {
            crate::attitude::to_body(a, tank)
        };
        let (sp, cp) = a[0].sin_cos();
        let (st, ct) = a[1].sin_cos();
        let rates = [
            d[0] - d[2] * st,
            d[1] * cp + d[2] * sp * ct,
            -d[1] * sp + d[2] * cp * ct,
        ];
        let mut row: Vec<f64> = (0..6)
            .map(|c| s[c].0 + if c < 3 { noise_m } else { 0.3 * noise_m } * noise(k, c))
            .collect();
        row.extend(v);
        row.extend(rates);
        row
    })
}

fn whole_map(frame: &str) -> Map {
    let names = [
        "x_m",
        "y_m",
        "z_m",
        "phi_rad",
        "theta_rad",
        "psi_rad",
        "u_mps",
        "v_mps",
        "w_mps",
        "p_radps",
        "q_radps",
        "r_radps",
    ];
    let columns = [
        "x", "y", "z", "roll", "pitch", "yaw", "u", "v", "w", "p", "q", "r",
    ];
    let mut toml = "[time]\ncolumn = \"t\"\nunit = \"s\"\n".to_owned();
    for (i, (name, column)) in names.iter().zip(columns).enumerate() {
        let unit = ["m", "rad", "m/s", "rad/s"][i / 3];
        toml += &channel(name, column, unit);
        if i / 3 == 2 {
            toml += &format!("frame = \"{frame}\"\n");
        }
    }
    Map::from_toml(&toml, "m").unwrap()
}

#[test]
fn random_motion_at_any_rate_has_no_fault_and_its_own_frame() {
    for (seed, rate_hz) in [2.0, 5.0, 10.0, 20.0, 50.0, 200.0, 1000.0]
        .into_iter()
        .enumerate()
    {
        for noise_m in [0.0, 0.0005, 0.003] {
            for (in_tank, frame) in [(false, "body"), (true, "tank")] {
                let text = random_motion(seed, rate_hz, noise_m, in_tank);
                let data = read(&text, &whole_map(frame));
                assert!(
                    faults(&data).is_empty(),
                    "{rate_hz} Hz, {noise_m} m, {frame}: {:?}",
                    data.findings
                );
            }
            if noise_m < 0.001 && rate_hz < 500.0 {
                let other = read(
                    &random_motion(seed, rate_hz, noise_m, true),
                    &whole_map("body"),
                );
                let is_said =
                    |f: &Finding| f.severity >= Severity::Warning && f.message.contains("frame");
                assert!(
                    other.findings.iter().any(is_said),
                    "{rate_hz} Hz, {noise_m} m: {:?}",
                    other.findings
                );
            }
        }
    }
}

#[test]
fn a_steady_circle_follows_itself() {
    let circle = |sign: f64| {
        sampled("x,y,yaw,u,r", 20.0, 1500, |k, t| {
            let psi = 0.3 * t;
            vec![
                psi.sin() + 1e-4 * noise(k, 0),
                -psi.cos() + 1e-4 * noise(k, 1),
                psi + 1e-4 * noise(k, 2),
                0.3,
                sign * 0.3 + 1e-4 * noise(k, 3),
            ]
        })
    };
    let map = map_of(&[
        ("x_m", "x", "m"),
        ("y_m", "y", "m"),
        ("psi_rad", "yaw", "rad"),
        ("r_radps", "r", "rad/s"),
    ]);
    let data = read(&circle(1.0), &map);
    assert_eq!(
        kinds(&data, Severity::Warning),
        Vec::<&str>::new(),
        "{:?}",
        data.findings
    );
    assert!(kinds(&read(&circle(-1.0), &map), Severity::Fault).contains(&"sign"));
}

#[test]
fn a_file_that_starts_under_way_has_no_jump() {
    let map = map_of(&[("x_m", "x", "m")]);
    for (rate_hz, speed) in [(200.0, 1.2), (1000.0, 2.0), (20.0, 3.0)] {
        let data = read(&sampled("x", rate_hz, 2000, |_, t| vec![speed * t]), &map);
        assert_eq!(
            kinds(&data, Severity::Warning),
            Vec::<&str>::new(),
            "{:?}",
            data.findings
        );
    }
}

/// x with something wrong from row `from` on.
fn spoilt(rate_hz: f64, noise_m: f64, wrong: impl Fn(usize) -> f64) -> Imported {
    let text = sampled("x", rate_hz, 1500, |k, t| {
        vec![1.0 + 0.3 * (0.3 * t).sin() + noise_m * noise(k, 0) + wrong(k)]
    });
    read(&text, &map_of(&[("x_m", "x", "m")]))
}

#[test]
fn a_spike_is_named_at_its_own_row_and_the_good_one_stays() {
    for (rate_hz, size, noise_m) in [
        (100.0, 0.012, 1e-4),
        (100.0, 0.018, 1e-4),
        (20.0, 0.4, 1e-3),
        (200.0, 0.03, 1e-4),
    ] {
        for sign in [-1.0, 1.0] {
            let data = spoilt(
                rate_hz,
                noise_m,
                |k| if k == 700 { sign * size } else { 0.0 },
            );
            let found = faults(&data);
            assert_eq!(found.len(), 1, "{rate_hz} {size}: {:?}", data.findings);
            assert_eq!((found[0].kind, found[0].line), ("outlier", Some(702)));
            assert!(
                data.motion[0][700].is_nan()
                    && data.motion[0][701].is_finite()
                    && data.motion[0][699].is_finite()
            );
        }
    }
}

#[test]
fn the_first_good_row_after_a_loss_is_no_outlier() {
    // 30 rows of exact zeros, then a teleport later.
    let text = sampled("x", 100.0, 1500, |k, t| {
        let lost = (400..430).contains(&k);
        vec![if lost {
            0.0
        } else {
            1.0 + 0.2 * t + 1e-4 * noise(k, 0) + if k >= 900 { 0.5 } else { 0.0 }
        }]
    });
    let data = read(&text, &map_of(&[("x_m", "x", "m")]));
    let found: Vec<(&str, Option<u64>)> = faults(&data).iter().map(|f| (f.kind, f.line)).collect();
    assert_eq!(
        found,
        [("zeros", Some(402)), ("teleport", Some(902))],
        "{:?}",
        data.findings
    );
    assert!(data.motion[0][430].is_finite());
}

#[test]
fn a_lost_body_takes_its_roll_with_it() {
    let text = sampled("x,roll", 100.0, 1500, |k, t| {
        let lost = (400..440).contains(&k);
        if lost {
            vec![0.0, 0.0]
        } else {
            vec![1.0 + 0.2 * t, 0.002 * (0.9 * t).sin() + 1e-4 * noise(k, 0)]
        }
    });
    let data = read(
        &text,
        &map_of(&[("x_m", "x", "m"), ("phi_rad", "roll", "rad")]),
    );
    for k in 400..440 {
        assert!(
            data.motion[0][k].is_nan() && data.motion[3][k].is_nan(),
            "row {k}: {:?}",
            data.findings
        );
    }
    assert!(data.motion[3][399].is_finite() && data.motion[3][440].is_finite());
}

#[test]
fn a_sudden_jump_at_a_low_rate_is_said() {
    for (rate_hz, size) in [(10.0, 0.8), (4.0, 3.0)] {
        for step in [false, true] {
            let data = spoilt(rate_hz, 1e-3, |k| {
                if k == 700 || (step && k > 700) {
                    size
                } else {
                    0.0
                }
            });
            let found: Vec<_> = data
                .findings
                .iter()
                .filter(|f| f.severity >= Severity::Warning)
                .map(|f| (f.kind, f.line))
                .collect();
            assert!(
                matches!(
                    found[..],
                    [("sudden_jump" | "outlier" | "teleport", Some(702))]
                ),
                "{rate_hz} {step}: {:?}",
                data.findings
            );
        }
    }
    for (rate_hz, degrees) in [(10.0, 60.0), (50.0, 15.0)] {
        let text = sampled("yaw", rate_hz, 1500, |k, t| {
            vec![20.0 * (0.2 * t).sin() + 0.05 * noise(k, 0) + if k >= 700 { degrees } else { 0.0 }]
        });
        let data = read(&text, &map_of(&[("psi_rad", "yaw", "deg")]));
        assert!(
            data.findings
                .iter()
                .any(|f| f.severity >= Severity::Warning && f.line == Some(702)),
            "{rate_hz}: {:?}",
            data.findings
        );
    }
}

#[test]
fn vigorous_motion_does_not_jump() {
    let map = map_of(&[("x_m", "x", "m"), ("phi_rad", "roll", "rad")]);
    for rate_hz in [2.0, 4.0, 10.0, 25.0, 100.0, 1000.0] {
        for noise_m in [0.0, 3e-4, 3e-3] {
            // Rest, a thrust that sets in, one that reverses; a release from 25 degrees.
            let text = sampled("x,roll", rate_hz, 1600, |k, t| {
                let end_s = 1600.0 / rate_hz;
                let (t1, t2) = (0.3 * end_s, 0.6 * end_s);
                let after = |from: f64| {
                    let s = (t - from).max(0.0);
                    1.5 * (s - 1.5 * (1.0 - (-s / 1.5).exp()))
                };
                let s = (t - t1).max(0.0);
                vec![
                    after(t1) - 2.0 * after(t2) + noise_m * noise(k, 0),
                    0.44 * (-0.2 * s).exp() * (4.0 * s).cos() + 0.3 * noise_m * noise(k, 1),
                ]
            });
            let data = read(&text, &map);
            // A channel at rest without noise has always the same value.
            let jumps: Vec<_> = kinds(&data, Severity::Warning)
                .into_iter()
                .filter(|k| *k != "stuck_channel")
                .collect();
            assert_eq!(
                jumps,
                Vec::<&str>::new(),
                "{rate_hz} Hz {noise_m} m: {:?}",
                data.findings
            );
        }
    }
}

#[test]
fn a_frozen_measurement_is_named_where_it_stops() {
    let text = sampled("x", 100.0, 1500, |k, t| {
        let held = if (600..660).contains(&k) { 6.0 } else { t };
        let at = if held == t { k } else { 600 };
        vec![0.8 * held + 1e-4 * noise(at, 0)]
    });
    let data = read(&text, &map_of(&[("x_m", "x", "m")]));
    let found = faults(&data);
    assert!(
        found.iter().any(|f| f.message.contains("from line 602 on")),
        "{:?}",
        data.findings
    );
}

/// Some in a hundred rows made the largest twentieth of all changes themselves, by which a jump was judged: a single spike
/// was said, two in a hundred rows were not.
#[test]
fn many_spikes_do_not_hide_each_other() {
    for (every, size_m) in [
        (300, 0.5),
        (50, 0.5),
        (20, 0.5),
        (16, 0.5),
        (50, -0.08),
        (50, 12.0),
    ] {
        // Not in step with the rows.
        let is_spike = |k: usize| k > 5 && (k * 31 + k / 7) % every == 7;
        assert!((0..900).any(is_spike), "{every}");
        let text = sampled("x", 25.0, 900, |k, t| {
            let spike_m = if is_spike(k) { size_m } else { 0.0 };
            vec![0.2 * t + 0.4 * (0.5 * t).sin() + 1.5e-4 * noise(k, 1) + spike_m]
        });
        let found = read(&text, &map_of(&[("x_m", "x", "m")]));
        let said = kinds(&found, Severity::Warning);
        let spikes = |kind: &&str| matches!(*kind, "outlier" | "sudden_jump" | "teleport");
        assert!(said.iter().any(spikes), "{every} {size_m}: {said:?}");
    }
}

/// A roll beyond 108 degrees was a fault of units, whatever turned the hull.
#[test]
fn a_hull_that_is_rolled_by_hand_has_no_fault_of_units() {
    let map = map_of(&[("phi_rad", "roll", "rad")]);
    let turn = |rad: f64| (rad + PI).rem_euclid(2.0 * PI) - PI;
    // Over and over at a turn in four seconds, wrapped or not; a turn and a half there and back.
    let over = |t: f64| 0.5 * PI * t;
    let back = |t: f64| 3.0 * PI * (0.3 * t).sin();
    let ways: [&dyn Fn(f64) -> f64; 3] = [&|t| turn(over(t)), &over, &back];
    for way in ways {
        let text = sampled("roll", 25.0, 1000, |k, t| vec![way(t) + 1e-3 * noise(k, 0)]);
        let data = read(&text, &map);
        assert!(faults(&data).is_empty(), "{:?}", data.findings);
        assert!(kinds(&data, Severity::Warning).contains(&"units"));
        assert!(data.motion[3].iter().all(|v| v.is_finite()));
    }
    // Ten degrees in two seconds, as radians.
    let text = sampled("roll", 25.0, 1000, |_, t| vec![10.0 * (PI * t).sin()]);
    assert_eq!(kinds(&read(&text, &map), Severity::Fault), ["units"]);
}

/// What moves faster than 15 m/s was a fault of units, and each of its steps one of jumps.
#[test]
fn a_ball_at_23_mps_is_no_fault_and_keeps_its_samples() {
    let map = map_of(&[("x_m", "x", "m"), ("u_mps", "u", "m/s")]);
    for rate_hz in [25.0, 100.0, 200.0] {
        let text = sampled("x,u", rate_hz, 1500, |k, t| {
            let phase = (t + 0.3).rem_euclid(2.0) - 1.0;
            vec![
                23.0 * phase.abs() + 1e-3 * noise(k, 0),
                23.0 * phase.signum() + 1e-2 * noise(k, 1),
            ]
        });
        let data = read(&text, &map);
        assert!(faults(&data).is_empty(), "{rate_hz}: {:?}", data.findings);
        assert!(kinds(&data, Severity::Warning).contains(&"units"));
        assert!(data.motion[0].iter().all(|v| v.is_finite()));
    }
}
