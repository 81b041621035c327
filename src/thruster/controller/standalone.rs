//! The simulated controller as a program of its own: at a pseudo-terminal, or at the host end of a UNIX socket whose
//! other end is a serial port inside a QEMU guest.

use super::pty::{OnPulses, PtyController, PtyError};
use super::{ControllerConfig, ServeEnd, SimController, serve};
use hydroline_core::clock::SystemClock;
use std::io;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Where the controller is to be reached.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ServeAt {
    /// Connects to a socket that another program listens on (`-chardev socket,path=...,server=on,wait=off`), and
    /// again whenever the connection ends: for QEMU's usb-serial that is an unplug and a replug.
    Connect(PathBuf),
    /// Listens on a socket, one connection after the other; a stale socket file is replaced.
    Listen(PathBuf),
    /// Opens a pseudo-terminal; with a path, that becomes a link to it.
    Pty(Option<PathBuf>),
}

/// Why the controller ended early.
#[derive(Debug, thiserror::Error)]
pub enum StandaloneError {
    /// No pseudo-terminal.
    #[error(transparent)]
    Pty(#[from] PtyError),
    /// The socket failed.
    #[error("socket {path}: {error}")]
    Socket {
        /// Path.
        path: PathBuf,
        /// The system's words.
        error: io::Error,
    },
}

const RETRY: Duration = Duration::from_millis(50);

/// Serves until `stop` is set. `on_ready` is called with the path once it can be opened (pty, listening socket) or is connected.
///
/// # Errors
/// [`StandaloneError`]; a socket that is not there yet is waited for.
pub fn run_standalone(
    config: ControllerConfig,
    at: &ServeAt,
    stop: &AtomicBool,
    on_ready: &mut dyn FnMut(&Path),
    mut on_pulses: OnPulses,
) -> Result<(), StandaloneError> {
    let controller = SimController::new(config);
    match at {
        ServeAt::Pty(link) => {
            let pty = PtyController::start(controller, link.clone(), on_pulses)?;
            if let Some(path) = pty.path() {
                on_ready(path);
            }
            while !stop.load(Ordering::Relaxed) {
                std::thread::sleep(RETRY);
            }
            Ok(())
        }
        ServeAt::Connect(path) => {
            let controller = Mutex::new(controller);
            while !stop.load(Ordering::Relaxed) {
                match UnixStream::connect(path) {
                    Ok(mut stream) => {
                        on_ready(path);
                        session(&controller, &mut stream, stop, &mut on_pulses, path)?;
                    }
                    Err(e)
                        if matches!(
                            e.kind(),
                            io::ErrorKind::NotFound | io::ErrorKind::ConnectionRefused
                        ) => {}
                    Err(error) => {
                        return Err(StandaloneError::Socket {
                            path: path.clone(),
                            error,
                        });
                    }
                }
                std::thread::sleep(RETRY);
            }
            Ok(())
        }
        ServeAt::Listen(path) => {
            let fail = |error| StandaloneError::Socket {
                path: path.clone(),
                error,
            };
            match std::fs::remove_file(path) {
                Err(e) if e.kind() != io::ErrorKind::NotFound => return Err(fail(e)),
                _ => {}
            }
            let listener = UnixListener::bind(path).map_err(fail)?;
            listener.set_nonblocking(true).map_err(fail)?;
            on_ready(path);
            let controller = Mutex::new(controller);
            while !stop.load(Ordering::Relaxed) {
                match listener.accept() {
                    Ok((mut stream, _)) => {
                        session(&controller, &mut stream, stop, &mut on_pulses, path)?
                    }
                    Err(e) if e.kind() == io::ErrorKind::WouldBlock => std::thread::sleep(RETRY),
                    Err(error) => return Err(fail(error)),
                }
            }
            let _ = std::fs::remove_file(path);
            Ok(())
        }
    }
}

fn session(
    controller: &Mutex<SimController>,
    stream: &mut UnixStream,
    stop: &AtomicBool,
    on_pulses: &mut OnPulses,
    path: &Path,
) -> Result<(), StandaloneError> {
    let end = serve(controller, stream, &SystemClock, stop, &mut |e| {
        on_pulses(e)
    })
    .map_err(|error| StandaloneError::Socket {
        path: path.to_path_buf(),
        error,
    })?;
    if end == ServeEnd::Closed {
        controller
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner)
            .cable_pulled();
    }
    Ok(())
}
