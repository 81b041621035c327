use super::*;
use crate::fixture::lshpi_rig;
use hydroline_rigs::{ParameterValue, PhysicsEntry};

fn surge(x_n: f64) -> Wrench {
    Wrench {
        surge_n: x_n,
        ..Wrench::default()
    }
}

#[test]
fn the_cases_surge_run_is_reproduced() {
    // cases/images: 4 N from rest at psi = -4 deg moves along the heading.
    let rig = lshpi_rig();
    let mut w = World::new(&rig, rig.tank.start_pose).unwrap();
    w.command(0.0, &surge(4.0)).unwrap();
    let s = w.state_at(8.0).unwrap();
    assert!(s.eta[0] > 0.3 && (s.eta[1] / s.eta[0] - (-4f64.to_radians()).tan()).abs() < 1e-9);
    assert!(s.eta[2] == -0.83 && s.nu[1] == 0.0);
}

#[test]
fn thrusts_pulses_and_wrenches_agree() {
    let rig = lshpi_rig();
    let mut worlds: Vec<World> = (0..3)
        .map(|_| World::new(&rig, rig.tank.start_pose).unwrap())
        .collect();
    let made = worlds[0].allocation().allocate(&surge(8.0)).unwrap();
    let pulses = worlds[0]
        .allocation()
        .pulses_of_thrusts(&made.thrust_n)
        .unwrap();
    worlds[0].command(0.2, &made.wrench).unwrap();
    worlds[1].command_thrusts(0.2, &made.thrust_n).unwrap();
    worlds[2].command_pulses(0.2, &pulses).unwrap();
    let x: Vec<f64> = worlds
        .iter_mut()
        .map(|w| w.state_at(3.0).unwrap().eta[0])
        .collect();
    assert_eq!(x[0], x[1]);
    assert!((x[0] - x[2]).abs() < 1e-12, "the pulse's last bits");
    assert!(matches!(
        worlds[0].command_thrusts(4.0, &[1.0]),
        Err(SimError::Thrust(ThrustError::Count { .. }))
    ));
}

#[test]
fn before_the_run_it_is_at_rest_and_seen_as_it_is() {
    let rig = lshpi_rig();
    let mut w = World::new(&rig, rig.tank.start_pose).unwrap();
    w.command(0.0, &surge(4.0)).unwrap();
    assert_eq!(w.state_at(-1.0).unwrap().eta, rig.tank.start_pose);
    let eta = w.state_at(2.0).unwrap().eta;
    assert_eq!(w.pose_seen(2.0, 100.0).unwrap().to_array(), eta);
    assert_eq!(w.pose_reported(2.0).unwrap().to_array(), eta);
}

#[test]
fn effects_of_the_rig_are_at_work_and_bad_ones_refused() {
    let mut rig = lshpi_rig();
    let lag = |v| PhysicsEntry {
        effect: "thruster_lag".into(),
        parameters: vec![("lag_s".into(), ParameterValue::Number(v))],
    };
    let run = |rig: &Rig| {
        let mut w = World::new(rig, rig.tank.start_pose).unwrap();
        w.command(0.0, &surge(4.0)).unwrap();
        w.state_at(3.0).unwrap().eta[0]
    };
    let without = run(&rig);
    rig.physics.push(lag(0.4));
    assert!(run(&rig) < without - 0.005);
    rig.physics[0] = lag(1.5);
    assert_eq!(
        World::new(&rig, rig.tank.start_pose).unwrap().notes().len(),
        1
    );
    rig.physics[0] = lag(f64::NAN);
    assert!(matches!(
        World::new(&rig, rig.tank.start_pose),
        Err(SimError::Effect(EffectError::OutOfLimits { .. }))
    ));
    rig.physics.clear();
    assert!(matches!(
        World::new(&rig, [f64::NAN; 6]),
        Err(SimError::Trajectory(TrajectoryError::NotFinite { .. }))
    ));
}
