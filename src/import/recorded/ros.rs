//! ROS 2: definitions of messages, their bytes, and what is known of the usual ones.

pub(super) mod cdr;
pub(super) mod definition;

use definition::Definition;

/// Definitions of the usual messages: bags in db3 of before 2023 hold none. From common_interfaces of ROS 2, fields only.
const KNOWN: &str = include_str!("ros/known.msg");

/// The definition of a message that the log does not define.
pub(super) fn known(name: &str) -> Option<Definition> {
    // One text of sections `MSG: package/Type`, so that each finds the others.
    let short = name.replace("/msg/", "/");
    KNOWN
        .lines()
        .any(|l| l.strip_prefix("MSG: ") == Some(short.as_str()))
        .then(|| Definition::parse(&short, KNOWN).ok())?
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_known_message_compiles() {
        let mut count = 0;
        for line in KNOWN.lines() {
            if let Some(name) = line.strip_prefix("MSG: ") {
                let definition = known(&name.replace('/', "/msg/"));
                assert!(definition.is_some_and(|d| !d.types[0].is_empty()), "{name}");
                count += 1;
            }
        }
        assert!(count > 40);
        assert!(known("sensor_msgs/msg/Banana").is_none());
    }
}
