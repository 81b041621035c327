//! One test body, both protocols, against the simulated controller in memory.

use super::*;
use crate::controller::{ControllerConfig, Faults, OutputCause};
use crate::loopback::Loopback;
use hydroline_core::clock::{Clock, ManualClock};
use hydroline_rigs::{Link, LinkPort, ThrustCurve, Thruster};
use std::sync::Arc;

const MS: u64 = 1_000_000;
const KINDS: [LinkKind; 2] = [LinkKind::Maestro, LinkKind::Stamped];

fn set(kind: LinkKind) -> ThrusterSet {
    let thruster = |name: &str, channel| Thruster {
        name: name.into(),
        channel,
        position_m: [0.0; 3],
        direction: [1.0, 0.0, 0.0],
        curve: ThrustCurve {
            points: vec![(1100.0, -40.0), (1900.0, 40.0)],
        },
    };
    ThrusterSet {
        link: Link {
            kind,
            port: LinkPort::Sim,
            baud: 115_200,
            rate_hz: 50.0,
            deadline_s: 0.02,
            timeout_s: 0.2,
            mavlink: None,
        },
        thrusters: vec![thruster("port", 0), thruster("starboard", 3)],
        neutral_us: 1500.0,
        min_us: 1100.0,
        max_us: 1900.0,
        max_slew_us_per_s: 4000.0,
        scale_sd: None,
    }
}

fn link(
    kind: LinkKind,
    change: impl FnOnce(&mut ControllerConfig),
) -> (ThrusterLink, Loopback, Arc<ManualClock>) {
    let clock = Arc::new(ManualClock::new(1_000_000_000, 1_700_000_000_000_000_000));
    let mut config = ControllerConfig::bench(kind);
    change(&mut config);
    let cable = Loopback::new(config, clock.clone());
    let line = cable.open().unwrap();
    let mut link = ThrusterLink::new(
        protocol_for(&set(kind)),
        Box::new(line),
        Duration::from_millis(100),
    );
    link.open().unwrap();
    (link, cable, clock)
}

fn pulses(us: f64) -> Vec<ChannelPulse> {
    vec![ChannelPulse::from_us(0, us), ChannelPulse::from_us(3, us)]
}

fn poll_for(link: &mut ThrusterLink, clock: &ManualClock, ms: u64) -> Vec<LinkEvent> {
    let end_ns = clock.monotonic_ns() + ms * MS;
    let mut events = Vec::new();
    while clock.monotonic_ns() < end_ns {
        events.extend(link.poll(Duration::from_millis(1)).unwrap());
    }
    events
}

fn echoes(events: &[LinkEvent]) -> Vec<&Echo> {
    events
        .iter()
        .filter_map(|e| {
            if let LinkEvent::Echo(echo) = e {
                Some(echo)
            } else {
                None
            }
        })
        .collect()
}

#[test]
fn every_command_is_echoed_in_order_with_what_was_asked() {
    for kind in KINDS {
        let (mut link, _cable, clock) = link(kind, |_| {});
        for k in 1..=100u32 {
            let sent = link.send(k, &pulses(1500.0 + f64::from(k)), false).unwrap();
            let events = poll_for(&mut link, &clock, 19);
            let echoes = echoes(&events);
            assert_eq!(echoes.len(), 1, "{kind:?} {k}");
            assert_eq!(echoes[0].sequence, k);
            assert_eq!(echoes[0].pulses, pulses(1500.0 + f64::from(k)));
            assert!(echoes[0].received_ns > sent.last_byte_out_ns);
            assert!(
                !events
                    .iter()
                    .any(|e| matches!(e, LinkEvent::Garbage { .. })),
                "{kind:?}"
            );
        }
        assert!(link.silent_since_ns().is_none());
    }
}

#[test]
fn pulses_take_effect_when_the_last_byte_has_arrived() {
    for kind in KINDS {
        let (mut link, cable, clock) = link(kind, |_| {});
        poll_for(&mut link, &clock, 50);
        cable.take_events();
        let sent = link.send(1, &pulses(1600.0), false).unwrap();
        poll_for(&mut link, &clock, 20);
        let events = cable.take_events();
        assert_eq!(events.len(), 2, "{kind:?}");
        let last = events.iter().map(|e| e.host_monotonic_ns).max().unwrap();
        // The Maestro obeys each Set Target as it comes, before the Get Positions behind it.
        let behind_ns = match kind {
            LinkKind::Mavlink => unreachable!("an autopilot has a simulation of its own"),
            LinkKind::Stamped => 0,
            LinkKind::Maestro => 4 * 10_000_000_000 / 115_200,
        };
        // Whole nanoseconds per byte on the far side, per write on ours: below 1 ns a byte.
        assert!(
            (sent.last_byte_out_ns - behind_ns).abs_diff(last) < 32,
            "{kind:?}"
        );
        assert!(
            events
                .iter()
                .all(|e| e.pulse_us == 1600.0 && e.cause == OutputCause::Command)
        );
    }
}

#[test]
fn a_mute_controller_is_silent_and_its_commands_unanswered() {
    for kind in KINDS {
        let (mut link, cable, clock) = link(kind, |_| {});
        poll_for(&mut link, &clock, 100);
        cable.with(|c| {
            c.set_faults(Faults {
                mute: true,
                ..Faults::default()
            })
        });
        link.send(7, &pulses(1510.0), false).unwrap();
        let events = poll_for(&mut link, &clock, 400);
        assert!(
            events.iter().any(|e| matches!(
                e,
                LinkEvent::Unanswered {
                    sequence: 7,
                    sets: 1
                }
            )),
            "{kind:?}: {events:?}"
        );
        assert!(link.silent_since_ns().is_some());
        cable.with(|c| c.set_faults(Faults::default()));
        let events = poll_for(&mut link, &clock, 1200);
        assert!(events.iter().any(LinkEvent::is_sound), "{kind:?}");
        link.send(8, &pulses(1520.0), false).unwrap();
        let events = poll_for(&mut link, &clock, 50);
        assert_eq!(echoes(&events).len(), 1, "{kind:?}");
    }
}

#[test]
fn damaged_bytes_never_make_a_wrong_echo_and_the_link_recovers() {
    for kind in KINDS {
        let (mut link, cable, clock) = link(kind, |_| {});
        let faults = Faults {
            corrupt_tx: 0.02,
            garbage: 0.1,
            ..Faults::default()
        };
        cable.with(|c| c.set_faults(faults));
        let (mut good, mut wrong) = (0, 0);
        for k in 1..=300u32 {
            let wanted = pulses(1500.0 + f64::from(k % 50));
            link.send(k, &wanted, false).unwrap();
            for echo in echoes(&poll_for(&mut link, &clock, 19)) {
                good += 1;
                wrong += usize::from(echo.sequence == k && echo.pulses != wanted);
            }
        }
        // The Maestro's answers carry no check: a flipped bit inside the believable range cannot be noticed on
        // the wire. The stamped protocol's can.
        if kind == LinkKind::Stamped {
            assert_eq!(wrong, 0);
        }
        assert!(good > 100, "{kind:?}: {good}");
        cable.with(|c| c.set_faults(Faults::default()));
        poll_for(&mut link, &clock, 300);
        link.send(1000, &pulses(1555.0), false).unwrap();
        let events = poll_for(&mut link, &clock, 50);
        assert_eq!(echoes(&events).len(), 1, "{kind:?}");
        assert_eq!(echoes(&events)[0].pulses, pulses(1555.0));
    }
}

#[test]
fn the_stamped_link_finds_the_controllers_clock() {
    let (mut link, cable, clock) = link(LinkKind::Stamped, |c| c.drift_ppm = -180.0);
    for k in 1..=1500u32 {
        link.send(k, &pulses(1500.0), false).unwrap();
        poll_for(&mut link, &clock, 20);
    }
    let e = link.clock().unwrap();
    assert!((e.drift_ppm + 180.0).abs() < 2.0, "{e:?}");
    let now_ns = clock.monotonic_ns();
    let truth = cable.with(|c| c.clock_us(now_ns));
    let error = (e.controller_at_us(now_ns).round() as u64 as u32).wrapping_sub(truth) as i32;
    println!("offset error {error} us, {e:?}");
    // The rest of the polling step (1 us here) and whole microseconds; the wire's own time must have cancelled.
    assert!(error.abs() <= 20, "{error} us");
    // Echo and command agree on one time scale.
    let sent = link.send(2000, &pulses(1600.0), false).unwrap();
    let events = poll_for(&mut link, &clock, 20);
    let took_effect_us = echoes(&events)[0].controller_time_us as f64;
    assert!((took_effect_us - e.controller_at_us(sent.last_byte_out_ns)).abs() < 30.0);
}

#[test]
fn a_controller_reset_is_reported_and_it_is_configured_again() {
    let (mut link, cable, clock) = link(LinkKind::Stamped, |c| c.watchdog_ns = 5_000_000_000);
    poll_for(&mut link, &clock, 3000);
    cable.with(|c| c.reset(clock.monotonic_ns(), &mut |_| {}));
    let events = poll_for(&mut link, &clock, 1500);
    assert!(
        events.iter().any(|e| matches!(e, LinkEvent::Reset { .. })),
        "{events:?}"
    );
    // Configured again: the watchdog is the rig's 0.2 s, not the firmware's 5 s.
    cable.take_events();
    link.send(1, &pulses(1600.0), false).unwrap();
    poll_for(&mut link, &clock, 10);
    cable.with(|c| {
        c.set_faults(Faults {
            deaf: true,
            ..Faults::default()
        })
    });
    poll_for(&mut link, &clock, 400);
    let tripped = cable.take_events();
    assert!(
        tripped.iter().any(|e| e.cause == OutputCause::Watchdog),
        "{tripped:?}"
    );
}

#[test]
fn an_old_handle_does_not_work_on_a_new_cable() {
    let (mut link, cable, _clock) = link(LinkKind::Stamped, |_| {});
    cable.unplug();
    assert_eq!(
        link.poll(Duration::from_millis(1)).unwrap_err().kind(),
        io::ErrorKind::BrokenPipe
    );
    assert!(cable.open().is_err());
    cable.replug();
    assert!(link.send(1, &pulses(1500.0), false).is_err());
    assert!(cable.open().is_ok());
}

#[test]
fn delayed_answers_are_still_answers_and_only_the_round_trip_grows() {
    for kind in KINDS {
        let (mut link, cable, clock) = link(kind, |_| {});
        poll_for(&mut link, &clock, 100);
        cable.with(|c| {
            c.set_faults(Faults {
                delay_ns: 60 * MS,
                ..Faults::default()
            })
        });
        let mut heard = Vec::new();
        for k in 1..=50u32 {
            link.send(k, &pulses(1500.0 + f64::from(k)), false).unwrap();
            heard.extend(poll_for(&mut link, &clock, 20));
        }
        heard.extend(poll_for(&mut link, &clock, 100));
        let echoes = echoes(&heard);
        assert_eq!(
            echoes.iter().map(|e| e.sequence).collect::<Vec<_>>(),
            (1..=50).collect::<Vec<_>>(),
            "{kind:?}"
        );
        assert!(
            echoes
                .iter()
                .all(|e| e.round_trip_ns >= 60 * MS && e.round_trip_ns < 70 * MS),
            "{kind:?}"
        );
        assert!(!heard.iter().any(|e| !e.is_sound()), "{kind:?}");
    }
}
