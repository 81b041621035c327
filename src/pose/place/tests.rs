use super::*;
use crate::fixture::lshpi_rig;

const PERIOD_M: f64 = 0.207_846;

fn place() -> Place {
    Place::new(&rig(), Some(PERIOD_M), [0.0, 6.0 * PERIOD_M])
}

fn rig() -> hydroline_rigs::Rig {
    let mut rig = lshpi_rig();
    rig.tank.start_pose[0] = -0.2;
    rig
}

const SD2: f64 = 1e-6;
fn ns(t_s: f64) -> u64 {
    1_000_000_000_000 + (t_s * 1e9).round() as u64
}

/// x as a frame shows it: some repetitions off.
fn shown(x_m: f64, k: f64) -> f64 {
    x_m + k * PERIOD_M
}

/// Follows a motion at a rate of frames; the last carried place.
fn follow(place: &mut Place, x: impl Fn(f64) -> f64, times_s: [f64; 2], fps: f64) -> Carried {
    let frames = ((times_s[1] - times_s[0]) * fps).round() as usize;
    let mut last = None;
    for k in 0..=frames {
        let t_s = times_s[0] + k as f64 / fps;
        place.begin(ns(t_s));
        last = Some(place.update(ns(t_s), x(t_s), SD2, 0.0));
    }
    last.unwrap()
}

#[test]
fn a_second_without_a_pose_at_two_frames_a_second_loses_nothing() {
    let mut place = place();
    let x = |t: f64| -0.2 + 0.5 * 0.02 * t * t;
    follow(&mut place, x, [0.0, 2.0], 2.0);
    let back = place.update(ns(3.5), shown(x(3.5), 1.0), SD2, 0.0);
    assert!(back.is_decided(), "{back}");
    assert!((back.x_m - x(3.5)).abs() < 0.005, "{back}");
}

#[test]
fn the_motion_after_a_gap_decides_between_places() {
    // Unknown thrust brakes the vehicle in the gap and speeds it up again: x is expected a seventh of a repetition too far.
    let mut place = place();
    let speed_mps = 0.1;
    let before = |t: f64| -0.2 + speed_mps * t;
    follow(&mut place, before, [0.0, 2.0], 5.0);
    let after = |t: f64| before(t) - 0.03;
    let first = place.update(ns(4.5), after(4.5), SD2, 0.0);
    assert!(first.places > 1, "{first}");
    let last = follow(&mut place, after, [4.7, 6.5], 5.0);
    assert!(
        last.is_decided() && (last.x_m - after(6.5)).abs() < 0.005,
        "{last}"
    );
}

#[test]
fn a_long_gap_is_said_to_be_open_and_its_sd_grows() {
    let mut place = place();
    follow(&mut place, |_| -0.2, [0.0, 1.0], 5.0);
    let sd = |t_s: f64| place.carried(ns(t_s)).sd_m;
    assert!(
        sd(2.0) < sd(3.0) && sd(3.0) < sd(11.0),
        "{} {}",
        sd(2.0),
        sd(11.0)
    );
    let open = place.update(ns(41.0), -0.1, SD2, 0.0);
    assert!(!open.is_decided() && open.places > 2, "{open}");
    assert!(open.to_string().contains("waits until"), "{open}");
}

#[test]
fn commands_carry_a_vehicle_over_a_gap_and_narrow_it() {
    let mut rig = rig();
    rig.tank.start_pose[5] = 0.0;
    let mut world = hydroline_sim::World::new(&rig, rig.tank.start_pose).unwrap();
    let wrench = hydroline_rigs::Wrench {
        surge_n: 8.0,
        ..Default::default()
    };
    world.command(0.0, &wrench).unwrap();
    let xs: Vec<f64> = (0..=60)
        .map(|k| world.state_at(f64::from(k) * 0.1).unwrap().eta[0])
        .collect();
    let mut place = Place::new(&rig, Some(PERIOD_M), [0.0, 6.0 * PERIOD_M]);
    place.command(ns(0.0), "surge", 8.0);
    place.begin(ns(0.0));
    for (k, x_m) in xs[..=20].iter().enumerate() {
        place.update(ns(k as f64 * 0.1), *x_m, SD2, 0.0);
    }
    // Two and a half seconds later, half a repetition on.
    let carried = place.carried(ns(4.5));
    assert!(
        (carried.x_m - xs[45]).abs() < 3.0 * carried.sd_m,
        "{carried}"
    );
    assert!(carried.sd_m < 0.06, "{carried}");
    let back = place.update(ns(4.5), shown(xs[45], -1.0), SD2, 0.0);
    assert!((back.x_m - xs[45]).abs() < 0.01, "{back}");
    let late = place.update(ns(4.7), xs[47], SD2, 0.0);
    assert!(late.is_decided(), "{late}");
}

#[test]
fn a_pose_that_is_an_outlier_hardly_moves_the_place() {
    let mut place = place();
    follow(&mut place, |_| -0.2, [0.0, 2.0], 25.0);
    place.update(ns(2.04), -0.16, SD2, 0.0);
    let next = place.update(ns(2.08), -0.2, SD2, 0.0);
    assert!(next.is_decided() && (next.x_m + 0.2).abs() < 0.01, "{next}");
}

#[test]
fn half_way_between_two_starts_nothing_is_decided() {
    // In the middle of the target: at its ends, there may be no other place.
    let mut rig = rig();
    rig.tank.start_pose[0] = 0.3;
    let mut place = Place::new(&rig, Some(PERIOD_M), [0.0, 6.0 * PERIOD_M]);
    place.begin(ns(0.0));
    let open = place.update(ns(0.0), 0.3 + 0.49 * PERIOD_M, SD2, 0.0);
    assert!(!open.is_decided(), "{open}");
}
