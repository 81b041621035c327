//! The real machine: identities, permissions, who holds a node. All of it is read from directories that tests replace.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use hydroline_rigs::DeviceIdentity;

use super::device::{Errno, NotFound, V4lDevice, V4lSystem};
#[cfg(feature = "v4l2")]
use super::kernel::KernelDevice;
use super::setup::{CAP_CAPTURE, CAP_OUTPUT};

/// Module parameters that change the meaning of stamps and flags.
const PARAMETERS: [&str; 4] = ["clock", "hwtimestamps", "nodrop", "quirks"];

/// The machine, by its directories.
#[derive(Debug, Clone)]
pub struct KernelSystem {
    /// `/dev`
    pub dev: PathBuf,
    /// `/sys`
    pub sys: PathBuf,
    /// `/proc`
    pub proc: PathBuf,
    /// `/etc`
    pub etc: PathBuf,
}

impl Default for KernelSystem {
    fn default() -> Self {
        Self {
            dev: "/dev".into(),
            sys: "/sys".into(),
            proc: "/proc".into(),
            etc: "/etc".into(),
        }
    }
}

/// A video node as sysfs knows it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SysNode {
    /// `/dev/videoN`.
    pub node: PathBuf,
    /// Card name.
    pub card: String,
    /// Which of the device's nodes this is.
    pub index: u32,
    /// The name udev gives in by-id: of USB devices only.
    pub by_id: Option<String>,
    /// The name udev gives in by-path: of USB, PCI and platform devices.
    pub by_path: Option<String>,
}

fn line(path: &Path) -> Option<String> {
    fs::read_to_string(path)
        .ok()
        .map(|s| s.trim().to_owned())
        .filter(|s| !s.is_empty())
}

/// udev replaces everything but letters, digits and a few signs by underscores.
fn udev_word(s: &str) -> String {
    let allowed = |c: char| c.is_ascii_alphanumeric() || "#+-.:=@_/".contains(c);
    let mut out = String::new();
    for c in s.trim().chars() {
        let c = if allowed(c) { c } else { '_' };
        if !(c == '_' && out.ends_with('_')) {
            out.push(c);
        }
    }
    out.replace('/', "_")
}

impl KernelSystem {
    /// All video nodes, in the order of their numbers.
    pub fn nodes(&self) -> Vec<SysNode> {
        let class = self.sys.join("class/video4linux");
        let mut nodes: Vec<(u32, SysNode)> = fs::read_dir(&class)
            .into_iter()
            .flatten()
            .flatten()
            .filter_map(|entry| {
                let name = entry.file_name().into_string().ok()?;
                let number: u32 = name.strip_prefix("video")?.parse().ok()?;
                let dir = entry.path();
                let index = line(&dir.join("index"))
                    .and_then(|s| s.parse().ok())
                    .unwrap_or(0);
                let card = line(&dir.join("name")).unwrap_or_default();
                Some((
                    number,
                    SysNode {
                        node: self.dev.join(&name),
                        card,
                        index,
                        by_id: usb_name(&dir, index),
                        by_path: path_name(&dir, index),
                    },
                ))
            })
            .collect();
        nodes.sort_by_key(|(number, _)| *number);
        nodes.into_iter().map(|(_, node)| node).collect()
    }

    /// Names of `/dev/v4l/<folder>` that point to this node.
    pub fn links(&self, folder: &str, node: &Path) -> Vec<String> {
        let wanted = fs::canonicalize(node).ok();
        let mut names: Vec<String> = fs::read_dir(self.dev.join("v4l").join(folder))
            .into_iter()
            .flatten()
            .flatten()
            .filter(|e| wanted.is_some() && fs::canonicalize(e.path()).ok() == wanted)
            .filter_map(|e| e.file_name().into_string().ok())
            .collect();
        names.sort();
        names
    }

    fn present(&self) -> NotFound {
        let all: Vec<String> = self
            .nodes()
            .iter()
            .map(|n| {
                format!(
                    "{} ({}{})",
                    n.node.display(),
                    n.card,
                    n.by_id
                        .as_ref()
                        .map(|i| format!(", {i}"))
                        .unwrap_or_default()
                )
            })
            .collect();
        NotFound {
            present: if all.is_empty() {
                "no video device at all".into()
            } else {
                all.join(", ")
            },
        }
    }

    fn by_bus(&mut self, bus_info: &str) -> Option<PathBuf> {
        let mut second_choice = None;
        for node in self.nodes() {
            let Ok(mut device) = self.open(&node.node) else {
                continue;
            };
            let Ok(capability) = device.capability() else {
                continue;
            };
            if capability.bus_info != bus_info {
                continue;
            }
            if capability.caps & CAP_CAPTURE != 0 {
                return Some(node.node);
            }
            // v4l2loopback is an output only until its feeder has opened it.
            if capability.caps & CAP_OUTPUT != 0 {
                second_choice.get_or_insert(node.node);
            }
        }
        second_choice
    }

    fn name_of(&self, file: &str, id: u32) -> String {
        let table = fs::read_to_string(self.etc.join(file)).unwrap_or_default();
        let id_text = id.to_string();
        table
            .lines()
            .find_map(|l| {
                let mut fields = l.split(':');
                let name = fields.next()?;
                (fields.nth(1)? == id_text).then(|| name.to_owned())
            })
            .unwrap_or(id_text)
    }
}

/// `usb-<manufacturer>_<product>_<serial>-video-index<n>` from the USB device above this node.
fn usb_name(class_dir: &Path, index: u32) -> Option<String> {
    let start = fs::canonicalize(class_dir.join("device")).ok()?;
    let usb = start
        .ancestors()
        .take(4)
        .find(|d| d.join("idVendor").exists())?;
    let vendor = line(&usb.join("manufacturer")).or_else(|| line(&usb.join("idVendor")))?;
    let product = line(&usb.join("product")).or_else(|| line(&usb.join("idProduct")))?;
    let mut name = format!("usb-{}_{}", udev_word(&vendor), udev_word(&product));
    if let Some(serial) = line(&usb.join("serial")) {
        name = format!("{name}_{}", udev_word(&serial));
    }
    Some(format!("{name}-video-index{index}"))
}

/// `<bus>-<device>[-usb-0:<port>:<interface>]-video-index<n>` as udev's path_id builds it.
fn path_name(class_dir: &Path, index: u32) -> Option<String> {
    let start = fs::canonicalize(class_dir.join("device")).ok()?;
    let mut usb = String::new();
    for dir in start.ancestors() {
        let name = dir.file_name()?.to_str()?;
        let subsystem = fs::canonicalize(dir.join("subsystem")).ok();
        match subsystem
            .as_deref()
            .and_then(Path::file_name)
            .and_then(|s| s.to_str())
        {
            // An interface is called `<bus>-<port>[.<port>...]:<configuration>.<interface>`.
            Some("usb") if usb.is_empty() && name.contains(':') => {
                usb = format!("-usb-0:{}", name.split_once('-')?.1);
            }
            Some(bus @ ("pci" | "platform")) => {
                return Some(format!("{bus}-{name}{usb}-video-index{index}"));
            }
            _ => {}
        }
    }
    None
}

impl V4lSystem for KernelSystem {
    fn find(&mut self, identity: &DeviceIdentity) -> Result<PathBuf, NotFound> {
        if cfg!(not(feature = "v4l2")) {
            return Err(NotFound {
                present: "none can be: this program was built without V4L2; build it with the Cargo feature `acquisition`".to_owned(),
            });
        }
        let found = match identity {
            DeviceIdentity::Node(node) => node.exists().then(|| node.clone()),
            DeviceIdentity::ById(name) => fs::canonicalize(self.dev.join("v4l/by-id").join(name))
                .ok()
                .or_else(|| {
                    self.nodes()
                        .into_iter()
                        .find(|n| n.by_id.as_deref() == Some(name))
                        .map(|n| n.node)
                }),
            DeviceIdentity::ByPath(name) => {
                fs::canonicalize(self.dev.join("v4l/by-path").join(name))
                    .ok()
                    .or_else(|| {
                        self.nodes()
                            .into_iter()
                            .find(|n| n.by_path.as_deref() == Some(name))
                            .map(|n| n.node)
                    })
                    .or_else(|| self.by_bus(name))
            }
        };
        found.ok_or_else(|| self.present())
    }

    #[cfg(feature = "v4l2")]
    fn open(&mut self, node: &Path) -> Result<Box<dyn V4lDevice>, Errno> {
        Ok(Box::new(KernelDevice::open(node)?))
    }

    #[cfg(not(feature = "v4l2"))]
    fn open(&mut self, _node: &Path) -> Result<Box<dyn V4lDevice>, Errno> {
        Err(Errno(libc::EOPNOTSUPP))
    }

    fn holders(&self, node: &Path) -> String {
        let mut holders = Vec::new();
        let mut blind = false;
        for process in fs::read_dir(&self.proc).into_iter().flatten().flatten() {
            // Ourselves we know.
            let Some(pid) = process
                .file_name()
                .to_str()
                .and_then(|n| n.parse::<u32>().ok())
                .filter(|pid| *pid != std::process::id())
            else {
                continue;
            };
            let Ok(files) = fs::read_dir(process.path().join("fd")) else {
                blind = true;
                continue;
            };
            if files
                .flatten()
                .any(|f| fs::read_link(f.path()).is_ok_and(|target| target == node))
            {
                holders.push(format!(
                    "{pid} ({})",
                    line(&process.path().join("comm")).unwrap_or_default()
                ));
            }
        }
        match (holders.is_empty(), blind) {
            (false, _) => holders.join(", "),
            (true, true) => format!(
                "a process of another user (`sudo fuser -v {}` names it)",
                node.display()
            ),
            (true, false) => {
                "no process that can be seen (another container, or the driver itself)".into()
            }
        }
    }

    fn access_problem(&self, node: &Path) -> String {
        let Ok(meta) = fs::metadata(node) else {
            return "permission denied, and its owner cannot be read; check the folders above it"
                .into();
        };
        let (owner, group) = (
            self.name_of("passwd", meta.uid()),
            self.name_of("group", meta.gid()),
        );
        let mode = meta.mode() & 0o777;
        let fix = if mode & 0o060 == 0o060 && meta.gid() != 0 {
            format!("`sudo usermod -aG {group} $USER`, then log in again")
        } else {
            format!(
                "a udev rule that gives it to a group, e.g. `SUBSYSTEM==\"video4linux\", GROUP=\"video\", MODE=\"0660\"`; until the next plug `sudo chgrp video {0} && sudo chmod 660 {0}`",
                node.display()
            )
        };
        format!("permission denied: it belongs to {owner}:{group} with mode {mode:03o}; {fix}")
    }

    fn module_parameters(&self, driver: &str) -> BTreeMap<String, String> {
        let folder = self
            .sys
            .join("module")
            .join(driver.replace([' ', '-', '/'], "_"))
            .join("parameters");
        PARAMETERS
            .iter()
            .filter_map(|name| Some(((*name).to_owned(), line(&folder.join(name))?)))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    fn put(root: &Path, path: &str, text: &str) {
        let path = root.join(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }

    fn machine() -> (tempfile::TempDir, KernelSystem) {
        let root = tempfile::tempdir().unwrap();
        let r = root.path();
        for (file, text) in [
            ("manufacturer", "Emu Vendor"),
            ("product", "EmuCam"),
            ("serial", "SN0001"),
            ("idVendor", "1d6b"),
        ] {
            put(
                r,
                &format!("sys/devices/0000:00:14.0/usb1/1-1/{file}"),
                text,
            );
        }
        for n in 0..2 {
            put(
                r,
                &format!("sys/devices/0000:00:14.0/usb1/1-1/1-1:1.0/video4linux/video{n}/index"),
                &format!("{n}\n"),
            );
            put(
                r,
                &format!("sys/devices/0000:00:14.0/usb1/1-1/1-1:1.0/video4linux/video{n}/name"),
                "EmuCam: EmuCam\n",
            );
            put(r, &format!("dev/video{n}"), "");
            let dir = r.join(format!(
                "sys/devices/0000:00:14.0/usb1/1-1/1-1:1.0/video4linux/video{n}"
            ));
            symlink("../..", dir.join("device")).unwrap();
            for (device, bus) in [
                ("usb1/1-1/1-1:1.0", "usb"),
                ("usb1/1-1", "usb"),
                ("", "pci"),
            ] {
                fs::create_dir_all(r.join("sys/bus").join(bus)).unwrap();
                let device = r.join("sys/devices/0000:00:14.0").join(device);
                let _ = symlink(r.join("sys/bus").join(bus), device.join("subsystem"));
            }
            fs::create_dir_all(r.join("sys/class/video4linux")).unwrap();
            symlink(&dir, r.join(format!("sys/class/video4linux/video{n}"))).unwrap();
        }
        put(r, "etc/passwd", "root:x:0:0:root:/root:/bin/sh\n");
        put(r, "etc/group", "root:x:0:\nvideo:x:44:\n");
        put(r, "sys/module/uvcvideo/parameters/nodrop", "1\n");
        put(
            r,
            "sys/module/uvcvideo/parameters/clock",
            "CLOCK_MONOTONIC\n",
        );
        let system = KernelSystem {
            dev: r.join("dev"),
            sys: r.join("sys"),
            proc: r.join("proc"),
            etc: r.join("etc"),
        };
        (root, system)
    }

    #[test]
    fn without_udev_the_same_name_is_built_from_sysfs() {
        let (root, mut system) = machine();
        let id = DeviceIdentity::ById("usb-Emu_Vendor_EmuCam_SN0001-video-index0".into());
        assert_eq!(system.find(&id).unwrap(), root.path().join("dev/video0"));
        let other = DeviceIdentity::ById("usb-Emu_Vendor_EmuCam_SN0002-video-index0".into());
        assert!(
            system
                .find(&other)
                .unwrap_err()
                .present
                .contains("SN0001-video-index1")
        );
    }

    #[test]
    fn by_path_is_built_as_udev_does() {
        let (root, mut system) = machine();
        let name = "pci-0000:00:14.0-usb-0:1:1.0-video-index1";
        assert_eq!(
            system.find(&DeviceIdentity::ByPath(name.into())).unwrap(),
            root.path().join("dev/video1")
        );
    }

    #[test]
    fn with_udev_the_link_decides() {
        let (root, mut system) = machine();
        fs::create_dir_all(root.path().join("dev/v4l/by-id")).unwrap();
        symlink("../../video1", root.path().join("dev/v4l/by-id/mine")).unwrap();
        let found = system.find(&DeviceIdentity::ById("mine".into())).unwrap();
        assert_eq!(
            found,
            fs::canonicalize(root.path().join("dev/video1")).unwrap()
        );
        assert_eq!(
            system.links("by-id", &root.path().join("dev/video1")),
            ["mine"]
        );
    }

    #[test]
    fn permission_trouble_names_owner_group_and_cure() {
        let (root, system) = machine();
        let text = system.access_problem(&root.path().join("dev/video0"));
        assert!(
            text.contains("root:root") && text.contains("udev rule"),
            "{text}"
        );
    }

    #[test]
    fn parameters_and_holders_are_read() {
        let (root, system) = machine();
        assert_eq!(system.module_parameters("uvcvideo").len(), 2);
        put(root.path(), "proc/77/comm", "ffmpeg\n");
        fs::create_dir_all(root.path().join("proc/77/fd")).unwrap();
        symlink(
            root.path().join("dev/video0"),
            root.path().join("proc/77/fd/3"),
        )
        .unwrap();
        assert_eq!(
            system.holders(&root.path().join("dev/video0")),
            "77 (ffmpeg)"
        );
    }
}
