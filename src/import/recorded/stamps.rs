//! A message's own stamp, and messages that hold several bodies.

use std::io;

use super::message::{Leaves, Message, Number, Sink};

/// Where messages of ROS and Foxglove have their stamp: seconds and nanoseconds.
const PLACES: [(&str, &str); 9] = [
    ("header.stamp.sec", "header.stamp.nanosec"),
    ("header.stamp.sec", "header.stamp.nsec"),
    ("header.stamp.secs", "header.stamp.nsecs"),
    ("timestamp.seconds", "timestamp.nanos"),
    ("timestamp.sec", "timestamp.nsec"),
    ("timestamp.sec", "timestamp.nanosec"),
    ("timestamp.seconds", "timestamp.nanoseconds"),
    ("stamp.sec", "stamp.nanosec"),
    ("stamp.seconds", "stamp.nanos"),
];

/// The stamp below a path, UNIX or of any clock \[ns\]. One that was left at 0 is none.
pub(super) fn of(leaves: &Leaves, below: &str) -> Option<i128> {
    // It stands first; only the usual places are looked at.
    let get = |name: &str| {
        let (lead, dot) = if below.is_empty() {
            ("", "")
        } else {
            (below, ".")
        };
        leaves.numbers().take(4096).find_map(|(path, value)| {
            let own = path.strip_prefix(lead)?.strip_prefix(dot)?;
            (own == name).then_some(value)
        })
    };
    let ns = PLACES.iter().find_map(|(seconds, rest)| {
        let (s, ns) = (get(seconds)?.whole()?, get(rest)?.whole()?);
        s.checked_mul(1_000_000_000)?.checked_add(ns)
    })?;
    (ns != 0).then_some(ns)
}

/// Lists of transforms, one for each child frame: as many messages.
pub(super) fn divided(message: &Message<'_>, sink: &mut dyn Sink) -> io::Result<()> {
    let is_list = matches!(
        message.schema,
        "tf2_msgs/msg/TFMessage" | "tf/tfMessage" | "foxglove.FrameTransforms"
    );
    if !is_list {
        return sink.message(message);
    }
    for index in 0.. {
        let lead = format!("transforms[{index}]");
        let child = message.leaves.get_text(&format!("{lead}.child_frame_id"));
        let mut own = Leaves::default();
        let dotted = format!("{lead}.");
        for (path, value) in message.leaves.numbers() {
            if let Some(rest) = path.strip_prefix(&dotted) {
                own.named(rest, value);
            }
        }
        if own.numbers().next().is_none() {
            break;
        }
        let topic = format!("{}[{}]", message.topic, child.unwrap_or("?"));
        sink.message(&Message {
            topic: &topic,
            schema: "geometry_msgs/msg/TransformStamped",
            log_ns: message.log_ns,
            stamp_ns: of(&own, ""),
            leaves: &own,
            unit: message.unit,
        })?;
    }
    Ok(())
}

/// A counter of milli- or microseconds as nanoseconds.
pub(super) fn counted(value: Option<Number>, unit_ns: i128) -> Option<i128> {
    value?.whole()?.checked_mul(unit_ns)
}
