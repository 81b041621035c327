//! The link to the thrusters' controller.

use crate::DeviceIdentity;
use crate::device::is_device;
use crate::raw::{Kind, Section, flag, number, text, whole, words};

/// Protocol on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LinkKind {
    /// Pololu Maestro compact protocol.
    Maestro,
    /// Our own framed protocol with controller time stamps.
    Stamped,
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
}

/// Folder of the stable names of serial adapters.
const FOLDER: &str = "/dev/serial/";

table! {
    /// The link to the thruster controller.
    pub struct Link as LinkTyped, checked by port {
        /// Protocol: hydroline's own, with the controller's clock in every echo, or that of a Pololu Maestro.
        pub kind: LinkKind = words([("stamped", LinkKind::Stamped), ("maestro", LinkKind::Maestro)]),
        /// Serial adapter by its stable name, as `hydroline devices` prints it, or the simulated controller.
        key named as "port": String = text(
            "\"sim\" or the adapter's stable name, `/dev/serial/by-id/…` or `/dev/serial/by-path/…`",
            |text| text == "sim" || is_device(text, FOLDER),
        ) => |l| Some(l.port.identity().map_or("sim".to_owned(), |id| id.typed(FOLDER))),
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
    }
}

impl LinkPort {
    fn identity(&self) -> Option<DeviceIdentity> {
        match self.clone() {
            LinkPort::Sim => None,
            LinkPort::ById(name) => Some(DeviceIdentity::ById(name)),
            LinkPort::ByPath(name) => Some(DeviceIdentity::ByPath(name)),
            LinkPort::Node(path) => Some(DeviceIdentity::Node(path)),
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
        (Some(text), Some(allow)) => {
            DeviceIdentity::of(s, "port", text, FOLDER, allow).map(LinkPort::of)
        }
        _ => None,
    };
}

impl Link {
    /// Whether the line carries the commands of so many thrusters; `s` is the table above.
    pub(super) fn check_baud(&self, s: &Section<'_>, thrusters: usize) {
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
