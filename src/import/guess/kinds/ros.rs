//! `ros2 topic echo --csv`: the fields of a message one after the other, without names.

use super::super::head::Head;
use super::super::shape::{self, Named, Proposal, Shape};
use super::{SI, is_quaternion};
use crate::map::{Separator, place_name};
use crate::number::number;

const POSITION: [&str; 3] = ["position.x", "position.y", "position.z"];
const ORIENTATION: [&str; 4] = [
    "orientation.x",
    "orientation.y",
    "orientation.z",
    "orientation.w",
];
/// Messages that so many numbers may be, from the column of the first on.
fn open(numbers: usize, first: usize) -> Vec<Proposal> {
    let motion = |from: usize, unit: &'static str| -> Vec<(String, &'static str, usize)> {
        (0..3)
            .map(|k| {
                (
                    format!("[motion.{}]", place_name(from + k)),
                    unit,
                    first + from % 6 + k,
                )
            })
            .collect()
    };
    let load =
        |dofs: [&str; 3], unit: &'static str, from: usize| -> Vec<(String, &'static str, usize)> {
            let table = |d: &str| format!("[[command]]\nthruster = \"{d}\"");
            (0..3)
                .map(|k| (table(dofs[k]), unit, first + from + k))
                .collect()
        };
    let proposal = |message, tables: [Vec<(String, &'static str, usize)>; 2]| Proposal {
        message,
        tables: tables.concat(),
    };
    let twist = |message| proposal(message, [motion(6, "m/s"), motion(9, "rad/s")]);
    match numbers {
        3 => vec![proposal("PointStamped", [motion(0, "m"), Vec::new()])],
        6 => vec![
            twist("TwistStamped"),
            proposal(
                "WrenchStamped, if it was the command",
                [
                    load(["surge", "sway", "heave"], "N", 0),
                    load(["roll", "pitch", "yaw"], "N m", 3),
                ],
            ),
        ],
        42 => vec![twist("TwistWithCovarianceStamped")],
        _ => Vec::new(),
    }
}

const LINEAR: [&str; 3] = ["twist.linear.x", "twist.linear.y", "twist.linear.z"];
const ANGULAR: [&str; 3] = ["twist.angular.x", "twist.angular.y", "twist.angular.z"];

/// Names of the numbers after the head, by the message that has so many.
fn fields(child: bool, numbers: &[String]) -> Option<(&'static str, Vec<String>)> {
    let mut out: Vec<String> = Vec::new();
    let mut add = |names: &[&str]| out.extend(names.iter().map(|n| (*n).to_owned()));
    let covariance = |n: usize| vec!["covariance"; n];
    let rotated_at = |i: usize| numbers.get(i..i + 4).is_some_and(|q| is_quaternion(q, '.'));
    let kind = match (child, numbers.len()) {
        (true, 85) if rotated_at(3) => {
            add(&POSITION);
            add(&ORIENTATION);
            add(&covariance(36));
            add(&LINEAR);
            add(&ANGULAR);
            add(&covariance(36));
            "nav_msgs/Odometry"
        }
        (true, 13) if rotated_at(3) => {
            add(&POSITION);
            add(&ORIENTATION);
            add(&LINEAR);
            add(&ANGULAR);
            "nav_msgs/Odometry without covariance"
        }
        (_, 7 | 43) if rotated_at(3) => {
            add(&POSITION);
            add(&ORIENTATION);
            add(&covariance(numbers.len() - 7));
            match (child, numbers.len()) {
                (true, _) => "geometry_msgs/TransformStamped, or a pose with two frames",
                (false, 7) => "geometry_msgs/PoseStamped",
                _ => "geometry_msgs/PoseWithCovarianceStamped",
            }
        }
        (false, 37) if rotated_at(0) => {
            add(&ORIENTATION);
            add(&covariance(9));
            add(&["gyro.x", "gyro.y", "gyro.z"]);
            add(&covariance(9));
            add(&["acceleration.x", "acceleration.y", "acceleration.z"]);
            add(&covariance(9));
            "sensor_msgs/Imu"
        }
        // Several messages have so many: none is chosen.
        (false, 6) => {
            add(&["covariance"; 6]);
            "geometry_msgs/TwistStamped, WrenchStamped or AccelStamped"
        }
        (false, 42) => {
            add(&["covariance"; 42]);
            "geometry_msgs/TwistWithCovarianceStamped or AccelWithCovarianceStamped"
        }
        (false, 3) => {
            add(&["covariance"; 3]);
            "geometry_msgs/PointStamped or Vector3Stamped"
        }
        (_, more) if rotated_at(3) => {
            add(&POSITION);
            add(&ORIENTATION);
            add(&vec!["field"; more - 7]);
            "a pose; what follows it is none of a message that is known here, and not mapped"
        }
        _ => return None,
    };
    Some((kind, out))
}

/// Seconds, nanoseconds, one or two names of frames, numbers.
pub(super) fn echo(head: &Head) -> Option<Shape> {
    let comma = Separator::Byte(b',');
    let rows: Vec<Vec<String>> = head
        .lines
        .iter()
        .filter(|l| !l.1.trim().is_empty() && l.1.trim() != "---")
        .map(|l| shape::cells(comma, &l.1))
        .collect();
    let first = rows.first()?;
    let whole = |cell: &str| cell.parse::<u64>().ok();
    let stamped = |r: &Vec<String>| {
        r.len() > 4
            && whole(&r[0]).is_some()
            && whole(&r[1]).is_some_and(|ns| ns < 1_000_000_000)
            && number(&r[2], '.').is_none()
    };
    if rows.len() < 3 || !rows.iter().take(200).all(stamped) {
        return None;
    }
    // Nanoseconds that never pass their second are none.
    let large = rows.iter().filter_map(|r| whole(&r[1])).max()?;
    if large < 1_000_000 {
        return None;
    }
    let child = number(&first[3], '.').is_none();
    let lead = if child { 4 } else { 3 };
    let (message, names) = fields(child, &first[lead..])?;
    let mut columns = vec![
        shape::named("sec"),
        shape::named("nanosec"),
        shape::named("frame_id"),
    ];
    if child {
        columns.push(shape::named("child_frame_id"));
    }
    columns.extend(names.into_iter().map(|name| Named {
        name,
        ..Named::default()
    }));
    let mut file = shape::file(head, comma, '.');
    file.header = false;
    file.comment = head
        .lines
        .iter()
        .any(|l| l.1.trim() == "---")
        .then(|| "---".to_owned());
    Some(Shape {
        kind: "ros2 topic echo --csv",
        by_number: true,
        file,
        columns,
        rate_hz: None,
        units: SI,
        open: open(first.len() - lead, lead + 1),
        remarks: vec![format!(
            "the file names no fields: by their number they are those of {message}"
        )],
    })
}
