//! Runs a [`SimController`] over any descriptor.

use super::{ControllerEvent, SimController};
use hydroline_core::clock::Clock;
use hydroline_core::lock::Lock;
use std::io::{self, Read, Write};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// Reason why [`serve`] came back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ServeEnd {
    /// `stop` was set.
    Stopped,
    /// The other end closed.
    Closed,
}

/// Serves `stream` until `stop` is set or the other end closes. Every change of an output goes to `on_pulses`.
///
/// The stream is made non-blocking. `clock` has to be the system's: the waiting is done by poll(2).
/// Bytes that the other end does not read are dropped as a UART would, not kept.
///
/// # Errors
/// When the descriptor fails.
pub fn serve<S: Read + Write + AsFd>(
    controller: &Mutex<SimController>,
    stream: &mut S,
    clock: &dyn Clock,
    stop: &AtomicBool,
    on_pulses: &mut dyn FnMut(ControllerEvent),
) -> io::Result<ServeEnd> {
    set_nonblocking(stream.as_fd())?;
    let (mut buffer, mut out) = ([0u8; 512], Vec::new());
    while !stop.load(Ordering::Relaxed) {
        let wake_ns = {
            let mut controller = controller.held();
            out.clear();
            controller.poll(clock.monotonic_ns(), &mut out, on_pulses);
            controller.next_wake_ns()
        };
        match stream.write(&out) {
            Ok(_) => {}
            Err(e) if later(&e) => {}
            Err(e) if gone(&e) => return Ok(ServeEnd::Closed),
            Err(e) => return Err(e),
        }
        // Never longer than 20 ms, so that `stop` and new faults are noticed.
        let wait_ns = wake_ns
            .map_or(u64::MAX, |w| w.saturating_sub(clock.monotonic_ns()))
            .min(20_000_000);
        if !readable(stream.as_fd(), wait_ns)? {
            continue;
        }
        match stream.read(&mut buffer) {
            Ok(0) => return Ok(ServeEnd::Closed),
            Ok(n) => {
                let mut controller = controller.held();
                controller.receive(clock.monotonic_ns(), &buffer[..n]);
            }
            Err(e) if later(&e) => {}
            Err(e) if gone(&e) => return Ok(ServeEnd::Closed),
            Err(e) => return Err(e),
        }
    }
    Ok(ServeEnd::Stopped)
}

/// Whether the same call may succeed when it is made again.
fn later(e: &io::Error) -> bool {
    use io::ErrorKind::{Interrupted, WouldBlock};
    matches!(e.kind(), WouldBlock | Interrupted)
}

fn gone(e: &io::Error) -> bool {
    // EIO is how a pseudo-terminal's master says that nobody holds the other side.
    matches!(
        e.kind(),
        io::ErrorKind::BrokenPipe | io::ErrorKind::ConnectionReset
    ) || e.raw_os_error() == Some(libc::EIO)
}

fn set_nonblocking(fd: BorrowedFd<'_>) -> io::Result<()> {
    // SAFETY: fcntl on a borrowed, open descriptor.
    let flags = unsafe { libc::fcntl(fd.as_raw_fd(), libc::F_GETFL) };
    // SAFETY: as above.
    if flags < 0
        || unsafe { libc::fcntl(fd.as_raw_fd(), libc::F_SETFL, flags | libc::O_NONBLOCK) } < 0
    {
        return Err(io::Error::last_os_error());
    }
    Ok(())
}

fn readable(fd: BorrowedFd<'_>, wait_ns: u64) -> io::Result<bool> {
    let mut poll = libc::pollfd {
        fd: fd.as_raw_fd(),
        events: libc::POLLIN,
        revents: 0,
    };
    let wait = libc::timespec {
        tv_sec: (wait_ns / 1_000_000_000) as _,
        tv_nsec: (wait_ns % 1_000_000_000) as _,
    };
    // SAFETY: one valid pollfd, a valid timespec, no signal mask.
    let n = unsafe { libc::ppoll(&mut poll, 1, &wait, std::ptr::null()) };
    if n < 0 {
        let error = io::Error::last_os_error();
        return if error.kind() == io::ErrorKind::Interrupted {
            Ok(false)
        } else {
            Err(error)
        };
    }
    Ok(n > 0)
}
