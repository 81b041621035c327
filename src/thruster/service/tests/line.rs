//! Lost and found: the line, the controller, its clock.

use super::*;

#[test]
fn an_unplugged_line_is_closed_found_again_and_neutral_comes_first() {
    for kind in KINDS {
        let mut b = bench(kind, |_| {});
        b.plan(60.0, constant(10.0));
        b.run_ms(500);
        assert!(b.running());
        let (unplugged_ns, opens) = (
            b.clock.triple().realtime_ns,
            b.opens.load(Ordering::Relaxed),
        );
        b.cable.unplug();
        b.run_ms(3000);
        let lost = b.events("serial.lost");
        assert_eq!(lost.len(), 1, "{kind:?}");
        assert!(
            lost[0].timestamp_ns - unplugged_ns < 1_000 * MS,
            "noticed within a second"
        );
        assert_eq!(b.core.state(), State::Lost);
        // No busy loop while it is away: five attempts a second.
        let tried = b.opens.load(Ordering::Relaxed) - opens;
        assert!((10..=16).contains(&tried), "{tried} attempts in 3 s");
        // Meanwhile the controller's own watchdog has acted.
        let trip = b
            .cable
            .take_events()
            .iter()
            .filter(|e| e.cause == OutputCause::Watchdog)
            .count();
        assert!(trip > 0 && b.at_neutral());
        b.cable.replug();
        b.run_ms(1000);
        assert_eq!(b.events("serial.back").len(), 1);
        assert_eq!(b.core.state(), State::Neutral(NeutralReason::Lost));
        let after = b.cable.take_events();
        assert!(
            !after.is_empty() && after.iter().all(|e| e.pulse_us == 1500.0),
            "{kind:?}"
        );
        // Armed again, it runs again.
        b.plan(10.0, constant(10.0));
        b.run_ms(300);
        assert!(b.running(), "{kind:?}");
    }
}

#[test]
fn what_the_controller_does_alone_is_said_by_kind() {
    for (kind, words, warnings) in [
        (
            LinkKind::Stamped,
            "own watchdog (300 ms) goes to neutral",
            0,
        ),
        (LinkKind::Maestro, "only if its serial timeout is set", 1),
    ] {
        let mut b = bench(kind, |_| {});
        b.run_ms(200);
        for _ in 0..2 {
            b.cable.unplug();
            b.run_ms(600);
            b.cable.replug();
            b.run_ms(600);
        }
        let lost = b.events("serial.lost");
        assert_eq!(lost.len(), 2);
        assert!(lost[0].message.contains(words), "{}", lost[0].message);
        // Once per service, however often the line comes back.
        assert_eq!(b.events("thruster.maestro_timeout").len(), warnings);
    }
}

#[test]
fn with_resume_the_plan_goes_on_after_a_confirmed_neutral() {
    let mut b = bench(LinkKind::Stamped, |c| c.resume_after_loss = true);
    b.plan(60.0, constant(10.0));
    b.run_ms(500);
    b.cable.unplug();
    b.run_ms(1000);
    b.cable.take_events();
    b.cable.replug();
    b.run_ms(1000);
    assert!(b.running());
    let after = b.cable.take_events();
    assert_eq!(after[0].pulse_us, 1500.0, "neutral first");
    assert_eq!(b.core.state(), State::Running);
}

#[test]
fn a_mute_controller_is_a_lost_link_and_comes_back_by_itself() {
    for kind in KINDS {
        let mut b = bench(kind, |_| {});
        b.plan(60.0, constant(10.0));
        b.run_ms(500);
        let silent_from = b.clock.triple().realtime_ns;
        b.cable.with(|c| {
            c.set_faults(Faults {
                mute: true,
                ..Faults::default()
            })
        });
        b.run_ms(1000);
        let lost = b.events("serial.lost");
        assert_eq!(lost.len(), 1, "{kind:?}");
        assert!(lost[0].timestamp_ns - silent_from < 1_000 * MS);
        // The line outwards still works, so neutral has arrived without waiting for the watchdog.
        assert!(b.at_neutral(), "{kind:?}");
        b.cable.with(|c| c.set_faults(Faults::default()));
        b.run_ms(1500);
        assert_eq!(b.events("serial.back").len(), 1, "{kind:?}");
        assert_eq!(b.core.state(), State::Neutral(NeutralReason::Lost));
    }
}

#[test]
fn the_controllers_clock_is_reported_once_a_second() {
    let mut b = bench(LinkKind::Stamped, |_| {});
    b.run_ms(10_000);
    let clocks: Vec<_> = b
        .records()
        .into_iter()
        .filter_map(|r| {
            if let LinkRecord::Clock(c) = r {
                Some(c)
            } else {
                None
            }
        })
        .collect();
    assert!((9..=11).contains(&clocks.len()), "{}", clocks.len());
    let last = clocks.last().unwrap();
    assert!((last.drift_ppm - 37.0).abs() < 5.0, "{last:?}");
}

#[test]
fn a_line_too_slow_for_the_rate_is_refused_with_the_arithmetic() {
    let mut slow = set(LinkKind::Maestro);
    slow.link.baud = 9600;
    slow.link.rate_hz = 100.0;
    let error = check(&slow, &*protocol_for(&slow)).unwrap_err();
    assert!(
        matches!(error, ServiceError::TooSlow { baud: 9600, .. }),
        "{error}"
    );
    let mut twice = set(LinkKind::Maestro);
    twice.thrusters[1].channel = 0;
    assert!(matches!(
        check(&twice, &*protocol_for(&twice)),
        Err(ServiceError::Channels { .. })
    ));
}

#[test]
fn a_controller_reset_while_running_is_noticed_by_its_next_ack() {
    let mut b = bench(LinkKind::Stamped, |_| {});
    b.plan(60.0, constant(10.0));
    b.run_ms(3000);
    assert!(b.running());
    let now_ns = b.now();
    b.cable.with(|c| c.reset(now_ns, &mut |_| {}));
    b.run_ms(60);
    assert_eq!(b.events("thruster.reset").len(), 1);
    assert!(b.at_neutral());
    b.run_ms(3000);
    assert_eq!(b.events("thruster.reset").len(), 1, "reported once");
    // The controller's stamps keep rising within the new generation.
    b.plan(1.0, constant(10.0));
    b.run_ms(900);
    let stamps: Vec<_> = b
        .echoes()
        .iter()
        .rev()
        .take(40)
        .map(|e| e.controller_time_us)
        .collect();
    assert!(stamps.windows(2).all(|w| w[0] >= w[1]));
}

/// Every number is in the log: as a command, or named in a `thruster.unsent`.
fn numbers_without_a_hole(b: &Bench) -> Result<(), String> {
    let mut all: Vec<u32> = b.commands().iter().map(|c| c.sequence).collect();
    for event in b.events("thruster.unsent") {
        let of = |name| event.values.iter().find(|v| v.0 == name).unwrap().1 as u32;
        all.extend(of("sequence")..of("sequence") + of("sets"));
    }
    all.sort_unstable();
    all.dedup();
    match all.windows(2).find(|w| w[1] != w[0] + 1) {
        Some(hole) => Err(format!("nothing between {} and {}", hole[0], hole[1])),
        None => Ok(()),
    }
}

#[test]
fn a_set_cut_off_by_the_unplugging_keeps_its_number_in_the_log() {
    for kind in KINDS {
        let mut cut_off = 0;
        // Over a whole period of 20 ms, so that the line breaks before, in and behind a write.
        for late_ms in 0..20 {
            let mut b = bench(kind, |_| {});
            b.plan(60.0, constant(10.0));
            b.run_ms(500 + late_ms);
            assert!(b.running());
            b.cable.unplug();
            b.run_ms(1000);
            b.cable.replug();
            b.run_ms(500);
            assert!(b.commands().last().unwrap().cause == "lost", "{kind:?}");
            assert_eq!(numbers_without_a_hole(&b), Ok(()), "{kind:?}, {late_ms} ms");
            cut_off += b.events("thruster.unsent").len();
            // The abort to neutral is said, not only the loss.
            let neutral = b.events("thruster.neutral");
            assert_eq!(neutral.len(), 1, "{kind:?}: {neutral:?}");
            assert!(
                neutral[0].message.contains("lost"),
                "{}",
                neutral[0].message
            );
        }
        assert!(
            cut_off > 0,
            "{kind:?}: no unplugging met a command: this test tests nothing"
        );
    }
}
