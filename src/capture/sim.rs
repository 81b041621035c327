//! The simulated camera: a [`FrameSource`] in real time that renders what the vehicle's camera would see.
//!
//! It behaves like a driver, not like a file: frames fall due by the clock whether or not anyone
//! fetches them, eight buffers hold them, and what falls due while all are full is lost with a gap
//! in the sequence. A machine too slow to render therefore shows losses, not a slower world.

use super::{
    CaptureCounts, CaptureError, Captured, FrameSource, NegotiatedFormat, SourceDescription,
};
use bytes::Bytes;
use hydroline_core::clock::Clock;
use hydroline_core::frame::{Frame, FrameMeta, LossBefore, StampClock, StampSource};
use hydroline_rigs::{Camera, PixelFormat};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

/// Buffers of the simulated driver, as our V4L2 queue asks for.
const BUFFERS: usize = 8;
/// Readout and USB transfer after the end of the exposure \[s\]: a USB 2 camera's order of magnitude.
const TRANSFER_S: f64 = 0.008;

/// Scene in front of the simulated camera.
pub trait Scene: Send {
    /// The 8-bit grey image, row-major, of the world at `t_s` seconds after the source's start;
    /// `index` seeds the frame's noise. Called with ascending times.
    fn image_at(&mut self, t_s: f64, index: u64) -> Result<Vec<u8>, CaptureError>;

    /// The latest time \[s\] that any row of the image stamped `t_s` shows; the frame is not there before it.
    fn complete_s(&self, t_s: f64) -> f64 {
        t_s
    }
}

/// A camera rendered in real time.
pub struct SimCamera<S> {
    scene: S,
    camera: Camera,
    clock: Arc<dyn Clock>,
    start_ns: u64,
    seen: u64,
    filled: VecDeque<u64>,
    last_delivered: Option<u64>,
    counts: CaptureCounts,
}

impl<S: Scene> SimCamera<S> {
    /// A camera whose first exposure starts now, on the given clock.
    pub fn new(scene: S, camera: &Camera, clock: Arc<dyn Clock>) -> Self {
        let start_ns = clock.monotonic_ns();
        Self {
            scene,
            camera: camera.clone(),
            clock,
            start_ns,
            seen: 0,
            filled: VecDeque::with_capacity(BUFFERS),
            last_delivered: None,
            counts: CaptureCounts {
                period_s: 1.0 / camera.rate_fps,
                ..CaptureCounts::default()
            },
        }
    }

    /// CLOCK_MONOTONIC of the first exposure's start \[ns\]: t_s = 0 of the scene.
    pub fn start_ns(&self) -> u64 {
        self.start_ns
    }

    /// Start of exposure `index`, from the source's start \[s\].
    fn exposure_start_s(&self, index: u64) -> f64 {
        index as f64 / self.camera.rate_fps
    }

    /// When the driver hands out frame `index`, CLOCK_MONOTONIC \[ns\].
    fn due_ns(&self, index: u64) -> u64 {
        let start_s = self.exposure_start_s(index);
        let half_s = 0.5 * self.camera.exposure_s;
        let beyond_s = (self.scene.complete_s(start_s + half_s) - (start_s + half_s)).max(0.0);
        let after_s = start_s + self.camera.exposure_s + TRANSFER_S + beyond_s;
        self.start_ns + (after_s * 1e9) as u64
    }

    /// Runs the driver up to now: it fills buffers, or loses frames while all are full.
    fn run_driver(&mut self, now_ns: u64) {
        while self.due_ns(self.seen) <= now_ns {
            if self.filled.len() < BUFFERS {
                self.filled.push_back(self.seen);
            }
            self.seen += 1;
        }
    }

    fn deliver(&mut self, index: u64) -> Result<Frame, CaptureError> {
        let mid_s = self.exposure_start_s(index) + 0.5 * self.camera.exposure_s;
        let pixels = self.scene.image_at(mid_s, index)?;
        let triple = self.clock.triple();
        let start_of_exposure_ns = self.start_ns + (self.exposure_start_s(index) * 1e9) as u64;
        let mid_ns = self.start_ns + (mid_s * 1e9) as u64;
        let gap = self.last_delivered.map_or(index, |last| index - last - 1);
        self.last_delivered = Some(index);
        self.counts.received += 1;
        self.counts.lost.sequence_gap += gap;
        self.counts.expected = index + 1;
        Ok(Frame {
            format: PixelFormat::Grey,
            width_px: self.camera.width_px,
            height_px: self.camera.height_px,
            stride_bytes: self.camera.width_px,
            data: Bytes::from(pixels),
            meta: FrameMeta {
                sequence: index as u32,
                driver_stamp_ns: start_of_exposure_ns,
                stamp_clock: StampClock::Monotonic,
                stamp_source: StampSource::StartOfExposure,
                flags: 0,
                received_monotonic_ns: triple.monotonic_ns,
                mid_exposure_ns: triple.monotonic_to_unix_ns(mid_ns),
                exposure_s: self.camera.exposure_s,
                fault: None,
                lost_before: LossBefore {
                    sequence_gap: gap.min(u64::from(u32::MAX)) as u32,
                    time_gap: 0,
                },
            },
        })
    }
}

impl<S: Scene> FrameSource for SimCamera<S> {
    fn describe(&self) -> SourceDescription {
        SourceDescription {
            kind: "sim".to_owned(),
            driver: "hydroline-sim".to_owned(),
            driver_version: hydroline_core::build_info::VERSION.to_owned(),
            card: "simulated camera".to_owned(),
            format: NegotiatedFormat {
                fourcc: "GREY".to_owned(),
                width_px: self.camera.width_px,
                height_px: self.camera.height_px,
                stride_bytes: self.camera.width_px,
                size_bytes: self.camera.width_px * self.camera.height_px,
                field: "none".to_owned(),
                yuv_range: None,
            },
            rate_fps: self.camera.rate_fps,
            buffers: BUFFERS as u32,
            ..SourceDescription::default()
        }
    }

    fn next(&mut self, wait: Duration) -> Result<Captured, CaptureError> {
        let mut now_ns = self.clock.monotonic_ns();
        self.run_driver(now_ns);
        if self.filled.is_empty() {
            let left_ns = self.due_ns(self.seen).saturating_sub(now_ns);
            self.clock.sleep(Duration::from_nanos(left_ns).min(wait));
            now_ns = self.clock.monotonic_ns();
            self.run_driver(now_ns);
        }
        match self.filled.pop_front() {
            Some(index) => self.deliver(index).map(Captured::Frame),
            None => Ok(Captured::Nothing),
        }
    }

    fn finish(&mut self) {
        let now_ns = self.clock.monotonic_ns();
        self.run_driver(now_ns);
        // The frame that fell due in the last period is the one in flight: the caller was about to fetch it.
        let period_ns = (1e9 / self.camera.rate_fps) as u64;
        let from = self.last_delivered.map_or(0, |last| last + 1);
        let due = (from..self.seen)
            .take_while(|index| self.due_ns(*index).saturating_add(period_ns) <= now_ns)
            .count() as u64;
        self.counts.lost.sequence_gap += due;
        self.counts.lost_at_end += due;
        self.counts.expected = from + due;
        self.filled.clear();
        self.last_delivered = (from + due).checked_sub(1);
    }

    fn counts(&self) -> CaptureCounts {
        let mut counts = self.counts;
        counts.disagreement =
            (counts.received + counts.lost.total()) as i64 - counts.expected as i64;
        counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_core::clock::ManualClock;

    /// Records the times it was asked for.
    struct Times(Arc<std::sync::Mutex<Vec<(f64, u64)>>>);

    impl Scene for Times {
        fn image_at(&mut self, t_s: f64, index: u64) -> Result<Vec<u8>, CaptureError> {
            self.0.lock().unwrap().push((t_s, index));
            Ok(vec![0; 64])
        }
    }

    fn camera() -> Camera {
        let mut camera = hydroline_rigs::Rig::builtin("lshpi").unwrap().camera;
        (
            camera.width_px,
            camera.height_px,
            camera.rate_fps,
            camera.exposure_s,
        ) = (8, 8, 25.0, 0.01);
        camera
    }

    #[test]
    fn frames_fall_due_by_the_clock_and_are_stamped_at_mid_exposure() {
        let clock = Arc::new(ManualClock::new(5_000_000_000, 1_700_000_000_000_000_000));
        let asked = Arc::new(std::sync::Mutex::new(Vec::new()));
        let mut source = SimCamera::new(Times(asked.clone()), &camera(), clock.clone());
        let mut frames = Vec::new();
        while frames.len() < 10 {
            if let Captured::Frame(frame) = source.next(Duration::from_millis(15)).unwrap() {
                frames.push(frame);
            }
        }
        for (k, frame) in frames.iter().enumerate() {
            assert_eq!(frame.meta.sequence as usize, k);
            assert_eq!(
                frame.meta.mid_exposure_ns,
                1_700_000_000_005_000_000 + k as u64 * 40_000_000
            );
            assert!(frame.meta.received_monotonic_ns >= frame.meta.driver_stamp_ns + 18_000_000);
        }
        assert_eq!(asked.lock().unwrap()[3], (3.0 / 25.0 + 0.005, 3));
        assert_eq!(source.counts().disagreement, 0);
    }

    #[test]
    fn what_was_due_at_the_stop_and_never_fetched_is_lost() {
        let clock = Arc::new(ManualClock::new(0, 1_700_000_000_000_000_000));
        let mut source = SimCamera::new(Times(Arc::default()), &camera(), clock.clone());
        let mut received = 0;
        while received < 50 {
            if let Captured::Frame(_) = source.next(Duration::from_millis(40)).unwrap() {
                received += 1;
            }
        }
        // Just after a frame, and a whole period later: only the frame in flight is missing.
        source.finish();
        assert_eq!(
            (source.counts().lost.total(), source.counts().expected),
            (0, 50)
        );
        clock.advance(Duration::from_millis(60));
        source.finish();
        assert_eq!(
            (source.counts().lost.total(), source.counts().expected),
            (0, 50)
        );
        // Frame 49 fell due at 1.978 s; by 10 s frame 249 (due 9.978 s) is in flight, 50..=248 are lost.
        clock.advance(Duration::from_nanos(10_000_000_000 - clock.monotonic_ns()));
        source.finish();
        let counts = source.counts();
        assert_eq!(
            (
                counts.received,
                counts.lost.total(),
                counts.expected,
                counts.disagreement
            ),
            (50, 199, 249, 0)
        );
    }

    #[test]
    fn what_falls_due_while_all_buffers_are_full_is_lost_and_counted() {
        let clock = Arc::new(ManualClock::new(0, 1_700_000_000_000_000_000));
        let mut source = SimCamera::new(Times(Arc::default()), &camera(), clock.clone());
        clock.advance(Duration::from_millis(18 + 40 * 19)); // frames 0..=19 are due, 8 fit
        let mut sequences = Vec::new();
        for _ in 0..9 {
            if let Captured::Frame(frame) = source.next(Duration::from_millis(40)).unwrap() {
                sequences.push((frame.meta.sequence, frame.meta.lost_before.sequence_gap));
            }
        }
        assert_eq!(
            sequences[..8].iter().map(|s| s.0).collect::<Vec<_>>(),
            (0..8).collect::<Vec<_>>()
        );
        assert_eq!(sequences[8], (20, 12));
        let counts = source.counts();
        assert_eq!(
            (
                counts.received,
                counts.lost.sequence_gap,
                counts.expected,
                counts.disagreement
            ),
            (9, 12, 21, 0)
        );
    }
}
