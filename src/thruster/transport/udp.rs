//! A UDP port as a line: datagrams in from whoever sends, answers to who sent last.

use super::{OpenError, Sent, Transport};
use hydroline_core::clock::Clock;
use std::collections::VecDeque;
use std::io::{self, ErrorKind};
use std::net::{SocketAddr, UdpSocket};
use std::sync::Arc;
use std::time::Duration;

/// Shortest time-out that a socket takes.
const SHORTEST: Duration = Duration::from_micros(1);

/// A bound UDP port.
pub struct UdpTransport {
    socket: UdpSocket,
    clock: Arc<dyn Clock>,
    peer: Option<SocketAddr>,
    /// Rest of a datagram that was longer than the reader's buffer.
    rest: VecDeque<u8>,
}

impl UdpTransport {
    /// Binds `address`.
    ///
    /// # Errors
    /// [`OpenError`] with the reason: taken by another program, no address of this computer.
    pub fn open(address: SocketAddr, clock: Arc<dyn Clock>) -> Result<Self, OpenError> {
        let name = format!("udp:{address}");
        let socket = UdpSocket::bind(address).map_err(|error| match error.kind() {
            ErrorKind::AddrInUse => OpenError::Busy { path: name.into() },
            _ => OpenError::Other {
                path: name.into(),
                reason: error.to_string(),
            },
        })?;
        Ok(Self {
            socket,
            clock,
            peer: None,
            rest: VecDeque::new(),
        })
    }

    /// Address that it is bound to.
    ///
    /// # Errors
    /// That of the socket.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }
}

impl Transport for UdpTransport {
    fn now_ns(&self) -> u64 {
        self.clock.monotonic_ns()
    }

    /// Nothing is sent before somebody has been heard: there is no address yet.
    fn write(&mut self, bytes: &[u8], _: Duration) -> io::Result<Sent> {
        if let Some(peer) = self.peer {
            match self.socket.send_to(bytes, peer) {
                // Nobody listens there at the moment: silence is noticed elsewhere.
                Err(e) if e.kind() == ErrorKind::ConnectionRefused => {}
                sent => drop(sent?),
            }
        }
        Ok(Sent {
            last_byte_out_ns: self.now_ns(),
            bytes: bytes.len(),
        })
    }

    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        if self.rest.is_empty() {
            self.socket.set_read_timeout(Some(timeout.max(SHORTEST)))?;
            let mut datagram = [0u8; 2048];
            match self.socket.recv_from(&mut datagram) {
                Ok((got, peer)) => {
                    self.peer = Some(peer);
                    self.rest.extend(&datagram[..got]);
                }
                Err(e) => match e.kind() {
                    ErrorKind::WouldBlock
                    | ErrorKind::TimedOut
                    | ErrorKind::Interrupted
                    | ErrorKind::ConnectionRefused => {}
                    _ => return Err(e),
                },
            }
        }
        let got = buffer.len().min(self.rest.len());
        for (to, from) in buffer.iter_mut().zip(self.rest.drain(..got)) {
            *to = from;
        }
        Ok(got)
    }

    fn unsent_bytes(&mut self) -> Option<usize> {
        None
    }
}
