//! A camera by script: frames, silences, events and faults, exactly as told.
//!
//! For tests of everything behind a [`FrameSource`]: time is the injected clock's, so a
//! script of an hour runs in a moment on a `ManualClock` and paced on a `SystemClock`.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use super::{CaptureCounts, CaptureError, Captured, FrameSource, SourceDescription};
use crate::clock::Clock;
use crate::event::Event;
use crate::frame::{Frame, FrameFault};

/// One step of a script.
#[derive(Debug, Clone)]
pub enum FakeStep {
    /// Delivers this frame, as it is.
    Frame(Frame),
    /// Delivers this event.
    Event(Event),
    /// Is silent for so long.
    Silence(Duration),
    /// Fails; later calls go on with the next step.
    Fail(CaptureError),
}

/// Plays a script.
pub struct FakeSource {
    clock: Arc<dyn Clock>,
    description: SourceDescription,
    steps: VecDeque<FakeStep>,
    counts: CaptureCounts,
}

impl FakeSource {
    /// A source that plays `steps` and is then finished.
    pub fn new(
        clock: Arc<dyn Clock>,
        description: SourceDescription,
        steps: impl IntoIterator<Item = FakeStep>,
    ) -> Self {
        Self {
            clock,
            description,
            steps: steps.into_iter().collect(),
            counts: CaptureCounts::default(),
        }
    }

    fn account(&mut self, frame: &Frame) {
        let counts = &mut self.counts;
        counts.received += 1;
        counts.lost.sequence_gap += u64::from(frame.meta.lost_before.sequence_gap);
        counts.lost.time_gap += u64::from(frame.meta.lost_before.time_gap);
        match frame.meta.fault {
            Some(FrameFault::DriverError) => counts.excluded.driver_error += 1,
            Some(FrameFault::Truncated) => counts.excluded.truncated += 1,
            Some(FrameFault::BrokenJpeg) => counts.excluded.broken_jpeg += 1,
            Some(FrameFault::Stale) => counts.excluded.stale += 1,
            None => {}
        }
        counts.expected = counts.received + counts.lost.total();
    }
}

impl FrameSource for FakeSource {
    fn describe(&self) -> SourceDescription {
        self.description.clone()
    }

    fn next(&mut self, wait: Duration) -> Result<Captured, CaptureError> {
        match self.steps.pop_front() {
            None => Ok(Captured::Finished),
            Some(FakeStep::Frame(frame)) => {
                self.account(&frame);
                Ok(Captured::Frame(frame))
            }
            Some(FakeStep::Event(event)) => Ok(Captured::Event(event)),
            Some(FakeStep::Fail(error)) => Err(error),
            Some(FakeStep::Silence(left)) => {
                let slept = left.min(wait);
                self.clock.sleep(slept);
                if left > slept {
                    self.steps.push_front(FakeStep::Silence(left - slept));
                }
                Ok(Captured::Nothing)
            }
        }
    }

    fn counts(&self) -> CaptureCounts {
        self.counts
    }
}
