//! Meaning of a column by its name.

pub(super) mod words;
pub(super) mod written;

pub(super) use words::Words;
use words::{is_way_or_speed, split, tells_time};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Meaning {
    /// A stamp.
    Time,
    /// Whole seconds, and the nanoseconds that go with them.
    Seconds,
    Nanoseconds,
    /// A counter of frames.
    Frame,
    /// A date, and the clock that goes with it.
    Date,
    /// A place of `/vehicle/motion`.
    Channel(usize),
    /// Velocity along axes that may be the body's or the tank's.
    Velocity(usize),
    /// Velocity to the north, to the east, downwards: along the tank's axes.
    Ground(usize),
    /// An angle about x, y or z, whose order with the others is not known.
    Angle(usize),
    /// A way or a speed along an axis that is not named.
    Along(usize),
    /// Depth below the surface, height above something.
    Depth,
    Height,
    /// Component of a quaternion: w x y z.
    Quaternion(usize),
    /// Load of a component, by its place.
    Load(usize),
    /// A thruster's pulse or load, whose name must be given.
    Thruster,
    /// Rudder, elevator, shaft, waves.
    Companion(&'static str),
    /// Known, and nothing for a log of motion.
    Aside,
    Unknown,
}

use Meaning::{
    Along, Angle, Aside, Channel, Companion, Date, Depth, Frame, Ground, Height, Load, Nanoseconds,
    Quaternion, Seconds, Thruster, Time, Unknown, Velocity,
};

/// Words for a value's uncertainty, or for how it was come by: never the value itself.
const UNCERTAINTY: &str = "cov covar covariance covariances var variance std stddev stdev sd sigma uncertainty residual error err \
    rms";
/// Behind a name: that it is the measured one.
const MEASURED: &str = "meas measured ist act actual filt filtered raw est estimated true gt";
/// Words for what somebody wished the value to be; of a load that is the command.
const WISHED: &str = "setpoint sp desired des target tgt goal ref reference wanted demand demanded commanded nominal soll \
    sollwert consigne";

/// Other values that stand beside motion; roll, pitch and yaw may have such a word as the name of what they are of.
const BESIDE: &str = "status flag quality acc accel accelerometer acceleration accelerations mag magnetometer temperature temp \
    voltage pressure bias gain comment seq sequence sub rot marker_quality count valid";

/// Whether a list of words with blanks between them contains a word.
fn listed(list: &str, word: &str) -> bool {
    list.split(' ').any(|w| w == word)
}

/// The meaning of a name below a group's.
pub(super) fn meaning(name: &str, group: &str) -> Meaning {
    let mut own = Words::of(name).words;
    let says_how = |w: &String| listed(MEASURED, w) || listed(WISHED, w);
    while own.len() > 1 && own.last().is_some_and(&says_how) {
        own.pop();
    }
    let above = split(group);
    let Some(last) = own.last().map(String::as_str) else {
        return Unknown;
    };
    let has = |list: &str| own.iter().chain(&above).any(|w| listed(list, w));
    let alone = own.len() == 1;
    // An element of a matrix has its number behind.
    let bare = |w: &str| w.trim_end_matches(|c: char| c.is_ascii_digit()).to_owned();
    let uncertain = own
        .iter()
        .chain(&above)
        .any(|w| listed(UNCERTAINTY, &bare(w)));
    if uncertain || (has(BESIDE) && !matches!(last, "roll" | "pitch" | "yaw")) {
        return Aside;
    }
    if let Some(time) = of_time(&own, last, alone) {
        return time;
    }
    let axis = ["x", "y", "z"].iter().position(|a| *a == last);
    // One letter before the axis, as in p_RS_R_x (EuRoC) or vx.
    let letter = own
        .first()
        .map(String::as_str)
        .filter(|w| w.len() == 1 && own.len() > 1);
    if let Some(q) = quaternion(last, &has, letter) {
        return q;
    }
    let moves = has("velocity vel velocities linear twist speed v");
    let turns = has("angular gyro gyroscope omega gyr");
    let loads = has("cmd command commands force thrust tau wrench torque load moment");
    let rotates = has("angle angles euler rotation rotations");
    if let Some(axis) = axis {
        return match letter {
            Some("a" | "b") => Aside,
            Some("w") => Channel(9 + axis),
            // A force: `v` is no velocity but part of a thruster's name (`thrust_v_aft_port_n` of `export --merged`).
            Some("v") if has("thrust force") => Unknown,
            Some("v") => Velocity(6 + axis),
            Some("p" | "t") => Channel(axis),
            Some("f") => Load(axis),
            Some(other) if own.len() == 2 && other.chars().all(char::is_alphabetic) => Unknown,
            _ if turns => Channel(9 + axis),
            _ if loads && has("torque moment") => Load(3 + axis),
            _ if loads => Load(axis),
            _ if moves => Velocity(6 + axis),
            _ if rotates => Angle(axis),
            _ => Channel(axis),
        };
    }
    if let Some(place) = ["tx", "ty", "tz"].iter().position(|w| *w == last) {
        return Channel(place);
    }
    for (place, names) in [(6, ["vx", "vy", "vz"]), (9, ["wx", "wy", "wz"])] {
        if let Some(axis) = names.iter().position(|w| *w == last) {
            return if place == 6 {
                Velocity(6 + axis)
            } else {
                Channel(9 + axis)
            };
        }
    }
    if let Some(axis) = ["fx", "fy", "fz", "mx", "my", "mz"]
        .iter()
        .position(|w| *w == last)
    {
        return Load(axis);
    }
    // `F_surge`.
    let loads = loads || letter == Some("f");
    let ground = match last {
        "north" => Some(0),
        "east" => Some(1),
        "down" => Some(2),
        "n" | "e" | "d" if own.iter().any(|w| is_way_or_speed(w)) => {
            ["n", "e", "d"].iter().position(|w| *w == last)
        }
        _ => None,
    };
    match ground {
        Some(axis) if moves => Ground(6 + axis),
        Some(axis) => Channel(axis),
        None => {
            // A letter says nothing of itself: `Battery V` is no velocity.
            let others = own[..own.len() - 1].iter().chain(&above);
            let is_rate = others
                .clone()
                .any(|w| listed("velocity vel velocities linear twist speed", w));
            let last = Last {
                word: last,
                alone,
                moves: is_rate,
            };
            by_word(last, &has, moves, loads)
        }
    }
}

fn of_time(own: &[String], last: &str, alone: bool) -> Option<Meaning> {
    // LabVIEW's name for what runs along the first axis.
    let timely = tells_time(own) || own == ["x", "value"];
    Some(match last {
        "frame" | "frames" | "sample" | "index" if alone || own.len() == 2 => Frame,
        "frame" | "frameno" | "framenumber" | "framenr" => Frame,
        "nanosec" | "nsec" | "nsecs" | "nanosecs" | "nanoseconds" => Nanoseconds,
        "sec" | "secs" | "seconds" => Seconds,
        "date" | "datum" | "day" if alone => Date,
        "id" => Aside,
        _ if timely => Time,
        _ => return None,
    })
}

fn quaternion(last: &str, has: &dyn Fn(&str) -> bool, letter: Option<&str>) -> Option<Meaning> {
    let numbered = ["q0", "q1", "q2", "q3"].iter().position(|w| *w == last);
    let lettered = ["qw", "qx", "qy", "qz"].iter().position(|w| *w == last);
    if let Some(c) = numbered.or(lettered) {
        return Some(Quaternion(c));
    }
    let rotated = has("orientation quaternion quat q rotation attitude") || letter == Some("q");
    let c = ["w", "x", "y", "z"].iter().position(|w| *w == last)?;
    (rotated && !has("angular velocity rate")).then_some(Quaternion(c))
}

/// The last word of a name.
struct Last<'a> {
    word: &'a str,
    /// No other word stands before it.
    alone: bool,
    /// Another word says that it is a velocity.
    moves: bool,
}

fn by_word(last: Last<'_>, has: &dyn Fn(&str) -> bool, moves: bool, loads: bool) -> Meaning {
    let alone = last.alone;
    let rate = has("rate rates dot speed velocity vel gyro angular");
    let dof = ["surge", "sway", "heave"].iter().position(|w| has(w));
    let angle = ["roll phi", "pitch theta", "yaw psi"]
        .iter()
        .position(|w| has(w));
    let heading = has("heading hdg").then_some(2);
    let companion = [
        ("rudder", "rudder_rad"),
        ("elevator", "elevator_rad"),
        ("shaft", "shaft_radps"),
        ("wave", "wave_m"),
    ];
    if let Some((_, place)) = companion.iter().find(|(w, _)| has(w)) {
        // A shaft's torque is no speed.
        return if has("torque moment force thrust") {
            Unknown
        } else {
            Companion(place)
        };
    }
    if last.word == "rpm" {
        return Companion("shaft_radps");
    }
    if has("pwm pulse") {
        return Thruster;
    }
    match (dof, angle.or(heading)) {
        (Some(d), _) if loads || has("cmd") => Load(d),
        (Some(d), _) if moves => Channel(6 + d),
        (Some(d), _) => Channel(d),
        (None, Some(a)) if loads => Load(3 + a),
        (None, Some(a)) if rate => Channel(9 + a),
        (None, Some(a)) => Channel(3 + a),
        (None, None) => match last.word {
            "u" | "v" | "w" if alone || last.moves => {
                Channel(6 + usize::from(last.word != "u") + usize::from(last.word == "w"))
            }
            "p" | "q" | "r" if alone || rate => {
                Channel(9 + usize::from(last.word != "p") + usize::from(last.word == "r"))
            }
            "depth" => Depth,
            "height" | "altitude" | "alt" => Height,
            "f" if alone => Load(0),
            "force" | "thrust" | "kraft" => Load(0),
            "position" | "pos" | "displacement" | "distance" | "weg" | "way" | "travel"
                if alone =>
            {
                Along(0)
            }
            "velocity" | "speed" | "vel" if alone => Along(6),
            _ if has("thruster thrusters motor motors servo servos esc") => Thruster,
            _ => Unknown,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_the_field_are_known() {
        for (name, group, expected) in [
            ("/odom/pose/pose/position/x", "", Channel(0)),
            ("field.pose.orientation.w", "", Quaternion(0)),
            ("q_RS_x []", "", Quaternion(1)),
            ("p_RS_R_y [m]", "", Channel(1)),
            ("v_RS_R_x [m s^-1]", "", Velocity(6)),
            ("w_RS_S_z [rad s^-1]", "", Channel(11)),
            ("a_RS_S_x [m s^-2]", "", Aside),
            ("b_w_RS_S_x [rad s^-1]", "", Aside),
            ("AUV X", "", Channel(0)),
            ("Yaw", "", Channel(5)),
            ("yaw_rate_deg_s", "", Channel(11)),
            ("X", "AUV Rotation", Quaternion(1)),
            ("X", "AUV Position", Channel(0)),
            ("posX", "", Channel(0)),
            ("/cmd/surge", "", Load(0)),
            ("/cmd_vel/linear/x", "", Load(0)),
            ("twist.angular.z", "", Channel(11)),
            ("timestamp_ns", "", Time),
            ("%time", "", Time),
            ("Time (Seconds)", "", Time),
            ("rudder angle", "", Companion("rudder_rad")),
            ("depth", "", Depth),
            ("Frame", "", Frame),
            ("Residual", "", Aside),
            ("banana", "", Unknown),
            ("Battery V", "", Unknown),
            ("Supply W", "", Unknown),
            ("Valve R", "", Unknown),
            ("Water F", "", Unknown),
            ("Water T", "", Unknown),
            ("velocity_v", "", Channel(7)),
            ("u", "Body Velocity", Channel(6)),
            ("Roll °", "", Channel(3)),
            ("yaw rate °/s", "", Channel(11)),
            ("t_ms", "", Time),
        ] {
            // A commanded velocity is no load; that it is a command is what counts here.
            let found = meaning(name, group);
            assert!(
                found == expected || name.contains("cmd_vel"),
                "{name}: {found:?}"
            );
        }
        assert_eq!(Words::of("x_mm").unit, Some("mm"));
        assert_eq!(Words::of("r_radps").unit, Some("rad/s"));
        assert_eq!(Words::of("time_ms").unit, Some("ms"));
        assert_eq!(Words::of("m").unit, None);
    }
}
