use super::*;
use crate::stamped::{ControllerMessage, Deframer, HostMessage};
use hydroline_rigs::LinkKind;
use proptest::prelude::*;

impl SimController {
    /// Its clock at a host time \[us\], 32 bits.
    pub(crate) fn clock_us(&self, host_ns: u64) -> u32 {
        self.clock.read_us(host_ns)
    }
}

const MS: u64 = 1_000_000;

fn config(kind: LinkKind, baud: u32) -> ControllerConfig {
    ControllerConfig {
        baud: Some(baud),
        processing_ns: 0,
        ..ControllerConfig::bench(kind)
    }
}

/// Runs to `end_ns` in its own wake-ups; bytes with the time they were handed over.
fn run(c: &mut SimController, end_ns: u64) -> (Vec<(u64, u8)>, Vec<ControllerEvent>) {
    let (mut bytes, mut events) = (Vec::new(), Vec::new());
    while let Some(at_ns) = c.next_wake_ns().filter(|at| *at <= end_ns) {
        let mut out = Vec::new();
        c.poll(at_ns, &mut out, &mut |e| events.push(e));
        bytes.extend(out.into_iter().map(|b| (at_ns, b)));
    }
    c.poll(end_ns, &mut Vec::new(), &mut |e| events.push(e));
    (bytes, events)
}

fn messages(bytes: &[(u64, u8)]) -> Vec<(u64, ControllerMessage)> {
    let mut deframer = Deframer::default();
    bytes
        .iter()
        .filter_map(|(at, b)| {
            Some((
                *at,
                ControllerMessage::parse(&deframer.feed(*b)?.ok()?).ok()?,
            ))
        })
        .collect()
}

fn set_pulses(sequence: u32, quarter_us: u16) -> Vec<u8> {
    let pulses = vec![ChannelPulse {
        channel: 3,
        quarter_us,
    }];
    let mut out = Vec::new();
    HostMessage::SetPulses { sequence, pulses }.encode(&mut out);
    out
}

#[test]
fn a_round_trip_takes_exactly_the_wires_time_both_ways() {
    let mut c = SimController::new(config(LinkKind::Stamped, 9600));
    let request = set_pulses(1, 6400);
    c.receive(0, &request);
    let (bytes, events) = run(&mut c, 500 * MS);
    let byte_ns = 10 * 1_000_000_000 / 9600;
    assert_eq!(events[0].host_monotonic_ns, request.len() as u64 * byte_ns);
    let (at_ns, message) = messages(&bytes).remove(0);
    assert_eq!(at_ns, (request.len() + bytes.len()) as u64 * byte_ns);
    assert!(matches!(
        message,
        ControllerMessage::Ack { sequence: 1, .. }
    ));
}

#[test]
fn the_watchdog_acts_on_time_although_nobody_looked() {
    for kind in [LinkKind::Maestro, LinkKind::Stamped] {
        let mut c = SimController::new(config(kind, 115_200));
        let request = match kind {
            LinkKind::Mavlink => unreachable!("an autopilot has a simulation of its own"),
            LinkKind::Stamped => set_pulses(1, 6400),
            LinkKind::Maestro => crate::maestro::set_target(3, 6400).unwrap().to_vec(),
        };
        c.receive(0, &request);
        let mut events = Vec::new();
        // First looked at ten seconds later: the event still carries the moment it was due.
        c.poll(10_000 * MS, &mut Vec::new(), &mut |e| events.push(e));
        let commanded = events[0].host_monotonic_ns;
        let neutral: Vec<_> = events
            .iter()
            .filter(|e| e.cause == OutputCause::Watchdog)
            .collect();
        assert_eq!(neutral.len(), 12);
        assert!(
            neutral
                .iter()
                .all(|e| e.host_monotonic_ns == commanded + 500 * MS && e.pulse_us == 1500.0)
        );
    }
}

#[test]
fn a_refused_set_changes_nothing_and_says_so() {
    let mut c = SimController::new(config(LinkKind::Stamped, 115_200));
    c.receive(0, &set_pulses(1, 7601));
    let (bytes, events) = run(&mut c, 100 * MS);
    assert!(events.is_empty());
    match &messages(&bytes)[0].1 {
        ControllerMessage::Ack { errors, pulses, .. } => {
            assert_eq!(*errors, crate::stamped::error::RANGE);
            assert_eq!(
                pulses,
                &[ChannelPulse {
                    channel: 3,
                    quarter_us: 6000
                }]
            );
        }
        other => panic!("{other:?}"),
    }
}

proptest! {
    #[test]
    fn n_bytes_take_at_least_n_byte_times(
        chunks in prop::collection::vec((1usize..60, 0u64..20 * MS), 1..20), baud in 9600u32..1_000_000
    ) {
        let mut c = SimController::new(config(LinkKind::Maestro, baud));
        let (mut now, mut asked) = (0, 0u64);
        for (n, wait) in chunks {
            now += wait;
            // Each Get Errors (1 byte) is answered by two.
            c.receive(now, &vec![0xA1; n]);
            asked += n as u64;
        }
        let (bytes, _) = run(&mut c, u64::MAX / 2);
        prop_assert_eq!(bytes.len() as u64, 2 * asked);
        let byte_ns = 10_000_000_000 / u64::from(baud);
        for (k, (at, _)) in bytes.iter().enumerate() {
            // The k-th answer byte cannot come before its question's byte and k bytes of answers.
            prop_assert!(*at >= (k as u64 + 2) * byte_ns);
        }
    }

    #[test]
    fn arbitrary_bytes_never_panic_and_it_obeys_afterwards(
        garbage in prop::collection::vec(any::<u8>(), 0..300), maestro: bool
    ) {
        let kind = if maestro { LinkKind::Maestro } else { LinkKind::Stamped };
        let mut c = SimController::new(config(kind, 115_200));
        c.receive(0, &garbage);
        let clean = if maestro {
            crate::maestro::set_target(3, 6400).unwrap().to_vec()
        } else {
            [vec![0], set_pulses(1, 6400)].concat()
        };
        c.receive(100 * MS, &clean);
        run(&mut c, 200 * MS);
        let out = c.outputs().iter().find(|o| o.channel == 3).map(|o| o.quarter_us);
        prop_assert_eq!(out, Some(6400));
    }

    #[test]
    fn the_same_faults_from_the_same_seed(seed: u64) {
        let once = || {
            let mut c = SimController::new(ControllerConfig { seed, ..config(LinkKind::Stamped, 115_200) });
            c.set_faults(Faults { corrupt_tx: 0.05, corrupt_rx: 0.01, garbage: 0.5, ..Faults::default() });
            for k in 0..20 {
                c.receive(u64::from(k) * 10 * MS, &set_pulses(k, 6400));
            }
            run(&mut c, 400 * MS).0
        };
        prop_assert_eq!(once(), once());
    }
}
