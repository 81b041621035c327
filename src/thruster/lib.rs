//! Thrusters: from a planned load to bytes on a wire, and back to an echo with the controller's own clock.
//!
//! The way of a command: [`scheduler`] says when a set-point is due, [`curve`] turns thrust into a pulse,
//! [`safety`] checks range and slew, [`link`] encodes it ([`maestro`] or [`stamped`]), [`service`] writes it,
//! stamps it when its last byte has left and stamps the echo. Everything but `service`, `transport`, `ports`
//! and the pseudo-terminal of [`controller`] is free of I/O and driven byte by byte in tests.
//!
//! Times ending in `_ns` in these modules are CLOCK_MONOTONIC unless the name says `unix`; the records that
//! leave the service are UNIX nanoseconds, converted in one place.
//!
//! ```
//! use hydroline_thruster::curve::pulse_for_thrust;
//!
//! let rig = hydroline_rigs::Rig::builtin("lshpi")?;
//! let curve = &rig.thrusters.thrusters[0].curve;
//! let pulse_us = pulse_for_thrust(curve, 1500.0, 5.0)?;
//! assert!(pulse_us > 1500.0 && (curve.thrust_n(pulse_us) - 5.0).abs() < 1e-9);
//! assert!(pulse_for_thrust(curve, 1500.0, 1e4).is_err());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

// Tests may unwrap; the library build is still checked.
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod clocksync;
pub mod controller;
pub mod curve;
pub mod link;
pub mod lowlatency;
pub mod maestro;
pub mod mavlink;
pub mod ports;
pub mod probe;
pub mod record;
pub mod safety;
pub mod scheduler;
pub mod service;
pub mod stamped;
pub mod transport;

// The loopback names this crate as the bench does.
#[cfg(test)]
extern crate self as hydroline_thruster;
#[cfg(test)]
#[path = "tests/loopback/mod.rs"]
mod loopback;

pub use record::{CommandRecord, ControllerClock, EchoRecord, LinkRecord};
pub use service::{NeutralHandle, PlanState, ServiceConfig, SetPoint, ThrusterService};

/// Names of the bits that are set; those above the `known` ones are unassigned and reported as such.
fn bit_names<const N: usize>(known: [&'static str; N], bits: u16) -> Vec<&'static str> {
    let is_set = |bit: &usize| bits & (1 << bit) != 0;
    let mut names: Vec<_> = (0..N).filter(is_set).map(|bit| known[bit]).collect();
    if bits >> N != 0 {
        names.push("unassigned error bit");
    }
    names
}

/// One channel's pulse as the wire carries it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ChannelPulse {
    /// Controller channel.
    pub channel: u8,
    /// Pulse width in quarters of a microsecond (the Maestro's unit); 0 = no pulses.
    pub quarter_us: u16,
}

impl ChannelPulse {
    /// From a pulse width \[us\], rounded to the wire's quarter microsecond.
    pub fn from_us(channel: u8, pulse_us: f64) -> Self {
        // `as` saturates and maps NaN to 0 (no pulses): both are refused by `safety` long before.
        Self {
            channel,
            quarter_us: (pulse_us * 4.0).round() as u16,
        }
    }

    /// Pulse width \[us\].
    pub fn pulse_us(self) -> f64 {
        f64::from(self.quarter_us) / 4.0
    }
}
