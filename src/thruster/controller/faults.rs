//! Faults of the simulated controller and its cable.

use rand::rngs::StdRng;
use rand::{Rng, RngExt};

/// Faults that are simulated. Default: none.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Faults {
    /// It listens and obeys, but never answers.
    pub mute: bool,
    /// It hears nothing: the watchdog will see to neutral.
    pub deaf: bool,
    /// It obeys, but its acknowledgements carry sequence numbers of its own (`stamped`): alive, yet nothing is echoed.
    pub misnumbered: bool,
    /// It acknowledges set-points but its outputs do not follow them.
    pub stuck: bool,
    /// It obeys, but its acknowledgements name no channel (`stamped`): nothing says what it puts out.
    pub without_channels: bool,
    /// Error bits that are set again before every answer.
    pub errors: u16,
    /// Chance that a byte towards the host has one bit flipped.
    pub corrupt_tx: f64,
    /// Chance that a byte towards the controller has one bit flipped.
    pub corrupt_rx: f64,
    /// Chance that 1 to 16 random bytes come before an answer.
    pub garbage: f64,
    /// Every answer this much later, behind the controller's own stamps \[ns\].
    pub delay_ns: u64,
}

impl Faults {
    pub(super) fn corrupt(&self, byte: u8, chance: f64, rng: &mut StdRng) -> u8 {
        if chance > 0.0 && rng.random_bool(chance.min(1.0)) {
            byte ^ (1 << rng.random_range(0..8))
        } else {
            byte
        }
    }

    pub(super) fn garbage(&self, rng: &mut StdRng) -> Vec<u8> {
        if self.garbage <= 0.0 || !rng.random_bool(self.garbage.min(1.0)) {
            return Vec::new();
        }
        let mut bytes = vec![0; rng.random_range(1..=16)];
        rng.fill_bytes(&mut bytes);
        bytes
    }
}
