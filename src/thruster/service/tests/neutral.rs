//! Every way to neutral.

use super::*;
use hydroline_core::event::Severity;

#[test]
fn shutdown_sends_neutral_and_waits_for_its_echo() {
    for kind in KINDS {
        let mut b = bench(kind, |_| {});
        b.plan(60.0, constant(10.0));
        b.run_ms(500);
        assert!(b.running());
        b.shared.stop.store(true, Ordering::Release);
        b.run_ms(1000);
        assert!(b.at_neutral(), "{kind:?}");
        let last = b.commands().last().cloned().unwrap();
        assert_eq!((last.cause, last.pulse_us), ("exit", 1500.0));
        assert_eq!(b.echoes().last().unwrap().sequence, last.sequence);
        assert!(
            b.cable
                .take_events()
                .iter()
                .any(|e: &ControllerEvent| e.pulse_us > 1500.0)
        );
    }
}

#[test]
fn a_request_from_a_signal_handler_stops_within_milliseconds() {
    let mut b = bench(LinkKind::Stamped, |_| {});
    b.plan(60.0, constant(10.0));
    b.run_ms(500);
    b.cable.take_events();
    let asked_ns = b.now();
    NeutralHandle(b.shared.clone()).request(NeutralReason::Limit);
    b.run_ms(100);
    let stopped = b
        .cable
        .take_events()
        .iter()
        .find(|e| e.pulse_us == 1500.0)
        .unwrap()
        .host_monotonic_ns;
    assert!(stopped - asked_ns < 10 * MS, "{}", stopped - asked_ns);
    assert_eq!(b.core.state(), State::Neutral(NeutralReason::Limit));
    assert_eq!(b.commands().last().unwrap().cause, "limit");
    // And stays there.
    b.run_ms(500);
    assert!(b.at_neutral());
}

#[test]
fn a_stalled_plan_misses_its_deadline_and_stops() {
    for kind in KINDS {
        let mut b = bench(kind, |_| {});
        let clock = b.clock.clone();
        b.plan(60.0, move |t_s| {
            if (t_s - 0.4).abs() < 1e-9 {
                // The producer hangs for 100 ms; 30 are allowed.
                clock.advance(Duration::from_millis(100));
            }
            PlannedLoad {
                thrust_n: vec![10.0; 2],
                pulses_us: None,
                plan_step: 1,
            }
        });
        b.run_ms(1000);
        assert!(b.at_neutral(), "{kind:?}");
        assert_eq!(b.core.state(), State::Neutral(NeutralReason::Deadline));
        assert_eq!(b.events("thruster.deadline").len(), 1);
        assert_eq!(b.events("thruster.neutral").len(), 1);
        assert_eq!(b.commands().last().unwrap().cause, "deadline");
    }
}

#[test]
fn a_producer_that_falls_silent_misses_its_deadline() {
    let mut b = bench(LinkKind::Stamped, |_| {});
    b.run_ms(100);
    b.orders.try_send(Order::Arm).unwrap();
    for _ in 0..10 {
        let set_point = SetPoint {
            due_ns: b.now(),
            thrust_n: vec![10.0; 2],
            plan_step: 0,
        };
        b.orders.try_send(Order::SetPoint(set_point)).unwrap();
        b.run_ms(20);
    }
    assert!(b.running());
    b.run_ms(100);
    assert!(b.at_neutral());
    assert_eq!(b.core.state(), State::Neutral(NeutralReason::Deadline));
    // One that comes after that is not taken, and said so.
    let set_point = SetPoint {
        due_ns: 0,
        thrust_n: vec![10.0; 2],
        plan_step: 0,
    };
    b.orders.try_send(Order::SetPoint(set_point)).unwrap();
    b.run_ms(50);
    assert!(b.at_neutral());
    assert_eq!(b.events("thruster.refused").len(), 1);
}

#[test]
fn a_panic_in_sink_or_plan_leaves_the_thrusters_at_neutral() {
    for kind in KINDS {
        let mut b = bench(kind, |_| {});
        b.plan(60.0, |t_s| {
            assert!(t_s < 0.4, "the plan breaks");
            PlannedLoad {
                thrust_n: vec![10.0; 2],
                pulses_us: None,
                plan_step: 1,
            }
        });
        let panic = catch_unwind(AssertUnwindSafe(|| b.run_ms(1000)));
        assert!(panic.is_err() && b.running());
        b.core.panicked("the plan breaks");
        assert!(b.at_neutral(), "{kind:?}");
        assert_eq!(b.commands().last().unwrap().cause, "panic");
        assert!(
            b.events("thruster.neutral")
                .iter()
                .any(|e| e.message.contains("the plan breaks"))
        );
    }
    // A sink that panics at every record from some point on.
    let mut b = bench(LinkKind::Stamped, |_| {});
    let left = AtomicU32::new(60);
    b.core.sink = Box::new(move |_| assert!(left.fetch_sub(1, Ordering::Relaxed) > 0, "disk full"));
    b.plan(60.0, constant(10.0));
    assert!(catch_unwind(AssertUnwindSafe(|| b.run_ms(5000))).is_err());
    assert!(b.running());
    b.core.panicked("disk full");
    assert!(b.at_neutral());
}

#[test]
fn a_controller_that_talks_but_never_confirms_is_not_trusted() {
    let mut b = bench(LinkKind::Stamped, |_| {});
    b.plan(60.0, constant(10.0));
    b.run_ms(500);
    assert!(b.running());
    let unacked_ns = b.clock.triple().realtime_ns;
    b.cable.with(|c| {
        c.set_faults(Faults {
            misnumbered: true,
            ..Faults::default()
        })
    });
    b.run_ms(3000);
    let reported = b.events("thruster.no_echo");
    assert_eq!(reported.len(), 1);
    let after_ns = reported[0].timestamp_ns - unacked_ns;
    // timeout_s = 0.3 s from the first command without an echo, at most one period (20 ms) later.
    assert!((290 * MS..340 * MS).contains(&after_ns), "{after_ns}");
    assert!(b.at_neutral());
    assert_eq!(b.core.state(), State::Neutral(NeutralReason::Lost));
    assert_eq!(
        b.shared.plan(|p| p.clone()),
        PlanState::Aborted(NeutralReason::Lost)
    );
    // It was talking all the time: the link itself was never lost.
    assert!(b.events("serial.lost").is_empty());
    b.cable.with(|c| c.set_faults(Faults::default()));
    b.run_ms(200);
    b.plan(10.0, constant(10.0));
    b.run_ms(1000);
    assert!(b.running());
}

/// One pulse goes up and one down with the time: a controller that stands still is soon found out.
fn rising(t_s: f64) -> PlannedLoad {
    PlannedLoad {
        thrust_n: vec![10.0 + t_s, 10.0 - t_s],
        pulses_us: None,
        plan_step: 1,
    }
}

/// The controller acknowledges set-points, and its outputs follow them or not.
fn stick(b: &Bench, stuck: bool) {
    b.cable.with(|c| {
        c.set_faults(Faults {
            stuck,
            ..Faults::default()
        })
    });
}

#[test]
fn a_controller_that_contradicts_stops_the_plan() {
    for kind in KINDS {
        let mut b = bench(kind, |_| {});
        b.plan(60.0, rising);
        b.run_ms(500);
        assert!(b.events("thruster.echo_mismatch").is_empty(), "{kind:?}");
        let stuck_ns = b.clock.triple().realtime_ns;
        stick(&b, true);
        b.run_ms(2000);
        let said = |kind: &str, name: &str| {
            let event = &b.events(kind)[0];
            event.values.iter().find(|v| v.0 == name).unwrap().1
        };
        assert!(!b.events("thruster.echo_mismatch").is_empty(), "{kind:?}");
        let reported = b.events("thruster.contradicted");
        assert_eq!(reported.len(), 1, "{kind:?}");
        assert_eq!(reported[0].severity, Severity::Error);
        let difference_us =
            said("thruster.contradicted", "sent_us") - said("thruster.contradicted", "echo_us");
        assert!(difference_us.abs() > 0.25, "{kind:?}");
        // timeout_s = 0.3 s from the first echo that differs; the load changes by a quarter microsecond only after a
        // few periods.
        let after_ns = reported[0].timestamp_ns - stuck_ns;
        assert!(
            (300 * MS..600 * MS).contains(&after_ns),
            "{kind:?}: {after_ns}"
        );
        assert_eq!(
            b.core.state(),
            State::Neutral(NeutralReason::Contradicted),
            "{kind:?}"
        );
        assert_eq!(
            b.shared.plan(|p| p.clone()),
            PlanState::Aborted(NeutralReason::Contradicted)
        );
        // Obedient again, it takes the neutral that is repeated, and a new plan.
        b.cable.with(|c| c.set_faults(Faults::default()));
        b.run_ms(500);
        assert!(b.at_neutral(), "{kind:?}");
        b.plan(10.0, constant(10.0));
        b.run_ms(300);
        assert!(b.running(), "{kind:?}");
    }
}

#[test]
fn a_few_wrong_echoes_stop_nothing() {
    for kind in KINDS {
        let mut b = bench(kind, |_| {});
        b.plan(60.0, rising);
        b.run_ms(500);
        for stuck in [true, false, true, false] {
            stick(&b, stuck);
            b.run_ms(200);
        }
        assert!(!b.events("thruster.echo_mismatch").is_empty(), "{kind:?}");
        assert!(b.events("thruster.contradicted").is_empty(), "{kind:?}");
        assert!(b.running(), "{kind:?}");
    }
}

#[test]
fn a_lost_neutral_is_repeated_until_it_is_confirmed() {
    let mut b = bench(LinkKind::Stamped, |_| {});
    b.plan(60.0, constant(10.0));
    b.run_ms(500);
    // The frame does not get through for 100 ms, well inside the watchdog's 300 ms.
    b.cable.with(|c| {
        c.set_faults(Faults {
            deaf: true,
            ..Faults::default()
        })
    });
    NeutralHandle(b.shared.clone()).request(NeutralReason::Request);
    b.run_ms(100);
    assert!(b.running());
    b.cable.with(|c| c.set_faults(Faults::default()));
    b.cable.take_events();
    b.run_ms(100);
    assert!(b.at_neutral());
    assert!(
        b.cable
            .take_events()
            .iter()
            .all(|e| e.cause == OutputCause::Neutral)
    );
}
