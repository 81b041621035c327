//! Meaning of the fields of known kinds of messages.

use super::super::meaning::{Meaning, meaning};
use crate::recorded::TopicContents;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum What {
    /// Place, whether its axis is reversed against ours, whether it is along the tank's axes (`None` = not known).
    Channel(usize, bool, Option<bool>),
    /// Of w x y z.
    Quaternion(usize),
    Load(usize, bool),
    /// A pulse or a share of one thruster's.
    Thruster,
}

use What::{Channel, Load, Quaternion, Thruster};

/// Parts of the motion that come from one topic each.
pub(super) const GROUPS: [&str; 4] = ["position", "orientation", "velocity", "rates"];

pub(super) fn group(what: What) -> Option<usize> {
    match what {
        Channel(place @ 0..12, ..) => Some(place / 3),
        Quaternion(_) => Some(1),
        _ => None,
    }
}

fn index(path: &str, name: &str) -> Option<usize> {
    let rest = path.strip_prefix(name)?.strip_prefix('[')?;
    rest.strip_suffix(']')?.parse().ok()
}

/// Axes x forward, y to port, z up (REP 103).
pub(super) fn ros(topic: &TopicContents, path: &str) -> Option<What> {
    let mut parts = path.rsplit('.');
    let (last, above) = (parts.next()?, parts.next().unwrap_or(""));
    let axis = ["x", "y", "z"].iter().position(|a| *a == last);
    let rotated = axis.is_some_and(|a| a > 0);
    let schema = topic.schema.as_str();
    match (above, axis) {
        // Speeds that are wanted are neither measured nor loads.
        ("linear" | "angular", _) if is_wish(&topic.topic) => None,
        ("position" | "translation" | "point", Some(a)) => Some(Channel(a, rotated, None)),
        ("orientation" | "rotation" | "quaternion", _) => {
            let c = ["w", "x", "y", "z"].iter().position(|a| *a == last)?;
            Some(Quaternion(c))
        }
        ("linear", Some(a)) if !schema.contains("Accel") => {
            // Of an odometry they are those of the child frame; of a bare twist nobody says.
            let frame = schema.ends_with("Odometry").then_some(false);
            Some(Channel(6 + a, rotated, frame))
        }
        ("angular" | "angular_velocity", Some(a)) if !schema.contains("Accel") => {
            Some(Channel(9 + a, rotated, None))
        }
        ("force", Some(a)) => Some(Load(a, rotated)),
        ("torque", Some(a)) => Some(Load(3 + a, rotated)),
        _ if path == "data" => match meaning(&topic.topic, "") {
            Meaning::Channel(place @ 0..12) => Some(Channel(place, false, None)),
            Meaning::Load(d) => Some(Load(d, false)),
            Meaning::Thruster => Some(Thruster),
            _ => None,
        },
        _ if index(path, "data").is_some() => match meaning(&topic.topic, "") {
            Meaning::Load(_) | Meaning::Thruster => Some(Thruster),
            _ => None,
        },
        _ => None,
    }
}

/// Axes x forward or north, y to starboard or east, z down: ArduPilot, MAVLink, PX4.
pub(super) fn autopilot(topic: &TopicContents, path: &str) -> Option<What> {
    let own = |names: &[&str]| names.iter().position(|n| *n == path);
    let of = |first: usize, tank: Option<bool>, names: &[&str]| {
        own(names).map(|i| Channel(first + i, false, tank))
    };
    let array = |first: usize, tank: Option<bool>, name: &str| {
        index(path, name)
            .filter(|i| *i < 3)
            .map(|i| Channel(first + i, false, tank))
    };
    match topic.schema.as_str() {
        "XKF1" | "NKF1" | "SIM2" => of(0, None, &["PN", "PE", "PD", "Roll", "Pitch", "Yaw"])
            .or_else(|| of(6, Some(true), &["VN", "VE", "VD"])),
        "ATT" | "AHR2" | "SIM" => of(3, None, &["Roll", "Pitch", "Yaw"]),
        "IMU" | "IMU2" | "IMU3" => of(9, None, &["GyrX", "GyrY", "GyrZ"]),
        "RATE" => of(9, None, &["R", "P", "Y"]),
        "RCOU" | "RCO2" | "RCO3" => {
            let number = path.strip_prefix('C')?;
            number.parse::<u8>().ok().map(|_| Thruster)
        }
        "ATTITUDE" | "VISION_POSITION_ESTIMATE" | "AHRS2" | "SIM_STATE" | "SIMSTATE" => {
            let known = of(3, None, &["roll", "pitch", "yaw"])
                .or_else(|| of(9, None, &["rollspeed", "pitchspeed", "yawspeed"]));
            match topic.schema.as_str() {
                "VISION_POSITION_ESTIMATE" => known.or_else(|| of(0, None, &["x", "y", "z"])),
                _ => known,
            }
        }
        "ATTITUDE_QUATERNION" => own(&["q1", "q2", "q3", "q4"])
            .map(Quaternion)
            .or_else(|| of(9, None, &["rollspeed", "pitchspeed", "yawspeed"])),
        "LOCAL_POSITION_NED" | "LOCAL_POSITION_NED_COV" => {
            of(0, None, &["x", "y", "z"]).or_else(|| of(6, Some(true), &["vx", "vy", "vz"]))
        }
        "ODOMETRY" => of(0, None, &["x", "y", "z"])
            .or_else(|| of(6, None, &["vx", "vy", "vz"]))
            .or_else(|| of(9, None, &["rollspeed", "pitchspeed", "yawspeed"]))
            .or_else(|| index(path, "q").map(Quaternion)),
        "SERVO_OUTPUT_RAW" => path.starts_with("servo").then_some(Thruster),
        "vehicle_local_position" | "vehicle_local_position_groundtruth" => {
            of(0, None, &["x", "y", "z"]).or_else(|| of(6, Some(true), &["vx", "vy", "vz"]))
        }
        "vehicle_attitude" | "vehicle_attitude_groundtruth" => index(path, "q")
            .map(Quaternion)
            .or_else(|| of(9, None, &["rollspeed", "pitchspeed", "yawspeed"])),
        "vehicle_angular_velocity" | "vehicle_angular_velocity_groundtruth" => {
            array(9, None, "xyz")
        }
        "vehicle_odometry" | "vehicle_visual_odometry" | "vehicle_mocap_odometry" => {
            array(0, None, "position")
                .or_else(|| array(6, None, "velocity"))
                .or_else(|| array(9, None, "angular_velocity"))
                .or_else(|| index(path, "q").map(Quaternion))
                .or_else(|| of(0, None, &["x", "y", "z"]))
                .or_else(|| of(6, None, &["vx", "vy", "vz"]))
                .or_else(|| of(9, None, &["rollspeed", "pitchspeed", "yawspeed"]))
        }
        "sensor_combined" => array(9, None, "gyro_rad"),
        "actuator_outputs" => index(path, "output").map(|_| Thruster),
        "actuator_motors" => index(path, "control").map(|_| Thruster),
        _ => None,
    }
}

pub(super) fn is_wish(topic: &str) -> bool {
    let small = topic.to_lowercase();
    [
        "setpoint",
        "desired",
        "target",
        "reference",
        "cmd_vel",
        "goal",
    ]
    .iter()
    .any(|w| small.contains(w))
}
