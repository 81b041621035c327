//! Capture jitter under a stalled disk: how long the daemon keeps the capture thread away from its
//! source per frame, with a good disk and with one that stands still for 500 ms every 2 s.
//!
//! `cargo bench -p hydroline-daemon --bench stall` (about 25 s). Asked: p99 <= 1 ms over the source's own, no frame lost.
#![allow(clippy::unwrap_used, missing_docs)]

#[path = "../../../tests/support/slow_disk.rs"]
mod slow_disk;

use hydroline_capture::sim::{Scene, SimCamera};
use hydroline_capture::{CaptureCounts, CaptureError, Captured, FrameSource, SourceDescription};
use hydroline_core::clock::{Clock, SystemClock};
use hydroline_core::shutdown::Shutdown;
use hydroline_daemon::record::{self, Job, Parts};
use hydroline_log::{Head, MetadataMap, Recorder, WriteSettings};
use hydroline_rigs::Rig;
use hydroline_sim::{Pose6, Renderer};
use hydroline_stripe::ExtractorConfig;
use slow_disk::BadDisk;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// One rendered frame again and again: noise that does not compress well, a real stripe, no time to render.
struct Still(Vec<u8>);

impl Scene for Still {
    fn image_at(&mut self, _: f64, _: u64) -> Result<Vec<u8>, CaptureError> {
        Ok(self.0.clone())
    }
}

/// Notes how long the daemon stays away between two calls.
struct Timed {
    inner: SimCamera<Still>,
    returned: Option<Instant>,
    away: Arc<Mutex<Vec<Duration>>>,
}

impl FrameSource for Timed {
    fn describe(&self) -> SourceDescription {
        self.inner.describe()
    }
    fn counts(&self) -> CaptureCounts {
        self.inner.counts()
    }
    fn finish(&mut self) {
        self.inner.finish();
    }
    fn next(&mut self, wait: Duration) -> Result<Captured, CaptureError> {
        if let Some(returned) = self.returned.take() {
            self.away.lock().unwrap().push(returned.elapsed());
        }
        let captured = self.inner.next(wait)?;
        if matches!(captured, Captured::Frame(_)) {
            self.returned = Some(Instant::now());
        }
        Ok(captured)
    }
}

fn run(stall_ms: u64) -> (Vec<Duration>, u64, u64, u64) {
    let mut rig = Rig::builtin("lshpi").unwrap();
    rig.log.min_free_bytes = 0;
    let clock: Arc<dyn Clock> = Arc::new(SystemClock);
    let dir = tempfile::tempdir().unwrap();
    let stalls = Arc::new(AtomicU64::new(0));
    let disk = BadDisk {
        path: dir.path().join("bench.mcap"),
        every: Duration::from_secs(2),
        stall: Duration::from_millis(stall_ms),
        room_bytes: u64::MAX,
        stalls: stalls.clone(),
    };
    let head = Head {
        rig_toml: String::new(),
        calibration_toml: None,
        session: MetadataMap::new(),
        ..Head::default()
    };
    let settings = WriteSettings::live(&rig.log, Some(rig.camera.pixel_format));
    let recorder = Recorder::start(Box::new(disk), head, settings, clock.clone()).unwrap();
    let [x, y, z, phi, theta, psi] = rig.tank.start_pose;
    let pose = Pose6 {
        x_m: x,
        y_m: y,
        z_m: z,
        phi_rad: phi,
        theta_rad: theta,
        psi_rad: psi,
    };
    let image = Renderer::new(&rig).unwrap().render(&pose, 0).0;
    let away = Arc::new(Mutex::new(Vec::new()));
    let inner = SimCamera::new(Still(image), &rig.camera, clock.clone());
    let source = Box::new(Timed {
        inner,
        returned: None,
        away: away.clone(),
    });
    let parts = Parts {
        source,
        line: None,
        recorder,
        clock,
        map: None,
        live: None,
    };
    let job = Job {
        rig,
        plan: None,
        length: Some(Duration::from_secs(10)),
        ready_within: Duration::from_secs(5),
        extractor: ExtractorConfig::default(),
        calibrate: None,
        unattended: false,
    };
    let report = record::run(parts, &job, &Shutdown::new(), Box::new(|_| {})).unwrap();
    let lost = report.capture.lost.total() + report.log.counts.frames_dropped;
    let away = away.lock().unwrap().clone();
    (
        away,
        report.capture.received,
        lost,
        stalls.load(Ordering::Relaxed),
    )
}

fn main() {
    println!(
        "{:<22} {:>7} {:>5} {:>7} {:>10} {:>10} {:>10}",
        "disk", "frames", "lost", "stalls", "p50 ms", "p99 ms", "max ms"
    );
    for (name, stall_ms) in [("good", 0), ("500 ms stall every 2 s", 500)] {
        let (mut away, frames, lost, stalls) = run(stall_ms);
        away.sort();
        let at = |q: f64| away[((away.len() - 1) as f64 * q) as usize].as_secs_f64() * 1e3;
        println!(
            "{name:<22} {frames:>7} {lost:>5} {stalls:>7} {:>10.3} {:>10.3} {:>10.3}",
            at(0.5),
            at(0.99),
            at(1.0)
        );
    }
}
