use super::*;
use crate::fixture::lshpi_rig;
use crate::model::{Model, ModelState};
use crate::trajectory::Trajectory;
use crate::vehicle::Hydrodynamics;
use hydroline_rigs::{ParameterValue, PhysicsEntry};
use proptest::prelude::*;

fn entry(effect: &str, parameters: &[(&str, f64)]) -> PhysicsEntry {
    let numbers = parameters
        .iter()
        .map(|(n, v)| ((*n).to_owned(), ParameterValue::Number(*v)));
    PhysicsEntry {
        effect: effect.to_owned(),
        parameters: numbers.collect(),
    }
}

fn with_word(mut e: PhysicsEntry, name: &str, word: &str) -> PhysicsEntry {
    e.parameters
        .push((name.to_owned(), ParameterValue::Word(word.to_owned())));
    e
}

/// Surge alone, without drag: M u' = thrust, so u shows the thrust's integral.
fn frictionless(entries: &[PhysicsEntry]) -> (Trajectory, f64) {
    let mut v = lshpi_rig().vehicle;
    for c in &mut v.coefficients {
        (c.linear, c.quadratic) = (0.0, 0.0);
    }
    let hydrodynamics = Hydrodynamics::new(&v);
    let mass = hydrodynamics.mass()[0];
    let model = Model {
        hydrodynamics,
        effects: EffectStack::build(entries).unwrap(),
    };
    (
        Trajectory::new(model, ModelState::at_rest([0.0; 6]), 0.005).unwrap(),
        mass,
    )
}

fn surge(x_n: f64) -> [f64; 6] {
    [x_n, 0.0, 0.0, 0.0, 0.0, 0.0]
}

#[test]
fn lag_is_the_exact_exponential_response() {
    let lag_s = 0.25;
    let (mut r, mass) = frictionless(&[entry("thruster_lag", &[("lag_s", lag_s)])]);
    r.command(0.3, surge(8.0)).unwrap();
    for t_s in [0.1f64, 0.3, 0.5, 1.0, 4.0] {
        // X(t) = 8 (1 - e^(-t/lag)); M u = its integral.
        let since = (t_s - 0.3).max(0.0);
        let impulse = 8.0 * (since - lag_s * (1.0 - (-since / lag_s).exp()));
        let state = r.state_at(t_s).unwrap();
        // RK4 on a 5 ms grid: (h/lag)^4/120 per e-fold.
        assert!(
            (state.vehicle.nu[0] * mass - impulse).abs() < 1e-7,
            "t = {t_s}"
        );
        assert!((state.own[0] - 8.0 * (1.0 - (-since / lag_s).exp())).abs() < 1e-7);
    }
}

#[test]
fn deadband_subtracts_with_the_sign() {
    for (x_n, expected) in [
        (0.3, 0.0),
        (-0.3, 0.0),
        (4.0, 3.6),
        (-4.0, -3.6),
        (0.4, 0.0),
    ] {
        let (mut r, mass) = frictionless(&[entry("thruster_deadband", &[("width_n", 0.4)])]);
        r.command(0.0, surge(x_n)).unwrap();
        assert!((r.state_at(2.0).unwrap().vehicle.nu[0] * mass / 2.0 - expected).abs() < 1e-12);
    }
}

#[test]
fn asymmetry_acts_astern_only() {
    for (x_n, expected) in [(4.0, 4.0), (-4.0, -3.2)] {
        let (mut r, mass) = frictionless(&[entry("thrust_asymmetry", &[("reverse_gain", 0.8)])]);
        r.command(0.0, surge(x_n)).unwrap();
        assert!((r.state_at(2.0).unwrap().vehicle.nu[0] * mass / 2.0 - expected).abs() < 1e-12);
    }
}

#[test]
fn thruster_effects_act_in_their_order_whatever_the_file_says() {
    // Deadband, then asymmetry, then lag: (-4 + 0.4) 0.8 = -2.88 at rest of the lag.
    let entries = [
        entry("thruster_lag", &[("lag_s", 0.1)]),
        entry("thrust_asymmetry", &[("reverse_gain", 0.8)]),
        entry("thruster_deadband", &[("width_n", 0.4)]),
    ];
    let ids: Vec<&str> = EffectStack::build(&entries)
        .unwrap()
        .infos()
        .map(|i| i.id)
        .collect();
    assert_eq!(
        ids,
        ["thruster_deadband", "thrust_asymmetry", "thruster_lag"]
    );
    let (mut r, _) = frictionless(&entries);
    r.command(0.0, surge(-4.0)).unwrap();
    assert!((r.state_at(6.0).unwrap().own[0] + 2.88).abs() < 1e-9);
}

#[test]
fn a_vehicle_adrift_takes_the_velocity_of_the_current() {
    let model = Model {
        hydrodynamics: Hydrodynamics::new(&lshpi_rig().vehicle),
        effects: EffectStack::build(&[entry("current", &[("vx_mps", 0.02), ("vy_mps", -0.01)])])
            .unwrap(),
    };
    let psi = 0.7;
    let mut r = Trajectory::new(
        model,
        ModelState::at_rest([0.0, 0.0, 0.0, 0.0, 0.0, psi]),
        0.02,
    )
    .unwrap();
    let state = r.state_at(400.0).unwrap().vehicle;
    // Tank-frame velocity = current. Eq. 1's u v terms (Munk moment) turn the hull meanwhile, so use its own psi.
    let (sin, cos) = state.eta[5].sin_cos();
    let (vx, vy) = (
        cos * state.nu[0] - sin * state.nu[1],
        sin * state.nu[0] + cos * state.nu[1],
    );
    let slip = (vx - 0.02).hypot(vy + 0.01);
    assert!(slip < 2e-4, "slip {slip}: {vx} {vy}");
}

#[test]
fn terminal_velocity_in_a_current_is_shifted_by_it() {
    let model = Model {
        hydrodynamics: Hydrodynamics::new(&lshpi_rig().vehicle),
        effects: EffectStack::build(&[entry("current", &[("vx_mps", 0.01)])]).unwrap(),
    };
    let mut r = Trajectory::new(model, ModelState::at_rest([0.0; 6]), 0.005).unwrap();
    r.command(0.0, surge(8.0)).unwrap();
    // X = 20 u_r + 200 u_r^2
    let u_r = (-20.0 + (400.0f64 + 4.0 * 200.0 * 8.0).sqrt()) / 400.0;
    let u = r.state_at(300.0).unwrap().vehicle.nu[0];
    assert!((u - u_r - 0.01).abs() < 1e-12, "{u} against {}", u_r + 0.01);
}

#[test]
fn dof_words_move_a_thruster_effect() {
    let yaw = with_word(
        entry("thruster_deadband", &[("width_n", 0.4)]),
        "dof",
        "yaw",
    );
    let (mut r, mass) = frictionless(&[yaw]);
    r.command(0.0, [4.0, 0.0, 0.0, 0.0, 0.0, 0.3]).unwrap();
    let state = r.state_at(2.0).unwrap().vehicle;
    assert!((state.nu[0] * mass / 2.0 - 4.0).abs() < 1e-12 && state.nu[5] == 0.0);
}

#[test]
fn entries_are_checked_with_errors_one_can_act_on() {
    let refuse = |e: PhysicsEntry| EffectStack::build(&[e]).unwrap_err();
    let unknown = refuse(entry("thruster_lagg", &[]));
    assert!(
        unknown
            .to_string()
            .contains("did you mean \"thruster_lag\"")
            && unknown.to_string().contains("current")
    );
    assert!(matches!(
        refuse(entry("poltergeist", &[])),
        EffectError::UnknownEffect { nearest: None, .. }
    ));
    let missing = refuse(entry("thruster_lag", &[]));
    assert!(
        matches!(
            missing,
            EffectError::Missing {
                parameter: "lag_s",
                ..
            }
        ),
        "{missing}"
    );
    let name = refuse(entry("thruster_lag", &[("lag_ms", 3.0)]));
    assert!(
        name.to_string().contains("did you mean \"lag_s\""),
        "{name}"
    );
    for bad in [f64::NAN, f64::INFINITY, -1.0, 0.0, 31.0] {
        let e = refuse(entry("thruster_lag", &[("lag_s", bad)]));
        assert!(
            matches!(
                e,
                EffectError::OutOfLimits {
                    parameter: "lag_s",
                    ..
                }
            ),
            "{e}"
        );
    }
    let word = refuse(with_word(
        entry("thruster_lag", &[("lag_s", 0.2)]),
        "dof",
        "sideways",
    ));
    assert!(word.to_string().contains("surge, sway"), "{word}");
    let kind = refuse(with_word(entry("thruster_lag", &[]), "lag_s", "long"));
    assert!(matches!(kind, EffectError::WrongKind { .. }));
    let twice = refuse(entry("thruster_lag", &[("lag_s", 0.2), ("lag_s", 0.3)]));
    assert!(matches!(twice, EffectError::Repeated { .. }));
    let lag = || entry("thruster_lag", &[("lag_s", 0.2)]);
    assert!(matches!(
        EffectStack::build(&[lag(), lag()]),
        Err(EffectError::Duplicate { .. })
    ));
    assert!(EffectStack::build(&[lag(), with_word(lag(), "dof", "yaw")]).is_ok());
}

#[test]
fn the_implausible_is_allowed_with_a_note() {
    let stack = EffectStack::build(&[entry("thruster_lag", &[("lag_s", 2.0)])]).unwrap();
    assert_eq!(stack.notes().len(), 1);
    assert!(
        stack.notes()[0].contains("0.05 .. 0.5"),
        "{:?}",
        stack.notes()
    );
    assert!(
        EffectStack::build(&[entry("thruster_lag", &[("lag_s", 0.2)])])
            .unwrap()
            .notes()
            .is_empty()
    );
}

#[test]
fn the_registry_is_consistent() {
    let mut ids: Vec<&str> = ALL.iter().map(|i| i.id).collect();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), ALL.len(), "ids are unique");
    for info in ALL {
        assert_eq!(find(info.id), Some(*info));
        assert!(!info.law.is_empty() && !info.source.is_empty() && !info.kin.contains(&info.id));
        for p in info.parameters {
            assert!(
                p.limits.0 <= p.plausible.0
                    && p.plausible.0 < p.plausible.1
                    && p.plausible.1 <= p.limits.1
            );
            assert!(
                (p.plausible.0..=p.plausible.1).contains(&p.typical),
                "{} {}",
                info.id,
                p.name
            );
        }
        // Every law builds at its typical values.
        let numbers: Vec<(&str, f64)> = info
            .parameters
            .iter()
            .map(|p| (p.name, p.typical))
            .collect();
        assert!(EffectStack::build(&[entry(info.id, &numbers)]).is_ok());
    }
}

proptest! {
    #[test]
    fn any_entry_gives_a_stack_or_an_error(effect in "[a-z_]{0,12}|thruster_lag|current", name in "[a-z_]{0,8}|lag_s|vx_mps|dof", value in proptest::num::f64::ANY) {
        let _ = EffectStack::build(&[entry(&effect, &[(&name, value)])]);
        let _ = EffectStack::build(&[with_word(entry(&effect, &[]), &name, &effect)]);
    }
}
