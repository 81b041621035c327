//! The link to the thrusters' controller.

use std::net::SocketAddr;

use super::mavlink::Mavlink;
use crate::DeviceIdentity;
use crate::device::is_device;
use crate::raw::{Kind, Section, flag, number, table, text, whole, words};

/// Protocol on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LinkKind {
    /// Pololu Maestro compact protocol.
    Maestro,
    /// Our own framed protocol with controller time stamps.
    Stamped,
    /// MAVLink to an autopilot (ArduSub, PX4) that owns the thrusters.
    Mavlink,
}

/// Where the controller is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LinkPort {
    /// A simulated controller on a pseudo-terminal, driving the simulated vehicle.
    Sim,
    /// `/dev/serial/by-id/<name>` (or matched by USB vendor/product/serial where udev is absent).
    ById(String),
    /// `/dev/serial/by-path/<name>`.
    ByPath(String),
    /// `/dev/ttyX`: not stable, accepted only with `allow_unstable_node = true`.
    Node(std::path::PathBuf),
    /// UDP port of this computer that the autopilot (or a router) sends to; answers go where the last datagram came from.
    Udp(std::net::SocketAddr),
}

/// Folder of the stable names of serial adapters.
const FOLDER: &str = "/dev/serial/";

table! {
    /// The link to the thruster controller.
    pub struct Link as LinkTyped, checked by port {
        /// Protocol: hydroline's own, with the controller's clock in every echo, that of a Pololu Maestro, or MAVLink to an autopilot.
        pub kind: LinkKind = words([
            ("stamped", LinkKind::Stamped),
            ("maestro", LinkKind::Maestro),
            ("mavlink", LinkKind::Mavlink),
        ]),
        /// Serial adapter by its stable name, as `hydroline devices` prints it, the simulated controller, or for MAVLink the UDP
        /// address that the autopilot sends to.
        key named as "port": String = text(
            "\"sim\", \"udp:ADDRESS:PORT\" or the adapter's stable name, `/dev/serial/by-id/…` or `/dev/serial/by-path/…`",
            |text| text == "sim" || udp(text).is_some() || is_device(text, FOLDER),
        ) => |l| Some(l.port.typed()),
        /// Whether `port` may be a `/dev/ttyX`, which can be another adapter after a replug.
        key allow_unstable_node: bool = flag().or(false).quiet() => |l| Some(matches!(l.port, LinkPort::Node(_))),
        /// Serial adapter or simulated controller.
        made port: LinkPort,
        /// Bit rate of the line. It must carry all thrusters at `rate_hz`.
        pub baud: u32 = whole(1200, 4_000_000, "bit/s"),
        /// Rate of the commands; between two of them the last one holds.
        pub rate_hz: f64 = number(0.5, 500.0, "1/s"),
        /// A command that is later than this is not sent: the thrusters go to neutral.
        pub deadline_s: f64 = number(0.001, 10.0, "s").or(0.1),
        /// Without an answer of the controller for this long the thrusters go to neutral.
        pub timeout_s: f64 = number(0.01, 10.0, "s").or(0.5),
        /// What the autopilot and hydroline do for each other. Read with `kind = "mavlink"`.
        pub mavlink: Option<Mavlink> = table().optional(),
    }
}

/// The address in `udp:ADDRESS:PORT`.
fn udp(text: &str) -> Option<SocketAddr> {
    text.strip_prefix("udp:")?.parse().ok()
}

impl LinkPort {
    fn identity(&self) -> Option<DeviceIdentity> {
        match self.clone() {
            LinkPort::Sim | LinkPort::Udp(_) => None,
            LinkPort::ById(name) => Some(DeviceIdentity::ById(name)),
            LinkPort::ByPath(name) => Some(DeviceIdentity::ByPath(name)),
            LinkPort::Node(path) => Some(DeviceIdentity::Node(path)),
        }
    }

    /// Its name in a file.
    fn typed(&self) -> String {
        match self {
            LinkPort::Udp(address) => format!("udp:{address}"),
            port => port
                .identity()
                .map_or("sim".to_owned(), |id| id.typed(FOLDER)),
        }
    }

    fn of(identity: DeviceIdentity) -> LinkPort {
        match identity {
            DeviceIdentity::ById(name) => LinkPort::ById(name),
            DeviceIdentity::ByPath(name) => LinkPort::ByPath(name),
            DeviceIdentity::Node(path) => LinkPort::Node(path),
        }
    }
}

fn port(typed: &mut LinkTyped, s: &Section<'_>) {
    typed.port = match (typed.named.as_deref(), typed.allow_unstable_node) {
        (Some("sim"), _) => Some(LinkPort::Sim),
        (Some(text), _) if udp(text).is_some() => udp(text).map(LinkPort::Udp),
        (Some(text), Some(allow)) => {
            DeviceIdentity::of(s, "port", text, FOLDER, allow).map(LinkPort::of)
        }
        _ => None,
    };
    match (typed.kind, &typed.port) {
        (Some(LinkKind::Mavlink), Some(LinkPort::Sim)) => s.rule(
            "port",
            "the simulated controller is no autopilot".to_owned(),
            "Name the autopilot's serial adapter or udp:ADDRESS:PORT, or simulate with kind = \"stamped\"",
        ),
        (Some(LinkKind::Maestro | LinkKind::Stamped), Some(LinkPort::Udp(_))) => s.rule(
            "port",
            "this protocol runs on a serial line, not over UDP".to_owned(),
            "Name the serial adapter as `hydroline devices` prints it",
        ),
        _ => {}
    }
}

impl Link {
    /// Whether the autopilot drives and hydroline only listens: no command leaves this computer.
    pub fn follows(&self) -> bool {
        self.kind == LinkKind::Mavlink
    }

    /// Settings of an autopilot; the defaults where the rig has none.
    pub fn autopilot(&self) -> Mavlink {
        self.mavlink.clone().unwrap_or_default()
    }

    /// Whether the line carries the commands of so many thrusters; `s` is the table above.
    pub(super) fn check_baud(&self, s: &Section<'_>, thrusters: usize) {
        if self.mavlink.is_some() && self.kind != LinkKind::Mavlink {
            s.rule(
                "link.mavlink",
                "an autopilot's settings for a controller that is none".to_owned(),
                "Take the table out, or set kind = \"mavlink\"",
            );
        }
        // No command is sent.
        if self.follows() {
            return;
        }
        let (baud, rate) = (self.baud, self.rate_hz);
        // Pololu compact protocol: set target = 4 bytes, 10 bits each on the wire. No protocol here says it in fewer.
        let needed = 40.0 * thrusters as f64 * rate;
        if needed > f64::from(baud) {
            s.rule(
                "link.baud",
                format!(
                    "{baud} bit/s cannot carry {thrusters} thrusters at {rate} commands/s: at 4 bytes each that is at least {needed} bit/s"
                ),
                "Raise baud or lower rate_hz",
            );
        }
    }
}
