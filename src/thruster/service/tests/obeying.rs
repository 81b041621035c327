//! A controller that does not do, or does not say, what it was commanded.

use super::*;
use hydroline_core::event::Severity;

fn fail(b: &Bench, faults: Faults) {
    b.cable.with(|c| c.set_faults(faults));
}

fn state(b: &Bench) -> PlanState {
    b.shared.plan(|p| p.clone())
}

/// To the end of the service: whether neutral was left open there.
fn shut_down(b: &mut Bench) -> bool {
    b.shared.stop.store(true, Ordering::Release);
    b.run_ms(3000);
    b.shared.stats(|s| s.neutral_open)
}

const WITHOUT_CHANNELS: Faults = Faults {
    mute: false,
    deaf: false,
    misnumbered: false,
    stuck: false,
    without_channels: true,
    errors: 0,
    corrupt_tx: 0.0,
    corrupt_rx: 0.0,
    garbage: 0.0,
    delay_ns: 0,
};

#[test]
fn an_ack_without_channels_confirms_neither_a_set_nor_neutral() {
    let mut b = bench(LinkKind::Stamped, |_| {});
    b.plan(60.0, constant(10.0));
    b.run_ms(500);
    assert!(b.running());
    let (echoed, since_ns) = (b.shared.stats(|s| s.echoed), b.clock.triple().realtime_ns);
    fail(&b, WITHOUT_CHANNELS);
    b.run_ms(2000);
    let reported = b.events("thruster.contradicted");
    assert_eq!(reported.len(), 1);
    assert_eq!(reported[0].severity, Severity::Error);
    let words = &reported[0].message;
    assert!(
        words.contains("port: ") && words.contains("channel 0"),
        "{words}"
    );
    let after_ns = reported[0].timestamp_ns - since_ns;
    // timeout_s = 0.3 s from the first of them, and a period at most.
    assert!((300 * MS..400 * MS).contains(&after_ns), "{after_ns}");
    assert_eq!(state(&b), PlanState::Aborted(NeutralReason::Contradicted));
    assert!(
        b.shared.stats(|s| s.echoed) <= echoed + 1,
        "no set is answered in full"
    );
    assert!(b.at_neutral(), "the controller did obey");
    // But nobody knows it: neutral is repeated to the end, and open there.
    assert!(shut_down(&mut b));
    let last = b.events("thruster.neutral").pop().unwrap();
    assert!(
        last.message
            .contains("without the controller's confirmation"),
        "{last:?}"
    );
}

#[test]
fn a_controller_without_channels_from_the_start_is_never_ready() {
    let mut b = bench(LinkKind::Stamped, |_| {});
    fail(&b, WITHOUT_CHANNELS);
    b.run_ms(1000);
    assert_eq!(b.shared.stats(|s| s.echoed), 0);
    assert!(b.shared.stats(|s| s.neutral_open));
}

#[test]
fn error_bits_in_every_answer_stop_the_plan() {
    let kinds = [
        (LinkKind::Stamped, 1 << 5, "watchdog"),
        (LinkKind::Stamped, 1 << 6, "undervoltage"),
        (LinkKind::Stamped, 1 << 7, "output fault"),
        (LinkKind::Stamped, 1 << 12, "unassigned error bit"),
        (LinkKind::Maestro, 1 << 4, "serial protocol error"),
    ];
    for (kind, errors, name) in kinds {
        let mut b = bench(kind, |_| {});
        b.plan(60.0, constant(10.0));
        b.run_ms(500);
        assert!(b.running());
        fail(
            &b,
            Faults {
                errors,
                ..Faults::default()
            },
        );
        b.run_ms(2500);
        let reported = b.events("thruster.fault");
        assert_eq!(reported.len(), 1, "{kind:?} {name}");
        assert!(
            reported[0].message.contains(name),
            "{}",
            reported[0].message
        );
        assert_eq!(state(&b), PlanState::Aborted(NeutralReason::Fault));
        assert_eq!(b.core.state(), State::Neutral(NeutralReason::Fault));
        assert!(b.at_neutral());
        // Nor does the next plan run for long, as long as they stand.
        b.plan(60.0, constant(10.0));
        b.run_ms(2500);
        assert_eq!(state(&b), PlanState::Aborted(NeutralReason::Fault));
        fail(&b, Faults::default());
        b.run_ms(1500);
        b.plan(60.0, constant(10.0));
        b.run_ms(500);
        assert!(b.running(), "{kind:?} {name}");
        assert!(!shut_down(&mut b), "neutral is confirmed all the same");
    }
}

#[test]
fn error_bits_that_go_again_stop_nothing() {
    for kind in KINDS {
        let mut b = bench(kind, |_| {});
        b.plan(60.0, constant(10.0));
        b.run_ms(500);
        for _ in 0..4 {
            fail(
                &b,
                Faults {
                    errors: 1 << 4,
                    ..Faults::default()
                },
            );
            b.run_ms(200);
            fail(&b, Faults::default());
            b.run_ms(1000);
        }
        assert!(!b.events("thruster.error_bits").is_empty(), "{kind:?}");
        assert!(b.events("thruster.fault").is_empty(), "{kind:?}");
        assert!(b.running(), "{kind:?}");
    }
}

#[test]
fn neutral_that_nobody_confirms_is_open_at_the_end() {
    type Break = fn(&mut Bench);
    let breaks: [(&str, Break, bool); 5] = [
        ("sound", |_| {}, false),
        (
            "deaf",
            |b| {
                fail(
                    b,
                    Faults {
                        deaf: true,
                        ..Faults::default()
                    },
                )
            },
            true,
        ),
        (
            "mute",
            |b| {
                fail(
                    b,
                    Faults {
                        mute: true,
                        ..Faults::default()
                    },
                )
            },
            true,
        ),
        (
            "stuck",
            |b| {
                fail(
                    b,
                    Faults {
                        stuck: true,
                        ..Faults::default()
                    },
                )
            },
            false,
        ),
        ("unplugged", |b| b.cable.unplug(), true),
    ];
    for (name, breaks, open) in breaks {
        let mut b = bench(LinkKind::Stamped, |_| {});
        b.plan(60.0, constant(10.0));
        b.run_ms(500);
        assert!(b.running());
        breaks(&mut b);
        b.run_ms(40);
        assert_eq!(shut_down(&mut b), open, "{name}");
    }
    // A line that breaks when the vehicle rests, as far as the controller has said, leaves nothing open.
    let mut b = bench(LinkKind::Stamped, |_| {});
    b.plan(1.0, constant(10.0));
    b.run_ms(1500);
    b.cable.unplug();
    b.run_ms(500);
    assert!(!shut_down(&mut b));
    // Nor does one that never opened.
    let mut b = bench(LinkKind::Stamped, |_| {});
    b.cable.unplug();
    b.run_ms(500);
    assert!(!shut_down(&mut b));
}

#[test]
fn a_controller_clock_two_percent_off_is_said_once() {
    for (drift_ppm, said) in [
        (20_000.0, Some("2.00 % fast")),
        (-20_000.0, Some("2.00 % slow")),
        (7_000.0, Some("0.70 % fast")),
        (3_000.0, None),
        (-37.0, None),
    ] {
        let mut b = bench_of(LinkKind::Stamped, |_| {}, |c| c.drift_ppm = drift_ppm);
        b.run_ms(10_000);
        let events = b.events("thruster.clock_rate");
        assert_eq!(events.len(), usize::from(said.is_some()), "{drift_ppm}");
        if let Some(words) = said {
            assert!(events[0].message.contains(words), "{}", events[0].message);
        }
        assert!(b.events("thruster.reset").is_empty(), "{drift_ppm}");
    }
}
