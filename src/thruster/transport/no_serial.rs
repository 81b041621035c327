//! Serial ports of a build without them: none opens.

use super::{OpenError, Sent, Transport};
use crate::lowlatency::LowLatency;
use hydroline_core::clock::Clock;
use std::io;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// A serial port, of which this build has none.
pub enum SerialTransport {}

impl SerialTransport {
    /// Refuses.
    ///
    /// # Errors
    /// [`OpenError::Other`], always: it names the feature.
    pub fn open(path: &Path, _baud: u32, _clock: Arc<dyn Clock>) -> Result<Self, OpenError> {
        Err(OpenError::Other {
            path: path.to_path_buf(),
            reason: "this program was built without serial ports; build it with the Cargo feature `acquisition`"
                .to_owned(),
        })
    }

    /// Path as opened.
    pub fn path(&self) -> &Path {
        match *self {}
    }

    /// Result of asking for low-latency mode.
    pub fn low_latency(&self) -> &LowLatency {
        match *self {}
    }
}

impl Transport for SerialTransport {
    fn now_ns(&self) -> u64 {
        match *self {}
    }

    fn write(&mut self, _bytes: &[u8], _timeout: Duration) -> io::Result<Sent> {
        match *self {}
    }

    fn read(&mut self, _buffer: &mut [u8], _timeout: Duration) -> io::Result<usize> {
        match *self {}
    }

    fn unsent_bytes(&mut self) -> Option<usize> {
        match *self {}
    }
}
