//! Keys while recording and between runs: Space = neutral at once and no plan any more, q (or Ctrl-D) = end cleanly.
//! Ctrl-C stays a signal.
//!
//! A thread of its own reads them, so that nothing the program waits for delays a neutral.

use hydroline_thruster::NeutralHandle;
use hydroline_thruster::safety::NeutralReason;
use std::io;
use std::os::fd::RawFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

/// Period at which the thread looks whether it is still wanted \[ms\].
const LOOK_MS: i32 = 100;

/// Keys pressed so far; Space and Enter are reported once.
#[derive(Debug, Default)]
struct Pressed {
    space: AtomicBool,
    quit: AtomicBool,
    enter: AtomicBool,
    closing: AtomicBool,
}

/// Watches the keys of the terminal on stdin until dropped, and gives the terminal back as it was.
#[derive(Debug)]
pub struct Keys {
    pressed: Arc<Pressed>,
    before: libc::termios,
    thread: Option<JoinHandle<()>>,
}

impl Keys {
    /// `None` when stdin is not a terminal (a pipe, a service), or not ours to read (`record ... &` in an interactive
    /// shell): then there are no keys to watch. Line buffering, echo, Ctrl-S and Ctrl-Z are switched off; Ctrl-C keeps
    /// working.
    pub fn watch(line: Option<NeutralHandle>) -> Option<Self> {
        let fd: RawFd = libc::STDIN_FILENO;
        if !in_foreground(fd) {
            return None;
        }
        // SAFETY: isatty only asks; termios is plain data that tcgetattr fills before it is used.
        let before = unsafe {
            if libc::isatty(fd) == 0 {
                return None;
            }
            let mut before: libc::termios = std::mem::zeroed();
            if libc::tcgetattr(fd, &mut before) != 0 {
                return None;
            }
            let mut raw = before;
            raw.c_lflag &= !(libc::ICANON | libc::ECHO);
            // Ctrl-S would stop the terminal, and with it whoever writes to it.
            raw.c_iflag &= !(libc::IXON | libc::IXOFF);
            // Ctrl-Z would stop the daemon and leave the thrusters running.
            raw.c_cc[libc::VSUSP] = 0; // _POSIX_VDISABLE on Linux
            raw.c_cc[libc::VMIN] = 0;
            raw.c_cc[libc::VTIME] = 0;
            if libc::tcsetattr(fd, libc::TCSANOW, &raw) != 0 {
                return None;
            }
            before
        };
        let pressed = Arc::new(Pressed::default());
        let seen = pressed.clone();
        let thread = std::thread::Builder::new()
            .name("keys".to_owned())
            .spawn(move || read_keys(fd, &seen, line.as_ref()))
            .ok();
        Some(Self {
            pressed,
            before,
            thread,
        })
    }

    /// Whether Space was pressed since the last call.
    pub fn space(&self) -> bool {
        self.pressed.space.swap(false, Ordering::AcqRel)
    }

    /// Whether q was pressed.
    pub fn quit(&self) -> bool {
        self.pressed.quit.load(Ordering::Acquire)
    }

    /// Reads what was typed until now and stops watching: whether Space or q was among it. A key pressed
    /// while the watch ends must not be lost: what comes next may be a plan.
    pub fn finish(mut self) -> bool {
        self.join();
        self.space() || self.quit()
    }

    fn join(&mut self) {
        self.pressed.closing.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }

    /// Whether Enter was pressed since the last call.
    pub fn enter(&self) -> bool {
        self.pressed.enter.swap(false, Ordering::AcqRel)
    }
}

/// Whether this process may read the terminal and change its settings: from the background either of them stops the
/// whole process (SIGTTIN, SIGTTOU).
fn in_foreground(fd: RawFd) -> bool {
    // SAFETY: both only ask.
    let (group, ours) = unsafe { (libc::tcgetpgrp(fd), libc::getpgrp()) };
    // None: a terminal that controls no session of ours, where there is no job control.
    group < 0 || group == ours
}

fn read_keys(fd: RawFd, pressed: &Pressed, line: Option<&NeutralHandle>) {
    let mut keys = [0u8; 64];
    loop {
        let closing = pressed.closing.load(Ordering::Acquire);
        let mut poll = libc::pollfd {
            fd,
            events: libc::POLLIN,
            revents: 0,
        };
        // SAFETY: one valid pollfd.
        if unsafe { libc::poll(&mut poll, 1, if closing { 0 } else { LOOK_MS }) } <= 0 {
            // All that was typed until the very end has been read: a Space then is a Space.
            if closing {
                return;
            }
            continue;
        }
        // SAFETY: the buffer is valid for its length. Straight from the descriptor: a buffered reader would
        // keep keys that poll then knows nothing about.
        let n = unsafe { libc::read(fd, keys.as_mut_ptr().cast(), keys.len()) };
        let Ok(n @ 1..) = usize::try_from(n) else {
            let gone = n == 0 || io::Error::last_os_error().kind() != io::ErrorKind::Interrupted;
            if gone {
                return; // the terminal went away: SIGHUP says so too
            }
            continue;
        };
        for key in &keys[..n] {
            match key {
                b' ' => {
                    if let Some(line) = line {
                        line.bar(NeutralReason::Request);
                    }
                    pressed.space.store(true, Ordering::Release);
                }
                // 4 = Ctrl-D.
                b'q' | 4 => {
                    if let Some(line) = line {
                        line.bar(NeutralReason::Exit);
                    }
                    pressed.quit.store(true, Ordering::Release);
                }
                b'\n' | b'\r' => pressed.enter.store(true, Ordering::Release),
                _ => {}
            }
        }
    }
}

impl Drop for Keys {
    fn drop(&mut self) {
        self.join();
        // Sent to the background meanwhile: the terminal is somebody else's now.
        if !in_foreground(libc::STDIN_FILENO) {
            return;
        }
        // SAFETY: restores what tcgetattr returned for the same descriptor.
        unsafe { libc::tcsetattr(libc::STDIN_FILENO, libc::TCSANOW, &self.before) };
    }
}
