//! The capture thread: owns a source, is never interrupted, never waits for anybody.

use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use super::{CaptureCounts, CaptureError, Captured, FrameSource, SourceDescription};

/// How long a stop may take to be noticed.
const TICK: Duration = Duration::from_millis(100);

/// How a capture ended.
#[derive(Debug, Clone, PartialEq)]
pub struct CaptureEnd {
    /// The final account.
    pub counts: CaptureCounts,
    /// The source as it was at the end.
    pub description: SourceDescription,
    /// The error that ended it, if one did.
    pub error: Option<CaptureError>,
}

/// A running capture thread. Dropping it stops the thread and waits for it.
pub struct CaptureThread {
    stop: Arc<AtomicBool>,
    counts: Arc<Mutex<CaptureCounts>>,
    handle: Option<JoinHandle<CaptureEnd>>,
}

fn with_signals_blocked<T>(f: impl FnOnce() -> T) -> T {
    // SAFETY: plain libc calls on local, initialised sets; the old mask is restored below.
    let old = unsafe {
        let mut all: libc::sigset_t = std::mem::zeroed();
        let mut old: libc::sigset_t = std::mem::zeroed();
        libc::sigfillset(&mut all);
        libc::pthread_sigmask(libc::SIG_SETMASK, &all, &mut old);
        old
    };
    let result = f();
    // SAFETY: `old` was filled above.
    unsafe { libc::pthread_sigmask(libc::SIG_SETMASK, &old, std::ptr::null_mut()) };
    result
}

impl CaptureThread {
    /// Starts the thread. `deliver` is called on it for each frame and event and must not block: a disk or a network
    /// belongs behind a queue ([`frame_channel`]).
    ///
    /// # Errors
    /// When the system has no thread left.
    pub fn spawn(
        mut source: Box<dyn FrameSource>,
        mut deliver: impl FnMut(Captured) + Send + 'static,
    ) -> std::io::Result<Self> {
        let stop = Arc::new(AtomicBool::new(false));
        let counts = Arc::new(Mutex::new(source.counts()));
        let (stopped, shared) = (Arc::clone(&stop), Arc::clone(&counts));
        let run = move || {
            let mut error = None;
            while !stopped.load(Ordering::Relaxed) {
                match source.next(TICK) {
                    Ok(Captured::Finished) => break,
                    Ok(Captured::Nothing) => {}
                    Ok(one) => {
                        // The account changes with frames; once a second its event says so.
                        let refresh = matches!(&one, Captured::Event(_));
                        deliver(one);
                        if refresh {
                            *shared.lock().unwrap_or_else(PoisonError::into_inner) =
                                source.counts();
                        }
                    }
                    Err(e) => {
                        error = Some(e);
                        break;
                    }
                }
            }
            let counts = source.counts();
            *shared.lock().unwrap_or_else(PoisonError::into_inner) = counts;
            CaptureEnd {
                counts,
                description: source.describe(),
                error,
            }
        };
        // A thread inherits the mask: no signal can ever reach it, not even before its first instruction.
        let handle = with_signals_blocked(|| {
            std::thread::Builder::new()
                .name("capture".into())
                .spawn(run)
        })?;
        Ok(Self {
            stop,
            counts,
            handle: Some(handle),
        })
    }

    /// The account, at most about a second old.
    pub fn counts(&self) -> CaptureCounts {
        *self.counts.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The source has ended by itself (finished, or an error).
    pub fn is_finished(&self) -> bool {
        self.handle.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Stops and returns how it ended.
    pub fn stop(mut self) -> CaptureEnd {
        self.join()
    }

    fn join(&mut self) -> CaptureEnd {
        self.stop.store(true, Ordering::Relaxed);
        let counts = self.counts();
        let lost = |reason: &str| CaptureEnd {
            counts,
            description: SourceDescription::default(),
            error: Some(CaptureError::Source {
                source_name: "capture thread".into(),
                reason: reason.into(),
            }),
        };
        match self.handle.take().map(JoinHandle::join) {
            Some(Ok(end)) => end,
            Some(Err(_)) => lost("panicked; its account is as of its last event"),
            None => lost("was already stopped"),
        }
    }
}

impl Drop for CaptureThread {
    fn drop(&mut self) {
        if self.handle.is_some() {
            self.join();
        }
    }
}

/// Sending end for `deliver`: frames beyond the bound are dropped, newest first, and counted; events never are.
pub struct FrameSender {
    sender: Sender<Captured>,
    waiting: Arc<AtomicUsize>,
    dropped: Arc<AtomicU64>,
    most: usize,
}

/// Receiving end.
pub struct FrameReceiver {
    receiver: Receiver<Captured>,
    waiting: Arc<AtomicUsize>,
    dropped: Arc<AtomicU64>,
}

/// A channel that holds at most `most` frames and any number of events.
pub fn frame_channel(most: usize) -> (FrameSender, FrameReceiver) {
    let (sender, receiver) = channel();
    let (waiting, dropped) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicU64::new(0)));
    (
        FrameSender {
            sender,
            waiting: Arc::clone(&waiting),
            dropped: Arc::clone(&dropped),
            most,
        },
        FrameReceiver {
            receiver,
            waiting,
            dropped,
        },
    )
}

impl FrameSender {
    /// Hands over without ever waiting. `false` = a frame was dropped, or nobody receives any more.
    pub fn send(&self, one: Captured) -> bool {
        if matches!(one, Captured::Frame(_)) {
            if self.waiting.load(Ordering::Acquire) >= self.most {
                self.dropped.fetch_add(1, Ordering::Relaxed);
                return false;
            }
            self.waiting.fetch_add(1, Ordering::AcqRel);
        }
        self.sender.send(one).is_ok()
    }
}

impl FrameReceiver {
    /// The next one, or `None` after `wait` or when the sender is gone.
    pub fn recv(&self, wait: Duration) -> Option<Captured> {
        let one = self.receiver.recv_timeout(wait).ok()?;
        if matches!(one, Captured::Frame(_)) {
            self.waiting.fetch_sub(1, Ordering::AcqRel);
        }
        Some(one)
    }

    /// Frames dropped so far because the channel was full.
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::{FakeSource, FakeStep};
    use crate::clock::ManualClock;
    use crate::event::{Event, Severity};
    use crate::frame::{Frame, FrameMeta, PixelFormat, StampClock, StampSource};

    fn frame(sequence: u32) -> Frame {
        let meta = FrameMeta {
            sequence,
            driver_stamp_ns: 0,
            stamp_clock: StampClock::Realtime,
            stamp_source: StampSource::MidExposure,
            flags: 0,
            received_monotonic_ns: 0,
            mid_exposure_ns: u64::from(sequence) * 40_000_000,
            exposure_s: 0.0,
            fault: None,
            lost_before: Default::default(),
        };
        Frame {
            format: PixelFormat::Grey,
            width_px: 1,
            height_px: 1,
            stride_bytes: 1,
            data: vec![0].into(),
            meta,
        }
    }

    fn source(steps: Vec<FakeStep>) -> Box<FakeSource> {
        Box::new(FakeSource::new(
            Arc::new(ManualClock::new(0, 0)),
            SourceDescription::default(),
            steps,
        ))
    }

    fn join(thread: CaptureThread) -> CaptureEnd {
        while !thread.is_finished() {
            std::thread::yield_now();
        }
        thread.stop()
    }

    #[test]
    fn frames_and_events_arrive_in_order_and_the_end_is_told() {
        let event = Event::new(1, Severity::Info, "camera.counts", "x");
        let steps = vec![
            FakeStep::Frame(frame(0)),
            FakeStep::Event(event.clone()),
            FakeStep::Silence(Duration::from_secs(9)),
            FakeStep::Frame(frame(1)),
        ];
        let (sender, receiver) = frame_channel(10);
        let thread =
            CaptureThread::spawn(source(steps), move |one| assert!(sender.send(one))).unwrap();
        let end = join(thread);
        let got: Vec<_> = std::iter::from_fn(|| receiver.recv(Duration::ZERO)).collect();
        assert_eq!(
            got,
            [
                Captured::Frame(frame(0)),
                Captured::Event(event),
                Captured::Frame(frame(1))
            ]
        );
        assert_eq!((end.counts.received, end.error), (2, None));
    }

    #[test]
    fn a_full_channel_drops_the_newest_frames_and_no_event() {
        let steps = (0..50).flat_map(|i| {
            [
                FakeStep::Frame(frame(i)),
                FakeStep::Event(Event::new(0, Severity::Info, "x", "y")),
            ]
        });
        let (sender, receiver) = frame_channel(7);
        let thread = CaptureThread::spawn(source(steps.collect()), move |one| {
            sender.send(one);
        })
        .unwrap();
        assert_eq!(join(thread).counts.received, 50);
        let got: Vec<_> = std::iter::from_fn(|| receiver.recv(Duration::ZERO)).collect();
        let frames: Vec<u32> = got
            .iter()
            .filter_map(|c| {
                if let Captured::Frame(f) = c {
                    Some(f.meta.sequence)
                } else {
                    None
                }
            })
            .collect();
        assert_eq!(
            (frames, receiver.dropped(), got.len()),
            ((0..7).collect(), 43, 57)
        );
    }

    #[test]
    fn an_error_ends_it_and_is_told() {
        let error = CaptureError::NotV4l;
        let steps = vec![
            FakeStep::Frame(frame(0)),
            FakeStep::Fail(error.clone()),
            FakeStep::Frame(frame(1)),
        ];
        let end = join(CaptureThread::spawn(source(steps), drop).unwrap());
        assert_eq!((end.counts.received, end.error), (1, Some(error)));
    }

    #[test]
    fn no_signal_reaches_it() {
        let blocked = Arc::new(AtomicBool::new(false));
        let seen = Arc::clone(&blocked);
        let deliver = move |_| {
            // SAFETY: reads this thread's mask into a local set.
            let hup = unsafe {
                let mut mask: libc::sigset_t = std::mem::zeroed();
                libc::pthread_sigmask(libc::SIG_SETMASK, std::ptr::null(), &mut mask);
                libc::sigismember(&mask, libc::SIGHUP) == 1
                    && libc::sigismember(&mask, libc::SIGTERM) == 1
            };
            seen.store(hup, Ordering::SeqCst);
        };
        join(CaptureThread::spawn(source(vec![FakeStep::Frame(frame(0))]), deliver).unwrap());
        assert!(blocked.load(Ordering::SeqCst));
    }
}
