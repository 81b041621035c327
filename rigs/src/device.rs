//! Names of devices: stable ones by `by-id` and `by-path`, and nodes that are numbered in the order of plugging in.

use std::path::PathBuf;

use crate::raw::Section;

/// Identity by which a V4L2 device is found again after an unplug.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum DeviceIdentity {
    /// `/dev/v4l/by-id/<name>` (or, without udev, matched against sysfs vendor/product/serial).
    ById(String),
    /// `/dev/v4l/by-path/<name>` (or, without udev, matched against the bus info that QUERYCAP reports).
    ByPath(String),
    /// `/dev/videoN`: not stable, accepted only with `allow_unstable_node = true`.
    Node(PathBuf),
}

/// Advice on a `/dev/videoN` or `/dev/ttyX`: the number is handed out in the order of plugging in, so after a
/// replug it may be another device.
const UNSTABLE_NEXT: &str = "Run `hydroline devices` and enter the stable name it prints, \
     or set `allow_unstable_node = true` beside it to accept whatever device has that number";

impl DeviceIdentity {
    /// The device that a key names, its stable names in `folder`; `None` = reported.
    pub(crate) fn of(
        s: &Section<'_>,
        key: &str,
        text: &str,
        folder: &str,
        allow_node: bool,
    ) -> Option<DeviceIdentity> {
        if let Some(stable) = stable_name(text, folder) {
            return Some(stable);
        }
        let device = match folder {
            "/dev/v4l/" => "camera",
            _ => "adapter",
        };
        if !allow_node {
            s.rule(
                key,
                format!("{text} is not a stable name: after a replug it may be another {device}"),
                UNSTABLE_NEXT,
            );
            return None;
        }
        Some(DeviceIdentity::Node(PathBuf::from(text)))
    }

    /// Its name in a file.
    pub(crate) fn typed(&self, folder: &str) -> String {
        match self {
            DeviceIdentity::ById(name) => format!("{folder}by-id/{name}"),
            DeviceIdentity::ByPath(name) => format!("{folder}by-path/{name}"),
            DeviceIdentity::Node(path) => path.display().to_string(),
        }
    }
}

/// Whether a text names a device, by a stable name in `folder` or by its node.
pub(crate) fn is_device(text: &str, folder: &str) -> bool {
    stable_name(text, folder).is_some() || is_node(text)
}

/// Splits `/dev/v4l/by-id/NAME` and its likes.
fn stable_name(text: &str, folder: &str) -> Option<DeviceIdentity> {
    let (kind, name) = text.strip_prefix(folder)?.split_once('/')?;
    match kind {
        _ if !is_device_name(name) => None,
        "by-id" => Some(DeviceIdentity::ById(name.to_owned())),
        "by-path" => Some(DeviceIdentity::ByPath(name.to_owned())),
        _ => None,
    }
}

fn is_device_name(name: &str) -> bool {
    !name.is_empty()
        && name.len() <= 255
        && name != "."
        && name != ".."
        && !name.chars().any(|c| c == '/' || c.is_control())
}

/// `/dev/NAME` or `/dev/FOLDER/NAME`, nothing that leads out again, and not a misspelt stable name.
fn is_node(text: &str) -> bool {
    text.strip_prefix("/dev/").is_some_and(|rest| {
        !rest.starts_with("v4l/")
            && !rest.starts_with("serial/")
            && rest.split('/').all(is_device_name)
    })
}
