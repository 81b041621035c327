use super::*;
use proptest::prelude::*;

const MS: u64 = 1_000_000;

fn limits() -> PulseLimits {
    PulseLimits {
        neutral_us: 1500.0,
        min_us: 1100.0,
        max_us: 1900.0,
        max_slew_us_per_s: 2000.0,
        max_step_s: 0.04,
    }
}

fn armed(channels: usize) -> Safety {
    let mut s = Safety::new(limits(), channels);
    s.neutral(NeutralReason::Idle, 0);
    assert!(s.arm());
    s
}

#[test]
fn out_of_range_is_refused_and_nothing_changes() {
    let mut s = armed(2);
    for bad in [1099.75, 1900.25, f64::NAN, f64::INFINITY] {
        assert!(matches!(
            s.admit(MS, &[1500.0, bad]),
            Err(Refused::Range { index: 1, .. })
        ));
    }
    assert_eq!(s.last_us, [1500.0, 1500.0]);
    assert!(matches!(
        s.admit(MS, &[1500.0]),
        Err(Refused::Count { got: 1, want: 2 })
    ));
}

#[test]
fn a_step_is_ramped_with_one_event() {
    let mut s = armed(1);
    let mut begins = 0;
    let mut got = Vec::new();
    for k in 1..=10 {
        let a = s.admit(k * 20 * MS, &[1700.0]).unwrap();
        begins += u32::from(a.ramp_begins);
        got.push(a.pulses_us[0]);
    }
    assert_eq!(begins, 1);
    assert_eq!(&got[..6], [1540.0, 1580.0, 1620.0, 1660.0, 1700.0, 1700.0]);
}

#[test]
fn a_pause_saves_up_no_jump() {
    let mut s = armed(1);
    s.admit(20 * MS, &[1510.0]).unwrap();
    let a = s.admit(60_000 * MS, &[1900.0]).unwrap();
    assert_eq!(a.pulses_us, [1590.0]);
}

#[test]
fn neutral_is_at_once_and_holds_until_armed() {
    let mut s = armed(1);
    for k in 1..=9 {
        s.admit(k * 20 * MS, &[1900.0]).unwrap();
    }
    assert_eq!(s.last_us, [1860.0]);
    assert_eq!(
        s.neutral(NeutralReason::Deadline, 400 * MS),
        (vec![1500.0], true)
    );
    assert_eq!(
        s.neutral(NeutralReason::Deadline, 401 * MS),
        (vec![1500.0], false)
    );
    assert!(matches!(
        s.admit(200 * MS, &[1600.0]),
        Err(Refused::State { .. })
    ));
    assert!(s.arm());
    assert!(s.admit(220 * MS, &[1520.0]).is_ok());
}

#[test]
fn lost_is_left_only_by_regain_and_then_neutral() {
    let mut s = armed(1);
    assert!(s.lose());
    assert!(!s.lose());
    assert!(!s.arm());
    s.neutral(NeutralReason::Request, 0);
    assert_eq!(s.state(), State::Lost);
    s.regain(NeutralReason::Lost);
    assert_eq!(s.state(), State::Neutral(NeutralReason::Lost));
}

proptest! {
    #[test]
    fn whatever_is_asked_range_and_slew_hold(
        asked in prop::collection::vec((800.0f64..2200.0, 0u64..100), 1..200),
    ) {
        let mut s = armed(1);
        let (mut now, mut last, mut last_ns) = (0u64, 1500.0, 0u64);
        for (pulse, wait_ms) in asked {
            now += wait_ms * MS;
            match s.admit(now, &[pulse]) {
                Ok(a) => {
                    let out = a.pulses_us[0];
                    prop_assert!((1100.0..=1900.0).contains(&out));
                    let allowed = 2000.0 * ((now - last_ns) as f64 * 1e-9).min(0.04);
                    prop_assert!((out - last).abs() <= allowed + 1e-9);
                    // Never away from the wish.
                    prop_assert!((pulse - out).abs() <= (pulse - last).abs() + 1e-9);
                    (last, last_ns) = (out, now);
                }
                Err(Refused::Range { .. }) => prop_assert!(!(1100.0..=1900.0).contains(&pulse)),
                Err(e) => prop_assert!(false, "{e}"),
            }
        }
    }

    #[test]
    fn a_constant_wish_is_reached(wish in 1100.0f64..=1900.0) {
        let mut s = armed(1);
        let mut out = 1500.0;
        for k in 1..=50u64 {
            out = s.admit(k * 20 * MS, &[wish]).unwrap().pulses_us[0];
        }
        prop_assert_eq!(out, wish);
    }
}
