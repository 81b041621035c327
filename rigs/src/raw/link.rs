//! `[thrusters.link]` as typed.

use std::path::PathBuf;

use super::camera::{StableName, UNSTABLE_NEXT, is_node, stable_name};
use super::{Section, quantity};
use crate::{Link, LinkKind, LinkPort};

pub(super) fn read_link(s: &Section<'_>, thrusters: usize) -> Option<Link> {
    let kind = s.choice(
        "kind",
        &[
            ("stamped", LinkKind::Stamped),
            ("maestro", LinkKind::Maestro),
        ],
    );
    let port = read_port(s);
    let baud = s
        .integer("baud", 1200, 4_000_000, "bit/s")
        .map(|b| b as u32);
    let rate_hz = s.number("rate_hz", quantity(0.5, 500.0, "1/s"));
    let deadline_s = s.number_or("deadline_s", quantity(0.001, 10.0, "s"), 0.1);
    let timeout_s = s.number_or("timeout_s", quantity(0.01, 10.0, "s"), 0.5);
    s.finish();
    if let (Some(baud), Some(rate)) = (baud, rate_hz) {
        // Pololu compact protocol: set target = 4 bytes, 10 bits each on the wire.
        // No protocol here says it in fewer.
        let needed = 40.0 * thrusters as f64 * rate;
        if needed > f64::from(baud) {
            s.rule(
                "baud",
                format!(
                    "{baud} bit/s cannot carry {thrusters} thrusters at {rate} commands/s: at 4 bytes each that is at least {needed} bit/s"
                ),
                "Raise baud or lower rate_hz",
            );
        }
    }
    Some(Link {
        kind: kind?,
        port: port?,
        baud: baud?,
        rate_hz: rate_hz?,
        deadline_s,
        timeout_s,
    })
}

fn read_port(s: &Section<'_>) -> Option<LinkPort> {
    let expected =
        "\"sim\" or the adapter's stable name, `/dev/serial/by-id/…` or `/dev/serial/by-path/…`";
    let allow_node = s.flag_or("allow_unstable_node", false);
    s.asks_for("port", "text", expected);
    s.requires("port");
    if !s.has("port") {
        s.item("port");
        s.missing("port", format!("`port = …`, {expected}"));
        return None;
    }
    let (text, item) = s.text_opt("port", expected)?;
    if text == "sim" {
        return Some(LinkPort::Sim);
    }
    match stable_name(&text, "/dev/serial/") {
        Some(StableName::ById(name)) => Some(LinkPort::ById(name)),
        Some(StableName::ByPath(name)) => Some(LinkPort::ByPath(name)),
        None if is_node(&text) => {
            if allow_node {
                return Some(LinkPort::Node(PathBuf::from(text)));
            }
            s.rule(
                "port",
                format!("{text} is not a stable name: after a replug it may be another adapter"),
                UNSTABLE_NEXT,
            );
            None
        }
        None => {
            s.wrong_type(&item, expected);
            None
        }
    }
}
