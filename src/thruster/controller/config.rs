//! Configuration of a simulated controller.

use hydroline_rigs::{LinkKind, ThrusterSet};

/// A simulated controller's properties.
#[derive(Debug, Clone, PartialEq)]
pub struct ControllerConfig {
    /// Protocol that it speaks.
    pub kind: LinkKind,
    /// Baud rate that paces both directions; `None` = native USB, not paced.
    pub baud: Option<u32>,
    /// Channels there are, e.g. 24.
    pub channels: Vec<u8>,
    /// Neutral \[us\].
    pub neutral_us: f64,
    /// Smallest pulse the stamped firmware accepts \[us\].
    pub min_us: f64,
    /// Largest \[us\].
    pub max_us: f64,
    /// Watchdog until Configure says otherwise \[ns\].
    pub watchdog_ns: u64,
    /// Its clock at host monotonic 0 \[us\]; wraps.
    pub clock_offset_us: u32,
    /// Its clock fast against the host's \[ppm\].
    pub drift_ppm: f64,
    /// Boot id at first.
    pub boot_id: u16,
    /// Time between a command's last byte and the first byte of the answer \[ns\].
    pub processing_ns: u64,
    /// Seed of the faults' randomness.
    pub seed: u64,
}

impl ControllerConfig {
    /// A controller that fits a rig: its channels, limits, baud rate, and its timeout as watchdog.
    pub fn for_rig(set: &ThrusterSet) -> Self {
        Self {
            kind: set.link.kind,
            baud: Some(set.link.baud),
            channels: set.thrusters.iter().map(|t| t.channel).collect(),
            neutral_us: set.neutral_us,
            min_us: set.min_us,
            max_us: set.max_us,
            watchdog_ns: (set.link.timeout_s.max(0.01) * 1e9) as u64,
            ..Self::bench(set.link.kind)
        }
    }

    /// Twelve channels at 115200 baud with a clock that is neither right nor steady: for tests and the HIL guest.
    pub fn bench(kind: LinkKind) -> Self {
        Self {
            kind,
            baud: Some(115_200),
            channels: (0..12).collect(),
            neutral_us: 1500.0,
            min_us: 1100.0,
            max_us: 1900.0,
            watchdog_ns: 500_000_000,
            clock_offset_us: 4_294_000_000,
            drift_ppm: 37.0,
            boot_id: 0x5a01,
            processing_ns: 60_000,
            seed: 1,
        }
    }
}
