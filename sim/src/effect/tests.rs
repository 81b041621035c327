use super::*;
use crate::Real;
use crate::fixture::lshpi_rig;
use crate::model::{Model, ModelState};
use crate::trajectory::Trajectory;
use crate::vehicle::Hydrodynamics;
use fixtures::*;
use hydroline_rigs::PhysicsEntry;
use proptest::prelude::*;

pub(in crate::effect) mod fixtures;
mod registry;

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

/// Friction whose strength goes from half to one and a half with x, as such.
#[test]
fn a_number_that_varies_with_a_covariate_is_what_it_is_there() {
    let mut friction = CheckedEffect::typical(find("coulomb_friction").unwrap());
    friction.numbers[0] = 0.4;
    friction.trend = Some(Trend {
        parameter: 0,
        nothing: 0.0,
        along: 0,
        range: (-1.0, 1.0),
        shares: vec![-0.5, 0.0, 0.5],
    });
    let force = |x_m: f64, one: &CheckedEffect| {
        let effects = EffectStack::assemble(std::slice::from_ref(one), |_, _, v| v).unwrap();
        let model = Model {
            hydrodynamics: Hydrodynamics::new(&lshpi_rig().vehicle),
            effects,
        };
        let mut state = ModelState::at_rest([x_m, 0.0, 0.0, 0.0, 0.0, 0.0]);
        state.vehicle.nu[0] = 0.2;
        model.rate(0.0, 0.0, &state, &[0.0; 6]).vehicle.nu[0]
    };
    for (x_m, share) in [(-1.0, -0.5), (0.0, 0.0), (0.5, 0.25), (7.0, 0.5)] {
        let mut plain = CheckedEffect::typical(friction.info);
        plain.numbers[0] = 0.4 * (1.0 + share);
        let (changed, plain) = (force(x_m, &friction), force(x_m, &plain));
        assert!((changed - plain).abs() < 1e-12, "{x_m}: {changed} {plain}");
    }
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

/// Every effect, and every one that acts on a DOF or an axis on each of them, at its typical values.
fn variants() -> Vec<CheckedEffect> {
    let mut all = Vec::new();
    for info in ALL {
        let typical = CheckedEffect::typical(info);
        let first = info.words.first().map_or(1, |w| w.allowed.len());
        for word in 0..first {
            let mut one = typical.clone();
            if let Some(w) = one.words.first_mut() {
                *w = word;
            }
            all.push(one);
        }
    }
    all
}

/// Poses that a measurement would report of a shaken run in all six DOFs.
fn reported<T: Real>(
    effects: &[CheckedEffect],
    lift: impl FnMut(usize, usize, f64) -> T,
) -> Vec<[T; 6]> {
    let mut vehicle = lshpi_rig().vehicle;
    // The coupled model has the terms that `added_mass_coupling` adds to this one.
    vehicle.model = hydroline_rigs::VehicleModel::Decoupled;
    let model = Model::assemble(Hydrodynamics::new(&vehicle), effects, lift).unwrap();
    let start = [0.19, 0.0, -0.83, 0.05, -0.04, 0.1].map(T::from_f64);
    // Rudder and elevator swing through the run, the shaft turns both ways, and waves pass.
    let swing = |size: f64, speed: f64| {
        let knots = (0..80).map(|k| 0.1 * f64::from(k)).map(|t| {
            let (sin, cos) = (speed * t).sin_cos();
            (t, size * sin, size * speed * cos)
        });
        Some(crate::given::Curve::new(&knots.collect::<Vec<_>>()))
    };
    let beside = crate::Given {
        companions: [
            swing(0.3, 1.0),
            swing(0.3, 1.0),
            swing(60.0, 0.8),
            swing(0.02, 2.0),
        ],
        ..crate::Given::default()
    };
    let mut path = Trajectory::new(model, ModelState::at_rest(start), 0.01)
        .unwrap()
        .beside(beside);
    let mut poses = Vec::new();
    for (k, share) in [1.0, -2.2, 1.6, -1.2].into_iter().enumerate() {
        let wrench = [8.0, -5.3, 3.0, 0.6, 0.7, 1.0].map(|x: f64| T::from_f64(x * share));
        // Off the grid and off the queries.
        path.command(T::from_f64(k as f64 * 1.5137 + 0.0031), wrench)
            .unwrap();
    }
    for i in 0..120 {
        let stamp_s = T::from_f64(f64::from(i) * 0.05 + 0.0077);
        let t_s = path.model().effects.scene_time_s(stamp_s, 0.0);
        let eta = path.state_at(t_s).unwrap().vehicle.eta;
        let effects = &path.model().effects;
        poses.push(effects.reported_pose(t_s, effects.scene_pose(t_s, eta)));
    }
    poses
}

/// Effects that images alone show: a measured pose is that of row 0, and optics move no vehicle.
fn image_only(info: &EffectInfo) -> bool {
    let pose = ["position_scale", "attitude_disturbance"];
    (info.stage == Stage::Measurement && !pose.contains(&info.id))
        || ["rolling_shutter", "interlace"].contains(&info.id)
}

#[test]
fn every_motion_level_effect_changes_the_motion() {
    let plain = reported::<f64>(&[], |_, _, v| v);
    for info in ALL.iter().filter(|i| !image_only(i)) {
        let with = reported::<f64>(&[CheckedEffect::typical(info)], |_, _, v| v);
        let largest = with
            .iter()
            .flatten()
            .zip(plain.iter().flatten())
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        // A hundredth of a millimetre or of a milliradian.
        assert!(largest > 1e-5, "{}: {largest}", info.id);
    }
}

#[test]
fn every_image_level_effect_changes_the_image() {
    let picture = |effect: Option<&'static EffectInfo>| {
        let mut rig = lshpi_rig();
        rig.physics = effect
            .map(|i| CheckedEffect::typical(i).entry())
            .into_iter()
            .collect();
        let mut world = crate::World::new(&rig, rig.tank.start_pose).unwrap();
        let ahead = hydroline_rigs::Wrench {
            surge_n: 16.0,
            ..Default::default()
        };
        world.command(0.0, &ahead).unwrap();
        let renderer = crate::Renderer::new(&rig).unwrap();
        let poses = world.frame_poses(3.0, renderer.height_px()).unwrap();
        let image = renderer.render_frame(&poses, 0).0;
        (image, renderer.profile_truth(&poses))
    };
    let (plain, line) = picture(None);
    // These change how bright the stripe is, not where.
    let bright = [
        "backscatter_haze",
        "image_saturation",
        "speckle",
        "attenuation",
        "line_profile",
        "lens_shading",
        "ambient_gradient",
        "mains_banding",
        "tone_curve",
        "range_clipping",
    ];
    for info in ALL.iter().filter(|i| image_only(i)) {
        let (image, moved) = picture(Some(info));
        let differ = image.iter().zip(&plain).filter(|(a, b)| a != b).count();
        assert!(differ > 200, "{}: {differ} pixels", info.id);
        assert_eq!(moved == line, bright.contains(&info.id), "{}", info.id);
    }
}

/// At the stiff end of its limits each law stays inside RK4's region of stability on the simulator's grid.
#[test]
fn stiff_limits_stay_stable() {
    type Stiff<'a> = (&'a str, &'a [(&'a str, f64)], &'a str);
    let stiff: [Stiff<'_>; 11] = [
        ("thruster_lag", &[("lag_s", 0.005)], "surge"),
        ("linear_damping", &[("coefficient", -1000.0)], "roll"),
        ("quadratic_damping", &[("coefficient", -1e4)], "roll"),
        ("cubic_damping", &[("d3", 1e5)], "surge"),
        ("astern_drag", &[("gain", 20.0)], "surge"),
        ("lift_damping", &[("c", 1000.0)], "roll"),
        ("coulomb_friction", &[("f_n", 50.0)], "surge"),
        (
            "fluid_memory",
            &[("gain_nspm", 1000.0), ("tau_s", 0.02)],
            "roll",
        ),
        (
            "tether_spring",
            &[("stiffness_npm", 1e4), ("slack_m", 0.0)],
            "",
        ),
        (
            "wall_added_mass",
            &[("gain", 10.0), ("wall_x_m", 0.1), ("length_m", 0.02)],
            "",
        ),
        ("nonlinear_restoring", &[("k3_nmprad3", 1e4)], "roll"),
    ];
    for (id, numbers, dof) in stiff {
        let mut one = entry(id, numbers);
        if !dof.is_empty() {
            one = with_word(one, "dof", dof);
        }
        let model = Model {
            hydrodynamics: Hydrodynamics::new(&lshpi_rig().vehicle),
            effects: EffectStack::build(&[one]).unwrap(),
        };
        let start = [0.05, 0.0, -0.83, 0.2, 0.0, 0.0];
        let mut path = Trajectory::new(model, ModelState::at_rest(start), 0.005).unwrap();
        path.command(0.0, [8.0, 0.0, 0.0, 0.3, 0.0, 0.0]).unwrap();
        path.command(2.0, [-8.0, 0.0, 0.0, -0.3, 0.0, 0.0]).unwrap();
        let mut last = [0.0; 6];
        for i in 0..1000 {
            let nu = path.state_at(f64::from(i) * 0.005).unwrap().vehicle.nu;
            let jump = nu[0].abs().max(nu[3].abs());
            assert!(jump < 1.5, "{id}: {nu:?}");
            last = nu;
        }
        assert!(last[0].abs() < 0.3, "{id}: {last:?}");
    }
}

/// The duals' derivative of the reported poses with respect to every parameter of every effect in every
/// DOF is that of central differences: delays, kinks and clamps included.
#[test]
fn sensitivities_are_exact() {
    use crate::Dual;
    let (mut checked, mut worst) = (0, (0.0, String::new()));
    // A table is linear in its points: `along` shows that; of a written force `form` shows it piece by piece.
    let asked = |e: &&CheckedEffect| !image_only(e.info) && !e.info.is_written();
    for effect in variants().iter().filter(asked) {
        let count = effect.numbers.len();
        assert!(count <= 5, "{}: widen the dual", effect.info.id);
        let dual =
            reported::<Dual<5>>(std::slice::from_ref(effect), |_, p, v| Dual::variable(v, p));
        for (p, info) in effect.info.parameters.iter().enumerate() {
            let h = 1e-5 * (info.plausible.1 - info.plausible.0);
            let at = |by: f64| {
                let lift = |_: usize, q: usize, v: f64| if q == p { v + by } else { v };
                reported::<f64>(std::slice::from_ref(effect), lift)
            };
            let (up, down) = (at(h), at(-h));
            let (mut largest, mut off) = (0.0f64, 0.0f64);
            for (d, (a, b)) in dual.iter().zip(up.iter().zip(&down)) {
                for c in 0..6 {
                    let numeric = (a[c] - b[c]) / (2.0 * h);
                    largest = largest.max(numeric.abs());
                    off = off.max((numeric - d[c].slope[p]).abs());
                }
            }
            // Rounding of a pose (1e-16) over the step, and what the step itself leaves.
            let floor = 4e-15 / h;
            let share = (off - floor).max(0.0) / largest.max(1e-12);
            // Where a step spans the kink of a tether that becomes taut, both differ by the step's own error.
            let allowed = if effect.info.id == "tether_spring" {
                1e-3
            } else {
                2e-5
            };
            assert!(
                share < allowed,
                "{} {:?}.{}: off by {off:.2e} of {largest:.2e}",
                effect.info.id,
                effect.words,
                info.name
            );
            if share > worst.0 && allowed < 1e-4 {
                worst = (share, format!("{}.{}", effect.info.id, info.name));
            }
            checked += usize::from(largest > 0.0);
        }
    }
    println!("{checked} sensitivities, worst {worst:?}");
    assert!(checked > 80, "{checked}");
}

#[test]
fn every_effect_round_trips_through_a_rig_file() {
    let rig = lshpi_rig();
    for effect in variants() {
        let mut text = rig.effective_toml.clone();
        let _ = std::fmt::Write::write_fmt(
            &mut text,
            format_args!("\n[[physics]]\neffect = \"{}\"\n", effect.info.id),
        );
        for (name, value) in effect.entry().parameters {
            let value = match value {
                hydroline_rigs::ParameterValue::Number(v) => format!("{v:e}"),
                hydroline_rigs::ParameterValue::Word(w) => format!("\"{w}\""),
            };
            text += &format!("{name} = {value}\n");
        }
        let read = hydroline_rigs::Rig::from_toml(&text, "with.toml", None).unwrap();
        let again =
            hydroline_rigs::Rig::from_toml(&read.effective_toml, "again.toml", None).unwrap();
        for r in [&read, &again] {
            let back = check(&r.physics).unwrap();
            assert_eq!(back, std::slice::from_ref(&effect), "{text}");
        }
    }
}

#[test]
fn the_table_names_every_effect_with_its_parameters() {
    let table = markdown_table();
    for info in ALL {
        let line = table
            .lines()
            .find(|l| l.starts_with(&format!("| `{}` |", info.id)))
            .unwrap_or_else(|| panic!("{} is missing", info.id));
        for p in info.parameters {
            assert!(line.contains(&format!("`{}`", p.name)), "{line}");
        }
    }
}

proptest! {
    #[test]
    fn any_entry_gives_a_stack_or_an_error(effect in "[a-z_]{0,12}|thruster_lag|current", name in "[a-z_]{0,8}|lag_s|vx_mps|dof", value in proptest::num::f64::ANY) {
        let _ = EffectStack::build(&[entry(&effect, &[(&name, value)])]);
        let _ = EffectStack::build(&[with_word(entry(&effect, &[]), &name, &effect)]);
    }
}
