//! What a column's name says that it is.

/// What a column may be.
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
    Along, Aside, Channel, Companion, Date, Depth, Frame, Height, Load, Nanoseconds, Quaternion,
    Seconds, Thruster, Time, Unknown, Velocity,
};

/// A name in small words; what the unit says is taken off.
pub(super) struct Words {
    pub words: Vec<String>,
    /// The unit that ends it, as in `x_mm`.
    pub unit: Option<&'static str>,
}

const SUFFIXES: [(&[&str], &str); 27] = [
    (&["deg", "per", "s"], "deg/s"),
    (&["rad", "per", "s"], "rad/s"),
    (&["deg", "s"], "deg/s"),
    (&["rad", "s"], "rad/s"),
    (&["mm", "s"], "mm/s"),
    (&["cm", "s"], "cm/s"),
    (&["m", "s"], "m/s"),
    (&["m", "per", "s"], "m/s"),
    (&["ft", "s"], "ft/s"),
    (&["mps"], "m/s"),
    (&["radps"], "rad/s"),
    (&["degps"], "deg/s"),
    (&["dps"], "deg/s"),
    (&["rpm"], "rpm"),
    (&["kn"], "kn"),
    (&["kts"], "kn"),
    (&["knots"], "kn"),
    (&["mm"], "mm"),
    (&["cm"], "cm"),
    (&["ft"], "ft"),
    (&["m"], "m"),
    (&["deg"], "deg"),
    (&["degrees"], "deg"),
    (&["cdeg"], "cdeg"),
    (&["rad"], "rad"),
    (&["n"], "N"),
    (&["nm"], "N m"),
];
const TIME_SUFFIXES: [(&str, &str); 9] = [
    ("s", "s"),
    ("sec", "s"),
    ("secs", "s"),
    ("seconds", "s"),
    ("ms", "ms"),
    ("us", "us"),
    ("usec", "us"),
    ("ns", "ns"),
    ("nsec", "ns"),
];

/// Splits `/odom/pose/position/x`, `posX`, `x_mm`, `AUV X [mm]` into words.
fn split(name: &str) -> Vec<String> {
    let bare = match name.find(['[', '(', '{']) {
        Some(at) if at > 0 => &name[..at],
        _ => name,
    };
    let mut words: Vec<String> = vec![String::new()];
    let mut before = ' ';
    for c in bare.chars() {
        let turns = (before.is_lowercase() || before.is_ascii_digit()) && c.is_uppercase();
        if !c.is_alphanumeric() || turns {
            words.push(String::new());
        }
        if c.is_alphanumeric()
            && let Some(word) = words.last_mut()
        {
            word.extend(c.to_lowercase());
        }
        before = c;
    }
    words.retain(|w| !w.is_empty());
    words
}

impl Words {
    pub fn of(name: &str) -> Words {
        let mut words = split(name);
        let timely = words.iter().any(|w| is_time(w));
        let mut unit = None;
        if words.len() >= 2 && timely {
            let last = words[words.len() - 1].clone();
            if let Some((_, own)) = TIME_SUFFIXES.iter().find(|(w, _)| *w == last) {
                unit = Some(*own);
                words.pop();
            }
        } else {
            for (suffix, own) in SUFFIXES {
                if words.len() > suffix.len() && words.ends_with(&suffix.map_strings()) {
                    unit = Some(own);
                    words.truncate(words.len() - suffix.len());
                    break;
                }
            }
        }
        Words { words, unit }
    }
}

trait MapStrings {
    fn map_strings(&self) -> Vec<String>;
}
impl MapStrings for &[&str] {
    fn map_strings(&self) -> Vec<String> {
        self.iter().map(|s| (*s).to_owned()).collect()
    }
}

fn is_time(word: &str) -> bool {
    matches!(
        word,
        "t" | "time"
            | "timestamp"
            | "stamp"
            | "timestamps"
            | "times"
            | "zeit"
            | "temps"
            | "tiempo"
            | "clock"
            | "utc"
            | "datetime"
            | "elapsed"
    )
}

/// The meaning of a name below a group's.
pub(super) fn meaning(name: &str, group: &str) -> Meaning {
    let own = Words::of(name).words;
    let above = split(group);
    let Some(last) = own.last().map(String::as_str) else {
        return Unknown;
    };
    let has = |list: &[&str]| own.iter().chain(&above).any(|w| list.contains(&w.as_str()));
    let alone = own.len() == 1;
    if has(&[
        "cov",
        "covariance",
        "std",
        "sd",
        "sigma",
        "residual",
        "error",
        "err",
        "status",
        "flag",
        "quality",
        "setpoint",
        "desired",
        "target",
        "acc",
        "accel",
        "accelerometer",
        "acceleration",
        "accelerations",
        "mag",
        "magnetometer",
        "temperature",
        "temp",
        "voltage",
        "pressure",
        "bias",
        "gain",
        "comment",
        "seq",
        "sequence",
        "sub",
        "rot",
        "marker_quality",
    ]) && !matches!(last, "roll" | "pitch" | "yaw")
    {
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
    let moves = has(&[
        "velocity",
        "vel",
        "velocities",
        "linear",
        "twist",
        "speed",
        "v",
    ]);
    let turns = has(&["angular", "gyro", "gyroscope", "omega", "gyr"]);
    let loads = has(&[
        "cmd", "command", "commands", "force", "thrust", "tau", "wrench", "torque", "load",
        "moment",
    ]);
    if let Some(axis) = axis {
        return match letter {
            Some("a" | "b") => Aside,
            Some("w") => Channel(9 + axis),
            Some("v") => Velocity(6 + axis),
            Some("p") => Channel(axis),
            _ if turns => Channel(9 + axis),
            _ if loads && has(&["torque", "moment"]) => Load(3 + axis),
            _ if loads => Load(axis),
            _ if moves => Velocity(6 + axis),
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
    by_word(last, &has, moves, loads, alone)
}

fn of_time(own: &[String], last: &str, alone: bool) -> Option<Meaning> {
    // LabVIEW's name for what runs along the first axis.
    let timely = own.iter().any(|w| is_time(w)) || own == ["x", "value"];
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

fn quaternion(last: &str, has: &dyn Fn(&[&str]) -> bool, letter: Option<&str>) -> Option<Meaning> {
    let numbered = ["q0", "q1", "q2", "q3"].iter().position(|w| *w == last);
    let lettered = ["qw", "qx", "qy", "qz"].iter().position(|w| *w == last);
    if let Some(c) = numbered.or(lettered) {
        return Some(Quaternion(c));
    }
    let turned = has(&[
        "orientation",
        "quaternion",
        "quat",
        "q",
        "rotation",
        "attitude",
    ]) || letter == Some("q");
    let c = ["w", "x", "y", "z"].iter().position(|w| *w == last)?;
    (turned && !has(&["angular", "velocity", "rate"])).then_some(Quaternion(c))
}

fn by_word(
    last: &str,
    has: &dyn Fn(&[&str]) -> bool,
    moves: bool,
    loads: bool,
    alone: bool,
) -> Meaning {
    let rate = has(&[
        "rate", "rates", "dot", "speed", "velocity", "vel", "gyro", "angular",
    ]);
    let dof = ["surge", "sway", "heave"].iter().position(|w| has(&[*w]));
    let angle = [["roll", "phi"], ["pitch", "theta"], ["yaw", "psi"]]
        .iter()
        .position(|names| has(&names[..]));
    let heading = has(&["heading", "hdg"]).then_some(2);
    let companion = [
        ("rudder", "rudder_rad"),
        ("elevator", "elevator_rad"),
        ("shaft", "shaft_radps"),
        ("wave", "wave_m"),
    ];
    if let Some((_, place)) = companion.iter().find(|(w, _)| has(&[*w])) {
        return Companion(place);
    }
    if last == "rpm" {
        return Companion("shaft_radps");
    }
    if has(&["pwm", "pulse"]) {
        return Thruster;
    }
    match (dof, angle.or(heading)) {
        (Some(d), _) if loads || has(&["cmd"]) => Load(d),
        (Some(d), _) if moves => Channel(6 + d),
        (Some(d), _) => Channel(d),
        (None, Some(a)) if loads => Load(3 + a),
        (None, Some(a)) if rate => Channel(9 + a),
        (None, Some(a)) => Channel(3 + a),
        (None, None) => match last {
            "u" | "v" | "w" if alone || moves => {
                Channel(6 + usize::from(last != "u") + usize::from(last == "w"))
            }
            "p" | "q" | "r" if alone || rate => {
                Channel(9 + usize::from(last != "p") + usize::from(last == "r"))
            }
            "north" => Channel(0),
            "east" => Channel(1),
            "down" => Channel(2),
            "depth" => Depth,
            "height" | "altitude" | "alt" => Height,
            "f" | "force" | "thrust" | "kraft" => Load(0),
            "position" | "pos" | "displacement" | "distance" | "weg" | "way" | "travel"
                if alone =>
            {
                Along(0)
            }
            "velocity" | "speed" | "vel" if alone => Along(6),
            "thruster" => Thruster,
            _ if has(&["thruster", "motor", "servo"]) => Thruster,
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
