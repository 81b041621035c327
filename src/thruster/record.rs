//! Records of the thruster service, ready for the log: fields of `hydroline.proto`, times UNIX \[ns\].

use super::mavlink::Content;
use hydroline_core::event::Event;
use std::sync::Arc;

/// One command to one thruster, stamped when its last byte left the host (`hydroline.ThrusterCommand`).
///
/// One set of commands (all thrusters) shares one `sequence`; per thruster, a gap is a loss.
#[derive(Debug, Clone, PartialEq)]
pub struct CommandRecord {
    /// Last byte out, UNIX \[ns\].
    pub timestamp_ns: u64,
    /// The same on CLOCK_MONOTONIC \[ns\]: what supervision goes by, for the wall clock may be set meanwhile.
    pub sent_monotonic_ns: u64,
    /// Counts sets of commands.
    pub sequence: u32,
    /// Name in the rig file.
    pub thruster: Arc<str>,
    /// Thrust at the pulse that was sent \[N\] (differs from the plan's only while the slew limit acts).
    pub thrust_n: f64,
    /// Pulse that was sent \[us\].
    pub pulse_us: f64,
    /// When the plan wanted it, UNIX \[ns\]; 0 = at once.
    pub due_ns: u64,
    /// Step of the plan, from 1; 0 = none.
    pub plan_step: u32,
    /// `plan`, `setpoint`, `hold`, or why neutral: `neutral`, `deadline`, `exit`, `panic`, `lost`, ...
    pub cause: &'static str,
}

/// The controller's answer to one command (`hydroline.ThrusterEcho`).
#[derive(Debug, Clone, PartialEq)]
pub struct EchoRecord {
    /// Last byte of the answer in, UNIX \[ns\].
    pub timestamp_ns: u64,
    /// Of the command answered.
    pub sequence: u32,
    /// Name in the rig file.
    pub thruster: Arc<str>,
    /// Pulse that the controller says it puts out \[us\].
    pub pulse_us: f64,
    /// Controller clock when the command took effect \[us\], unwrapped; 0 where the link has none.
    pub controller_time_us: u64,
    /// Last byte out to last byte in \[s\].
    pub round_trip_s: f64,
    /// Controller's error bits.
    pub errors: u32,
}

/// State of the controller's clock (`hydroline.ControllerClock`):
/// `controller_us = offset_us + (host_monotonic_us - host_epoch_us) (1 + drift_ppm 1e-6)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ControllerClock {
    /// Controller clock (unwrapped) at the host's epoch \[us\].
    pub offset_us: f64,
    /// Its standard deviation \[us\]: statistics and the unobservable asymmetry of the path together.
    pub offset_sd_us: f64,
    /// Controller fast against host \[ppm\].
    pub drift_ppm: f64,
    /// Its standard deviation \[ppm\].
    pub drift_sd_ppm: f64,
    /// Round trip, median \[us\].
    pub round_trip_us: f64,
    /// Round trip, 95th percentile minus minimum \[us\].
    pub round_trip_spread_us: f64,
    /// Samples in the fit.
    pub samples: u32,
    /// CLOCK_MONOTONIC the fit is centred on \[ns\].
    pub host_epoch_ns: u64,
    /// `offset_us` rounded: the controller clock the fit is centred on \[us\].
    pub controller_epoch_us: u64,
}

/// What an autopilot says besides its outputs.
#[derive(Debug, Clone, PartialEq)]
pub struct HeardRecord {
    /// When it was true, UNIX \[ns\].
    pub timestamp_ns: u64,
    /// Autopilot's clock \[us\], unwrapped; 0 = the message has no stamp.
    pub autopilot_us: u64,
    /// Its content, never [`Content::Outputs`].
    pub what: Content,
}

/// One record of the thruster service.
#[derive(Debug, Clone, PartialEq)]
pub enum LinkRecord {
    /// To `/thruster/command`.
    Command(CommandRecord),
    /// To `/thruster/echo`.
    Echo(EchoRecord),
    /// To `/daemon/event`.
    Event(Event),
    /// To the `controller` field of `/clock`.
    Clock(ControllerClock),
    /// To `/autopilot/motion` or `/autopilot/state`.
    Heard(HeardRecord),
    /// The autopilot's side begins or ends the recording.
    Recording {
        /// Whether it begins.
        on: bool,
    },
}
