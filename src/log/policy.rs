//! When to close a chunk, when to make it durable, when to start a new file, when to stop.
//!
//! Pure decisions on injected times (`now_ns`: any clock that does not go back) and sizes.
//! A chunk that is open when the process dies is lost whole, so its size and age bound the loss.

use hydroline_rigs::LogSettings;

/// Part of the command flush time after which the chunk is closed.
const CLOSE_SHARE: f64 = 0.5;

/// Limits of the policy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// A chunk is closed before it would grow beyond this \[bytes, uncompressed\].
    pub chunk_bytes: u64,
    /// Oldest open chunk \[ns\].
    pub chunk_age_ns: u64,
    /// Longest wait of a command or event in an open chunk before it is closed \[ns\]; `None` = no such hurry (offline).
    pub command_flush_ns: Option<u64>,
    /// Interval between syncs \[ns\]; `None` = only at the end (offline).
    pub sync_ns: Option<u64>,
    /// New file beyond this size \[bytes\]; 0 = never.
    pub rotate_bytes: u64,
    /// Clean stop when the disk has less than this left \[bytes\].
    pub min_free_bytes: u64,
}

impl Limits {
    /// For a live recording, from the rig's `[log]`.
    pub fn live(settings: &LogSettings) -> Self {
        let ns = |s: f64| (s.max(0.0) * 1e9) as u64;
        // `command_flush_s` is when a command is to be in the file; compressing and writing the
        // chunk that holds it takes its share of that.
        Self {
            chunk_bytes: settings.chunk_bytes,
            chunk_age_ns: ns(settings.chunk_age_s),
            command_flush_ns: Some(ns(settings.command_flush_s * CLOSE_SHARE)),
            sync_ns: Some(ns(settings.sync_s)),
            rotate_bytes: settings.rotate_bytes,
            min_free_bytes: settings.min_free_bytes,
        }
    }

    /// For `simulate` and `replay`: nothing can be lost but the file, so chunks close by size and
    /// by the log's own time only, which makes the bytes a function of the input.
    pub fn offline() -> Self {
        Self {
            chunk_bytes: 1 << 20,
            chunk_age_ns: 1_000_000_000,
            command_flush_ns: None,
            sync_ns: None,
            rotate_bytes: 0,
            min_free_bytes: 0,
        }
    }
}

impl Default for Limits {
    /// The defaults: 1 MiB, 1 s, commands on file within 40 ms, 2 s, no rotation, 256 MiB kept free.
    fn default() -> Self {
        Self {
            command_flush_ns: Some((40e6 * CLOSE_SHARE) as u64),
            sync_ns: Some(2_000_000_000),
            min_free_bytes: 256 << 20,
            ..Self::offline()
        }
    }
}

/// Actions that are due now.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Due {
    /// Close the open chunk.
    pub close: bool,
    /// Call fdatasync.
    pub sync: bool,
}

/// The policy's memory.
#[derive(Debug, Clone, Default)]
pub struct Policy {
    limits: Limits,
    open_bytes: u64,
    opened_ns: Option<u64>,
    urgent_ns: Option<u64>,
    unsynced_ns: Option<u64>,
}

impl Policy {
    /// Nothing open, nothing unsynced.
    pub fn new(limits: Limits) -> Self {
        Self {
            limits,
            ..Self::default()
        }
    }

    /// The limits.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// Bytes in the open chunk, uncompressed.
    pub fn open_bytes(&self) -> u64 {
        self.open_bytes
    }

    /// Whether the open chunk must be closed before `bytes` more go into it.
    pub fn must_close_before(&self, bytes: u64) -> bool {
        self.open_bytes > 0 && self.open_bytes.saturating_add(bytes) > self.limits.chunk_bytes
    }

    /// `bytes` went into the open chunk.
    pub fn added(&mut self, now_ns: u64, bytes: u64, urgent: bool) {
        self.open_bytes += bytes;
        self.opened_ns.get_or_insert(now_ns);
        if urgent {
            self.urgent_ns.get_or_insert(now_ns);
        }
    }

    /// The open chunk was closed and handed to the file system.
    pub fn closed(&mut self, now_ns: u64) {
        self.open_bytes = 0;
        self.urgent_ns = None;
        // The wait for the sync counts from the chunk's first byte, not from its closing.
        let since = self.opened_ns.take().unwrap_or(now_ns);
        self.unsynced_ns.get_or_insert(since);
    }

    /// Everything handed over is durable.
    pub fn synced(&mut self) {
        self.unsynced_ns = None;
    }

    /// When something is next due, if anything is: the earliest of chunk age, command flush and
    /// sync. Open data counts for the sync from its first byte: it must be durable `sync_ns` later.
    pub fn next_deadline_ns(&self) -> Option<u64> {
        [self.close_deadline(), self.sync_deadline()]
            .into_iter()
            .flatten()
            .min()
    }

    /// Actions due at `now_ns`. A sync takes the open chunk with it.
    pub fn due(&self, now_ns: u64) -> Due {
        let reached = |deadline: Option<u64>| deadline.is_some_and(|d| now_ns >= d);
        let sync = reached(self.sync_deadline());
        Due {
            close: self.open_bytes > 0 && (sync || reached(self.close_deadline())),
            sync,
        }
    }

    fn close_deadline(&self) -> Option<u64> {
        let age = self
            .opened_ns
            .map(|t| t.saturating_add(self.limits.chunk_age_ns));
        let urgent = match (self.urgent_ns, self.limits.command_flush_ns) {
            (Some(t), Some(wait)) => Some(t.saturating_add(wait)),
            _ => None,
        };
        [age, urgent].into_iter().flatten().min()
    }

    fn sync_deadline(&self) -> Option<u64> {
        let since = [self.unsynced_ns, self.opened_ns]
            .into_iter()
            .flatten()
            .min()?;
        Some(since.saturating_add(self.limits.sync_ns?))
    }

    /// Whether a file of this size is to be followed by a new one.
    pub fn must_rotate(&self, file_bytes: u64) -> bool {
        self.limits.rotate_bytes > 0 && file_bytes >= self.limits.rotate_bytes
    }

    /// Whether the disk is too full to go on.
    pub fn must_stop(&self, free_bytes: Option<u64>) -> bool {
        free_bytes.is_some_and(|free| free < self.limits.min_free_bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Driven as the writer drives it, with arbitrary arrivals: no chunk over the limit unless
        /// one message is, none older than allowed, no command waiting longer, no byte unsynced
        /// longer than the sync interval.
        #[test]
        fn bounds_hold(arrivals in proptest::collection::vec((0u64..400_000_000, 1u64..700_000, any::<bool>()), 1..200)) {
            let limits = Limits::default();
            let mut p = Policy::new(limits);
            let (mut now, mut chunk) = (1u64, Vec::<(u64, u64, bool)>::new());
            let mut unsynced: Option<u64> = None;
            for (wait, bytes, urgent) in arrivals {
                let arrival = now + wait;
                // The writer sleeps until the next deadline or the arrival, whichever is first.
                while let Some(deadline) = p.next_deadline_ns().filter(|d| *d <= arrival) {
                    now = now.max(deadline);
                    let due = p.due(now);
                    prop_assert!(due.close || due.sync, "a deadline with nothing due would spin");
                    if due.close {
                        check(&limits, now, &chunk)?;
                        chunk.clear();
                        p.closed(now);
                    }
                    if due.sync {
                        prop_assert!(now - unsynced.unwrap_or(now) <= limits.sync_ns.unwrap());
                        unsynced = None;
                        p.synced();
                    }
                }
                now = arrival;
                if p.must_close_before(bytes) {
                    check(&limits, now, &chunk)?;
                    chunk.clear();
                    p.closed(now);
                }
                p.added(now, bytes, urgent);
                unsynced.get_or_insert(now);
                chunk.push((now, bytes, urgent));
                let total: u64 = chunk.iter().map(|c| c.1).sum();
                prop_assert!(total <= limits.chunk_bytes || chunk.len() == 1);
                prop_assert_eq!(total, p.open_bytes());
            }
        }
    }

    fn check(limits: &Limits, now: u64, chunk: &[(u64, u64, bool)]) -> Result<(), TestCaseError> {
        if let Some(first) = chunk.first() {
            prop_assert!(now - first.0 <= limits.chunk_age_ns);
        }
        if let Some(urgent) = chunk.iter().find(|c| c.2) {
            prop_assert!(now - urgent.0 <= limits.command_flush_ns.unwrap());
        }
        Ok(())
    }

    #[test]
    fn rotation_and_free_space() {
        let p = Policy::new(Limits {
            rotate_bytes: 100,
            min_free_bytes: 10,
            ..Limits::default()
        });
        assert!(!p.must_rotate(99) && p.must_rotate(100));
        assert!(p.must_stop(Some(9)) && !p.must_stop(Some(10)) && !p.must_stop(None));
        assert!(!Policy::new(Limits::offline()).must_rotate(u64::MAX));
    }
}
