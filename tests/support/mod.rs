//! What several tests of the chain need: a recording of the built-in rig, assembled as the daemon does.
#![allow(dead_code, clippy::unwrap_used)]

use hydroline::capture::sim::{Scene, SimCamera};
use hydroline::capture::{CaptureError, FrameSource};
use hydroline::clock::{Clock, SystemClock};
use hydroline::log::{
    FileParts, Head, LogReader, MetadataMap, PartOpener, Record, Recorder, WriteSettings,
};
use hydroline::record::{self, Job, Parts, Report};
use hydroline::shutdown::Shutdown;
use hydroline::stripe::ExtractorConfig;
use hydroline_calib::analytic::IdealMap;
use hydroline_rigs::{Camera, Plan, Rig};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// The same dark frame again and again: for tests that are not about images.
pub struct Dark(pub usize);

impl Scene for Dark {
    fn image_at(&mut self, _: f64, _: u64) -> Result<Vec<u8>, CaptureError> {
        Ok(vec![7; self.0])
    }
}

/// A camera of dark frames on the machine's clock.
pub fn dark_camera(camera: &Camera, clock: Arc<dyn Clock>) -> Box<dyn FrameSource> {
    let pixels = (camera.width_px * camera.height_px) as usize;
    Box::new(SimCamera::new(Dark(pixels), camera, clock))
}

/// A job on the built-in rig.
pub fn job(rig: &Rig, plan: Option<Plan>, length_s: f64) -> Job {
    Job {
        rig: rig.clone(),
        plan,
        length: Some(Duration::from_secs_f64(length_s)),
        ready_within: Duration::from_secs(20),
        extractor: ExtractorConfig::default(),
    }
}

/// Starts a recorder into a file.
pub fn recorder(rig: &Rig, opener: Box<dyn PartOpener>, clock: Arc<dyn Clock>) -> Recorder {
    let head = Head {
        rig_toml: rig.effective_toml.clone(),
        calibration_toml: None,
        session: MetadataMap::new(),
    };
    let settings = WriteSettings::live(&rig.log, Some(rig.camera.pixel_format));
    Recorder::start(opener, head, settings, clock).unwrap()
}

/// Records without thrusters from a source into a file.
pub fn record_into(path: &Path, rig: &Rig, source: Box<dyn FrameSource>, length_s: f64) -> Report {
    let clock: Arc<dyn Clock> = Arc::new(SystemClock);
    let recorder = recorder(
        rig,
        Box::new(FileParts {
            path: path.to_owned(),
            replace: false,
        }),
        clock.clone(),
    );
    let parts = Parts {
        source,
        line: None,
        recorder,
        clock,
        map: Some(Arc::new(IdealMap::of(rig))),
    };
    record::run(
        parts,
        &job(rig, None, length_s),
        &Shutdown::new(),
        &mut |_| {},
    )
    .unwrap()
}

/// All records of a log with their kinds counted.
pub fn read(path: &Path) -> (Vec<Record>, BTreeMap<String, MetadataMap>) {
    let mut reader = LogReader::open(path).unwrap();
    let records = reader.by_ref().map(|m| m.unwrap().record).collect();
    (records, reader.metadata().clone())
}

/// The binary under test.
pub fn hydroline() -> std::process::Command {
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_hydroline"));
    command
        .env_remove("RUST_LOG")
        .stdin(std::process::Stdio::null());
    command
}
