//! Which cameras there are, what each can do, and what stands in the way: for `hydroline devices` and `check`.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::v4l::controls;
use super::v4l::device::{Errno, OfferedSize, V4lSystem};
use super::v4l::setup::{CAP_CAPTURE, CAP_OUTPUT, field_name};
use super::v4l::system::KernelSystem;

/// A camera node.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct CameraListing {
    /// `/dev/videoN`.
    pub node: PathBuf,
    /// Names under `/dev/v4l/by-id`, or, without udev, the name it would have.
    pub by_id: Vec<String>,
    /// Names under `/dev/v4l/by-path`; without udev, the name it would have; else the bus info.
    pub by_path: Vec<String>,
    /// Card name.
    pub card: String,
    /// Driver.
    pub driver: String,
    /// Bus info.
    pub bus_info: String,
    /// Formats, sizes, rates.
    pub offers: Vec<OfferedSize>,
    /// Field order of the current format.
    pub field: String,
    /// Controls.
    pub controls: Vec<ControlListing>,
    /// What stands in the way of using it, with the cure; empty = nothing.
    pub problem: String,
}

/// A control of a camera.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct ControlListing {
    /// Name for the rig.
    pub name: String,
    /// V4L2 id.
    pub id: u32,
    /// Least value.
    pub min: i64,
    /// Largest value.
    pub max: i64,
    /// Step.
    pub step: u64,
    /// Default.
    pub default: i64,
    /// Value now; `None` = cannot be read.
    pub value: Option<i64>,
}

/// All nodes that are cameras, or cannot be asked whether they are. A camera's metadata node is left out.
pub fn cameras() -> Vec<CameraListing> {
    cameras_of(&mut KernelSystem::default())
}

/// The same on a given machine.
pub fn cameras_of(system: &mut KernelSystem) -> Vec<CameraListing> {
    let mut found = Vec::new();
    for node in system.nodes() {
        let mut by_id = system.links("by-id", &node.node);
        if by_id.is_empty() {
            by_id.extend(node.by_id.clone());
        }
        let mut by_path = system.links("by-path", &node.node);
        if by_path.is_empty() {
            by_path.extend(node.by_path.clone());
        }
        let mut listing = CameraListing {
            by_path,
            by_id,
            card: node.card.clone(),
            node: node.node.clone(),
            ..CameraListing::default()
        };
        let mut device = match system.open(&node.node) {
            Ok(device) => device,
            Err(errno) => {
                listing.problem = match errno {
                    Errno(libc::EACCES | libc::EPERM) => system.access_problem(&node.node),
                    Errno(libc::EBUSY) => format!("busy: open in {}", system.holders(&node.node)),
                    other => format!("cannot be opened: {other}"),
                };
                found.push(listing);
                continue;
            }
        };
        let Ok(capability) = device.capability() else {
            continue;
        };
        if capability.caps & CAP_CAPTURE == 0 {
            if capability.caps & CAP_OUTPUT == 0 || !capability.driver.contains("loopback") {
                continue;
            }
            listing.problem = "no picture yet: nothing feeds this loopback device".into();
        }
        (listing.card, listing.driver, listing.bus_info) =
            (capability.card, capability.driver, capability.bus_info);
        if listing.by_path.is_empty() {
            listing.by_path.push(listing.bus_info.clone());
        }
        listing.offers = device.offers();
        listing.field = device
            .format()
            .map(|f| field_name(f.field).to_owned())
            .unwrap_or_default();
        for info in controls::list(device.as_mut()) {
            let value = device.control(info.id).ok();
            listing.controls.push(ControlListing {
                name: controls::snake_case(&info.name),
                id: info.id,
                min: info.min,
                max: info.max,
                step: info.step,
                default: info.default,
                value,
            });
        }
        found.push(listing);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_node_that_is_no_device_is_listed_with_its_problem() {
        let root = tempfile::tempdir().unwrap();
        let class = root.path().join("sys/class/video4linux/video3");
        std::fs::create_dir_all(&class).unwrap();
        std::fs::write(class.join("name"), "Gone Cam\n").unwrap();
        let r = root.path();
        let mut system = KernelSystem {
            dev: r.join("dev"),
            sys: r.join("sys"),
            proc: r.join("proc"),
            etc: r.join("etc"),
        };
        let found = cameras_of(&mut system);
        assert_eq!(found.len(), 1);
        assert_eq!(
            (found[0].card.as_str(), found[0].by_path.len()),
            ("Gone Cam", 0)
        );
        assert!(
            found[0].problem.contains("No such file"),
            "{}",
            found[0].problem
        );
        let json = serde_json::to_string(&found).unwrap();
        assert_eq!(
            serde_json::from_str::<Vec<CameraListing>>(&json).unwrap(),
            found
        );
    }

    #[test]
    fn a_machine_without_cameras_lists_none() {
        let root = tempfile::tempdir().unwrap();
        let r = root.path().to_path_buf();
        assert!(
            cameras_of(&mut KernelSystem {
                dev: r.clone(),
                sys: r.clone(),
                proc: r.clone(),
                etc: r
            })
            .is_empty()
        );
    }
}
