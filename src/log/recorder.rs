//! The live log: a cheap handle for every producer, one queue, one writer thread.

use hydroline_core::lock::Lock;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, Weak};
use std::thread::JoinHandle;
use std::time::Duration;

use super::LogError;
use super::entry::Entry;
use super::loss_account::{Counts, FrameLedger, LogOutcome, SummaryInput};
use super::messages::pb;
use super::queue::{Admission, Popped, Queue, Queued};
use super::settings::{Head, PartOpener, WriteSettings};
use super::time::LogTime;
use super::writer::LogWriter;
use hydroline_core::clock::Clock;
use hydroline_core::event::{Event, Severity, kind};
use hydroline_core::frame::Frame;
use hydroline_core::heartbeat::Heartbeat;

/// State that producers share under the queue's lock.
#[derive(Debug, Default)]
struct Producers {
    time: LogTime,
    frames: FrameLedger,
    faulty: u64,
    after_end: u64,
}

struct Shared {
    queue: Arc<Queue<Producers>>,
    writer_counts: Arc<Mutex<Counts>>,
    clock: Arc<dyn Clock>,
    heartbeat: Heartbeat,
    thread: Mutex<Option<JoinHandle<Option<LogWriter>>>>,
}

/// Handle to a running recording. Clone it freely; no call waits for the disk.
#[derive(Clone)]
pub struct Recorder {
    shared: Arc<Shared>,
}

/// A handle that does not keep the recording alive.
#[derive(Clone)]
pub struct WeakRecorder {
    shared: Weak<Shared>,
}

impl WeakRecorder {
    /// The recording, if it still runs.
    pub fn upgrade(&self) -> Option<Recorder> {
        self.shared.upgrade().map(|shared| Recorder { shared })
    }
}

impl Recorder {
    /// Creates the first file, makes its head durable, and starts the writer thread.
    ///
    /// # Errors
    /// When the first file cannot be created or the thread cannot be started.
    pub fn start(
        opener: Box<dyn PartOpener>,
        head: Head,
        settings: WriteSettings,
        clock: Arc<dyn Clock>,
    ) -> Result<Self, LogError> {
        let queue_bytes = settings.queue_bytes;
        let writer = LogWriter::create(opener, head, settings, clock.monotonic_ns())?;
        let queue = Arc::new(Queue::new(queue_bytes, Producers::default()));
        let writer_counts = Arc::new(Mutex::new(Counts::default()));
        let heartbeat = Heartbeat::default();
        let (q, c, k, beat) = (
            Arc::clone(&queue),
            Arc::clone(&writer_counts),
            Arc::clone(&clock),
            heartbeat.clone(),
        );
        let thread = std::thread::Builder::new()
            .name("log-writer".to_owned())
            .spawn(move || run(writer, &q, &c, k.as_ref(), &beat))
            .map_err(|source| LogError::Thread { source })?;
        let thread = Mutex::new(Some(thread));
        Ok(Self {
            shared: Arc::new(Shared {
                queue,
                writer_counts,
                clock,
                heartbeat,
                thread,
            }),
        })
    }

    /// A frame; `frame_index` counts frames received by the daemon, from 0.
    pub fn frame(&self, frame: &Frame, frame_index: u64) {
        self.push(Entry::frame(frame, frame_index));
    }

    /// Every command sent.
    pub fn command(&self, message: &pb::ThrusterCommand) {
        self.push(Entry::command(message));
    }

    /// Every event of the daemon.
    pub fn event(&self, event: &Event) {
        // It takes back losses which a frame before was marked with.
        if *event.kind == kind::CAMERA_GAP_RETRACTED {
            let taken_back = event.values.iter().find(|v| v.0 == "frames");
            let frames = taken_back.map_or(0, |v| v.1 as u64);
            let queue = &self.shared.queue;
            queue.with(|_, producers| producers.frames.retract(frames));
        }
        self.push(Entry::event(event));
    }

    /// Anything; stamps it with the log time, in the order of arrival.
    pub fn push(&self, entry: Entry) {
        // Read before the lock: five clock reads are no reason to hold up another producer.
        // LogTime keeps the order of the queue monotone whatever the order of the readings.
        let clocks = self.shared.clock.triple();
        self.shared.queue.with(|queue, producers| {
            let (log_ns, step) = producers.time.stamp(&clocks);
            if let Some(step_ns) = step {
                let step_s = step_ns as f64 / 1e9;
                let message = format!(
                    "the realtime clock was set by {step_s:+.3} s; stamps before and after do not compare"
                );
                let event = Event::new(clocks.realtime_ns, Severity::Warning, &kind::CLOCK_STEP, message)
                    .with("step_s", step_s);
                queue.push(Queued { log_ns, entry: Entry::event(&event) });
            }
            if let Entry::Frame { frame, .. } = &entry {
                producers.frames.count(frame);
                producers.faulty += u64::from(frame.meta.fault.is_some());
            }
            match queue.push(Queued { log_ns, entry }) {
                Admission::Queued => {}
                Admission::Closed => producers.after_end += 1,
                Admission::Dropped { first: false } | Admission::DroppedDerived => {}
                Admission::Dropped { first: true } => {
                    let used = queue.used_bytes() as f64 / 1e6;
                    let message = format!(
                        "the disk is too slow: {used:.0} MB wait in the queue, new frames are dropped"
                    );
                    let event =
                        Event::new(clocks.realtime_ns, Severity::Error, &kind::LOG_FRAMES_DROPPED, message)
                            .with("queue_mb", used);
                    queue.push(Queued { log_ns, entry: Entry::event(&event) });
                }
                Admission::QueuedAfterDrops { dropped } => {
                    let message = format!("the queue takes frames again; {dropped} were dropped");
                    let event =
                        Event::new(clocks.realtime_ns, Severity::Error, &kind::LOG_FRAMES_DROPPED, message)
                            .with("dropped", dropped as f64);
                    queue.push(Queued { log_ns, entry: Entry::event(&event) });
                }
            }
        });
    }

    /// A handle that does not keep the recording alive.
    pub fn downgrade(&self) -> WeakRecorder {
        WeakRecorder {
            shared: Arc::downgrade(&self.shared),
        }
    }

    /// Host realtime of the recording's clock, UNIX \[ns\].
    pub fn now_unix_ns(&self) -> u64 {
        self.shared.clock.triple().realtime_ns
    }

    /// Beats with each turn of the writer's loop, which a disk that stands still holds up.
    pub fn heartbeat(&self) -> Heartbeat {
        self.shared.heartbeat.clone()
    }

    /// Live counters.
    pub fn counts(&self) -> Counts {
        let writer = self.shared.writer_counts.held().clone();
        producer_counts(&self.shared.queue, writer)
    }

    /// Reason why writing stopped (disk full or failed, the writer panicked), if it did: the recording should end.
    pub fn stopped(&self) -> Option<String> {
        let counts = self.shared.writer_counts.held();
        counts.stopped.clone()
    }

    /// Writes what is queued, closes the file and reports. Other handles may still exist; what
    /// they push afterwards is counted, not written.
    ///
    /// # Errors
    /// [`LogError::Finished`] when another handle did it before, [`LogError::WriterPanicked`].
    pub fn finish(&self, summary: &SummaryInput) -> Result<LogOutcome, LogError> {
        self.shared.finish(summary)
    }
}

impl Shared {
    fn finish(&self, summary: &SummaryInput) -> Result<LogOutcome, LogError> {
        self.queue.with(|queue, _| queue.close());
        let thread = self.thread.held().take();
        let writer = thread
            .ok_or(LogError::Finished)?
            .join()
            .ok()
            .flatten()
            .ok_or(LogError::WriterPanicked)?;
        let now_ns = self.clock.monotonic_ns();
        let counts = || producer_counts(&self.queue, Counts::default());
        let outcome = writer.finish(now_ns, summary, &counts);
        outcome.counts.clone_into(&mut self.writer_counts.held());
        Ok(outcome)
    }
}

impl Drop for Shared {
    fn drop(&mut self) {
        // The daemon is unwinding: still give the file its end, and say that it was not orderly.
        let summary = SummaryInput {
            clean: false,
            ..SummaryInput::clean("the recorder was dropped")
        };
        self.finish(&summary).ok();
    }
}

fn producer_counts(queue: &Queue<Producers>, mut counts: Counts) -> Counts {
    queue.with(|queue, producers| {
        counts.frames.clone_from(&producers.frames);
        counts.frames_faulty = producers.faulty;
        counts.frames_dropped = queue.dropped_frames();
        counts.derived_dropped.clear();
        for (topic, n) in queue.dropped_derived() {
            *counts.derived_dropped.entry(topic.name()).or_default() += n;
        }
        counts.after_end = producers.after_end;
        counts.queue_bytes = queue.used_bytes();
        counts.queue_peak_bytes = queue.peak_bytes();
    });
    counts
}

/// Longest sleep of the writer: bounds how late a clock that is not the machine's is noticed.
const IDLE: Duration = Duration::from_millis(500);

/// Writes until the queue ends. `None`: the writer panicked; then [`Recorder::stopped`] says so at
/// once and the queue takes nothing more, instead of growing until somebody asks for the end.
fn run(
    mut writer: LogWriter,
    queue: &Queue<Producers>,
    shared: &Mutex<Counts>,
    clock: &dyn Clock,
    heartbeat: &Heartbeat,
) -> Option<LogWriter> {
    // Unwind safety: after a panic the writer is only dropped; queue and counts are whole between
    // any two of their statements.
    let written = catch_unwind(AssertUnwindSafe(|| {
        drain(&mut writer, queue, shared, clock, heartbeat)
    }));
    let Err(panic) = written else {
        return Some(writer);
    };
    let words = panic
        .downcast_ref::<&str>()
        .map(|s| (*s).to_owned())
        .or_else(|| panic.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "no words".to_owned());
    let given_up = queue.with(|queue, _| queue.give_up());
    let why = format!(
        "the log's writer panicked ({words}), {given_up} queued entries are lost; `hydroline recover` mends the file"
    );
    tracing::error!("{why}");
    shared.held().stopped = Some(why);
    // A writer that panicked while writing may panic again while being dropped.
    catch_unwind(AssertUnwindSafe(|| drop(writer))).ok();
    None
}

fn drain(
    writer: &mut LogWriter,
    queue: &Queue<Producers>,
    shared: &Mutex<Counts>,
    clock: &dyn Clock,
    heartbeat: &Heartbeat,
) {
    let counts = || producer_counts(queue, Counts::default());
    loop {
        heartbeat.beat();
        let wait = match writer.next_deadline_ns() {
            Some(deadline) => {
                Duration::from_nanos(deadline.saturating_sub(clock.monotonic_ns())).min(IDLE)
            }
            None => IDLE,
        };
        let popped = queue.pop(wait);
        let now_ns = clock.monotonic_ns();
        match popped {
            Popped::Entry(item) => {
                // Overdue work goes first: the entry just taken belongs to the next chunk.
                writer.tick(now_ns, &counts);
                writer.write(now_ns, item.log_ns, &item.entry, &counts);
            }
            Popped::Timeout => writer.tick(now_ns, &counts),
            Popped::End => return,
        }
        let mut latest = Counts::default();
        writer.count_into(&mut latest);
        *shared.held() = latest;
    }
}
