//! A map for a log of another program: what its kinds of messages mean is known, which of them the vehicle's is not.

use std::io;

use super::file::quoted;
use super::meaning::{Meaning, meaning};
use super::{Draft, Guess, GuessError};
use crate::check::{Finding, Severity};
use crate::map::{Map, dimension, place_name};
use crate::recorded::{RecordedError, Recording, TopicContents};
use crate::survey::survey;
use crate::unit::{self, Dimension};

const LOADS: [&str; 6] = ["surge", "sway", "heave", "roll", "pitch", "yaw"];

/// What a field is.
#[derive(Debug, Clone, Copy, PartialEq)]
enum What {
    /// Place, whether its axis is turned over against ours, whether it is along the tank's axes (`None` = not known).
    Channel(usize, bool, Option<bool>),
    /// Of w x y z.
    Quaternion(usize),
    Load(usize, bool),
    /// A pulse or a share of one thruster's.
    Thruster,
}

use What::{Channel, Load, Quaternion, Thruster};

/// Parts of the motion that come from one topic each.
const GROUPS: [&str; 4] = ["position", "orientation", "velocity", "rates"];

fn group(what: What) -> Option<usize> {
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
fn ros(topic: &TopicContents, path: &str) -> Option<What> {
    let mut parts = path.rsplit('.');
    let (last, above) = (parts.next()?, parts.next().unwrap_or(""));
    let axis = ["x", "y", "z"].iter().position(|a| *a == last);
    let turned = axis.is_some_and(|a| a > 0);
    let schema = topic.schema.as_str();
    match (above, axis) {
        // Speeds that are wanted are neither measured nor loads.
        ("linear" | "angular", _) if is_wish(&topic.topic) => None,
        ("position" | "translation" | "point", Some(a)) => Some(Channel(a, turned, None)),
        ("orientation" | "rotation" | "quaternion", _) => {
            let c = ["w", "x", "y", "z"].iter().position(|a| *a == last)?;
            Some(Quaternion(c))
        }
        ("linear", Some(a)) if !schema.contains("Accel") => {
            // Of an odometry they are those of the child frame; of a bare twist nobody says.
            let frame = schema.ends_with("Odometry").then_some(false);
            Some(Channel(6 + a, turned, frame))
        }
        ("angular" | "angular_velocity", Some(a)) if !schema.contains("Accel") => {
            Some(Channel(9 + a, turned, None))
        }
        ("force", Some(a)) => Some(Load(a, turned)),
        ("torque", Some(a)) => Some(Load(3 + a, turned)),
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
fn autopilot(topic: &TopicContents, path: &str) -> Option<What> {
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

fn is_wish(topic: &str) -> bool {
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

/// One topic with what its fields are.
struct Bundle<'a> {
    topic: &'a TopicContents,
    fields: Vec<(What, &'a str, Option<&'a str>)>,
}

impl Bundle<'_> {
    /// Whole groups: three axes or angles, or a quaternion.
    fn has(&self, own: usize) -> bool {
        let count = self
            .fields
            .iter()
            .filter(|f| group(f.0) == Some(own))
            .count();
        count >= 3 || (own != 1 && count > 0)
    }

    fn groups(&self) -> usize {
        (0..GROUPS.len()).filter(|g| self.has(*g)).count()
    }
}

fn is_ros(recording: &Recording) -> bool {
    recording.one_clock()
}

fn bundles(recording: &Recording) -> Vec<Bundle<'_>> {
    let mut all: Vec<Bundle<'_>> = Vec::new();
    for topic in &recording.contents().topics {
        if !recording.is_chosen(&topic.topic) || topic.messages < 4 || is_wish(&topic.topic) {
            continue;
        }
        let fields = topic
            .fields
            .iter()
            .filter_map(|f| {
                let what = if is_ros(recording) {
                    ros(topic, &f.path)
                } else {
                    autopilot(topic, &f.path)
                }?;
                Some((what, f.path.as_str(), f.unit.as_deref()))
            })
            .collect::<Vec<_>>();
        if !fields.is_empty() {
            all.push(Bundle { topic, fields });
        }
    }
    // What holds more together comes first; of equals the one that stands first in the log.
    all.sort_by_key(|b| std::cmp::Reverse(b.groups()));
    all
}

/// Unit of a field: as the log states it, or as its kind has it; and whether that was stated.
fn unit_of(place: usize, stated: Option<&str>, recording: &Recording) -> (String, bool) {
    let dimension = dimension(place);
    let stated = stated.map(|s| if s == "degheading" { "deg" } else { s });
    if let Some(u) = stated.and_then(|s| unit::find(dimension, s)) {
        return (u.name.to_owned(), true);
    }
    let dataflash = recording.contents().kind.starts_with("ArduPilot");
    let own = match dimension {
        Dimension::Length => "m",
        Dimension::Angle if dataflash => "deg",
        Dimension::Angle => "rad",
        Dimension::Speed => "m/s",
        _ => "rad/s",
    };
    (own.to_owned(), false)
}

/// How a draft is written where the log leaves something open.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Open {
    in_tank: bool,
    unix: bool,
}

struct Plan<'a> {
    recording: &'a Recording,
    bundles: Vec<Bundle<'a>>,
    /// Bundle of each group.
    sources: [Option<usize>; 4],
}

impl<'a> Plan<'a> {
    fn of(recording: &'a Recording) -> Plan<'a> {
        let bundles = bundles(recording);
        let sources = std::array::from_fn(|g| bundles.iter().position(|b| b.has(g)));
        Plan {
            recording,
            bundles,
            sources,
        }
    }

    /// Fields of a group.
    fn fields(&self, own: usize) -> impl Iterator<Item = (What, String, Option<&'a str>)> + '_ {
        let bundle = self.sources[own].map(|s| &self.bundles[s]);
        bundle.into_iter().flat_map(move |b| {
            b.fields
                .iter()
                .filter(move |f| group(f.0) == Some(own))
                .map(|f| (f.0, format!("{}.{}", b.topic.topic, f.1), f.2))
        })
    }

    fn loads(&self) -> Vec<(usize, bool, String)> {
        let mut loads: Vec<(usize, bool, String)> = Vec::new();
        for b in &self.bundles {
            for (what, path, _) in &b.fields {
                if let Load(d, turned) = what
                    && !loads.iter().any(|l| l.0 == *d)
                {
                    loads.push((*d, *turned, format!("{}.{path}", b.topic.topic)));
                }
            }
        }
        loads
    }

    fn thrusters(&self) -> Vec<String> {
        let of = |b: &Bundle<'_>| -> Vec<String> {
            b.fields
                .iter()
                .filter(|f| f.0 == Thruster)
                .map(|f| format!("{}.{}", b.topic.topic, f.1))
                .collect()
        };
        self.bundles.iter().flat_map(of).collect()
    }

    /// Topics that the map will name.
    fn topics(&self) -> Vec<&TopicContents> {
        let mut own: Vec<usize> = self.sources.iter().flatten().copied().collect();
        let loaded = |b: &Bundle<'_>| b.fields.iter().any(|f| matches!(f.0, Load(..)));
        own.extend((0..self.bundles.len()).filter(|i| loaded(&self.bundles[*i])));
        own.sort_unstable();
        own.dedup();
        own.iter().map(|i| self.bundles[*i].topic).collect()
    }

    fn is_empty(&self) -> bool {
        self.sources.iter().all(Option::is_none) && self.loads().is_empty()
    }

    /// Frame of velocities, where their topic leaves it open.
    fn frame_open(&self) -> bool {
        self.fields(2).any(|f| matches!(f.0, Channel(_, _, None)))
    }

    fn write(&self, open: Open) -> Draft {
        let mut draft = Draft::default();
        let title = format!(
            "map guessed by hydroline from {}",
            self.recording.contents().kind
        );
        draft.line(format!("# {title}"));
        draft.remarks.push(title);
        self.write_time(open, &mut draft);
        self.write_axes(&mut draft);
        let turned_axes = is_ros(self.recording);
        if let Some(quaternion) = self.quaternion() {
            draft.line("[quaternion]");
            let list: Vec<String> = quaternion.iter().map(|c| quoted(c)).collect();
            draft.line(format!("columns = [{}]", list.join(", ")));
            draft.line("order = \"wxyz\"");
            if turned_axes {
                draft.line("axes = \"z_up\"");
            }
        }
        for own in 0..GROUPS.len() {
            self.write_group(own, open, &mut draft);
        }
        for (dof, turned, column) in self.loads() {
            draft.line("[[command]]");
            let unit = if dof < 3 { "N" } else { "N m" };
            draft.doubt(format!("{column}: taken as the load commanded in {}; whether it was commanded or measured, and that it is in {unit}, is not written", LOADS[dof]));
            draft.line(format!("thruster = \"{}\"", LOADS[dof]));
            draft.line(format!("column = {}", quoted(&column)));
            draft.line(format!("unit = \"{unit}\""));
            if turned {
                draft.line("sign = -1");
            }
        }
        self.write_thrusters(&mut draft);
        self.write_others(&mut draft);
        draft
    }

    fn quaternion(&self) -> Option<[String; 4]> {
        let mut parts: [Option<String>; 4] = Default::default();
        for (what, column, _) in self.fields(1) {
            if let Quaternion(c @ 0..4) = what {
                parts[c] = Some(column);
            }
        }
        let [Some(w), Some(x), Some(y), Some(z)] = parts else {
            return None;
        };
        Some([w, x, y, z])
    }

    fn write_time(&self, open: Open, draft: &mut Draft) {
        draft.line("[time]");
        let without: Vec<&str> = self
            .topics()
            .iter()
            .filter(|t| t.stamped < t.messages)
            .map(|t| t.topic.as_str())
            .collect();
        let mut unix = open.unix && is_ros(self.recording);
        let column = if without.is_empty() {
            "stamp"
        } else {
            unix = true;
            draft.doubt(format!(
                "{}: messages without a stamp of their own, so that all go by when they were recorded; how long they were under way looks like a latency",
                without.join(", ")
            ));
            "log_time"
        };
        draft.line(format!("column = \"{column}\""));
        draft.line("unit = \"ns\"");
        if unix {
            draft.line("clock = \"unix\"");
        }
    }

    fn write_axes(&self, draft: &mut Draft) {
        if is_ros(self.recording) {
            draft.doubt("axes: x forward, y to port, z up, and metres, radians, seconds, as REP 103 has them and the log does not say: turned to y to starboard, z down");
        } else {
            draft.doubt("axes: x forward (north), y to starboard (east), z down, as the autopilot has them: those of the tank are turned by its heading");
        }
    }

    fn write_group(&self, own: usize, open: Open, draft: &mut Draft) {
        if own == 1 && self.quaternion().is_some() {
            return;
        }
        let frame_open = own == 2 && self.frame_open();
        if frame_open {
            let (frame, other) = if open.in_tank {
                ("tank", "body")
            } else {
                ("body", "tank")
            };
            draft.doubt(format!("velocities are taken to be along the {frame}'s axes, which the log does not say: else frame = \"{other}\""));
        }
        let mut fields: Vec<_> = self.fields(own).collect();
        fields.sort_by_key(|f| match f.0 {
            Channel(place, ..) => place,
            _ => 99,
        });
        let mut before = None;
        for (what, column, stated) in fields {
            let Channel(place, turned, tank) = what else {
                continue;
            };
            if before.replace(place) == Some(place) {
                continue;
            }
            let (unit, is_stated) = unit_of(place, stated, self.recording);
            draft.line(format!("[motion.{}]", place_name(place)));
            draft.line(format!("column = {}", quoted(&column)));
            if !is_stated && !is_ros(self.recording) {
                let kind = self.recording.contents().kind;
                let words =
                    format!("unit of {column}: {unit}, as {kind} has it; the log does not say");
                draft.doubt(words);
            }
            draft.line(format!("unit = \"{unit}\""));
            if turned {
                draft.line("sign = -1");
            }
            if (6..9).contains(&place) && tank.unwrap_or(open.in_tank) {
                draft.line("frame = \"tank\"");
            }
        }
    }

    fn write_thrusters(&self, draft: &mut Draft) {
        let thrusters = self.thrusters();
        if thrusters.is_empty() {
            return;
        }
        draft.doubt("these look like commands of single thrusters: which is which in the rig is not written; for each that is, without the #:");
        for column in thrusters.iter().take(16) {
            let unit = if column.contains("control[") || column.contains(".data") {
                "N\"   # and scale = newtons per unit"
            } else {
                "us\"   # a pulse, by the rig's curve: import --rig RIG"
            };
            draft.toml.push("# [[command]]".to_owned());
            draft
                .toml
                .push("# thruster = \"NAME IN THE RIG\"".to_owned());
            draft.toml.push(format!("# column = {}", quoted(column)));
            draft.toml.push(format!("# unit = \"{unit}"));
        }
    }

    /// Topics that could stand in a chosen one's place.
    fn write_others(&self, draft: &mut Draft) {
        for (own, name) in GROUPS.iter().enumerate() {
            let Some(source) = self.sources[own] else {
                continue;
            };
            let others: Vec<&str> = self
                .bundles
                .iter()
                .enumerate()
                .filter(|(i, b)| *i != source && b.has(own))
                .map(|(_, b)| b.topic.topic.as_str())
                .take(12)
                .collect();
            if !others.is_empty() {
                draft.doubt(format!(
                    "{name} from {}; it is in others too: {} (--topic names those to look at)",
                    self.bundles[source].topic.topic,
                    others.join(" ")
                ));
            }
        }
    }
}

/// Proposes a map for a log.
///
/// # Errors
/// Those of its files.
pub fn guess_recording(recording: &Recording) -> Result<Result<Guess, GuessError>, RecordedError> {
    let plan = Plan::of(recording);
    if plan.is_empty() {
        let topics = recording.contents().topics.iter();
        let columns = topics
            .filter(|t| recording.is_chosen(&t.topic))
            .map(|t| format!("{} ({})", t.topic, t.schema))
            .collect::<Vec<_>>()
            .join(" | ");
        return Ok(Err(GuessError::NoMotion { columns }));
    }
    let first = Open {
        in_tank: false,
        unix: true,
    };
    let mut draft = plan.write(first);
    let mut found = faults(recording, &draft)?;
    let others = [
        Open {
            unix: false,
            ..first
        },
        Open {
            in_tank: true,
            ..first
        },
        Open {
            in_tank: true,
            unix: false,
        },
    ];
    for open in others {
        let other = plan.write(open);
        if found.1 == 0 || other.toml == draft.toml {
            continue;
        }
        let tried = faults(recording, &other)?;
        if tried.1 < found.1 {
            (draft, found) = (other, tried);
        }
    }
    for (kind, message) in found.0 {
        draft
            .remarks
            .push(format!("with this map: {kind}: {message}"));
    }
    Ok(Ok(Guess {
        kind: recording.contents().kind,
        toml: draft.toml.join("\n") + "\n",
        remarks: draft.remarks,
    }))
}

/// What an import with the drafted map would say, and how bad that is.
fn faults(
    recording: &Recording,
    draft: &Draft,
) -> Result<(Vec<(&'static str, String)>, usize), RecordedError> {
    let map = match Map::from_toml(&draft.toml.join("\n"), "guessed map") {
        Ok(map) => map,
        Err(error) => return Ok((vec![("map", error.to_string())], usize::MAX)),
    };
    let table = recording.table(&map)?;
    let own = survey(&table, &table.map, None).map_err(io::Error::other)?;
    let all: Vec<&Finding> = table.findings.iter().chain(&own.findings).collect();
    let strange = all
        .iter()
        .filter(|f| f.severity == Severity::Warning && f.kind == "kinematics")
        .count();
    let serious: Vec<(&'static str, String)> = all
        .iter()
        .filter(|f| f.severity == Severity::Fault)
        .map(|f| (f.kind, f.message.clone()))
        .collect();
    let bad = 100 * serious.len() + strange;
    Ok((serious, bad))
}
