//! A camera by script: frames, silences, events and faults, exactly as scripted.
//!
//! For tests of everything behind a [`FrameSource`]: time is the injected clock's, so a
//! script of an hour runs in a moment on a `ManualClock` and paced on a `SystemClock`.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use super::gaps::due_after;
use super::{CaptureCounts, CaptureError, Captured, FrameSource, SourceDescription};
use hydroline_core::clock::Clock;
use hydroline_core::event::Event;
use hydroline_core::frame::{Frame, FrameFault};

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
    /// When the last frame was delivered \[ns\].
    last_ns: Option<u64>,
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
            last_ns: None,
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
                self.last_ns = Some(self.clock.monotonic_ns());
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

    /// Silence since the last frame counts as frozen, at the rate of the description (0 = no rate, nothing is due).
    fn finish(&mut self) {
        if let Some(last_ns) = self.last_ns.take() {
            let period_ns = 1e9 / self.description.rate_fps;
            self.counts.lost.frozen += due_after(last_ns, self.clock.monotonic_ns(), period_ns);
            self.counts.expected = self.counts.received + self.counts.lost.total();
        }
    }

    fn counts(&self) -> CaptureCounts {
        self.counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_core::clock::ManualClock;

    #[test]
    fn a_silence_at_the_end_is_lost_frames() {
        let clock = Arc::new(ManualClock::new(0, 1_700_000_000_000_000_000));
        let frames =
            (0..3).map(|i| FakeStep::Frame(hydroline_core::synthetic::grey_frame(i, 8, 8)));
        let steps = frames.chain([FakeStep::Silence(Duration::from_secs(2))]);
        let description = SourceDescription {
            rate_fps: 25.0,
            ..SourceDescription::default()
        };
        let mut source = FakeSource::new(clock, description, steps);
        while source.next(Duration::from_millis(100)).unwrap() != Captured::Finished {}
        source.finish();
        source.finish();
        let counts = source.counts();
        // 2 s at 25 frames/s less the one in flight, and the transfer.
        assert_eq!(
            (counts.received, counts.lost.frozen, counts.expected),
            (3, 48, 51)
        );
    }
}
