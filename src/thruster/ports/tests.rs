use super::*;
use std::os::unix::fs::{PermissionsExt, symlink};

/// A small /sys and /dev: two FTDI adapters (one with a serial number), one CDC ACM Maestro, one 8250, a console.
struct Machine {
    _dir: tempfile::TempDir,
    roots: Roots,
}

fn put(path: &Path, text: &str) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, text).unwrap();
}

impl Machine {
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let root = dir.path().canonicalize().unwrap();
        let this = Self {
            roots: Roots {
                sys: root.join("sys"),
                dev: root.join("dev"),
            },
            _dir: dir,
        };
        this.usb(
            "1-2",
            "0403",
            "6001",
            "FTDI",
            "FT232R USB UART",
            Some("A9XYZ"),
            "ttyUSB0",
        );
        this.usb(
            "1-4.1",
            "0403",
            "6001",
            "FTDI",
            "FT232R USB UART",
            None,
            "ttyUSB1",
        );
        this.usb(
            "1-3",
            "1ffb",
            "008a",
            "Pololu Corporation",
            "Maestro 12",
            Some("00123"),
            "ttyACM0",
        );
        let isa = this.roots.sys.join("devices/platform/serial8250");
        put(&isa.join("tty/ttyS0/type"), "4\n");
        put(&isa.join("tty/ttyS1/type"), "0\n");
        for name in ["ttyS0", "ttyS1"] {
            this.tty(&isa.join("tty").join(name), &isa, name);
        }
        put(&this.roots.sys.join("class/tty/console/active"), "tty0");
        this
    }

    fn tty(&self, entry: &Path, device: &Path, name: &str) {
        fs::create_dir_all(entry).unwrap();
        symlink(device, entry.join("device")).unwrap();
        let class = self.roots.sys.join("class/tty");
        fs::create_dir_all(&class).unwrap();
        symlink(entry, class.join(name)).unwrap();
        put(&self.roots.dev.join(name), "");
    }

    #[allow(clippy::too_many_arguments)]
    fn usb(
        &self,
        chain: &str,
        vid: &str,
        pid: &str,
        maker: &str,
        model: &str,
        serial: Option<&str>,
        tty: &str,
    ) {
        let usb = self
            .roots
            .sys
            .join("devices/pci0000:00/0000:00:14.0/usb1")
            .join(chain);
        for (file, text) in [
            ("idVendor", vid),
            ("idProduct", pid),
            ("manufacturer", maker),
            ("product", model),
        ] {
            put(&usb.join(file), text);
        }
        if let Some(serial) = serial {
            put(&usb.join("serial"), serial);
        }
        let interface = usb.join(format!("{chain}:1.0"));
        put(&interface.join("bInterfaceNumber"), "00\n");
        let acm = tty.starts_with("ttyACM");
        let device = if acm {
            interface.clone()
        } else {
            interface.join(tty)
        };
        if !acm {
            put(&device.join("port_number"), "0\n");
        }
        self.tty(&device.join("tty").join(tty), &device, tty);
    }
}

#[test]
fn ports_have_the_names_udev_would_give_them() {
    let m = Machine::new();
    let ports = m.roots.ports();
    let names: Vec<_> = ports
        .iter()
        .map(|p| p.node.file_name().unwrap().to_string_lossy().into_owned())
        .collect();
    assert_eq!(
        names,
        ["ttyACM0", "ttyS0", "ttyUSB0", "ttyUSB1"],
        "an absent 8250 and the console are no ports"
    );
    assert_eq!(
        ports[0].by_id.as_deref(),
        Some("usb-Pololu_Corporation_Maestro_12_00123-if00")
    );
    assert_eq!(
        ports[0].by_path.as_deref(),
        Some("pci-0000:00:14.0-usb-0:3:1.0")
    );
    assert_eq!(ports[0].usb, Some((0x1ffb, 0x008a)));
    assert_eq!(ports[1].by_id, None);
    assert_eq!(
        ports[2].by_id.as_deref(),
        Some("usb-FTDI_FT232R_USB_UART_A9XYZ-if00-port0")
    );
    assert_eq!(
        ports[3].by_path.as_deref(),
        Some("pci-0000:00:14.0-usb-0:4.1:1.0-port0")
    );
}

#[test]
fn a_port_is_found_by_each_of_its_names_and_after_renumbering() {
    let m = Machine::new();
    let node = |name: &str| m.roots.dev.join(name);
    let resolve = |p: LinkPort| m.roots.resolve(&p);
    let by_id = LinkPort::ById("usb-FTDI_FT232R_USB_UART_A9XYZ-if00-port0".into());
    assert_eq!(resolve(by_id.clone()).unwrap(), node("ttyUSB0"));
    assert_eq!(
        resolve(LinkPort::ById("usb:0403:6001:A9XYZ".into())).unwrap(),
        node("ttyUSB0")
    );
    assert_eq!(
        resolve(LinkPort::ById("usb:1ffb:008a".into())).unwrap(),
        node("ttyACM0")
    );
    let by_path = LinkPort::ByPath("pci-0000:00:14.0-usb-0:4.1:1.0-port0".into());
    assert_eq!(resolve(by_path).unwrap(), node("ttyUSB1"));
    // udev's link, where it exists, is used as it is: the system keeps it up to date.
    let link = m
        .roots
        .dev
        .join("serial/by-id/usb-FTDI_FT232R_USB_UART_A9XYZ-if00-port0");
    fs::create_dir_all(link.parent().unwrap()).unwrap();
    symlink(node("ttyUSB1"), &link).unwrap();
    assert_eq!(resolve(by_id).unwrap(), link);
}

#[test]
fn what_does_not_fit_or_fits_twice_is_an_error_that_names_the_choices() {
    let m = Machine::new();
    let words = |p: LinkPort| m.roots.resolve(&p).unwrap_err().to_string();
    let twice = words(LinkPort::ById("usb:0403:6001".into()));
    assert!(twice.contains("2 ports fit"), "{twice}");
    assert!(twice.contains("by-path"), "{twice}");
    let none = words(LinkPort::ById("usb-Other-if00".into()));
    assert!(none.contains("A9XYZ") && none.contains("ttyACM0"), "{none}");
    for odd in ["usb:", "usb:zz:1", "usb:0403", "", "../../etc"] {
        assert!(
            m.roots.resolve(&LinkPort::ById(odd.into())).is_err(),
            "{odd}"
        );
    }
    let empty = Roots {
        sys: "/nonexistent".into(),
        dev: "/nonexistent".into(),
    };
    assert!(empty.ports().is_empty());
    assert!(
        empty
            .resolve(&LinkPort::ByPath("x".into()))
            .unwrap_err()
            .to_string()
            .contains("no serial port at all")
    );
}

#[test]
fn a_permission_problem_names_path_owner_group_and_fix() {
    let dir = tempfile::tempdir().unwrap();
    let node = dir.path().join("ttyUSB7");
    fs::write(&node, "").unwrap();
    assert_eq!(permission_problem(&node), None);
    assert_eq!(permission_problem(&dir.path().join("absent")), None);
    // Root may do everything, so the words are made from given facts.
    let words = explain_permission(&node, "root", "dialout", 0o660);
    assert!(
        words.contains("ttyUSB7")
            && words.contains("owner root")
            && words.contains("group dialout"),
        "{words}"
    );
    assert!(words.contains("sudo usermod -aG dialout"), "{words}");
    let words = explain_permission(&node, "root", "root", 0o600);
    assert!(words.contains("udev rule"), "{words}");
    fs::set_permissions(&node, fs::Permissions::from_mode(0o000)).unwrap();
    // SAFETY: geteuid has no preconditions.
    let root = unsafe { libc::geteuid() } == 0;
    assert_eq!(permission_problem(&node).is_none(), root);
}
