//! A serial port (or pseudo-terminal) through the `serialport` crate.

use super::{LineModel, OpenError, Sent, Transport, Wire};
use crate::lowlatency::{self, LowLatency};
use hydroline_core::clock::Clock;
use serialport::{ClearBuffer, SerialPort, TTYPort};
use std::io::{self, Read, Write};
use std::os::fd::AsRawFd;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Most bytes per write: serialport's timeout covers the poll, not a large write, which can block beyond it.
const MAX_WRITE: usize = 255;

/// An open serial port.
pub struct SerialTransport {
    port: TTYPort,
    path: PathBuf,
    clock: Arc<dyn Clock>,
    line: LineModel,
    wire: Wire,
    low_latency: LowLatency,
}

impl SerialTransport {
    /// Opens `path` exclusively at `baud`, 8N1, raw, in low-latency mode where the driver has one, buffers emptied.
    ///
    /// # Errors
    /// [`OpenError`], each with what to do about it.
    pub fn open(path: &Path, baud: u32, clock: Arc<dyn Clock>) -> Result<Self, OpenError> {
        // The node behind a stable link says what it is: ttyACM is USB up to the microcontroller, without a UART.
        let node = path.canonicalize().unwrap_or_else(|_| path.to_path_buf());
        let packet = node
            .file_name()
            .is_some_and(|n| n.to_string_lossy().starts_with("ttyACM"));
        let wire = if packet {
            Wire::Packet
        } else {
            Wire::Uart { baud }
        };
        let builder =
            serialport::new(path.to_string_lossy(), baud).timeout(Duration::from_millis(5));
        let port = TTYPort::open(&builder).map_err(|error| Self::explain(path, &error))?;
        // Bytes that arrived before we opened belong to nobody's request.
        port.clear(ClearBuffer::All).map_err(|e| OpenError::Other {
            path: path.to_path_buf(),
            reason: e.to_string(),
        })?;
        let low_latency = lowlatency::enable(port.as_raw_fd(), &node);
        Ok(Self {
            port,
            path: path.to_path_buf(),
            clock,
            line: LineModel::new(wire),
            wire,
            low_latency,
        })
    }

    /// Path as opened.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Result of asking for low-latency mode.
    pub fn low_latency(&self) -> &LowLatency {
        &self.low_latency
    }

    fn explain(path: &Path, error: &serialport::Error) -> OpenError {
        use serialport::ErrorKind as K;
        match error.kind {
            K::NoDevice if path.exists() => OpenError::Busy {
                path: path.to_path_buf(),
            },
            K::Io(io::ErrorKind::NotFound) | K::NoDevice => OpenError::NotFound {
                wanted: path.display().to_string(),
                hint: "plugged in? `hydroline devices` lists what is there".into(),
            },
            K::Io(io::ErrorKind::PermissionDenied) => OpenError::Permission(
                crate::ports::permission_problem(path).unwrap_or_else(|| error.to_string()),
            ),
            _ => OpenError::Other {
                path: path.to_path_buf(),
                reason: error.to_string(),
            },
        }
    }
}

impl Transport for SerialTransport {
    fn now_ns(&self) -> u64 {
        self.clock.monotonic_ns()
    }

    fn write(&mut self, bytes: &[u8], timeout: Duration) -> io::Result<Sent> {
        if let (Wire::Uart { .. }, Some(waiting)) = (self.wire, self.unsent_bytes())
            && waiting > 0
        {
            // The kernel still holds bytes the model thought gone: the line is at least that busy.
            let now_ns = self.now_ns();
            self.line.busy_until(now_ns + self.wire.time_ns(waiting));
        }
        let started_ns = self.now_ns();
        let until = Instant::now() + timeout;
        let mut rest = bytes;
        while !rest.is_empty() {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Err(io::Error::new(
                    io::ErrorKind::TimedOut,
                    format!(
                        "{} of {} bytes not taken within {timeout:?}",
                        rest.len(),
                        bytes.len()
                    ),
                ));
            }
            self.port.set_timeout(left).map_err(io::Error::from)?;
            match self.port.write(&rest[..rest.len().min(MAX_WRITE)]) {
                Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
                Ok(n) => rest = &rest[n..],
                // serialport's ppoll runs with an empty signal mask: a signal is no reason to lose the line.
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) => return Err(e),
            }
        }
        let last_byte_out_ns = match self.wire {
            Wire::Uart { .. } => self.line.push(started_ns, bytes.len()),
            Wire::Packet => self.now_ns(),
        };
        Ok(Sent {
            last_byte_out_ns,
            bytes: bytes.len(),
        })
    }

    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        self.port.set_timeout(timeout).map_err(io::Error::from)?;
        match self.port.read(buffer) {
            Ok(0) => Err(io::Error::new(
                io::ErrorKind::BrokenPipe,
                "end of file: the device is gone",
            )),
            Ok(n) => Ok(n),
            Err(e)
                if matches!(
                    e.kind(),
                    io::ErrorKind::TimedOut | io::ErrorKind::Interrupted
                ) =>
            {
                Ok(0)
            }
            Err(e) => Err(e),
        }
    }

    fn unsent_bytes(&mut self) -> Option<usize> {
        let mut count: libc::c_int = 0;
        // SAFETY: TIOCOUTQ writes one int; the descriptor is open as long as `self.port` lives.
        let done = unsafe { libc::ioctl(self.port.as_raw_fd(), libc::TIOCOUTQ as _, &mut count) };
        (done == 0).then(|| usize::try_from(count).unwrap_or(0))
    }
}
