//! A pseudo-terminal with the simulated controller at its far end, that can be unplugged and plugged in again.

use super::serve::serve;
use super::{ControllerEvent, Faults, SimController};
use hydroline_core::clock::{Clock, SystemClock};
use hydroline_core::lock::Lock;
use hydroline_core::thread_class::real_time;
use std::fs::File;
use std::io;
use std::os::fd::{FromRawFd, OwnedFd};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::JoinHandle;

/// Called for every change of an output.
pub type OnPulses = Box<dyn FnMut(ControllerEvent) + Send>;

/// Reason why there is no pseudo-terminal.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum PtyError {
    #[error("no pseudo-terminal: {0} (is devpts mounted on /dev/pts?)")]
    Open(io::Error),
    #[error("cannot link {link} to {node}: {error}; name another path, or remove what is there")]
    Link {
        link: PathBuf,
        node: PathBuf,
        error: io::Error,
    },
    #[error("cannot start the controller's thread: {0}")]
    Thread(io::Error),
}

struct Plugged {
    node: PathBuf,
    stop: Arc<AtomicBool>,
    thread: JoinHandle<()>,
}

/// The simulated controller on a pseudo-terminal, on a thread of its own.
pub struct PtyController {
    controller: Arc<Mutex<SimController>>,
    on_pulses: Arc<Mutex<OnPulses>>,
    link: Option<PathBuf>,
    plugged: Option<Plugged>,
}

impl PtyController {
    /// Plugs it in. With `link`, that path points to the node after every plugging in, as udev's by-id links do.
    pub fn start(
        controller: SimController,
        link: Option<PathBuf>,
        on_pulses: OnPulses,
    ) -> Result<Self, PtyError> {
        let mut this = Self {
            controller: Arc::new(Mutex::new(controller)),
            on_pulses: Arc::new(Mutex::new(on_pulses)),
            link,
            plugged: None,
        };
        this.replug()?;
        Ok(this)
    }

    /// Path to open: the stable link where there is one. `None` while unplugged without a link.
    pub fn path(&self) -> Option<&Path> {
        self.link
            .as_deref()
            .or(self.plugged.as_ref().map(|p| p.node.as_path()))
    }

    /// New faults from now on.
    pub fn set_faults(&self, faults: Faults) {
        self.controller().set_faults(faults);
    }

    /// Resets the controller, as a brown-out would.
    pub fn reset(&self) {
        let mut on_pulses = self.on_pulses.held();
        self.controller()
            .reset(SystemClock.monotonic_ns(), &mut |e| on_pulses(e));
    }

    /// The controller, for questions.
    pub fn controller(&self) -> MutexGuard<'_, SimController> {
        self.controller.held()
    }

    /// Pulls the cable: the host's descriptor is at its end, the node vanishes. The controller's watchdog runs on.
    pub fn unplug(&mut self) {
        if let Some(plugged) = self.plugged.take() {
            // Only the link that was made here: someone may have put something else in its place.
            if let Some(link) = &self.link
                && std::fs::read_link(link).is_ok_and(|to| to == plugged.node)
            {
                let _ = std::fs::remove_file(link);
            }
            plugged.stop.store(true, Ordering::Relaxed);
            let _ = plugged.thread.join();
            self.controller().cable_pulled();
        }
    }

    /// Plugs it in (again).
    pub fn replug(&mut self) -> Result<(), PtyError> {
        self.unplug();
        let (master, slave, node) = open_pty().map_err(PtyError::Open)?;
        if let Some(link) = &self.link {
            symlink(&node, link).map_err(|error| PtyError::Link {
                link: link.clone(),
                node: node.clone(),
                error,
            })?;
        }
        let stop = Arc::new(AtomicBool::new(false));
        let (controller, on_pulses, stopped) = (
            self.controller.clone(),
            self.on_pulses.clone(),
            stop.clone(),
        );
        let run = move || {
            // It stands for a microcontroller, which does not share our processor.
            real_time().ok();
            // Our own hold on the far side: without it the master reads EIO whenever the host has it closed.
            let _slave: OwnedFd = slave;
            let mut master = master;
            let mut forward = |event| (on_pulses.held())(event);
            if let Err(error) = serve(
                &controller,
                &mut master,
                &SystemClock,
                &stopped,
                &mut forward,
            ) {
                tracing::error!("simulated controller: {error}");
            }
        };
        let thread = std::thread::Builder::new()
            .name("sim-controller".into())
            .spawn(run)
            .map_err(PtyError::Thread)?;
        self.plugged = Some(Plugged { node, stop, thread });
        Ok(())
    }
}

impl Drop for PtyController {
    fn drop(&mut self) {
        self.unplug();
    }
}

pub(crate) fn open_pty() -> io::Result<(File, OwnedFd, PathBuf)> {
    let (mut master, mut slave) = (-1, -1);
    // SAFETY: openpty fills two descriptors; name, termios and size may be null.
    let done = unsafe {
        libc::openpty(
            &mut master,
            &mut slave,
            std::ptr::null_mut(),
            std::ptr::null_mut(),
            std::ptr::null_mut(),
        )
    };
    if done != 0 {
        return Err(io::Error::last_os_error());
    }
    // SAFETY: both were just opened and belong to nobody else.
    let (master, slave) = unsafe { (File::from_raw_fd(master), OwnedFd::from_raw_fd(slave)) };
    use std::os::fd::AsRawFd;
    for fd in [master.as_raw_fd(), slave.as_raw_fd()] {
        // A child process must not keep the line open. SAFETY: fcntl on an open descriptor.
        unsafe { libc::fcntl(fd, libc::F_SETFD, libc::FD_CLOEXEC) };
    }
    // Raw from the start: an echoing terminal would send the host's first bytes back to it.
    // SAFETY: termios is plain data, filled by tcgetattr before use.
    unsafe {
        let mut termios: libc::termios = std::mem::zeroed();
        if libc::tcgetattr(slave.as_raw_fd(), &mut termios) != 0 {
            return Err(io::Error::last_os_error());
        }
        libc::cfmakeraw(&mut termios);
        if libc::tcsetattr(slave.as_raw_fd(), libc::TCSANOW, &termios) != 0 {
            return Err(io::Error::last_os_error());
        }
    }
    let mut name = [0 as libc::c_char; 128];
    // SAFETY: the buffer is as long as said; ptsname_r ends it with NUL.
    let node = unsafe {
        if libc::ptsname_r(master.as_raw_fd(), name.as_mut_ptr(), name.len()) != 0 {
            return Err(io::Error::last_os_error());
        }
        std::ffi::CStr::from_ptr(name.as_ptr())
            .to_string_lossy()
            .into_owned()
    };
    Ok((master, slave, node.into()))
}
