//! Cameras that are present, what each can do, and what prevents its use: for `hydroline devices` and `check`.

use std::path::PathBuf;

use hydroline_rigs::PixelFormat;
use serde::{Deserialize, Serialize};

use super::v4l::controls;
use super::v4l::device::{Errno, OfferedSize, V4lSystem};
use super::v4l::setup::{CAP_CAPTURE, CAP_CAPTURE_MPLANE, CAP_OUTPUT, CAP_STREAMING, field_name};
use super::v4l::system::KernelSystem;

/// A camera node.
#[derive(Debug, Clone, PartialEq, Default, Serialize, schemars::JsonSchema, Deserialize)]
pub struct CameraListing {
    /// `/dev/videoN`.
    pub node: PathBuf,
    /// Names under `/dev/v4l/by-id`, or, without udev, the name it would have.
    pub by_id: Vec<String>,
    /// Names under `/dev/v4l/by-path`; without udev, the name it would have; else the bus info.
    pub by_path: Vec<String>,
    /// Card name.
    pub card: String,
    /// Driver name.
    pub driver: String,
    /// Bus info.
    pub bus_info: String,
    /// Formats, sizes, rates.
    pub offers: Vec<OfferedSize>,
    /// Field order of the current format.
    pub field: String,
    /// Controls of the camera.
    pub controls: Vec<ControlListing>,
    /// Obstacle to its use, with the cure; empty = none.
    pub problem: String,
    /// Why the node can never be the camera of a rig; empty = it can.
    #[serde(default)]
    pub no_camera: String,
}

/// A control of a camera.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, schemars::JsonSchema, Deserialize)]
pub struct ControlListing {
    /// Name for the rig.
    pub name: String,
    /// V4L2 id.
    pub id: u32,
    /// Least value.
    pub min: i64,
    /// Largest value.
    pub max: i64,
    /// Step between values.
    pub step: u64,
    /// Default value.
    pub default: i64,
    /// Value now; `None` = cannot be read.
    pub value: Option<i64>,
}

/// Purpose of a node that gives no pictures, by its V4L2_CAP_*; the first that fits is taken.
const OTHERS: [(u32, &str); 7] = [
    (
        CAP_META_CAPTURE,
        "it carries a camera's metadata, no pictures",
    ),
    (
        CAP_M2M | CAP_M2M_MPLANE,
        "it converts pictures that are written to it (memory to memory), it makes none",
    ),
    (
        CAP_OUTPUT | CAP_OUTPUT_MPLANE,
        "it takes pictures (an output), it gives none",
    ),
    (CAP_VBI, "it carries the blanking interval of television"),
    (CAP_RADIO, "it is a radio"),
    (CAP_TOUCH, "it is a touch panel"),
    (CAP_META_OUTPUT, "it takes metadata, it gives no pictures"),
];
// Bits of linux/videodev2.h, there V4L2_CAP_*; the kernel has VIDEO_ before OUTPUT and M2M.
const CAP_META_CAPTURE: u32 = 0x0080_0000;
const CAP_META_OUTPUT: u32 = 0x0800_0000;
const CAP_OUTPUT_MPLANE: u32 = 0x2000;
const CAP_M2M: u32 = 0x8000;
const CAP_M2M_MPLANE: u32 = 0x4000;
/// V4L2_CAP_VBI_CAPTURE and V4L2_CAP_SLICED_VBI_CAPTURE
const CAP_VBI: u32 = 0x50;
/// V4L2_CAP_RADIO and V4L2_CAP_SDR_CAPTURE
const CAP_RADIO: u32 = 0x0014_0000;
const CAP_TOUCH: u32 = 0x1000_0000;

/// Why a node of these capabilities gives no pictures to a program; `None` = it does.
fn not_a_camera(caps: u32) -> Option<String> {
    let captures = caps & (CAP_CAPTURE | CAP_CAPTURE_MPLANE) != 0;
    let other = OTHERS.iter().find(|(bits, _)| caps & bits != 0);
    match (captures, other) {
        // A touch panel captures its pressure as if it were a picture.
        (true, _) if caps & CAP_TOUCH != 0 => Some(OTHERS[5].1.to_owned()),
        (true, _) if caps & CAP_STREAMING == 0 => {
            Some("it cannot stream (V4L2_CAP_STREAMING), which is how frames are taken".to_owned())
        }
        (true, _) => None,
        (false, Some((_, words))) => Some((*words).to_owned()),
        (false, None) => Some(format!("it captures no video (capabilities {caps:#010x})")),
    }
}

/// The format that V4L2's name of it stands for, if it is read.
fn format_of(fourcc: &str) -> Option<PixelFormat> {
    let mut code = [b' '; 4];
    for (to, from) in code.iter_mut().zip(fourcc.bytes()) {
        *to = from;
    }
    PixelFormat::of_fourcc(code)
}

/// Names of the formats of these offers, for a rig those that are read, and those that are not.
pub fn formats(offers: &[OfferedSize]) -> (Vec<&'static str>, Vec<&str>) {
    let (mut read, mut unread) = (Vec::new(), Vec::new());
    for offer in offers {
        match format_of(&offer.fourcc) {
            Some(format) if !read.contains(&format.name()) => read.push(format.name()),
            None if !unread.contains(&offer.fourcc.as_str()) => unread.push(offer.fourcc.as_str()),
            _ => {}
        }
    }
    (read, unread)
}

/// Why no format of these offers can be used; `None` = one can, or the node would not list any.
fn no_format(offers: &[OfferedSize]) -> Option<String> {
    let (read, unread) = formats(offers);
    if !read.is_empty() || unread.is_empty() {
        return None;
    }
    // NM12, YM12 ...: V4L2's names of formats whose planes lie in memory of their own.
    let apart = unread
        .iter()
        .all(|name| name.as_bytes().get(1) == Some(&b'M'));
    let why = if apart {
        ": their planes lie in memory of their own, and one is read"
    } else {
        ""
    };
    let known: Vec<&str> = PixelFormat::of_cameras().map(PixelFormat::name).collect();
    Some(format!(
        "it offers only {}, which hydroline does not read{why}; it reads {}",
        unread.join(", "),
        known.join(", ")
    ))
}

/// All video nodes: cameras, those that cannot be asked whether they are, and those that are none, with the reason.
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
        let capability = match device.capability() {
            Ok(capability) => capability,
            Err(errno) => {
                listing.no_camera = format!("it is no V4L2 device (VIDIOC_QUERYCAP: {errno})");
                found.push(listing);
                continue;
            }
        };
        let unfed = capability.caps & (CAP_CAPTURE | CAP_OUTPUT) == CAP_OUTPUT
            && capability.driver.contains("loopback");
        if unfed {
            listing.problem = "no picture yet: nothing feeds this loopback device".into();
        } else if let Some(why) = not_a_camera(capability.caps) {
            listing.no_camera = why;
        }
        (listing.card, listing.driver, listing.bus_info) =
            (capability.card, capability.driver, capability.bus_info);
        if !listing.no_camera.is_empty() {
            found.push(listing);
            continue;
        }
        if listing.by_path.is_empty() {
            listing.by_path.push(listing.bus_info.clone());
        }
        listing.offers = device.offers();
        listing.no_camera = no_format(&listing.offers).unwrap_or_default();
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
    name_the_camera(&mut found);
    found
}

/// A camera's second node says where its pictures come from.
fn name_the_camera(found: &mut [CameraListing]) {
    let cameras: Vec<(PathBuf, String)> = found
        .iter()
        .filter(|c| c.no_camera.is_empty() && !c.bus_info.is_empty())
        .map(|c| (c.node.clone(), c.bus_info.clone()))
        .collect();
    for other in found.iter_mut().filter(|c| !c.no_camera.is_empty()) {
        if let Some((node, _)) = cameras.iter().find(|(_, bus)| *bus == other.bus_info) {
            other.no_camera += &format!("; the pictures come from {}", node.display());
        }
    }
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
    fn every_node_that_is_no_camera_has_its_reason() {
        // Capabilities of nodes as they are met (uvcvideo, vivid, bcm2835-codec, a tuner, a touch panel).
        for (caps, words) in [
            (0x04a0_0000, "metadata"),
            (0x0420_0002, "an output"),
            (0x0420_2000, "an output"),
            (0x0420_4000, "memory to memory"),
            (0x0020_0050, "blanking interval"),
            (0x0010_0000, "radio"),
            (0x1420_0001, "touch panel"),
            (0x0020_0001, "V4L2_CAP_STREAMING"),
            (0x0420_0000, "0x04200000"),
        ] {
            let why = not_a_camera(caps).unwrap();
            assert!(why.contains(words), "{caps:#x}: {why}");
        }
        for caps in [0x0420_0001, 0x0420_1000, 0x0520_0001] {
            assert_eq!(not_a_camera(caps), None, "{caps:#x}");
        }
    }

    #[test]
    fn formats_that_are_not_read_are_named() {
        let offer = |fourcc: &str| OfferedSize {
            fourcc: fourcc.into(),
            ..OfferedSize::default()
        };
        let mixed = ["H264", "Y10 ", "Y10 ", "BA81", "pRAA", "Y16"].map(offer);
        let found = formats(&mixed);
        assert_eq!(found, (vec!["Y10", "BGGR8", "Y16"], vec!["H264", "pRAA"]));
        assert_eq!(no_format(&mixed), None);
        assert_eq!(no_format(&[]), None);
        let why = no_format(&["H264", "pRAA"].map(offer)).unwrap();
        assert!(
            why.contains("only H264, pRAA") && why.contains("RGGB10"),
            "{why}"
        );
        let why = no_format(&["NM12", "YM12"].map(offer)).unwrap();
        assert!(why.contains("memory of their own"), "{why}");
    }

    #[test]
    fn a_metadata_node_says_where_the_pictures_come_from() {
        let node = |n: u32, no_camera: &str| CameraListing {
            node: format!("/dev/video{n}").into(),
            bus_info: "usb-1".into(),
            no_camera: no_camera.into(),
            ..CameraListing::default()
        };
        let mut found = [node(0, ""), node(1, "it carries metadata")];
        name_the_camera(&mut found);
        assert_eq!(
            found[1].no_camera,
            "it carries metadata; the pictures come from /dev/video0"
        );
        assert_eq!(found[0].no_camera, "");
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
