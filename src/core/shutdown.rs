//! One shutdown signal for everything that runs: raised once, with a reason, seen by all.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Why a run ends.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum StopReason {
    /// The plan or the requested time is over.
    Finished,
    /// Ctrl-C, SIGTERM or the q key.
    Asked(&'static str),
    /// A limit of the rig was passed: thrusters went to neutral first.
    Limit(String),
    /// The time is over, but the plan did not come to its end: the words say why.
    PlanAborted(String),
    /// The requested time is over before the plan is: the words say where it was.
    PlanCut(String),
    /// The log can take no more (disk full or failed): the file is closed and readable.
    LogStopped(String),
    /// The source has no more frames (a log that was played).
    SourceEnded,
    /// Something failed; the words say what.
    Failed(String),
}

impl std::fmt::Display for StopReason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            StopReason::Finished => f.write_str("finished as planned"),
            StopReason::Asked(by) => write!(f, "stopped by {by}"),
            StopReason::Limit(what) => write!(f, "aborted to neutral: {what}"),
            StopReason::PlanAborted(why) | StopReason::PlanCut(why) => f.write_str(why),
            StopReason::LogStopped(why) => write!(f, "the log stopped: {why}"),
            StopReason::SourceEnded => f.write_str("the source ended"),
            StopReason::Failed(what) => write!(f, "failed: {what}"),
        }
    }
}

/// A shutdown that any part may raise and every part may watch. The first reason counts.
#[derive(Debug, Clone, Default)]
pub struct Shutdown {
    inner: Arc<Inner>,
}

#[derive(Debug, Default)]
struct Inner {
    reason: Mutex<Option<StopReason>>,
    raised: std::sync::Condvar,
}

impl Shutdown {
    /// A shutdown that nobody has raised yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Raises it; later calls change nothing.
    pub fn raise(&self, reason: StopReason) {
        let mut slot = self
            .inner
            .reason
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        if slot.is_none() {
            *slot = Some(reason);
        }
        drop(slot);
        self.inner.raised.notify_all();
    }

    /// The reason, once raised.
    pub fn reason(&self) -> Option<StopReason> {
        self.inner
            .reason
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }

    /// Whether it was raised.
    pub fn is_raised(&self) -> bool {
        self.reason().is_some()
    }

    /// Waits up to `wait`; true when raised.
    pub fn wait(&self, wait: Duration) -> bool {
        let slot = self
            .inner
            .reason
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let (slot, _) = self
            .inner
            .raised
            .wait_timeout_while(slot, wait, |r| r.is_none())
            .unwrap_or_else(PoisonError::into_inner);
        slot.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_reason_counts_and_wakes_everybody() {
        let shutdown = Shutdown::new();
        let waiter = {
            let shutdown = shutdown.clone();
            std::thread::spawn(move || shutdown.wait(Duration::from_secs(30)))
        };
        shutdown.raise(StopReason::Asked("SIGTERM"));
        shutdown.raise(StopReason::Finished);
        assert!(waiter.join().unwrap());
        assert_eq!(shutdown.reason(), Some(StopReason::Asked("SIGTERM")));
    }
}
