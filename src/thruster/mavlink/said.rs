//! Frames to contents: which messages are read, in which units they come, and on which clock they are stamped.

use super::frame::Frame;
use super::{Content, Motion, State};
use crate::ChannelPulse;
use mavlink::MessageData;
use mavlink::dialects::ardupilotmega::{
    ACTUATOR_OUTPUT_STATUS_DATA, ATTITUDE_DATA, ESC_STATUS_DATA, ESC_TELEMETRY_1_TO_4_DATA,
    GLOBAL_POSITION_INT_DATA, LOCAL_POSITION_NED_DATA, SERVO_OUTPUT_RAW_DATA, SYS_STATUS_DATA,
};

/// Pulses that a servo output may have \[us\]; 0 and values without a unit are none.
const PULSE_US: std::ops::RangeInclusive<f64> = 500.0..=2500.0;

/// Messages asked of the autopilot at the rig's rate.
pub const FAST: [u32; 5] = [
    SERVO_OUTPUT_RAW_DATA::ID,
    ACTUATOR_OUTPUT_STATUS_DATA::ID,
    ATTITUDE_DATA::ID,
    GLOBAL_POSITION_INT_DATA::ID,
    LOCAL_POSITION_NED_DATA::ID,
];
/// Messages asked of it twice a second.
pub const SLOW: [u32; 3] = [
    SYS_STATUS_DATA::ID,
    ESC_STATUS_DATA::ID,
    ESC_TELEMETRY_1_TO_4_DATA::ID,
];

/// A content with the low 32 bits of its autopilot time \[us\]; `None` = the message has no stamp.
pub type Stamped = (Option<u32>, Content);

/// Contents of a frame; empty = nothing for the log.
pub fn contents(frame: &Frame) -> Vec<Stamped> {
    let all = [outputs(frame), motion(frame), state(frame)];
    all.into_iter().flatten().collect()
}

/// A stamp in milliseconds is cut, not rounded: half of one is the expected rest.
fn of_ms(time_boot_ms: u32) -> Option<u32> {
    Some(time_boot_ms.wrapping_mul(1000).wrapping_add(500))
}

fn outputs(frame: &Frame) -> Option<Stamped> {
    let pulses = |first: usize, us: &[f64]| {
        let used = us
            .iter()
            .enumerate()
            .filter(|(_, us)| PULSE_US.contains(us));
        let pulse = |(i, us): (usize, &f64)| ChannelPulse::from_us((first + i) as u8, *us);
        used.map(pulse).collect::<Vec<_>>()
    };
    let (stamp, pulses) = if let Some(m) = frame.message::<SERVO_OUTPUT_RAW_DATA>() {
        let us = [
            m.servo1_raw,
            m.servo2_raw,
            m.servo3_raw,
            m.servo4_raw,
            m.servo5_raw,
            m.servo6_raw,
            m.servo7_raw,
            m.servo8_raw,
            m.servo9_raw,
            m.servo10_raw,
            m.servo11_raw,
            m.servo12_raw,
            m.servo13_raw,
            m.servo14_raw,
            m.servo15_raw,
            m.servo16_raw,
        ];
        // A port is a bank of 16 outputs (0 = main).
        (
            m.time_usec,
            pulses(16 * usize::from(m.port.min(1)), &us.map(f64::from)),
        )
    } else {
        let m = frame.message::<ACTUATOR_OUTPUT_STATUS_DATA>()?;
        (m.time_usec as u32, pulses(0, &m.actuator.map(f64::from)))
    };
    (!pulses.is_empty()).then_some((Some(stamp), Content::Outputs(pulses)))
}

fn motion(frame: &Frame) -> Option<Stamped> {
    let (stamp, motion) = if let Some(m) = frame.message::<ATTITUDE_DATA>() {
        let motion = Motion {
            attitude_rad: Some([m.roll, m.pitch, m.yaw].map(f64::from)),
            rates_radps: Some([m.rollspeed, m.pitchspeed, m.yawspeed].map(f64::from)),
            depth_m: None,
        };
        (of_ms(m.time_boot_ms), motion)
    } else {
        let m = frame.message::<GLOBAL_POSITION_INT_DATA>()?;
        let motion = Motion {
            depth_m: Some(-1e-3 * f64::from(m.relative_alt)),
            ..Motion::default()
        };
        (of_ms(m.time_boot_ms), motion)
    };
    Some((stamp, Content::Motion(motion)))
}

fn state(frame: &Frame) -> Option<Stamped> {
    let (stamp, state) = if let Some(m) = frame.message::<LOCAL_POSITION_NED_DATA>() {
        let state = State {
            message: LOCAL_POSITION_NED_DATA::NAME,
            place_ned_m: Some([m.x, m.y, m.z].map(f64::from)),
            velocity_ned_mps: Some([m.vx, m.vy, m.vz].map(f64::from)),
            ..State::default()
        };
        (of_ms(m.time_boot_ms), state)
    } else if let Some(m) = frame.message::<SYS_STATUS_DATA>() {
        let state = State {
            message: SYS_STATUS_DATA::NAME,
            // 65535 and -1: not measured.
            battery_v: (m.voltage_battery != u16::MAX).then(|| 1e-3 * f64::from(m.voltage_battery)),
            battery_a: (m.current_battery >= 0).then(|| 1e-2 * f64::from(m.current_battery)),
            ..State::default()
        };
        (None, state)
    } else if let Some(m) = frame.message::<ESC_STATUS_DATA>() {
        let state = State {
            message: ESC_STATUS_DATA::NAME,
            esc_first: m.index.into(),
            esc_rpm: m.rpm.map(f64::from).to_vec(),
            esc_v: m.voltage.map(f64::from).to_vec(),
            esc_a: m.current.map(f64::from).to_vec(),
            ..State::default()
        };
        (Some(m.time_usec as u32), state)
    } else {
        let m = frame.message::<ESC_TELEMETRY_1_TO_4_DATA>()?;
        let centi = |values: [u16; 4]| values.map(|v| 1e-2 * f64::from(v)).to_vec();
        let state = State {
            message: ESC_TELEMETRY_1_TO_4_DATA::NAME,
            esc_rpm: m.rpm.map(f64::from).to_vec(),
            esc_v: centi(m.voltage),
            esc_a: centi(m.current),
            ..State::default()
        };
        (None, state)
    };
    Some((stamp, Content::State(state)))
}
