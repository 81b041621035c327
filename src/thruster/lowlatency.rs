//! Low-latency mode of a serial driver: set, read back, and reported when there is none.
//!
//! `ASYNC_LOW_LATENCY` (linux/tty_flags.h) makes ftdi_sio set its latency timer to 1 ms instead of 16 ms, and the
//! 8250 driver push received bytes at once. The FTDI timer is also a sysfs file, `latency_timer`. A stamp that is
//! 16 ms late moves X_udot by 0.9 %, hence the fuss.

use std::fmt;
use std::os::fd::RawFd;
use std::path::Path;

/// Bit 13 of `serial_struct.flags`.
pub const ASYNC_LOW_LATENCY: libc::c_int = 1 << 13;

/// `struct serial_struct` of linux/serial.h; not in the libc crate.
#[repr(C)]
struct SerialStruct {
    kind: libc::c_int,
    line: libc::c_int,
    port: libc::c_uint,
    irq: libc::c_int,
    flags: libc::c_int,
    xmit_fifo_size: libc::c_int,
    custom_divisor: libc::c_int,
    baud_base: libc::c_int,
    close_delay: libc::c_ushort,
    io_type: libc::c_char,
    reserved_char: [libc::c_char; 1],
    hub6: libc::c_int,
    closing_wait: libc::c_ushort,
    closing_wait2: libc::c_ushort,
    iomem_base: *mut libc::c_uchar,
    iomem_reg_shift: libc::c_ushort,
    port_high: libc::c_uint,
    iomap_base: libc::c_ulong,
}

/// State of low-latency mode after it was asked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LowLatency {
    /// ASYNC_LOW_LATENCY, read back.
    pub flag: FlagState,
    /// FTDI latency timer, read back \[ms\]; `None` where the driver has none.
    pub latency_timer_ms: Option<u32>,
}

/// State of the flag.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum FlagState {
    /// Set and read back.
    Set,
    /// The driver took the call and reads back without the flag.
    Ignored,
    /// The driver has no such thing (ENOTTY, EINVAL: pseudo-terminals, cdc_acm): nothing to gain either.
    Unsupported,
    /// Refused for another reason, in the system's words.
    Failed(String),
}

impl LowLatency {
    /// Whether there is nothing left to improve.
    pub fn good(&self) -> bool {
        matches!(self.flag, FlagState::Set | FlagState::Unsupported)
            && self.latency_timer_ms.is_none_or(|ms| ms <= 1)
    }
}

impl fmt::Display for LowLatency {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.flag {
            FlagState::Set => write!(f, "low-latency mode set and read back")?,
            FlagState::Ignored => {
                write!(f, "low-latency mode set, but the driver does not keep it")?
            }
            FlagState::Unsupported => write!(f, "the driver has no low-latency mode")?,
            FlagState::Failed(why) => write!(f, "low-latency mode refused: {why}")?,
        }
        match self.latency_timer_ms {
            Some(ms) if ms <= 1 => write!(f, ", latency timer {ms} ms"),
            Some(ms) => write!(
                f,
                ", latency timer {ms} ms: stamps may be that late; as root, echo 1 > .../latency_timer, or a udev rule"
            ),
            None => Ok(()),
        }
    }
}

/// Sets low-latency mode on an open port; `node` is its `/dev/tty*`. Never fatal.
pub fn enable(fd: RawFd, node: &Path) -> LowLatency {
    let flag = set_flag(fd);
    let latency_timer_ms = node.file_name().and_then(|name| {
        let file = Path::new("/sys/class/tty")
            .join(name)
            .join("device/latency_timer");
        latency_timer(&file)
    });
    LowLatency {
        flag,
        latency_timer_ms,
    }
}

/// The timer after trying to make it 1 ms.
fn latency_timer(file: &Path) -> Option<u32> {
    let read = || {
        std::fs::read_to_string(file)
            .ok()?
            .trim()
            .parse::<u32>()
            .ok()
    };
    if read()? > 1 {
        // Needs root; where it fails the value read back says so.
        let _ = std::fs::write(file, "1");
    }
    read()
}

fn set_flag(fd: RawFd) -> FlagState {
    // SAFETY: all-zero is a valid SerialStruct (integers and one pointer that is never followed).
    let mut s: SerialStruct = unsafe { std::mem::zeroed() };
    // SAFETY: TIOCGSERIAL fills the struct whose layout is that of linux/serial.h.
    if unsafe { libc::ioctl(fd, libc::TIOCGSERIAL as _, &mut s) } != 0 {
        return refused();
    }
    if s.flags & ASYNC_LOW_LATENCY == 0 {
        s.flags |= ASYNC_LOW_LATENCY;
        // SAFETY: as above; the kernel copies the struct.
        if unsafe { libc::ioctl(fd, libc::TIOCSSERIAL as _, &s) } != 0 {
            return refused();
        }
    }
    // SAFETY: as above.
    let mut back: SerialStruct = unsafe { std::mem::zeroed() };
    // SAFETY: as above.
    if unsafe { libc::ioctl(fd, libc::TIOCGSERIAL as _, &mut back) } != 0 {
        return refused();
    }
    if back.flags & ASYNC_LOW_LATENCY != 0 {
        FlagState::Set
    } else {
        FlagState::Ignored
    }
}

fn refused() -> FlagState {
    let error = std::io::Error::last_os_error();
    match error.raw_os_error() {
        Some(libc::ENOTTY | libc::EINVAL) => FlagState::Unsupported,
        _ => FlagState::Failed(error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::fd::AsRawFd;

    #[test]
    fn a_descriptor_without_the_mode_is_not_fatal() {
        let file = tempfile::tempfile().unwrap();
        let got = enable(file.as_raw_fd(), Path::new("/dev/pts/999999"));
        assert_eq!(
            got,
            LowLatency {
                flag: FlagState::Unsupported,
                latency_timer_ms: None
            }
        );
        assert!(got.good());
    }

    #[test]
    fn a_long_latency_timer_is_shortened_or_reported() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("latency_timer");
        std::fs::write(&file, "16\n").unwrap();
        assert_eq!(latency_timer(&file), Some(1));
        assert_eq!(latency_timer(&dir.path().join("absent")), None);
        let reported = LowLatency {
            flag: FlagState::Ignored,
            latency_timer_ms: Some(16),
        };
        assert!(!reported.good());
        assert!(reported.to_string().contains("16 ms"));
    }

    #[test]
    fn the_struct_has_the_kernels_size() {
        // x86_64 and aarch64: 72 bytes (linux/serial.h).
        #[cfg(target_pointer_width = "64")]
        assert_eq!(std::mem::size_of::<SerialStruct>(), 72);
    }
}
