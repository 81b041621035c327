//! The one queue between everything that happens and the log writer.
//!
//! Bounded in bytes. Frames and what `replay` computes again from them (profiles, annotations) may
//! be dropped, newest first: what does not fit on arrival is counted and forgotten, so what is
//! queued already stays contiguous. Everything else is admitted beyond the bound: it is small, and
//! nothing brings it back. Order is first in, first out. The core has no locks and no clock.

use hydroline_core::lock::Lock;
use std::collections::{BTreeMap, VecDeque};
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;

use super::entry::Entry;
use super::topic::Topic;

/// An entry with the log time it was given on arrival.
#[derive(Debug, Clone, PartialEq)]
pub struct Queued {
    /// UNIX \[ns\], never decreasing along the queue.
    pub log_ns: u64,
    /// Entry to be written.
    pub entry: Entry,
}

/// Outcome of a push.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Admission {
    /// The entry was queued.
    Queued,
    /// Queued; before it, `dropped` frames in a row had been dropped.
    QueuedAfterDrops {
        /// Frames dropped since the last one that fitted.
        dropped: u64,
    },
    /// A frame that did not fit. `first` = the one before it had fitted.
    Dropped {
        /// Start of an episode.
        first: bool,
    },
    /// A derived message that did not fit; `replay` computes it again.
    DroppedDerived,
    /// The queue is closed: the recording has ended.
    Closed,
}

/// The queue without locks.
#[derive(Debug, Default)]
pub struct QueueCore {
    entries: VecDeque<Queued>,
    used_bytes: u64,
    bound_bytes: u64,
    peak_bytes: u64,
    dropped_in_a_row: u64,
    dropped_frames: u64,
    dropped_derived: BTreeMap<Topic, u64>,
    closed: bool,
}

impl QueueCore {
    /// An empty queue that takes frames and derived messages up to `bound_bytes` in all.
    pub fn new(bound_bytes: u64) -> Self {
        Self {
            bound_bytes,
            ..Self::default()
        }
    }

    /// Takes or drops an entry.
    pub fn push(&mut self, item: Queued) -> Admission {
        if self.closed {
            return Admission::Closed;
        }
        let size = item.entry.size_bytes();
        let is_frame = item.entry.is_frame();
        let fits = self.used_bytes.saturating_add(size) <= self.bound_bytes;
        if let (Some(topic), false) = (item.entry.derived_topic(), fits) {
            *self.dropped_derived.entry(topic).or_default() += 1;
            return Admission::DroppedDerived;
        }
        if is_frame && !fits {
            self.dropped_frames += 1;
            self.dropped_in_a_row += 1;
            return Admission::Dropped {
                first: self.dropped_in_a_row == 1,
            };
        }
        self.used_bytes += size;
        self.peak_bytes = self.peak_bytes.max(self.used_bytes);
        self.entries.push_back(item);
        if is_frame && self.dropped_in_a_row > 0 {
            let dropped = std::mem::take(&mut self.dropped_in_a_row);
            return Admission::QueuedAfterDrops { dropped };
        }
        Admission::Queued
    }

    /// The oldest entry.
    pub fn pop(&mut self) -> Option<Queued> {
        let item = self.entries.pop_front()?;
        self.used_bytes -= item.entry.size_bytes();
        Some(item)
    }

    /// No more pushes and no more pops: nobody is left to write. Returns how many were given up.
    pub fn give_up(&mut self) -> u64 {
        self.closed = true;
        self.used_bytes = 0;
        let left = std::mem::take(&mut self.entries);
        left.len() as u64
    }

    /// No more pushes; what is queued can still be popped.
    pub fn close(&mut self) {
        self.closed = true;
    }

    /// Bytes queued now.
    pub fn used_bytes(&self) -> u64 {
        self.used_bytes
    }

    /// Most bytes ever queued.
    pub fn peak_bytes(&self) -> u64 {
        self.peak_bytes
    }

    /// Frames dropped so far.
    pub fn dropped_frames(&self) -> u64 {
        self.dropped_frames
    }

    /// Derived messages dropped so far, by topic.
    pub fn dropped_derived(&self) -> &BTreeMap<Topic, u64> {
        &self.dropped_derived
    }

    /// Entries queued now.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Nothing queued.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }
}

/// Result of a blocking pop.
#[derive(Debug, PartialEq)]
pub enum Popped {
    /// The oldest entry.
    Entry(Box<Queued>),
    /// Nothing came in time.
    Timeout,
    /// Closed and empty: there will never be another.
    End,
}

/// [`QueueCore`] behind a lock, with a state of the producers' own (`T`) under the same lock.
#[derive(Debug)]
pub struct Queue<T> {
    inner: Mutex<(QueueCore, T)>,
    arrived: Condvar,
}

impl<T> Queue<T> {
    /// An empty queue.
    pub fn new(bound_bytes: u64, state: T) -> Self {
        Self {
            inner: Mutex::new((QueueCore::new(bound_bytes), state)),
            arrived: Condvar::new(),
        }
    }

    /// Runs `f` under the lock and wakes the consumer. The lock is held by the consumer only while
    /// it takes one entry, never while it writes: a producer does not wait for the disk.
    pub fn with<R>(&self, f: impl FnOnce(&mut QueueCore, &mut T) -> R) -> R {
        let result = {
            let mut guard = self.inner.held();
            let (core, state) = &mut *guard;
            f(core, state)
        };
        self.arrived.notify_one();
        result
    }

    /// Waits up to `timeout` for the oldest entry.
    pub fn pop(&self, timeout: Duration) -> Popped {
        let guard = self.inner.held();
        let waiting = |inner: &mut (QueueCore, T)| inner.0.is_empty() && !inner.0.closed;
        let (mut guard, _) = self
            .arrived
            .wait_timeout_while(guard, timeout, waiting)
            .unwrap_or_else(PoisonError::into_inner);
        match guard.0.pop() {
            Some(item) => Popped::Entry(Box::new(item)),
            None if guard.0.closed => Popped::End,
            None => Popped::Timeout,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::messages::pb;
    use super::*;
    use crate::tests::fixtures::{command, grey_frame};
    use proptest::prelude::*;

    fn item(log_ns: u64, entry: Entry) -> Queued {
        Queued { log_ns, entry }
    }

    proptest! {
        /// Whatever arrives and leaves in whatever order: commands all come out, in order; frames
        /// and profiles come out or are counted; they never push the queue beyond its bound.
        #[test]
        fn nothing_is_lost_uncounted(steps in proptest::collection::vec(0u8..5, 1..300), bound in 0u64..20_000) {
            let mut q = QueueCore::new(bound);
            let (mut frames_in, mut out, mut commands_in) = (0u64, Vec::new(), 0u32);
            let (mut drops, mut episodes_closed) = (0u64, 0u64);
            let mut profiles_in = 0u64;
            for (n, step) in steps.iter().enumerate() {
                match step {
                    0 | 1 => {
                        frames_in += 1;
                        let before = q.used_bytes();
                        let frame = Entry::frame(&grey_frame(n as u32, 40, 30), frames_in);
                        let size = frame.size_bytes();
                        match q.push(item(n as u64, frame)) {
                            Admission::Dropped { .. } => {
                                prop_assert!(before + size > bound);
                                drops += 1;
                            }
                            Admission::QueuedAfterDrops { dropped } => episodes_closed += dropped,
                            _ => {}
                        }
                        prop_assert!(q.used_bytes() <= bound.max(before));
                    }
                    2 => {
                        commands_in += 1;
                        let admitted = q.push(item(n as u64, Entry::command(&command(commands_in))));
                        prop_assert_eq!(admitted, Admission::Queued);
                    }
                    3 => {
                        profiles_in += 1;
                        let before = q.used_bytes();
                        let profile = pb::StripeProfile { row_px: vec![1.0; 60], ..Default::default() };
                        let entry = Entry::profile(&profile);
                        let size = entry.size_bytes();
                        let dropped = q.push(item(n as u64, entry)) == Admission::DroppedDerived;
                        prop_assert_eq!(dropped, before + size > bound);
                        prop_assert!(q.used_bytes() <= bound.max(before));
                    }
                    _ => out.extend(q.pop()),
                }
            }
            while let Some(i) = q.pop() { out.push(i); }
            prop_assert_eq!(q.used_bytes(), 0);
            prop_assert!(out.windows(2).all(|w| w[0].log_ns < w[1].log_ns));
            let frames_out = out.iter().filter(|i| i.entry.is_frame()).count() as u64;
            let profiles_out = out.iter().filter(|i| i.entry.derived_topic().is_some()).count() as u64;
            let profiles_dropped = q.dropped_derived().values().sum::<u64>();
            prop_assert_eq!(profiles_out + profiles_dropped, profiles_in);
            prop_assert_eq!(out.len() as u64 - frames_out - profiles_out, u64::from(commands_in));
            prop_assert_eq!(frames_out + q.dropped_frames(), frames_in);
            prop_assert_eq!(drops, q.dropped_frames());
            prop_assert!(episodes_closed <= drops);
        }
    }

    #[test]
    fn a_closed_queue_drains_and_refuses() {
        let queue = Queue::new(1 << 20, ());
        queue.with(|q, ()| {
            q.push(item(1, Entry::command(&command(1))));
            q.close();
            assert_eq!(
                q.push(item(2, Entry::command(&command(2)))),
                Admission::Closed
            );
        });
        assert!(matches!(queue.pop(Duration::ZERO), Popped::Entry(_)));
        assert_eq!(queue.pop(Duration::from_secs(1000)), Popped::End);
    }

    #[test]
    fn an_empty_queue_times_out() {
        let queue = Queue::new(1 << 20, ());
        assert_eq!(queue.pop(Duration::ZERO), Popped::Timeout);
    }
}
