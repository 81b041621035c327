//! Bytes in and out, with an honest answer to "when did the last byte leave the host?".

#[cfg(not(feature = "serial"))]
mod no_serial;
mod open_error;
#[cfg(feature = "serial")]
mod serial;
mod udp;

#[cfg(not(feature = "serial"))]
pub use no_serial::SerialTransport;
pub use open_error::OpenError;
#[cfg(feature = "serial")]
pub use serial::SerialTransport;
pub use udp::UdpTransport;

use std::io;
use std::time::Duration;

/// Kind of line, by which the time of the last byte is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wire {
    /// A real UART line: bytes leave one after the other, 10 bits each (start, 8 data, stop).
    Uart {
        /// \[bit/s\]
        baud: u32,
    },
    /// Native USB (ttyACM) or a socket: the baud rate means nothing, a write leaves as a whole.
    Packet,
}

impl Wire {
    /// Time on the wire for `bytes` \[ns\].
    pub fn time_ns(self, bytes: usize) -> u64 {
        match self {
            Wire::Uart { baud } => bytes as u64 * 10 * 1_000_000_000 / u64::from(baud.max(1)),
            Wire::Packet => 0,
        }
    }
}

/// A write that was taken by the kernel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sent {
    /// When the last byte leaves (or left) the host \[ns\]; for a UART up to one write's wire time in the future.
    pub last_byte_out_ns: u64,
    /// Number of bytes.
    pub bytes: usize,
}

/// The line's transmitter as a clockwork: the earliest time each byte can be out.
///
/// tcdrain (`flush`) would say when the queue is empty, but it blocks without bound on a stuck line, and on USB adapters
/// it does not include the adapter's own buffer. A UART is perfectly regular: the last byte is out
/// `10 bits * n / baud` after the first started, and the first starts when it is written or when the line
/// is free, whichever is later. That the queue really emptied is checked afterwards by TIOCOUTQ.
#[derive(Debug, Clone, Copy)]
pub struct LineModel {
    wire: Wire,
    free_ns: u64,
}

impl LineModel {
    /// An idle line.
    pub fn new(wire: Wire) -> Self {
        Self { wire, free_ns: 0 }
    }

    /// `bytes` handed over at `now_ns`: when the last one is out \[ns\].
    pub fn push(&mut self, now_ns: u64, bytes: usize) -> u64 {
        self.free_ns = self.free_ns.max(now_ns) + self.wire.time_ns(bytes);
        self.free_ns
    }

    /// The line is known to be busy until then.
    pub fn busy_until(&mut self, ns: u64) {
        self.free_ns = self.free_ns.max(ns);
    }
}

/// A byte line with its clock.
pub trait Transport: Send {
    /// CLOCK_MONOTONIC of this line's host \[ns\].
    fn now_ns(&self) -> u64;
    /// Hands all bytes (fewer than 256) to the kernel within `timeout`.
    ///
    /// # Errors
    /// `TimedOut` on a stuck line, `BrokenPipe`, `NotFound` or another kind when it is gone.
    fn write(&mut self, bytes: &[u8], timeout: Duration) -> io::Result<Sent>;
    /// Waits up to `timeout` for bytes; 0 = none came.
    ///
    /// # Errors
    /// `BrokenPipe` at end of file, another kind when the line is gone.
    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize>;
    /// Bytes the kernel still holds; `None` where it cannot say.
    fn unsent_bytes(&mut self) -> Option<usize>;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_sends_one_byte_after_the_other() {
        let mut line = LineModel::new(Wire::Uart { baud: 10_000 });
        assert_eq!(line.push(0, 5), 5_000_000);
        // Written while the first is still going out: queues behind it.
        assert_eq!(line.push(1_000_000, 5), 10_000_000);
        assert_eq!(line.push(50_000_000, 1), 51_000_000);
        assert_eq!(LineModel::new(Wire::Packet).push(7, 100), 7);
    }
}
