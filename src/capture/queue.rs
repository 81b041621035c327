//! The mmap buffer queue as a state machine without I/O.
//!
//! It knows which buffers the kernel owns and which we hold, returns the next [`Action`], and takes its
//! [`Outcome`]. The rules it keeps, whatever comes back: a buffer is queued only while it is ours, none is ever
//! lost, and every failure leads to a next step: retry, restart with back-off, or re-open. (The `v4l` crate's
//! own stream queues a buffer before it polls, so one timeout makes every later call fail.)
//!
//! Kernel side: videobuf2, <https://docs.kernel.org/userspace-api/media/v4l/mmap.html>. STREAMOFF gives every buffer back
//! and clears a fatal error; QBUF, DQBUF fail with EIO until then.

use std::time::Duration;

/// Next action of the adapter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Action {
    /// VIDIOC_QBUF of this buffer.
    Enqueue(u32),
    /// VIDIOC_STREAMON: the stream starts.
    StreamOn,
    /// VIDIOC_STREAMOFF: the stream stops, and all buffers come back.
    StreamOff,
    /// poll(2) for a frame, at the latest until this CLOCK_MONOTONIC time \[ns\].
    Poll {
        /// Deadline \[ns\].
        until_ns: u64,
    },
    /// VIDIOC_DQBUF of a filled buffer.
    Dequeue,
    /// Copy the frame out of this buffer; it is ours until [`Outcome::Done`].
    Deliver(u32),
    /// Do nothing until this CLOCK_MONOTONIC time \[ns\].
    Rest {
        /// Deadline \[ns\].
        until_ns: u64,
    },
    /// The device is gone: close it and find it again; then make a new queue.
    Reopen,
}

/// Outcome of an action.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// Enqueue, StreamOn, StreamOff, Deliver, Rest: done.
    Done,
    /// Poll: a frame (or an error) waits.
    Ready,
    /// Poll: nothing until the deadline or a signal came.
    Silence,
    /// Dequeue: this buffer is ours now. `void` = it holds no frame (ERROR, no bytes, no stamp).
    Dequeued {
        /// Index of the buffer.
        index: u32,
        /// No frame in it.
        void: bool,
    },
    /// The call failed with this errno.
    Failed(i32),
}

/// Call that failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Call {
    /// VIDIOC_QBUF of a buffer.
    Enqueue,
    /// VIDIOC_DQBUF of a filled buffer.
    Dequeue,
    /// VIDIOC_STREAMON at the start of the stream.
    StreamOn,
    /// VIDIOC_STREAMOFF at its end.
    StreamOff,
    /// poll(2)
    Poll,
}

impl std::fmt::Display for Call {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Enqueue => "VIDIOC_QBUF",
            Self::Dequeue => "VIDIOC_DQBUF",
            Self::StreamOn => "VIDIOC_STREAMON",
            Self::StreamOff => "VIDIOC_STREAMOFF",
            Self::Poll => "poll",
        })
    }
}

/// Notice for the user about the stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Notice {
    /// STREAMON succeeded.
    Started,
    /// No frame for so long; the stream is stopped and started again.
    Frozen {
        /// Silence \[ns\].
        silence_ns: u64,
        /// Restarts in a row, from 1.
        attempt: u32,
    },
    /// A call failed; the stream is stopped, and started again after the back-off.
    Failed {
        /// Call that failed.
        call: Call,
        /// Its errno.
        errno: i32,
        /// Failures in a row, from 1.
        attempt: u32,
        /// Back-off \[ns\].
        back_off_ns: u64,
    },
    /// All buffers came back without a frame; the stream is restarted.
    Voided,
    /// A buffer was refused once and will be tried again.
    Refused {
        /// Index of the buffer.
        index: u32,
        /// Its errno.
        errno: i32,
    },
    /// The kernel handed out a buffer it did not have; the stream is restarted.
    Nonsense {
        /// Index it gave.
        index: u32,
    },
    /// The device is gone.
    Gone {
        /// Its errno.
        errno: i32,
    },
}

/// Waiting times.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Patience {
    /// Silence after which a streaming camera counts as frozen.
    pub frozen_after: Duration,
    /// First pause before a restart; doubled each time in a row.
    pub back_off: Duration,
    /// Longest pause before a restart.
    pub longest_back_off: Duration,
    /// Pause before a refused buffer is tried again, and after a spurious wake-up.
    pub retry: Duration,
}

impl Default for Patience {
    fn default() -> Self {
        Self {
            frozen_after: Duration::from_secs(1),
            back_off: Duration::from_millis(50),
            longest_back_off: Duration::from_secs(2),
            retry: Duration::from_millis(5),
        }
    }
}

/// Behind a buffer without a frame this part of the patience is enough: the driver has given up on the stream.
const AFTER_VOID: u64 = 2;

/// Who has a buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Owner {
    /// We; to be queued, not before this time (0 = at once).
    Us {
        not_before_ns: u64,
    },
    Kernel,
    /// We; the frame in it is being copied out.
    Held,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// Queueing all buffers, then STREAMON.
    Filling,
    /// Running; `ready` = poll said so.
    Streaming {
        ready: bool,
    },
    /// Running, but nothing can be done before this time.
    Idling {
        until_ns: u64,
    },
    /// STREAMOFF next.
    Stopping {
        then_rest_ns: u64,
    },
    /// Waiting before a new start.
    Resting {
        until_ns: u64,
    },
    Gone,
}

/// The queue. `now_ns` is CLOCK_MONOTONIC everywhere.
#[derive(Debug, Clone)]
pub struct BufferQueue {
    owners: Vec<Owner>,
    phase: Phase,
    patience: Patience,
    /// Last frame, or last start: silence counts from here.
    alive_ns: u64,
    failures: u32,
    freezes: u32,
    voids: usize,
    last_void_ns: u64,
    refusals: u32,
    spurious: u32,
}

/// ENODEV and its relatives: what a driver says when its device has been pulled.
fn is_gone(errno: i32) -> bool {
    matches!(
        errno,
        libc::ENODEV | libc::ENXIO | libc::ENOENT | libc::ESHUTDOWN | libc::EBADF
    )
}

impl BufferQueue {
    /// A queue of `buffers` buffers, none queued, the stream off.
    pub fn new(buffers: u32, patience: Patience, now_ns: u64) -> Self {
        Self {
            owners: vec![Owner::Us { not_before_ns: 0 }; buffers as usize],
            phase: Phase::Filling,
            patience,
            alive_ns: now_ns,
            failures: 0,
            freezes: 0,
            voids: 0,
            last_void_ns: 0,
            refusals: 0,
            spurious: 0,
        }
    }

    /// The action to take now. Asking again without an outcome gives the same answer (a deadline may have passed).
    pub fn action(&self, now_ns: u64) -> Action {
        match self.phase {
            Phase::Gone => Action::Reopen,
            Phase::Stopping { .. } => Action::StreamOff,
            Phase::Resting { until_ns } | Phase::Idling { until_ns } => Action::Rest { until_ns },
            Phase::Filling => self
                .queueable(now_ns)
                .map_or(Action::StreamOn, Action::Enqueue),
            Phase::Streaming { ready } => {
                if let Some(held) = self.owners.iter().position(|o| *o == Owner::Held) {
                    Action::Deliver(held as u32)
                } else if let Some(free) = self.queueable(now_ns) {
                    Action::Enqueue(free)
                } else if !self.owners.contains(&Owner::Kernel) {
                    Action::Rest {
                        until_ns: now_ns + self.patience.retry.as_nanos() as u64,
                    }
                } else if ready {
                    Action::Dequeue
                } else {
                    Action::Poll {
                        until_ns: self.frozen_at_ns(),
                    }
                }
            }
        }
    }

    /// Tells how the last action went.
    pub fn outcome(&mut self, action: Action, outcome: Outcome, now_ns: u64) -> Option<Notice> {
        match (action, outcome) {
            (Action::Enqueue(index), Outcome::Done) => {
                self.set(index, Owner::Kernel);
                self.refusals = 0;
                None
            }
            (Action::Enqueue(index), Outcome::Failed(errno)) => self.refused(index, errno, now_ns),
            (Action::StreamOn, Outcome::Done) => {
                self.phase = Phase::Streaming { ready: false };
                self.alive_ns = now_ns;
                (self.voids, self.spurious) = (0, 0);
                Some(Notice::Started)
            }
            (Action::StreamOff, Outcome::Done) => {
                // Every buffer comes back with STREAMOFF, whatever its state was.
                self.owners.fill(Owner::Us { not_before_ns: 0 });
                let rest_ns = if let Phase::Stopping { then_rest_ns } = self.phase {
                    then_rest_ns
                } else {
                    0
                };
                self.phase = Phase::Resting {
                    until_ns: now_ns + rest_ns,
                };
                None
            }
            (Action::Deliver(index), _) => {
                self.set(index, Owner::Us { not_before_ns: 0 });
                None
            }
            (Action::Rest { until_ns }, _) => {
                if now_ns >= until_ns {
                    self.phase = match self.phase {
                        Phase::Resting { .. } => Phase::Filling,
                        Phase::Idling { .. } => Phase::Streaming { ready: false },
                        other => other,
                    };
                }
                self.check_frozen(now_ns)
            }
            (Action::Poll { .. }, Outcome::Ready) => {
                self.phase = Phase::Streaming { ready: true };
                None
            }
            (Action::Poll { .. }, Outcome::Failed(errno)) if is_gone(errno) => self.gone(errno),
            (Action::Poll { .. }, Outcome::Failed(errno))
                if !matches!(errno, libc::EINTR | libc::EAGAIN) =>
            {
                Some(self.fail(Call::Poll, errno, now_ns))
            }
            (Action::Poll { .. }, _) => self.check_frozen(now_ns),
            (Action::Dequeue, Outcome::Dequeued { index, void }) => {
                self.dequeued(index, void, now_ns)
            }
            (Action::Dequeue, Outcome::Failed(libc::EINTR)) => None,
            (Action::Dequeue, Outcome::Failed(libc::EAGAIN)) => {
                // Woken for nothing. Once is normal; a driver that does it for ever must not cost a core.
                self.spurious += 1;
                self.phase = if self.spurious > 2 {
                    Phase::Idling {
                        until_ns: now_ns + self.patience.retry.as_nanos() as u64,
                    }
                } else {
                    Phase::Streaming { ready: false }
                };
                self.check_frozen(now_ns)
            }
            (Action::StreamOn | Action::StreamOff, Outcome::Failed(libc::EINTR)) => None,
            (Action::Dequeue, Outcome::Failed(errno)) => {
                Some(self.fail(Call::Dequeue, errno, now_ns))
            }
            (Action::StreamOn, Outcome::Failed(errno)) => {
                Some(self.fail(Call::StreamOn, errno, now_ns))
            }
            // A stream that cannot be stopped can only be closed.
            (Action::StreamOff, Outcome::Failed(errno)) => self.gone(errno),
            _ => None,
        }
    }

    fn set(&mut self, index: u32, owner: Owner) {
        if let Some(slot) = self.owners.get_mut(index as usize) {
            *slot = owner;
        }
    }

    fn queueable(&self, now_ns: u64) -> Option<u32> {
        let ours = |o: &Owner| matches!(o, Owner::Us { not_before_ns } if *not_before_ns <= now_ns);
        self.owners.iter().position(ours).map(|i| i as u32)
    }

    fn frozen_at_ns(&self) -> u64 {
        // Each restart that brought nothing doubles the patience with the next.
        let patience = self.patience.frozen_after.as_nanos() as u64;
        let frozen_ns = self
            .alive_ns
            .saturating_add(patience << self.freezes.min(2));
        self.given_up_at_ns()
            .map_or(frozen_ns, |given_up_ns| given_up_ns.min(frozen_ns))
    }

    /// When the silence after a buffer without a frame has lasted long enough to mean something.
    fn given_up_at_ns(&self) -> Option<u64> {
        let patience = self.patience.frozen_after.as_nanos() as u64 / AFTER_VOID;
        (self.voids > 0).then(|| self.last_void_ns.saturating_add(patience))
    }

    fn check_frozen(&mut self, now_ns: u64) -> Option<Notice> {
        if now_ns < self.frozen_at_ns()
            || !matches!(self.phase, Phase::Streaming { .. } | Phase::Idling { .. })
        {
            return None;
        }
        if self.given_up_at_ns().is_some_and(|at_ns| now_ns >= at_ns) {
            return Some(self.voided());
        }
        self.freezes = self.freezes.saturating_add(1);
        self.phase = Phase::Stopping { then_rest_ns: 0 };
        Some(Notice::Frozen {
            silence_ns: now_ns - self.alive_ns,
            attempt: self.freezes,
        })
    }

    fn refused(&mut self, index: u32, errno: i32, now_ns: u64) -> Option<Notice> {
        match errno {
            libc::EINTR => return None,
            e if is_gone(e) => return self.gone(e),
            libc::EIO => return Some(self.fail(Call::Enqueue, errno, now_ns)),
            _ => {}
        }
        self.refusals += 1;
        if self.refusals as usize > 4 * self.owners.len() {
            self.refusals = 0;
            return Some(self.fail(Call::Enqueue, errno, now_ns));
        }
        self.set(
            index,
            Owner::Us {
                not_before_ns: now_ns + self.patience.retry.as_nanos() as u64,
            },
        );
        if self.phase == Phase::Filling {
            // Nothing streams yet, so nothing is lost by waiting for this buffer.
            self.phase = Phase::Resting {
                until_ns: now_ns + self.patience.retry.as_nanos() as u64,
            };
        }
        Some(Notice::Refused { index, errno })
    }

    fn dequeued(&mut self, index: u32, void: bool, now_ns: u64) -> Option<Notice> {
        if self.owners.get(index as usize) != Some(&Owner::Kernel) {
            self.failures += 1;
            self.phase = Phase::Stopping {
                then_rest_ns: self.back_off_ns(),
            };
            return Some(Notice::Nonsense { index });
        }
        self.set(index, Owner::Held);
        self.phase = Phase::Streaming { ready: false };
        self.spurious = 0;
        if !void {
            self.alive_ns = now_ns;
            (self.failures, self.freezes, self.voids) = (0, 0, 0);
            return None;
        }
        self.voids += 1;
        self.last_void_ns = now_ns;
        if self.voids < self.owners.len() {
            // Of the buffers that it gave back some may have held frames; what follows will show it.
            return None;
        }
        Some(self.voided())
    }

    /// The driver has given up on this stream (EPIPE on the bulk endpoint): only a new start helps.
    fn voided(&mut self) -> Notice {
        self.failures = self.failures.saturating_add(1);
        self.phase = Phase::Stopping {
            then_rest_ns: self.back_off_ns(),
        };
        Notice::Voided
    }

    fn back_off_ns(&self) -> u64 {
        let first = self.patience.back_off.as_nanos() as u64;
        (first << self.failures.saturating_sub(1).min(16))
            .min(self.patience.longest_back_off.as_nanos() as u64)
    }

    fn fail(&mut self, call: Call, errno: i32, _now_ns: u64) -> Notice {
        if is_gone(errno) {
            self.phase = Phase::Gone;
            return Notice::Gone { errno };
        }
        self.failures = self.failures.saturating_add(1);
        let back_off_ns = self.back_off_ns();
        self.phase = Phase::Stopping {
            then_rest_ns: back_off_ns,
        };
        Notice::Failed {
            call,
            errno,
            attempt: self.failures,
            back_off_ns,
        }
    }

    fn gone(&mut self, errno: i32) -> Option<Notice> {
        self.phase = Phase::Gone;
        Some(Notice::Gone { errno })
    }
}

#[cfg(test)]
mod tests;
