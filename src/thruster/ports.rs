//! Serial ports by stable identity: what is there, which one is meant, and what to fix.
//!
//! With udev the links under `/dev/serial/by-id` and `by-path` decide. Without it (a minimal system, a container, an
//! initramfs) the same names are derived from sysfs as udev's rules `60-serial.rules` and `usb_id` do. By-id also takes
//! `usb:VVVV:PPPP[:SERIAL]` (hexadecimal vendor and product), refused when it fits several ports.

use super::transport::OpenError;
use hydroline_rigs::LinkPort;
use std::ffi::CString;
use std::fs;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// A serial port.
#[derive(Debug, Clone, PartialEq, Eq, Default, serde::Serialize, schemars::JsonSchema)]
pub struct Port {
    /// Device node, e.g. `/dev/ttyUSB0`.
    pub node: PathBuf,
    /// Driver, e.g. `ftdi_sio`, `cdc_acm`, `serial8250`.
    pub driver: String,
    /// Name under `/dev/serial/by-id`, as found or as udev would make it.
    pub by_id: Option<String>,
    /// Name under `/dev/serial/by-path`, likewise.
    pub by_path: Option<String>,
    /// USB vendor and product.
    pub usb: Option<(u16, u16)>,
    /// USB serial number.
    pub serial: Option<String>,
    /// Manufacturer and product words.
    pub description: String,
    /// Obstacle to its use, with the fix; `None` = there is none.
    pub problem: Option<String>,
}

/// Folders of sysfs and devices; others in tests.
#[derive(Debug, Clone)]
pub struct Roots {
    /// `/sys`
    pub sys: PathBuf,
    /// `/dev`
    pub dev: PathBuf,
}

impl Default for Roots {
    fn default() -> Self {
        Self {
            sys: "/sys".into(),
            dev: "/dev".into(),
        }
    }
}

impl Roots {
    /// All serial ports with hardware behind them, sorted by node.
    pub fn ports(&self) -> Vec<Port> {
        let Ok(entries) = fs::read_dir(self.sys.join("class/tty")) else {
            return Vec::new();
        };
        let mut ports: Vec<Port> = entries
            .flatten()
            .filter_map(|e| self.port(&e.path()))
            .collect();
        ports.sort_by(|a, b| a.node.cmp(&b.node));
        ports
    }

    fn port(&self, entry: &Path) -> Option<Port> {
        // Consoles and pseudo-terminals have no device; absent 8250 slots have type 0.
        let device = entry.join("device").canonicalize().ok()?;
        if read(&entry.join("type")).is_some_and(|t| t == "0") {
            return None;
        }
        let name = entry.file_name()?.to_string_lossy().into_owned();
        let driver = device
            .join("driver")
            .canonicalize()
            .ok()
            .and_then(|d| Some(d.file_name()?.to_string_lossy().into_owned()))
            .unwrap_or_default();
        let mut port = Port {
            node: self.dev.join(&name),
            driver,
            ..Port::default()
        };
        self.usb(&device, &mut port);
        // udev's own links win over what we derive.
        for (kind, slot) in [("by-id", &mut port.by_id), ("by-path", &mut port.by_path)] {
            if let Some(link) = self.link_to(kind, &port.node) {
                *slot = Some(link);
            }
        }
        port.problem = permission_problem(&port.node);
        Some(port)
    }

    fn link_to(&self, kind: &str, node: &Path) -> Option<String> {
        let node = node.canonicalize().ok()?;
        fs::read_dir(self.dev.join("serial").join(kind))
            .ok()?
            .flatten()
            .find(|e| e.path().canonicalize().is_ok_and(|p| p == node))
            .map(|e| e.file_name().to_string_lossy().into_owned())
    }

    fn usb(&self, device: &Path, port: &mut Port) {
        let port_number = read(&device.join("port_number"));
        let Some(interface) = device
            .ancestors()
            .find(|p| p.join("bInterfaceNumber").exists())
        else {
            return;
        };
        let Some(usb) = interface.parent() else {
            return;
        };
        let hex = |file: &str| read(&usb.join(file)).and_then(|s| u16::from_str_radix(&s, 16).ok());
        let (Some(vendor), Some(product)) = (hex("idVendor"), hex("idProduct")) else {
            return;
        };
        let words =
            |file: &str, or: u16| read(&usb.join(file)).unwrap_or_else(|| format!("{or:04x}"));
        let (maker, model) = (words("manufacturer", vendor), words("product", product));
        port.usb = Some((vendor, product));
        port.serial = read(&usb.join("serial"));
        port.description = format!("{maker} {model}");
        let mut id = format!("usb-{}_{}", udev_word(&maker), udev_word(&model));
        if let Some(serial) = &port.serial {
            id = format!("{id}_{}", udev_word(serial));
        }
        let number = read(&interface.join("bInterfaceNumber")).unwrap_or_else(|| "00".into());
        let tail = port_number.map(|n| format!("-port{n}")).unwrap_or_default();
        port.by_id = Some(format!("{id}-if{number}{tail}"));
        // usb-0:<port chain>:<configuration.interface>, below the PCI function (udev's path_id).
        let chain = interface
            .file_name()
            .map(|n| n.to_string_lossy().into_owned())
            .unwrap_or_default();
        let pci = interface
            .ancestors()
            .filter_map(|p| p.file_name())
            .map(|n| n.to_string_lossy())
            .find(|n| {
                n.len() == 12
                    && n.as_bytes()[4] == b':'
                    && n.as_bytes()[7] == b':'
                    && n.as_bytes()[10] == b'.'
            });
        if let (Some((_, chain)), Some(pci)) = (chain.split_once('-'), pci) {
            port.by_path = Some(format!("pci-{pci}-usb-0:{chain}{tail}"));
        }
    }

    /// The node that a rig's port means, now. Ask again after every unplug: node numbers change.
    ///
    /// # Errors
    /// When nothing, or more than one port, fits; the error names what is there.
    pub fn resolve(&self, wanted: &LinkPort) -> Result<PathBuf, OpenError> {
        let (kind, name) = match wanted {
            LinkPort::Node(path) => return Ok(path.clone()),
            LinkPort::Sim => {
                return Err(OpenError::NotFound {
                    wanted: "the simulated controller".into(),
                    hint: "it has no device of its own: start it and use the node it reports"
                        .into(),
                });
            }
            LinkPort::Udp(address) => {
                return Err(OpenError::NotFound {
                    wanted: format!("udp:{address}"),
                    hint: "it is no serial port".into(),
                });
            }
            LinkPort::ById(name) => ("by-id", name),
            LinkPort::ByPath(name) => ("by-path", name),
        };
        let link = self.dev.join("serial").join(kind).join(name);
        if link.exists() {
            return Ok(link);
        }
        let ports = self.ports();
        let usb = name
            .strip_prefix("usb:")
            .map(|rest| rest.splitn(3, ':').collect::<Vec<_>>());
        let fits = |p: &&Port| match (&usb, kind) {
            (Some(parts), "by-id") => {
                let part = |i: usize| parts.get(i).copied();
                p.usb.is_some_and(|(vendor, product)| {
                    part(0).and_then(|v| u16::from_str_radix(v, 16).ok()) == Some(vendor)
                        && part(1).and_then(|v| u16::from_str_radix(v, 16).ok()) == Some(product)
                }) && part(2).is_none_or(|serial| p.serial.as_deref() == Some(serial))
            }
            (_, "by-id") => p.by_id.as_deref() == Some(name.as_str()),
            _ => p.by_path.as_deref() == Some(name.as_str()),
        };
        let found: Vec<&Port> = ports.iter().filter(fits).collect();
        match found.as_slice() {
            [one] => Ok(one.node.clone()),
            [] => Err(OpenError::NotFound {
                wanted: format!("{kind}/{name}"),
                hint: if ports.is_empty() {
                    "there is no serial port at all; is it plugged in, is its driver loaded (dmesg)?".into()
                } else {
                    format!("there are: {}", list(&ports, kind))
                },
            }),
            _ => Err(OpenError::NotFound {
                wanted: format!("{kind}/{name}"),
                hint: format!(
                    "{} ports fit, name the serial number or use by-path: {}",
                    found.len(),
                    list(&ports, "by-path")
                ),
            }),
        }
    }
}

/// All serial ports of this machine.
pub fn ports() -> Vec<Port> {
    Roots::default().ports()
}

fn list(ports: &[Port], kind: &str) -> String {
    ports
        .iter()
        .map(|p| {
            let name = if kind == "by-id" {
                &p.by_id
            } else {
                &p.by_path
            };
            format!(
                "{} ({})",
                name.as_deref().unwrap_or("no stable name"),
                p.node.display()
            )
        })
        .collect::<Vec<_>>()
        .join(", ")
}

fn read(path: &Path) -> Option<String> {
    let text = fs::read_to_string(path).ok()?;
    let text = text.trim();
    (!text.is_empty()).then(|| text.to_owned())
}

/// udev's `util_replace_whitespace` and `util_replace_chars`: runs of blanks become one `_`, so do odd characters.
fn udev_word(text: &str) -> String {
    let joined = text.split_whitespace().collect::<Vec<_>>().join("_");
    joined
        .chars()
        .map(|c| {
            if c.is_alphanumeric() || "#+-.:=@_".contains(c) {
                c
            } else {
                '_'
            }
        })
        .collect()
}

/// Why this process may not use `node`, with path, owner, group and the command that helps; `None` = it may (or it is
/// not there).
pub fn permission_problem(node: &Path) -> Option<String> {
    let c_path = CString::new(node.as_os_str().as_bytes()).ok()?;
    // SAFETY: a NUL-terminated path.
    if unsafe { libc::access(c_path.as_ptr(), libc::R_OK | libc::W_OK) } == 0 {
        return None;
    }
    let meta = fs::metadata(node).ok()?;
    let name_of = |file: &str, id: u32| {
        fs::read_to_string(file)
            .ok()
            .and_then(|text| {
                text.lines().find_map(|line| {
                    let mut fields = line.split(':');
                    let name = fields.next()?;
                    (fields.nth(1)?.parse() == Ok(id)).then(|| name.to_owned())
                })
            })
            .unwrap_or_else(|| id.to_string())
    };
    let (owner, group) = (
        name_of("/etc/passwd", meta.uid()),
        name_of("/etc/group", meta.gid()),
    );
    Some(explain_permission(node, &owner, &group, meta.mode()))
}

fn explain_permission(node: &Path, owner: &str, group: &str, mode: u32) -> String {
    let fix = if mode & 0o060 == 0o060 && group != "root" {
        format!("run `sudo usermod -aG {group} $USER` and log in again")
    } else {
        format!(
            "its group {group} may not read and write either: a udev rule with GROUP=\"dialout\", MODE=\"0660\" helps, \
             then `sudo usermod -aG dialout $USER`"
        )
    };
    format!(
        "no permission for {} (owner {owner}, group {group}, mode {:04o}): {fix}",
        node.display(),
        mode & 0o7777
    )
}

#[cfg(test)]
mod tests;
