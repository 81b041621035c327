//! Cost of a command on the host: encoding, decoding, the clock fit, a whole turn of the service's link in memory.
//!
//! `cargo bench -p hydroline-thruster --bench thruster`. A command period is 20 ms at 50 Hz: every figure here should vanish beside it.
#![allow(clippy::unwrap_used, missing_docs)]

use divan::Bencher;
use hydroline_core::clock::{Clock, ManualClock};
use hydroline_rigs::LinkKind;
use hydroline_thruster::ChannelPulse;
use hydroline_thruster::clocksync::{ClockSync, Exchange, SyncSettings};
use hydroline_thruster::controller::ControllerConfig;
use hydroline_thruster::link::{LinkEvent, MaestroProtocol, ThrusterLink};
use hydroline_thruster::stamped::{Deframer, HostMessage};
use loopback::Loopback;
use std::sync::Arc;
use std::time::Duration;

#[path = "../tests/loopback/mod.rs"]
mod loopback;

fn main() {
    divan::main();
}

fn pulses() -> Vec<ChannelPulse> {
    (0..8)
        .map(|channel| ChannelPulse::from_us(channel, 1500.0 + f64::from(channel)))
        .collect()
}

#[divan::bench]
fn stamped_encode_eight_channels(bencher: Bencher) {
    let message = HostMessage::SetPulses {
        sequence: 7,
        pulses: pulses(),
    };
    bencher.bench_local(|| {
        let mut out = Vec::with_capacity(64);
        message.encode(&mut out);
        out
    });
}

#[divan::bench]
fn stamped_deframe_and_parse_eight_channels(bencher: Bencher) {
    let mut bytes = Vec::new();
    HostMessage::SetPulses {
        sequence: 7,
        pulses: pulses(),
    }
    .encode(&mut bytes);
    let mut deframer = Deframer::default();
    bencher.bench_local(|| {
        let payload = bytes.iter().find_map(|b| deframer.feed(*b)).unwrap();
        HostMessage::parse(&payload.unwrap()).unwrap()
    });
}

/// One more exchange into a full window: 60 s at 2 Hz.
#[divan::bench]
fn clock_fit_over_120_exchanges(bencher: Bencher) {
    let mut sync = ClockSync::new(SyncSettings::default());
    let mut k = 0u64;
    let mut add = move || {
        k += 1;
        let t1_ns = k * 500_000_000;
        let jitter_us = (k * 7919) % 400;
        let t2_us = (t1_ns / 1000 + 300 + jitter_us) as u32;
        let t4_ns = t1_ns + (900 + 2 * jitter_us) * 1000;
        sync.add(Exchange {
            t1_ns,
            t2_us,
            t3_us: t2_us.wrapping_add(300),
            t4_ns,
            boot_id: 1,
        })
    };
    for _ in 0..120 {
        add();
    }
    bencher.bench_local(add);
}

/// A set of eight targets to the simulated Maestro and the echo of all eight back, in simulated time.
#[divan::bench]
fn maestro_command_and_echo_in_memory(bencher: Bencher) {
    let clock = Arc::new(ManualClock::new(1_000_000_000, 0));
    let cable = Loopback::new(ControllerConfig::bench(LinkKind::Maestro), clock.clone());
    let protocol = Box::new(MaestroProtocol::new(1100.0, 1900.0, 200_000_000));
    let mut link = ThrusterLink::new(
        protocol,
        Box::new(cable.open().unwrap()),
        Duration::from_millis(100),
    );
    link.open().unwrap();
    let (pulses, mut sequence) = (pulses(), 0);
    bencher.bench_local(|| {
        sequence += 1;
        link.send(sequence, &pulses, false).unwrap();
        let begin_ns = clock.monotonic_ns();
        while !link
            .poll(Duration::from_millis(5))
            .unwrap()
            .iter()
            .any(|e| matches!(e, LinkEvent::Echo(_)))
        {
            assert!(clock.monotonic_ns() < begin_ns + 1_000_000_000, "no echo");
        }
    });
}
