//! Whether a thread still goes round: a counter that it raises in each turn and that others look at.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// A thread's turns. Clones share the counter.
#[derive(Debug, Clone, Default)]
pub struct Heartbeat(Arc<AtomicU64>);

impl Heartbeat {
    /// One more turn.
    pub fn beat(&self) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }

    /// Turns so far.
    pub fn turns(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

/// Whether all of several threads have gone on since they were last asked.
#[derive(Debug)]
pub struct Liveness {
    watched: Vec<(&'static str, Heartbeat, u64)>,
}

impl Liveness {
    /// Watches these threads.
    pub fn of(threads: impl IntoIterator<Item = (&'static str, Heartbeat)>) -> Self {
        let watched = threads.into_iter().map(|(name, beat)| (name, beat, 0));
        Self {
            watched: watched.collect(),
        }
    }

    /// The threads that stand still since the last call that found all of them going; empty = all have gone on. Those
    /// that went on while another stood need not do so again: only together do they count.
    pub fn standing(&mut self) -> Vec<&'static str> {
        let turns: Vec<u64> = self.watched.iter().map(|(_, b, _)| b.turns()).collect();
        let standing: Vec<&'static str> = self
            .watched
            .iter()
            .zip(&turns)
            .filter(|((.., last), turns)| last == *turns)
            .map(|((name, ..), _)| *name)
            .collect();
        if standing.is_empty() {
            for ((.., last), turns) in self.watched.iter_mut().zip(turns) {
                *last = turns;
            }
        }
        standing
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_thread_that_stands_is_named_until_it_goes_on() {
        let (capture, writer) = (Heartbeat::default(), Heartbeat::default());
        let threads = [("capture", capture.clone()), ("log writer", writer.clone())];
        let mut liveness = Liveness::of(threads);
        assert_eq!(liveness.standing(), ["capture", "log writer"]);
        capture.beat();
        assert_eq!(liveness.standing(), ["log writer"]);
        writer.beat();
        assert!(liveness.standing().is_empty());
        assert_eq!(liveness.standing(), ["capture", "log writer"]);
        writer.beat();
        capture.beat();
        assert!(liveness.standing().is_empty());
    }
}
