//! Errors that are found before a byte is sent.

use crate::link::{Protocol, protocol_for};
use crate::safety::State;
use crate::stamped::MAX_CHANNELS;
use crate::transport::Wire;
use hydroline_rigs::ThrusterSet;

/// Reason why the service does not start or take something.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum ServiceError {
    #[error(
        "{channels} thrusters at {rate_hz} /s need {needed_s:.4} s of wire time per set at {baud} baud, the period is {period_s:.4} s: raise link.baud or lower link.rate_hz"
    )]
    TooSlow {
        channels: usize,
        rate_hz: f64,
        /// Wire time of a set and its echo, the longer direction \[s\].
        needed_s: f64,
        period_s: f64,
        baud: u32,
    },
    /// Two thrusters on one channel, or too many.
    #[error("thruster channels {channels:?}: {reason}")]
    Channels {
        channels: Vec<u8>,
        reason: &'static str,
    },
    #[error("cannot start the thruster thread: {0}")]
    Thread(std::io::Error),
    #[error("the thruster service has ended ({state:?}): see its events")]
    Ended { state: State },
    #[error("the thruster service's queue is full: set-points come faster than link.rate_hz")]
    Full,
}

/// Whether a rig's thrusters and link work together: channels, and the wire's time against the rate. Opens nothing.
///
/// # Errors
/// As [`super::ThrusterService::start`], without starting anything.
pub fn check_set(set: &ThrusterSet) -> Result<(), ServiceError> {
    check(set, &*protocol_for(set))
}

/// Channels and wire time of a rig.
pub(super) fn check(set: &ThrusterSet, protocol: &dyn Protocol) -> Result<(), ServiceError> {
    let channels: Vec<u8> = set.thrusters.iter().map(|t| t.channel).collect();
    let mut sorted = channels.clone();
    sorted.sort_unstable();
    sorted.dedup();
    let most = MAX_CHANNELS;
    let wrong = match () {
        () if channels.is_empty() => Some("there are none"),
        () if sorted.len() != channels.len() => Some("each thruster needs a channel of its own"),
        () if channels.len() > most => Some("more than 24 do not fit a frame"),
        () if sorted.iter().any(|c| *c >= 0x80) => Some("channels go from 0 to 127"),
        () => None,
    };
    if let Some(reason) = wrong {
        return Err(ServiceError::Channels { channels, reason });
    }
    let link = &set.link;
    let (out, back) = protocol.bytes_per_set(channels.len());
    let needed_s = Wire::Uart { baud: link.baud }.time_ns(out.max(back)) as f64 * 1e-9;
    let period_s = 1.0 / link.rate_hz;
    // A fifth is left for clock sync, error reads and repeated neutrals.
    if needed_s > 0.8 * period_s {
        let (channels, rate_hz, baud) = (channels.len(), link.rate_hz, link.baud);
        return Err(ServiceError::TooSlow {
            channels,
            rate_hz,
            needed_s,
            period_s,
            baud,
        });
    }
    Ok(())
}
