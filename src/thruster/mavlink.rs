//! MAVLink 1 and 2 without I/O: bytes to frames ([`frame`]), frames to what an autopilot says ([`said`]), and the state
//! machine that follows it ([`follow`]).
//!
//! Messages by the crate `mavlink`, dialect ardupilotmega (it contains common). Only the messages named in [`said`] are
//! decoded. Source: <https://mavlink.io/en/guide/serialization.html>, <https://mavlink.io/en/services/timesync.html>.

pub mod autopilot;
pub mod follow;
pub mod frame;
pub mod said;

use super::ChannelPulse;

/// One message of the autopilot that belongs into the log. Host times CLOCK_MONOTONIC \[ns\].
#[derive(Debug, Clone, PartialEq)]
pub struct Heard {
    /// When it was true: by the autopilot's stamp and the clock's estimate, else [`Self::received_ns`] \[ns\].
    pub at_ns: u64,
    /// Last byte in \[ns\].
    pub received_ns: u64,
    /// Autopilot's clock \[us\], unwrapped; 0 = the message has no stamp.
    pub autopilot_us: u64,
    /// Its content.
    pub what: Content,
}

/// Content of a [`Heard`].
#[derive(Debug, Clone, PartialEq)]
pub enum Content {
    /// Pulses that the autopilot puts out; outputs that it does not use are missing.
    Outputs(Vec<ChannelPulse>),
    /// Motion by the autopilot's filter; `None` = not in this message.
    Motion(Motion),
    /// State besides the motion.
    State(State),
}

/// Motion in an autopilot's message. Attitude: north east down to the body, Euler ZYX; rates in the body.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Motion {
    /// Roll, pitch, yaw \[rad\].
    pub attitude_rad: Option<[f64; 3]>,
    /// Body rates p, q, r \[rad/s\].
    pub rates_radps: Option<[f64; 3]>,
    /// Depth below the autopilot's origin \[m\], positive down.
    pub depth_m: Option<f64>,
}

/// State in an autopilot's message; `None` = not in this message.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct State {
    /// Message that it comes from.
    pub message: &'static str,
    /// Whether it is armed.
    pub armed: Option<bool>,
    /// custom_mode.
    pub mode: Option<u32>,
    /// Battery \[V\].
    pub battery_v: Option<f64>,
    /// Battery \[A\].
    pub battery_a: Option<f64>,
    /// Index of the first ESC below, from 0.
    pub esc_first: u32,
    /// Rotational speeds \[rpm\].
    pub esc_rpm: Vec<f64>,
    /// Voltages \[V\].
    pub esc_v: Vec<f64>,
    /// Currents \[A\].
    pub esc_a: Vec<f64>,
    /// Place of the autopilot's filter, north east down from its origin \[m\].
    pub place_ned_m: Option<[f64; 3]>,
    /// Its velocity, north east down \[m/s\].
    pub velocity_ned_mps: Option<[f64; 3]>,
}

#[cfg(test)]
mod tests;
