use super::*;
use crate::effect::EffectStack;
use crate::fixture::lshpi_rig;
use crate::vehicle::Hydrodynamics;
use hydroline_rigs::{AxisCoefficients, Vehicle, VehicleModel};

fn vehicle(surge: [f64; 3]) -> Vehicle {
    let mut v = lshpi_rig().vehicle;
    let [added, linear, quadratic] = surge;
    v.coefficients[0] = AxisCoefficients {
        added,
        linear,
        quadratic,
    };
    v
}

fn run(vehicle: &Vehicle, step_s: f64, wrench: [f64; 6]) -> Trajectory {
    let model = Model {
        hydrodynamics: Hydrodynamics::new(vehicle),
        effects: EffectStack::empty(),
    };
    let mut run = Trajectory::new(model, ModelState::at_rest([0.0; 6]), step_s).unwrap();
    run.command(0.0, wrench).unwrap();
    run
}

fn surge(x_n: f64) -> [f64; 6] {
    [x_n, 0.0, 0.0, 0.0, 0.0, 0.0]
}

/// Paper Table 11 from Table 10: greatest |dx| until the actual vehicle has gone 5 m, RK4 at 1 ms.
#[test]
fn table_11_comes_out() {
    let actual = vehicle([-250.0, -20.0, -200.0]);
    let identified = [
        ([-250.061, -20.0488, -199.512], [0.37, 1.05, 2.11]),
        ([-258.120, -18.8034, -208.059], [17.49, 17.13, 42.68]),
        ([-256.532, -18.9499, -212.454], [21.64, 55.54, 80.47]),
    ];
    for (parameters, expected_mm) in identified {
        for (x_n, expected) in [4.0, 8.0, 16.0].into_iter().zip(expected_mm) {
            let mut a = run(&actual, 0.001, surge(x_n));
            let mut b = run(&vehicle(parameters), 0.001, surge(x_n));
            let mut worst_mm = 0.0f64;
            for i in 0.. {
                let t_s = f64::from(i) * 0.001;
                let x = a.state_at(t_s).unwrap().vehicle.eta[0];
                worst_mm = worst_mm.max((x - b.state_at(t_s).unwrap().vehicle.eta[0]).abs() * 1e3);
                if x >= 5.0 {
                    break;
                }
            }
            // theory/geometry.md, the paper's tables, prints two decimals.
            assert!(
                (worst_mm - expected).abs() <= 0.005 + 1e-9,
                "{x_n} N: {worst_mm:.4} mm, expected {expected}"
            );
        }
    }
}

#[test]
fn fourth_order() {
    // Large loads in all DOFs, so that the error is far above rounding. No quadratic damping:
    // |p| p has a kink where the rolling turns back, and no method has order 4 across a kink.
    let mut v = lshpi_rig().vehicle;
    for c in &mut v.coefficients {
        c.quadratic = 0.0;
    }
    let end = |step_s: f64| {
        let mut r = run(&v, step_s, [30.0, 20.0, 10.0, 0.5, 0.8, 3.0]);
        r.state_at(3.2).unwrap().vehicle.eta
    };
    let exact = end(0.000_5);
    let error = |step_s: f64| {
        end(step_s)
            .iter()
            .zip(exact)
            .map(|(a, b)| (a - b).powi(2))
            .sum::<f64>()
            .sqrt()
    };
    let (coarse, fine) = (error(0.08), error(0.04));
    let order = (coarse / fine).log2();
    assert!(
        (3.7..4.4).contains(&order),
        "order {order:.2}: {coarse:.2e} -> {fine:.2e}"
    );
}

#[test]
fn fourth_order_survives_edges_off_the_grid() {
    let v = lshpi_rig().vehicle;
    let end = |step_s: f64| {
        let mut r = run(&v, step_s, surge(0.0));
        for k in 0..6 {
            // sqrt: never on a grid point.
            r.command(
                f64::from(k).sqrt() * 0.7,
                surge(if k % 2 == 0 { 400.0 } else { 100.0 }),
            )
            .unwrap();
        }
        r.state_at(3.2).unwrap().vehicle.eta[0]
    };
    let exact = end(0.000_2);
    // Edges cut steps into uneven pieces, so the order shows over a wide ratio only.
    let (coarse, fine) = ((end(0.1) - exact).abs(), (end(0.0125) - exact).abs());
    let order = (coarse / fine).log2() / 3.0;
    assert!(
        (3.5..5.0).contains(&order),
        "order {order:.2}: {coarse:.2e} -> {fine:.2e}"
    );
}

/// M u' = X - b u - c u^2 from rest: u = a tanh-like closed form.
#[test]
fn closed_form_of_constant_thrust() {
    let (m, b, c, x_n) = (29.777 + 250.0, 20.0, 200.0, 8.0f64);
    let root = (b * b + 4.0 * c * x_n).sqrt();
    let (u1, u2) = ((-b + root) / (2.0 * c), (-b - root) / (2.0 * c)); // roots of X - b u - c u^2
    let mut r = run(&lshpi_rig().vehicle, 0.005, surge(x_n));
    for t_s in [0.3, 1.7, 4.0, 12.0, 60.0] {
        let e = (-c * (u1 - u2) * t_s / m).exp();
        let u = (u1 - u1 * e) / (1.0 - u1 / u2 * e); // separable Riccati, u(0) = 0
        let got = r.state_at(t_s).unwrap().vehicle.nu[0];
        assert!((got - u).abs() < 1e-10, "u({t_s}) = {got}, closed form {u}");
    }
    let terminal = r.state_at(600.0).unwrap().vehicle.nu[0];
    assert!(
        (terminal - u1).abs() < 1e-12,
        "terminal velocity {terminal} against {u1}"
    );
}

#[test]
fn small_roll_is_the_damped_pendulum() {
    let mut v = lshpi_rig().vehicle;
    for c in &mut v.coefficients {
        c.quadratic = 0.0;
    }
    let model = Model {
        hydrodynamics: Hydrodynamics::new(&v),
        effects: EffectStack::empty(),
    };
    let phi0 = 1e-5;
    let mut r = Trajectory::new(
        model,
        ModelState::at_rest([0.0, 0.0, 0.0, phi0, 0.0, 0.0]),
        0.005,
    )
    .unwrap();
    let (inertia, damping, stiffness) = (0.730 + 4.0, 1.5, 0.028 * 29.777 * 9.81);
    let decay = damping / (2.0 * inertia);
    let omega = (stiffness / inertia - decay * decay).sqrt();
    for t_s in [0.5f64, 1.0, 3.0, 7.0] {
        let phi = phi0
            * (-decay * t_s).exp()
            * ((omega * t_s).cos() + decay / omega * (omega * t_s).sin());
        let got = r.state_at(t_s).unwrap().vehicle.eta[3];
        assert!((got - phi).abs() < 1e-14, "{got} {phi}");
    }
}

/// Without drag, weight's moment and thrust, Eq. 1 keeps the kinetic energy 1/2 nu' M nu.
#[test]
fn coriolis_terms_do_no_work() {
    let mut v = lshpi_rig().vehicle;
    v.r_bz_m = 0.0;
    for c in &mut v.coefficients {
        (c.linear, c.quadratic) = (0.0, 0.0);
    }
    let h = Hydrodynamics::<f64>::new(&v);
    let mass = h.mass();
    let mut start = ModelState::at_rest([0.0; 6]);
    start.vehicle.nu = [0.3, -0.2, 0.1, 0.2, -0.1, 0.3];
    let energy = |nu: &[f64; 6]| {
        nu.iter()
            .zip(mass)
            .map(|(v, m)| 0.5 * m * v * v)
            .sum::<f64>()
    };
    let model = Model {
        hydrodynamics: h,
        effects: EffectStack::empty(),
    };
    let mut r = Trajectory::new(model, start, 0.005).unwrap();
    let end = r.state_at(5.0).unwrap().vehicle;
    assert!((energy(&end.nu) / energy(&start.vehicle.nu) - 1.0).abs() < 1e-9);
    assert!((end.nu[0] - 0.3).abs() > 1e-3, "the terms are there");
}

#[test]
fn decoupled_equals_eq1_for_one_dof_at_a_time() {
    for dof in 0..6 {
        let mut wrench = [0.0; 6];
        wrench[dof] = if dof < 3 { 8.0 } else { 0.3 };
        let end = |model| {
            let v = Vehicle {
                model,
                ..lshpi_rig().vehicle
            };
            run(&v, 0.005, wrench).state_at(4.0).unwrap().vehicle
        };
        assert_eq!(
            end(VehicleModel::Eq1),
            end(VehicleModel::Decoupled),
            "DOF {dof}"
        );
    }
    let both = [20.0, 5.0, 0.0, 0.0, 0.0, 2.0];
    let end = |model| {
        run(
            &Vehicle {
                model,
                ..lshpi_rig().vehicle
            },
            0.005,
            both,
        )
        .state_at(4.0)
        .unwrap()
        .vehicle
    };
    assert_ne!(
        end(VehicleModel::Eq1),
        end(VehicleModel::Decoupled),
        "several DOFs at once do couple"
    );
}

#[test]
fn queries_change_no_bit_and_late_commands_roll_back() {
    let v = lshpi_rig().vehicle;
    let commands = [(0.0, 8.0), (0.513, -4.0), (0.777, 16.0), (1.2, 0.0)];
    let mut quiet = run(&v, 0.005, surge(0.0));
    let mut busy = run(&v, 0.005, surge(0.0));
    for (t_s, x_n) in commands {
        quiet.command(t_s, surge(x_n)).unwrap();
    }
    // Asked all the time, and every command arrives 40 ms late.
    let mut next = 0;
    for i in 0..2000 {
        let now = f64::from(i) * 0.001_37;
        if commands.get(next).is_some_and(|c| c.0 + 0.04 <= now) {
            busy.command(commands[next].0, surge(commands[next].1))
                .unwrap();
            next += 1;
        }
        busy.state_at(now).unwrap();
    }
    for t_s in [0.3, 0.513, 0.9, 2.5] {
        assert_eq!(quiet.state_at(t_s).unwrap(), busy.state_at(t_s).unwrap());
    }
    let forward = quiet.state_at(1.0).unwrap();
    quiet.state_at(9.0).unwrap();
    assert_eq!(
        quiet.state_at(1.0).unwrap(),
        forward,
        "looking back gives the same bits"
    );
}

#[test]
fn history_is_bounded_and_bad_input_is_refused() {
    let mut r = run(&lshpi_rig().vehicle, 0.005, surge(8.0));
    r.state_at(60.0).unwrap();
    assert!(matches!(
        r.state_at(1.0),
        Err(TrajectoryError::TooOld { what: "query", .. })
    ));
    assert!(matches!(
        r.command(1.0, surge(1.0)),
        Err(TrajectoryError::TooOld {
            what: "command",
            ..
        })
    ));
    assert!(matches!(
        r.command(61.0, surge(f64::NAN)),
        Err(TrajectoryError::NotFinite { .. })
    ));
    assert!(matches!(
        r.state_at(f64::INFINITY),
        Err(TrajectoryError::NotFinite { .. })
    ));
    // Positive "damping" explodes: an error with the time, not NaN poses.
    let mut wild = run(&vehicle([-250.0, 900.0, 9e5]), 0.005, surge(8.0));
    assert!(matches!(
        wild.state_at(50.0),
        Err(TrajectoryError::Diverged { .. })
    ));
}
