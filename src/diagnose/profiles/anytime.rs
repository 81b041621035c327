//! Progress and limit of the searches over frames, and whether the limit has ended one of them.

use std::sync::atomic::{AtomicBool, Ordering};

use hydroline_inference::limit::{Cause, Watch};

/// A watch that remembers whether a step was left out for its limit.
pub struct Anytime<'a> {
    watch: Watch<'a>,
    is_cut: AtomicBool,
}

impl<'a> Anytime<'a> {
    pub fn new(watch: Watch<'a>) -> Anytime<'a> {
        Anytime {
            watch,
            is_cut: AtomicBool::new(false),
        }
    }

    /// Says what begins.
    pub fn tell(&self, what: &str) {
        self.watch.tell(what);
    }

    /// Whether the limit is over; the step before which that is asked is left out then.
    pub fn is_over(&self) -> bool {
        let is_over = self.watch.limit.is_over();
        if is_over {
            self.is_cut.store(true, Ordering::Relaxed);
        }
        is_over
    }

    /// Reason why a step was left out; `None` = none was.
    pub fn cut(&self) -> Option<Cause> {
        let is_cut = self.is_cut.load(Ordering::Relaxed);
        is_cut.then(|| self.watch.limit.cause()).flatten()
    }
}
