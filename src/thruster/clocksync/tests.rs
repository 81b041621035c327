use super::*;
use proptest::prelude::*;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

/// A controller clock and a path with jitter, both known.
struct World {
    offset_us: f64,
    drift_ppm: f64,
    /// Fixed delay out and back \[us\].
    floor_us: (f64, f64),
    /// Mean of the exponential jitter out and back \[us\].
    jitter_us: (f64, f64),
    rng: StdRng,
}

impl World {
    fn controller_us(&self, host_us: f64) -> f64 {
        self.offset_us + host_us * (1.0 + self.drift_ppm * 1e-6)
    }

    fn exponential(&mut self, mean_us: f64) -> f64 {
        -mean_us * self.rng.random_range(1e-12..1.0f64).ln()
    }

    fn exchange(&mut self, t1_us: f64) -> Exchange {
        let out_us = self.floor_us.0 + self.exponential(self.jitter_us.0);
        let back_us = self.floor_us.1 + self.exponential(self.jitter_us.1);
        let held_us = 300.0;
        let t2_us = t1_us + out_us;
        let t3_us = t2_us + held_us;
        let raw = |host_us: f64| self.controller_us(host_us).floor() as u64 as u32;
        Exchange {
            t1_ns: (t1_us * 1e3) as u64,
            t2_us: raw(t2_us),
            t3_us: raw(t3_us),
            t4_ns: ((t3_us + back_us) * 1e3) as u64,
            boot_id: 1,
        }
    }
}

fn world(seed: u64) -> World {
    let mut rng = StdRng::seed_from_u64(seed);
    World {
        // Close to a wrap, so that most runs cross one.
        offset_us: 4_294_967_296.0 * 3.0 - rng.random_range(0.0..40e6),
        drift_ppm: rng.random_range(-200.0..200.0),
        floor_us: (400.0, 400.0),
        jitter_us: (
            rng.random_range(50.0..1000.0),
            rng.random_range(50.0..1000.0),
        ),
        rng,
    }
}

fn run(world: &mut World, seconds: f64, rate_hz: f64) -> (ClockSync, f64) {
    let mut sync = ClockSync::new(SyncSettings::default());
    let mut t_us = 1e6;
    while t_us < 1e6 + seconds * 1e6 {
        assert!(!matches!(
            sync.add(world.exchange(t_us)),
            Added::Reset { .. }
        ));
        // The host's own timing is irregular too.
        t_us += 1e6 / rate_hz * world.rng.random_range(0.9..1.1);
    }
    (sync, t_us)
}

/// Error of the estimated controller time at `t_us` \[us\], whole wraps aside.
fn error_us(sync: &ClockSync, world: &World, t_us: f64) -> f64 {
    let e = sync.estimate().unwrap();
    let error = e.controller_at_us((t_us * 1e3) as u64) - world.controller_us(t_us);
    error - (error / 4_294_967_296.0).round() * 4_294_967_296.0
}

#[test]
fn under_a_millisecond_after_30_s_and_drift_within_a_few_ppm() {
    let mut worst_us: f64 = 0.0;
    let mut worst_ppm: f64 = 0.0;
    for seed in 0..200 {
        let mut w = world(seed);
        let (sync, t_us) = run(&mut w, 30.0, 2.0);
        worst_us = worst_us.max(error_us(&sync, &w, t_us).abs());
        worst_ppm = worst_ppm.max((sync.estimate().unwrap().drift_ppm - w.drift_ppm).abs());
    }
    println!(
        "200 runs of 30 s: worst offset error {worst_us:.1} us, worst drift error {worst_ppm:.1} ppm"
    );
    assert!(worst_us < 1000.0, "{worst_us}");
    assert!(worst_ppm < 40.0, "{worst_ppm}");
}

#[test]
fn the_reported_sd_covers_95_percent() {
    // Equal fixed delays: here the fit's own sd has to be honest, without the allowance for path asymmetry.
    let runs = 1000;
    let (mut offset_in, mut drift_in) = (0, 0);
    for seed in 0..runs {
        let mut w = world(10_000 + seed);
        let (sync, _) = run(&mut w, 30.0, 2.0);
        let e = sync.estimate().unwrap();
        let t_us = e.host_epoch_ns as f64 * 1e-3;
        // Both controller stamps are cut to whole microseconds: their mean is half a microsecond early.
        let error = error_us(&sync, &w, t_us) + 0.5;
        offset_in += i32::from(error.abs() <= 1.96 * e.offset_fit_sd_us);
        drift_in += i32::from((e.drift_ppm - w.drift_ppm).abs() <= 1.96 * e.drift_sd_ppm);
    }
    let share = |n: i32| f64::from(n) / runs as f64;
    println!(
        "95 % intervals cover: offset {:.3}, drift {:.3} of {runs}",
        share(offset_in),
        share(drift_in)
    );
    assert!(
        (0.92..=0.985).contains(&share(offset_in)),
        "offset {}",
        share(offset_in)
    );
    assert!(
        (0.92..=0.985).contains(&share(drift_in)),
        "drift {}",
        share(drift_in)
    );
}

#[test]
fn an_unknown_asymmetry_of_the_path_is_inside_the_total_sd() {
    let runs = 300;
    let mut inside = 0;
    for seed in 0..runs {
        let mut w = world(50_000 + seed);
        // The minimal round trip of 2 ms is split at random: nothing can show how.
        let out = w.rng.random_range(0.0..2000.0);
        w.floor_us = (out, 2000.0 - out);
        let (sync, t_us) = run(&mut w, 30.0, 2.0);
        let sd_us = sync.estimate().unwrap().sd_at_us((t_us * 1e3) as u64);
        inside += i32::from(error_us(&sync, &w, t_us).abs() <= 1.96 * sd_us);
    }
    let share = f64::from(inside) / runs as f64;
    println!("random path asymmetry: 95 % intervals cover {share:.3}");
    assert!(share >= 0.95, "{share}");
}

#[test]
fn a_reset_is_noticed_by_boot_id_and_by_a_jump() {
    let mut w = world(3);
    let (mut sync, t_us) = run(&mut w, 10.0, 2.0);
    let mut x = w.exchange(t_us);
    x.boot_id = 2;
    assert!(matches!(sync.add(x), Added::Reset { .. }));
    assert_eq!(sync.estimate().unwrap().samples, 1);
    assert_eq!(sync.estimate().unwrap().generation, 1);

    let (mut sync, t_us) = run(&mut w, 10.0, 2.0);
    w.offset_us -= 3e6;
    match sync.add(w.exchange(t_us)) {
        Added::Reset { jump_us } => assert!((jump_us + 3e6).abs() < 1e4, "{jump_us}"),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_few_outliers_move_it_little() {
    let mut w = world(4);
    w.jitter_us = (100.0, 100.0);
    let (mut sync, mut t_us) = run(&mut w, 30.0, 2.0);
    for k in 0..10 {
        let mut x = w.exchange(t_us);
        if k % 3 == 0 {
            // A stamp that is simply wrong, with an ordinary round trip.
            x.t2_us = x.t2_us.wrapping_add(20_000);
            x.t3_us = x.t3_us.wrapping_add(20_000);
        }
        sync.add(x);
        t_us += 5e5;
    }
    assert!(error_us(&sync, &w, t_us).abs() < 1000.0);
}

#[test]
fn one_sample_is_bounded_by_its_round_trip() {
    let mut w = world(5);
    let mut sync = ClockSync::new(SyncSettings::default());
    sync.add(w.exchange(1e6));
    let e = sync.estimate().unwrap();
    assert!(e.offset_sd_us >= e.round_trip_us / 12f64.sqrt());
    assert!(error_us(&sync, &w, 1e6).abs() <= e.round_trip_us / 2.0 + 2.0);
    assert!(e.drift_sd_ppm > 4000.0);
}

#[test]
fn impossible_exchanges_are_refused() {
    let mut sync = ClockSync::new(SyncSettings::default());
    let x = Exchange {
        t1_ns: 5_000_000,
        t2_us: 10,
        t3_us: 20,
        t4_ns: 4_000_000,
        boot_id: 1,
    };
    assert!(matches!(sync.add(x), Added::Refused { .. }));
    let x = Exchange {
        t1_ns: 0,
        t2_us: 10,
        t3_us: 2000,
        t4_ns: 1_000_000,
        boot_id: 1,
    };
    assert!(matches!(sync.add(x), Added::Refused { .. }));
    assert!(sync.estimate().is_none());
}

proptest! {
    #[test]
    fn unwrapping_follows_any_walk(start: u32, steps in prop::collection::vec(-1_000_000i64..2_000_000_000, 1..50)) {
        let mut unwrap = Unwrap32::default();
        let first = unwrap.unwrap_us(start);
        let mut truth = i128::from(first);
        for step in steps {
            truth += i128::from(step);
            if truth < 0 {
                break;
            }
            prop_assert_eq!(i128::from(unwrap.unwrap_us(truth as u64 as u32)), truth);
        }
    }

    #[test]
    fn arbitrary_exchanges_never_panic(list in prop::collection::vec(
        (any::<u64>(), any::<u32>(), any::<u32>(), any::<u64>(), 0u16..3), 0..30)
    ) {
        let mut sync = ClockSync::new(SyncSettings::default());
        for (t1_ns, t2_us, t3_us, t4_ns, boot_id) in list {
            sync.add(Exchange { t1_ns, t2_us, t3_us, t4_ns, boot_id });
            if let Some(e) = sync.estimate() {
                let _ = (e.controller_at_us(t1_ns), e.sd_at_us(t4_ns), e.record());
            }
        }
    }
}
