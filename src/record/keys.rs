//! Keys while recording: Space = neutral at once, q = end cleanly. Ctrl-C stays a signal.

use std::io::{IsTerminal, Read};
use std::os::fd::AsRawFd;
use std::time::Duration;

/// Puts the terminal on stdin into a mode where single keys arrive, and back on drop.
///
/// Only line buffering and echo are switched off; signals (Ctrl-C, Ctrl-Z) keep working.
#[derive(Debug)]
pub struct Keys {
    before: libc::termios,
}

impl Keys {
    /// `None` when stdin is not a terminal (a pipe, a service): then there are no keys to watch.
    pub fn on_terminal() -> Option<Self> {
        let stdin = std::io::stdin();
        if !stdin.is_terminal() {
            return None;
        }
        // SAFETY: termios is plain old data, fully written by tcgetattr before it is used.
        let mut before: libc::termios = unsafe { std::mem::zeroed() };
        // SAFETY: stdin's descriptor stays open for the life of the process; `before` is valid.
        if unsafe { libc::tcgetattr(stdin.as_raw_fd(), &mut before) } != 0 {
            return None;
        }
        let mut raw = before;
        raw.c_lflag &= !(libc::ICANON | libc::ECHO);
        raw.c_cc[libc::VMIN] = 0;
        raw.c_cc[libc::VTIME] = 0;
        // SAFETY: as above.
        (unsafe { libc::tcsetattr(stdin.as_raw_fd(), libc::TCSANOW, &raw) } == 0)
            .then_some(Self { before })
    }

    /// The next key, waiting up to `wait`.
    pub fn next(&self, wait: Duration) -> Option<u8> {
        let mut stdin = std::io::stdin();
        let mut poll = libc::pollfd {
            fd: stdin.as_raw_fd(),
            events: libc::POLLIN,
            revents: 0,
        };
        let wait_ms = wait.as_millis().min(i32::MAX as u128) as i32;
        // SAFETY: one valid pollfd.
        if unsafe { libc::poll(&mut poll, 1, wait_ms) } <= 0 {
            return None;
        }
        let mut key = [0u8; 1];
        match stdin.read(&mut key) {
            Ok(1) => Some(key[0]),
            _ => None,
        }
    }
}

impl Drop for Keys {
    fn drop(&mut self) {
        // SAFETY: restores what tcgetattr returned for the same descriptor.
        unsafe { libc::tcsetattr(std::io::stdin().as_raw_fd(), libc::TCSANOW, &self.before) };
    }
}
