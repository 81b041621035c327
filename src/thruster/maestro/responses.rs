//! The host's side: bytes to answers.

use super::ERROR_NAMES;
use std::collections::VecDeque;

/// An answer the host waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Request {
    /// Position of a channel; the smallest and largest believable answer \[quarter us\].
    Position {
        /// Number of the channel.
        channel: u8,
        /// Smallest believable position.
        min: u16,
        /// Largest believable position.
        max: u16,
    },
    /// The error register.
    Errors,
}

/// Event in the controller's answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Response {
    /// The answer to the oldest open request.
    Answer {
        /// The request.
        request: Request,
        /// Position \[quarter us\] or error bits.
        value: u16,
    },
    /// Answers were lost or shifted: all open requests are void; bytes are ignored until the line is quiet.
    Resync {
        /// Requests given up.
        lost: usize,
        /// Reason for it.
        reason: ResyncReason,
    },
}

/// Reason why the decoder discarded its state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ResyncReason {
    /// The oldest request was not answered in time.
    Timeout,
    /// A byte came although nothing was asked.
    Surplus,
    /// An answer outside the believable range.
    Implausible,
}

/// Decoder of the controller's answers, fed byte by byte.
#[derive(Debug)]
pub struct Responses {
    open: VecDeque<(Request, u64)>,
    low: Option<u8>,
    timeout_ns: u64,
    quiet_ns: u64,
    /// Ignore bytes until the line was silent up to this time.
    deaf_until_ns: Option<u64>,
}

impl Responses {
    /// `timeout_ns` for one answer; `quiet_ns` of silence end a resync.
    pub fn new(timeout_ns: u64, quiet_ns: u64) -> Self {
        Self {
            open: VecDeque::new(),
            low: None,
            timeout_ns,
            quiet_ns,
            deaf_until_ns: None,
        }
    }

    /// A request has been put on the wire; its answer is expected after those before it.
    pub fn expect(&mut self, request: Request, sent_ns: u64) {
        self.open.push_back((request, sent_ns));
    }

    /// Open requests.
    pub fn open(&self) -> usize {
        self.open.len()
    }

    /// Whether bytes are being ignored until the line is quiet: requests made now would lose their answers.
    pub fn resyncing(&self, now_ns: u64) -> bool {
        self.deaf_until_ns.is_some_and(|until| now_ns < until)
    }

    /// Takes one received byte.
    pub fn feed(&mut self, byte: u8, at_ns: u64) -> Option<Response> {
        if let Some(until) = self.deaf_until_ns {
            if at_ns < until {
                self.deaf_until_ns = Some(at_ns.saturating_add(self.quiet_ns));
                return None;
            }
            self.deaf_until_ns = None;
        }
        let Some(&(request, _)) = self.open.front() else {
            return Some(self.resync(at_ns, ResyncReason::Surplus));
        };
        let Some(low) = self.low.take() else {
            self.low = Some(byte);
            return None;
        };
        let value = u16::from_le_bytes([low, byte]);
        let believable = match request {
            Request::Position { min, max, .. } => (min..=max).contains(&value),
            Request::Errors => value >> ERROR_NAMES.len() == 0,
        };
        if !believable {
            return Some(self.resync(at_ns, ResyncReason::Implausible));
        }
        self.open.pop_front();
        Some(Response::Answer { request, value })
    }

    /// Lets time pass without bytes.
    pub fn tick(&mut self, now_ns: u64) -> Option<Response> {
        let &(_, sent_ns) = self.open.front()?;
        (now_ns > sent_ns.saturating_add(self.timeout_ns))
            .then(|| self.resync(now_ns, ResyncReason::Timeout))
    }

    /// Forgets everything, as after opening the port.
    pub fn reset(&mut self) {
        self.open.clear();
        self.low = None;
        self.deaf_until_ns = None;
    }

    fn resync(&mut self, now_ns: u64, reason: ResyncReason) -> Response {
        let lost = self.open.len();
        self.open.clear();
        self.low = None;
        self.deaf_until_ns = Some(now_ns.saturating_add(self.quiet_ns));
        Response::Resync { lost, reason }
    }
}
